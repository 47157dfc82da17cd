"""The way of those who avoid nobody: straight from point to point, at cruise speed.

Units and axes: metres, seconds; north-east-down about home. Index k is system id k + 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from ridlink.scenario import VehicleSpec

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

ROUTE_POINT_M = 2.0
ROUTE_LEAD_S = 0.3
"""A route's next leg begins this near to its point, or this long before it."""


class Routes:
    """Who is under way, and where to next.

    Args:
        vehicles: In the order of their system ids.
    """

    def __init__(self, vehicles: Sequence[VehicleSpec]) -> None:
        self._vehicles = vehicles
        self._ahead: dict[int, list[FloatArray]] = {}

    def set_out(self, index: int) -> FloatArray:
        """The velocity of the first leg of a vehicle's way, whose later legs `turns` gives."""
        vehicle = self._vehicles[index]
        points = [np.array(point) for point in (*vehicle.route_ned_m, vehicle.goal_ned_m)]
        self._ahead[index] = points
        return self._leg(index, np.array(vehicle.start_ned_m), points[0])

    def turns(self, position_ned_m: FloatArray, flying: BoolArray) -> Iterator[tuple[int, FloatArray]]:
        """Who has come to a point of its route now, and its velocity to the next one.

        Args:
            position_ned_m: Where everybody is, shape (n, 3).
            flying: Who flies what it is told, shape (n,); the way of the others ends.
        """
        for index, points in list(self._ahead.items()):
            if len(points) == 1 or not flying[index]:
                del self._ahead[index]
                continue
            here = position_ned_m[index]
            lead_m = max(ROUTE_POINT_M, ROUTE_LEAD_S * self._vehicles[index].speed_mps)
            if float(np.linalg.norm(points[0] - here)) <= lead_m:
                points.pop(0)
                yield index, self._leg(index, here, points[0])

    def _leg(self, index: int, start: FloatArray, end: FloatArray) -> FloatArray:
        way = end - start
        return np.asarray(way * (self._vehicles[index].speed_mps / max(float(np.linalg.norm(way)), 1e-9)))
