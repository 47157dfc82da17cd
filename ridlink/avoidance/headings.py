"""Common part of the two solvers that choose among headings: how they see neighbours and obstacles, what they report.

Such a solver flies one speed and picks its heading from a fan about the direction to the goal. Whether a heading leads
into a disc is judged by the relative velocity of the reciprocal velocity obstacle (van den Berg et al., 2008): if the
neighbour takes its half of the avoidance, own-ship may change by half as much, `w = 2 v' - v_i - v_j`; if not,
`w = v' - v_j`.

Axes: north-east, metres, m/s, seconds. In these axes a rotation by a positive angle is a turn to the right, and
`a x b = a_1 b_2 - a_2 b_1` is positive when b points to the right of a. Nothing here allocates.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.encounter import EPSILON, time_to_entry
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.preference import APPROACH_OFFSET_MPS, INTERVAL_S
from ridlink.avoidance.rows import (
    AIM,
    AIM_IS_VELOCITY,
    COMMAND,
    CONSTRAINED,
    CRUISE,
    EXTRA_TURN,
    FREE,
    INFEASIBLE,
    LANES,
    LIMIT,
    N_POSITION,
    N_VELOCITY,
    OVERLAPPED,
    POSITION,
    R_BINDING,
    R_COMMAND,
    R_MARGIN,
    R_NEAREST,
    R_OBSTACLE,
    R_SLACK,
    R_STATUS,
    R_TIME,
    R_VELOCITY,
    RADIUS,
    RECIPROCAL,
    VELOCITY,
)
from ridlink.avoidance.walls import WALL_COLUMNS, time_to_wall

# Columns of a neighbour as own-ship sees it: where it is, its velocity, FROM and TIMES in w = TIMES v' - FROM, and the
# radius that the solver keeps from it (which the solver fills in). TAIL is for the graded solver.
SEEN, SEEN_VELOCITY, FROM, TIMES, KEPT, TAIL, SIGHT_COLUMNS = (0, 2, 4, 6, 7, 8, 9)

# Columns of the way: unit vector to the goal, distance to it, speed to fly, speed wanted on the way.
UNIT, AWAY, SPEED, PACE, WAY_COLUMNS = (0, 2, 3, 4, 5)

FAR_M = 1e6
"""Distance of the goal if there is a preferred velocity instead."""

REACH_S = 10.0
"""Without a goal, obstacles within this flight time count; with one, those before it."""

WALL_S = 2.0
"""A heading that reaches an obstacle within this time is flown only if every other one does."""


@kernel
def find_way(own, arrival_mps2, way):  # type: ignore[no-untyped-def]
    """Direction, distance and speed of the straight way to the goal, turned right by the extra turn.

    Args:
        own: Own-ship.
        arrival_mps2: Deceleration that the vehicle has towards its goal; infinite for one that stops at once.
        way: Result, shape (WAY_COLUMNS,).
    """
    if own[AIM_IS_VELOCITY] != 0.0:
        to_1, to_2 = own[AIM], own[AIM + 1]
        length = norm(to_1, to_2)
        pace = min(length, own[LIMIT])
        way[AWAY], way[SPEED], way[PACE] = FAR_M, pace, pace
    else:
        to_1, to_2 = own[AIM] - own[POSITION], own[AIM + 1] - own[POSITION + 1]
        length = norm(to_1, to_2)
        pace = min(own[CRUISE], own[LIMIT])
        speed = min(pace, length / INTERVAL_S)
        if not math.isinf(arrival_mps2):
            speed = min(speed, math.sqrt(2.0 * arrival_mps2 * length) + APPROACH_OFFSET_MPS)
        way[AWAY], way[SPEED], way[PACE] = length, speed, pace
    if length < EPSILON:
        # Nowhere to go: any direction will do, and the present one is the smoothest.
        to_1, to_2 = own[VELOCITY], own[VELOCITY + 1]
        length = norm(to_1, to_2)
        if length < EPSILON:
            to_1, to_2, length = 1.0, 0.0, 1.0
    to_1, to_2 = to_1 / length, to_2 / length
    if own[EXTRA_TURN] != 0.0:
        c, s = math.cos(own[EXTRA_TURN]), math.sin(own[EXTRA_TURN])
        to_1, to_2 = c * to_1 - s * to_2, s * to_1 + c * to_2
    way[UNIT], way[UNIT + 1] = to_1, to_2


@kernel
def see_neighbours(own, neighbours, count, sights, result):  # type: ignore[no-untyped-def]
    """Fill in where the neighbours are now, and which is nearest; the solver fills in the radii to keep.

    Args:
        own: Own-ship.
        neighbours: Blocks of neighbours, all of them heard.
        count: Number of neighbours.
        sights: Result, shape (>= count, SIGHT_COLUMNS).
        result: Result: nearest neighbour, its margin, time to violation.
    """
    # Midpoint of the own velocity and the own command: the point from which changes are shared.
    o_1, o_2 = (own[VELOCITY] + own[COMMAND]) / 2.0, (own[VELOCITY + 1] + own[COMMAND + 1]) / 2.0
    margin, nearest, violation = math.inf, -1, math.inf
    for j in range(count):
        block, k, sight = neighbours[j // LANES], j % LANES, sights[j]
        u_1, u_2, radius = block[N_VELOCITY + k], block[N_VELOCITY + LANES + k], block[RADIUS + k]
        r_1, r_2 = block[N_POSITION + k] - own[POSITION], block[N_POSITION + LANES + k] - own[POSITION + 1]
        sight[SEEN], sight[SEEN + 1], sight[SEEN_VELOCITY], sight[SEEN_VELOCITY + 1] = r_1, r_2, u_1, u_2
        if block[RECIPROCAL + k] != 0.0:
            sight[FROM], sight[FROM + 1], sight[TIMES] = o_1 + u_1, o_2 + u_2, 2.0
        else:
            sight[FROM], sight[FROM + 1], sight[TIMES] = u_1, u_2, 1.0
        sight[KEPT], sight[TAIL] = radius, 0.0
        gap = norm(r_1, r_2) - radius
        if gap < margin:
            margin, nearest = gap, j
        w_1, w_2 = own[VELOCITY] - u_1, own[VELOCITY + 1] - u_2
        violation = min(violation, time_to_entry(r_1, r_2, w_1, w_2, radius, math.inf))
    result[R_MARGIN], result[R_NEAREST], result[R_TIME] = margin, nearest, violation


@kernel
def slack_to_disc(sight, v_1, v_2, horizon_s):  # type: ignore[no-untyped-def]
    """Distance [m/s] of a velocity to the velocity obstacle of a neighbour, negative inside.

    Infinite while the two do not approach, or do not come into the disc within the horizon. Inside the disc any
    approach is a violation, by its closing speed.

    Args:
        sight: The neighbour.
        v_1: North of the velocity.
        v_2: East of it.
        horizon_s: Entries later than this do not count.
    """
    r_1, r_2, radius = sight[SEEN], sight[SEEN + 1], sight[KEPT]
    w_1, w_2 = sight[TIMES] * v_1 - sight[FROM], sight[TIMES] * v_2 - sight[FROM + 1]
    towards = r_1 * w_1 + r_2 * w_2
    if towards <= 0.0:
        return math.inf
    square = r_1 * r_1 + r_2 * r_2
    if square <= radius * radius:
        return -towards / max(math.sqrt(square), EPSILON) / sight[TIMES]
    leg = math.sqrt(square - radius * radius)
    slack = (abs(r_1 * w_2 - r_2 * w_1) * leg - towards * radius) / square / sight[TIMES]
    if slack < 0.0 and time_to_entry(r_1, r_2, w_1, w_2, radius, math.inf) > horizon_s:
        return math.inf
    return slack


@kernel
def name_binding(sights, count, v_1, v_2, horizon_s, result):  # type: ignore[no-untyped-def]
    """Write the three neighbours whose velocity obstacles a velocity is deepest in, the deepest first."""
    worst_1 = worst_2 = worst_3 = 0.0
    first = second = third = -1.0
    for j in range(count):
        slack = slack_to_disc(sights[j], v_1, v_2, horizon_s)
        if slack < worst_1:
            worst_3, third, worst_2, second, worst_1, first = worst_2, second, worst_1, first, slack, j
        elif slack < worst_2:
            worst_3, third, worst_2, second = worst_2, second, slack, j
        elif slack < worst_3:
            worst_3, third = slack, j
    result[R_BINDING], result[R_BINDING + 1], result[R_BINDING + 2] = first, second, third


@kernel
def feasibility(own, sights, count, pieces, walls, reach_m, horizon_s, result):  # type: ignore[no-untyped-def]
    """Whether the velocity in the result leads into no disc and no obstacle, and whether own-ship is in a disc already.

    Arguments as in `explain_choice`.
    """
    v_1, v_2 = result[R_VELOCITY], result[R_VELOCITY + 1]
    slack = math.inf
    overlapped = False
    for j in range(count):
        sight = sights[j]
        slack = min(slack, slack_to_disc(sight, v_1, v_2, horizon_s))
        overlapped = overlapped or sight[SEEN] ** 2 + sight[SEEN + 1] ** 2 < sight[KEPT] ** 2
    blocked = time_to_wall(own, pieces, walls, v_1, v_2, reach_m) < math.inf
    return slack >= 0.0 and not blocked, overlapped


@kernel
def settle_choice(  # type: ignore[no-untyped-def]
    own, pieces, walls, reach_m, feasible, overlapped, straight, smoothing, result
):
    """Fill in the status and the command for the velocity in the result.

    Args:
        own: Own-ship.
        pieces: Convex pieces of the obstacles.
        walls: As `see_walls` left them.
        reach_m: Obstacles further than this do not count.
        feasible: True if the velocity leads into no disc and no obstacle.
        overlapped: True within a disc or the clearance of an obstacle.
        straight: True if the straight way was chosen.
        smoothing: Part of the way from the last command to the new velocity.
        result: Result, the velocity already in it.
    """
    if not feasible:
        result[R_STATUS] = INFEASIBLE
    else:
        result[R_STATUS] = OVERLAPPED if overlapped else FREE if straight else CONSTRAINED
    v_1, v_2 = result[R_VELOCITY], result[R_VELOCITY + 1]
    if smoothing == 1.0:
        result[R_COMMAND], result[R_COMMAND + 1] = v_1, v_2
        return
    c_1 = own[COMMAND] + smoothing * (v_1 - own[COMMAND])
    c_2 = own[COMMAND + 1] + smoothing * (v_2 - own[COMMAND + 1])
    # The mean of two velocities that keep out of an obstacle may lead into it.
    if time_to_wall(own, pieces, walls, c_1, c_2, reach_m) < WALL_S:
        c_1, c_2 = v_1, v_2
    speed = norm(c_1, c_2)
    if speed > own[LIMIT]:
        c_1, c_2 = c_1 * own[LIMIT] / speed, c_2 * own[LIMIT] / speed
    result[R_COMMAND], result[R_COMMAND + 1] = c_1, c_2


@kernel
def explain_choice(  # type: ignore[no-untyped-def]
    own, way, sights, count, pieces, walls, reach_m, straight, horizon_s, result
):
    """Fill in slack and what binds the velocity in the result, whose status is known.

    Args:
        own: Own-ship.
        way: The straight way.
        sights: Neighbours as seen, with the radii that the solver keeps.
        count: Number of neighbours.
        pieces: Convex pieces of the obstacles.
        walls: As `see_walls` left them.
        reach_m: Obstacles further than this do not count.
        straight: True if the straight way was chosen.
        horizon_s: Entries into discs later than this do not count.
        result: Result.
    """
    v_1, v_2 = result[R_VELOCITY], result[R_VELOCITY + 1]
    slack = math.inf
    for j in range(count):
        slack = min(slack, slack_to_disc(sights[j], v_1, v_2, horizon_s))
    s_1, s_2 = way[SPEED] * way[UNIT], way[SPEED] * way[UNIT + 1]
    blocked = time_to_wall(own, pieces, walls, v_1, v_2, reach_m) < math.inf
    in_the_way = not straight and time_to_wall(own, pieces, walls, s_1, s_2, reach_m) < math.inf
    result[R_OBSTACLE] = 1.0 if blocked or in_the_way else 0.0
    if result[R_STATUS] == INFEASIBLE:
        name_binding(sights, count, v_1, v_2, horizon_s, result)
    else:
        slack = max(slack, 0.0)  # but for rounding it is
        name_binding(sights, count, s_1, s_2, horizon_s, result)
    result[R_SLACK] = slack


def new_scratch(count: int, obstacles: Obstacles) -> tuple[np.ndarray, ...]:
    """Scratch of the two solvers for up to `count` neighbours: neighbours and walls as seen, the straight way."""
    return (
        np.zeros((count, SIGHT_COLUMNS)),
        np.zeros((obstacles.piece_count, WALL_COLUMNS)),
        np.zeros(WAY_COLUMNS),
    )


def has_room(scratch: tuple[np.ndarray, ...], obstacles: Obstacles) -> bool:
    """Whether a scratch is large enough for these obstacles, at the number of neighbours it was made for."""
    return obstacles.piece_count <= len(scratch[1])
