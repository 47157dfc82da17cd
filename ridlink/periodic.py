"""Work that is done once a period."""

from __future__ import annotations

import math


class Periodic:
    """Says in which steps periodic work is due. It keeps the grid of the first time: no drift, no bursts.

    Args:
        period_s: Time between two executions.
        early_s: How much too early the work may be done; half a step if the steps have their own grid.
    """

    def __init__(self, period_s: float, early_s: float = 1e-9) -> None:
        self._period_s, self._early_s = period_s, early_s
        self._next_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Whether the work is due now."""
        if now_s < self._next_s - self._early_s:
            return False
        # Stay on the grid of the period unless a whole period was missed: no drift, no burst.
        on_grid = now_s - self._next_s < self._period_s
        self._next_s = (self._next_s if on_grid else now_s) + self._period_s
        return True
