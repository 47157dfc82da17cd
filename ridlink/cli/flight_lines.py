"""Output of ``ridlink avoid`` during a flight: JSON for programs, lines for people."""

from __future__ import annotations

import json
import os
import sys
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from ridlink.cli.printing import Printer
from ridlink.failsafe import HEARTBEAT_LOST_S
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.daemon.summary import Summary

GUARD_LINES = {
    "taking over": "the guard takes over for a conflict",
    "resolving": "the guard has taken over",
    "holding": "the mission was found paused: the guard keeps the vehicle here until AUTO is chosen",
    "handing back": "the guard hands back what it found",
    "ended": "MAV_CMD_DO_PAUSE_CONTINUE 1 to component 196 engages it again",
}
"""Text for each phase that a guard enters."""
HANDED_BACK = "it has handed back"
AWAITED = "waiting for an autopilot"
"""Reason of a daemon that stands by and hears no autopilot on its vehicle link."""


class FlightPrinter(Printer, ABC):
    """Prints events of a flight as they happen."""

    @abstractmethod
    def event(self, facts: dict[str, Any]) -> None:
        """Print a change of state or the summary of a second."""

    @abstractmethod
    def final(self, summary: Summary) -> None:
        """Print the summary of the flight."""


class JsonPrinter(FlightPrinter):
    """One JSON object a line on standard output."""

    def event(self, facts: dict[str, Any]) -> None:
        self.put(json.dumps(facts) + "\n")

    def final(self, summary: Summary) -> None:
        self.event({"event": "final", **summary.as_dict()})


class HumanPrinter(FlightPrinter):
    """A line for every change of state, and on a terminal a status line that is rewritten every second.

    Args:
        vehicle: The link on which the autopilot is awaited.
    """

    def __init__(self, vehicle: str) -> None:
        super().__init__()
        self._vehicle = vehicle
        self._live = sys.stderr.isatty()
        self._phase: str | None = None

    def event(self, facts: dict[str, Any]) -> None:
        if facts["event"] == "state":
            self.put(f"{self._clear}{self._state_line(facts)}\n", error=True)
        elif facts["event"] == "warning":
            self.put(f"{self._clear}warning: {facts['text']}\n", error=True)
        elif facts["event"] == "module":
            self.put(f"{self._clear}{module_line(facts)}\n", error=True)
        elif facts["event"] == "dry_run":
            north, east, down = facts["velocity_ned_mps"]
            said = f"would fly {north:+z.1f} north, {east:+z.1f} east, {-down:+z.1f} up m/s"
            self.put(f"{self._clear}{said}\n", error=True)
        elif facts["event"] == "recording_ended":
            self.put(f"{self._clear}the recording has ended: {facts['reason']}\n", error=True)
        elif facts["event"] == "stalled":
            self.put(f"{self._clear}warning: the loop stood still\n", error=True)
        elif self._live:
            self.put(f"{self._clear}{_cut(_status_line(facts))}", error=True)

    def _state_line(self, facts: dict[str, Any]) -> str:
        before, self._phase = self._phase, facts["guard"]
        handed_back = (before, self._phase) == ("handing back", "watching")
        entered = HANDED_BACK if handed_back else GUARD_LINES.get(self._phase or "")
        said = f"{facts['state']}: {facts['reason']}"
        said += f" on {self._vehicle}" if facts["reason"] == AWAITED else ""
        return f"{said}; {entered}" if entered and self._phase != before else said

    @property
    def _clear(self) -> str:
        return "\r\x1b[K" if self._live else ""

    def final(self, summary: Summary) -> None:
        decision, gap = summary.decision_ms, summary.setpoint_gap_ms
        gaps = f" (gap p99 {gap['p99']:.0f} ms, max {gap['max']:.0f} ms)" if summary.setpoints > 1 else ""
        setpoints = counted(summary.setpoints, "setpoint", "d") if summary.setpoints else "no setpoints"
        self.put(
            f"{self._clear}{setpoints}{gaps}, {counted(summary.reports_received, 'report', 'd')}, "
            f"decisions p99 {decision['p99']:.1f} ms, "
            f"{counted(summary.infeasible_steps, 'step', 'd')} without an admissible velocity\n",
            error=True,
        )


def module_line(facts: dict[str, Any]) -> str:
    """What a transmitter module says, as a line."""
    if facts["good_to_arm"]:
        return "the transmitter module is good to arm"
    return f"warning: the transmitter module is not ready: {facts['text'] or 'it does not say why'}"


def _cut(line: str) -> str:
    """A line cut to the width of the terminal: a second line could not be overwritten."""
    try:
        columns = os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):  # no terminal, or no file
        return line
    return line[: columns - 1] if columns > 1 else line  # 0 if unknown


def _status_line(facts: dict[str, Any]) -> str:
    parts = [facts["state"], counted(facts["tracks"], "track")]
    heard_s = facts["autopilot_heard_s"]
    if heard_s is not None and heard_s > HEARTBEAT_LOST_S:
        said = ("armed" if facts["armed"] else "disarmed") + (", on the ground" if facts["on_ground"] else "")
        parts.append(f"autopilot last heard {heard_s:.0f} s ago, {said}")
    if facts["conflicts"]:
        parts.append(f"{facts['conflicts']} in conflict")
    if facts["nearest_margin_m"] is not None:
        parts.append(f"nearest disc {facts['nearest_margin_m']:.0f} m")
    if facts["speed_mps"] is not None:
        parts.append(f"{facts['speed_mps']:.1f} m/s")
    if facts["goal_distance_m"] is not None:
        parts.append(f"goal {facts['goal_distance_m']:.0f} m")
    if facts["status"] is not None:
        parts.append(facts["status"])
    return " | ".join(parts)
