"""Exact two-dimensional programme: the velocity nearest a preferred one in a disc cut by half-planes.

A half-plane is a row (n_1, n_2, d) with a unit normal: velocities x with n.x >= d are allowed. Units are m/s. The
method is the randomised-incremental idea of Seidel as ORCA uses it (van den Berg et al., "Reciprocal n-body collision
avoidance", 2011), in normal form: a new half-plane either keeps the optimum or moves it onto its own edge, which leaves
a problem in one dimension; and when nothing is allowed, the largest excess over all soft half-planes is made as small
as possible, while the hard ones at the head of the list stay as they are.

Compiled by numba; nothing here allocates. With NUMBA_DISABLE_JIT=1 the same functions run as plain Python.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.kernel import kernel, norm

EPSILON = 1e-9
"""Speeds are compared to this, m/s; it is far below what any autopilot resolves."""


@kernel
def optimum_on_edge(lines, index, limit_mps, aim, linear, point):  # type: ignore[no-untyped-def]
    """Best point on the edge of half-plane `index` that meets all earlier ones; False if there is none.

    Args:
        lines: Half-planes, shape (m, 3).
        index: The one whose edge is searched; those before it count.
        limit_mps: Radius of the disc.
        aim: Preferred velocity, or with `linear` the direction to go as far as possible in, shape (2,).
        linear: Which of the two `aim` is.
        point: Result, shape (2,), written only on success.
    """
    n_1, n_2, d = lines[index, 0], lines[index, 1], lines[index, 2]
    room = limit_mps * limit_mps - d * d
    if room < 0.0:
        return False
    along_1, along_2 = -n_2, n_1
    high = math.sqrt(room)
    low = -high
    for j in range(index):
        slope = lines[j, 0] * along_1 + lines[j, 1] * along_2
        rest = lines[j, 2] - d * (lines[j, 0] * n_1 + lines[j, 1] * n_2)
        if abs(slope) <= EPSILON:
            if rest > EPSILON * 10.0:
                return False
            continue
        if slope > 0.0:
            low = max(low, rest / slope)
        else:
            high = min(high, rest / slope)
        if low > high:
            return False
    reach = along_1 * aim[0] + along_2 * aim[1]
    t = (high if reach > 0.0 else low) if linear else min(max(reach, low), high)
    point[0] = n_1 * d + along_1 * t
    point[1] = n_2 * d + along_2 * t
    return True


@kernel
def optimum(lines, count, limit_mps, aim, linear, point):  # type: ignore[no-untyped-def]
    """Best point of the disc within the first `count` half-planes.

    Returns `count` on success, else the index of the first half-plane that could not be met; `point` then is the
    optimum over those before it. Arguments as in `optimum_on_edge`.
    """
    length = norm(aim[0], aim[1])
    scale = limit_mps / length if linear or length > limit_mps else 1.0
    point[0] = aim[0] * scale
    point[1] = aim[1] * scale
    for i in range(count):
        if lines[i, 0] * point[0] + lines[i, 1] * point[1] < lines[i, 2] - EPSILON and not optimum_on_edge(
            lines, i, limit_mps, aim, linear, point
        ):
            return i
    return count


@kernel
def least_excess(lines, hard, count, start, limit_mps, work, point):  # type: ignore[no-untyped-def]
    """Make the largest excess over the soft half-planes `hard..count-1` as small as possible; hard ones stay met.

    Args:
        lines: Half-planes, hard ones first, shape (m, 3).
        hard: Number of hard half-planes; they must have been met by `point`.
        count: Number of half-planes.
        start: First half-plane that `point` fails.
        limit_mps: Radius of the disc.
        work: Scratch, shape (m, 3).
        point: In: optimum before `start`. Out: velocity of least excess.

    Returns:
        That excess, m/s.
    """
    excess = 0.0
    aim = work[count]
    for i in range(start, count):
        n_1, n_2, d = lines[i, 0], lines[i, 1], lines[i, 2]
        if d - (n_1 * point[0] + n_2 * point[1]) <= excess:
            continue
        for k in range(hard):
            work[k, 0], work[k, 1], work[k, 2] = lines[k, 0], lines[k, 1], lines[k, 2]
        used = hard
        for j in range(hard, i):
            # An earlier half-plane may be exceeded, but by no more than this one: d_j - n_j.x <= d_i - n_i.x.
            e_1, e_2 = lines[j, 0] - n_1, lines[j, 1] - n_2
            length = norm(e_1, e_2)
            if length <= EPSILON:
                continue
            work[used, 0], work[used, 1] = e_1 / length, e_2 / length
            work[used, 2] = (lines[j, 2] - d) / length
            used += 1
        kept_1, kept_2 = point[0], point[1]
        aim[0], aim[1] = n_1, n_2
        if optimum(work, used, limit_mps, aim, True, point) < used:
            # The old point is feasible here by construction: only rounding leads to this branch.
            point[0], point[1] = kept_1, kept_2
        excess = max(excess, d - (n_1 * point[0] + n_2 * point[1]))
    return excess


@kernel
def nearest_admissible(lines, hard, count, limit_mps, preferred, work, point):  # type: ignore[no-untyped-def]
    """Velocity nearest `preferred` within all half-planes and the disc, or the one that exceeds the soft ones least.

    Where the hard half-planes contradict each other, all of them are moved back by their least possible excess first.

    Args:
        lines: Half-planes, hard ones first, shape (m, 3) with m > count; hard rows may be moved back.
        hard: Number of hard half-planes.
        count: Number of half-planes.
        limit_mps: Radius of the disc.
        preferred: Preferred velocity, shape (2,).
        work: Scratch, shape (m, 3).
        point: Result, shape (2,).

    Returns:
        True if every half-plane is met as it was given.
    """
    failed = optimum(lines, count, limit_mps, preferred, False, point)
    if failed == count:
        return True
    if failed < hard:
        excess = least_excess(lines, 0, hard, failed, limit_mps, work, point)
        for k in range(hard):
            lines[k, 2] -= excess + 1e3 * EPSILON
        failed = optimum(lines, count, limit_mps, preferred, False, point)
        if failed == count or failed < hard:
            return False
    least_excess(lines, hard, count, failed, limit_mps, work, point)
    return False


def new_lines(count: int) -> np.ndarray:
    """Room for `count` half-planes and two spare rows, one for `least_excess` and one for its caller."""
    return np.zeros((count + 2, 3))
