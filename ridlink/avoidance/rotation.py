"""The paper's solver: turn the straight way to the goal until it leads into no disc.

Source: "Remote ID for separation provision and multi-agent navigation", section VI-B. Candidates are the direction to
the goal turned clockwise in equal steps, all at the same speed. The cheapest one that leads into no disc and no
obstacle is flown. Discs count without a horizon, and only while the two approach each other: without that gate,
diverging traffic constrains for ever and flights freeze. So inside a disc exactly the velocities that do not approach
are allowed.

Both questions about a heading are asked of all neighbours of a block at once, without a branch; the first block with a
neighbour in the way ends the first question. So a heading costs the same whatever the neighbours do, and most headings
are not looked at.

Axes and symbols: see `headings`. Nothing here allocates.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.encounter import EPSILON
from ridlink.avoidance.headings import (
    AWAY,
    FAR_M,
    PACE,
    REACH_S,
    SPEED,
    UNIT,
    WALL_S,
    explain_choice,
    find_way,
    see_neighbours,
    settle_choice,
)
from ridlink.avoidance.headings import KEPT as SIGHT_KEPT
from ridlink.avoidance.kernel import kernel, larger, smaller
from ridlink.avoidance.rows import (
    AGE,
    COMMAND,
    GAP,
    HEARD,
    LANES,
    N_POSITION,
    N_VELOCITY,
    POSITION,
    R_PREFERRED,
    R_VELOCITY,
    RADIUS,
    RECIPROCAL,
    REPORTED,
    VELOCITY,
)
from ridlink.avoidance.walls import see_walls, time_to_wall

# Columns of the settings vector, in the order of the fields of RotationSettings.
STEP, LEFT_WEIGHT, COST_WEIGHT, AGE_ACCELERATION, ARRIVAL, SMOOTHING = range(6)

# Columns of a block that these kernels fill in: where the neighbour is as seen from own-ship, zero if it is not heard,
# so that nothing approaches it; the own velocity at which w is zero; the radius, grown with age, and its square.
AT, APEX, KEPT, KEPT_SQUARE = GAP, GAP + 2 * LANES, GAP + 4 * LANES, GAP + 5 * LANES

CLEAR_M = 1e3
"""Excess of a heading that approaches no neighbour."""


def candidates(step_deg: float, left_weight: float) -> np.ndarray:
    """Candidates as cosine, sine, angle [rad] to the right and cost, the cheapest first, shape (360 / step, 4).

    The cost is the distance to the straight way in speeds, `|v / s - u|`, and a preference for the right: without one
    vehicles dance.
    """
    count = round(360.0 / step_deg)
    turns = np.arange(count)
    angle = np.radians(360.0 / count) * np.where(2 * turns > count, turns - count, turns)
    cost = 2.0 * np.abs(np.sin(angle / 2.0)) + left_weight * np.maximum(-angle, 0.0)
    return np.stack([np.cos(angle), np.sin(angle), angle, cost], axis=1)[np.argsort(cost, kind="stable")]


@kernel(forceinline=True)
def see_blocks(own, neighbours, count, range_m, age_acceleration_mps2):  # type: ignore[no-untyped-def]
    """Fill in the columns of every block that these kernels use; True if a neighbour's disc is entered already.

    Args:
        own: Own-ship.
        neighbours: Blocks of neighbours.
        count: Number of blocks.
        range_m: Neighbours whose reports are from further away are not heard.
        age_acceleration_mps2: Manoeuvre granted to an unheard neighbour.
    """
    p_1, p_2, reach = own[POSITION], own[POSITION + 1], range_m * range_m
    # Midpoint of the own velocity and the own command: the point from which changes are shared.
    o_1, o_2 = (own[VELOCITY] + own[COMMAND]) / 2.0, (own[VELOCITY + 1] + own[COMMAND + 1]) / 2.0
    deepest = -1.0
    for b in range(count):
        block = neighbours[b]
        for k in range(LANES):
            off_1, off_2 = block[REPORTED + k] - p_1, block[REPORTED + LANES + k] - p_2
            heard = (block[HEARD + k] != 0.0) & (off_1 * off_1 + off_2 * off_2 <= reach)
            reciprocal = block[RECIPROCAL + k] != 0.0
            r_1, r_2 = block[N_POSITION + k] - p_1, block[N_POSITION + LANES + k] - p_2
            u_1, u_2, age = block[N_VELOCITY + k], block[N_VELOCITY + LANES + k], block[AGE + k]
            radius = block[RADIUS + k] + age_acceleration_mps2 * age * age / 2.0
            deepest = larger(deepest, radius * radius - (r_1 * r_1 + r_2 * r_2) if heard else -1.0)
            block[AT + k], block[AT + LANES + k] = r_1 if heard else 0.0, r_2 if heard else 0.0
            block[APEX + k] = (o_1 + u_1) / 2.0 if reciprocal else u_1
            block[APEX + LANES + k] = (o_2 + u_2) / 2.0 if reciprocal else u_2
            block[KEPT + k], block[KEPT_SQUARE + k] = radius, radius * radius
    return deepest > 0.0


@kernel(forceinline=True)
def leads_into_a_disc(block, v_1, v_2):  # type: ignore[no-untyped-def]
    """Whether a velocity approaches a neighbour of a block and would miss it by less than its radius."""
    deepest = -1.0
    for k in range(LANES):
        r_1, r_2, w_1, w_2 = block[AT + k], block[AT + LANES + k], v_1 - block[APEX + k], v_2 - block[APEX + LANES + k]
        across = r_1 * w_2 - r_2 * w_1
        # Squares of the radius and the miss distance, times that of the relative speed.
        depth = block[KEPT_SQUARE + k] * (w_1 * w_1 + w_2 * w_2) - across * across
        deepest = larger(deepest, depth if r_1 * w_1 + r_2 * w_2 > 0.0 else -1.0)
    return deepest > 0.0


@kernel(forceinline=True)
def least_excess(block, v_1, v_2):  # type: ignore[no-untyped-def]
    """Smallest miss distance less radius [m] over the neighbours of a block that a velocity approaches."""
    least = CLEAR_M
    for k in range(LANES):
        r_1, r_2, w_1, w_2 = block[AT + k], block[AT + LANES + k], v_1 - block[APEX + k], v_2 - block[APEX + LANES + k]
        miss = abs(r_1 * w_2 - r_2 * w_1) / larger(math.sqrt(w_1 * w_1 + w_2 * w_2), EPSILON)
        least = smaller(least, miss - block[KEPT + k] if r_1 * w_1 + r_2 * w_2 > 0.0 else CLEAR_M)
    return least


@kernel(forceinline=True)
def choose_heading(  # type: ignore[no-untyped-def]
    own, neighbours, count, range_m, pieces, settings, fan, scratch, result
):
    """Decide for one own-ship, with no more than the status and the command.

    Args:
        own: Own-ship, goal and limits, shape (OWN_COLUMNS,).
        neighbours: Blocks of neighbours, shape (>= count, BLOCK).
        count: Number of blocks.
        range_m: Neighbours whose reports are from further away are not heard.
        pieces: Convex pieces of the obstacles, `Obstacles.pieces`.
        settings: Constants, `RotationSettings.as_vector`.
        fan: Candidates, see `candidates`.
        scratch: `headings.new_scratch`; what it sees of neighbours is not used here.
        result: Result, shape (RESULT_COLUMNS,): velocity, preferred velocity, command and status.

    Returns:
        True if the straight way was chosen.
    """
    _, walls, way = scratch
    find_way(own, settings[ARRIVAL], way)
    overlapped = see_blocks(own, neighbours, count, range_m, settings[AGE_ACCELERATION])
    inside_wall = see_walls(own, pieces, walls)
    u_1, u_2, speed = way[UNIT], way[UNIT + 1], way[SPEED]
    reach = way[AWAY] if way[AWAY] < FAR_M else REACH_S * way[PACE]
    result[R_PREFERRED], result[R_PREFERRED + 1] = speed * u_1, speed * u_2

    chosen, last = -1, 0
    for k in range(len(fan)):
        v_1, v_2 = speed * (fan[k, 0] * u_1 - fan[k, 1] * u_2), speed * (fan[k, 1] * u_1 + fan[k, 0] * u_2)
        # A block in the way of the last heading is likely to be in the way of the next one.
        blocked = count > 0 and leads_into_a_disc(neighbours[last], v_1, v_2)
        b = 0
        while not blocked and b < count:
            if b != last and leads_into_a_disc(neighbours[b], v_1, v_2):
                blocked, last = True, b
            b += 1
        if not blocked and time_to_wall(own, pieces, walls, v_1, v_2, reach) == math.inf:
            chosen = k
            break
    feasible = chosen >= 0
    if not feasible:
        best = -math.inf
        for k in range(len(fan)):
            v_1, v_2 = speed * (fan[k, 0] * u_1 - fan[k, 1] * u_2), speed * (fan[k, 1] * u_1 + fan[k, 0] * u_2)
            cost, score, b = settings[COST_WEIGHT] * fan[k, 3], CLEAR_M, 0
            score -= cost
            while score > best and b < count:
                score = min(score, least_excess(neighbours[b], v_1, v_2) - cost)
                b += 1
            if score > best:
                wall = time_to_wall(own, pieces, walls, v_1, v_2, reach)
                if wall < WALL_S:
                    # Obstacles stay hard: if every heading is so short, the longest of them is flown.
                    score = (wall - WALL_S - 1.0) * 1e6
            if score > best:
                chosen, best = k, score
    result[R_VELOCITY] = speed * (fan[chosen, 0] * u_1 - fan[chosen, 1] * u_2)
    result[R_VELOCITY + 1] = speed * (fan[chosen, 1] * u_1 + fan[chosen, 0] * u_2)
    settle_choice(
        own, pieces, walls, reach, feasible, overlapped or inside_wall, chosen == 0, settings[SMOOTHING],
        result,
    )  # fmt: skip
    return chosen == 0


@kernel
def rotate_one(  # type: ignore[no-untyped-def]
    own, neighbours, count, pieces, settings, fan, scratch, result
):
    """Decide for one own-ship, and explain the choice.

    Args:
        own: Own-ship, goal and limits, shape (OWN_COLUMNS,).
        neighbours: Blocks of neighbours, all of them heard, as many blocks as hold `count`.
        count: Number of neighbours.
        pieces: See `choose_heading`; so are `settings`, `fan` and `scratch`.
        settings: See `pieces`.
        fan: See `pieces`.
        scratch: See `pieces`.
        result: Result, shape (RESULT_COLUMNS,); here it is complete.
    """
    sights, walls, way = scratch
    straight = choose_heading(own, neighbours, -(-count // LANES), math.inf, pieces, settings, fan, scratch, result)
    see_neighbours(own, neighbours, count, sights, result)
    for j in range(count):
        sights[j, SIGHT_KEPT] = neighbours[j // LANES, KEPT + j % LANES]
    reach = way[AWAY] if way[AWAY] < FAR_M else REACH_S * way[PACE]
    explain_choice(own, way, sights, count, pieces, walls, reach, straight, math.inf, result)
