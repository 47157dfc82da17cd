"""Plain ORCA: what half-planes are without buffers, sides, delays and obstacles, and their peer in the benchmark.

Method: van den Berg et al., "Reciprocal n-body collision avoidance" (2011), as RVO2 does it: neighbours in the order of
their distance, half-planes one after the other, and the largest excess minimised if they allow nothing. In float64,
compiled as our own kernels are.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HORIZON_S, STEP_S = 8.0, 0.1
EPSILON = 1e-9


@njit(cache=True, error_model="numpy")
def half_plane(r_1, r_2, w_1, w_2, radius_m):
    """Unit normal, and the change of the relative velocity along it that leads out of the velocity obstacle."""
    square = r_1 * r_1 + r_2 * r_2
    if square > radius_m * radius_m:
        o_1, o_2 = w_1 - r_1 / HORIZON_S, w_2 - r_2 / HORIZON_S
        towards, length_square = r_1 * o_1 + r_2 * o_2, o_1 * o_1 + o_2 * o_2
        if towards < 0.0 and towards * towards > radius_m * radius_m * length_square:
            length = math.sqrt(length_square)
            return o_1 / length, o_2 / length, radius_m / HORIZON_S - length
        leg = math.sqrt(square - radius_m * radius_m)
        if r_1 * o_2 - r_2 * o_1 >= 0.0:
            n_1, n_2 = -(r_1 * radius_m + r_2 * leg) / square, (r_1 * leg - r_2 * radius_m) / square
        else:
            n_1, n_2 = (r_2 * leg - r_1 * radius_m) / square, -(r_2 * radius_m + r_1 * leg) / square
        return n_1, n_2, -(n_1 * w_1 + n_2 * w_2)
    o_1, o_2 = w_1 - r_1 / STEP_S, w_2 - r_2 / STEP_S
    length = max(math.sqrt(o_1 * o_1 + o_2 * o_2), EPSILON)
    return o_1 / length, o_2 / length, radius_m / STEP_S - length


@njit(cache=True, error_model="numpy")
def on_edge(lines, index, limit, aim_1, aim_2, towards, point):
    """Best point on the edge of one half-plane within those before it; nearest the aim, or furthest towards it."""
    n_1, n_2, bound = lines[index, 0], lines[index, 1], lines[index, 2]
    room = limit * limit - bound * bound
    if room < 0.0:
        return False
    high = math.sqrt(room)
    low = -high
    for j in range(index):
        slope = lines[j, 1] * n_1 - lines[j, 0] * n_2
        rest = lines[j, 2] - bound * (lines[j, 0] * n_1 + lines[j, 1] * n_2)
        if abs(slope) <= EPSILON:
            if rest > EPSILON:
                return False
            continue
        if slope > 0.0:
            low = max(low, rest / slope)
        else:
            high = min(high, rest / slope)
        if low > high:
            return False
    reach = aim_2 * n_1 - aim_1 * n_2
    t = (high if reach > 0.0 else low) if towards else min(max(reach, low), high)
    point[0], point[1] = n_1 * bound - n_2 * t, n_2 * bound + n_1 * t
    return True


@njit(cache=True, error_model="numpy")
def nearest(lines, count, limit, aim_1, aim_2, towards, point):
    """Solve for the first `count` half-planes; returns the first that cannot be met, `count` if there is none."""
    size = math.sqrt(aim_1 * aim_1 + aim_2 * aim_2)
    scale = limit / size if towards or size > limit else 1.0
    point[0], point[1] = aim_1 * scale, aim_2 * scale
    for i in range(count):
        if lines[i, 0] * point[0] + lines[i, 1] * point[1] < lines[i, 2]:
            kept_1, kept_2 = point[0], point[1]
            if not on_edge(lines, i, limit, aim_1, aim_2, towards, point):
                point[0], point[1] = kept_1, kept_2
                return i
    return count


@njit(cache=True, error_model="numpy")
def least_bad(lines, count, begin, limit, work, point):
    """Minimise the largest excess, from the first half-plane on that cannot be met."""
    excess = 0.0
    for i in range(begin, count):
        n_1, n_2, bound = lines[i, 0], lines[i, 1], lines[i, 2]
        if bound - (n_1 * point[0] + n_2 * point[1]) <= excess:
            continue
        used = 0
        for j in range(i):
            e_1, e_2 = lines[j, 0] - n_1, lines[j, 1] - n_2
            length = math.sqrt(e_1 * e_1 + e_2 * e_2)
            if length <= EPSILON:
                continue
            work[used, 0], work[used, 1], work[used, 2] = e_1 / length, e_2 / length, (lines[j, 2] - bound) / length
            used += 1
        kept_1, kept_2 = point[0], point[1]
        if nearest(work, used, limit, n_1, n_2, True, point) < used:
            point[0], point[1] = kept_1, kept_2
        excess = bound - (n_1 * point[0] + n_2 * point[1])


@njit(cache=True, error_model="numpy")
def decide(own, place, flown, aim, radius_m, me, limit, room, point):
    """One decision among all others of a world."""
    order, squares, lines, work = room
    count = 0
    for j in range(len(place)):
        if j == me:
            continue
        square = (place[j, 0] - own[0]) ** 2 + (place[j, 1] - own[1]) ** 2
        k = count
        while k > 0 and squares[k - 1] > square:
            order[k], squares[k] = order[k - 1], squares[k - 1]
            k -= 1
        order[k], squares[k] = j, square
        count += 1
    v_1, v_2 = flown[me, 0], flown[me, 1]
    for k in range(count):
        j = order[k]
        r_1, r_2 = place[j, 0] - own[0], place[j, 1] - own[1]
        n_1, n_2, change = half_plane(r_1, r_2, v_1 - flown[j, 0], v_2 - flown[j, 1], radius_m)
        lines[k, 0], lines[k, 1], lines[k, 2] = n_1, n_2, n_1 * v_1 + n_2 * v_2 + 0.5 * change
    met = nearest(lines, count, limit, aim[0], aim[1], False, point)
    if met < count:
        least_bad(lines, count, met, limit, work, point)


@njit(cache=True, error_model="numpy")
def decide_in_worlds(place, flown, deciding, radius_m, limit, room, velocity):
    """Decisions of W worlds of N vehicles that like their velocities; arrays have the shape (W, N, 2) or (W, N)."""
    for world in range(place.shape[0]):
        for i in range(place.shape[1]):
            if deciding[world, i]:
                decide(
                    place[world, i], place[world], flown[world], flown[world, i], radius_m, i, limit, room,
                    velocity[world, i],
                )  # fmt: skip


class Orca:
    """The same step of W worlds of N vehicles again and again.

    Args:
        place, flown: Positions and velocities, shape (W, N, 2); what is flown is preferred, too.
        deciding: Who decides, shape (W, N).
        radius_m: Radius of the disc of a pair.
        limit: Limit of speed.
    """

    def __init__(
        self, place: np.ndarray, flown: np.ndarray, deciding: np.ndarray, radius_m: float, limit: float
    ) -> None:
        count = place.shape[1]
        self.decisions = int(deciding.sum())
        self.velocity = np.zeros_like(place)
        self._given = np.ascontiguousarray(place), np.ascontiguousarray(flown), deciding, radius_m, limit
        self._room = np.zeros(count, np.int64), np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3))

    def step(self) -> np.ndarray:
        """Decide; returns velocities, shape (W, N, 2), zero for those that do not decide."""
        decide_in_worlds(*self._given, self._room, self.velocity)
        return self.velocity
