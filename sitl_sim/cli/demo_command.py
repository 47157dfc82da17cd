"""``ridlink demo``: flies an emulated fleet with its avoidance daemons, and judges the flight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from ridlink.cli import EXIT_DONE, EXIT_NEGATIVE
from ridlink.cli.options import DEFINITIONS, PATH, accuracy_convention, eta_option
from ridlink.cli.printing import PAGING_S, Printer
from ridlink.cli.signals import end_by_interrupts, ended_by_signals, stopped_by_signals
from ridlink.cli.view import announce
from ridlink.errors import LinkError, MissingExtraError
from sitl_sim.cli.options import fleet_options

if TYPE_CHECKING:
    from collections.abc import Callable

    from sitl_sim.demo.options import DemoOptions
    from sitl_sim.demo.page import Page
    from sitl_sim.demo.screen import Screen

SOLVERS = ("halfplane", "graded", "rotation")
COMPARED = ("snmac", "remote-id", "candidate1", "candidate2")


@click.command(short_help="Fly emulated vehicles through one point, each with its daemon, and judge it.")
@fleet_options
@click.option(
    "--definition",
    type=click.Choice(DEFINITIONS),
    default="candidate2",
    show_default=True,
    help="What sizes the disc of a pair.",
)
@eta_option()
@accuracy_convention
@click.option(
    "--solver", type=click.Choice(SOLVERS), default="halfplane", show_default=True, help="What chooses the velocity."
)
@click.option("--vertical", is_flag=True, help="Daemons climb or descend, too, where turning is not enough.")
@click.option(
    "--from-ground",
    is_flag=True,
    help="Begin on the ground: MAVSDK conductors arm every vehicle, take it off, hand it over and land it.",
)
@click.option("--compare", is_flag=True, help=f"Fly the same seed under {', '.join(COMPARED)}, one after the other.")
@click.option(
    "--processes",
    is_flag=True,
    help="Each daemon in an operating-system process of its own; without it all share one, apart from the fleet.",
)
@click.option("--headless", is_flag=True, help="Neither a table nor the page: how far it is, and the verdict.")
@click.option("--no-view", is_flag=True, help="Do not serve the page.")
@click.option(
    "--view-port",
    type=click.IntRange(0, 65535),
    metavar="PORT",
    help="Port of the page; 0 = any.  [default: 8090, or any if that is in use]",
)
@click.option(
    "--stay", is_flag=True, help="Keep the page after the flight, until Ctrl-C.  [default: if there is a terminal]"
)
@click.option("--open", "opens", is_flag=True, help="Open the page in a browser.")
@click.option("--json", "as_json", is_flag=True, help="The verdict of each flight as one line of JSON on stdout.")
@click.option("--any-ports", is_flag=True, help="Ports that the kernel chooses, to fly several demos side by side.")
@click.option(
    "--log",
    type=PATH,
    metavar="FILE.tlog",
    help="Record the flight there; replaces the file.  [default: a new file in the temporary folder]",
)
def demo(
    fleet: dict[str, Any],
    definition: str,
    eta: float,
    accuracy_convention: str,
    solver: str,
    vertical: bool,
    from_ground: bool,
    compare: bool,
    processes: bool,
    headless: bool,
    no_view: bool,
    view_port: int | None,
    stay: bool,
    opens: bool,
    as_json: bool,
    any_ports: bool,
    log: Path | None,
) -> int:
    """Fly emulated vehicles through one point, each with its avoidance daemon, and judge it.

    Every message is real MAVLink on UDP of this machine. The daemons know what Remote ID tells them; only the
    referee and the page know where the vehicles truly are. Ends with 0 if every vehicle arrived and none collided,
    with 1 otherwise.

    \b
    Examples:
      ridlink demo
      ridlink demo --scenario square24 --headless --json
      ridlink demo --compare --autopilot ideal --gnss white-radial --sigma 10 --speed 30.7
    """
    import asyncio

    from ridlink.avoidance.types import SolverKind
    from ridlink.remote_id.accuracy import AccuracyConvention
    from ridlink.separation.definitions import Definition
    from sitl_sim.autopilot import Start
    from sitl_sim.cli.options import fleet_config
    from sitl_sim.demo.flight import fly, scenario_of
    from sitl_sim.demo.options import DemoOptions, any_free_ports
    from sitl_sim.demo.screen import Screen

    config = fleet_config(fleet, Start.GROUND if from_ground else Start.HOLDING)
    options = DemoOptions(
        scenario=fleet["scenario"],
        definition=Definition(definition),
        eta=eta,
        accuracy_convention=AccuracyConvention(accuracy_convention),
        solver=SolverKind(solver),
        vertical=vertical,
        count=fleet["count"],
        speed_mps=fleet["speed_mps"],
        interval_s=fleet["interval_s"],
        fleet=any_free_ports(config) if any_ports else config,
        processes=processes,
        log=log,
    )
    if (headless or no_view) and (stay or opens or view_port is not None):
        raise click.UsageError("--stay, --open and --view-port are about the page, which is not served here")
    if compare and click.get_current_context().get_parameter_source("definition") is not ParameterSource.DEFAULT:
        raise click.UsageError(f"--compare flies {', '.join(COMPARED)}: --definition does not go with it")
    if any_ports and view_port is None:
        view_port = 0
    scenario_of(options)  # fails before a page is opened if the scenario is wrong
    end_by_interrupts()
    printer = Printer()
    screen = Screen(printer.stream(error=True), table=not headless)
    flights = _compared(options) if compare else [options]
    tell_one, tell_all = _words(printer, screen, compare=compare, as_json=as_json)

    async def fly_all() -> list[dict[str, Any]]:
        page = None if headless or no_view else await _open_page(screen, printer, view_port, opens)
        results: list[dict[str, Any]] = []
        try:
            for chosen in flights:
                results.append(await _until_signal(fly(chosen, screen, page), printer))
                tell_one(results[-1])
            tell_all(results)
            if page is not None and (stay or screen.is_terminal):
                printer.put(f"ridlink: the page stays at {page.server.url} until Ctrl-C\n", error=True)
                await stopped_by_signals(asyncio.get_running_loop()).wait()
            else:
                printer.patience_s = PAGING_S  # nobody asked for the end, so the reader may take longer
        finally:
            if page is not None:
                await page.close()
        return results

    try:
        results = asyncio.run(fly_all())
    finally:
        printer.close()
    return EXIT_DONE if all(result["passed"] for result in results) else EXIT_NEGATIVE


def _compared(options: DemoOptions) -> list[DemoOptions]:
    """Options of the same flight under every definition to compare, each with its own log."""
    from dataclasses import replace

    from ridlink.separation.definitions import Definition

    log = options.log
    return [
        replace(options, definition=Definition(each), log=log and log.with_stem(f"{log.stem}-{each}"))
        for each in COMPARED
    ]


def _words(
    printer: Printer, screen: Screen, *, compare: bool, as_json: bool
) -> tuple[Callable[[dict[str, Any]], None], Callable[[list[dict[str, Any]]], None]]:
    """Two functions: one prints a flight when it is over, the other all flights at the end."""
    import msgspec

    from sitl_sim.demo.screen import comparison_table, held_up_by, show, verdict_table

    def tell_one(result: dict[str, Any]) -> None:
        if as_json:
            printer.put(msgspec.json.encode(result).decode() + "\n")
        elif not compare:
            show(verdict_table(result), printer.stream(error=False))
        else:
            each = result["definition"]
            screen.say(f"{each}: {result['arrived']} of {result['vehicles']} arrived, {result['macs']} MACs")
            if held_up := held_up_by(result):
                screen.say(f"{each}: this machine {held_up}")

    def tell_all(results: list[dict[str, Any]]) -> None:
        if compare:
            show(comparison_table(results), printer.stream(error=as_json))
        if not as_json:
            for result in results:
                printer.put(f"{result['log']}\n")

    return tell_one, tell_all


async def _open_page(screen: Screen, printer: Printer, port: int | None, opens: bool) -> Page | None:
    """The page; None, with the reason printed, if there is none."""
    try:
        from sitl_sim.demo.page import Page
    except MissingExtraError as error:
        screen.say(f"{error}; flying without it")
        return None
    remark = ""

    def ready() -> None:
        announce(page.server.url, opens, remark, lambda line: printer.put(f"{line}\n", error=True))

    page = Page(ready)
    try:
        if not await page.open(port):
            remark = " (port 8090 is in use)"
    except LinkError as error:
        raise LinkError(f"{error}; choose another with --view-port, or do without: --no-view") from error
    return page


async def _until_signal(flight: Any, printer: Printer) -> dict[str, Any]:
    """The result of the flight. Ctrl-C, SIGTERM or the loss of the terminal ends everything that it started."""
    import asyncio

    task = asyncio.ensure_future(flight)
    ended_by_signals(asyncio.get_running_loop(), task.cancel)
    try:
        return await task  # type: ignore[no-any-return]
    except asyncio.CancelledError:
        printer.put("ridlink: ended before the verdict\n", error=True)
        raise click.exceptions.Exit(EXIT_NEGATIVE) from None
