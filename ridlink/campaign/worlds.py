"""Whole batches of worlds in virtual time, through the kernels that the daemon calls.

Every step all vehicles of all worlds report, decide from the same picture, and fly; vehicles obey at once. A run is one
row of the outcome and depends on the plan and its own number only, not on the batch it is flown in.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import rows
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.priority import give_way_in_worlds, new_turns
from ridlink.avoidance.types import SolverKind
from ridlink.campaign.chance import PositionErrors, draw_fleet
from ridlink.campaign.deciding import new_decider
from ridlink.campaign.plan import Plan, coded_bound_m
from ridlink.campaign.stepping import brief_worlds, fly_on
from ridlink.separation.definitions import Discs, separation_discs
from ridlink.traffic.position_filter import TIME_CONSTANT_S

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BATCH = 128
"""Runs flown at a time: enough to make little of a call, little enough for the caches."""

COMPACT_EVERY = 20
"""Steps after which worlds that are over leave the batch."""


@dataclass(frozen=True, slots=True)
class Outcomes:
    """What happened, one row a run: R runs of N vehicles.

    Attributes:
        run: Numbers of the runs, shape (R,).
        duration_s: Cut-off; the time of a flight that did not arrive.
        arrival_s: When a vehicle arrived, infinite if it did not, shape (R, N).
        collided: True for vehicles in a mid-air collision, shape (R, N).
        distance_m: Smallest true distance of two centres, shape (R,).
        margin_m: The same less the MAC radius, shape (R,).
        decisions: Number of decisions, shape (R,).
        infeasible: Those in which no velocity met every constraint, shape (R,).
        in_obstacle: Steps of vehicles with their true centre in an obstacle, shape (R,).
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
    """What happens at one instant in a batch of W worlds, for who watches.

    Attributes:
        now_s: Time since the start.
        position_ne_m: Where the vehicles are, shape (W, N, 2).
        reported_ne_m: Where they say they are, shape (W, N, 2).
        velocity_ne_mps: How they flew until now, shape (W, N, 2).
        command_ne_mps: How they fly from now on, shape (W, N, 2).
        present: Who is in the air, shape (W, N).
        airframe_m: Airframe sizes, shape (W, N).
        sending: Who reports at this instant, shape (W, N); None: everybody in the air.
    """

    now_s: float
    position_ne_m: FloatArray
    reported_ne_m: FloatArray
    velocity_ne_mps: FloatArray
    command_ne_mps: FloatArray
    present: BoolArray
    airframe_m: FloatArray
    sending: BoolArray | None = None


def fly(
    plan: Plan, runs: range, *, batch: int = BATCH, watch: Callable[[Instant], None] | None = None
) -> Outcomes:  # fmt: skip
    """Fly runs of a plan.

    Args:
        plan: What to fly.
        runs: Numbers of the runs, not negative; they seed them.
        batch: How many are flown at a time.
        watch: Called at every instant of every batch; worlds that are over leave it.

    Returns:
        One row a run, in their order.

    Raises:
        ValueError: If there are no runs, or a number is negative.
    """
    if not runs or min(runs) < 0 or batch < 1:
        raise ValueError(f"runs must be a range of numbers that are not negative, got {runs} in batches of {batch}")
    return Outcomes.joined([_Batch(plan, runs[k : k + batch]).fly(watch) for k in range(0, len(runs), batch)])


class _Batch:
    """Worlds in the air, W of them; those that are over leave it."""

    def __init__(self, plan: Plan, runs: range) -> None:
        scene = plan.scene
        shape = (len(runs), len(scene))
        fleets = [draw_fleet(len(scene), plan.seed, run, plan.category) for run in runs]
        drawn_airframe = np.stack([fleet.airframe_m for fleet in fleets])
        drawn_speed = np.stack([fleet.speed_mps for fleet in fleets])
        self.plan = plan
        self.obstacles = Obstacles.from_polygons(scene.polygons_ne_m)
        self.airframe_m = drawn_airframe if scene.airframe_m is None else np.tile(scene.airframe_m, (shape[0], 1))
        self.speed_mps = drawn_speed if scene.speed_mps is None else np.tile(scene.speed_mps, (shape[0], 1))
        self.sigma_m = np.full(shape[1], plan.sigma_m) if scene.sigma_m is None else scene.sigma_m
        self.extended = np.ones(shape[1], np.bool_) if scene.extended is None else scene.extended
        self.position = np.tile(scene.start_ne_m, (shape[0], 1, 1))
        away = scene.goal_ne_m - scene.start_ne_m
        course = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]
        self.velocity = course * self.speed_mps[..., None]
        self.present = np.ones(shape, np.bool_)
        self.errors = PositionErrors(
            plan.errors, self.sigma_m, count=shape[1], seed=plan.seed, runs=runs, interval_s=plan.interval_s,
            correlation_s=plan.correlation_s, common_share=plan.common_share, bias_m=plan.bias_m,
        )  # fmt: skip
        self.decider = new_decider(plan.settings, shape, self.obstacles)
        still = self._discs(0.0)
        self.still_m, self.error_sum_m = np.ascontiguousarray(still.radius_m), np.ascontiguousarray(still.error_sum_m)
        # Every definition takes the displacement of both as it is, or not at all.
        self.displaced_s = plan.interval_s if np.any(self._discs(1.0).radius_m > still.radius_m) else 0.0
        self.clearance_m = self._clearance(still)
        self.reported = np.zeros((*shape, 2))
        # What a step works on; while fewer worlds fly, the first of it.
        self.own = np.zeros((*shape, rows.OWN_COLUMNS))
        self.heard = np.full((*shape, 8), np.nan)
        self.heard[..., 6] = 0.0
        # Who does not speak the extension cannot say that it avoids.
        self.heard[..., 7] = scene.avoiding & self.extended
        self.radius_m = np.empty_like(self.still_m)
        self.before, self.hit = np.empty((*shape, 2)), np.empty(shape, np.bool_)
        self.turns = new_turns(*shape)
        self.room = np.zeros((shape[1], 10)), np.zeros(shape[1], np.int64)
        self.row = np.arange(shape[0])
        self.outcome = Outcomes(
            run=np.array(runs), duration_s=plan.duration_s, arrival_s=np.full(shape, np.inf),
            collided=np.zeros(shape, np.bool_), distance_m=np.full(shape[0], np.inf),
            margin_m=np.full(shape[0], np.inf), decisions=np.zeros(shape[0], np.int64),
            infeasible=np.zeros(shape[0], np.int64), in_obstacle=np.zeros(shape[0], np.int64),
        )  # fmt: skip

    def _discs(self, speed_mps: float) -> Discs:
        plan = self.plan
        error_m = plan.bound_sigmas * self.sigma_m
        coded_m = np.array([coded_bound_m(bound) for bound in error_m])
        told_airframe_m = np.where(self.extended, self.airframe_m, np.nan)
        told_error_m = np.where(self.extended, error_m, np.nan)
        return separation_discs(
            plan.definition, own_airframe_m=self.airframe_m[:, :, None], own_error_bound_m=error_m[:, None],
            own_accuracy_bound_m=coded_m[:, None], own_speed_mps=speed_mps, airframe_m=told_airframe_m[:, None, :],
            error_bound_m=told_error_m, accuracy_bound_m=coded_m, speed_mps=speed_mps,
            interval_s=plan.interval_s, eta=plan.eta, neighbours=max(len(plan.scene) - 1, 1), bound=plan.chance_bound,
        )  # fmt: skip

    def fly(self, watch: Callable[[Instant], None] | None) -> Outcomes:
        """Fly until all have arrived or collided, or the time is over."""
        plan = self.plan
        for step in range(round(plan.duration_s / plan.interval_s)):
            if step % COMPACT_EVERY == 0:
                self._let_go()
                if not len(self.row):
                    break
            self._report(step)
            result = self._decide(step * plan.interval_s)
            if watch is not None:
                self._show(watch, step * plan.interval_s, result)
            self._fly_on((step + 1) * plan.interval_s, result)
        return self.outcome

    def _let_go(self) -> None:
        """Worlds without a vehicle in the air leave the batch."""
        kept: BoolArray = np.any(self.present, axis=1)
        if kept.all():
            return
        for name in (
            "airframe_m", "speed_mps", "position", "velocity", "present", "still_m", "clearance_m", "error_sum_m",
            "reported", "turns", "row",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[kept])
        self.errors.keep(kept)
        self.decider.keep(kept)

    def _report(self, step: int) -> None:
        """Positions as everybody hears them, the vehicle itself included."""
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

    def _clearance(self, still: Discs) -> FloatArray:
        """Distance to keep from obstacles but for the displacement: half of what two such vehicles would keep from each
        other."""
        if self.plan.obstacle_bound_m is not None:
            return self.airframe_m / 2.0 + self.plan.obstacle_bound_m
        twin: FloatArray = np.diagonal(still.radius_m, axis1=1, axis2=2) / 2.0
        return twin

    def _fly_on(self, now_s: float, result: FloatArray) -> None:
        plan, outcome, obstacles, count = self.plan, self.outcome, self.obstacles, len(self.row)
        fly_on(
            result, plan.scene.avoiding, plan.interval_s, now_s, plan.scene.goal_ne_m, plan.arrived_m,
            obstacles.piece_vertex_ne_m, obstacles.piece_start, plan.swept, self.airframe_m, self.position,
            self.before[:count], self.velocity, self.present, self.hit[:count], self.row, outcome.arrival_s,
            outcome.collided, outcome.distance_m, outcome.margin_m, outcome.decisions, outcome.infeasible,
            outcome.in_obstacle,
        )  # fmt: skip
