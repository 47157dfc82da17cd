"""Static obstacles in the kernels: the half-planes that keep out of them.

Axes: north-east, metres. Polygons are convex and positively oriented (north to east), see `obstacles`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.programme import BOUND, N_1, N_2
from ridlink.avoidance.rows import (
    BARRIER,
    BARRIER_SHARE,
    BUFFER_SHARE,
    CLEARANCE,
    LANES,
    LIMIT,
    OBSTACLE_DECELERATION,
    OBSTACLE_HORIZON,
    OBSTACLE_RESPONSE,
    POSITION,
    RESPONSE,
    VELOCITY,
)


@kernel(inner=True)
def nearest_point(vertex, first, last, p_1, p_2, found):  # type: ignore[no-untyped-def]
    """Signed distance [m] of a point to a convex polygon, negative inside, and the outward normal at the nearest point.

    Args:
        vertex: Vertices, shape (m, 2); the polygon is `first..last-1`.
        first: Index of its first vertex.
        last: Index after its last vertex.
        p_1: North of the point.
        p_2: East of the point.
        found: Result: the normal, shape (2,).
    """
    inside = True
    deepest = -math.inf
    closest = math.inf
    outward_1 = outward_2 = edge_1 = edge_2 = 0.0
    for k in range(first, last):
        following = k + 1 if k + 1 < last else first
        a_1, a_2 = vertex[k, 0], vertex[k, 1]
        side_1, side_2 = vertex[following, 0] - a_1, vertex[following, 1] - a_2
        length = norm(side_1, side_2)
        normal_1, normal_2 = side_2 / length, -side_1 / length
        height = (p_1 - a_1) * normal_1 + (p_2 - a_2) * normal_2
        if height > 0.0:
            inside = False
        if height > deepest:
            deepest = height
            edge_1, edge_2 = normal_1, normal_2
        along = ((p_1 - a_1) * side_1 + (p_2 - a_2) * side_2) / (length * length)
        along = min(max(along, 0.0), 1.0)
        gap_1, gap_2 = p_1 - a_1 - along * side_1, p_2 - a_2 - along * side_2
        distance = norm(gap_1, gap_2)
        if distance < closest:
            closest = distance
            outward_1, outward_2 = gap_1, gap_2
    if inside or closest < 1e-9:
        found[0], found[1] = edge_1, edge_2
        return deepest
    found[0], found[1] = outward_1 / closest, outward_2 / closest
    return closest


@kernel(inner=True)
def approach_speed(gap_m, horizon_s, deceleration_mps2, response_s):  # type: ignore[no-untyped-def]
    """Largest speed [m/s] towards an obstacle from which the vehicle still stops within the gap."""
    if math.isinf(deceleration_mps2):
        return gap_m / horizon_s
    lost = deceleration_mps2 * response_s
    return min(gap_m / horizon_s, math.sqrt(lost * lost + 2.0 * deceleration_mps2 * gap_m) - lost)


@kernel(forceinline=True, inner=True)
def buffered_clearance(own, settings):  # type: ignore[no-untyped-def]
    """Distance [m] to keep from obstacles, with a buffer: a clearance grazed with a drifting position is lost."""
    return own[CLEARANCE] * (1.0 + settings[BUFFER_SHARE])


@kernel(forceinline=True, inner=True)
def obstacle_half_planes(own, pieces, settings, lines, hard, normal):  # type: ignore[no-untyped-def]
    """Write one hard half-plane for each convex piece that could matter, from column `hard` of `lines` on, and some
    that forbid nothing up to a multiple of LANES; returns the column after those, and True while too near an
    obstacle."""
    vertex, start = pieces
    used = hard
    inside = False
    limit = own[LIMIT]
    for piece in range(len(start) - 1):
        distance = nearest_point(vertex, start[piece], start[piece + 1], own[POSITION], own[POSITION + 1], normal)
        inside = inside or distance < own[CLEARANCE]
        gap = distance - buffered_clearance(own, settings)
        # The gap that is left when the vehicle begins to obey; moving away earns nothing in advance.
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
