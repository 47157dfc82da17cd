"""Flies the runs of a plan and returns their outcomes.

If every vehicle receives every report at once and flies as decided, all share one picture, and `worlds` flies them.
This module flies the other plans: reports are lost and late, receivers keep tracks, vehicles respond as with
autopilots, some send standard Remote ID only, some avoid nobody.

All vehicles decide at the same instants. A report holds what its sender knows at such an instant; a report that arrives
between two instants is received at the second. Every flight begins with a complete picture. A vehicle that has arrived
or collided leaves the picture at once, as in the paper.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import rows
from ridlink.avoidance import worlds as batches
from ridlink.avoidance.progress import ProgressWatch
from ridlink.avoidance.types import SolverKind
from ridlink.campaign import tracks
from ridlink.campaign.chance import Source, generator
from ridlink.campaign.channel import Reception
from ridlink.campaign.pair_deciding import PairDecider, avoid_pairs, grade_pairs, rotate_pairs
from ridlink.campaign.plan import Plan
from ridlink.campaign.referee import judge_worlds
from ridlink.campaign.response import Dynamics, Response
from ridlink.campaign.stepping import is_inside
from ridlink.campaign.worlds import BATCH, MOST_PAIRS, Batch, Instant, Outcomes, SharedBatch
from ridlink.compiled import is_compiled
from ridlink.traffic.position_filter import TIME_CONSTANT_S

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WATCH = ProgressWatch()
"""Only its constants are used: the rule is implemented here for whole batches."""


def fly(
    plan: Plan, runs: range, *, batch: int = BATCH, watch: Callable[[Instant], None] | None = None
) -> Outcomes:  # fmt: skip
    """Fly runs of a plan.

    Args:
        plan: What to fly.
        runs: Numbers of the runs, not negative; they are part of the seed.
        batch: Number of runs flown at a time; fewer if the worlds are large.
        watch: Called at every instant of every batch; finished worlds leave the batch.

    Returns:
        One row per run, in their order.

    Raises:
        ValueError: If there are no runs, or a number is negative.
    """
    if not runs or min(runs) < 0 or batch < 1:
        raise ValueError(f"runs must be a range of numbers that are not negative, got {runs} in batches of {batch}")
    kind = SharedBatch if plan.is_heard_at_once else PairBatch
    batch = max(min(batch, MOST_PAIRS // len(plan.scene) ** 2), 1)
    return Outcomes.joined([kind(plan, runs[k : k + batch]).fly(watch) for k in range(0, len(runs), batch)])


def is_warm(plan: Plan) -> bool:
    """Whether flying a plan needs no compiler: its solver's kernel is in memory or on disk."""
    at_once, by_pairs = _KERNELS[plan.solver]
    return is_compiled(at_once if plan.is_heard_at_once else by_pairs)


_KERNELS = {
    SolverKind.HALFPLANE: (batches.avoid_worlds, avoid_pairs),
    SolverKind.GRADED: (batches.grade_worlds, grade_pairs),
    SolverKind.ROTATION: (batches.rotate_worlds, rotate_pairs),
}


class PairBatch(Batch):
    """Worlds in which every vehicle has its own picture."""

    of_worlds = (
        *Batch.of_worlds, "reciprocal", "command", "own_track", "tracks", "sent", "arrives_s", "due_s", "turn_rad",
        "intent",
    )  # fmt: skip

    def __init__(self, plan: Plan, runs: range) -> None:
        super().__init__(plan, runs)
        shape = self.present.shape
        count = shape[1]
        self.reciprocal = (self.avoiding & self.extended).astype(np.float64)
        self.command = self.velocity.copy()
        self.response = Response(plan.dynamics, self.velocity, self.speed_mps)
        self.decider = PairDecider(plan.settings, shape, self.obstacles)
        self.reception = Reception(plan.channel, count=count, seed=plan.seed, runs=runs)
        slots = 1 + math.ceil(plan.channel.latency_s[1] / min(plan.interval_s, self.step_s) - 1e-9)
        self.sent = np.zeros((*shape, slots, tracks.REPORT_COLUMNS))
        self.arrives_s = np.full((*shape, count, slots), np.inf)
        self.tracks = np.zeros((*shape, count, tracks.TRACK_COLUMNS))
        self.tracks[..., tracks.BETWEEN] = plan.interval_s
        self.intent = np.where(self.extended[..., None], 0.0, np.nan)
        self.filter_s = TIME_CONSTANT_S if plan.filtered else 0.0
        # A vehicle that obeys at once flew the last interval at the velocity that it reports at its end.
        self.flown_s = plan.interval_s if plan.dynamics is Dynamics.IDEAL else 0.0
        self.own_track = np.zeros((*shape, tracks.TRACK_COLUMNS))
        phases = max(round(plan.interval_s / self.step_s), 1)
        drawn = np.stack([generator(plan.seed, run, Source.PHASE).integers(0, phases, count) for run in runs])
        self.due_s = drawn * self.step_s
        self.turn_rad = np.zeros(shape)
        self.to_goal_m = np.full((round(WATCH.window_s / self.step_s), *shape), np.nan)

    def advance(self, step: int, watch: Callable[[Instant], None] | None) -> None:
        """See `Batch.advance`."""
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

    def keep(self, kept: BoolArray) -> None:
        """See `Batch.keep`."""
        super().keep(kept)
        self.to_goal_m = self.to_goal_m[:, kept]
        for part in (self.response, self.decider, self.reception):
            part.keep(kept)

    def _send(self, step: int, now_s: float, reported: FloatArray) -> BoolArray:
        """Send the reports that are due, and receive those that have arrived; returns the mask of senders."""
        plan = self.plan
        due = self.present & (self.due_s <= now_s + tracks.SAME_INSTANT_S)
        self.due_s = np.where(due, self.due_s + plan.interval_s, self.due_s)
        sending: BoolArray = np.ones_like(due) if step == 0 else due
        # Drawn at every step, so that the draws of a run do not depend on the times when others of its batch report.
        lost, latency_s, luck = self.reception.next(sending)
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
                if plan.channel.depends_on_others:
                    heard = in_range & self.present[:, None, :] & ~np.eye(in_range.shape[1], dtype=np.bool_)
                    reaches &= luck < plan.channel.share(distance, plan.range_m, heard)
            arrives_s = np.where(reaches, arrives_s, np.inf)
            self.arrives_s[..., slot] = np.where(sending[:, None, :], arrives_s, self.arrives_s[..., slot])
        tracks.hear(
            self.sent, self.arrives_s, now_s, self.bound_m, self.filter_s, self.flown_s, self.tracks
        )  # fmt: skip
        return sending

    def _own_position(self, now_s: float, reported: FloatArray) -> FloatArray:
        """Own positions as the vehicles know them: as reported, or smoothed like all received positions."""
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
        # Vehicles fly to the goal by the true position, as in the paper.
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
        picture = tracks.Picture(
            self.tracks, self.present, now_s, self.reciprocal, self.still_m, self.error_sum_m, self.displaced_s
        )
        result = self.decider.decide(own, deciding, picture)
        decided = result[..., rows.R_COMMAND : rows.R_COMMAND + 2]
        self.command = np.where(deciding[..., None], decided, self.command)
        self.outcome.decisions[self.row] += deciding.sum(axis=1)
        infeasible = deciding & (result[..., rows.R_STATUS] == rows.INFEASIBLE)
        self.outcome.infeasible[self.row] += infeasible.sum(axis=1)

    def _turn(self, step: int, to_goal_m: FloatArray) -> FloatArray:
        """The extra turn of vehicles that make no progress, as in `ProgressWatch`."""
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
