"""The solvers for one own-ship: checked values in, one finite velocity within the limits out."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from contextlib import nullcontext
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ridlink.avoidance import graded, halfplane, headings, rotation, rows
from ridlink.avoidance.obstacles import NO_OBSTACLES, Obstacles
from ridlink.avoidance.packing import pack, unpack_memory
from ridlink.avoidance.priority import RightOfWay, give_way
from ridlink.avoidance.roadmap import new_roadmap
from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.avoidance.types import (
    Decision,
    FloatArray,
    OwnShip,
    SolverKind,
    Status,
    Traffic,
    checked_pair,
)
from ridlink.compiled import compiling_alone, is_compiled

SolverSettings = HalfplaneSettings | GradedSettings | RotationSettings


class Solver(Protocol):
    """Interface of the solvers: decides one step after the other."""

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
        route: int = 0,
    ) -> Decision:
        """Decide one step [m/s, north-east].

        Args:
            own: Own-ship.
            traffic: Neighbours.
            goal_ne_m: Where to go, shape (2,).
            preferred_ne_mps: Instead of a goal, the velocity wanted, shape (2,).
            cruise_mps: Speed wanted on the way to the goal.
            obstacles: Static obstacles, never relaxed.
            own_clearance_m: Distance to keep from them: airframe / 2 + own error bound + 0.1 s of flight; half the
                airframe if not given.
            extra_right_turn_rad: Turn of the preferred velocity on top of the solver's own, see `ProgressWatch`.
            route: `Decision.route` of the last step.

        Returns:
            Decision; its velocities are finite and not faster than the speed limit, whatever the status.

        Raises:
            ValueError: If a value is not finite or out of range (it is named), or not exactly one of goal and preferred
                velocity is given.
        """


def new_solver(kind: SolverKind | str = SolverKind.HALFPLANE, settings: SolverSettings | None = None) -> Solver:
    """A solver of that kind.

    Args:
        kind: Which one.
        settings: Its constants; those for a real vehicle if not given.

    Raises:
        ValueError: If there is no such kind, or the settings are those of another kind.
    """
    kind = SolverKind(kind)
    if kind is SolverKind.HALFPLANE and (settings is None or isinstance(settings, HalfplaneSettings)):
        return HalfplaneSolver(settings)
    if kind is SolverKind.GRADED and (settings is None or isinstance(settings, GradedSettings)):
        return GradedSolver(settings)
    if kind is SolverKind.ROTATION and (settings is None or isinstance(settings, RotationSettings)):
        return RotationSolver(settings)
    raise ValueError(f"the {kind} solver has no use for {type(settings).__name__}")


class _RowSolver(ABC):
    """Packs checked values into rows, calls a kernel, and unpacks its answer.

    Holds scratch memory and the ways worked out so far: about the same origin, equal arguments give equal answers. The
    memory of encounters is the caller's. Not for use by two threads at a time.
    """

    def __init__(self) -> None:
        self._own = np.zeros(rows.OWN_COLUMNS)
        self._result = rows.result_row()
        self._most = self._count = self._route = 0
        self._make_room(32, NO_OBSTACLES)

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
        route: int = 0,
    ) -> Decision:
        """See `Solver.solve`."""
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
        if count > self._most or not self._has_room(obstacles):
            self._make_room(max(2 * count, 32), obstacles)

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

        table, memory = self._reports, self._memory
        table[:count, 0:2], table[:count, 2:4] = traffic.position_ne_m, traffic.velocity_ne_mps
        table[:count, 4:6], table[:count, 6] = traffic.command_ne_mps, traffic.age_s
        table[:count, 7] = traffic.reciprocal
        table[:count, 8], table[:count, 9] = traffic.radius_m, traffic.error_sum_m
        memory[:count] = traffic.memory
        pack(table, memory, count, self._neighbours)
        self._route = route
        self._decide(count, obstacles)
        return self._decision(count)

    def _make_room(self, count: int, obstacles: Obstacles) -> None:
        """Allocate scratch for so many neighbours and these obstacles."""
        self._most = count
        self._neighbours = rows.new_blocks(count)
        self._reports = np.zeros((count, 10))
        self._memory = np.zeros(count, np.int8)
        self._reserve(obstacles)

    @abstractmethod
    def _reserve(self, obstacles: Obstacles) -> None:
        """Make the scratch of the kernel, for as many neighbours as there is room for."""

    @abstractmethod
    def _has_room(self, obstacles: Obstacles) -> bool:
        """Whether the scratch is large enough for these obstacles, at the number of neighbours it was made for."""

    @abstractmethod
    def _decide(self, count: int, obstacles: Obstacles) -> None:
        """Call the kernel; a solver that goes round obstacles updates the memory of its way."""

    def _decision(self, count: int) -> Decision:
        self._count = count
        row: FloatArray = self._result.copy()
        unpack_memory(self._neighbours, count, self._memory)
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
            memory=self._memory[:count].copy(),
            route=self._route,
        )


class HalfplaneSolver(_RowSolver):
    """Velocity nearest the preferred one that keeps out of every disc; the least bad one if there is none.

    The way to a goal leads round the obstacles.
    """

    def __init__(self, settings: HalfplaneSettings | None = None) -> None:
        self.settings = settings or HalfplaneSettings()
        self._vector = self.settings.as_vector()
        self._layout, self._roadmap = NO_OBSTACLES.layout, new_roadmap(NO_OBSTACLES)
        super().__init__()

    def half_planes(self) -> list[tuple[FloatArray, int]]:
        """Half-planes that constrained the last decision, for inspection.

        Returns:
            Half-planes (n_1, n_2, d), velocities x with n.x >= d being allowed, each with the place of its neighbour,
            or -1 for an obstacle. A neighbour has one of now and one of later. Those that every velocity within the
            limit meets are left out, and those that keep airframes from touching within the next step.
        """
        candidates, names, lines, *_ = self._scratch
        hard = rows.LANES * rows.blocks_for(self._count)
        columns = lines[:3, hard : hard + int(self._result[rows.R_HARD])].T
        found = [(plane.copy(), -1) for plane in columns if plane[2] > -math.inf]
        for c in range(int(self._result[rows.R_MATTERING])):
            block, lane, place = candidates[c // rows.LANES], c % rows.LANES, int(names[c])
            for first in (rows.NOW, rows.LATER) if self.settings.response_time_s > 0.0 else (rows.NOW,):
                plane = block[first + lane : first + 3 * rows.LANES : rows.LANES].copy()
                if plane[2] > -math.inf:
                    found.append((plane, place))
        return found

    def _reserve(self, obstacles: Obstacles) -> None:
        self._scratch = halfplane.new_scratch(self._most, obstacles)

    def _has_room(self, obstacles: Obstacles) -> bool:
        return halfplane.has_room(self._scratch, obstacles)

    def _decide(self, count: int, obstacles: Obstacles) -> None:
        if obstacles.layout is not self._layout:
            self._layout, self._roadmap = obstacles.layout, new_roadmap(obstacles)
        self._route = halfplane.avoid_one(
            self._own, self._neighbours, rows.blocks_for(count), math.inf, obstacles.pieces, self._roadmap,
            self._route, self._vector, self._scratch, self._result,
        )  # fmt: skip


class _HeadingSolver(_RowSolver):
    """Common part of the two solvers that choose among headings.

    They fly straight to the goal and turn away from an obstacle as soon as it lies before the goal. A choice among
    headings is no help to a vehicle that is told to stand: without a goal, a preferred velocity of zero stays zero.
    """

    _vector: FloatArray
    _fan: FloatArray

    def _reserve(self, obstacles: Obstacles) -> None:
        self._scratch = headings.new_scratch(self._most, obstacles)

    def _has_room(self, obstacles: Obstacles) -> bool:
        return headings.has_room(self._scratch, obstacles)


class GradedSolver(_HeadingSolver):
    """The heading of least time and risk at full speed; positions should be filtered by the caller."""

    def __init__(self, settings: GradedSettings | None = None) -> None:
        self.settings = settings or GradedSettings()
        self._vector = self.settings.as_vector()
        self._fan = graded.candidates()
        super().__init__()

    def _decide(self, count: int, obstacles: Obstacles) -> None:
        graded.grade_one(
            self._own, self._neighbours, count, obstacles.pieces, self._vector, self._fan, self._scratch, self._result
        )


class RotationSolver(_HeadingSolver):
    """The paper's solver: the straight way, turned until it leads into no disc."""

    def __init__(self, settings: RotationSettings | None = None) -> None:
        self.settings = settings or RotationSettings()
        self._vector = self.settings.as_vector()
        self._fan = rotation.candidates(self.settings.step_deg, self.settings.left_weight)
        super().__init__()

    def _decide(self, count: int, obstacles: Obstacles) -> None:
        rotation.rotate_one(
            self._own, self._neighbours, count, obstacles.pieces, self._vector, self._fan, self._scratch, self._result
        )


_OWN_KERNELS = {
    SolverKind.HALFPLANE: (halfplane.avoid_one, give_way),
    SolverKind.GRADED: (graded.grade_one,),
    SolverKind.ROTATION: (rotation.rotate_one,),
}


def is_warm(kind: SolverKind | str = SolverKind.HALFPLANE) -> bool:
    """Whether `warm_up` needs no compiler: every kernel of a solver is in memory or in the cache on disk."""
    return all(is_compiled(kernel) for kernel in (pack, unpack_memory, *_OWN_KERNELS[SolverKind(kind)]))


def warm_up(kind: SolverKind | str = SolverKind.HALFPLANE) -> None:
    """Compile the kernels of a solver, or load them from the cache, once.

    Takes seconds when cold, a fraction of one from the cache. Call it before the first deadline, not within one. If
    several processes are cold, one compiles and the others wait for it.
    """
    with nullcontext() if is_warm(kind) else compiling_alone(pack):
        _decide_once(SolverKind(kind))


def _decide_once(kind: SolverKind) -> None:
    square = Obstacles.from_polygons([[[50.0, 50.0], [60.0, 50.0], [60.0, 60.0], [50.0, 60.0]]])
    pair = np.zeros((1, 2))
    one = np.ones(1)
    traffic = Traffic(pair + 20.0, pair, pair, one, one, one, np.ones(1, np.bool_), np.zeros(1, np.int8))
    own = OwnShip(np.zeros(2), np.zeros(2), np.zeros(2), 0.5, 10.0)
    new_solver(kind).solve(own, traffic, goal_ne_m=(100.0, 100.0), cruise_mps=5.0, obstacles=square)
    if kind == SolverKind.HALFPLANE:
        RightOfWay().velocity(own, 1, traffic, np.zeros(1, np.int64), goal_ne_m=(99.0, 0.0), cruise_mps=5.0, now_s=0.0)
