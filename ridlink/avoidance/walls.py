"""Static obstacles as the solvers that choose among headings see them: how soon a heading runs into one.

Axes: north-east, metres, m/s, seconds. Polygons are convex and positively oriented (north to east), see `obstacles`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.encounter import EPSILON
from ridlink.avoidance.keep_out import nearest_point
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.rows import CLEARANCE, POSITION

# Columns of an obstacle piece as own-ship sees it: distance less clearance, outward normal at its nearest point.
GAP, NORMAL, WALL_COLUMNS = (0, 1, 3)

EDGE_M = 1e-6
"""Tolerance, far more than rounding moves anything here."""


@kernel
def see_walls(own, pieces, walls):  # type: ignore[no-untyped-def]
    """Fill in the gap to every piece of an obstacle, grown by the clearance, and its outward normal; True inside one.

    Args:
        own: Own-ship.
        pieces: Convex pieces of the obstacles, `Obstacles.pieces`.
        walls: Result, shape (>= pieces, WALL_COLUMNS).
    """
    vertex, start = pieces
    inside = False
    for piece in range(len(start) - 1):
        wall = walls[piece]
        distance = nearest_point(
            vertex, start[piece], start[piece + 1], own[POSITION], own[POSITION + 1], wall[NORMAL : NORMAL + 2]
        )
        wall[GAP] = distance - own[CLEARANCE]
        inside = inside or wall[GAP] < 0.0
    return inside


@kernel
def ray_to_piece(vertex, first, last, clearance_m, p_1, p_2, d_1, d_2):  # type: ignore[no-untyped-def]
    """Distance [m] along a ray at which a convex polygon grown by a clearance is entered from outside, or infinity.

    The grown polygon is covered by its edges moved outwards and by discs about its corners. It is entered at the first
    of them that the ray meets.

    Args:
        vertex: Vertices, shape (m, 2); the polygon is `first..last-1`.
        first: Index of its first vertex.
        last: Index after its last vertex.
        clearance_m: Growth.
        p_1: North of the start, outside of the grown polygon.
        p_2: East of it.
        d_1: North of the direction, a unit vector.
        d_2: East of it.
    """
    hit = math.inf
    for k in range(first, last):
        following = k + 1 if k + 1 < last else first
        a_1, a_2 = vertex[k, 0] - p_1, vertex[k, 1] - p_2
        side_1, side_2 = vertex[following, 0] - vertex[k, 0], vertex[following, 1] - vertex[k, 1]
        length = norm(side_1, side_2)
        side_1, side_2 = side_1 / length, side_2 / length
        # The outward normal is (side_2, -side_1).
        height = a_2 * side_1 - a_1 * side_2 - clearance_m
        closing = d_2 * side_1 - d_1 * side_2
        if height >= 0.0 and closing > EPSILON:
            along = height / closing
            place = (d_1 * along - a_1) * side_1 + (d_2 * along - a_2) * side_2
            if 0.0 <= place <= length:
                hit = min(hit, along)
        towards = a_1 * d_1 + a_2 * d_2
        root = towards * towards - a_1 * a_1 - a_2 * a_2 + clearance_m * clearance_m
        if towards > 0.0 and root > 0.0:
            hit = min(hit, max(towards - math.sqrt(root), 0.0))
    return hit


@kernel(forceinline=True)
def time_to_wall(own, pieces, walls, v_1, v_2, reach_m):  # type: ignore[no-untyped-def]
    """Time [s] in which a velocity reaches the clearance of an obstacle, 0 if it leads deeper into it, else infinity.

    Args:
        own: Own-ship.
        pieces: Convex pieces of the obstacles.
        walls: As `see_walls` left them.
        v_1: North of the velocity.
        v_2: East of it.
        reach_m: Obstacles further than this do not count.
    """
    vertex, start = pieces
    speed = norm(v_1, v_2)
    if speed < EPSILON:
        return math.inf
    d_1, d_2 = v_1 / speed, v_2 / speed
    nearest = math.inf
    for piece in range(len(start) - 1):
        wall = walls[piece]
        closing = -(wall[NORMAL] * d_1 + wall[NORMAL + 1] * d_2)
        if wall[GAP] < 0.0:
            if closing > EPSILON:
                return 0.0
        # All of a convex piece lies beyond the tangent at its nearest point.
        elif closing > -EPSILON and wall[GAP] < closing * min(reach_m, nearest) + EDGE_M:
            hit = ray_to_piece(
                vertex, start[piece], start[piece + 1], own[CLEARANCE], own[POSITION], own[POSITION + 1], d_1, d_2
            )
            if hit < reach_m:
                nearest = min(nearest, hit)
    return nearest / speed
