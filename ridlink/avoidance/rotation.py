"""The paper's solver: turn the straight way to the goal until it leads into no disc.

Source: "Remote ID for separation provision and multi-agent navigation", section VI-B. Candidates are the direction to
the goal turned clockwise in equal steps, all at the same speed; the cheapest one that leads into no disc and no
obstacle is flown. Discs count without a horizon, and only while the two approach each other: without that gate
diverging traffic constrains for ever and flights freeze. So inside a disc exactly the velocities that do not approach
are allowed.

Axes and symbols: see `headings`. Nothing here allocates.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.encounter import EPSILON
from ridlink.avoidance.headings import (
    AWAY,
    FAR_M,
    FROM,
    KEPT,
    PACE,
    REACH_S,
    SEEN,
    SPEED,
    TIMES,
    UNIT,
    WALL_S,
    find_way,
    report_choice,
    see_neighbours,
    see_walls,
    time_to_wall,
)
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.rows import R_PREFERRED, R_VELOCITY

# Columns of the settings vector, in the order of the fields of RotationSettings.
STEP, LEFT_WEIGHT, COST_WEIGHT, ARRIVAL, SMOOTHING = range(5)

CLEAR_M = 1e3
"""Excess of a heading that approaches nobody."""


def candidates(step_deg: float, left_weight: float) -> np.ndarray:
    """Candidates as cosine, sine, angle [rad] to the right and cost, the cheapest first, shape (360 / step, 4).

    The cost is the distance to the straight way in speeds, `|v / s - u|`, and a preference for the right: vehicles
    without one dance.
    """
    count = round(360.0 / step_deg)
    turns = np.arange(count)
    angle = np.radians(360.0 / count) * np.where(2 * turns > count, turns - count, turns)
    cost = 2.0 * np.abs(np.sin(angle / 2.0)) + left_weight * np.maximum(-angle, 0.0)
    return np.stack([np.cos(angle), np.sin(angle), angle, cost], axis=1)[np.argsort(cost, kind="stable")]


@kernel
def least_excess(sights, count, v_1, v_2):  # type: ignore[no-untyped-def]
    """Smallest miss distance less radius [m] over the neighbours that a velocity approaches."""
    least = CLEAR_M
    for j in range(count):
        sight = sights[j]
        w_1, w_2 = sight[TIMES] * v_1 - sight[FROM], sight[TIMES] * v_2 - sight[FROM + 1]
        if sight[SEEN] * w_1 + sight[SEEN + 1] * w_2 > 0.0:
            miss = abs(sight[SEEN] * w_2 - sight[SEEN + 1] * w_1) / max(norm(w_1, w_2), EPSILON)
            least = min(least, miss - sight[KEPT])
    return least


@kernel
def leads_into_a_disc(sights, count, v_1, v_2):  # type: ignore[no-untyped-def]
    """Whether a velocity approaches a neighbour and would miss it by less than its radius."""
    for j in range(count):
        sight = sights[j]
        w_1, w_2 = sight[TIMES] * v_1 - sight[FROM], sight[TIMES] * v_2 - sight[FROM + 1]
        if sight[SEEN] * w_1 + sight[SEEN + 1] * w_2 > 0.0:
            across = sight[SEEN] * w_2 - sight[SEEN + 1] * w_1
            if across * across < sight[KEPT] * sight[KEPT] * (w_1 * w_1 + w_2 * w_2):
                return True
    return False


@kernel
def rotate_one(  # type: ignore[no-untyped-def]
    own, neighbours, count, pieces, piece_start, settings, fan, sights, walls, way, result
):
    """Decide for one own-ship.

    Args:
        own: Own-ship, goal and limits, shape (OWN_COLUMNS,).
        neighbours: Blocks of neighbours, all of them heard, as many blocks as hold `count`.
        count: Number of neighbours.
        pieces: Vertices of the convex pieces of all obstacles, shape (m, 2).
        piece_start: Where each piece begins in it, with the end.
        settings: Constants, `RotationSettings.as_vector`.
        fan: Candidates, see `candidates`.
        sights: Scratch, shape (>= count, SIGHT_COLUMNS).
        walls: Scratch, shape (>= pieces, WALL_COLUMNS).
        way: Scratch, shape (WAY_COLUMNS,).
        result: Result, shape (RESULT_COLUMNS,).
    """
    find_way(own, settings[ARRIVAL], way)
    see_neighbours(own, neighbours, count, sights, result)
    inside_wall = see_walls(own, pieces, piece_start, walls)
    u_1, u_2, speed = way[UNIT], way[UNIT + 1], way[SPEED]
    reach = way[AWAY] if way[AWAY] < FAR_M else REACH_S * way[PACE]
    result[R_PREFERRED], result[R_PREFERRED + 1] = speed * u_1, speed * u_2

    chosen = -1
    for k in range(len(fan)):
        v_1, v_2 = speed * (fan[k, 0] * u_1 - fan[k, 1] * u_2), speed * (fan[k, 1] * u_1 + fan[k, 0] * u_2)
        if not leads_into_a_disc(sights, count, v_1, v_2) and (
            time_to_wall(own, pieces, piece_start, walls, v_1, v_2, reach) == math.inf
        ):
            chosen = k
            break
    if chosen < 0:
        best = -math.inf
        for k in range(len(fan)):
            v_1, v_2 = speed * (fan[k, 0] * u_1 - fan[k, 1] * u_2), speed * (fan[k, 1] * u_1 + fan[k, 0] * u_2)
            score = least_excess(sights, count, v_1, v_2) - settings[COST_WEIGHT] * fan[k, 3]
            wall = time_to_wall(own, pieces, piece_start, walls, v_1, v_2, reach)
            if wall < WALL_S:
                # Obstacles stay hard: only where every heading is so short, the longest of them.
                score = (wall - WALL_S - 1.0) * 1e6
            if score > best:
                chosen, best = k, score
    result[R_VELOCITY] = speed * (fan[chosen, 0] * u_1 - fan[chosen, 1] * u_2)
    result[R_VELOCITY + 1] = speed * (fan[chosen, 1] * u_1 + fan[chosen, 0] * u_2)
    report_choice(
        own, way, sights, count, pieces, piece_start, walls, inside_wall, reach, chosen == 0, math.inf,
        settings[SMOOTHING], result,
    )  # fmt: skip
