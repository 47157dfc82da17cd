"""One decision: discs and velocities -> half-planes -> the velocity nearest the preferred one.

Method: ORCA half-planes (van den Berg et al., 2011) for a vehicle that does not obey at once and positions that drift.
Each neighbour gives two half-planes, one from now and one from a response time ahead: "fly on for T, then change at
once" is what a linear response tends to, and the true path lies between the two. Discs carry a buffer, because a disc
that is grazed with moving errors is violated; inside the disc a barrier asks for separation in proportion to the
overlap.

What is worked out for one neighbour is in `encounter`; here all neighbours are met, block by block, and the decision is
made. Axes: north-east, metres, m/s, seconds. Inputs are rows and blocks of numbers, see `rows`. Nothing here allocates.
"""

from __future__ import annotations

import math

from ridlink.avoidance.contact import contact_half_planes
from ridlink.avoidance.encounter import EPSILON, half_plane, lean, passing_side, rule_side, time_to_entry
from ridlink.avoidance.kernel import copy_lanes, kernel, larger, norm, smaller
from ridlink.avoidance.programme import BOUND, EXCESS, N_1, N_2, measure, nearest_admissible
from ridlink.avoidance.reach import REACH_SIDES as REACH_SIDES
from ridlink.avoidance.reach import keep_within, reach_half_planes
from ridlink.avoidance.route import approach_speed, nearest_point, route_aim
from ridlink.avoidance.rows import (
    AGE,
    AIM,
    AIM_IS_VELOCITY,
    APART,
    CLEARANCE,
    COMMAND,
    CONSTRAINED,
    CRUISE,
    ERROR_SUM,
    EXTRA_TURN,
    FREE,
    GAP,
    HEARD,
    INFEASIBLE,
    LANES,
    LATER,
    LIMIT,
    N_COMMAND,
    N_POSITION,
    N_VELOCITY,
    NOW,
    OVERLAPPED,
    POSITION,
    R_BINDING,
    R_COMMAND,
    R_HARD,
    R_MARGIN,
    R_NEAREST,
    R_OBSTACLE,
    R_PREFERRED,
    R_SLACK,
    R_STATUS,
    R_TIME,
    R_VELOCITY,
    RADIUS,
    RECIPROCAL,
    REPORTED,
    SIDE,
    VELOCITY,
)
from ridlink.avoidance.rows import OWN_COLUMNS as OWN_COLUMNS
from ridlink.avoidance.rows import RESULT_COLUMNS as RESULT_COLUMNS

# Columns of the settings vector, in the order of the fields of HalfplaneSettings.
(
    HORIZON, RESPONSE, BARRIER, BARRIER_SHARE, SMOOTHING, RIGHT_TURN, START_TURN, AGE_ACCELERATION, BUFFER_SHARE,
    ARRIVAL, HEAD_ON_COSINE, HEAD_ON_SPEED, OBSTACLE_HORIZON, OBSTACLE_DECELERATION, OBSTACLE_RESPONSE, ROUTE_MARGIN,
    CONTACT_STEP, ACCELERATION,
) = range(18)  # fmt: skip

TOUCHING_MPS = 0.05
"""A constraint whose slack is smaller than this is named as binding."""

APART_FACTOR = 1.3
"""A neighbour that was once so many radii away, buffer included, has the buffer held against it from then on. One that
begins nearer, as in a fleet that starts side by side, may stay there and come up to the disc itself: pushing it out of
a buffer first is what kept such fleets from moving at all. Once it has left, it is as any other."""

HORIZON_RADII = 1.5
"""The conflict horizon is at least the time in which own-ship flies so many radii of the disc."""

START_RADII = 1.5
"""A neighbour nearer than so many radii calls for no turn of a standing vehicle; one a radius further for all of it.
Who stands at the edge of a disc waits, and is not just starting."""

APPROACH_OFFSET_MPS = 0.3
"""Keeps the last metre to a goal from taking for ever."""

INTERVAL_S = 0.1
"""Time between decisions; a goal nearer than one step of cruise is flown to in one step."""

MOST_TURN = 1.5
"""All turns together [rad]: a quarter turn and more would lead away from the goal."""

FAR = 1e300
"""Metres or seconds that stand for infinity where least values are sought: the compiler knows too well what the smaller
one of infinity and a number is, and what it makes of that does not go by lanes."""


@kernel(forceinline=True)
def slowness(preferred, v_1, v_2, limit):  # type: ignore[no-untyped-def]
    """How far own-ship is from the speed it wants, 0 at that speed and 1 at rest."""
    wanted = min(norm(preferred[0], preferred[1]), limit)
    return max(1.0 - norm(v_1, v_2) / max(wanted, EPSILON), 0.0)


@kernel(forceinline=True)
def buffered_clearance(own, settings):  # type: ignore[no-untyped-def]
    """Distance [m] aimed at from obstacles. As with discs, a clearance that is grazed with a drifting position is
    lost."""
    return own[CLEARANCE] * (1.0 + settings[BUFFER_SHARE])


@kernel(forceinline=True)
def preferred_velocity(own, vertex, start, memory, settings, ring, aim, preferred):  # type: ignore[no-untyped-def]
    """Velocity without traffic: to the goal, round obstacles, slower towards the end. Returns the route memory."""
    if own[AIM_IS_VELOCITY] != 0.0:
        preferred[0], preferred[1] = own[AIM], own[AIM + 1]
        return 0
    p_1, p_2 = own[POSITION], own[POSITION + 1]
    to_goal = norm(own[AIM] - p_1, own[AIM + 1] - p_2)
    clearance = buffered_clearance(own, settings) + settings[ROUTE_MARGIN]
    route = route_aim(vertex, start, p_1, p_2, own[AIM], own[AIM + 1], clearance, memory, ring, aim)
    to_1, to_2 = aim[0] - p_1, aim[1] - p_2
    length = norm(to_1, to_2)
    preferred[0] = preferred[1] = 0.0
    if to_goal < EPSILON or length < EPSILON:
        return route
    speed = min(own[CRUISE], to_goal / INTERVAL_S)
    if not math.isinf(settings[ARRIVAL]):
        speed = min(speed, math.sqrt(2.0 * settings[ARRIVAL] * to_goal) + APPROACH_OFFSET_MPS)
    preferred[0], preferred[1] = speed * to_1 / length, speed * to_2 / length
    return route


@kernel(forceinline=True)
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


@kernel(forceinline=True)
def neighbour_half_planes(own, neighbours, count, range_m, preferred, settings, lines, first):  # type: ignore[no-untyped-def]
    """The half-planes of all neighbours, LANES of now and LANES of later for every block; those that no velocity within
    the limit fails forbid nothing.

    Args:
        own: Own-ship.
        neighbours: Blocks; what is kept of the encounters is brought up to date.
        count: Number of blocks.
        range_m: Neighbours whose reports are from further away are not heard.
        preferred: Velocity without traffic, shape (2,).
        settings: Constants.
        lines: Result, from column `first` on.
        first: See `lines`.

    Returns:
        Number of columns of `lines` used; weights of the turn to the right, to the left, and when starting; least
        distance less radius [m] and least time to violation [s], FAR if there is none.
    """
    p_1, p_2, v_1, v_2 = own[POSITION], own[POSITION + 1], own[VELOCITY], own[VELOCITY + 1]
    # Midway between what the vehicle does and what it was told: the point from which changes are shared.
    o_1, o_2 = (v_1 + own[COMMAND]) / 2.0, (v_2 + own[COMMAND + 1]) / 2.0
    a_1, a_2 = preferred[0], preferred[1]
    speed = norm(a_1, a_2)
    way_1, way_2 = a_1 / max(speed, EPSILON), a_2 / max(speed, EPSILON)
    if speed <= EPSILON:
        way_1, way_2 = 1.0, 0.0
    limit, stretch = own[LIMIT], HORIZON_RADII / max(own[CRUISE], 1.0)
    least_horizon, wait, buffer, growth = (
        settings[HORIZON], settings[RESPONSE], settings[BUFFER_SHARE], settings[AGE_ACCELERATION] / 2.0,
    )  # fmt: skip
    cosine, course_speed = settings[HEAD_ON_COSINE], settings[HEAD_ON_SPEED]
    barrier, most = settings[BARRIER], settings[BARRIER_SHARE] * limit

    used, reach = first, range_m * range_m
    right = left = start = 0.0
    margin = violation = FAR
    for b in range(count):
        block = neighbours[b]
        # One array and distances known beforehand, and no branch: that lets the compiler take all lanes at once.
        for k in range(LANES):
            off_1, off_2 = block[REPORTED + k] - p_1, block[REPORTED + LANES + k] - p_2
            heard = (block[HEARD + k] != 0.0) & (off_1 * off_1 + off_2 * off_2 <= reach)
            reciprocal = block[RECIPROCAL + k] != 0.0
            r_1, r_2 = block[N_POSITION + k] - p_1, block[N_POSITION + LANES + k] - p_2
            u_1, u_2, age = block[N_VELOCITY + k], block[N_VELOCITY + LANES + k], block[AGE + k]
            c_1, c_2 = block[N_COMMAND + k], block[N_COMMAND + LANES + k]
            disc = block[RADIUS + k]
            radius = disc + buffer * block[ERROR_SUM + k] + growth * age * age
            # A large disc must be seen earlier.
            horizon = larger(least_horizon, stretch * radius)
            some = larger(radius, EPSILON)
            once_per = 1.0 / (horizon * some)
            once_per_horizon = once_per * some
            distance = math.sqrt(r_1 * r_1 + r_2 * r_2)
            w_1, w_2 = v_1 - u_1, v_2 - u_2

            gap = distance - disc if heard else FAR
            block[GAP + k] = gap
            margin = smaller(margin, gap)
            entry = time_to_entry(r_1, r_2, w_1, w_2, disc, FAR)
            violation = smaller(violation, entry if heard else FAR)

            rule = rule_side(v_1, v_2, u_1, u_2, reciprocal, cosine, course_speed)
            called = lean(r_1, r_2, a_1 - u_1, a_2 - u_2, disc, once_per_horizon)
            weight = called if heard else 0.0
            right, left = larger(right, 0.0 if rule < 0.0 else weight), larger(left, weight if rule < 0.0 else 0.0)
            # Going round works where the other does it too; who stands or lands is passed, not gone round with.
            away = smaller(larger(distance * horizon * once_per - START_RADII, 0.0), 1.0)
            start = larger(start, weight * away if reciprocal else 0.0)

            apart = (block[APART + k] != 0.0) | (distance >= APART_FACTOR * radius)
            # The edge that the barrier defends: with the buffer, but not against a neighbour that began inside of it.
            edge = radius if apart else disc
            side = passing_side(
                block[SIDE + k], rule, r_1, r_2, distance, w_1, w_2, c_1, c_2, reciprocal, radius, horizon
            )
            # An encounter is forgotten with the neighbour that goes out of range.
            block[APART + k], block[SIDE + k] = 1.0 if apart & heard else 0.0, side if heard else 0.0
            # Head-on, the neighbour's own midpoint: then both see the same relative velocity.
            x_1, x_2 = (u_1 + c_1) / 2.0 if side != 0.0 else u_1, (u_2 + c_2) / 2.0 if side != 0.0 else u_2
            share = 0.5 if reciprocal else 1.0

            now_side = side if r_1 * w_1 + r_2 * w_2 > 0.0 else 0.0
            n_1, n_2, change = half_plane(
                r_1, r_2, radius, once_per_horizon, edge, o_1 - x_1, o_2 - x_2, now_side, way_1, way_2, barrier, most
            )
            bound = n_1 * o_1 + n_2 * o_2 + share * change
            matters = heard & (bound > -limit)
            block[NOW + k], block[NOW + LANES + k] = n_1, n_2
            block[NOW + 2 * LANES + k] = bound if matters else -math.inf

            s_1, s_2 = r_1 - w_1 * wait, r_2 - w_2 * wait
            later_side = side if s_1 * w_1 + s_2 * w_2 > 0.0 else 0.0
            n_1, n_2, change = half_plane(
                s_1, s_2, radius, once_per_horizon, edge, o_1 - x_1, o_2 - x_2, later_side, way_1, way_2, barrier, most
            )
            bound = n_1 * o_1 + n_2 * o_2 + share * change
            matters = heard & (bound > -limit)
            block[LATER + k], block[LATER + LANES + k] = n_1, n_2
            block[LATER + 2 * LANES + k] = bound if matters else -math.inf

        for row in range(3):
            copy_lanes(block, NOW + LANES * row, lines[row], used)
        used += LANES
        if wait > 0.0:
            for row in range(3):
                copy_lanes(block, LATER + LANES * row, lines[row], used)
            used += LANES
    return used, right, left, start, margin, violation


@kernel(forceinline=True)
def nearest_neighbour(neighbours, count, margin_m):  # type: ignore[no-untyped-def]
    """Place of the first neighbour with that least gap, -1 if nobody is heard."""
    if margin_m == FAR:
        return -1
    for b in range(count):
        block = neighbours[b]
        for k in range(LANES):
            if block[GAP + k] == margin_m:
                return LANES * b + k
    return -1


@kernel(forceinline=True)
def name_binding(lines, hard, walls, first, last, ends, slack_mps, result):  # type: ignore[no-untyped-def]
    """Write what the velocity touches or exceeds, at least what it is nearest to: obstacles, three neighbours.

    Args:
        lines: Half-planes, measured at that velocity.
        hard: Index of the first one of an obstacle.
        walls: Index after the last one.
        first: Index of the first one of a neighbour.
        last: Index after the last one.
        ends: Half-planes for each neighbour.
        slack_mps: Distance of the velocity to the tightest of all.
        result: Result.
    """
    result[R_OBSTACLE] = 0.0
    for b in range(3):
        result[R_BINDING + b] = -1.0
    if math.isinf(slack_mps):
        return
    excess = lines[EXCESS]
    touching = -(max(slack_mps, 0.0) + TOUCHING_MPS)
    for k in range(hard, walls):
        if excess[k] >= touching:
            result[R_OBSTACLE] = 1.0
    named = place = 0
    for block in range(first, last, LANES * ends):
        for k in range(LANES):
            if excess[block + k] >= touching or excess[block + LANES * (ends - 1) + k] >= touching:
                result[R_BINDING + named] = place + k
                named += 1
                if named == 3:
                    return
        place += LANES


@kernel
def avoid_one(  # type: ignore[no-untyped-def]
    own, neighbours, count, range_m, pieces, piece_start, hulls, hull_start, route, settings, lines, chosen, work, ring,
    result,
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
    # First room for firm half-planes, filled from the end, then the hard ones, then the soft ones.
    begin = hard = LANES * count
    first, near_obstacle = obstacle_half_planes(own, pieces, piece_start, settings, lines, hard, pair)
    result[R_HARD] = first - hard
    walls, change = first, settings[ACCELERATION] * INTERVAL_S
    if not math.isinf(change):
        first = reach_half_planes(own, change, lines, first)
    used, right, left, start, margin, violation = neighbour_half_planes(
        own, neighbours, count, range_m, preferred, settings, lines, first
    )
    overlapped = near_obstacle or margin < 0.0
    if settings[CONTACT_STEP] > 0.0 and margin < 2.0 * limit * settings[CONTACT_STEP]:
        begin = contact_half_planes(own, neighbours, count, settings[CONTACT_STEP], lines, hard)

    # Starting and stalled are the same to the speed; both turns together would lead away from the goal.
    if start > 0.0:
        start *= settings[START_TURN] * slowness(preferred, own[VELOCITY], own[VELOCITY + 1], limit)
    speed = norm(preferred[0], preferred[1])
    if speed > limit:
        preferred[0], preferred[1] = preferred[0] * limit / speed, preferred[1] * limit / speed
    extra = own[EXTRA_TURN]
    if extra != 0.0 and measure(lines, first, used, preferred[0], preferred[1]) <= EPSILON:
        # A turn that outlives its cause leads round the goal for ever: whose way is free flies straight on.
        extra = 0.0
    turn = settings[RIGHT_TURN] * (right - left) + extra + max(start - max(extra, 0.0), 0.0)
    turn = min(turn, MOST_TURN)
    if turn != 0.0:
        c, s = math.cos(turn), math.sin(turn)
        preferred[0], preferred[1] = c * preferred[0] - s * preferred[1], s * preferred[0] + c * preferred[1]

    x = result[R_VELOCITY : R_VELOCITY + 2]
    feasible = nearest_admissible(lines, begin, hard, first, used, limit, preferred, chosen, work, x)
    keep_within(own, change, limit, x)

    slack = -max(measure(lines, begin, walls, x[0], x[1]), measure(lines, first, used, x[0], x[1]))
    name_binding(lines, hard, walls, first, used, 2 if settings[RESPONSE] > 0.0 else 1, slack, result)
    pair = work[len(work) - 1]
    pair[0], pair[1] = preferred[0], preferred[1]
    keep_within(own, change, limit, pair)
    moved = norm(x[0] - pair[0], x[1] - pair[1]) > TOUCHING_MPS
    result[R_STATUS] = FREE
    if not feasible:
        result[R_STATUS] = INFEASIBLE
    elif overlapped:
        result[R_STATUS] = OVERLAPPED
    elif moved:
        result[R_STATUS] = CONSTRAINED
    result[R_SLACK], result[R_NEAREST] = slack, nearest_neighbour(neighbours, count, margin)
    result[R_MARGIN] = margin if margin < FAR else math.inf
    result[R_TIME] = violation if violation < FAR else math.inf

    # Smoothed, and put back behind obstacles: a mean of two velocities that keep out may be one that does not.
    blend = settings[SMOOTHING]
    pair[0] = own[COMMAND] + blend * (x[0] - own[COMMAND])
    pair[1] = own[COMMAND + 1] + blend * (x[1] - own[COMMAND + 1])
    nearest_admissible(lines, begin, hard, first, first, limit, pair, chosen, work, result[R_COMMAND : R_COMMAND + 2])
    keep_within(own, change, limit, result[R_COMMAND : R_COMMAND + 2])
    return route
