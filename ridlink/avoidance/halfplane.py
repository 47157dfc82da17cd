"""One decision: discs and velocities -> half-planes -> the velocity nearest the preferred one.

Method: ORCA half-planes (van den Berg et al., 2011) for a vehicle that does not obey at once and positions that drift.
Each neighbour gives two half-planes, one from now and one from a response time ahead: "fly on for T, then change at
once" is what a linear response tends to, and the true path lies between the two. Discs carry a buffer, because a disc
that is grazed with moving errors is violated; inside the disc a barrier asks for separation in proportion to the
overlap.

Which neighbours matter is told in `sift`, what they ask for is worked out in `meeting`, and the decision is made here.
Axes: north-east, metres, m/s, seconds. Inputs are rows and blocks of numbers, see `rows`. Nothing here allocates.
"""

from __future__ import annotations

import math

from ridlink.avoidance.contact import contact_half_planes
from ridlink.avoidance.encounter import EPSILON, LEAN_HORIZONS
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.lanes import BLOCKS_A_WORD, lanes_from, lowest_bit
from ridlink.avoidance.meeting import meet, neighbour_half_planes
from ridlink.avoidance.programme import (
    BOUND,
    EXCESS,
    N_1,
    N_2,
    exceeds,
    least_bad,
    measure,
    nearest,
    nearest_admissible,
    unconstrained,
)
from ridlink.avoidance.reach import REACH_SIDES as REACH_SIDES
from ridlink.avoidance.reach import keep_within, reach_half_planes
from ridlink.avoidance.route import approach_speed, nearest_point, route_aim
from ridlink.avoidance.rows import (
    ACCELERATION,
    AIM,
    AIM_IS_VELOCITY,
    ARRIVAL,
    BARRIER,
    BARRIER_SHARE,
    BUFFER_SHARE,
    CLEARANCE,
    COMMAND,
    CONSTRAINED,
    CONTACT_STEP,
    CRUISE,
    EXTRA_TURN,
    FREE,
    INFEASIBLE,
    LANES,
    LIMIT,
    OBSTACLE_DECELERATION,
    OBSTACLE_HORIZON,
    OBSTACLE_RESPONSE,
    OVERLAPPED,
    POSITION,
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
    ROUTE_MARGIN,
    SMOOTHING,
    START_TURN,
    VELOCITY,
)
from ridlink.avoidance.rows import OWN_COLUMNS as OWN_COLUMNS
from ridlink.avoidance.rows import RESULT_COLUMNS as RESULT_COLUMNS
from ridlink.avoidance.sift import FAR, sift
from ridlink.avoidance.turning import earlier_and_wider

TOUCHING_MPS = 0.05
"""A constraint whose slack is smaller than this is named as binding."""

APPROACH_OFFSET_MPS = 0.3
"""Keeps the last metre to a goal from taking for ever."""

INTERVAL_S = 0.1
"""Time between decisions; a goal nearer than one step of cruise is flown to in one step."""

STRAIGHT_M, STRAIGHT_SHARE = 3.0, 0.25
"""A slow vehicle whose course leads past its goal at this distance, or this share of the way to it if that is less,
flies straight on: its own position drifts by as much while it turns, and to turn after every drift is to weave."""

AMENDED = 3.0
"""Where its velocity leads past the goal at so many times that distance, the command leads to the goal itself."""

MOST_TURN = 1.5
"""All turns together [rad]: a quarter turn and more would lead away from the goal."""


@kernel(forceinline=True, inner=True)
def slowness(preferred, v_1, v_2, limit):  # type: ignore[no-untyped-def]
    """How far own-ship is from the speed it wants, 0 at that speed and 1 at rest."""
    wanted = min(norm(preferred[0], preferred[1]), limit)
    return max(1.0 - norm(v_1, v_2) / max(wanted, EPSILON), 0.0)


@kernel(forceinline=True, inner=True)
def buffered_clearance(own, settings):  # type: ignore[no-untyped-def]
    """Distance [m] aimed at from obstacles. As with discs, a clearance that is grazed with a drifting position is
    lost."""
    return own[CLEARANCE] * (1.0 + settings[BUFFER_SHARE])


@kernel(forceinline=True, inner=True)
def steadied(c_1, c_2, v_1, v_2, to_1, to_2, to_goal_m):  # type: ignore[no-untyped-def]
    """The way to a goal, turned away from the course commanded no further than that has to be left.

    A vehicle that comes back from a detour still flies outwards of what it is told, PX4 for seconds: the further its
    velocity leads past the goal, the nearer to it the command must lead.

    Args:
        c_1: North of the velocity commanded.
        c_2: East of it.
        v_1: North of the velocity flown.
        v_2: East of it.
        to_1: North of the goal as seen from own-ship.
        to_2: East of it.
        to_goal_m: How far it is.
    """
    square = c_1 * c_1 + c_2 * c_2
    if c_1 * to_1 + c_2 * to_2 <= 0.0 or square < EPSILON:
        return to_1, to_2
    once_per_speed = 1.0 / math.sqrt(square)
    most = min(STRAIGHT_M, STRAIGHT_SHARE * to_goal_m)
    # A root and a division only where it is not nearly straight.
    across, flown_square, near = v_1 * to_2 - v_2 * to_1, v_1 * v_1 + v_2 * v_2, (AMENDED - 1.0) * most
    if across * across > near * near * flown_square:
        flown_past = abs(across) / max(math.sqrt(flown_square), EPSILON)
        most = min(max(AMENDED * most - flown_past, 0.0), most)
    past = min(max((c_1 * to_2 - c_2 * to_1) * once_per_speed, -most), most) * once_per_speed
    return to_1 + past * c_2, to_2 - past * c_1


@kernel(forceinline=True, inner=True)
def preferred_velocity(own, vertex, start, memory, settings, ring, aim, preferred):  # type: ignore[no-untyped-def]
    """Velocity without traffic: to the goal, round obstacles, slower towards the end. Returns the route memory."""
    if own[AIM_IS_VELOCITY] != 0.0:
        preferred[0], preferred[1] = own[AIM], own[AIM + 1]
        return 0
    p_1, p_2 = own[POSITION], own[POSITION + 1]
    to_1, to_2, route = own[AIM] - p_1, own[AIM + 1] - p_2, 0
    to_goal = length = norm(to_1, to_2)
    if len(start) > 1:
        clearance = buffered_clearance(own, settings) + settings[ROUTE_MARGIN]
        route = route_aim(vertex, start, p_1, p_2, own[AIM], own[AIM + 1], clearance, memory, ring, aim)
        to_1, to_2 = aim[0] - p_1, aim[1] - p_2
        length = norm(to_1, to_2)
    slow = not math.isinf(settings[ARRIVAL])
    if slow and route == 0:
        to_1, to_2 = steadied(
            own[COMMAND], own[COMMAND + 1], own[VELOCITY], own[VELOCITY + 1], to_1, to_2, length
        )  # fmt: skip
        length = norm(to_1, to_2)
    preferred[0] = preferred[1] = 0.0
    if to_goal < EPSILON or length < EPSILON:
        return route
    speed = min(own[CRUISE], to_goal / INTERVAL_S)
    if slow:
        speed = min(speed, math.sqrt(2.0 * settings[ARRIVAL] * to_goal) + APPROACH_OFFSET_MPS)
    preferred[0], preferred[1] = speed * to_1 / length, speed * to_2 / length
    return route


@kernel(forceinline=True, inner=True)
def obstacle_half_planes(own, vertex, start, settings, lines, hard, normal):  # type: ignore[no-untyped-def]
    """One hard half-plane for each convex piece that could matter, from column `hard` of `lines` on, and some that
    forbid nothing up to a multiple of LANES; returns the column after those, and True while too near an obstacle."""
    used = hard
    inside = False
    limit = own[LIMIT]
    for piece in range(len(start) - 1):
        distance = nearest_point(vertex, start[piece], start[piece + 1], own[POSITION], own[POSITION + 1], normal)
        inside = inside or distance < own[CLEARANCE]
        gap = distance - buffered_clearance(own, settings)
        # What is left of the gap when the vehicle begins to obey; moving away earns nothing in advance.
        gap += min(settings[RESPONSE] * (normal[0] * own[VELOCITY] + normal[1] * own[VELOCITY + 1]), 0.0)
        if gap >= 0.0:
            approach = approach_speed(
                gap, settings[OBSTACLE_HORIZON], settings[OBSTACLE_DECELERATION], settings[OBSTACLE_RESPONSE]
            )
            if approach >= limit:
                continue
            bound = -approach
        else:
            bound = min(-gap * settings[BARRIER], settings[BARRIER_SHARE] * limit)
        lines[N_1, used], lines[N_2, used], lines[BOUND, used] = normal[0], normal[1], bound
        used += 1
    for k in range(used, -(-used // LANES) * LANES):
        lines[N_1, k], lines[N_2, k], lines[BOUND, k] = 0.0, 0.0, -math.inf
    return -(-used // LANES) * LANES, inside


@kernel(forceinline=True, inner=True)
def name_binding(lines, hard, walls, first, last, ends, names, slack_mps, result):  # type: ignore[no-untyped-def]
    """Write what the velocity touches or exceeds, at least what it is nearest to: obstacles, three neighbours.

    Args:
        lines: Half-planes, measured at that velocity.
        hard: Index of the first one of an obstacle.
        walls: Index after the last one.
        first: Index of the first one of a neighbour.
        last: Index after the last one.
        ends: Half-planes for each neighbour.
        names: Places of these neighbours.
        slack_mps: Distance of the velocity to the tightest of all.
        result: Result.
    """
    excess = lines[EXCESS]
    # Of no half-plane the slack is infinite, and nothing is as near as that.
    touching = max(-(max(slack_mps, 0.0) + TOUCHING_MPS), -FAR)
    result[R_OBSTACLE] = 0.0
    for k in range(hard, walls):
        if excess[k] >= touching:
            result[R_OBSTACLE] = 1.0
    # The first three of them as they came: candidates are in another order.
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
    own, neighbours, count, range_m, pieces, piece_start, hulls, hull_start, route, settings, candidates, names, lines,
    chosen, work, ring, result,
):  # fmt: skip
    """Decide for one own-ship.

    Args:
        own: Own-ship, goal and limits, shape (OWN_COLUMNS,).
        neighbours: Blocks of neighbours, shape (>= count, BLOCK); what is kept of each encounter is read and written.
        count: Number of blocks.
        range_m: Neighbours whose reports are from further away are not heard.
        pieces: Vertices of the convex pieces of all obstacles, shape (m, 2).
        piece_start: Where each piece begins in it, with the end.
        hulls: Vertices of the hulls of all obstacles, shape (h, 2).
        hull_start: Where each hull begins in it, with the end.
        route: Memory of the way round obstacles.
        settings: Constants, `HalfplaneSettings.as_vector`.
        candidates: Scratch, shape of `neighbours`; in it remain those that matter, with their half-planes.
        names: Scratch: their places among the neighbours, `rows.new_names(count)`.
        lines: Scratch, `new_lines(pieces, 2 LANES count, LANES count)`.
        chosen: Scratch, `new_choice` of the same.
        work: Scratch, another.
        ring: Scratch for routes, shape (`ring_size`, 2).
        result: Result, shape (RESULT_COLUMNS,).

    Returns:
        Memory of the way round obstacles for the next step.
    """
    limit = own[LIMIT]
    preferred = result[R_PREFERRED : R_PREFERRED + 2]
    pair = result[R_VELOCITY : R_VELOCITY + 2]
    route = preferred_velocity(own, hulls, hull_start, route, settings, ring, pair, preferred)
    slow = slowness(preferred, own[VELOCITY], own[VELOCITY + 1], limit)
    # First room for firm half-planes, filled from the end, then the hard ones, then the soft ones.
    begin = hard = LANES * count
    first, near_obstacle = obstacle_half_planes(own, pieces, piece_start, settings, lines, hard, pair)
    result[R_HARD] = first - hard
    walls, change = first, settings[ACCELERATION] * INTERVAL_S
    if not math.isinf(change):
        first = reach_half_planes(own, change, lines, first)
    heard, found, meetings, closest, margin = sift(
        own, neighbours, count, range_m, preferred, settings, candidates, names
    )
    result[R_MATTERING] = found
    sooner, wider = earlier_and_wider(heard) if settings[RESPONSE] > 0.0 else (0.0, 0.0)
    right, left, start, violation = meet(
        own, neighbours, candidates, found, names, meetings, preferred, LEAN_HORIZONS + sooner, settings
    )
    if margin < 0.0:
        violation = 0.0
    used = neighbour_half_planes(own, candidates, found, preferred, settings, lines, first)
    overlapped = near_obstacle or margin < 0.0
    if settings[CONTACT_STEP] > 0.0 and margin < 2.0 * limit * settings[CONTACT_STEP]:
        begin = contact_half_planes(own, neighbours, count, candidates, found, settings[CONTACT_STEP], lines, hard)

    # Starting and stalled are the same to the speed; both turns together would lead away from the goal.
    start *= settings[START_TURN] * slow
    if exceeds(preferred[0], preferred[1], limit):
        speed = norm(preferred[0], preferred[1])
        preferred[0], preferred[1] = preferred[0] * limit / speed, preferred[1] * limit / speed
    extra = own[EXTRA_TURN]
    if extra != 0.0 and measure(lines, first, used, preferred[0], preferred[1]) <= EPSILON:
        # A turn that outlives its cause leads round the goal for ever: whose way is free flies straight on.
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

    # Smoothed, and put back behind obstacles: a mean of two velocities that keep out may be one that does not.
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
