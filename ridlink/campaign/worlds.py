"""Flies batches of worlds in virtual time, with the kernels that the daemon calls.

A run is one row of the outcomes. It depends on the plan and its own number only, not on its batch. In a shared batch,
all vehicles of all worlds report at every step, decide from the same picture, and obey at once. `flight` has the other
batches.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import rows
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.priority import give_way_in_worlds, new_turns
from ridlink.avoidance.types import SolverKind
from ridlink.campaign.chance import PositionErrors, draw_fleet, draw_mix
from ridlink.campaign.deciding import new_decider
from ridlink.campaign.plan import Plan
from ridlink.campaign.stepping import Flight, Log, Rules, brief_worlds, fly_on
from ridlink.remote_id.accuracy import coded_bound_m
from ridlink.separation.definitions import Reported, bounded_error, separation_discs
from ridlink.traffic.position_filter import TIME_CONSTANT_S

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BATCH = 128
"""Runs flown at a time: many enough that the cost of a call is small, few enough for the caches."""

MOST_PAIRS = 2**18
"""Limit of pairs of vehicles in a batch: each needs hundreds of bytes if every vehicle has its own picture. A single
world may have more."""

COMPACT_EVERY = 20
"""Steps after which finished worlds leave the batch."""


@dataclass(frozen=True, slots=True)
class Outcomes:
    """Outcomes of R runs of N vehicles, one row per run.

    Attributes:
        run: Numbers of the runs, shape (R,).
        duration_s: Cut-off; the time of a flight that did not arrive.
        arrival_s: Arrival time of each vehicle, infinite if it did not arrive, shape (R, N).
        collided: True for vehicles in a mid-air collision, shape (R, N).
        distance_m: Smallest true distance of two centres, shape (R,).
        margin_m: Smallest distance less the MAC radius, shape (R,).
        decisions: Number of decisions, shape (R,).
        infeasible: Decisions in which no velocity met every constraint, shape (R,).
        in_obstacle: Steps of vehicles whose true centre was in an obstacle, shape (R,).
    """

    run: NDArray[np.int64]
    duration_s: float
    arrival_s: FloatArray
    collided: BoolArray
    distance_m: FloatArray
    margin_m: FloatArray
    decisions: NDArray[np.int64]
    infeasible: NDArray[np.int64]
    in_obstacle: NDArray[np.int64]

    @property
    def flights(self) -> int:
        """Number of flights."""
        return int(self.collided.size)

    @property
    def macs(self) -> int:
        """Vehicles in a collision."""
        return int(self.collided.sum())

    @property
    def arrived(self) -> int:
        """Vehicles that arrived."""
        return int(np.isfinite(self.arrival_s).sum())

    @property
    def unfinished(self) -> int:
        """Vehicles that neither arrived nor collided."""
        return self.flights - self.macs - self.arrived

    @property
    def mission_s(self) -> FloatArray:
        """Times of the flights without a collision; the cut-off for those that did not arrive."""
        return np.minimum(self.arrival_s[~self.collided], self.duration_s)

    @classmethod
    def joined(cls, parts: list[Outcomes]) -> Outcomes:
        """Rows of several batches as one.

        Raises:
            ValueError: If there is none.
        """
        if not parts:
            raise ValueError("no runs to join")
        names = [name for name in cls.__slots__ if name != "duration_s"]
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(duration_s=parts[0].duration_s, **columns)


@dataclass(frozen=True, slots=True)
class Instant:
    """The state of a batch of W worlds at one instant, for an observer.

    Attributes:
        now_s: Time since the start.
        position_ne_m: True positions, shape (W, N, 2).
        reported_ne_m: Reported positions, shape (W, N, 2).
        velocity_ne_mps: Velocities until now, shape (W, N, 2).
        command_ne_mps: Commanded velocities from now on, shape (W, N, 2).
        present: Mask of vehicles in the air, shape (W, N).
        airframe_m: Airframe sizes, shape (W, N).
        sending: Mask of vehicles that report at this instant, shape (W, N); None: all in the air.
    """

    now_s: float
    position_ne_m: FloatArray
    reported_ne_m: FloatArray
    velocity_ne_mps: FloatArray
    command_ne_mps: FloatArray
    present: BoolArray
    airframe_m: FloatArray
    sending: BoolArray | None = None


@dataclass(frozen=True, slots=True)
class Roles:
    """Roles of the vehicles of one run, shape (N,) each.

    Attributes:
        avoiding: Whether it avoids others.
        extended: Whether it sends more than standard Remote ID.
    """

    avoiding: BoolArray
    extended: BoolArray


def draw_roles(plan: Plan, run: int) -> Roles:
    """Roles of the scene, changed for the vehicles that are drawn to be special."""
    scene = plan.scene
    mix = draw_mix(len(scene), plan.seed, run, stock_share=plan.stock_share, unresponsive_share=plan.unresponsive_share)
    extended = ~mix.stock if scene.extended is None else scene.extended & ~mix.stock
    return Roles(scene.avoiding & ~mix.unresponsive, extended)


class Batch(ABC):
    """A batch of W worlds in flight; finished worlds leave it.

    Args:
        plan: Their plan.
        runs: Numbers of their runs.
    """

    of_worlds: tuple[str, ...] = (
        "airframe_m", "speed_mps", "avoiding", "extended", "position", "velocity", "present", "still_m", "error_sum_m",
        "bound_m", "clearance_m", "row",
    )  # fmt: skip
    """Names of attributes whose first axis is that of worlds."""

    def __init__(self, plan: Plan, runs: range) -> None:
        scene = plan.scene
        count = len(scene)
        shape = (len(runs), count)
        fleets = [draw_fleet(count, plan.seed, run, plan.category) for run in runs]
        roles = [draw_roles(plan, run) for run in runs]
        drawn_airframe = np.stack([fleet.airframe_m for fleet in fleets])
        drawn_speed = np.stack([fleet.speed_mps for fleet in fleets])
        self.plan = plan
        self.step_s = plan.step_s or plan.interval_s
        self.obstacles = Obstacles.from_polygons(scene.polygons_ne_m)
        self.airframe_m = drawn_airframe if scene.airframe_m is None else np.tile(scene.airframe_m, (shape[0], 1))
        self.speed_mps = drawn_speed if scene.speed_mps is None else np.tile(scene.speed_mps, (shape[0], 1))
        sigma_m = plan.vehicle_sigma_m
        self.extended: BoolArray = np.stack([each.extended for each in roles])
        self.avoiding: BoolArray = np.stack([each.avoiding for each in roles])
        self.position = np.tile(scene.start_ne_m, (shape[0], 1, 1))
        away = scene.goal_ne_m - scene.start_ne_m
        course = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]
        self.velocity = course * self.speed_mps[..., None]
        self.present = np.ones(shape, np.bool_)
        self.errors = PositionErrors(
            plan.errors, sigma_m, count=count, seed=plan.seed, runs=runs, interval_s=self.step_s,
            correlation_s=plan.correlation_s, common_share=plan.common_share, bias_m=plan.bias_m,
        )  # fmt: skip
        self._size_discs(sigma_m)
        self.row = np.arange(shape[0])
        self.outcome = Outcomes(
            run=np.array(runs), duration_s=plan.duration_s, arrival_s=np.full(shape, np.inf),
            collided=np.zeros(shape, np.bool_), distance_m=np.full(shape[0], np.inf),
            margin_m=np.full(shape[0], np.inf), decisions=np.zeros(shape[0], np.int64),
            infeasible=np.zeros(shape[0], np.int64), in_obstacle=np.zeros(shape[0], np.int64),
        )  # fmt: skip

    def _size_discs(self, sigma_m: FloatArray) -> None:
        """Compute radii of all pairs without displacement, reported error bounds, and distances to obstacles."""
        plan = self.plan
        error_m = plan.bound_sigmas * sigma_m
        coded_m = np.array([coded_bound_m(bound, plan.accuracy_convention) for bound in error_m])
        told_m = np.where(self.extended, error_m, np.nan)
        told_airframe_m = np.where(self.extended, self.airframe_m, np.nan)

        def discs(speed_mps: float) -> tuple[FloatArray, FloatArray]:
            found = separation_discs(
                plan.definition,
                Reported(self.airframe_m[:, :, None], error_m[:, None], coded_m[:, None], speed_mps),
                Reported(told_airframe_m[:, None, :], told_m[:, None, :], coded_m, speed_mps),
                eta=plan.eta, neighbours=max(len(plan.scene) - 1, 1), bound=plan.chance_bound,
            )  # fmt: skip
            return np.ascontiguousarray(found.radius_m), np.ascontiguousarray(found.error_sum_m)

        self.still_m, self.error_sum_m = discs(0.0)
        allowed_s = plan.interval_s if plan.displaced_s is None else plan.displaced_s
        # Every definition adds the displacement of both in full, or not at all.
        self.displaced_s = allowed_s if np.any(discs(1.0)[0] > self.still_m) else 0.0
        self.bound_m = bounded_error(np.where(self.extended, error_m, coded_m))
        if plan.obstacle_bound_m is not None:
            self.clearance_m = self.airframe_m / 2.0 + plan.obstacle_bound_m
        else:
            # Half of the distance that two such vehicles would keep.
            self.clearance_m = np.diagonal(self.still_m, axis1=1, axis2=2) / 2.0

    def fly(self, watch: Callable[[Instant], None] | None) -> Outcomes:
        """Fly until all vehicles have arrived or collided, or the time is over."""
        for step in range(round(self.plan.duration_s / self.step_s)):
            if step % COMPACT_EVERY == 0:
                kept: BoolArray = np.any(self.present, axis=1)
                if not kept.any():
                    break
                if not kept.all():
                    self.keep(kept)
            self.advance(step, watch)
        return self.outcome

    @abstractmethod
    def advance(self, step: int, watch: Callable[[Instant], None] | None) -> None:
        """Report, decide and fly on."""

    def keep(self, kept: BoolArray) -> None:
        """Keep only some worlds, shape (W,)."""
        for name in self.of_worlds:
            setattr(self, name, getattr(self, name)[kept])
        self.errors.keep(kept)


class SharedBatch(Batch):
    """Worlds in which all vehicles have the same picture."""

    of_worlds = (*Batch.of_worlds, "reported", "turns")

    def __init__(self, plan: Plan, runs: range) -> None:
        super().__init__(plan, runs)
        shape = self.present.shape
        self.decider = new_decider(plan.settings, shape, self.obstacles)
        self.reported = np.zeros((*shape, 2))
        # Arrays for a step; with fewer worlds, their first part is used.
        self.own = np.zeros((*shape, rows.OWN_COLUMNS))
        self.heard = np.full((*shape, 8), np.nan)
        self.heard[..., 6] = 0.0
        # A vehicle without the extension cannot say that it avoids.
        self.heard[..., 7] = self.avoiding & self.extended
        self.radius_m = np.empty_like(self.still_m)
        self.before, self.hit = np.empty((*shape, 2)), np.empty(shape, np.bool_)
        self.turns = new_turns(*shape)
        self.room = np.zeros((shape[1], 10)), np.zeros(shape[1], np.int64)
        scene, obstacles = plan.scene, self.obstacles
        self.rules = Rules(
            scene.goal_ne_m, scene.avoiding, plan.arrived_m, obstacles.piece_vertex_ne_m, obstacles.piece_start,
            plan.swept, plan.interval_s,
        )  # fmt: skip
        self.log = Log(*(getattr(self.outcome, name) for name in Log._fields))

    def advance(self, step: int, watch: Callable[[Instant], None] | None) -> None:
        """See `Batch.advance`."""
        self._report(step)
        result = self._decide(step * self.step_s)
        if watch is not None:
            self._show(watch, step * self.step_s, result)
        self._fly_on((step + 1) * self.step_s, result)

    def keep(self, kept: BoolArray) -> None:
        """See `Batch.keep`."""
        super().keep(kept)
        self.decider.keep(kept)

    def _report(self, step: int) -> None:
        """Draw the reported positions, which the vehicle itself uses, too."""
        report = self.position + self.errors.next()
        if not self.plan.filtered or step == 0:
            self.reported = report
            return
        predicted = self.reported + self.velocity * self.plan.interval_s
        gain = max(1.0 / (step + 1), 1.0 - math.exp(-self.plan.interval_s / TIME_CONSTANT_S))
        self.reported = predicted + gain * (report - predicted)

    def _decide(self, now_s: float) -> FloatArray:
        plan, scene, count = self.plan, self.plan.scene, len(self.row)
        own, heard, radius = self.own[:count], self.heard[:count], self.radius_m[:count]
        brief_worlds(
            self.position, self.reported, self.velocity, scene.goal_ne_m, self.speed_mps, self.still_m,
            self.clearance_m, self.displaced_s, own, heard, radius,
        )  # fmt: skip
        deciding = self.present & scene.avoiding
        if plan.solver is SolverKind.HALFPLANE:
            give_way_in_worlds(
                own, deciding, heard, self.present, radius, plan.range_m, now_s, self.turns, *self.room
            )  # fmt: skip
        return self.decider.decide(own, deciding, heard, self.present, radius, self.error_sum_m, plan.range_m)

    def _show(self, watch: Callable[[Instant], None], now_s: float, result: FloatArray) -> None:
        deciding = self.present & self.plan.scene.avoiding
        decided = result[..., rows.R_VELOCITY : rows.R_VELOCITY + 2]
        watch(
            Instant(
                now_s, self.position.copy(), self.reported.copy(), self.velocity.copy(),
                np.where(deciding[..., None], decided, self.velocity), self.present.copy(), self.airframe_m,
            )
        )  # fmt: skip

    def _fly_on(self, now_s: float, result: FloatArray) -> None:
        count = len(self.row)
        flight = Flight(
            self.position, self.before[:count], self.velocity, self.present, self.hit[:count], self.airframe_m
        )
        fly_on(result, now_s, self.rules, flight, self.row, self.log)
