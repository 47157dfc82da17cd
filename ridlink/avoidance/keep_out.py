"""Static obstacles in the kernels: the half-planes that keep out of them.

An autopilot divides its acceleration between all that a command changes. One that comes as fast as it can stop, and is
sent along the obstacle or back, turns instead of braking. The half-plane is therefore folded, the more the faster it
comes, at the velocity that the vehicle has along the obstacle: who changes that must turn away as well, so that braking
gets the share that it needs.

Axes: north-east, metres. Polygons are convex and positively oriented (north to east), see `obstacles`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.programme import BOUND, EXCESS, N_1, N_2
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

MOST_BRAKING = 0.8
"""Share of an autopilot's acceleration that is counted on for braking: 2 of ArduPilot's 2.5 m/s^2."""

GRAZED_M = 0.5
"""A part of the buffer that turns in flight may take: within it, slow approaches would be folded by noise alone."""


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
def braking_share(gap_m, toward_mps, deceleration_mps2, response_s):  # type: ignore[no-untyped-def]
    """Share of its acceleration that a vehicle needs to stop within a gap to an obstacle; at most MOST_BRAKING, at the
    deceleration counted on."""
    stop = max(gap_m - toward_mps * response_s, 0.0) + GRAZED_M
    return min(toward_mps * toward_mps / (2.0 * stop * deceleration_mps2), 1.0) * MOST_BRAKING


@kernel(forceinline=True, inner=True)
def fold(own, lines, hard, used):  # type: ignore[no-untyped-def]
    """Fold half-planes `hard..used-1`, each by the share in its row EXCESS: one flank in its place, the other from
    `used` on. Returns the column after those.

    Both flanks go through the velocity that leads towards the obstacle at the bound, and along it as own-ship flies
    now: a change from there that they admit points out of the obstacle with at least that share of itself. Where
    several obstacles ask, there is one direction between their normals that serves them together, in a corner straight
    out; no share is so large that it would forbid this one.
    """
    out_1 = out_2 = 0.0
    for k in range(hard, used):
        out_1, out_2 = out_1 + lines[EXCESS, k] * lines[N_1, k], out_2 + lines[EXCESS, k] * lines[N_2, k]
    length = norm(out_1, out_2)
    for k in range(hard, used):
        n_1, n_2, bound = lines[N_1, k], lines[N_2, k], lines[BOUND, k]
        share = lines[EXCESS, k]
        if share <= 0.0 or out_1 * n_1 + out_2 * n_2 <= 0.0:
            continue
        share = min(share, MOST_BRAKING * (out_1 * n_1 + out_2 * n_2) / length)
        rest = math.sqrt(1.0 - share * share)
        along = n_1 * own[VELOCITY + 1] - n_2 * own[VELOCITY]
        lines[N_1, k], lines[N_2, k] = rest * n_1 - share * n_2, rest * n_2 + share * n_1
        lines[BOUND, k] = rest * bound + share * along
        lines[N_1, used], lines[N_2, used] = rest * n_1 + share * n_2, rest * n_2 - share * n_1
        lines[BOUND, used] = rest * bound - share * along
        used += 1
    return used


@kernel(forceinline=True, inner=True)
def obstacle_half_planes(own, pieces, settings, lines, hard, normal):  # type: ignore[no-untyped-def]
    """Write one hard half-plane, or the two flanks of a folded one, for each convex piece that could matter, from
    column `hard` of `lines` on, and some that forbid nothing up to a multiple of LANES; returns the column after those,
    and True while too near an obstacle."""
    vertex, start = pieces
    used = hard
    inside = False
    limit, speed = own[LIMIT], norm(own[VELOCITY], own[VELOCITY + 1])
    for piece in range(len(start) - 1):
        distance = nearest_point(vertex, start[piece], start[piece + 1], own[POSITION], own[POSITION + 1], normal)
        inside = inside or distance < own[CLEARANCE]
        # The gap that is left when the vehicle begins to obey; moving away earns nothing in advance.
        toward = max(-(normal[0] * own[VELOCITY] + normal[1] * own[VELOCITY + 1]), 0.0)
        gap = distance - buffered_clearance(own, settings) - settings[RESPONSE] * toward
        if gap >= 0.0:
            bound = -approach_speed(
                gap, settings[OBSTACLE_HORIZON], settings[OBSTACLE_DECELERATION], settings[OBSTACLE_RESPONSE]
            )
        else:
            bound = min(-gap * settings[BARRIER], settings[BARRIER_SHARE] * limit)
        share = braking_share(gap, toward, settings[OBSTACLE_DECELERATION], settings[OBSTACLE_RESPONSE])
        # However it is folded, it forbids nothing within the limit.
        if math.sqrt(1.0 - share * share) * (-bound - limit) >= share * (speed + limit):
            continue
        lines[N_1, used], lines[N_2, used], lines[BOUND, used] = normal[0], normal[1], bound
        lines[EXCESS, used] = share
        used += 1
    used = fold(own, lines, hard, used)
    for k in range(used, -(-used // LANES) * LANES):
        lines[N_1, k], lines[N_2, k], lines[BOUND, k] = 0.0, 0.0, -math.inf
    return -(-used // LANES) * LANES, inside
