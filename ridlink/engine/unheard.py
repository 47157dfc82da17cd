"""Why no autopilot is taken for the own one although somebody speaks: it looks like silence otherwise."""

from __future__ import annotations

from ridlink.engine.intake import Intake
from ridlink.own_ship import OwnShipTelemetry

ENOUGH = 5
"""Seconds with words that are not taken: autopilots begin with MAVLink 1, and change when they hear MAVLink 2."""


class Unheard:
    """Asked once a second.

    Args:
        intake: Of the vehicle link.
        telemetry: Which autopilot is listened to.
        otherwise: What helps against MAVLink 1, beside setting the vehicle to 2.
    """

    def __init__(self, intake: Intake, telemetry: OwnShipTelemetry, otherwise: str = "") -> None:
        self._intake, self._telemetry, self._otherwise = intake, telemetry, otherwise
        self._counted = (0, 0)
        self._seconds = 0

    def why(self) -> str:
        """Why none is heard; empty where one is, nobody speaks, or it may yet come."""
        if self._telemetry.lock is not None:
            return ""
        before = self._counted
        self._counted = self._intake.counters["mavlink_1_frame"], self._telemetry.counters["foreign_autopilot"]
        self._seconds += self._counted != before
        if self._seconds < ENOUGH:
            return ""
        if self._counted[1]:
            return f"autopilots are heard, none of them with system id {self._telemetry.pinned}"
        return f"the vehicle speaks MAVLink 1, which is not taken: set it to MAVLink 2{self._otherwise}"
