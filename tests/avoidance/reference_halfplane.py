"""The half-plane decision in its plain form: one neighbour after the other, one case after the other.

This is the reference that the form in lanes (`ridlink.avoidance.halfplane`) is compared with: branches instead of
picked answers, lengths instead of their squares, every half-plane taken in turn instead of the most exceeded one. It
is slower by far and needs no compiler. Arguments are as in the package, but a neighbour is a row of numbers (see
NEIGHBOUR_COLUMNS), what is kept of its encounter are `Memory` flags, and a half-plane is a row (n_1, n_2, d).
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance import keep_out, preference, turning
from ridlink.avoidance.encounter import CLEAR_FACTOR, DODGE_MPS, EPSILON, HOLD_FACTOR
from ridlink.avoidance.evasion import ACCELERATION_MPS2, DEEP, LESS_DEEP, REACTION_S, SOON_S
from ridlink.avoidance.halfplane import TOUCHING_MPS
from ridlink.avoidance.kernel import norm
from ridlink.avoidance.meeting import PUSHED_MPS, START_RADII
from ridlink.avoidance.rows import (
    AGE_ACCELERATION,
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
    HEAD_ON_COSINE,
    HEAD_ON_SPEED,
    HORIZON,
    INFEASIBLE,
    LIMIT,
    OBSTACLE_DECELERATION,
    OBSTACLE_HORIZON,
    OBSTACLE_RESPONSE,
    OVERLAPPED,
    POSITION,
    R_BINDING,
    R_COMMAND,
    R_MARGIN,
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
)
from ridlink.avoidance.sift import HORIZON_RADII
from tests.avoidance.way_in import way_in

buffered_clearance, preferred_velocity, slowness, approach_speed, braking_share, nearest_point, earlier_and_wider = map(
    way_in,
    (
        keep_out.buffered_clearance, preference.preferred_velocity, preference.slowness, keep_out.approach_speed,
        keep_out.braking_share, keep_out.nearest_point, turning.earlier_and_wider,
    ),
)  # fmt: skip

# Columns of a neighbour. Its position is the reported one, AGE seconds old; the command is NaN where none was given.
N_POSITION, N_VELOCITY, N_COMMAND, AGE, RADIUS, ERROR_SUM, RECIPROCAL, NEIGHBOUR_COLUMNS = (0, 2, 4, 6, 7, 8, 9, 10)

# Memory of an encounter.
PASSING_RIGHT, PASSING_LEFT, APART = 1, 2, 4


def optimum_on_edge(lines, index, limit_mps, aim, linear, point):
    """Best point on the edge of half-plane `index` that meets all earlier ones; False if there is none.

    Args:
        lines: Half-planes, shape (m, 3).
        index: The one whose edge is searched; those before it count.
        limit_mps: Radius of the disc.
        aim: Preferred velocity, or with `linear` the direction to go as far as possible in, shape (2,).
        linear: Which of the two `aim` is.
        point: Result, shape (2,), written only on success.
    """
    n_1, n_2, d = lines[index, 0], lines[index, 1], lines[index, 2]
    room = limit_mps * limit_mps - d * d
    if room < 0.0:
        return False
    along_1, along_2 = -n_2, n_1
    high = math.sqrt(room)
    low = -high
    for j in range(index):
        slope = lines[j, 0] * along_1 + lines[j, 1] * along_2
        rest = lines[j, 2] - d * (lines[j, 0] * n_1 + lines[j, 1] * n_2)
        if abs(slope) <= EPSILON:
            if rest > EPSILON * 10.0:
                return False
            continue
        if slope > 0.0:
            low = max(low, rest / slope)
        else:
            high = min(high, rest / slope)
        if low > high:
            return False
    reach = along_1 * aim[0] + along_2 * aim[1]
    t = (high if reach > 0.0 else low) if linear else min(max(reach, low), high)
    point[0] = n_1 * d + along_1 * t
    point[1] = n_2 * d + along_2 * t
    return True


def optimum(lines, count, limit_mps, aim, linear, point):
    """Best point of the disc within the first `count` half-planes.

    Returns `count` on success, else the index of the first half-plane that could not be met; `point` then is the
    optimum over those before it. Arguments as in `optimum_on_edge`.
    """
    length = norm(aim[0], aim[1])
    scale = limit_mps / length if linear or length > limit_mps else 1.0
    point[0] = aim[0] * scale
    point[1] = aim[1] * scale
    for i in range(count):
        if lines[i, 0] * point[0] + lines[i, 1] * point[1] < lines[i, 2] - EPSILON and not optimum_on_edge(
            lines, i, limit_mps, aim, linear, point
        ):
            return i
    return count


def least_excess(lines, hard, count, start, limit_mps, work, point):
    """Make the largest excess over the soft half-planes `hard..count-1` as small as possible; hard ones stay met.

    Args:
        lines: Half-planes, hard ones first, shape (m, 3).
        hard: Number of hard half-planes; they must have been met by `point`.
        count: Number of half-planes.
        start: First half-plane that `point` fails.
        limit_mps: Radius of the disc.
        work: Scratch, shape (m, 3).
        point: In: optimum before `start`. Out: velocity of least excess.

    Returns:
        That excess, m/s.
    """
    excess = 0.0
    aim = work[count]
    for i in range(start, count):
        n_1, n_2, d = lines[i, 0], lines[i, 1], lines[i, 2]
        if d - (n_1 * point[0] + n_2 * point[1]) <= excess:
            continue
        for k in range(hard):
            work[k, 0], work[k, 1], work[k, 2] = lines[k, 0], lines[k, 1], lines[k, 2]
        used = hard
        for j in range(hard, i):
            # An earlier half-plane may be exceeded, but by no more than this one: d_j - n_j.x <= d_i - n_i.x.
            e_1, e_2 = lines[j, 0] - n_1, lines[j, 1] - n_2
            length = norm(e_1, e_2)
            if length <= EPSILON:
                continue
            work[used, 0], work[used, 1] = e_1 / length, e_2 / length
            work[used, 2] = (lines[j, 2] - d) / length
            used += 1
        kept_1, kept_2 = point[0], point[1]
        aim[0], aim[1] = n_1, n_2
        if optimum(work, used, limit_mps, aim, True, point) < used:
            # The old point is feasible here by construction: only rounding leads to this branch.
            point[0], point[1] = kept_1, kept_2
        excess = max(excess, d - (n_1 * point[0] + n_2 * point[1]))
    return excess


def nearest_admissible(lines, hard, firm, count, limit_mps, preferred, work, point):
    """Velocity nearest `preferred` within all half-planes and the disc, or the one that exceeds the soft ones least.

    Where the hard half-planes contradict each other, all of them are moved back by their least possible excess first;
    then the firm ones, where they contradict each other or the hard ones.

    Args:
        lines: Half-planes, hard ones first, then firm ones, shape (m, 3) with m > count; both may be moved back.
        hard: Number of hard half-planes.
        firm: Index after the last firm one.
        count: Number of half-planes.
        limit_mps: Radius of the disc.
        preferred: Preferred velocity, shape (2,).
        work: Scratch, shape (m, 3).
        point: Result, shape (2,).

    Returns:
        True if every half-plane is met as it was given.
    """
    failed = optimum(lines, count, limit_mps, preferred, False, point)
    if failed == count:
        return True
    for above, below in ((0, hard), (hard, firm)):
        if failed < below:
            excess = least_excess(lines, above, below, failed, limit_mps, work, point)
            for k in range(above, below):
                lines[k, 2] -= excess + 1e3 * EPSILON
            failed = optimum(lines, count, limit_mps, preferred, False, point)
            if failed == count or failed < below:
                return False
    least_excess(lines, firm, count, failed, limit_mps, work, point)
    return False


def cone_half_plane(r_1, r_2, radius_m, horizon_s, w_1, w_2, side, line):
    """Smallest change out of the velocity obstacle of a disc outside own-ship.

    Args:
        r_1: North of the neighbour as seen from own-ship; |r| >= radius.
        r_2: East of it.
        radius_m: Radius of the disc.
        horizon_s: Conflicts later than this do not count, which cuts the cone off by a circle.
        w_1: North of the relative velocity, own less neighbour's.
        w_2: East of it.
        side: 0 nearest boundary; 1 the right leg of the cone, -1 the left one, without the circle.
        line: Result: outward normal of the boundary and the change along it, shape (3,).
    """
    square = r_1 * r_1 + r_2 * r_2
    chosen = side
    if side == 0:
        off_1, off_2 = w_1 - r_1 / horizon_s, w_2 - r_2 / horizon_s
        towards = off_1 * r_1 + off_2 * r_2
        off = norm(off_1, off_2)
        if towards < 0.0 and towards * towards > radius_m * radius_m * off * off:
            line[0], line[1] = off_1 / off, off_2 / off
            line[2] = radius_m / horizon_s - off
            return
        # Straight on is passed on the right, also when rounding says left.
        chosen = 1 if r_1 * off_2 - r_2 * off_1 >= -EPSILON * math.sqrt(square) * off else -1
    leg = math.sqrt(max(square - radius_m * radius_m, 0.0))
    # Leg of the cone: r turned by asin(R / |r|) to the chosen side; its outward normal is a quarter turn further.
    leg_1 = (r_1 * leg - chosen * r_2 * radius_m) / square
    leg_2 = (r_2 * leg + chosen * r_1 * radius_m) / square
    line[0], line[1] = -chosen * leg_2, chosen * leg_1
    line[2] = -(line[0] * w_1 + line[1] * w_2)


def rule_side(v_1, v_2, u_1, u_2, reciprocal, settings):
    """Side that the rule of the road gives own-ship: 1 right, -1 left, 0 where there is none.

    On opposite courses both turn to the right. A crossing vehicle that avoids nobody is passed astern: ahead of it, at
    its own speed, a slow answer ends in a race with it.

    Args:
        v_1: North of the own velocity.
        v_2: East of it.
        u_1: North of the neighbour's reported velocity.
        u_2: East of it.
        reciprocal: Not zero if the neighbour takes its half of the avoidance.
        settings: Constants.
    """
    own, other = norm(v_1, v_2), norm(u_1, u_2)
    if min(own, other) <= settings[HEAD_ON_SPEED]:
        return 0
    opposite = settings[HEAD_ON_COSINE] * own * other
    parallel = v_1 * u_1 + v_2 * u_2
    if parallel < opposite:
        return 1
    if reciprocal == 0.0 and parallel < -opposite:
        # Astern is the side that the neighbour moves away from.
        return -1 if v_1 * u_2 - v_2 * u_1 > 0.0 else 1
    return 0


def passing_side(memory, r_1, r_2, v_1, v_2, u_1, u_2, c_1, c_2, reciprocal, radius_m, horizon_s, settings):
    """Side on which own-ship passes a neighbour where the nearest boundary will not do: 1 right, -1 left, 0 nearest.

    Both vehicles must see the same case, so only reported velocities count, no private commands. The choice is held
    until the encounter is over, so that noise cannot turn it, with one exception: where the two disagree, because one
    of them saw itself clear on the left and the other did not, right wins. Otherwise both dodge the same way and lock
    on.

    Args:
        memory: What is kept of the encounter, `Memory` flags.
        r_1: North of the neighbour as seen from own-ship.
        r_2: East of it.
        v_1: North of the own velocity.
        v_2: East of it.
        u_1: North of the neighbour's reported velocity.
        u_2: East of it.
        c_1: North of what the neighbour was told to fly, its velocity where it does not say.
        c_2: East of it.
        reciprocal: Not zero if the neighbour takes its half of the avoidance.
        radius_m: Disc with its buffer.
        horizon_s: Conflict horizon.
        settings: Constants.
    """
    w_1, w_2 = v_1 - u_1, v_2 - u_2
    closing = norm(w_1, w_2)
    distance = norm(r_1, r_2)
    if closing < EPSILON or distance < radius_m or r_1 * w_1 + r_2 * w_2 <= 0.0:
        return 0
    # Miss distance, positive when own-ship passes to the right of the neighbour.
    miss = (r_1 * w_2 - r_2 * w_1) / closing
    if abs(miss) > HOLD_FACTOR * radius_m:
        return 0
    if (memory & PASSING_LEFT) != 0 and reciprocal != 0.0 and r_2 * c_1 - r_1 * c_2 > DODGE_MPS * distance:
        return 1
    if (memory & (PASSING_RIGHT | PASSING_LEFT)) != 0:
        return 1 if (memory & PASSING_RIGHT) != 0 else -1
    if distance >= closing * horizon_s + radius_m:
        return 0
    wanted = rule_side(v_1, v_2, u_1, u_2, reciprocal, settings)
    return -wanted if wanted * miss < -CLEAR_FACTOR * radius_m else wanted


def lean(preferred, r_1, r_2, u_1, u_2, radius_m, horizon_s, horizons):
    """Weight in [0, 1] of the turn that a neighbour calls for, tapered in miss distance and time.

    A turn switched by a threshold moves the miss distance over that threshold itself and chatters.
    """
    w_1, w_2 = preferred[0] - u_1, preferred[1] - u_2
    square = w_1 * w_1 + w_2 * w_2
    if square < EPSILON:
        return 0.0
    time = (r_1 * w_1 + r_2 * w_2) / square
    if time <= 0.0:
        return 0.0
    miss = abs(r_1 * w_2 - r_2 * w_1) / math.sqrt(square)
    near = min(max((2.0 * radius_m - miss) / radius_m, 0.0), 1.0)
    soon = min(max((horizons * horizon_s - time) / horizon_s, 0.0), 1.0)
    return near * soon * min(time, 1.0)


def time_to_entry(r_1, r_2, w_1, w_2, radius_m):
    """Time [s] until a disc is entered at relative velocity w (own less neighbour's); 0 inside, infinite if never."""
    inside = radius_m * radius_m - r_1 * r_1 - r_2 * r_2
    if inside > 0.0:
        return 0.0
    square = w_1 * w_1 + w_2 * w_2
    towards = r_1 * w_1 + r_2 * w_2
    root = towards * towards + square * inside
    if towards <= 0.0 or root <= 0.0:
        return math.inf
    return max((towards - math.sqrt(root)) / square, 0.0)


def obstacle_half_planes(own, vertex, start, settings, lines, owner, normal):
    """One hard half-plane for each convex piece that could matter, two where it is folded; returns their number, and
    True while too near one."""
    walls = []
    inside = False
    limit = own[LIMIT]
    v = np.array(own[VELOCITY : VELOCITY + 2])
    for piece in range(len(start) - 1):
        distance = nearest_point(vertex, start[piece], start[piece + 1], own[POSITION], own[POSITION + 1], normal)
        inside = inside or distance < own[CLEARANCE]
        gap = distance - buffered_clearance(own, settings)
        # What is left of the gap when the vehicle begins to obey; moving away earns nothing in advance.
        toward = max(-(normal @ v), 0.0)
        gap -= settings[RESPONSE] * toward
        if gap >= 0.0:
            bound = -approach_speed(
                gap, settings[OBSTACLE_HORIZON], settings[OBSTACLE_DECELERATION], settings[OBSTACLE_RESPONSE]
            )
        else:
            bound = min(-gap * settings[BARRIER], settings[BARRIER_SHARE] * limit)
        share = braking_share(gap, toward, settings[OBSTACLE_DECELERATION], settings[OBSTACLE_RESPONSE])
        if bound > -limit or math.tan(math.asin(share)) * (norm(*v) + limit) > -bound - limit:
            walls.append((normal.copy(), bound, share))
    used = 0
    out = sum((share * n for n, _, share in walls), np.zeros(2))
    for n, bound, share in walls:
        most = keep_out.MOST_BRAKING * max(out @ n, 0.0) / max(norm(*out), 1e-300)
        angle = math.asin(min(share, most))
        tangent = np.array([-n[1], n[0]])
        # Both flanks go through the velocity that leads towards the obstacle at the bound, and along it as now.
        edge = bound * n + (tangent @ v) * tangent
        for turn in (angle, -angle) if angle > 0.0 else (0.0,):
            flank = math.cos(turn) * n + math.sin(turn) * tangent
            lines[used, 0], lines[used, 1], lines[used, 2] = *flank, flank @ edge
            owner[used] = -1
            used += 1
    return used, inside


def contact_half_planes(own, neighbours, count, settings, lines, owner, used):
    """One firm half-plane for each neighbour whose exact disc could be entered within a step; returns their end."""
    limit, step = own[LIMIT], settings[CONTACT_STEP]
    p_1, p_2, v_1, v_2 = own[POSITION], own[POSITION + 1], own[VELOCITY], own[VELOCITY + 1]
    for j in range(count):
        u_1, u_2, age = neighbours[j, N_VELOCITY], neighbours[j, N_VELOCITY + 1], neighbours[j, AGE]
        out_1, out_2 = p_1 - neighbours[j, N_POSITION] - u_1 * age, p_2 - neighbours[j, N_POSITION + 1] - u_2 * age
        distance = norm(out_1, out_2)
        gap = distance - neighbours[j, RADIUS]
        if neighbours[j, RECIPROCAL] == 0.0 or neighbours[j, ERROR_SUM] != 0.0 or distance <= EPSILON:
            continue
        if gap >= 2.0 * limit * step:
            continue
        n_1, n_2 = out_1 / distance, out_2 / distance
        half = max(gap, 0.0) / (2.0 * step)
        common = (n_1 * (v_1 + u_1) + n_2 * (v_2 + u_2)) / 2.0
        lines[used, 0], lines[used, 1] = n_1, n_2
        lines[used, 2] = min(max(common, -half), half) - half
        owner[used] = j
        used += 1
    return used


def path(own, velocity, t):
    """Position and velocity at a time on the path to a velocity: on as before, then over at a steady acceleration."""
    change = [velocity[i] - own[VELOCITY + i] for i in range(2)]
    ramp, answering = math.hypot(*change) / ACCELERATION_MPS2, max(t - REACTION_S, 0.0)
    done, mean = (1.0, answering - ramp / 2.0) if answering >= ramp else (answering / ramp, answering**2 / ramp / 2.0)
    return (
        [own[POSITION + i] + own[VELOCITY + i] * t + change[i] * mean for i in range(2)],
        [own[VELOCITY + i] + change[i] * done for i in range(2)],
    )


def deepest_entry(own, neighbours, velocity):
    """Share of its radius by which the path to a velocity enters a disc, and whose; the deepest of them."""
    deepest, who = 0.0, -1
    ramp = math.hypot(velocity[0] - own[VELOCITY], velocity[1] - own[VELOCITY + 1]) / ACCELERATION_MPS2
    for j, (position, motion, radius, reciprocal) in neighbours.items():

        def approach(t, position=position, motion=motion):
            here, flown = path(own, velocity, t)
            r = [position[i] + motion[i] * t - here[i] for i in range(2)]
            w = [motion[i] - flown[i] for i in range(2)]
            return math.hypot(*r), t - (r[0] * w[0] + r[1] * w[1]) / max(w[0] ** 2 + w[1] ** 2, EPSILON)

        now, t = approach(0.0)
        first, t = approach(min(max(t, 0.0), SOON_S))
        second, _ = approach(min(max(t, 0.0), SOON_S))
        _, t = approach(REACTION_S + ramp)
        third, _ = approach(min(max(t, REACTION_S + ramp), SOON_S))
        entry = (0.5 if reciprocal else 1.0) * (1.0 - min(now, first, second, third) / max(radius, EPSILON))
        if entry > deepest:
            deepest, who = entry, j
    return deepest, who


def evade(own, neighbours, violation, admissible, x):
    """The velocity to fly to instead of an answer that comes too late, or that answer."""
    late = REACTION_S + math.hypot(x[0] - own[VELOCITY], x[1] - own[VELOCITY + 1]) / ACCELERATION_MPS2
    least, who = deepest_entry(own, neighbours, x)
    if not 0.0 < violation < min(SOON_S, late) or least < DEEP:
        return x
    position = neighbours[who][0]
    sight = math.atan2(position[1] - own[POSITION + 1], position[0] - own[POSITION])
    least -= LESS_DEEP
    for off in (math.pi / 4.0, -math.pi / 4.0, math.pi / 2.0, -math.pi / 2.0):
        way = [own[LIMIT] * math.cos(sight + off), own[LIMIT] * math.sin(sight + off)]
        entry, _ = deepest_entry(own, neighbours, way)
        if admissible(way) and entry < least - EPSILON:
            least, x = entry, way
    return x


def avoid_one(
    own, neighbours, count, memory, pieces, roadmap, route, settings, lines, work, owner,
    result,
):  # fmt: skip
    """Decide for one own-ship.

    Args:
        own: Own-ship, goal and limits, shape (OWN_COLUMNS,).
        neighbours: One row each, shape (>= count, NEIGHBOUR_COLUMNS).
        count: Number of neighbours.
        memory: What is kept of each encounter, read and written, `Memory` flags, shape (>= count,), int8.
        pieces: Convex pieces of the obstacles, `Obstacles.pieces`.
        roadmap: Ways round them, `Roadmap`.
        route: Memory of the way round obstacles.
        settings: Constants, `HalfplaneSettings.as_vector`.
        lines: Scratch for half-planes, shape (>= 3 count + 2 pieces + 2, 3).
        work: Scratch of the same shape.
        owner: Scratch: neighbour of each half-plane, shape (>= 3 count + 2 pieces,), int64.
        result: Result, shape (RESULT_COLUMNS,).

    Returns:
        Memory of the way round obstacles for the next step.
    """
    limit = own[LIMIT]
    p_1, p_2 = own[POSITION], own[POSITION + 1]
    v_1, v_2 = own[VELOCITY], own[VELOCITY + 1]
    # Midway between what the vehicle does and what it was told: the point from which changes are shared.
    o_1, o_2 = (v_1 + own[COMMAND]) / 2.0, (v_2 + own[COMMAND + 1]) / 2.0
    preferred = result[R_PREFERRED : R_PREFERRED + 2]
    pair = result[R_VELOCITY : R_VELOCITY + 2]
    route = preferred_velocity(own, pieces, roadmap, route, settings, pair, preferred)
    hard, overlapped = obstacle_half_planes(own, *pieces, settings, lines, owner, pair)

    used = firm = hard
    if settings[CONTACT_STEP] > 0.0:
        firm = used = contact_half_planes(own, neighbours, count, settings, lines, owner, hard)
    sooner, wider, announced = earlier_and_wider(count) if settings[RESPONSE] > 0.0 else (0.0, 0.0, 0.0)
    buffer = settings[BUFFER_SHARE] * turning.buffer_growth(own[CRUISE], settings[RESPONSE])
    pressed = False
    right = left = start = 0.0
    margin, nearest, violation = math.inf, -1, math.inf
    line = work[0]
    for j in range(count):
        u_1, u_2, age = neighbours[j, N_VELOCITY], neighbours[j, N_VELOCITY + 1], neighbours[j, AGE]
        r_1, r_2 = neighbours[j, N_POSITION] + u_1 * age - p_1, neighbours[j, N_POSITION + 1] + u_2 * age - p_2
        radius = neighbours[j, RADIUS] + buffer * neighbours[j, ERROR_SUM]
        radius += settings[AGE_ACCELERATION] * age * age / 2.0
        # A large disc must be seen earlier.
        horizon = max(settings[HORIZON], HORIZON_RADII * radius / max(own[CRUISE], 1.0))
        distance = norm(r_1, r_2)
        if distance - neighbours[j, RADIUS] < margin:
            margin, nearest = distance - neighbours[j, RADIUS], j
        violation = min(violation, time_to_entry(r_1, r_2, v_1 - u_1, v_2 - u_2, neighbours[j, RADIUS]))
        overlapped = overlapped or distance < neighbours[j, RADIUS]
        c_1, c_2 = u_1, u_2
        if not math.isnan(neighbours[j, N_COMMAND]) and not math.isnan(neighbours[j, N_COMMAND + 1]):
            c_1, c_2 = neighbours[j, N_COMMAND], neighbours[j, N_COMMAND + 1]
        met = (neighbours[j, RADIUS], horizon, 2.5 + sooner)
        weight = max(
            lean(preferred, r_1, r_2, u_1, u_2, *met),
            announced * lean(preferred, r_1, r_2, c_1, c_2, *met),
        )
        if weight > 0.0 and rule_side(v_1, v_2, u_1, u_2, neighbours[j, RECIPROCAL], settings) < 0:
            left = max(left, weight)
        else:
            right = max(right, weight)
        if neighbours[j, RECIPROCAL] != 0.0:
            # Going round works where the other does it too; who stands or lands is passed, not gone round with.
            start = max(start, weight * min(max(distance / max(radius, EPSILON) - START_RADII, 0.0), 1.0))
        before = int(memory[j])
        apart = (before & APART) != 0 or distance >= HOLD_FACTOR * radius
        # The edge that the barrier defends: with the buffer, but not against a neighbour that began inside of it.
        edge = radius if apart else neighbours[j, RADIUS]
        side = passing_side(
            before, r_1, r_2, v_1, v_2, u_1, u_2, c_1, c_2, neighbours[j, RECIPROCAL], radius, horizon, settings
        )
        memory[j] = (APART if apart else 0) + (PASSING_RIGHT if side > 0 else PASSING_LEFT if side < 0 else 0)
        share = 0.5 if neighbours[j, RECIPROCAL] != 0.0 else 1.0
        # Head-on, the neighbour's own midpoint: then both see the same relative velocity.
        x_1, x_2 = u_1, u_2
        if side != 0:
            x_1, x_2 = (u_1 + c_1) / 2.0, (u_2 + c_2) / 2.0
        w_1, w_2 = o_1 - x_1, o_2 - x_2
        for end in range(2):
            wait = settings[RESPONSE] * end
            s_1, s_2 = r_1 + (u_1 - v_1) * wait, r_2 + (u_2 - v_2) * wait
            ahead = norm(s_1, s_2)
            if ahead < radius:
                if ahead < EPSILON:
                    # Exactly on top of each other: any direction separates, the one to the own goal is as good as any.
                    speed = norm(preferred[0], preferred[1])
                    line[0] = preferred[0] / speed if speed > EPSILON else 1.0
                    line[1] = preferred[1] / speed if speed > EPSILON else 0.0
                else:
                    line[0], line[1] = -s_1 / ahead, -s_2 / ahead
                most = settings[BARRIER_SHARE] * limit
                if apart and settings[RESPONSE] > 0.0:
                    most = max(most, min(limit, PUSHED_MPS))
                parting = min(settings[BARRIER] * (edge - ahead), most)
                line[2] = parting - (line[0] * w_1 + line[1] * w_2)
            else:
                kept = side if s_1 * (v_1 - u_1) + s_2 * (v_2 - u_2) > 0.0 else 0
                cone_half_plane(s_1, s_2, radius, horizon, w_1, w_2, kept, line)
            bound = line[0] * o_1 + line[1] * o_2 + share * line[2]
            if bound > -limit:
                lines[used, 0], lines[used, 1], lines[used, 2] = line[0], line[1], bound
                owner[used] = j
                used += 1
                # The later end of a neighbour does not make the contact of others worth less.
                pressed = pressed or (neighbours[j, RECIPROCAL] == 0.0 and end == 0)
    if pressed and firm > hard:
        # With a neighbour about that avoids nobody, nothing is firm.
        lines[hard : hard + used - firm] = lines[firm:used].copy()
        owner[hard : hard + used - firm] = owner[firm:used].copy()
        used, firm = hard + used - firm, hard

    # Starting and stalled are the same to the speed; both turns together would lead away from the goal.
    start *= settings[START_TURN] * slowness(preferred, v_1, v_2, limit)
    speed = norm(preferred[0], preferred[1])
    if speed > limit:
        preferred[0], preferred[1] = preferred[0] * limit / speed, preferred[1] * limit / speed
    # A turn that outlives its cause leads round the goal for ever: whose way is free flies straight on.
    free = all(
        lines[k, 0] * preferred[0] + lines[k, 1] * preferred[1] >= lines[k, 2] - EPSILON for k in range(firm, used)
    )
    extra = 0.0 if free else own[EXTRA_TURN]
    turn = settings[RIGHT_TURN] * (1.0 + wider) * (right - left) + extra + max(start - max(extra, 0.0), 0.0)
    turn = min(turn, 1.5)
    if turn != 0.0:
        c, s = math.cos(turn), math.sin(turn)
        preferred[0], preferred[1] = c * preferred[0] - s * preferred[1], s * preferred[0] + c * preferred[1]

    x = result[R_VELOCITY : R_VELOCITY + 2]
    feasible = nearest_admissible(lines, hard, firm, used, limit, preferred, work, x)
    if settings[RESPONSE] > 0.0:
        heard = {}
        for j in sorted(set(owner[firm:used].tolist())):
            position, motion = neighbours[j, N_POSITION : N_POSITION + 2], neighbours[j, N_VELOCITY : N_VELOCITY + 2]
            heard[j] = (
                position + motion * neighbours[j, AGE], motion, neighbours[j, RADIUS], neighbours[j, RECIPROCAL]
            )  # fmt: skip
        evasion = evade(
            own, heard, violation,
            lambda way: all(lines[k, 0] * way[0] + lines[k, 1] * way[1] >= lines[k, 2] - EPSILON for k in range(firm)),
            x,
        )  # fmt: skip
        feasible = feasible and evasion is x
        x[0], x[1] = evasion[0], evasion[1]
    speed = norm(x[0], x[1])
    if speed > limit:
        x[0], x[1] = x[0] * limit / speed, x[1] * limit / speed

    slack = math.inf
    for k in range(used):
        slack = min(slack, lines[k, 0] * x[0] + lines[k, 1] * x[1] - lines[k, 2])
    for b in range(3):
        result[R_BINDING + b] = -1.0
    result[R_OBSTACLE] = 0.0
    named = 0
    for k in range(used):
        here = lines[k, 0] * x[0] + lines[k, 1] * x[1] - lines[k, 2]
        if here > max(slack, 0.0) + TOUCHING_MPS:
            continue
        if hard <= k < firm:
            continue
        if owner[k] < 0:
            result[R_OBSTACLE] = 1.0
        elif named < 3 and (named == 0 or result[R_BINDING + named - 1] != owner[k]):
            result[R_BINDING + named] = owner[k]
            named += 1
    moved = norm(x[0] - preferred[0], x[1] - preferred[1]) > TOUCHING_MPS
    result[R_STATUS] = FREE
    if not feasible:
        result[R_STATUS] = INFEASIBLE
    elif overlapped:
        result[R_STATUS] = OVERLAPPED
    elif moved:
        result[R_STATUS] = CONSTRAINED
    result[R_SLACK], result[R_MARGIN], result[R_NEAREST], result[R_TIME] = slack, margin, nearest, violation

    # Smoothed, and put back behind obstacles: a mean of two velocities that keep out may be one that does not.
    blend = settings[SMOOTHING]
    pair = work[len(work) - 1]
    pair[0] = own[COMMAND] + blend * (x[0] - own[COMMAND])
    pair[1] = own[COMMAND + 1] + blend * (x[1] - own[COMMAND + 1])
    nearest_admissible(lines, hard, firm, firm, limit, pair, work, result[R_COMMAND : R_COMMAND + 2])
    return route
