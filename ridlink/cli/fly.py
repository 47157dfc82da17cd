"""``ridlink fly``: takes off with a vehicle, hands it over to a daemon, lands it."""

from __future__ import annotations

import json
import shlex
import time
from typing import TYPE_CHECKING

import click

from ridlink.cli import EXIT_DONE, EXIT_NEGATIVE
from ridlink.cli.options import above_zero
from ridlink.cli.printing import PAGING_S, Printer
from ridlink.cli.signals import end_by_interrupts, stopped_by_signals
from ridlink.ranges import Range

if TYPE_CHECKING:
    from ridlink.daemon.config import DaemonConfig
    from ridlink.geodesy import Geodetic

RUNNING = "running"

TAKEOFF_RANGE = Range(0.5, 1000.0, "m")
"""Heights above home to climb to. A larger one was meant in feet or in another number of digits."""


def _height(_: click.Context, __: click.Parameter, value: float) -> float:
    TAKEOFF_RANGE.check("takeoff", value)
    return value


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
    callback=_height,
    metavar="M",
    help="Arm, and climb to this height over home, at most 1000 m.",
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
    help="How long the vehicle may take to be ready once it is heard; it must be heard within 10 s.",
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

    from ridlink.cli.avoid import configuration
    from ridlink.conductor import ConductedFlight, FlightError
    from ridlink.links import parse_link_url

    options, given = (None, None) if daemon in (None, RUNNING) else _split(daemon)
    config = None if given is None else configuration(given)
    link = parse_link_url(vehicle)
    if not link.port:
        raise click.UsageError(f"--vehicle {link}: MAVSDK listens on no port but one that is named")
    end_by_interrupts()
    printer = Printer()

    def say(text: str) -> None:
        printer.put(f"{flight.elapsed_s:6.1f} s  {text}\n", error=True)
        if as_json:
            printer.put(json.dumps({"event": "progress", "t": round(time.time(), 3), "text": text}) + "\n")

    flight = ConductedFlight(
        link,
        height_m,
        health_s=health_s,
        lands=land,
        under_daemon=daemon is not None,
        daemon_options=options,
        objection=lambda own: "" if config is None else _objection(own, config),
        say=say,
    )

    async def run() -> None:
        await flight.run(stopped_by_signals(asyncio.get_running_loop()))

    try:
        try:
            asyncio.run(run())
        except FlightError as error:
            printer.put(f"ridlink: {error}\n", error=True)
        if as_json:
            printer.put(json.dumps(flight.as_dict()) + "\n")
        if flight.outcome != "stopped":  # nobody asked for the end, so the reader may take longer
            printer.patience_s = PAGING_S
    finally:
        printer.close()
    return EXIT_DONE if flight.outcome == "done" else EXIT_NEGATIVE


def _objection(own: Geodetic, config: DaemonConfig) -> str:
    """Why a daemon would not fly from this position; empty if it would."""
    from ridlink.daemon.far_away import of_goal

    goal, settings = config.engine.goal, config.engine.failsafe
    return "" if goal is None or goal.away_m(own) <= settings.farthest_goal_m else of_goal(own, goal, settings)


def _split(text: str | None) -> tuple[list[str], click.Context]:
    """The options of a daemon, checked before the flight.

    Raises:
        click.UsageError: If `ridlink avoid` would refuse them.
    """
    from ridlink.cli.avoid import avoid

    try:
        options = shlex.split(text or "")
        context = avoid.make_context("ridlink avoid", list(options), resilient_parsing=False)
    except (ValueError, click.UsageError) as error:
        words = error.format_message() if isinstance(error, click.UsageError) else str(error)
        raise click.UsageError(f"--daemon, options of 'ridlink avoid' such as '--goal 47.39,8.54': {words}") from None
    return options, context
