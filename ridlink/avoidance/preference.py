"""Preferred velocity: what own-ship would fly without traffic, to its goal, round obstacles, slower towards the end.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import math

from ridlink.avoidance.encounter import EPSILON
from ridlink.avoidance.keep_out import buffered_clearance
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.rows import (
    AIM,
    AIM_IS_VELOCITY,
    ARRIVAL,
    COMMAND,
    CRUISE,
    POSITION,
    ROUTE_MARGIN,
    VELOCITY,
)
from ridlink.avoidance.waypoint import next_waypoint

APPROACH_OFFSET_MPS = 0.3
"""Keeps the last metre to a goal from taking for ever."""

INTERVAL_S = 0.1
"""Time between decisions; a goal nearer than one step of cruise is flown to in one step."""

STRAIGHT_M, STRAIGHT_SHARE = 3.0, 0.25
"""A vehicle that obeys late flies straight on if its course leads past the goal within STRAIGHT_M, or this share of the
distance if less. Its own position drifts by as much while it turns; to follow every drift would be to weave."""

AMENDED = 3.0
"""If its velocity leads past the goal at this many times that distance, the command leads to the goal itself."""


@kernel(forceinline=True, inner=True)
def steadied(c_1, c_2, v_1, v_2, to_1, to_2, to_goal_m):  # type: ignore[no-untyped-def]
    """Direction to a goal, kept as near to the commanded course as possible [m, north-east].

    A vehicle that comes back from a detour still flies outwards of its command, PX4 for seconds. The further its
    velocity leads past the goal, the nearer to the goal the command must lead.

    Args:
        c_1: North of the commanded velocity.
        c_2: East of it.
        v_1: North of the own velocity.
        v_2: East of it.
        to_1: North of the goal as seen from own-ship.
        to_2: East of it.
        to_goal_m: Distance to the goal.
    """
    square = c_1 * c_1 + c_2 * c_2
    if c_1 * to_1 + c_2 * to_2 <= 0.0 or square < EPSILON:
        return to_1, to_2
    once_per_speed = 1.0 / math.sqrt(square)
    most = min(STRAIGHT_M, STRAIGHT_SHARE * to_goal_m)
    # Root and division only if the way is not nearly straight.
    across, flown_square, near = v_1 * to_2 - v_2 * to_1, v_1 * v_1 + v_2 * v_2, (AMENDED - 1.0) * most
    if across * across > near * near * flown_square:
        flown_past = abs(across) / max(math.sqrt(flown_square), EPSILON)
        most = min(max(AMENDED * most - flown_past, 0.0), most)
    past = min(max((c_1 * to_2 - c_2 * to_1) * once_per_speed, -most), most) * once_per_speed
    return to_1 + past * c_2, to_2 - past * c_1


@kernel(forceinline=True, inner=True)
def preferred_velocity(own, pieces, roadmap, memory, settings, aim, preferred):  # type: ignore[no-untyped-def]
    """Velocity without traffic: to the goal, round obstacles, slower towards the end. Returns the route memory."""
    if own[AIM_IS_VELOCITY] != 0.0:
        preferred[0], preferred[1] = own[AIM], own[AIM + 1]
        return 0
    p_1, p_2 = own[POSITION], own[POSITION + 1]
    to_1, to_2, route = own[AIM] - p_1, own[AIM + 1] - p_2, 0
    to_goal = length = norm(to_1, to_2)
    if len(roadmap.points) > 0:
        # If there is no way, fly straight on: half-planes keep out.
        route = max(next_waypoint(
            pieces, roadmap, p_1, p_2, own[AIM], own[AIM + 1], buffered_clearance(own, settings),
            settings[ROUTE_MARGIN], memory, aim,
        ), 0)  # fmt: skip
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
def slowness(preferred, v_1, v_2, limit):  # type: ignore[no-untyped-def]
    """Share of the wanted speed that own-ship lacks: 0 at that speed, 1 at rest."""
    wanted = min(norm(preferred[0], preferred[1]), limit)
    return max(1.0 - norm(v_1, v_2) / max(wanted, EPSILON), 0.0)
