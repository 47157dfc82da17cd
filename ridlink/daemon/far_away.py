"""What lies so far from the vehicle that its longitude was written for its latitude."""

from __future__ import annotations

from ridlink.engine import Engine, Goal
from ridlink.geodesy import Geodetic, great_circle_m

FAR_GOAL_M = 100e3
"""No multirotor flies so far."""

FAR_OBSTACLE_M = 1000e3
"""A list of all obstacles of a country is no mistake."""


class FarAway:
    """Asked once a second.

    Args:
        engine: Whose goal and obstacles these are.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._goal: Goal | None = None
        self._obstacles_seen = False

    def found(self, own: Geodetic) -> list[str]:
        """What is far from an own position: a goal when it is a new one, and of the obstacles the first, once."""
        far = []
        here = own.latitude_deg, own.longitude_deg
        goal, self._goal = self._goal, self._engine.goal
        if self._goal is not None and self._goal != goal:
            there = self._goal.latitude_deg, self._goal.longitude_deg
            far += _words("the goal", great_circle_m(here, there), FAR_GOAL_M)
        if not self._obstacles_seen:
            self._obstacles_seen = True
            found = (
                _words(f"obstacle {number}", min(great_circle_m(here, corner) for corner in corners), FAR_OBSTACLE_M)
                for number, corners in enumerate(self._engine.config.obstacles, 1)
            )
            far += next(filter(None, found), [])
        return far


def _words(what: str, away_m: float, far_m: float) -> list[str]:
    return [f"{what} is {away_m / 1e3:,.0f} km away: latitude comes first"] if away_m > far_m else []
