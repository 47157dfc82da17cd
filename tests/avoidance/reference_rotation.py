"""The rotation solver as one would write it down: every heading against every neighbour and every obstacle.

Plain Python, heading by heading in the order of their cost. The kernel gives the same answer to the last bit and looks
at a fraction of all that.
"""

import math

import numpy as np

from ridlink.avoidance import keep_out, rotation, rows
from ridlink.avoidance.headings import EPSILON, WALL_S
from ridlink.avoidance.walls import ray_to_piece
from tests.avoidance.way_in import way_in

nearest_point = way_in(keep_out.nearest_point)


def straightforward(own, heard, radius, range_m, obstacles, settings):
    """Velocity (2,) and whether it leads into no disc and no obstacle.

    Args:
        own: Row of own-ship, with a goal, as in `rows`.
        heard: Reports as in `ridlink.avoidance.worlds`, shape (count, 8).
        radius: Discs, shape (count,).
        range_m: Neighbours whose reports are from further away are not heard.
        obstacles: `Obstacles`.
        settings: `RotationSettings`.
    """
    p, velocity, command = own[0:2], own[2:4], own[4:6]
    middle = (velocity + command) / 2.0
    to = own[6:8] - p
    away = math.sqrt(to[0] * to[0] + to[1] * to[1])
    pace = min(own[rows.CRUISE], own[rows.LIMIT])
    speed = min(pace, away / 0.1)
    if math.isfinite(settings.arrival_deceleration_mps2):
        speed = min(speed, math.sqrt(2.0 * settings.arrival_deceleration_mps2 * away) + 0.3)
    if away < EPSILON:
        to = np.array([1.0, 0.0]) if np.hypot(*velocity) < EPSILON else velocity
    u = to / math.sqrt(to[0] * to[0] + to[1] * to[1])
    reach = away

    seen = []
    for report, kept in zip(heard, radius, strict=True):
        off = report[0:2] - p
        if off[0] * off[0] + off[1] * off[1] <= range_m * range_m:
            r = report[0:2] + report[2:4] * report[6] - p
            reciprocal = report[7] != 0.0
            grown = kept + settings.age_acceleration_mps2 * report[6] * report[6] / 2.0
            seen.append((r, middle + report[2:4] if reciprocal else report[2:4], 2.0 if reciprocal else 1.0, grown))

    def depth_and_excess(v):
        """Whether it leads into a disc, and the least miss distance less radius."""
        into, least = False, 1e3
        for r, since, times, kept in seen:
            w = times * v - since
            if r[0] * w[0] + r[1] * w[1] > 0.0:
                across, square = r[0] * w[1] - r[1] * w[0], w[0] * w[0] + w[1] * w[1]
                into = into or across * across < kept * kept * square
                least = min(least, abs(across) / max(math.sqrt(square), EPSILON) - kept)
        return into, least

    def time_to_wall(v):
        flown = math.sqrt(v[0] * v[0] + v[1] * v[1])
        if flown < EPSILON:
            return math.inf
        d, nearest, normal = v / flown, math.inf, np.zeros(2)
        vertex, start = obstacles.piece_vertex_ne_m, obstacles.piece_start
        for piece in range(len(start) - 1):
            gap = nearest_point(vertex, start[piece], start[piece + 1], p[0], p[1], normal) - own[rows.CLEARANCE]
            if gap < 0.0:
                if normal[0] * d[0] + normal[1] * d[1] < -EPSILON:
                    return 0.0
                continue
            hit = ray_to_piece(vertex, start[piece], start[piece + 1], own[rows.CLEARANCE], p[0], p[1], d[0], d[1])
            if hit < reach:
                nearest = min(nearest, hit)
        return nearest / flown

    fan = rotation.candidates(settings.step_deg, settings.left_weight)
    best, chosen = -math.inf, None
    for c, s, _, cost in fan:
        v = np.array([speed * (c * u[0] - s * u[1]), speed * (s * u[0] + c * u[1])])
        into, least = depth_and_excess(v)
        wall = time_to_wall(v)
        if not into and wall == math.inf:
            return v, True
        score = (wall - WALL_S - 1.0) * 1e6 if wall < WALL_S else least - settings.cost_weight * cost
        if score > best:
            best, chosen = score, v
    return chosen, False
