"""Escalate fast, recover slowly: what follows a conflict.

A conflict that has just gone may be back with the next report. It counts as over only after it has been gone for a
while, and until then the way back to the preferred velocity is taken with part of the acceleration.
"""

from __future__ import annotations

import math

from ridlink.setpoint import Velocity

HYSTERESIS_S = 2.0
SHARE = 0.5
"""Of the acceleration limit."""


class Recovery:
    """Fed with whether there is a conflict, asked for the velocity that may be flown."""

    def __init__(self) -> None:
        self._conflict_at_s = -math.inf

    def conflict(self, now_s: float) -> None:
        """There is a conflict now."""
        self._conflict_at_s = now_s

    def recovering(self, now_s: float) -> bool:
        """A conflict is there, or was within the hysteresis."""
        return now_s - self._conflict_at_s < HYSTERESIS_S

    def slowed(self, wanted: Velocity, last: Velocity, *, step_s: float, acceleration_mps2: float) -> Velocity:
        """The velocity on the way from the last one to the wanted one that recovery allows; slowing down is free.

        Args:
            wanted: North, east, down [m/s].
            last: What was sent last.
            step_s: Time since then.
            acceleration_mps2: Limit of setpoints.
        """
        change = math.hypot(wanted[0] - last[0], wanted[1] - last[1])
        room = SHARE * acceleration_mps2 * step_s
        if change <= room or math.hypot(*wanted[:2]) < math.hypot(*last[:2]):
            return wanted
        part = room / change
        return last[0] + part * (wanted[0] - last[0]), last[1] + part * (wanted[1] - last[1]), wanted[2]
