"""Whether own-ship makes progress; if not, a turn that ends a perfect stand-off."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field


@dataclass(slots=True)
class ProgressWatch:
    """Grows a turn to the right while a vehicle comes no nearer to its goal, and takes it back when it does.

    Perfect symmetry can hold traffic in place, or on a circle, for ever. A turn that depends on each vehicle's own
    history breaks it. Reads no clock.

    Args:
        window_s: Progress is judged over this time.
        share: A vehicle is stalled below this share of the distance that cruise would have covered.
        growth_rad_per_s: Growth of the turn while stalled.
        decay_rad_per_s: Decay of the turn otherwise: a turn that outlives its cause is a detour.
        most_rad: Largest turn.
    """

    window_s: float = 5.0
    share: float = 0.1
    growth_rad_per_s: float = 0.1
    decay_rad_per_s: float = 0.5
    most_rad: float = 1.2
    extra_right_turn_rad: float = 0.0
    _history: deque[tuple[float, float]] = field(default_factory=deque)

    def update(self, now_s: float, goal_distance_m: float, cruise_mps: float) -> float:
        """Extra turn [rad] for the solver.

        Args:
            now_s: The caller's clock; must not go back.
            goal_distance_m: Distance to the goal now.
            cruise_mps: Speed that own-ship wants.

        Raises:
            ValueError: If an argument is not finite.
        """
        for name, value in (("now_s", now_s), ("goal_distance_m", goal_distance_m), ("cruise_mps", cruise_mps)):
            if not math.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
        step = max(now_s - self._history[-1][0], 0.0) if self._history else 0.0
        self._history.append((now_s, goal_distance_m))
        while len(self._history) > 2 and self._history[1][0] <= now_s - self.window_s:
            self._history.popleft()
        since, distance = self._history[0]
        span = now_s - since
        if span < self.window_s or goal_distance_m < cruise_mps:
            stalled = False
        else:
            stalled = distance - goal_distance_m < self.share * cruise_mps * span
        rate = self.growth_rad_per_s if stalled else -self.decay_rad_per_s
        turn = self.extra_right_turn_rad + rate * step
        self.extra_right_turn_rad = min(max(turn, 0.0), self.most_rad)
        return self.extra_right_turn_rad
