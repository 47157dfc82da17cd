"""The method of the half-planes in its first form, which the study flies in the same worlds for comparison.

A neighbour gives two half-planes of ORCA (van den Berg et al., 2011), one from now and one from RESPONSE_S ahead, about
a disc with a buffer; on opposite courses both pass on the right; the preferred velocity turns to the right, tapered in
miss distance and time; the answer is smoothed. `ridlink.avoidance` began as this. It shares the linear programme with
it, and nothing else.

Axes: north-east, metres, m/s, seconds. A positive angle is a turn to the right.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ridlink.avoidance import rows
from ridlink.avoidance.programme import BOUND, N_1, N_2, nearest_admissible, new_choice, new_lines

RESPONSE_S = 1.0
HORIZON_S = 8.0
BARRIER_PER_S = 1.0
SMOOTHING = 0.5
RIGHT_TURN_RAD = 0.3
BUFFER_SHARE = 1.0 / 3.0
AGE_ACCELERATION_MPS2 = 2.5
ARRIVAL_DECELERATION_MPS2 = 1.2
HEAD_ON_COSINE, HEAD_ON_MPS = -0.85, 2.0
HOLD_FACTOR, CLEAR_FACTOR = 1.3, 0.5
LEAN_HORIZONS = 2.5
LEAST = 1e-9


@njit(cache=True)
def half_plane(r_1, r_2, radius, w_1, w_2, side):
    """Outward normal of the velocity obstacle's boundary and the change of the relative velocity along it; on the
    nearest boundary, or on the right leg (side 1) or the left one (-1) of the cone."""
    square = r_1 * r_1 + r_2 * r_2
    if square < radius * radius:
        distance = max(math.sqrt(square), LEAST)
        n_1, n_2 = -r_1 / distance, -r_2 / distance
        return n_1, n_2, BARRIER_PER_S * (radius - distance) - (n_1 * w_1 + n_2 * w_2)
    o_1, o_2 = w_1 - r_1 / HORIZON_S, w_2 - r_2 / HORIZON_S
    towards, length = r_1 * o_1 + r_2 * o_2, max(math.hypot(o_1, o_2), LEAST)
    if side == 0 and towards < 0.0 and towards * towards > (radius * length) ** 2:
        return o_1 / length, o_2 / length, radius / HORIZON_S - length
    leg = math.sqrt(square - radius * radius)
    if side == 1 or (side == 0 and r_1 * o_2 - r_2 * o_1 >= 0.0):
        n_1, n_2 = -(r_1 * radius + r_2 * leg) / square, (r_1 * leg - r_2 * radius) / square
    else:
        n_1, n_2 = (r_2 * leg - r_1 * radius) / square, -(r_2 * radius + r_1 * leg) / square
    return n_1, n_2, -(n_1 * w_1 + n_2 * w_2)


@njit(cache=True)
def head_on_side(held, r_1, r_2, radius, v_1, v_2, u_1, u_2):
    """The side held on opposite courses: 1 right, -1 left, 0 none."""
    w_1, w_2 = v_1 - u_1, v_2 - u_2
    closing, distance = max(math.hypot(w_1, w_2), LEAST), math.hypot(r_1, r_2)
    miss = (r_1 * w_2 - r_2 * w_1) / closing
    if r_1 * w_1 + r_2 * w_2 <= 0.0 or abs(miss) > HOLD_FACTOR * radius or distance < radius:
        return 0
    own, other = math.hypot(v_1, v_2), math.hypot(u_1, u_2)
    opposite = v_1 * u_1 + v_2 * u_2 < HEAD_ON_COSINE * own * other and min(own, other) > HEAD_ON_MPS
    if held == 0 and opposite and distance < closing * HORIZON_S + radius:
        return -1 if miss < -CLEAR_FACTOR * radius else 1
    return held


@njit(cache=True)
def lean(r_1, r_2, w_1, w_2, width):
    """Weight of the turn that a neighbour calls for."""
    square = w_1 * w_1 + w_2 * w_2
    if square < LEAST:
        return 0.0
    time, miss = (r_1 * w_1 + r_2 * w_2) / square, abs(r_1 * w_2 - r_2 * w_1) / math.sqrt(square)
    near = min(max((2.0 * width - miss) / width, 0.0), 1.0)
    return near * min(max(LEAN_HORIZONS - time / HORIZON_S, 0.0), 1.0) * min(max(time, 0.0), 1.0)


@njit(cache=True)
def decide(own, heard, hears, radius_m, error_sum_m, held, room, result):
    """One decision; `held` keeps the sides, `room` is for half-planes and choices."""
    lines, chosen, work = room
    limit = own[rows.LIMIT]
    p_1, p_2, v_1, v_2 = own[rows.POSITION], own[rows.POSITION + 1], own[rows.VELOCITY], own[rows.VELOCITY + 1]
    c_1, c_2 = own[rows.COMMAND], own[rows.COMMAND + 1]
    o_1, o_2 = (v_1 + c_1) / 2.0, (v_2 + c_2) / 2.0
    to_1, to_2 = own[rows.AIM] - p_1, own[rows.AIM + 1] - p_2
    away = max(math.hypot(to_1, to_2), LEAST)
    speed = min(limit, math.sqrt(2.0 * ARRIVAL_DECELERATION_MPS2 * away) + 0.3)
    a_1, a_2 = to_1 / away * speed, to_2 / away * speed
    used, turn = 0, 0.0
    lines[BOUND] = -math.inf
    for j in range(len(heard)):
        age, u_1, u_2 = heard[j, 6], heard[j, 2], heard[j, 3]
        r_1, r_2 = heard[j, 0] + u_1 * age - p_1, heard[j, 1] + u_2 * age - p_2
        if not hears[j]:
            continue
        radius = radius_m[j] + BUFFER_SHARE * error_sum_m[j] + AGE_ACCELERATION_MPS2 * age * age / 2.0
        held[j] = head_on_side(held[j], r_1, r_2, radius, v_1, v_2, u_1, u_2)
        for ahead_s in (0.0, RESPONSE_S):
            s_1, s_2 = r_1 + (u_1 - v_1) * ahead_s, r_2 + (u_2 - v_2) * ahead_s
            n_1, n_2, change = half_plane(s_1, s_2, radius, o_1 - u_1, o_2 - u_2, held[j])
            lines[N_1, used], lines[N_2, used] = n_1, n_2
            lines[BOUND, used] = n_1 * o_1 + n_2 * o_2 + (0.5 if heard[j, 7] > 0.0 else 1.0) * change
            used += 1
        turn = max(turn, RIGHT_TURN_RAD * lean(r_1, r_2, a_1 - u_1, a_2 - u_2, error_sum_m[j] + 2.0))
    c, s = math.cos(turn), math.sin(turn)
    preferred, point = result[rows.R_PREFERRED : rows.R_PREFERRED + 2], result[rows.R_VELOCITY : rows.R_VELOCITY + 2]
    preferred[0], preferred[1] = c * a_1 - s * a_2, s * a_1 + c * a_2
    met = nearest_admissible(lines, 0, 0, 0, used, limit, preferred, chosen, work, point)
    result[rows.R_STATUS] = rows.FREE if met else rows.INFEASIBLE
    result[rows.R_COMMAND] = c_1 + SMOOTHING * (point[0] - c_1)
    result[rows.R_COMMAND + 1] = c_2 + SMOOTHING * (point[1] - c_2)


@njit(cache=True)
def decide_in_worlds(own, deciding, heard, hears, radius_m, error_sum_m, held, room, result):
    for world in range(deciding.shape[0]):
        for i in range(deciding.shape[1]):
            if deciding[world, i]:
                decide(
                    own[world, i], heard[world], hears[world, i], radius_m[world, i], error_sum_m[world, i],
                    held[world, i], room, result[world, i],
                )  # fmt: skip


class FirstForm:
    """Decides for W worlds of N vehicles, in place of the half-planes of `ridlink.avoidance`."""

    def __init__(self, worlds: int, count: int) -> None:
        self._held = np.zeros((worlds, count, count), np.int64)
        lines = new_lines(0, 2 * count)
        self._room = lines, new_choice(lines.shape[1]), new_choice(lines.shape[1])

    def decide(self, own, deciding, heard, present, radius_m, error_sum_m, range_m, result) -> None:
        """Write velocities, commands and status of the deciding into `result`; arguments as of `avoid_worlds`."""
        shape = self._held.shape
        away_m = np.linalg.norm(heard[:, None, :, :2] - own[:, :, None, :2], axis=-1)
        hears = (away_m <= range_m) & present[:, None, :] & ~np.eye(shape[-1], dtype=bool)
        radius_m, error_sum_m = (np.ascontiguousarray(np.broadcast_to(each, shape)) for each in (radius_m, error_sum_m))
        decide_in_worlds(own, deciding, heard, hears, radius_m, error_sum_m, self._held, self._room, result)
