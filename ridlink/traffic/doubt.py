"""Doubt about a track: an observed error widens its disc for a while. It is never a reason to drop the track.

A sender that moves where its own figures say it cannot (a position off its prediction by more than its stated error, a
second position under the same identity) may be in error, may lie, or may be two vehicles. Any of them may be there.
"""

from __future__ import annotations

DECAY_S = 10.0
MOST_M = 40.0
"""As much as for a sender that states no error at all: doubt must not demand more than silence does."""


class Doubt:
    """Widening of the disc of one track; metres."""

    __slots__ = ("_at_s", "_widening_m")

    def __init__(self) -> None:
        self._widening_m = 0.0
        self._at_s = 0.0

    def add(self, excess_m: float, now_s: float) -> None:
        """Note that the track was wrong by this much more than it stated."""
        self._widening_m = min(max(self.widening_m(now_s), excess_m), MOST_M)
        self._at_s = now_s

    def widening_m(self, now_s: float) -> float:
        """Present widening of the disc [m]."""
        if self._widening_m == 0.0:
            return 0.0
        return self._widening_m * min(max(1.0 - (now_s - self._at_s) / DECAY_S, 0.0), 1.0)
