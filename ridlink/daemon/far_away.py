"""What lies so far from the vehicle that its longitude was written for its latitude."""

from __future__ import annotations

import math

from ridlink.engine import Engine, Goal
from ridlink.geodesy import Geodetic

FAR_GOAL_M = 100e3
"""No multirotor flies so far."""

FAR_OBSTACLE_M = 1000e3
"""A list of all obstacles of a country is no mistake."""

EARTH_RADIUS_M = 6371e3


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
        goal, self._goal = self._goal, self._engine.goal
        if self._goal is not None and self._goal != goal:
            far += _words("the goal", _distance_m(own, self._goal.latitude_deg, self._goal.longitude_deg), FAR_GOAL_M)
        if not self._obstacles_seen:
            self._obstacles_seen = True
            found = (
                _words(f"obstacle {number}", min(_distance_m(own, *corner) for corner in corners), FAR_OBSTACLE_M)
                for number, corners in enumerate(self._engine.config.obstacles, 1)
            )
            far += next(filter(None, found), [])
        return far


def _words(what: str, away_m: float, far_m: float) -> list[str]:
    return [f"{what} is {away_m / 1e3:,.0f} km away: latitude comes first"] if away_m > far_m else []


def _distance_m(own: Geodetic, latitude_deg: float, longitude_deg: float) -> float:
    """Along a great circle of a sphere, which is near enough for words."""
    here, there = math.radians(own.latitude_deg), math.radians(latitude_deg)
    east = math.radians(longitude_deg - own.longitude_deg)
    haversine = math.sin((there - here) / 2.0) ** 2 + math.cos(here) * math.cos(there) * math.sin(east / 2.0) ** 2
    return 2.0 * EARTH_RADIUS_M * math.asin(math.sqrt(min(haversine, 1.0)))
