"""Exact two-dimensional programme: the velocity nearest a preferred one in a disc cut by half-planes.

A half-plane (n_1, n_2, d) has a unit normal and allows velocities x with n.x >= d; d - n.x is the excess of x. Units
are m/s. The method is Seidel's incremental one as ORCA uses it (van den Berg et al., "Reciprocal n-body collision
avoidance", 2011), in normal form: a new half-plane either keeps the optimum or moves it onto its own edge, which leaves
a problem in one dimension. Any order will do; here the next half-plane is always the one exceeded most. A handful of
rounds find those that matter, and only these are compared with each other, however many there are. If nothing is
allowed, the largest excess over all soft half-planes is minimised in the same way, while the hard ones at the head of
the list stay as they are.

Half-planes to choose from are `lines`, a row for each of n_1, n_2, d and the excess; chosen ones are one row each.
Compiled by numba; nothing here allocates. With NUMBA_DISABLE_JIT=1 the same functions run as plain Python.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.lanes import exceed, lanes_from, lowest_bit
from ridlink.avoidance.rows import LANES, aligned

EPSILON = 1e-9
"""Tolerance of speeds [m/s], far below what any autopilot resolves."""

# Rows of `lines`.
N_1, N_2, BOUND, EXCESS = range(4)


WITHIN = 1.0 + 1e-12
"""Tolerance of a square: by rounding, half of all velocities at a limit come out above it, unpredictably."""


@kernel(forceinline=True, inner=True)
def exceeds(x_1, x_2, limit_mps):  # type: ignore[no-untyped-def]
    """Whether a velocity is above a limit by more than rounding can make of one at the limit."""
    return x_1 * x_1 + x_2 * x_2 > WITHIN * limit_mps * limit_mps


@kernel(forceinline=True, inner=True)
def optimum_on_edge(chosen, index, limit_mps, aim, linear, point):  # type: ignore[no-untyped-def]
    """Find the best point on the edge of half-plane `index` that meets all earlier ones; False if there is none.

    Args:
        chosen: Half-planes, shape (m, 3).
        index: Half-plane whose edge is searched; those before it count.
        limit_mps: Radius of the disc.
        aim: Preferred velocity, or with `linear` the direction to go as far as possible in, shape (2,).
        linear: True if `aim` is a direction.
        point: Result, shape (2,), written only on success.
    """
    n_1, n_2, d = chosen[index, 0], chosen[index, 1], chosen[index, 2]
    room = limit_mps * limit_mps - d * d
    if room < 0.0:
        return False
    along_1, along_2 = -n_2, n_1
    high = math.sqrt(room)
    low = -high
    for j in range(index):
        slope = chosen[j, 0] * along_1 + chosen[j, 1] * along_2
        rest = chosen[j, 2] - d * (chosen[j, 0] * n_1 + chosen[j, 1] * n_2)
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


@kernel(forceinline=True, inner=True)
def unconstrained(limit_mps, preferred, point):  # type: ignore[no-untyped-def]
    """Write the point of the disc nearest a preferred velocity to `point`, both of shape (2,)."""
    point[0], point[1] = preferred[0], preferred[1]
    if exceeds(preferred[0], preferred[1], limit_mps):
        scale = limit_mps / norm(preferred[0], preferred[1])
        point[0], point[1] = preferred[0] * scale, preferred[1] * scale


@kernel(forceinline=True, inner=True)
def furthest(chosen, count, limit_mps, direction, point):  # type: ignore[no-untyped-def]
    """Find the furthest point of the disc in a direction (unit vector) within the first `count` of a few half-planes.

    Returns False if there is none. Arguments as in `optimum_on_edge`.
    """
    point[0], point[1] = limit_mps * direction[0], limit_mps * direction[1]
    for i in range(count):
        if chosen[i, 0] * point[0] + chosen[i, 1] * point[1] < chosen[i, 2] - EPSILON and not optimum_on_edge(
            chosen, i, limit_mps, direction, True, point
        ):
            return False
    return True


@kernel(forceinline=True, inner=True)
def measure(lines, first, last, x_1, x_2):  # type: ignore[no-untyped-def]
    """Fill in the excess of a velocity over half-planes `first..last-1`; returns the largest, minus infinity of none.

    Args:
        lines: Half-planes, shape (4, m).
        first: Index of the first.
        last: Index after the last.
        x_1: North of the velocity.
        x_2: East of it.
    """
    return exceed(lines, first, last, x_1, x_2)


@kernel(forceinline=True, inner=True)
def choose(lines, first, excess, chosen, place):  # type: ignore[no-untyped-def]
    """Copy the first half-plane with that excess, as `measure` left it, to a row of `chosen`."""
    # Measured columns are filled up to a multiple of LANES, and no excess is above the largest.
    k = first
    bits = lanes_from(lines[EXCESS], k, excess)
    while bits == 0:
        k += LANES
        bits = lanes_from(lines[EXCESS], k, excess)
    k += lowest_bit(bits)
    chosen[place, 0], chosen[place, 1], chosen[place, 2] = lines[N_1, k], lines[N_2, k], lines[BOUND, k]


@kernel(forceinline=True, inner=True)
def nearest(lines, first, last, limit_mps, preferred, chosen, point):  # type: ignore[no-untyped-def]
    """Find the best point of the disc within half-planes `first..last-1`, or some point if there is none.

    Arguments as in `least_bad`.

    Returns:
        Whether there is one, and the largest excess; if there is one, all these half-planes are measured at it.
    """
    unconstrained(limit_mps, preferred, point)
    worst = measure(lines, first, last, point[0], point[1])
    # A half-plane is chosen only once, except by rounding if two of them are almost parallel.
    for place in range(last - first):
        if worst <= EPSILON:
            break
        choose(lines, first, worst, chosen, place)
        if not optimum_on_edge(chosen, place, limit_mps, preferred, False, point):
            return False, worst
        worst = measure(lines, first, last, point[0], point[1])
    return True, worst


@kernel(inner=True)
def is_met(lines, first, last, limit_mps, preferred, chosen, point):  # type: ignore[no-untyped-def]
    """Whether `nearest` finds a point within all half-planes."""
    met, _ = nearest(lines, first, last, limit_mps, preferred, chosen, point)
    return met


@kernel(inner=True)
def least_excess(lines, hard, met, first, last, limit_mps, chosen, work, point):  # type: ignore[no-untyped-def]
    """Find the velocity of least largest excess over half-planes `first..last-1`, while others stay met.

    Args:
        lines: Half-planes, shape (4, m).
        hard: Index of the first half-plane that stays met; `point` must meet these.
        met: Index after the last one of them.
        first: Index of the first half-plane whose excess counts.
        last: Index after the last one.
        limit_mps: Radius of the disc.
        chosen: Scratch, shape (m + 2, 3).
        work: Scratch of the same shape.
        point: In: any point that meets the hard ones. Out: velocity of least excess.

    Returns:
        That excess, m/s; zero if there is none.
    """
    excess = 0.0
    aim = work[len(work) - 2]
    kept = 0
    for k in range(hard, met):
        if lines[BOUND, k] > -math.inf:
            work[kept, 0], work[kept, 1], work[kept, 2] = lines[N_1, k], lines[N_2, k], lines[BOUND, k]
            kept += 1
    for place in range(last - first):
        worst = measure(lines, first, last, point[0], point[1])
        if worst <= excess + EPSILON:
            break
        choose(lines, first, worst, chosen, place)
        n_1, n_2, d = chosen[place, 0], chosen[place, 1], chosen[place, 2]
        used = kept
        for j in range(place):
            # One chosen earlier may be exceeded, but by no more than this one: d_j - n_j.x <= d_i - n_i.x.
            e_1, e_2 = chosen[j, 0] - n_1, chosen[j, 1] - n_2
            length = norm(e_1, e_2)
            if length <= EPSILON:
                continue
            once_per = 1.0 / length
            work[used, 0], work[used, 1] = e_1 * once_per, e_2 * once_per
            work[used, 2] = (chosen[j, 2] - d) * once_per
            used += 1
        kept_1, kept_2 = point[0], point[1]
        aim[0], aim[1] = n_1, n_2
        if not furthest(work, used, limit_mps, aim, point):
            # The old point is feasible here by construction: only rounding leads to this branch.
            point[0], point[1] = kept_1, kept_2
        excess = max(excess, d - (n_1 * point[0] + n_2 * point[1]))
    return excess


@kernel(forceinline=True, inner=True)
def move_back(lines, first, last, excess):  # type: ignore[no-untyped-def]
    """Move half-planes `first..last-1` back by an excess, and a little more for rounding."""
    for k in range(first, last):
        lines[BOUND, k] -= excess + 1e3 * EPSILON


@kernel(inner=True)
def least_bad(  # type: ignore[no-untyped-def]
    lines, begin, hard, first, last, limit_mps, preferred, chosen, work, point
):
    """Find the velocity in the disc that exceeds half-planes least, if `nearest` finds none that meets all.

    There are three ranks: soft half-planes are exceeded before firm ones, and firm before hard ones, as little as
    possible. If firm or hard ones contradict each other, or firm ones the hard, all of the rank are first moved back by
    their least possible excess.

    Args:
        lines: Half-planes, shape (4, m): from `begin` firm ones, from `hard` hard ones, from `first` soft ones. All but
            the soft ones may be moved back.
        begin: Index of the first firm one.
        hard: Index of the first hard one, after the last firm one.
        first: Index of the first soft one, after the last hard one.
        last: Index after the last one.
        limit_mps: Radius of the disc.
        preferred: Preferred velocity, shape (2,).
        chosen: Scratch, shape (m + 2, 3).
        work: Scratch of the same shape.
        point: In: a point of the disc, as `nearest` leaves it. Out: that velocity, shape (2,).
    """
    if begin < first and not is_met(lines, begin, first, limit_mps, preferred, chosen, point):
        if not is_met(lines, hard, first, limit_mps, preferred, chosen, point):
            move_back(lines, hard, first, least_excess(lines, hard, hard, hard, first, limit_mps, chosen, work, point))
            is_met(lines, hard, first, limit_mps, preferred, chosen, point)
        if begin < hard:
            excess = least_excess(lines, hard, first, begin, hard, limit_mps, chosen, work, point)
            move_back(lines, begin, hard, excess)
        if is_met(lines, begin, last, limit_mps, preferred, chosen, point):
            return
        is_met(lines, begin, first, limit_mps, preferred, chosen, point)
    least_excess(lines, begin, first, first, last, limit_mps, chosen, work, point)


@kernel(inner=True)
def nearest_admissible(  # type: ignore[no-untyped-def]
    lines, begin, hard, first, last, limit_mps, preferred, chosen, work, point
):
    """Find the velocity nearest `preferred` within all half-planes and the disc, or the least bad one.

    Arguments as in `least_bad`.

    Returns:
        True if every half-plane is met as it was given.
    """
    if is_met(lines, begin, last, limit_mps, preferred, chosen, point):
        return True
    least_bad(lines, begin, hard, first, last, limit_mps, preferred, chosen, work, point)
    return False


def padded(count: int) -> int:
    """The next multiple of LANES: soft half-planes begin at one, and columns between hard and soft ones forbid
    nothing."""
    return -(-count // LANES) * LANES


def new_lines(hard: int, soft: int, firm: int = 0) -> np.ndarray:
    """Room for so many half-planes, shape (4, m), none of which forbids anything."""
    lines = aligned(np.zeros((4, padded(firm) + padded(hard) + padded(soft))))
    lines[BOUND] = -np.inf
    return lines


def new_choice(columns: int) -> np.ndarray:
    """Scratch for the choices of `nearest_admissible` among `columns` of lines, shape (m + 2, 3): two rows are spare,
    one of them for the caller."""
    return np.zeros((columns + 2, 3))
