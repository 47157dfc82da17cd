"""Things that are done once in a while."""

from __future__ import annotations

import math


class Periodic:
    """Asked every step, says yes once a period: on the grid of the first yes, without drift and without bursts."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Whether it is time again."""
        if now_s < self._next_s - 1e-9:
            return False
        # On the grid of the period, unless that was missed: no drift, no burst.
        on_grid = now_s - self._next_s < self._period_s
        self._next_s = (self._next_s if on_grid else now_s) + self._period_s
        return True
