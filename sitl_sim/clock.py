"""The fleet's time: real, faster than real, or stopped until somebody lets it go on.

Everything of the emulator lives by this clock, SYSTEM_TIME included, so that a client which follows that keeps up.
"""

from __future__ import annotations

from collections.abc import Callable


class FleetClock:
    """Seconds of the fleet.

    Args:
        real_s: Monotonic real time.
        utc_s: Seconds since 1970, read once: UTC goes on as fast as the fleet does.
        speedup: Seconds of the fleet in a real one; 0: time stands but for `advance` (lockstep).
    """

    def __init__(self, real_s: Callable[[], float], utc_s: Callable[[], float], speedup: float = 1.0) -> None:
        self._real_s, self._speedup = real_s, speedup
        self._origin_s = real_s() if speedup else 0.0  # in lockstep nothing depends on when it began
        self._utc_origin_s = utc_s()
        self._advanced_s = 0.0

    @property
    def is_lockstep(self) -> bool:
        """Whether time stands until it is advanced."""
        return self._speedup == 0.0

    def now_s(self) -> float:
        """The fleet's time; it begins at the real one, in lockstep at 0."""
        if self.is_lockstep:
            return self._advanced_s
        return self._origin_s + (self._real_s() - self._origin_s) * self._speedup

    def utc_s(self) -> float:
        """Seconds since 1970."""
        return self._utc_origin_s + self.now_s() - self._origin_s

    def real_of(self, fleet_s: float) -> float:
        """The real time at which the fleet's is this; for timers, never in lockstep."""
        return self._origin_s + (fleet_s - self._origin_s) / self._speedup

    def advance(self, seconds: float) -> None:
        """Let time go on by so much at once."""
        self._advanced_s += seconds
