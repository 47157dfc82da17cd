"""One conducted flight, from the search for the vehicle to its landing; it may start the daemon as well."""

from __future__ import annotations

import asyncio
import shlex
import sys
import time
from asyncio.subprocess import DEVNULL, Process
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from ridlink.conductor.outcome import End, FlightError, SilentError, TakenError
from ridlink.conductor.station import connect, mavsdk_ground_station
from ridlink.conductor.vehicle import Conductor
from ridlink.geodesy import Geodetic
from ridlink.links import LinkUrl

DAEMON_ENDS_S = 5.0


async def _unless(stop: asyncio.Event, work: Coroutine[Any, Any, Any]) -> Any:
    """The result of ``work``, or None if ``stop`` is set first: on the ground nothing must be waited for."""
    doing, ending = asyncio.ensure_future(work), asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait({doing, ending}, return_when=asyncio.FIRST_COMPLETED)
        return doing.result() if doing.done() else None
    finally:
        for each in (doing, ending):
            each.cancel()
        await asyncio.gather(doing, ending, return_exceptions=True)


class ConductedFlight:
    """A conducted flight and its outcome.

    Args:
        link: Link to the autopilot.
        height_m: Height above home to climb to.
        health_s: Longest time to wait until the vehicle can be armed.
        lands: Land at the end; otherwise the vehicle is left holding its position.
        under_daemon: Hand the vehicle over to a daemon.
        daemon_options: Start the daemon, `ridlink avoid`, with these options; None: start no daemon.
        objection: Called with the position of the vehicle before it is armed; what it returns, if it is not empty,
            prevents the flight.
        say: Called with a line for every step.

    Attributes:
        outcome: "done", "stopped" or "failed".
        reason: Why the flight failed; empty otherwise.
    """

    def __init__(
        self,
        link: LinkUrl,
        height_m: float,
        *,
        health_s: float,
        lands: bool,
        under_daemon: bool,
        daemon_options: Sequence[str] | None,
        objection: Callable[[Geodetic], str],
        say: Callable[[str], None],
    ) -> None:
        self._link, self._height_m, self._health_s, self._lands = link, height_m, health_s, lands
        self._under_daemon, self._daemon_options, self._say = under_daemon, daemon_options, say
        self._objection = objection
        self._process: Process | None = None
        self._began_s = time.monotonic()
        self.outcome, self.reason = "", ""
        self._ordered = self._up = self._arrived = self._landed = False

    @property
    def elapsed_s(self) -> float:
        """Time since the flight began."""
        return time.monotonic() - self._began_s

    def as_dict(self) -> dict[str, Any]:
        """The outcome, for JSON."""
        return {
            "event": "final", "outcome": self.outcome, "reason": self.reason, "took_off": self._up,
            "arrived": self._arrived, "landed": self._landed, "time_s": round(self.elapsed_s, 1),
        }  # fmt: skip

    async def run(self, stop: asyncio.Event) -> None:
        """Fly. A daemon started for the flight is ended in every case.

        Args:
            stop: Set it to end: on the ground at once, in the air by holding or landing.

        Raises:
            LinkError: If the link cannot be opened, or no autopilot is heard.
            FlightError: If the vehicle refused something or did not do it in time; `outcome` is then "failed".
        """
        try:
            async with mavsdk_ground_station() as mavsdk:
                self._say(f"looking for an autopilot on {self._link}")
                system = await _unless(stop, connect(mavsdk, self._link))
                if system is None:
                    self._stopped_on_the_ground()
                    return
                await self._conduct(Conductor(system, self._say, self._daemon_has_ended, stop.is_set), stop)
        except FlightError as error:
            self.outcome, self.reason = "failed", str(error)
            raise

    async def _conduct(self, conductor: Conductor, stop: asyncio.Event) -> None:
        await conductor.open()
        try:
            await self._fly(conductor, stop)
        except (TakenError, SilentError):
            raise
        except FlightError:
            if self._ordered and self._lands and not self._landed and await conductor.is_armed():
                await conductor.land()
                self._landed = True
            raise
        finally:
            await conductor.close()
            await self._end_daemon()

    async def _fly(self, conductor: Conductor, stop: asyncio.Event) -> None:
        if self._daemon_options is not None:
            await self._start_daemon(self._daemon_options)
        if self._under_daemon:
            await _unless(stop, conductor.find_daemon())
        await _unless(stop, conductor.wait_healthy(self._health_s))
        if stop.is_set():
            self._stopped_on_the_ground()
            return
        if objection := self._objection(await conductor.position()):
            raise FlightError(objection)
        self._ordered = True
        await conductor.take_off(self._height_m)
        self._up = True
        self.outcome = "done"
        end = None
        if self._under_daemon and not stop.is_set():
            await conductor.hand_over()
            end = End.STOPPED if stop.is_set() else await conductor.follow(stop)
        elif stop.is_set():
            self.outcome = "stopped"
        await self._down(conductor, end)

    def _stopped_on_the_ground(self) -> None:
        self.outcome = "stopped"
        self._say("stopped before the take-off")

    async def _down(self, conductor: Conductor, end: End | None) -> None:
        self._arrived = end is End.ARRIVED
        match end:
            case End.TAKEN:
                raise TakenError
            case End.ARRIVED:
                self._say("arrived")
            case End.STOPPED:
                self.outcome = "stopped"
            case End.LANDING:
                self._say("comes down by itself")
        if self._lands or end is End.LANDING:
            await conductor.land()
            self._landed = True
        elif end is not None:
            await conductor.hold()
        if end is End.DAEMON_LOST:
            raise FlightError(end)

    # --- the daemon ---------------------------------------------------------------------------------------------------

    async def _start_daemon(self, options: Sequence[str]) -> None:
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "ridlink", "avoid", *options, stdin=DEVNULL, stdout=DEVNULL,
            start_new_session=True,  # Ctrl-C of the terminal must not reach the daemon: this flight ends it
        )  # fmt: skip
        self._say(f"started: ridlink avoid {shlex.join(options)}")

    def _daemon_has_ended(self) -> bool:
        return self._process is not None and self._process.returncode is not None

    async def _end_daemon(self) -> None:
        if self._process is None:
            return
        if self._process.returncode is None:
            self._process.terminate()
        try:
            async with asyncio.timeout(DAEMON_ENDS_S):
                await self._process.wait()
        except TimeoutError:
            self._process.kill()
            await self._process.wait()
