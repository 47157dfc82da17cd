"""One decision: discs and velocities -> half-planes -> the velocity nearest the preferred one.

Method: ORCA half-planes (van den Berg et al., 2011), for a vehicle that does not obey at once and positions that drift.
Each neighbour gives two half-planes: one from now and one from a response time ahead. A linear response tends to "fly
on for T, then change at once", and the true path lies between the two. Discs carry a buffer: with moving errors, a disc
that is grazed is violated. Inside a disc, a barrier asks for separation in proportion to the overlap. An answer that
cannot be flown before a disc is entered is replaced by one that can, see `evasion`.

`sift` finds the neighbours that matter, `meeting` works out what they ask for, and this module decides.
Axes: north-east, metres, m/s, seconds. Inputs are rows and blocks of numbers, see `rows`. Nothing here allocates.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.contact import contact_half_planes
from ridlink.avoidance.encounter import EPSILON, LEAN_HORIZONS
from ridlink.avoidance.evasion import evade, too_soon
from ridlink.avoidance.keep_out import obstacle_half_planes
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.lanes import BLOCKS_A_WORD, lanes_from, lowest_bit
from ridlink.avoidance.meeting import meet, neighbour_half_planes
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.preference import INTERVAL_S, preferred_velocity, slowness
from ridlink.avoidance.programme import (
    EXCESS,
    exceeds,
    least_bad,
    measure,
    nearest,
    nearest_admissible,
    new_choice,
    new_lines,
    unconstrained,
)
from ridlink.avoidance.reach import REACH_SIDES, keep_within, reach_half_planes
from ridlink.avoidance.rows import (
    ACCELERATION,
    COMMAND,
    CONSTRAINED,
    CONTACT_STEP,
    EXTRA_TURN,
    FREE,
    INFEASIBLE,
    LANES,
    LIMIT,
    OVERLAPPED,
    R_BINDING,
    R_COMMAND,
    R_HARD,
    R_MARGIN,
    R_MATTERING,
    R_NEAREST,
    R_OBSTACLE,
    R_PREFERRED,
    R_SLACK,
    R_STATUS,
    R_TIME,
    R_VELOCITY,
    RESPONSE,
    RIGHT_TURN,
    SMOOTHING,
    START_TURN,
    VELOCITY,
    new_blocks,
    new_names,
)
from ridlink.avoidance.sift import FAR, sift
from ridlink.avoidance.turning import earlier_and_wider

TOUCHING_MPS = 0.05
"""A constraint whose slack is smaller than this is named as binding."""

MOST_TURN = 1.5
"""Limit of all turns together [rad]: a quarter turn or more would lead away from the goal."""


@kernel(forceinline=True, inner=True)
def name_binding(lines, hard, walls, first, last, ends, names, slack_mps, result):  # type: ignore[no-untyped-def]
    """Write what binds the velocity (touched, exceeded, or at least the tightest): obstacles, up to three neighbours.

    Args:
        lines: Half-planes, measured at that velocity.
        hard: Index of the first half-plane of an obstacle.
        walls: Index after the last one.
        first: Index of the first half-plane of a neighbour.
        last: Index after the last one.
        ends: Number of half-planes per neighbour.
        names: Places of these neighbours.
        slack_mps: Distance of the velocity to the tightest of all.
        result: Result.
    """
    excess = lines[EXCESS]
    # Without any half-plane the slack is infinite, and nothing is as near as that.
    touching = max(-(max(slack_mps, 0.0) + TOUCHING_MPS), -FAR)
    result[R_OBSTACLE] = 0.0
    for k in range(hard, walls):
        if excess[k] >= touching:
            result[R_OBSTACLE] = 1.0
    # The three that come first among the neighbours: candidates are in another order.
    one = two = three = FAR
    stride = LANES * ends
    for group in range(first, last, BLOCKS_A_WORD * stride):
        bits = shift = 0
        for block in range(group, min(group + BLOCKS_A_WORD * stride, last), stride):
            either = lanes_from(excess, block, touching) | lanes_from(excess, block + stride - LANES, touching)
            bits |= either << shift
            shift += LANES
        while bits != 0:
            named = float(names[(group - first) // ends + lowest_bit(bits)])
            bits &= bits - 1
            one, named = min(one, named), max(one, named)
            two, named = min(two, named), max(two, named)
            three = min(three, named)
    result[R_BINDING] = one if one < FAR else -1.0
    result[R_BINDING + 1] = two if two < FAR else -1.0
    result[R_BINDING + 2] = three if three < FAR else -1.0


@kernel(forceinline=True)
def avoid_one(  # type: ignore[no-untyped-def]
    own, neighbours, count, range_m, pieces, roadmap, route, settings, scratch, result
):
    """Decide for one own-ship.

    Args:
        own: Own-ship, goal and limits, shape (OWN_COLUMNS,).
        neighbours: Blocks of neighbours, shape (>= count, BLOCK); KEPT, the memory of each encounter, is updated.
        count: Number of blocks.
        range_m: Neighbours whose reports are from further away are not heard.
        pieces: Convex pieces of the obstacles, `Obstacles.pieces`.
        roadmap: Ways round them, `Roadmap`; read and written.
        route: Memory of the way round obstacles.
        settings: Constants, `HalfplaneSettings.as_vector`.
        scratch: `new_scratch`.
        result: Result, shape (RESULT_COLUMNS,).

    Returns:
        Memory of the way round obstacles for the next step.
    """
    candidates, names, lines, chosen, work = scratch
    limit = own[LIMIT]
    preferred = result[R_PREFERRED : R_PREFERRED + 2]
    pair = result[R_VELOCITY : R_VELOCITY + 2]
    route = preferred_velocity(own, pieces, roadmap, route, settings, pair, preferred)
    slow = slowness(preferred, own[VELOCITY], own[VELOCITY + 1], limit)
    # First room for firm half-planes, filled from the end, then the hard ones, then the soft ones.
    begin = hard = LANES * count
    first, near_obstacle = obstacle_half_planes(own, pieces, settings, lines, hard, pair)
    result[R_HARD] = first - hard
    walls, change = first, settings[ACCELERATION] * INTERVAL_S
    if not math.isinf(change):
        first = reach_half_planes(own, change, lines, first)
    heard, found, meetings, closest, margin = sift(
        own, neighbours, count, range_m, preferred, settings, candidates, names
    )
    result[R_MATTERING] = found
    sooner, wider, announced = earlier_and_wider(heard) if settings[RESPONSE] > 0.0 else (0.0, 0.0, 0.0)
    right, left, start, violation = meet(
        own, neighbours, candidates, found, names, meetings, preferred, LEAN_HORIZONS + sooner, announced, settings
    )
    if margin < 0.0:
        violation = 0.0
    used = neighbour_half_planes(own, candidates, found, preferred, settings, lines, first)
    overlapped = near_obstacle or margin < 0.0
    if settings[CONTACT_STEP] > 0.0 and margin < 2.0 * limit * settings[CONTACT_STEP]:
        begin = contact_half_planes(own, neighbours, count, candidates, found, settings[CONTACT_STEP], lines, hard)

    # By its speed, a vehicle that starts looks stalled; both turns together would lead away from the goal.
    start *= settings[START_TURN] * slow
    if exceeds(preferred[0], preferred[1], limit):
        speed = norm(preferred[0], preferred[1])
        preferred[0], preferred[1] = preferred[0] * limit / speed, preferred[1] * limit / speed
    extra = own[EXTRA_TURN]
    if extra != 0.0 and measure(lines, first, used, preferred[0], preferred[1]) <= EPSILON:
        # If the way is free, fly straight on: a turn that outlives its cause leads round the goal for ever.
        extra = 0.0
    turn = settings[RIGHT_TURN] * (1.0 + wider) * (right - left) + extra + max(start - max(extra, 0.0), 0.0)
    turn = min(turn, MOST_TURN)
    if turn != 0.0:
        c, s = math.cos(turn), math.sin(turn)
        preferred[0], preferred[1] = c * preferred[0] - s * preferred[1], s * preferred[0] + c * preferred[1]

    x = result[R_VELOCITY : R_VELOCITY + 2]
    feasible, worst = nearest(lines, begin, used, limit, preferred, chosen, x)
    if not feasible:
        least_bad(lines, begin, hard, first, used, limit, preferred, chosen, work, x)
    if (
        settings[RESPONSE] > 0.0
        and too_soon(own, x, violation)
        and evade(own, candidates, found, limit, lines, begin, first, x)
    ):
        feasible = False
    if keep_within(own, change, limit, x) or not feasible or walls != first:
        worst = max(measure(lines, begin, walls, x[0], x[1]), measure(lines, first, used, x[0], x[1]))
    slack = -worst
    name_binding(lines, hard, walls, first, used, 2 if settings[RESPONSE] > 0.0 else 1, names, slack, result)
    pair = work[len(work) - 1]
    pair[0], pair[1] = preferred[0], preferred[1]
    keep_within(own, change, limit, pair)
    moved = exceeds(x[0] - pair[0], x[1] - pair[1], TOUCHING_MPS)
    result[R_STATUS] = FREE
    if not feasible:
        result[R_STATUS] = INFEASIBLE
    elif overlapped:
        result[R_STATUS] = OVERLAPPED
    elif moved:
        result[R_STATUS] = CONSTRAINED
    result[R_SLACK], result[R_NEAREST] = slack, closest
    result[R_MARGIN] = margin if margin < FAR else math.inf
    result[R_TIME] = violation if violation < FAR else math.inf

    # Smooth, then keep out of obstacles again: the mean of two velocities that keep out may lead in.
    blend = settings[SMOOTHING]
    pair[0] = own[COMMAND] + blend * (x[0] - own[COMMAND])
    pair[1] = own[COMMAND + 1] + blend * (x[1] - own[COMMAND + 1])
    command = result[R_COMMAND : R_COMMAND + 2]
    if begin < first:
        nearest_admissible(lines, begin, hard, first, first, limit, pair, chosen, work, command)
    else:
        unconstrained(limit, pair, command)
    keep_within(own, change, limit, command)
    return route


def new_scratch(count: int, obstacles: Obstacles) -> tuple[np.ndarray, ...]:
    """Scratch of `avoid_one` for up to `count` neighbours.

    Returns:
        Blocks of candidates (the neighbours that matter, with their half-planes); their places among the neighbours;
        half-planes; two arrays for chosen half-planes.
    """
    blocks = new_blocks(count)
    lanes = LANES * len(blocks)
    lines = new_lines(2 * obstacles.piece_count + REACH_SIDES, 2 * lanes, lanes)
    width = lines.shape[1]
    return blocks, new_names(len(blocks)), lines, new_choice(width), new_choice(width)


def has_room(scratch: tuple[np.ndarray, ...], obstacles: Obstacles) -> bool:
    """Whether a scratch is large enough for these obstacles, at the number of neighbours it was made for."""
    blocks, _, lines, *_ = scratch
    return bool(2 * obstacles.piece_count + REACH_SIDES <= lines.shape[1] - 3 * LANES * len(blocks))
