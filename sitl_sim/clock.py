"""The fleet's time: real, faster than real, or stopped until it is advanced.

Everything in the emulator uses this clock, including SYSTEM_TIME, so a client that follows SYSTEM_TIME stays in step.
"""

from __future__ import annotations

from collections.abc import Callable


class FleetClock:
    """Seconds of the fleet.

    Args:
        real_s: Monotonic real time.
        utc_s: Seconds since 1970, read once: UTC runs as fast as the fleet's time.
        speedup: Fleet seconds per real second; 0: only `advance` moves time (lockstep).
    """

    def __init__(self, real_s: Callable[[], float], utc_s: Callable[[], float], speedup: float = 1.0) -> None:
        self._real_s, self._speedup = real_s, speedup
        self._origin_s = real_s() if speedup else 0.0  # in lockstep nothing depends on the real start time
        self._utc_origin_s = utc_s()
        self._advanced_s = 0.0

    @property
    def is_lockstep(self) -> bool:
        """Whether time stands still until it is advanced."""
        return self._speedup == 0.0

    def now_s(self) -> float:
        """The fleet's time; it begins at the real time, in lockstep at 0."""
        if self.is_lockstep:
            return self._advanced_s
        return self._origin_s + (self._real_s() - self._origin_s) * self._speedup

    def utc_s(self) -> float:
        """Seconds since 1970."""
        return self._utc_origin_s + self.now_s() - self._origin_s

    def real_of(self, fleet_s: float) -> float:
        """The real time of a fleet time; for timers, never in lockstep."""
        return self._origin_s + (fleet_s - self._origin_s) / self._speedup

    def advance(self, seconds: float) -> None:
        """Advance time at once by this many seconds."""
        self._advanced_s += seconds
