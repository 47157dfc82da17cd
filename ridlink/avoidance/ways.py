"""Ways round obstacles, in the kernels: the shortest ones that keep a clearance from all of them.

A shortest way among obstacles is a string pulled taut, which bends at their corners only. So the corners of all convex
pieces, grown by the clearance, are a map: `measure_ways` works out how far the goal is from each of them, once for a
goal, and at every step `way_aim` picks the one in sight by which it is nearest. Bays, and gaps that are too narrow, are
nothing special on such a map.

Source: visibility graph (Lozano-Pérez and Wesley, 1979), searched from the goal (Dijkstra, 1959).

Axes: north-east, metres. Pieces are convex and positively oriented (north to east), see `obstacles`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.keep_out import nearest_point
from ridlink.avoidance.kernel import kernel, norm

ROUND = 5
"""Points that stand for a grown corner: where tangents of its arc meet, so that no way between them cuts it."""

# Columns of a way: the point, how far the goal is from there, infinite where it cannot be reached, the point that comes
# next, NO_POINT where that is the goal, and how far ways keep off the piece of the point.
(NORTH, EAST, REMAINING, NEXT, OFF, WAY_COLUMNS) = range(6)

# Columns of scratch. Of a piece: how far it is kept off, and a circle that encloses it.
(KEEP, MIDDLE, REACH, KEEP_COLUMNS) = (0, 1, 3, 4)

# Those of `way_aim` go on, of a point: the length of the way that leads by it, which share of its clearance there is to
# its piece, and where it lies then.
(LENGTH, SHARE, POINT, ROOM_COLUMNS) = (4, 5, 6, 8)

NO_POINT = -1

NO_WAY = -1
"""Memory where no point of a way is in sight."""

DETOUR_M, DETOUR_SHARE = 5.0, 0.1
"""A way that was chosen is kept until another one is shorter by both: reported positions move by metres."""

TIE_M = 1.0
"""Ways that differ by less count as equal, and equal ways are passed on the right."""

TOUCH_M = 0.01
"""Ways that lead along a grown obstacle do not enter it by so much."""

WITHIN = 0.98
"""Who is nearer to an obstacle than its clearance, and a goal that is, are granted this share of what there is."""

LEAN = 4.0
"""Too near, the way leans outwards by so many times the share that is lacking."""


@kernel(inner=True)
def enclose(pieces, keep):  # type: ignore[no-untyped-def]
    """Write a circle about each piece to columns MIDDLE and REACH, from which most are seen to be out of the way."""
    vertex, start = pieces
    for piece in range(len(start) - 1):
        first, last = start[piece], start[piece + 1]
        middle_1 = middle_2 = square = 0.0
        for k in range(first, last):
            middle_1 += vertex[k, 0] / (last - first)
            middle_2 += vertex[k, 1] / (last - first)
        for k in range(first, last):
            q_1, q_2 = vertex[k, 0] - middle_1, vertex[k, 1] - middle_2
            square = max(square, q_1 * q_1 + q_2 * q_2)
        keep[piece, MIDDLE], keep[piece, MIDDLE + 1], keep[piece, REACH] = middle_1, middle_2, math.sqrt(square)


@kernel(inner=True)
def in_sight(pieces, keep, p_1, p_2, t_1, t_2):  # type: ignore[no-untyped-def]
    """Whether the straight way from p to t keeps its distance from every piece, as both of its ends do.

    Args:
        pieces: Convex pieces, `Obstacles.pieces`.
        keep: Distance to keep from each, with 0 it is not in the way, and what `enclose` wrote, shape
            (>= pieces, >= KEEP_COLUMNS).
        p_1: North of the beginning.
        p_2: East of it.
        t_1: North of the end.
        t_2: East of it.
    """
    vertex, start = pieces
    d_1, d_2 = t_1 - p_1, t_2 - p_2
    length = norm(d_1, d_2)
    if length < TOUCH_M:
        return True
    d_1, d_2 = d_1 / length, d_2 / length
    for piece in range(len(start) - 1):
        least = keep[piece, KEEP] - TOUCH_M
        if least <= -TOUCH_M:
            continue
        q_1, q_2 = keep[piece, MIDDLE] - p_1, keep[piece, MIDDLE + 1] - p_2
        along, reach = q_1 * d_1 + q_2 * d_2, keep[piece, REACH] + keep[piece, KEEP]
        if abs(d_1 * q_2 - d_2 * q_1) > reach or along < -reach or along > length + reach:
            continue
        square = max(least, 0.0) * max(least, 0.0)
        before = start[piece + 1] - 1
        q_1, q_2 = vertex[before, 0] - p_1, vertex[before, 1] - p_2
        along_before, off_before = q_1 * d_1 + q_2 * d_2, d_1 * q_2 - d_2 * q_1
        for k in range(start[piece], start[piece + 1]):
            q_1, q_2 = vertex[k, 0] - p_1, vertex[k, 1] - p_2
            along, off = q_1 * d_1 + q_2 * d_2, d_1 * q_2 - d_2 * q_1
            past = along - min(max(along, 0.0), length)
            if off * off + past * past < square:
                return False
            if off * off_before < 0.0:
                crossed = along_before + (along - along_before) * off_before / (off_before - off)
                if 0.0 <= crossed <= length:
                    return False
            along_before, off_before = along, off
    return True


@kernel(inner=True)
def is_taut(pieces, piece, way, n, t_1, t_2):  # type: ignore[no-untyped-def]
    """Whether a string from t that bends at point n, of a piece, touches that piece only there."""
    _, start = pieces
    first, last = ROUND * start[piece], ROUND * start[piece + 1]
    before, after = n - 1 if n > first else last - 1, n + 1 if n + 1 < last else first
    e_1, e_2 = t_1 - way[n, NORTH], t_2 - way[n, EAST]
    one = e_1 * (way[before, EAST] - way[n, EAST]) - e_2 * (way[before, NORTH] - way[n, NORTH])
    other = e_1 * (way[after, EAST] - way[n, EAST]) - e_2 * (way[after, NORTH] - way[n, NORTH])
    # A string along the edge to a neighbour touches it, too, and rounding may say that it lies on either side.
    least = TOUCH_M * norm(e_1, e_2)
    return one * other >= 0.0 or min(abs(one), abs(other)) <= least


@kernel
def measure_ways(pieces, rounding, owner, clearance_m, goal_1, goal_2, keep, settled, outward, way):  # type: ignore[no-untyped-def]
    """Work out how far a goal is from every corner.

    Args:
        pieces: Convex pieces, `Obstacles.pieces`.
        rounding: Where points lie for each metre of clearance, as seen from their corners, shape (points, 2).
        owner: The piece of each point, shape (points,), int64.
        clearance_m: Distance to keep from each of them, less from one that the goal is nearer to.
        goal_1: North of the goal.
        goal_2: East of it.
        keep: Scratch, shape (points, KEEP_COLUMNS).
        settled: Scratch, shape (points,), bool.
        outward: Scratch, shape (2,).
        way: Result, shape (points, WAY_COLUMNS).
    """
    vertex, start = pieces
    enclose(pieces, keep)
    for piece in range(len(start) - 1):
        far = nearest_point(vertex, start[piece], start[piece + 1], goal_1, goal_2, outward)
        keep[piece, KEEP] = min(clearance_m, WITHIN * far) if far > 0.0 else 0.0
    for n in range(len(way)):
        way[n, NORTH] = vertex[n // ROUND, 0] + keep[owner[n], KEEP] * rounding[n, 0]
        way[n, EAST] = vertex[n // ROUND, 1] + keep[owner[n], KEEP] * rounding[n, 1]
        way[n, REMAINING], way[n, NEXT], way[n, OFF] = math.inf, NO_POINT, keep[owner[n], KEEP]
        # A point that is too near to another piece is none, nor is one of a piece that the goal is in.
        settled[n] = keep[owner[n], KEEP] <= 0.0
        for piece in range(len(start) - 1):
            if piece != owner[n] and not settled[n] and keep[piece, KEEP] > 0.0:
                off = norm(way[n, NORTH] - keep[piece, MIDDLE], way[n, EAST] - keep[piece, MIDDLE + 1])
                if off < keep[piece, REACH] + keep[piece, KEEP]:
                    apart = nearest_point(vertex, start[piece], start[piece + 1], way[n, NORTH], way[n, EAST], outward)
                    settled[n] = apart < keep[piece, KEEP] - TOUCH_M
    here, least, p_1, p_2 = -1, 0.0, goal_1, goal_2
    for _ in range(len(way) + 1):
        following, next_least = -1, math.inf
        for n in range(len(way)):
            if settled[n]:
                continue
            length = least + norm(way[n, NORTH] - p_1, way[n, EAST] - p_2)
            if (
                length < way[n, REMAINING]
                and is_taut(pieces, owner[n], way, n, p_1, p_2)
                and (here < 0 or is_taut(pieces, owner[here], way, here, way[n, NORTH], way[n, EAST]))
                and in_sight(pieces, keep, way[n, NORTH], way[n, EAST], p_1, p_2)
            ):
                way[n, REMAINING], way[n, NEXT] = length, here
            if way[n, REMAINING] < next_least:
                following, next_least = n, way[n, REMAINING]
        here, least = following, next_least
        if here < 0:
            break
        settled[here] = True
        p_1, p_2 = way[here, NORTH], way[here, EAST]


@kernel(inner=True)
def leads_by(way, n, m):  # type: ignore[no-untyped-def]
    """Whether the way from point n leads by point m."""
    for _ in range(len(way)):
        if n == m or n < 0:
            break
        n = int(way[n, NEXT])
    return n == m


@kernel(inner=True)
def way_aim(  # type: ignore[no-untyped-def]
    pieces, way, p_1, p_2, goal_1, goal_2, clearance_m, memory, room, aim
):
    """Point to fly to now on the way to a goal round obstacles; the goal itself when nothing is in the way.

    The shortest way counts; of equal ways the right-hand one. Inside a piece the way leads over its nearest edge.

    Args:
        pieces: Convex pieces, `Obstacles.pieces`.
        way: What `measure_ways` found for this goal.
        p_1: North of own-ship.
        p_2: East of own-ship.
        goal_1: North of the goal.
        goal_2: East of the goal.
        clearance_m: Distance from pieces that the way out of one leads to.
        memory: Result of the last step.
        room: Scratch, shape (points, ROOM_COLUMNS).
        aim: Result, shape (2,).

    Returns:
        Memory for the next step: the number of the point, from 1, or 0 for the goal; NO_WAY if no way is in sight.
    """
    vertex, start = pieces
    for piece in range(len(start) - 1):
        first, last = start[piece], start[piece + 1]
        own = nearest_point(vertex, first, last, p_1, p_2, aim)
        if own <= 0.0:
            reach = clearance_m - own + 1.0
            aim[0], aim[1] = p_1 + aim[0] * reach, p_2 + aim[1] * reach
            return 0
        far = nearest_point(vertex, first, last, goal_1, goal_2, aim)
        # The way is that to a goal nearby, which may be nearer to the piece: what is further off is in nobody's sight.
        wanted = min(way[ROUND * first, OFF], WITHIN * far) if far > 0.0 else 0.0
        room[piece, KEEP] = min(wanted, WITHIN * own)
        # Too near, one flies along the piece rather than away from it: in a crowd all lanes would become one.
        share = min(own / wanted, 1.0) if wanted > 0.0 else 1.0
        for n in range(ROUND * first, ROUND * last):
            c_1, c_2 = vertex[n // ROUND, 0], vertex[n // ROUND, 1]
            t_1, t_2 = c_1 + share * (way[n, NORTH] - c_1), c_2 + share * (way[n, EAST] - c_2)
            length = norm(t_1 - p_1, t_2 - p_2)
            room[n, LENGTH] = length + way[n, REMAINING] if length > TOUCH_M else math.inf
            room[n, SHARE], room[n, POINT], room[n, POINT + 1] = share, t_1, t_2
    aim[0], aim[1] = goal_1, goal_2
    enclose(pieces, room)
    if in_sight(pieces, room, p_1, p_2, goal_1, goal_2):
        return 0

    known = 0 < memory <= len(way)
    best, chosen, most = -1, -1, math.inf
    for _ in range(len(way)):
        n, length = -1, math.inf
        for k in range(len(way)):
            if room[k, LENGTH] < length:
                n, length = k, room[k, LENGTH]
        if n < 0 or length > most:
            break
        room[n, LENGTH] = math.inf
        t_1, t_2 = room[n, POINT], room[n, POINT + 1]
        if known:
            preferred = leads_by(way, n, memory - 1) or leads_by(way, memory - 1, n)
        else:
            preferred = (goal_1 - p_1) * (t_2 - p_2) - (goal_2 - p_2) * (t_1 - p_1) > 0.0
        if (best < 0 or preferred) and in_sight(pieces, room, p_1, p_2, t_1, t_2):
            chosen = n
            if best >= 0 or preferred:
                break
            best = n
            most = length + (max(DETOUR_M, DETOUR_SHARE * length) if known else TIE_M)
    if chosen < 0:
        return NO_WAY
    # The nearer, the more it leans outwards.
    piece = 0
    while ROUND * start[piece + 1] <= chosen:
        piece += 1
    nearest_point(vertex, start[piece], start[piece + 1], p_1, p_2, aim)
    t_1, t_2 = room[chosen, POINT], room[chosen, POINT + 1]
    outwards = min(LEAN * (1.0 - room[chosen, SHARE]), 1.0) * norm(t_1 - p_1, t_2 - p_2)
    aim[0], aim[1] = t_1 + outwards * aim[0], t_2 + outwards * aim[1]
    return chosen + 1
