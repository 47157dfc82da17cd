"""Ways round obstacles, in the kernels: the shortest ones that keep a clearance from all of them.

A shortest way among obstacles is a taut string, which bends only at their corners. So the corners of all convex pieces,
grown by the clearance, are a map: `measure_ways` works out how far the goal is from each of them. Bays and gaps that
are too narrow need no special treatment.

Source: visibility graph (Lozano-Pérez and Wesley, 1979), searched from the goal (Dijkstra, 1959).

Axes: north-east, metres. Pieces are convex and positively oriented (north to east), see `obstacles`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.keep_out import nearest_point
from ridlink.avoidance.kernel import kernel, norm

ROUND = 5
"""Points for each grown corner: where tangents of its arc meet, so that no way between them cuts it."""

# Columns of the fixed data of a point: offset from its corner for each metre of clearance, and its piece.
(TANGENT, OWNER, POINT_COLUMNS) = (0, 2, 3)

# Columns of a way: the point, the distance to the goal from there (infinite if it cannot be reached), the next point
# (NO_POINT if that is the goal), and the distance that ways keep from the piece of the point.
(NORTH, EAST, REMAINING, NEXT, OFF, WAY_COLUMNS) = range(6)

# Columns of scratch. Of a piece: the distance to keep, and a circle that encloses it. Of a point: whether it is done.
(KEEP, MIDDLE, REACH, SETTLED, KEEP_COLUMNS) = (0, 1, 3, 4, 5)

NO_POINT = -1

TOUCH_M = 0.01
"""Tolerance: a way along a grown obstacle may enter it by less than this."""

WITHIN = 0.98
"""A vehicle or a goal nearer to an obstacle than the clearance is granted this share of its distance instead."""


@kernel(inner=True)
def enclose(pieces, keep):  # type: ignore[no-untyped-def]
    """Write a circle about each piece to columns MIDDLE and REACH, which shows that most are out of the way."""
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
    """Whether the straight way from p to t keeps the distance from every piece; both of its ends must.

    Args:
        pieces: Convex pieces, `Obstacles.pieces`.
        keep: Distance to keep from each piece (0: not in the way), and what `enclose` wrote,
            shape (>= pieces, >= KEEP_COLUMNS).
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
def edges_at(pieces, points, way, n):  # type: ignore[no-untyped-def]
    """The edges of a piece at point n: what leads from there to the points before and after it [m, north-east]."""
    _, start = pieces
    piece = int(points[n, OWNER])
    first, last = ROUND * start[piece], ROUND * start[piece + 1]
    before, after = n - 1 if n > first else last - 1, n + 1 if n + 1 < last else first
    return (
        way[before, NORTH] - way[n, NORTH], way[before, EAST] - way[n, EAST],
        way[after, NORTH] - way[n, NORTH], way[after, EAST] - way[n, EAST],
    )  # fmt: skip


@kernel(forceinline=True, inner=True)
def is_taut(edges, e_1, e_2):  # type: ignore[no-untyped-def]
    """Whether a string that bends at a point and leads on by e [m, north-east] touches the piece with these edges only
    there."""
    before_1, before_2, after_1, after_2 = edges
    one, other = e_1 * before_2 - e_2 * before_1, e_1 * after_2 - e_2 * after_1
    # A string along the edge to an adjacent point touches the piece, too, and by rounding may lie on either side.
    return one * other >= 0.0 or min(abs(one), abs(other)) <= TOUCH_M * norm(e_1, e_2)


@kernel(inner=True)
def measure_ways(pieces, points, clearance_m, goal_1, goal_2, keep, outward, way):  # type: ignore[no-untyped-def]
    """Work out the distance of a goal from every corner.

    Args:
        pieces: Convex pieces, `Obstacles.pieces`.
        points: Fixed data of their points, shape (points, POINT_COLUMNS).
        clearance_m: Distance to keep from each piece, less from a piece that the goal is nearer to.
        goal_1: North of the goal.
        goal_2: East of it.
        keep: Scratch, shape (points, KEEP_COLUMNS).
        outward: Scratch, shape (2,).
        way: Result, shape (points, WAY_COLUMNS).
    """
    vertex, start = pieces
    enclose(pieces, keep)
    for piece in range(len(start) - 1):
        far = nearest_point(vertex, start[piece], start[piece + 1], goal_1, goal_2, outward)
        keep[piece, KEEP] = min(clearance_m, WITHIN * far) if far > 0.0 else 0.0
    for n in range(len(way)):
        owner = int(points[n, OWNER])
        wide = keep[owner, KEEP]
        way[n, NORTH] = vertex[n // ROUND, 0] + wide * points[n, TANGENT]
        way[n, EAST] = vertex[n // ROUND, 1] + wide * points[n, TANGENT + 1]
        way[n, REMAINING], way[n, NEXT], way[n, OFF] = math.inf, NO_POINT, wide
        # A point too near to another piece is not used, nor is one of a piece that the goal is in.
        settled = wide <= 0.0
        for piece in range(len(start) - 1):
            if piece != owner and not settled and keep[piece, KEEP] > 0.0:
                off = norm(way[n, NORTH] - keep[piece, MIDDLE], way[n, EAST] - keep[piece, MIDDLE + 1])
                if off < keep[piece, REACH] + keep[piece, KEEP]:
                    apart = nearest_point(vertex, start[piece], start[piece + 1], way[n, NORTH], way[n, EAST], outward)
                    settled = apart < keep[piece, KEEP] - TOUCH_M
        keep[n, SETTLED] = 1.0 if settled else 0.0
    # A string that ends at the goal does not bend there.
    here, least, p_1, p_2, edges = -1, 0.0, goal_1, goal_2, (0.0, 0.0, 0.0, 0.0)
    for _ in range(len(way) + 1):
        following, next_least = -1, math.inf
        for n in range(len(way)):
            if keep[n, SETTLED] != 0.0:
                continue
            t_1, t_2 = way[n, NORTH], way[n, EAST]
            if is_taut(edges, t_1 - p_1, t_2 - p_2):
                length = least + norm(t_1 - p_1, t_2 - p_2)
                if (
                    length < way[n, REMAINING]
                    and is_taut(edges_at(pieces, points, way, n), p_1 - t_1, p_2 - t_2)
                    and in_sight(pieces, keep, t_1, t_2, p_1, p_2)
                ):
                    way[n, REMAINING], way[n, NEXT] = length, here
            if way[n, REMAINING] < next_least:
                following, next_least = n, way[n, REMAINING]
        here, least = following, next_least
        if here < 0:
            break
        keep[here, SETTLED] = 1.0
        p_1, p_2, edges = way[here, NORTH], way[here, EAST], edges_at(pieces, points, way, here)
