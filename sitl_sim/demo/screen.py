"""Text output of a flight: a live table on a terminal, and the verdict at the end.

Progress goes to stderr; the verdict is a result and goes to stdout, unless stdout is reserved for JSON.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ridlink.words import counted
from sitl_sim.vehicle import VehicleState
from sitl_sim.verdict import Outcome
from sitl_sim.world import World

MAX_ROWS = 24
HELD_UP_MS = 1000.0

_STATE = {
    VehicleState.GROUNDED: "landed",
    VehicleState.AIRBORNE: "flying",
    VehicleState.LANDING: "landing",
    VehicleState.GONE: "gone",
}


class Screen:
    """Progress of a flight: a live table, or a line, on a terminal; single lines elsewhere; nothing if ``quiet``.

    Args:
        file: Output; writing must not wait for a reader, since the fleet flies in the same loop.
        quiet: Show nothing.
        table: Show the state of each vehicle, not only the progress of the flight.
    """

    def __init__(self, file: TextIO, *, quiet: bool = False, table: bool = True) -> None:
        self._console = Console(file=file, highlight=False)
        self._quiet = quiet
        self._table = table
        self._live: Live | None = None

    @property
    def is_terminal(self) -> bool:
        """Whether progress is shown on a terminal."""
        return self._console.is_terminal and not self._quiet

    @property
    def has_table(self) -> bool:
        """Whether the table is shown."""
        return self.is_terminal and self._table

    def say(self, text: str) -> None:
        """Print one line about the progress."""
        if not self._quiet:
            self._console.print(text, markup=False, soft_wrap=True)

    def complain(self, text: str) -> None:
        """Print one line about a failure, even if ``quiet``."""
        self._console.print(f"ridlink: {text}", markup=False, soft_wrap=True)

    @contextmanager
    def flight(self, title: str) -> Iterator[None]:
        """Shows what ``update`` draws while the flight lasts."""
        if not self.is_terminal:
            yield
            return
        with Live(Text(title), console=self._console, refresh_per_second=5, transient=True) as live:
            self._live = live
            try:
                yield
            finally:
                self._live = None

    def update(self, world: World, title: str, solver: dict[int, str]) -> None:
        """Redraw the table from the truth; ``solver`` is the last status of each daemon by system id."""
        if self._live is not None:
            self._live.update(flight_table(world, title, solver) if self._table else _how_far(world))


def show(result: RenderableType, file: TextIO) -> None:
    """Print a result at its full width."""
    Console(file=file, highlight=False, soft_wrap=True).print(result)


def flight_table(world: World, title: str, solver: dict[int, str]) -> RenderableType:
    """The table of all vehicles."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for heading in ("vehicle", "state", "to goal m", "speed m/s", "nearest m", "with", "daemon"):
        table.add_column(heading, justify="left" if heading in ("state", "daemon") else "right")
    position = world.position_ned_m[:, :2]
    apart = np.linalg.norm(position[:, None] - position[None, :], axis=-1)
    in_air = world.in_air
    apart[~in_air] = np.inf
    apart[:, ~in_air] = np.inf
    np.fill_diagonal(apart, np.inf)
    for index, spec in enumerate(world.scenario.vehicles[:MAX_ROWS]):
        to_goal = float(np.hypot(*(np.array(spec.goal_ned_m[:2]) - position[index])))
        nearest = int(np.argmin(apart[index]))
        distance = float(apart[index, nearest])
        state = VehicleState(int(world.state[index]))
        table.add_row(
            str(index + 1),
            Text("arrived", style="green") if world.arrived[index] else Text(_STATE[state], style=_colour(state)),
            f"{to_goal:.0f}",
            f"{float(np.hypot(*world.velocity_ned_mps[index, :2])):.1f}",
            f"{distance:.1f}" if np.isfinite(distance) else "",
            str(nearest + 1) if np.isfinite(distance) else "",
            solver.get(index + 1, "" if spec.cooperative else "none: flies straight on"),
        )
    return Group(table, _how_far(world))


def _how_far(world: World) -> Text:
    return Text(f"{world.mission_time_s:5.1f} s   arrived {int(world.arrived.sum())} of {len(world.scenario.vehicles)}")


def _colour(state: VehicleState) -> str:
    return "red" if state is VehicleState.GONE else ""


def verdict_table(result: dict[str, Any]) -> RenderableType:
    """The verdict of one flight as a table."""
    passed = result["passed"]
    head = Text.assemble(
        ("PASSED  " if passed else "FAILED  ", "bold green" if passed else "bold red"),
        f"{result['scenario']} under {result['definition']}, seed {result['seed']}: "
        f"{result['arrived']} of {result['vehicles']} arrived, {counted(result['macs'], 'mid-air collision')}"
        + (f", {result['obstacle_hits']} flew into an obstacle" if result["obstacle_hits"] else ""),
    )
    time, decision, gap = result["mission_time_s"], result["decision_ms"], result["setpoint_gap_ms"]
    lines = [
        f"mission time      median {_number(time['median'], 's')}, slowest {_number(time['max'], 's')}",
        f"nearest pair      {_number(result['min_separation_m'], 'm')} between centres (true positions)",
        f"discs entered     {counted(result['unmac_violations'], 'pair')} on reported positions, "
        f"{result['unmac_violations_true']} on true ones",
        f"daemons           {result['setpoints']} setpoints, {result['reports_received']} reports heard, "
        f"decision p99 {_number(decision['p99'], 'ms')}, longest setpoint gap {_number(gap['max'], 'ms')}",
    ]
    late = [
        f"vehicle {detail['system_id']}: {_fate(detail['outcome'])}"
        for detail in result["details"]
        if detail["outcome"] != Outcome.ARRIVED
    ]
    if held_up := held_up_by(result):
        late.append(f"machine           {held_up}")
    return Group(head, *(Text(line) for line in lines), *(Text(line, style="red") for line in late))


def held_up_by(result: dict[str, Any]) -> str:
    """The text if this machine was so slow that a failsafe of a vehicle may have acted; else empty."""
    if result["stood_still_ms"] > HELD_UP_MS:
        return f"was too busy: the vehicles stood still for {result['stood_still_ms'] / 1e3:.1f} s, and said nothing"
    gap_ms = result["setpoint_gap_ms"]["max"]
    if gap_ms is None or gap_ms <= HELD_UP_MS:
        return ""
    return f"was too busy: {gap_ms / 1e3:.1f} s without a setpoint; PX4 returns after 1 s, ArduPilot brakes after 3 s"


def _fate(outcome: str) -> str:
    """The text for a vehicle that has not arrived."""
    words = {Outcome.FLYING: "not arrived", Outcome.GROUNDED: "on the ground, not arrived"}
    return words.get(Outcome(outcome), outcome.replace("_", " "))


def comparison_table(results: list[dict[str, Any]]) -> RenderableType:
    """The same seed under several definitions."""
    first = results[0]
    table = Table(
        title=f"{first['scenario']}, seed {first['seed']}, {counted(first['vehicles'], 'vehicle')}",
        box=None,
        title_justify="left",
    )
    for heading in ("definition", "arrived", "median s", "slowest s", "nearest m", "MACs", "discs entered"):
        table.add_column(heading, justify="left" if heading == "definition" else "right")
    for result in results:
        time = result["mission_time_s"]
        table.add_row(
            result["definition"],
            f"{result['arrived']}/{result['vehicles']}",
            _number(time["median"], ""),
            _number(time["max"], ""),
            _number(result["min_separation_m"], ""),
            Text(str(result["macs"]), style="red" if result["macs"] else "green"),
            str(result["unmac_violations"]),
        )
    return table


def _number(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.1f} {unit}".strip()
