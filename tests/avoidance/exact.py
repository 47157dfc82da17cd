"""Worlds without any error: vehicles that obey at once and know everything, judged along the whole of every step.

What a solver promises, it must keep here to the centimetre. Discs are given as the distance that two centres keep.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ridlink.avoidance import Obstacles, ProgressWatch, rows
from ridlink.avoidance.priority import give_way_in_worlds, new_turns
from ridlink.campaign.deciding import new_decider
from ridlink.campaign.plan import IDEAL_HALFPLANES

EVERYWHERE_M = 1e9


@dataclass(frozen=True)
class Flown:
    """What happened to N vehicles.

    Attributes:
        time_s: Arrival times, infinite for those that never arrived, shape (N,).
        straight_s: The same on the straight line without traffic, shape (N,).
        least_m: Smallest distance of two centres, between the steps too.
        came_closer_m: Most that a pair closed in one step while its disc was violated.
        path_ne_m: Positions at every step, NaN once arrived, shape (T, N, 2).
        infeasible_share: Share of decisions without an admissible velocity.
    """

    time_s: np.ndarray
    straight_s: np.ndarray
    least_m: float
    came_closer_m: float
    path_ne_m: np.ndarray
    infeasible_share: float

    @property
    def last(self) -> float:
        """Last arrival relative to the straight line."""
        return float((self.time_s / self.straight_s).max())


def on_circle(count: int, radius_m: float) -> np.ndarray:
    """Starts on a circle, shape (count, 2); the goals are opposite."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def fly(
    start, goal, disc_m, speed_mps, *, duration_s=200.0, step_s=0.1, cooperative=None, polygons=(),
    range_m=EVERYWHERE_M, arrived_m=1.0, settings=IDEAL_HALFPLANES,
) -> Flown:  # fmt: skip
    """Fly one world; vehicles that arrive leave it, and who does not cooperate flies straight on."""
    position, goal = np.array(start, float), np.array(goal, float)
    count = len(position)
    speed = np.broadcast_to(np.asarray(speed_mps, float), (count,))
    avoids = np.ones(count, bool) if cooperative is None else np.asarray(cooperative)
    obstacles = Obstacles.from_polygons(polygons)
    decider = new_decider(settings, (1, count), obstacles)
    away = goal - position
    straight = np.linalg.norm(away, axis=1) / speed
    velocity = away / straight[:, None]
    own, heard = np.zeros((1, count, rows.OWN_COLUMNS)), np.zeros((1, count, 8))
    radius, error = np.full((1, count, count), float(disc_m)), np.zeros((1, count, count))
    present, time_s = np.ones((1, count), bool), np.full(count, np.inf)
    watches = [ProgressWatch() for _ in range(count)]
    turns, scratch = new_turns(1, count), (np.zeros((count, 10)), np.zeros(count, np.int64))
    own[0, :, rows.LIMIT] = own[0, :, rows.CRUISE] = speed
    own[0, :, rows.CLEARANCE] = disc_m / 2.0
    heard[0, :, 7] = avoids
    least, closer, infeasible, decisions = np.inf, 0.0, 0, 0
    path = [position.copy()]
    for step in range(round(duration_s / step_s)):
        own[0, :, 0:2], own[0, :, 2:4], own[0, :, 4:6], own[0, :, 6:8] = position, velocity, velocity, goal
        own[0, :, rows.EXTRA_TURN] = [watch.extra_right_turn_rad for watch in watches]
        heard[0, :, 0:2], heard[0, :, 2:4], heard[0, :, 4:6] = position, velocity, velocity
        deciding = present & avoids
        give_way_in_worlds(
            own, deciding, heard, present, radius, range_m, step * step_s, turns, *scratch
        )  # fmt: skip
        result = decider.decide(own, deciding, heard, present, radius, error, range_m)[0]
        infeasible += int((deciding[0] & (result[:, rows.R_STATUS] == rows.INFEASIBLE)).sum())
        decisions += int(deciding.sum())
        told = result[:, rows.R_COMMAND : rows.R_COMMAND + 2]
        velocity = np.where(deciding[0][:, None], told, np.where(present[0][:, None], velocity, 0.0))
        here = np.nonzero(present[0])[0]
        if len(here) > 1:
            apart = position[here][:, None] - position[here]
            change = (velocity[here][:, None] - velocity[here]) * step_s
            along = -(apart * change).sum(-1) / np.maximum((change**2).sum(-1), 1e-12)
            nearest = np.linalg.norm(apart + np.clip(along, 0.0, 1.0)[..., None] * change, axis=-1)
            before, after = np.linalg.norm(apart, axis=-1), np.linalg.norm(apart + change, axis=-1)
            others = ~np.eye(len(here), dtype=bool)
            least = min(least, float(nearest[others].min()))
            closer = max(closer, float(np.where(others & (before < disc_m), before - after, 0.0).max()))
        position = position + velocity * step_s
        left = np.linalg.norm(goal - position, axis=1)
        for watch, distance, cruise in zip(watches, left, speed, strict=True):
            watch.update(step * step_s, float(distance), float(cruise))
        arrived = present[0] & (left < arrived_m)
        time_s = np.where(arrived, (step + 1) * step_s, time_s)
        present[0] &= ~arrived
        path.append(np.where(present[0][:, None], position, np.nan))
        if not (present[0] & avoids).any():
            break
    return Flown(time_s, straight, least, closer, np.array(path), infeasible / max(decisions, 1))
