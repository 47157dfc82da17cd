"""Exact two-dimensional programme: the velocity nearest a preferred one in a disc cut by half-planes.

A half-plane (n_1, n_2, d) has a unit normal: velocities x with n.x >= d are allowed; d - n.x is by how much x exceeds
it. Units are m/s. The method is the incremental idea of Seidel as ORCA uses it (van den Berg et al., "Reciprocal n-body
collision avoidance", 2011), in normal form: a new half-plane either keeps the optimum or moves it onto its own edge,
which leaves a problem in one dimension. Any order of the half-planes will do. Here the next one is always that which is
exceeded most: a handful of rounds find those that matter, and only these ever meet each other, however many there are.
When nothing is allowed, the largest excess over all soft half-planes is made as small as possible in the same way,
while the hard ones at the head of the list stay as they are.

Half-planes to choose from come as `lines`, a row for each of n_1, n_2, d, and one for the excess; chosen ones as one
row each. Compiled by numba; nothing here allocates. With NUMBA_DISABLE_JIT=1 the same functions run as plain Python.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.lanes import exceed, lanes_from, lowest_bit
from ridlink.avoidance.rows import LANES, aligned

EPSILON = 1e-9
"""Speeds are compared to this, m/s; it is far below what any autopilot resolves."""

# Rows of `lines`.
N_1, N_2, BOUND, EXCESS = range(4)


WITHIN = 1.0 + 1e-12
"""Rounding of a square. Half of all velocities at a limit come out above it, and which ones nobody can foretell."""


@kernel(forceinline=True, inner=True)
def exceeds(x_1, x_2, limit_mps):  # type: ignore[no-untyped-def]
    """Whether a velocity is above a limit by more than rounding makes of one that is at it."""
    return x_1 * x_1 + x_2 * x_2 > WITHIN * limit_mps * limit_mps


@kernel(forceinline=True, inner=True)
def optimum_on_edge(chosen, index, limit_mps, aim, linear, point):  # type: ignore[no-untyped-def]
    """Best point on the edge of half-plane `index` that meets all earlier ones; False if there is none.

    Args:
        chosen: Half-planes, shape (m, 3).
        index: The one whose edge is searched; those before it count.
        limit_mps: Radius of the disc.
        aim: Preferred velocity, or with `linear` the direction to go as far as possible in, shape (2,).
        linear: Which of the two `aim` is.
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
    """Point of the disc nearest a velocity, shape (2,)."""
    point[0], point[1] = preferred[0], preferred[1]
    if exceeds(preferred[0], preferred[1], limit_mps):
        scale = limit_mps / norm(preferred[0], preferred[1])
        point[0], point[1] = preferred[0] * scale, preferred[1] * scale


@kernel(forceinline=True, inner=True)
def furthest(chosen, count, limit_mps, direction, point):  # type: ignore[no-untyped-def]
    """Furthest point of the disc in a direction, a unit vector, within the first `count` of a few half-planes; False if
    there is none.

    Arguments as in `optimum_on_edge`.
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
    """Fill in by how much a velocity exceeds half-planes `first..last-1`; the largest excess, minus infinity of none.

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
    # What is measured is filled up to a multiple of LANES, and nothing exceeds the largest excess.
    k = first
    bits = lanes_from(lines[EXCESS], k, excess)
    while bits == 0:
        k += LANES
        bits = lanes_from(lines[EXCESS], k, excess)
    k += lowest_bit(bits)
    chosen[place, 0], chosen[place, 1], chosen[place, 2] = lines[N_1, k], lines[N_2, k], lines[BOUND, k]


@kernel(forceinline=True, inner=True)
def nearest(lines, first, last, limit_mps, preferred, chosen, point):  # type: ignore[no-untyped-def]
    """Best point of the disc within half-planes `first..last-1`, or some point if there is none.

    Arguments as in `least_bad`.

    Returns:
        True if there is one; then also the largest excess over these half-planes, all of which are measured there.
    """
    unconstrained(limit_mps, preferred, point)
    worst = measure(lines, first, last, point[0], point[1])
    # A half-plane is chosen but once, except by rounding where two of them are all but parallel.
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
    """Whether there is a point that `nearest` finds."""
    met, _ = nearest(lines, first, last, limit_mps, preferred, chosen, point)
    return met


@kernel(inner=True)
def least_excess(lines, hard, met, first, last, limit_mps, chosen, work, point):  # type: ignore[no-untyped-def]
    """Make the largest excess over half-planes `first..last-1` as small as possible while others stay met.

    Args:
        lines: Half-planes, shape (4, m).
        hard: Index of the first of those that stay met; `point` must meet them.
        met: Index after the last one of them.
        first: Index of the first one whose excess counts.
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
    """Move half-planes `first..last-1` back by so much, and by what rounding takes."""
    for k in range(first, last):
        lines[BOUND, k] -= excess + 1e3 * EPSILON


@kernel(inner=True)
def least_bad(  # type: ignore[no-untyped-def]
    lines, begin, hard, first, last, limit_mps, preferred, chosen, work, point
):
    """Velocity in the disc that exceeds half-planes least, where `nearest` finds none that meets them all.

    There are three ranks: soft half-planes are exceeded, as little as can be, before firm ones are, and those before
    hard ones. Firm or hard ones that contradict each other, or those above them, are all moved back by their least
    possible excess first.

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
    """Velocity nearest `preferred` within all half-planes and the disc, or the least bad one; arguments as there.

    Returns:
        True if every half-plane is met as it was given.
    """
    if is_met(lines, begin, last, limit_mps, preferred, chosen, point):
        return True
    least_bad(lines, begin, hard, first, last, limit_mps, preferred, chosen, work, point)
    return False


def padded(count: int) -> int:
    """The next multiple of LANES: soft half-planes begin at one, and hard ones are followed by some that do nothing."""
    return -(-count // LANES) * LANES


def new_lines(hard: int, soft: int, firm: int = 0) -> np.ndarray:
    """Room for so many half-planes, shape (4, m), none of which forbids anything."""
    lines = aligned(np.zeros((4, padded(firm) + padded(hard) + padded(soft))))
    lines[BOUND] = -np.inf
    return lines


def new_choice(columns: int) -> np.ndarray:
    """Room for the choices that `nearest_admissible` makes among so many columns of lines, and for two spare rows, one
    of them its caller's, shape (m + 2, 3)."""
    return np.zeros((columns + 2, 3))
