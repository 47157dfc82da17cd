"""Why no autopilot is accepted as the own one although one speaks; otherwise that looks like silence."""

from __future__ import annotations

from ridlink.engine.intake import Intake
from ridlink.own_ship import OwnShipTelemetry

ENOUGH = 5
"""Seconds with messages that are not taken: autopilots begin with MAVLink 1, and change when they hear MAVLink 2."""


class Unheard:
    """Finds out why no autopilot is heard; called once a second.

    Args:
        intake: Intake of the vehicle link.
        telemetry: Which autopilot is listened to.
    """

    def __init__(self, intake: Intake, telemetry: OwnShipTelemetry) -> None:
        self._intake, self._telemetry = intake, telemetry
        self._counted = (0, 0)
        self._seconds = 0

    def why(self) -> str:
        """Why no autopilot is heard; empty if one is, if nobody speaks, or if it may yet come."""
        if self._telemetry.lock is not None:
            return ""
        before = self._counted
        self._counted = self._intake.counters["mavlink_1_frame"], self._telemetry.counters["foreign_autopilot"]
        self._seconds += self._counted != before
        if self._seconds < ENOUGH:
            return ""
        if self._counted[1]:
            return f"autopilots are heard, none of them with system id {self._telemetry.pinned}"
        return "the vehicle speaks MAVLink 1, which is not taken: set it to MAVLink 2, or give --allow-v1"
