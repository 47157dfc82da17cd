"""``ridlink fly``: takes a vehicle off, hands it over to a daemon, lands it."""

from __future__ import annotations

import json
import shlex
import sys
import time
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli import EXIT_DONE, EXIT_NEGATIVE
from ridlink.cli.options import above_zero
from ridlink.cli.printing import PAGING_S, Printer
from ridlink.cli.signals import end_by_interrupts, stopped_by_signals

if TYPE_CHECKING:
    import asyncio
    from asyncio.subprocess import Process
    from collections.abc import Coroutine

    from ridlink.conductor import Conductor, End
    from ridlink.links import LinkUrl

RUNNING = "running"
DAEMON_ENDS_S = 5.0


@click.command(short_help="Take off with MAVSDK, hand over to a daemon, land.")
@click.option(
    "--vehicle",
    default="udpout:127.0.0.1:14580",
    show_default=True,
    metavar="URL",
    help="Link to the autopilot; another one than the daemon's.",
)
@click.option(
    "--takeoff",
    "height_m",
    type=float,
    required=True,
    callback=above_zero,
    metavar="M",
    help="Arm, and climb to this height over home.",
)
@click.option(
    "--daemon",
    metavar="OPTIONS",
    help="Start `ridlink avoid OPTIONS` beside it and hand over to it; 'running': to one that runs already.",
)
@click.option("--land", is_flag=True, help="Land at the end; otherwise the vehicle is left holding.")
@click.option(
    "--health-timeout",
    "health_s",
    type=float,
    default=60.0,
    show_default=True,
    callback=above_zero,
    metavar="S",
    help="So long a vehicle may take to be ready.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a step on standard output.")
def fly(vehicle: str, height_m: float, daemon: str | None, land: bool, health_s: float, as_json: bool) -> int:
    """Take one vehicle off, hand it over to its avoidance daemon, wait until it has arrived, and land it.

    \b
    ridlink fly --takeoff 50 --daemon "--goal 47.3995,8.5456" --land
    ridlink fly --vehicle udpin:0.0.0.0:14550 --takeoff 20 --daemon running --land

    For PX4 and ArduPilot. The command itself is the order to arm. Whoever changes the mode meanwhile has the vehicle;
    Ctrl-C ends the daemon and holds, or lands. Ends with 0 if all was flown, with 1 if something was refused or did not
    come about.
    """
    import asyncio

    from ridlink.conductor import FlightError
    from ridlink.links import parse_link_url

    options = None if daemon in (None, RUNNING) else _split(daemon)
    link = parse_link_url(vehicle)
    end_by_interrupts()
    printer = Printer()
    flight = _Flight(link, height_m, daemon, land, health_s, as_json, printer)
    try:
        try:
            asyncio.run(flight.run(options))
        except FlightError as error:
            printer.put(f"ridlink: {error}\n", error=True)
            flight.outcome = "failed"
            flight.reason = str(error)
        if as_json:
            printer.put(json.dumps(flight.final()) + "\n")
        if flight.outcome != "stopped":  # nobody has asked for the end, so nobody waits for it
            printer.patience_s = PAGING_S
    finally:
        printer.close()
    return EXIT_DONE if flight.outcome == "done" else EXIT_NEGATIVE


def _split(text: str | None) -> list[str]:
    """The options of a daemon, checked before anything flies.

    Raises:
        click.UsageError: If `ridlink avoid` would not take them.
    """
    from ridlink.cli.avoid import avoid

    try:
        options = shlex.split(text or "")
        avoid.make_context("ridlink avoid", list(options), resilient_parsing=False)
    except (ValueError, click.UsageError) as error:
        words = error.format_message() if isinstance(error, click.UsageError) else str(error)
        raise click.UsageError(f"--daemon: {words} as options of 'ridlink avoid', as in '--goal 47.39,8.54'") from None
    return options


async def _unless(stop: asyncio.Event, work: Coroutine[Any, Any, Any]) -> Any:
    """What comes of it, or nothing where a signal comes first: on the ground there is nothing to wait for."""
    import asyncio

    doing, ending = asyncio.ensure_future(work), asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait({doing, ending}, return_when=asyncio.FIRST_COMPLETED)
        return doing.result() if doing.done() else None
    finally:
        for each in (doing, ending):
            each.cancel()
        await asyncio.gather(doing, ending, return_exceptions=True)


class _Flight:
    """What is to be flown, and what has been."""

    def __init__(
        self,
        link: LinkUrl,
        height_m: float,
        daemon: str | None,
        land: bool,
        health_s: float,
        as_json: bool,
        printer: Printer,
    ) -> None:
        self._link, self._height_m, self._daemon, self._land = link, height_m, daemon, land
        self._health_s, self._as_json, self._printer = health_s, as_json, printer
        self._process: Process | None = None
        self._began_s = time.monotonic()
        self.outcome, self.reason = "", ""
        self._ordered = self._up = self._arrived = self._landed = False

    def say(self, text: str) -> None:
        """One line of progress."""
        self._printer.put(f"{time.monotonic() - self._began_s:6.1f} s  {text}\n", error=True)
        if self._as_json:
            self._printer.put(json.dumps({"event": "progress", "t": round(time.time(), 3), "text": text}) + "\n")

    def final(self) -> dict[str, Any]:
        """What it came to."""
        return {
            "event": "final", "outcome": self.outcome, "reason": self.reason, "took_off": self._up,
            "arrived": self._arrived, "landed": self._landed, "time_s": round(time.monotonic() - self._began_s, 1),
        }  # fmt: skip

    async def run(self, options: list[str] | None) -> None:
        """Fly; the daemon that was started for it is ended whatever happens."""
        import asyncio

        from ridlink.conductor import Conductor, FlightError, TakenError, connect, mavsdk_ground_station

        stop = stopped_by_signals(asyncio.get_running_loop())
        async with mavsdk_ground_station() as mavsdk:
            self.say(f"looking for an autopilot on {self._link}")
            system = await _unless(stop, connect(mavsdk, self._link))
            if system is None:
                self._stopped_on_the_ground()
                return
            conductor = Conductor(system, self.say, self._daemon_has_ended)
            await conductor.open()
            try:
                await self._fly(conductor, options, stop)
            except TakenError:
                raise
            except FlightError:
                if self._ordered and self._land and not self._landed and await conductor.is_armed():
                    await conductor.land()
                    self._landed = True
                raise
            finally:
                await conductor.close()
                await self._end_daemon()

    async def _fly(self, conductor: Conductor, options: list[str] | None, stop: asyncio.Event) -> None:
        if options is not None:
            await self._start_daemon(options)
        if self._daemon is not None:
            await _unless(stop, conductor.find_daemon())
        await _unless(stop, conductor.wait_healthy(self._health_s))
        if stop.is_set():
            self._stopped_on_the_ground()
            return
        self._ordered = True
        await conductor.take_off(self._height_m)
        self._up = True
        self.outcome = "done"
        end = None
        if self._daemon is not None and not stop.is_set():
            await conductor.hand_over()
            end = await conductor.follow(stop)
        elif stop.is_set():
            self.outcome = "stopped"
        await self._down(conductor, end)

    def _stopped_on_the_ground(self) -> None:
        self.outcome = "stopped"
        self.say("stopped before the take-off")

    async def _down(self, conductor: Conductor, end: End | None) -> None:
        from ridlink.conductor import End, FlightError, TakenError

        self._arrived = end is End.ARRIVED
        match end:
            case End.TAKEN:
                raise TakenError
            case End.ARRIVED:
                self.say("arrived")
            case End.STOPPED:
                self.outcome = "stopped"
            case End.LANDING:
                self.say("comes down by itself")
        if self._land or end is End.LANDING:
            await conductor.land()
            self._landed = True
        elif end is not None:
            await conductor.hold()
        if end is End.DAEMON_LOST:
            raise FlightError(end)

    # --- the daemon ---------------------------------------------------------------------------------------------------

    async def _start_daemon(self, options: list[str]) -> None:
        import asyncio

        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "ridlink", "avoid", *options,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C of the terminal is not for it: it flies until it is ended from here
        )  # fmt: skip
        self.say(f"started: ridlink avoid {shlex.join(options)}")

    def _daemon_has_ended(self) -> bool:
        return self._process is not None and self._process.returncode is not None

    async def _end_daemon(self) -> None:
        import asyncio

        if self._process is None:
            return
        if self._process.returncode is None:
            self._process.terminate()
        try:
            await asyncio.wait_for(self._process.wait(), DAEMON_ENDS_S)
        except TimeoutError:
            self._process.kill()
            await self._process.wait()
