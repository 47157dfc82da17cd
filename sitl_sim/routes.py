"""Routes of vehicles that avoid nobody: straight from point to point, at cruise speed.

Units and axes: metres, seconds; north-east-down about home. Index k is system id k + 1. Vehicles cannot turn on the
spot, and gusts move them off their leg: a vehicle beside its leg flies back onto it. A point that was passed at any
distance counts as reached, but a goal that was passed is flown to once more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ridlink.scenario import VehicleSpec

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

ROUTE_POINT_M = 2.0
ROUTE_LEAD_S = 0.3
"""The next leg of a route begins ``ROUTE_POINT_M`` from its point, or this long before it."""

LOOK_AHEAD_S = 2.0
"""A vehicle beside its leg heads for the point that it would reach on the leg after this time: slowly enough for either
autopilot."""

ON_LEG_M = 1e-6


class Routes:
    """Vehicles under way, and their next points.

    Args:
        vehicles: Vehicles in the order of their system ids.
    """

    def __init__(self, vehicles: Sequence[VehicleSpec]) -> None:
        count = len(vehicles)
        self._vehicles = vehicles
        self._speed_mps = np.array([vehicle.speed_mps for vehicle in vehicles], dtype=np.float64)
        self._lead_m = np.maximum(ROUTE_POINT_M, ROUTE_LEAD_S * self._speed_mps)
        self._under_way = np.zeros(count, dtype=np.bool_)
        self._ahead: list[list[FloatArray]] = [[] for _ in vehicles]
        self._begin_m = np.zeros((count, 3))
        self._velocity_mps = np.zeros((count, 3))
        self._length_m = np.zeros(count)

    def set_out(self, index: int) -> FloatArray:
        """Start a vehicle; returns the velocity of its first leg. From now on `steer` computes it."""
        vehicle = self._vehicles[index]
        self._under_way[index] = True
        self._ahead[index] = [np.array(point) for point in (*vehicle.route_ned_m, vehicle.goal_ned_m)]
        self._begin(index, np.array(vehicle.start_ned_m))
        return np.array(self._velocity_mps[index])

    def leave(self, index: int) -> None:
        """Stop steering this vehicle; another program flies it now."""
        self._under_way[index] = False

    def steer(self, position_ned_m: FloatArray, flying: BoolArray) -> tuple[IntArray, FloatArray]:
        """Vehicles under way, and their commanded velocities.

        Args:
            position_ned_m: Positions of all vehicles, shape (n, 3).
            flying: Mask of vehicles that obey, shape (n,); the routes of the others end.

        Returns:
            Indices, shape (m,), and velocities, shape (m, 3).
        """
        self._under_way &= flying
        rows = np.flatnonzero(self._under_way)
        if not len(rows):
            return rows, np.empty((0, 3))
        left_m = self._length_m[rows] - self._along(position_ned_m, rows)[0]
        for index, left in zip(rows.tolist(), left_m.tolist(), strict=True):
            ahead = self._ahead[index]
            if len(ahead) > 1 and left <= self._lead_m[index]:
                ahead.pop(0)
                self._begin(index, position_ned_m[index])
            elif left <= 0.0:
                self._begin(index, position_ned_m[index])
        _, direction, beside_m = self._along(position_ned_m, rows)
        speed = self._speed_mps[rows, None]
        heading = LOOK_AHEAD_S * speed * direction - beside_m
        back = speed * heading / np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-9)
        is_beside = np.linalg.norm(beside_m, axis=1, keepdims=True) > ON_LEG_M
        return rows, np.where(is_beside, back, self._velocity_mps[rows])

    def _begin(self, index: int, here: FloatArray) -> None:
        way = self._ahead[index][0] - here
        length_m = float(np.linalg.norm(way))
        self._begin_m[index], self._length_m[index] = here, length_m
        self._velocity_mps[index] = way * (self._speed_mps[index] / max(length_m, 1e-9))

    def _along(self, position_ned_m: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance flown on the leg, direction of the leg, and offset from it."""
        direction = self._velocity_mps[rows] / self._speed_mps[rows, None]
        gone = position_ned_m[rows] - self._begin_m[rows]
        along_m = np.einsum("ij,ij->i", gone, direction)
        return along_m, direction, gone - along_m[:, None] * direction
