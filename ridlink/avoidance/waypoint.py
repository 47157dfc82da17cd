"""Next waypoint on the way to a goal round obstacles, chosen at every step on the map that `roadmap` keeps.

The shortest way counts; of equal ways the right-hand one. If the goal is in sight, no map is needed.

Axes: north-east, metres. Pieces are convex and positively oriented (north to east), see `obstacles`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.keep_out import nearest_point
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.roadmap import (
    GOAL_OFF,
    LENGTH,
    MOST_STEPS,
    OWN_OFF,
    POINT,
    SHARE,
    SHORTEST,
    STEPS_PER_M,
    WIDTHS,
    ways_to,
    width_of_way,
)
from ridlink.avoidance.ways import (
    EAST,
    KEEP,
    NEXT,
    NORTH,
    OFF,
    OWNER,
    REMAINING,
    ROUND,
    TOUCH_M,
    WITHIN,
    enclose,
    in_sight,
)

NO_WAY = -1
"""Memory if no point of a way is in sight."""

DETOUR_M, DETOUR_SHARE = 5.0, 0.1
"""A chosen way is kept until another one is shorter by both: reported positions move by metres."""

TIE_M = 1.0
"""Ways that differ by less count as equal; of equal ways the right-hand one is flown."""

LEAN = 4.0
"""If own-ship is too near a piece, the way leans outwards by this many times the missing share of the clearance."""


@kernel(inner=True)
def next_waypoint(  # type: ignore[no-untyped-def]
    pieces, roadmap, p_1, p_2, goal_1, goal_2, clearance_m, margin_m, memory, aim
):
    """Find the point to fly to now; the goal itself if nothing is in the way, or no way is in sight.

    Inside a piece the way leads over its nearest edge.

    Args:
        pieces: Convex pieces, `Obstacles.pieces`, about the present origin.
        roadmap: `Roadmap`.
        p_1: North of own-ship.
        p_2: East of own-ship.
        goal_1: North of the goal.
        goal_2: East of the goal.
        clearance_m: Distance to keep from pieces.
        margin_m: Further distance that routes keep.
        memory: Result of the last step.
        aim: Result, shape (2,).

    Returns:
        Memory for the next step: the number of the point, from 1, or 0 for the goal; NO_WAY if no way is in sight.
    """
    (vertex, start), room = pieces, roadmap.room
    steps = int(min(clearance_m * STEPS_PER_M, MOST_STEPS))
    widest = width_of_way(steps, 0, margin_m)
    for piece in range(len(start) - 1):
        own = nearest_point(vertex, start[piece], start[piece + 1], p_1, p_2, aim)
        if own <= 0.0:
            reach = clearance_m + margin_m - own + 1.0
            aim[0], aim[1] = p_1 + aim[0] * reach, p_2 + aim[1] * reach
            return 0
        room[piece, OWN_OFF] = own
        far = nearest_point(vertex, start[piece], start[piece + 1], goal_1, goal_2, aim)
        room[piece, GOAL_OFF] = far
        room[piece, KEEP] = min(widest, WITHIN * far, WITHIN * own) if far > 0.0 else 0.0
    enclose(pieces, room)
    chosen = 0
    if not in_sight(pieces, room, p_1, p_2, goal_1, goal_2):
        chosen = NO_WAY
        for width in range(WIDTHS):
            if chosen == NO_WAY:
                found = ways_to(pieces, roadmap, goal_1, goal_2, steps, width, margin_m, aim)
                chosen = choose_way(pieces, roadmap, roadmap.table[found], p_1, p_2, goal_1, goal_2, memory)
    if chosen <= 0:
        aim[0], aim[1] = goal_1, goal_2
        return chosen
    # The nearer to the piece, the more the way leans outwards.
    n, piece = chosen - 1, int(roadmap.points[chosen - 1, OWNER])
    nearest_point(vertex, start[piece], start[piece + 1], p_1, p_2, aim)
    t_1, t_2 = room[n, POINT], room[n, POINT + 1]
    outwards = min(LEAN * (1.0 - room[n, SHARE]), 1.0) * norm(t_1 - p_1, t_2 - p_2)
    aim[0], aim[1] = t_1 + outwards * aim[0], t_2 + outwards * aim[1]
    return chosen


@kernel(inner=True)
def choose_way(pieces, roadmap, way, p_1, p_2, goal_1, goal_2, memory):  # type: ignore[no-untyped-def]
    """Choose the point of a way to fly to now, as in `next_waypoint`, which has filled in OWN_OFF and GOAL_OFF."""
    (vertex, start), about, room = pieces, roadmap.vertex, roadmap.room
    for piece in range(len(start) - 1):
        own, far = room[piece, OWN_OFF], room[piece, GOAL_OFF]
        # The way is to a rounded goal. The goal itself may be nearer to the piece; with more to keep, nothing has it in
        # sight.
        wanted = min(way[ROUND * start[piece], OFF], WITHIN * far) if far > 0.0 else 0.0
        room[piece, KEEP] = min(wanted, WITHIN * own)
        # If too near, own-ship flies along the piece rather than away from it: in a crowd all lanes would become one.
        share = min(own / wanted, 1.0) if wanted > 0.0 else 1.0
        for k in range(start[piece], start[piece + 1]):
            c_1, c_2 = vertex[k, 0], vertex[k, 1]
            moved_1, moved_2 = c_1 - about[k, 0], c_2 - about[k, 1]
            for n in range(ROUND * k, ROUND * (k + 1)):
                t_1 = c_1 + share * (way[n, NORTH] + moved_1 - c_1)
                t_2 = c_2 + share * (way[n, EAST] + moved_2 - c_2)
                length = norm(t_1 - p_1, t_2 - p_2)
                room[n, LENGTH] = length + way[n, REMAINING] if length > TOUCH_M else math.inf
                room[n, SHARE], room[n, POINT], room[n, POINT + 1] = share, t_1, t_2
        room[piece, SHORTEST] = room[first_of_shortest(room, start, piece), LENGTH]
    if in_sight(pieces, room, p_1, p_2, goal_1, goal_2):
        return 0

    known = 0 < memory <= len(way)
    best, chosen, most = -1, -1, math.inf
    for _ in range(len(way)):
        piece, length = -1, math.inf
        for k in range(len(start) - 1):
            if room[k, SHORTEST] < length:
                piece, length = k, room[k, SHORTEST]
        if piece < 0 or length > most:
            break
        n = first_of_shortest(room, start, piece)
        room[n, LENGTH] = math.inf
        room[piece, SHORTEST] = room[first_of_shortest(room, start, piece), LENGTH]
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
    return chosen + 1 if chosen >= 0 else NO_WAY


@kernel(inner=True)
def first_of_shortest(room, start, piece):  # type: ignore[no-untyped-def]
    """Point of a piece past which the way is shortest, the first one of equal ones."""
    n = ROUND * start[piece]
    for k in range(n + 1, ROUND * start[piece + 1]):
        if room[k, LENGTH] < room[n, LENGTH]:
            n = k
    return n


@kernel(inner=True)
def leads_by(way, n, m):  # type: ignore[no-untyped-def]
    """Whether the way from point n passes point m."""
    for _ in range(len(way)):
        if n == m or n < 0:
            break
        n = int(way[n, NEXT])
    return n == m
