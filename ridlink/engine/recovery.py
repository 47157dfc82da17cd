"""Recovery after a conflict: escalate fast, recover slowly.

A conflict that has just gone may be back with the next report. It is over only after it has been gone for a while.
Until then the vehicle returns to the preferred velocity with only a part of the acceleration.
"""

from __future__ import annotations

import math

from ridlink.setpoint import Velocity

HYSTERESIS_S = 2.0
SHARE = 0.5
"""Share of the acceleration limit."""


class Recovery:
    """Told when there is a conflict, it limits the velocity that may be flown."""

    def __init__(self) -> None:
        self._conflict_at_s = -math.inf

    def conflict(self, now_s: float) -> None:
        """Note that there is a conflict now."""
        self._conflict_at_s = now_s

    def recovering(self, now_s: float) -> bool:
        """Whether there is a conflict, or was one within the hysteresis."""
        return now_s - self._conflict_at_s < HYSTERESIS_S

    def slowed(self, wanted: Velocity, last: Velocity, *, step_s: float, acceleration_mps2: float) -> Velocity:
        """Velocity on the way from the last to the wanted one that recovery allows; to slow down is free.

        Args:
            wanted: North, east, down [m/s].
            last: Velocity sent last.
            step_s: Time since then.
            acceleration_mps2: Limit on the change of setpoints.
        """
        change = math.hypot(wanted[0] - last[0], wanted[1] - last[1])
        room = SHARE * acceleration_mps2 * step_s
        if change <= room or math.hypot(*wanted[:2]) < math.hypot(*last[:2]):
            return wanted
        part = room / change
        return last[0] + part * (wanted[0] - last[0]), last[1] + part * (wanted[1] - last[1]), wanted[2]
