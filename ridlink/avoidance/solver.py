"""The half-plane solver for one own-ship: checked values in, one finite velocity within the limits out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ridlink.avoidance import halfplane, rows
from ridlink.avoidance.obstacles import NO_OBSTACLES, Obstacles
from ridlink.avoidance.programme import new_lines
from ridlink.avoidance.route import ring_size
from ridlink.avoidance.types import (
    Decision,
    FloatArray,
    HalfplaneSettings,
    OwnShip,
    Status,
    Traffic,
    checked_pair,
)


class HalfplaneSolver:
    """Velocity nearest the preferred one that keeps out of every disc; the least bad one where there is none.

    Holds scratch memory only: equal arguments give equal answers, and memory of sides is the caller's. Not for use by
    two threads at a time.
    """

    def __init__(self, settings: HalfplaneSettings | None = None) -> None:
        self.settings = settings or HalfplaneSettings()
        self._vector = self.settings.as_vector()
        self._own = np.zeros(rows.OWN_COLUMNS)
        self._result = rows.result_row()
        self._reserve(32, NO_OBSTACLES)

    def _reserve(self, count: int, obstacles: Obstacles) -> None:
        lines = 2 * count + obstacles.piece_count
        self._neighbours = np.zeros((count, rows.NEIGHBOUR_COLUMNS))
        self._side = np.zeros(count, np.int8)
        self._lines, self._work = new_lines(lines), new_lines(lines)
        self._owner = np.zeros(lines, np.int64)
        self._ring = np.zeros((ring_size(obstacles.hull_start), 2))

    def solve(
        self,
        own: OwnShip,
        traffic: Traffic,
        *,
        goal_ne_m: ArrayLike | None = None,
        preferred_ne_mps: ArrayLike | None = None,
        cruise_mps: float,
        obstacles: Obstacles | None = None,
        own_clearance_m: float | None = None,
        extra_right_turn_rad: float = 0.0,
        route_side: int = 0,
    ) -> Decision:
        """Decide one step [m/s, north-east].

        Args:
            own: Own-ship.
            traffic: Neighbours.
            goal_ne_m: Where to go, shape (2,); the way there leads round the obstacles.
            preferred_ne_mps: Instead of a goal, the velocity wanted, shape (2,).
            cruise_mps: Speed wanted on the way to the goal.
            obstacles: Static obstacles, never relaxed.
            own_clearance_m: Distance to keep from them: airframe / 2 + own error bound + 0.1 s of flight; half the
                airframe if not given.
            extra_right_turn_rad: Turn of the preferred velocity on top of the solver's own, see `ProgressWatch`.
            route_side: `Decision.route_side` of the last step.

        Returns:
            Decision; its velocities are finite and not faster than the speed limit, whatever the status.

        Raises:
            ValueError: If a value is not finite or out of range (it is named), or not exactly one of goal and preferred
                velocity is given.
        """
        if (goal_ne_m is None) == (preferred_ne_mps is None):
            raise ValueError("give either goal_ne_m or preferred_ne_mps")
        clearance = own.airframe_m / 2.0 if own_clearance_m is None else own_clearance_m
        for name, value, least in (
            ("cruise_mps", cruise_mps, 0.0),
            ("own_clearance_m", clearance, 0.0),
            ("extra_right_turn_rad", extra_right_turn_rad, -math.inf),
        ):
            if not math.isfinite(value) or value < least:
                raise ValueError(f"{name} must be finite and in range, got {value}")
        obstacles = NO_OBSTACLES if obstacles is None else obstacles
        count = len(traffic)
        lines = 2 * count + obstacles.piece_count
        ring = ring_size(obstacles.hull_start)
        if count > len(self._neighbours) or lines > len(self._owner) or ring > len(self._ring):
            self._reserve(max(2 * count, 32), obstacles)

        vector = self._own
        vector[rows.POSITION : rows.POSITION + 2] = own.position_ne_m
        vector[rows.VELOCITY : rows.VELOCITY + 2] = own.velocity_ne_mps
        vector[rows.COMMAND : rows.COMMAND + 2] = own.command_ne_mps
        if goal_ne_m is not None:
            vector[rows.AIM : rows.AIM + 2] = checked_pair("goal_ne_m", goal_ne_m)
        elif preferred_ne_mps is not None:
            vector[rows.AIM : rows.AIM + 2] = checked_pair("preferred_ne_mps", preferred_ne_mps)
        vector[rows.AIM_IS_VELOCITY] = 0.0 if preferred_ne_mps is None else 1.0
        vector[rows.LIMIT] = own.speed_limit_mps
        vector[rows.CRUISE] = cruise_mps
        vector[rows.CLEARANCE] = clearance
        vector[rows.EXTRA_TURN] = extra_right_turn_rad

        table = self._neighbours
        table[:count, rows.N_POSITION : rows.N_POSITION + 2] = traffic.position_ne_m
        table[:count, rows.N_VELOCITY : rows.N_VELOCITY + 2] = traffic.velocity_ne_mps
        table[:count, rows.N_COMMAND : rows.N_COMMAND + 2] = traffic.command_ne_mps
        table[:count, rows.AGE] = traffic.age_s
        table[:count, rows.RADIUS] = traffic.radius_m
        table[:count, rows.ERROR_SUM] = traffic.error_sum_m
        table[:count, rows.RECIPROCAL] = traffic.reciprocal
        self._side[:count] = traffic.passing_side

        route = halfplane.avoid_one(
            vector, table, count, self._side, obstacles.piece_vertex_ne_m, obstacles.piece_start,
            obstacles.hull_vertex_ne_m, obstacles.hull_start, route_side, self._vector, self._lines, self._work,
            self._owner, self._ring, self._result,
        )  # fmt: skip
        return self._decision(count, int(route))

    def _decision(self, count: int, route: int) -> Decision:
        row: FloatArray = self._result.copy()
        binding = row[rows.R_BINDING : rows.R_BINDING + 3]
        return Decision(
            velocity_ne_mps=row[rows.R_VELOCITY : rows.R_VELOCITY + 2],
            command_ne_mps=row[rows.R_COMMAND : rows.R_COMMAND + 2],
            preferred_ne_mps=row[rows.R_PREFERRED : rows.R_PREFERRED + 2],
            status=Status(int(row[rows.R_STATUS])),
            binding=tuple(int(j) for j in binding if j >= 0.0),
            obstacle_binding=bool(row[rows.R_OBSTACLE]),
            worst_slack_mps=float(row[rows.R_SLACK]),
            nearest_margin_m=float(row[rows.R_MARGIN]),
            nearest_index=int(row[rows.R_NEAREST]),
            time_to_violation_s=float(row[rows.R_TIME]),
            passing_side=self._side[:count].copy(),
            route_side=route,
        )


def warm_up() -> None:
    """Compile the kernels, or load them from the cache, once.

    Seconds when cold, a fraction of one from the cache. Call it before the first deadline, not within one.
    """
    square = Obstacles.from_polygons([[[50.0, 50.0], [60.0, 50.0], [60.0, 60.0], [50.0, 60.0]]])
    pair = np.zeros((1, 2))
    one = np.ones(1)
    traffic = Traffic(pair + 20.0, pair, pair, one, one, one, np.ones(1, np.bool_), np.zeros(1, np.int8))
    own = OwnShip(np.zeros(2), np.zeros(2), np.zeros(2), 0.5, 10.0)
    HalfplaneSolver().solve(own, traffic, goal_ne_m=(100.0, 100.0), cruise_mps=5.0, obstacles=square)
