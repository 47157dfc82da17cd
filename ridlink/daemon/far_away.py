"""Finds goals and obstacles so far from the vehicle that latitude and longitude were probably swapped."""

from __future__ import annotations

from ridlink.engine import Engine, Goal
from ridlink.failsafe import FailsafeSettings
from ridlink.geodesy import Geodetic, great_circle_m

FAR_GOAL_M = 100e3
"""Distance that no multirotor flies."""

FAR_OBSTACLE_M = 1000e3
"""A larger limit than for goals: a list of all obstacles of a country is no mistake."""


class FarAway:
    """Checks once a second.

    Args:
        engine: The engine with the goal and the obstacles.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._goal: Goal | None = None
        self._obstacles_seen = False

    def found(self, own: Geodetic) -> list[str]:
        """Warnings about what is far from the own position: each new goal, and, once, the first such obstacle."""
        far: list[str] = []
        here = own.latitude_deg, own.longitude_deg
        goal, self._goal = self._goal, self._engine.goal
        if self._goal is not None and self._goal != goal:
            far += filter(None, [of_goal(own, self._goal, self._engine.config.failsafe)])
        if not self._obstacles_seen:
            self._obstacles_seen = True
            found = (
                _of_obstacle(number, min(great_circle_m(here, corner) for corner in corners))
                for number, corners in enumerate(self._engine.config.obstacles, 1)
            )
            far += next(filter(None, found), [])
        return far


def of_goal(own: Geodetic, goal: Goal, settings: FailsafeSettings) -> str:
    """A warning about a goal that is far from the own position; empty if it is not."""
    away_m, swapped = goal.away_m(own), Goal(goal.longitude_deg, goal.latitude_deg)
    if away_m <= FAR_GOAL_M:
        return ""
    is_swapped = abs(swapped.latitude_deg) <= 90.0 and swapped.away_m(own) <= FAR_GOAL_M
    meant = f"{swapped.latitude_deg:.7g},{swapped.longitude_deg:.7g}"
    return (
        f"the goal is {away_m / 1e3:,.0f} km away"
        + (" and is not flown to" if away_m > settings.farthest_goal_m else "")
        + (f": is {meant} meant? Latitude comes first" if is_swapped else "")
    )


def _of_obstacle(number: int, away_m: float) -> list[str]:
    if away_m <= FAR_OBSTACLE_M:
        return []
    return [f"obstacle {number} is {away_m / 1e3:,.0f} km away: latitude comes first"]
