"""UTC for the age of others' reports, from the monotonic clock, so that a step of the system clock does not age tracks.

The monotonic and the system clock are compared continuously. Small differences are followed. A step (NTP, an operator,
a virtual machine that slept) is counted, and for a while no timestamp is believed; then the new time is adopted.
"""

from __future__ import annotations

import time
from collections.abc import Callable

STEP_S = 0.1
DOUBT_S = 10.0


class SteadyUtc:
    """Converts monotonic time to UTC.

    Args:
        now_s: Monotonic time.
        wall: The system's UTC clock.

    Attributes:
        steps: Steps of the system clock so far.
    """

    def __init__(self, now_s: float, wall: Callable[[], float] = time.time) -> None:
        self._wall = wall
        self._offset_s = wall() - now_s
        self._stepped_at_s: float | None = None
        self.steps = 0

    def check(self, now_s: float) -> None:
        """Compare the clocks; called a few times a second."""
        off_s = self._wall() - now_s - self._offset_s
        if abs(off_s) <= STEP_S:
            self._offset_s += off_s
            if self._stepped_at_s is not None and now_s - self._stepped_at_s > DOUBT_S:
                self._stepped_at_s = None
            return
        self.steps += 1
        self._stepped_at_s = now_s
        self._offset_s += off_s

    def at(self, now_s: float) -> float | None:
        """UTC at that time [s]; None shortly after a step of the clock."""
        return None if self._stepped_at_s is not None else now_s + self._offset_s
