"""Things that are done once in a while."""

from __future__ import annotations

import math


class Periodic:
    """Asked every step, says yes once a period: on the grid of the first yes, without drift and without bursts.

    Args:
        period_s: Time from one yes to the next.
        early_s: It is time already so long before; half a step, where steps come on a grid of their own.
    """

    def __init__(self, period_s: float, early_s: float = 1e-9) -> None:
        self._period_s, self._early_s = period_s, early_s
        self._next_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Whether it is time again."""
        if now_s < self._next_s - self._early_s:
            return False
        # On the grid of the period, unless that was missed: no drift, no burst.
        on_grid = now_s - self._next_s < self._period_s
        self._next_s = (self._next_s if on_grid else now_s) + self._period_s
        return True
