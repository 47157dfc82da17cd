"""A solver that keeps its speed: the heading of least time and risk from a fan at full speed.

Every neighbour is a risk that fades with its distance from the pass and with the time until it, instead of a disc that
is entered or not. The risks of all neighbours add up, which is a union bound. All vehicles lean to the right, but only
while the straight way is in conflict. Nothing is forbidden except obstacles, so there is no fallback. No probability is
promised either: the constants were measured and not derived (see `GradedSettings`).

The caller should filter positions: the jitter of white position errors costs time and buys nothing.

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
    SEEN_VELOCITY,
    SPEED,
    TAIL,
    TIMES,
    UNIT,
    WALL_S,
    explain_choice,
    feasibility,
    find_way,
    see_neighbours,
    settle_choice,
)
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.rows import (
    AGE,
    ERROR_SUM,
    LANES,
    R_PREFERRED,
    R_VELOCITY,
    RADIUS,
    VELOCITY,
)
from ridlink.avoidance.walls import see_walls, time_to_wall

# Columns of the settings vector, in the order of the fields of GradedSettings.
(
    BASE, TAIL_SHARE, CROWD, CROWD_FROM, LEAST_RADIUS, RISK_WEIGHT, FADE, WRONG_SIDE, LEAN, LEAN_WITHIN, LEAN_RADII,
    LEFT_WEIGHT, SMOOTHNESS, LOOK_AHEAD, RESPONSE, AGE_ACCELERATION, ARRIVAL, SMOOTHING,
) = range(18)  # fmt: skip

RIGHT_DEG = (*range(0, 75, 5), 85, 100, 120, 140, 160, 180)
LEFT_DEG = (5, 10, 15, 20, 25, 30, 40, 50, 60, 75, 90, 110, 135)

CROWD_OF = 7.0
"""The radius is right for this many neighbours, and grows with the logarithm of their number."""

LEAST_TAIL_M = 1.0
"""Least tail: exact positions do not make a risk a step, for vehicles are not exact."""

TAIL_END = 4.0
"""Passes further outside than this many tails are no risk: there it is below 0.04 % of its value at the radius."""

TRACE = 1e-12
"""A risk above this is a risk."""

HIT_COST, WALL_COST = 1e3, 1e6
"""Cost of a heading that reaches an obstacle before the goal, and of one that does so at once; no risk is near
either."""

DODGE_SHARE = 0.5
"""A vehicle at its goal, or nearly, dodges at this share of its cruise speed."""


def candidates() -> np.ndarray:
    """Candidates as cosine, sine and angle [rad] to the right, the straight way first, shape (34, 3)."""
    degrees = [*RIGHT_DEG, *(-turn for turn in LEFT_DEG)]
    angle = np.radians(sorted(degrees, key=lambda turn: (abs(turn), -turn)))
    return np.stack([np.cos(angle), np.sin(angle), angle], axis=1)


@kernel
def fill_radii(neighbours, count, settings, sights):  # type: ignore[no-untyped-def]
    """Fill in radius and tail of every neighbour: airframes and displacement in full, a share of the errors."""
    crowd = settings[CROWD] * math.log(max(count, settings[CROWD_FROM], 1.0) / CROWD_OF)
    for j in range(count):
        block, k = neighbours[j // LANES], j % LANES
        errors, disc, age = block[ERROR_SUM + k], block[RADIUS + k], block[AGE + k]
        radius = disc - errors + (settings[BASE] + crowd) * errors
        radius = max(radius, min(settings[LEAST_RADIUS], disc))
        sights[j, KEPT] = radius + settings[AGE_ACCELERATION] * age * age / 2.0
        sights[j, TAIL] = max(settings[TAIL_SHARE] * errors, LEAST_TAIL_M)


@kernel
def in_conflict(sights, count, s_1, s_2, settings):  # type: ignore[no-untyped-def]
    """Whether the straight way passes a neighbour, if that flies on, closely and soon."""
    for j in range(count):
        sight = sights[j]
        w_1, w_2 = s_1 - sight[SEEN_VELOCITY], s_2 - sight[SEEN_VELOCITY + 1]
        towards = sight[SEEN] * w_1 + sight[SEEN + 1] * w_2
        square = w_1 * w_1 + w_2 * w_2
        if towards > 0.0 and towards < settings[LEAN_WITHIN] * square:
            across = sight[SEEN] * w_2 - sight[SEEN + 1] * w_1
            near = settings[LEAN_RADII] * sight[KEPT]
            if across * across < near * near * square:
                return True
    return False


@kernel
def risk_of_pass(r_1, r_2, w_1, w_2, radius_m, tail_m, settings):  # type: ignore[no-untyped-def]
    """Risk of one neighbour at relative velocity w (own less neighbour's); 1 at its radius now, 0 if it falls behind.

    Args:
        r_1: North of the neighbour as seen from own-ship.
        r_2: East of it.
        w_1: North of the relative velocity.
        w_2: East of it.
        radius_m: Radius.
        tail_m: Scale in which the risk falls off outside and grows inside.
        settings: Constants.
    """
    towards = r_1 * w_1 + r_2 * w_2
    if towards <= 0.0:
        return 0.0
    square = w_1 * w_1 + w_2 * w_2
    across = r_1 * w_2 - r_2 * w_1
    end = radius_m + TAIL_END * tail_m
    if across * across > end * end * square:
        return 0.0
    closing = math.sqrt(square)
    if closing < EPSILON:
        return 0.0
    entry = max(towards / square - radius_m / closing, 0.0)
    off = (abs(across) / closing - radius_m) / tail_m
    if off > 0.0:
        risk = math.exp(-entry / settings[FADE] - off * off / 2.0)
    else:
        risk = math.exp(-entry / settings[FADE]) * (1.0 - off)
    # Left of its bearing, the neighbour would stay on our right, the side to which it leans itself.
    return settings[WRONG_SIDE] * risk if across < 0.0 else risk


@kernel
def risk_of_heading(own, sights, count, v_1, v_2, settings, most):  # type: ignore[no-untyped-def]
    """Sum of the risks of all neighbours at a velocity; the sum ends once it is beyond `most`.

    For a vehicle that obeys late, a neighbour's risk is the larger one of now and of a response time ahead, with the
    present velocities until then.
    """
    wait = settings[RESPONSE]
    total = 0.0
    for j in range(count):
        sight = sights[j]
        w_1, w_2 = sight[TIMES] * v_1 - sight[FROM], sight[TIMES] * v_2 - sight[FROM + 1]
        risk = risk_of_pass(sight[SEEN], sight[SEEN + 1], w_1, w_2, sight[KEPT], sight[TAIL], settings)
        if wait > 0.0:
            later_1 = sight[SEEN] + (sight[SEEN_VELOCITY] - own[VELOCITY]) * wait
            later_2 = sight[SEEN + 1] + (sight[SEEN_VELOCITY + 1] - own[VELOCITY + 1]) * wait
            risk = max(risk, risk_of_pass(later_1, later_2, w_1, w_2, sight[KEPT], sight[TAIL], settings))
        total += risk
        if total >= most:
            break
    return total


@kernel
def is_free(own, sights, count, pieces, walls, way, reach_m, settings):  # type: ignore[no-untyped-def]
    """Whether the straight way bears no risk at all and meets no obstacle before the goal."""
    s_1, s_2 = way[SPEED] * way[UNIT], way[SPEED] * way[UNIT + 1]
    if risk_of_heading(own, sights, count, s_1, s_2, settings, TRACE) > 0.0:
        return False
    return time_to_wall(own, pieces, walls, s_1, s_2, reach_m) == math.inf


@kernel
def grade_one(  # type: ignore[no-untyped-def]
    own, neighbours, count, pieces, settings, fan, scratch, result
):
    """Decide for one own-ship.

    Args:
        own: Own-ship, goal and limits, shape (OWN_COLUMNS,).
        neighbours: Blocks of neighbours, all of them heard, as many blocks as hold `count`.
        count: Number of neighbours.
        pieces: Convex pieces of the obstacles, `Obstacles.pieces`.
        settings: Constants, `GradedSettings.as_vector`.
        fan: Candidates, see `candidates`.
        scratch: `headings.new_scratch`.
        result: Result, shape (RESULT_COLUMNS,).
    """
    sights, walls, way = scratch
    find_way(own, settings[ARRIVAL], way)
    see_neighbours(own, neighbours, count, sights, result)
    fill_radii(neighbours, count, settings, sights)
    inside_wall = see_walls(own, pieces, walls)
    u_1, u_2, away = way[UNIT], way[UNIT + 1], way[AWAY]
    reach = away if away < FAR_M else REACH_S * way[PACE]
    pace = max(way[PACE], EPSILON)
    conflict = in_conflict(sights, count, way[SPEED] * u_1, way[SPEED] * u_2, settings)
    lean = settings[LEAN] if conflict else 0.0
    c, s = math.cos(lean), math.sin(lean)
    result[R_PREFERRED] = way[SPEED] * (c * u_1 - s * u_2)
    result[R_PREFERRED + 1] = way[SPEED] * (s * u_1 + c * u_2)

    ahead = max(min(settings[LOOK_AHEAD], 0.9 * away / pace), 0.1)
    best, chosen = math.inf, 0
    speeds = 2 if conflict and way[SPEED] < DODGE_SHARE * way[PACE] else 1
    if not conflict and is_free(own, sights, count, pieces, walls, way, reach, settings):
        # Smoothness is no reason to leave the straight way.
        speeds = 0
    for level in range(speeds):
        speed = way[SPEED] if level == 0 else DODGE_SHARE * way[PACE]
        step = speed * ahead
        for k in range(len(fan)):
            v_1, v_2 = speed * (fan[k, 0] * u_1 - fan[k, 1] * u_2), speed * (fan[k, 1] * u_1 + fan[k, 0] * u_2)
            # Angle to the left of the direction that all vehicles lean to.
            left = lean - fan[k, 2]
            along = step * (c * fan[k, 0] + s * fan[k, 1])
            left_over = math.sqrt(max(away * away - 2.0 * away * along + step * step, 0.0))
            cost = (left_over - away) / (pace * ahead) + settings[LEFT_WEIGHT] * max(left, 0.0)
            cost += settings[SMOOTHNESS] * norm(v_1 - own[VELOCITY], v_2 - own[VELOCITY + 1]) / pace
            if cost >= best:
                continue
            most = (best - cost) / settings[RISK_WEIGHT]
            cost += settings[RISK_WEIGHT] * risk_of_heading(own, sights, count, v_1, v_2, settings, most)
            if cost >= best:
                continue
            wall = time_to_wall(own, pieces, walls, v_1, v_2, reach)
            if wall < WALL_S:
                # If every heading is so short, the longest of them is flown.
                cost += WALL_COST * (2.0 - wall / WALL_S)
            elif wall < math.inf:
                cost += HIT_COST
            if cost < best:
                best, chosen = cost, level * len(fan) + k
    speed = way[SPEED] if chosen < len(fan) else DODGE_SHARE * way[PACE]
    k = chosen % len(fan)
    result[R_VELOCITY] = speed * (fan[k, 0] * u_1 - fan[k, 1] * u_2)
    result[R_VELOCITY + 1] = speed * (fan[k, 1] * u_1 + fan[k, 0] * u_2)
    horizon = settings[LEAN_WITHIN]
    feasible, overlapped = feasibility(own, sights, count, pieces, walls, reach, horizon, result)
    settle_choice(
        own, pieces, walls, reach, feasible, overlapped or inside_wall, chosen == 0, settings[SMOOTHING],
        result,
    )  # fmt: skip
    explain_choice(own, way, sights, count, pieces, walls, reach, chosen == 0, horizon, result)
