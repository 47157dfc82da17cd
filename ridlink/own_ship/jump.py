"""Jumps of the own position: a receiver that found other satellites, an estimator that moved its origin.

A position that leaves its prediction by more than errors and motion allow is either wrong now or was wrong before;
nobody can say which. For a second it is no base for avoidance, and for ten seconds the jump counts as own error.
"""

from __future__ import annotations

BOUNDS = 2.0
"""Multiple of the three-sigma bound: two white errors differ by more than one bound every few seconds, by two never."""

LEAST_M = 1.0
"""Least bound: positions come in steps of a centimetre and motion is not steady, however exact the receiver is."""

DOUBT_S = 1.0
DECAY_S = 10.0


class JumpWatch:
    """Takes the distance of each position from where it was expected."""

    def __init__(self) -> None:
        self._jump_m = 0.0
        self._at_s = 0.0

    def update(self, off_m: float, *, bound_m: float, travelled_m: float, now_s: float) -> bool:
        """Whether this position is a jump.

        Args:
            off_m: Distance from where it was expected.
            bound_m: Three-sigma error of a position.
            travelled_m: Distance that may have been flown since the last position.
            now_s: Monotonic time.
        """
        if off_m <= BOUNDS * max(bound_m, LEAST_M) + travelled_m:
            return False
        self._jump_m = max(off_m, self.error_m(now_s))
        self._at_s = now_s
        return True

    def doubtful(self, now_s: float) -> bool:
        """Whether a jump was seen within the last second."""
        return self._jump_m > 0.0 and now_s - self._at_s < DOUBT_S

    def error_m(self, now_s: float) -> float:
        """Part of the last jump that still counts as own error [m]."""
        return self._jump_m * min(max(1.0 - (now_s - self._at_s) / DECAY_S, 0.0), 1.0)
