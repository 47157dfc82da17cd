"""Flying the runs of a plan: the one way in for whoever wants outcomes.

Where everybody hears every report at once and flies as decided, all share one picture, and `worlds` flies them. Here
fly those who do not: reports are lost and late, receivers keep tracks, vehicles answer as autopilots do, some are stock
senders, some avoid nobody.

Everybody decides at the same instants. A report holds what its sender knows at such an instant; one that arrives
between two of them is heard at the second. Every flight begins with a complete picture. Who has arrived, or collided,
leaves it at once, as in the paper.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import rows
from ridlink.avoidance import worlds as batches
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.progress import ProgressWatch
from ridlink.avoidance.types import SolverKind
from ridlink.campaign import tracks, worlds
from ridlink.campaign.chance import PositionErrors, Source, draw_fleet, draw_mix, generator
from ridlink.campaign.link import Reception
from ridlink.campaign.pair_deciding import PairDecider, avoid_pairs, grade_pairs, rotate_pairs
from ridlink.campaign.plan import Plan, coded_bound_m
from ridlink.campaign.referee import judge_worlds
from ridlink.campaign.response import Dynamics, Response
from ridlink.campaign.stepping import is_inside
from ridlink.campaign.worlds import BATCH, COMPACT_EVERY, Instant, Outcomes
from ridlink.compiled import is_compiled
from ridlink.separation.definitions import bounded_error, separation_discs
from ridlink.traffic.position_filter import TIME_CONSTANT_S

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WATCH = ProgressWatch()
"""Only its constants: here its rule is written out for whole batches."""


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
    if plan.is_heard_at_once:
        return worlds.fly(plan, runs, batch=batch, watch=watch)
    if not runs or min(runs) < 0 or batch < 1:
        raise ValueError(f"runs must be a range of numbers that are not negative, got {runs} in batches of {batch}")
    return Outcomes.joined([_Batch(plan, runs[k : k + batch]).fly(watch) for k in range(0, len(runs), batch)])


def is_warm(plan: Plan) -> bool:
    """Whether flying a plan needs no compiler: the kernel that decides in it is in memory or kept on disk."""
    at_once, by_pairs = _KERNELS[plan.solver]
    return is_compiled(at_once if plan.is_heard_at_once else by_pairs)


_KERNELS = {
    SolverKind.HALFPLANE: (batches.avoid_worlds, avoid_pairs),
    SolverKind.GRADED: (batches.grade_worlds, grade_pairs),
    SolverKind.ROTATION: (batches.rotate_worlds, rotate_pairs),
}


class _Batch:
    """Worlds in the air, W of them; those that are over leave it."""

    _OF_WORLDS = (
        "airframe_m", "speed_mps", "avoiding", "reciprocal", "position", "velocity", "command", "present", "still_m",
        "error_sum_m", "bound_m", "clearance_m", "own_track", "tracks", "sent", "arrives_s", "due_s", "turn_rad", "row",
    )  # fmt: skip

    def __init__(self, plan: Plan, runs: range) -> None:
        scene = plan.scene
        count = len(scene)
        shape = (len(runs), count)
        fleets = [draw_fleet(count, plan.seed, run, plan.category) for run in runs]
        shares = {"stock_share": plan.stock_share, "unresponsive_share": plan.unresponsive_share}
        mixes = [draw_mix(count, plan.seed, run, **shares) for run in runs]
        drawn_airframe = np.stack([fleet.airframe_m for fleet in fleets])
        drawn_speed = np.stack([fleet.speed_mps for fleet in fleets])
        self.plan = plan
        self.step_s = plan.step_s or plan.interval_s
        self.obstacles = Obstacles.from_polygons(scene.polygons_ne_m)
        self.airframe_m = drawn_airframe if scene.airframe_m is None else np.tile(scene.airframe_m, (shape[0], 1))
        self.speed_mps = drawn_speed if scene.speed_mps is None else np.tile(scene.speed_mps, (shape[0], 1))
        sigma_m = np.full(count, plan.sigma_m) if scene.sigma_m is None else scene.sigma_m
        extended = ~np.stack([mix.stock for mix in mixes])
        if scene.extended is not None:
            extended &= scene.extended
        self.avoiding: BoolArray = scene.avoiding & ~np.stack([mix.unresponsive for mix in mixes])
        self.reciprocal = (self.avoiding & extended).astype(np.float64)
        self.position = np.tile(scene.start_ne_m, (shape[0], 1, 1))
        away = scene.goal_ne_m - scene.start_ne_m
        course = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]
        self.velocity = course * self.speed_mps[..., None]
        self.command = self.velocity.copy()
        self.present = np.ones(shape, np.bool_)
        self.errors = PositionErrors(
            plan.errors, sigma_m, count=count, seed=plan.seed, runs=runs, interval_s=self.step_s,
            correlation_s=plan.correlation_s, common_share=plan.common_share, bias_m=plan.bias_m,
        )  # fmt: skip
        self.response = Response(plan.dynamics, self.velocity, self.speed_mps)
        self._size_discs(sigma_m, extended)
        self.decider = PairDecider(plan.settings, shape, self.obstacles)

        self.reception = Reception(plan.link, count=count, seed=plan.seed, runs=runs)
        slots = 1 + math.ceil(plan.link.latency_s[1] / min(plan.interval_s, self.step_s) - 1e-9)
        self.sent = np.zeros((*shape, slots, tracks.REPORT_COLUMNS))
        self.arrives_s = np.full((*shape, count, slots), np.inf)
        self.tracks = np.zeros((*shape, count, tracks.TRACK_COLUMNS))
        self.tracks[..., tracks.BETWEEN] = plan.interval_s
        self.intent = np.where(extended[..., None], 0.0, np.nan)
        self.filter_s = TIME_CONSTANT_S if plan.filtered else 0.0
        # A vehicle that obeys at once flew the last interval at the velocity that it reports at its end.
        self.flown_s = plan.interval_s if plan.dynamics is Dynamics.IDEAL else 0.0
        self.own_track = np.zeros((*shape, tracks.TRACK_COLUMNS))
        phases = max(round(plan.interval_s / self.step_s), 1)
        drawn = np.stack([generator(plan.seed, run, Source.PHASE).integers(0, phases, count) for run in runs])
        self.due_s = drawn * self.step_s
        self.turn_rad = np.zeros(shape)
        self.to_goal_m = np.full((round(WATCH.window_s / self.step_s), *shape), np.nan)
        self.row = np.arange(shape[0])
        self.outcome = Outcomes(
            run=np.array(runs), duration_s=plan.duration_s, arrival_s=np.full(shape, np.inf),
            collided=np.zeros(shape, np.bool_), distance_m=np.full(shape[0], np.inf),
            margin_m=np.full(shape[0], np.inf), decisions=np.zeros(shape[0], np.int64),
            infeasible=np.zeros(shape[0], np.int64), in_obstacle=np.zeros(shape[0], np.int64),
        )  # fmt: skip

    def _size_discs(self, sigma_m: FloatArray, extended: BoolArray) -> None:
        """Radii of all pairs but for the displacement, error bounds as they are told, distances to obstacles."""
        plan = self.plan
        error_m = plan.bound_sigmas * sigma_m
        coded_m = np.array([coded_bound_m(bound) for bound in error_m])
        told_m = np.where(extended, error_m, np.nan)

        def discs(speed_mps: float) -> tuple[FloatArray, FloatArray]:
            found = separation_discs(
                plan.definition, own_airframe_m=self.airframe_m[:, :, None], own_error_bound_m=error_m[:, None],
                own_accuracy_bound_m=coded_m[:, None], own_speed_mps=speed_mps,
                airframe_m=np.where(extended, self.airframe_m, np.nan)[:, None, :],
                error_bound_m=told_m[:, None, :], accuracy_bound_m=coded_m, speed_mps=speed_mps, eta=plan.eta,
                neighbours=max(len(plan.scene) - 1, 1), bound=plan.chance_bound,
            )  # fmt: skip
            return np.ascontiguousarray(found.radius_m), np.ascontiguousarray(found.error_sum_m)

        self.still_m, self.error_sum_m = discs(0.0)
        allowed_s = plan.interval_s if plan.displaced_s is None else plan.displaced_s
        # Every definition takes the displacement of both as it is, or not at all.
        self.displaced_s = allowed_s if np.any(discs(1.0)[0] > self.still_m) else 0.0
        self.bound_m = bounded_error(np.where(extended, error_m, coded_m))
        if plan.obstacle_bound_m is not None:
            self.clearance_m = self.airframe_m / 2.0 + plan.obstacle_bound_m
        else:
            # Half of what two such vehicles would keep from each other.
            self.clearance_m = np.diagonal(self.still_m, axis1=1, axis2=2) / 2.0

    def fly(self, watch: Callable[[Instant], None] | None) -> Outcomes:
        """Fly until all have arrived or collided, or the time is over."""
        for step in range(round(self.plan.duration_s / self.step_s)):
            if step % COMPACT_EVERY == 0:
                self._let_go()
                if not len(self.row):
                    break
            now_s = step * self.step_s
            reported = self.position + self.errors.next()
            sending = self._send(step, now_s, reported)
            self._decide(step, now_s, reported)
            if watch is not None:
                watch(
                    Instant(
                        now_s, self.position, reported, self.velocity, self.command, self.present, self.airframe_m,
                        sending,
                    )
                )  # fmt: skip
            before = self.position
            self.position, self.velocity = before.copy(), self.velocity.copy()
            self.response.advance(self.position, self.velocity, self.command, self.step_s)
            self._judge(before, (step + 1) * self.step_s)
        return self.outcome

    def _let_go(self) -> None:
        """Worlds without a vehicle in the air leave the batch."""
        kept: BoolArray = np.any(self.present, axis=1)
        if kept.all():
            return
        for name in self._OF_WORLDS:
            setattr(self, name, getattr(self, name)[kept])
        self.intent, self.to_goal_m = self.intent[kept], self.to_goal_m[:, kept]
        for part in (self.errors, self.response, self.decider, self.reception):
            part.keep(kept)

    def _send(self, step: int, now_s: float, reported: FloatArray) -> BoolArray:
        """Those whose turn it is report, and are given back; everybody hears what has reached it."""
        plan = self.plan
        due = self.present & (self.due_s <= now_s + tracks.SAME_INSTANT_S)
        self.due_s = np.where(due, self.due_s + plan.interval_s, self.due_s)
        sending: BoolArray = np.ones_like(due) if step == 0 else due
        # Drawn at every step: what a run draws does not depend on when others of its batch report.
        lost, latency_s, luck = self.reception.next()
        if sending.any():
            slot = step % self.sent.shape[2]
            fresh = np.empty((*sending.shape, tracks.REPORT_COLUMNS))
            fresh[..., tracks.PLACE : tracks.PLACE + 2] = reported
            fresh[..., tracks.MOTION : tracks.MOTION + 2] = self.velocity
            fresh[..., tracks.INTENT : tracks.INTENT + 2] = self.command + self.intent
            fresh[..., tracks.AT] = now_s
            self.sent[:, :, slot] = np.where(sending[..., None], fresh, self.sent[:, :, slot])
            if step == 0:
                reaches, arrives_s = np.ones_like(lost), np.zeros_like(latency_s)
            else:
                apart = self.position[:, :, None] - self.position[:, None, :]
                distance = np.hypot(apart[..., 0], apart[..., 1])
                in_range = distance <= plan.range_m
                reaches, arrives_s = in_range & ~lost, now_s + latency_s
                if plan.link.depends_on_others:
                    heard = in_range & self.present[:, None, :] & ~np.eye(in_range.shape[1], dtype=np.bool_)
                    reaches &= luck < plan.link.share(distance, plan.range_m, heard)
            arrives_s = np.where(reaches, arrives_s, np.inf)
            self.arrives_s[..., slot] = np.where(sending[:, None, :], arrives_s, self.arrives_s[..., slot])
        tracks.hear(
            self.sent, self.arrives_s, now_s, self.bound_m, self.filter_s, self.flown_s, self.tracks
        )  # fmt: skip
        return sending

    def _own_position(self, now_s: float, reported: FloatArray) -> FloatArray:
        """Where vehicles believe they are: as they report, or smoothed like everything else that is heard."""
        if not self.plan.filtered:
            return reported
        itself = np.zeros((*self.present.shape, 1, tracks.REPORT_COLUMNS))
        itself[..., 0, tracks.PLACE : tracks.PLACE + 2] = reported
        itself[..., 0, tracks.MOTION : tracks.MOTION + 2] = self.velocity
        itself[..., 0, tracks.AT] = now_s
        flat = (-1, 1, 1)
        kept = self.own_track.reshape(*flat, tracks.TRACK_COLUMNS)
        tracks.hear(
            itself.reshape(*flat, tracks.REPORT_COLUMNS), np.zeros((len(kept), 1, 1, 1)), now_s,
            self.bound_m.reshape(-1, 1), self.filter_s, self.flown_s, kept,
        )  # fmt: skip
        return self.own_track[..., tracks.PLACE : tracks.PLACE + 2].copy()

    def _decide(self, step: int, now_s: float, reported: FloatArray) -> None:
        plan, scene = self.plan, self.plan.scene
        here = self._own_position(now_s, reported)
        # The way to the goal is flown by the true position, as in the paper.
        aim = scene.goal_ne_m - self.position + here
        own = np.zeros((*self.present.shape, rows.OWN_COLUMNS))
        own[..., rows.POSITION : rows.POSITION + 2] = here
        own[..., rows.VELOCITY : rows.VELOCITY + 2] = self.velocity
        own[..., rows.COMMAND : rows.COMMAND + 2] = self.command
        own[..., rows.AIM : rows.AIM + 2] = aim
        own[..., rows.LIMIT] = own[..., rows.CRUISE] = self.speed_mps
        speed = np.hypot(self.velocity[..., 0], self.velocity[..., 1])
        own[..., rows.CLEARANCE] = self.clearance_m + self.displaced_s * speed
        if plan.dynamics is not Dynamics.IDEAL:
            own[..., rows.EXTRA_TURN] = self._turn(step, np.hypot(*np.moveaxis(aim - here, -1, 0)))
        deciding = self.present & self.avoiding
        result = self.decider.decide(
            own, deciding, self.tracks, self.present, now_s, self.reciprocal, self.still_m, self.error_sum_m,
            self.displaced_s,
        )  # fmt: skip
        decided = result[..., rows.R_COMMAND : rows.R_COMMAND + 2]
        self.command = np.where(deciding[..., None], decided, self.command)
        self.outcome.decisions[self.row] += deciding.sum(axis=1)
        infeasible = deciding & (result[..., rows.R_STATUS] == rows.INFEASIBLE)
        self.outcome.infeasible[self.row] += infeasible.sum(axis=1)

    def _turn(self, step: int, to_goal_m: FloatArray) -> FloatArray:
        """The extra turn of those who get nowhere, as `ProgressWatch` has it."""
        slot = step % len(self.to_goal_m)
        before = self.to_goal_m[slot]
        slow = before - to_goal_m < WATCH.share * self.speed_mps * WATCH.window_s
        stalled = np.isfinite(before) & slow & (to_goal_m >= self.speed_mps)
        rate = np.where(stalled, WATCH.growth_rad_per_s, -WATCH.decay_rad_per_s)
        self.turn_rad = np.clip(self.turn_rad + rate * self.step_s, 0.0, WATCH.most_rad)
        self.to_goal_m[slot] = to_goal_m
        return self.turn_rad

    def _judge(self, before: FloatArray, now_s: float) -> None:
        plan, outcome, present = self.plan, self.outcome, self.present
        hit = np.empty_like(present)
        distance, margin = outcome.distance_m[self.row], outcome.margin_m[self.row]
        judge_worlds(before, self.position, present, self.airframe_m, plan.swept, hit, distance, margin)
        outcome.distance_m[self.row], outcome.margin_m[self.row] = distance, margin
        outcome.collided[self.row] |= hit
        if self.obstacles.piece_count:
            inside = present & is_inside(self.obstacles, self.position)
            outcome.in_obstacle[self.row] += inside.sum(axis=1)
        away = plan.scene.goal_ne_m - self.position
        there = present & ~hit & (away[..., 0] ** 2 + away[..., 1] ** 2 < plan.arrived_m**2)
        outcome.arrival_s[self.row] = np.where(there, now_s, outcome.arrival_s[self.row])
        self.present = present & ~hit & ~there
