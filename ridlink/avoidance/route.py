"""Static obstacles in the kernels: the way round them.

Axes: north-east, metres. Polygons are convex and positively oriented (north to east), see `obstacles`. A grown polygon
is the set of points within a clearance of it; for routes its round corners are replaced by ARC points each.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.keep_out import nearest_point
from ridlink.avoidance.kernel import kernel, norm

ARC = 5
"""Points that stand for a grown corner. Chords of a right angle in four steps cut 2 % of the clearance, which the route
margin covers."""

DETOUR_M = 5.0
DETOUR_SHARE = 0.1
"""A way round that was chosen is kept until the other way is shorter by both: reported positions move by metres."""

TIE_M = 1.0
"""Ways that differ by less count as equal, and equal ways are passed on the right."""


@kernel(inner=True)
def grow(vertex, first, last, clearance_m, ring):  # type: ignore[no-untyped-def]
    """Vertices of a convex polygon grown by a clearance, ARC a corner; returns their number."""
    count = last - first
    for k in range(count):
        before = first + (k - 1 if k > 0 else count - 1)
        after = first + (k + 1 if k + 1 < count else 0)
        here = first + k
        # Outward normals of the two edges at this corner, as angles from north to east.
        start = math.atan2(-(vertex[here, 0] - vertex[before, 0]), vertex[here, 1] - vertex[before, 1])
        turn = math.atan2(-(vertex[after, 0] - vertex[here, 0]), vertex[after, 1] - vertex[here, 1]) - start
        # Of a corner that is straight but for rounding it may come out a little below zero, which is no full circle.
        turn = max(turn - 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi)), 0.0)
        for step in range(ARC):
            angle = start + turn * step / (ARC - 1)
            ring[ARC * k + step, 0] = vertex[here, 0] + clearance_m * math.cos(angle)
            ring[ARC * k + step, 1] = vertex[here, 1] + clearance_m * math.sin(angle)
    return ARC * count


@kernel(inner=True)
def entry(ring, count, p_1, p_2, t_1, t_2):  # type: ignore[no-untyped-def]
    """Share of the way from p to t at which a convex ring is entered; 2 if the way stays outside or just touches it."""
    enter = 0.0
    leave = 1.0
    for k in range(count):
        following = k + 1 if k + 1 < count else 0
        normal_1 = ring[following, 1] - ring[k, 1]
        normal_2 = -(ring[following, 0] - ring[k, 0])
        height = (p_1 - ring[k, 0]) * normal_1 + (p_2 - ring[k, 1]) * normal_2
        rate = (t_1 - p_1) * normal_1 + (t_2 - p_2) * normal_2
        if abs(rate) < 1e-12:
            if height >= 0.0 and (normal_1 != 0.0 or normal_2 != 0.0):
                return 2.0
        elif rate < 0.0:
            enter = max(enter, -height / rate)
        else:
            leave = min(leave, -height / rate)
    return enter if leave - enter > 1e-6 else 2.0


@kernel(inner=True)
def tangent(ring, count, p_1, p_2, t_1, t_2, side):  # type: ignore[no-untyped-def]
    """Vertex of a convex ring that a taut string from p touches on one side of the way to t: 1 right, -1 left."""
    best = 0
    widest = -math.inf
    for k in range(count):
        to_1, to_2 = ring[k, 0] - p_1, ring[k, 1] - p_2
        across = (t_1 - p_1) * to_2 - (t_2 - p_2) * to_1
        ahead = (t_1 - p_1) * to_1 + (t_2 - p_2) * to_2
        angle = side * math.atan2(across, ahead)
        if angle > widest:
            widest = angle
            best = k
    return best


@kernel(inner=True)
def length_round(ring, count, p_1, p_2, t_1, t_2, side):  # type: ignore[no-untyped-def]
    """Length [m] of the taut string from p to t on one side of a convex ring."""
    here = tangent(ring, count, p_1, p_2, t_1, t_2, side)
    # Seen from the far end the sides swap.
    there = tangent(ring, count, t_1, t_2, p_1, p_2, -side)
    length = norm(ring[here, 0] - p_1, ring[here, 1] - p_2)
    length += norm(ring[there, 0] - t_1, ring[there, 1] - t_2)
    step = -1 if side > 0 else 1
    k = here
    for _ in range(count):
        if k == there:
            break
        following = (k + step + count) % count
        length += norm(ring[following, 0] - ring[k, 0], ring[following, 1] - ring[k, 1])
        k = following
    return length


@kernel(inner=True)
def route_aim(hulls, p_1, p_2, goal_1, goal_2, clearance_m, memory, ring, aim):  # type: ignore[no-untyped-def]
    """Point to fly to now on the way to a goal round convex polygons; the goal itself when nothing is in the way.

    The shorter way counts; of equal ways the right-hand one. Inside a polygon the way leads over its nearest edge.

    Args:
        hulls: Convex polygons, `Obstacles.hulls`.
        p_1: North of own-ship.
        p_2: East of own-ship.
        goal_1: North of the goal.
        goal_2: East of the goal.
        clearance_m: Distance to keep from every polygon.
        memory: Result of the last step: side times (polygon + 1), or 0.
        ring: Scratch, shape (ARC * most vertices of one polygon, 2).
        aim: Result, shape (2,).

    Returns:
        Memory for the next step.
    """
    vertex, start = hulls
    aim[0], aim[1] = goal_1, goal_2
    chosen = 0
    last_polygon = -1
    for depth in range(4):
        nearest = 2.0
        nearest_polygon = -1
        nearest_clearance = 0.0
        lacking = away_1 = away_2 = 0.0
        target_1, target_2 = aim[0], aim[1]
        for polygon in range(len(start) - 1):
            first, last = start[polygon], start[polygon + 1]
            own = nearest_point(vertex, first, last, p_1, p_2, aim)
            out_1, out_2 = aim[0], aim[1]
            if own <= 0.0:
                reach = clearance_m - own + 1.0
                aim[0], aim[1] = p_1 + out_1 * reach, p_2 + out_2 * reach
                return 0
            far = nearest_point(vertex, first, last, target_1, target_2, aim)
            if far <= 0.0 or polygon == last_polygon:
                continue
            # Closer than the clearance the ring is drawn just inside own-ship, so that the way along it stays defined.
            wanted = min(clearance_m, 0.98 * far)
            clearance = min(wanted, 0.98 * own)
            count = grow(vertex, first, last, clearance, ring)
            at = entry(ring, count, p_1, p_2, target_1, target_2)
            if at < nearest:
                nearest, nearest_polygon, nearest_clearance = at, polygon, clearance
                lacking, away_1, away_2 = max(1.0 - own / wanted, 0.0), out_1, out_2
        aim[0], aim[1] = target_1, target_2
        if nearest_polygon < 0:
            break
        count = grow(vertex, start[nearest_polygon], start[nearest_polygon + 1], nearest_clearance, ring)
        right = length_round(ring, count, p_1, p_2, target_1, target_2, 1)
        left = length_round(ring, count, p_1, p_2, target_1, target_2, -1)
        if abs(memory) == nearest_polygon + 1 and depth == 0:
            side = 1 if memory > 0 else -1
            kept, other = (right, left) if side > 0 else (left, right)
            if other < kept - max(DETOUR_M, DETOUR_SHARE * kept):
                side = -side
        else:
            side = -1 if left < right - TIE_M else 1
        if depth == 0:
            chosen = side * (nearest_polygon + 1)
        touch = tangent(ring, count, p_1, p_2, target_1, target_2, side)
        # Too near, the way along the ring leans outwards, or its chords would lead nearer and nearer.
        outwards = min(4.0 * lacking, 1.0) * norm(ring[touch, 0] - p_1, ring[touch, 1] - p_2)
        aim[0], aim[1] = ring[touch, 0] + outwards * away_1, ring[touch, 1] + outwards * away_2
        last_polygon = nearest_polygon
    return chosen


def ring_size(hull_start: np.ndarray) -> int:
    """Rows of scratch that `route_aim` needs for these polygons."""
    return ARC * int(np.max(np.diff(hull_start), initial=0)) + 1
