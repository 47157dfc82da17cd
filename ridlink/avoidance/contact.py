"""Firm half-planes that keep own-ship out of a disc for one step, whatever else is asked.

If no velocity meets every half-plane of the horizon, the least-violation rule would trade a touch for a conflict far
away. Between vehicles that obey at once, avoid each other and know where they are, it need not: each keeps to its half
of what the two may approach in a step, and standing still always does. So these half-planes have a common solution
however dense the crowd, and no step leads into a disc, nor further into one.

Axes: north-east, metres, m/s, seconds; columns as in `rows`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.encounter import EPSILON
from ridlink.avoidance.kernel import kernel, larger, smaller
from ridlink.avoidance.programme import BOUND, N_1, N_2
from ridlink.avoidance.rows import (
    ERROR_SUM,
    GAP,
    LANES,
    LIMIT,
    N_POSITION,
    N_VELOCITY,
    NOW,
    POSITION,
    RECIPROCAL,
    VELOCITY,
)


@kernel(forceinline=True, inner=True)
def is_in_contact(block, lane, reach):  # type: ignore[no-untyped-def]
    """Whether two vehicles that avoid, with exact positions, can be inside each other's disc a step from now."""
    exact = (block[RECIPROCAL + lane] != 0.0) & (block[ERROR_SUM + lane] == 0.0)
    return exact & (block[GAP + lane] < reach)


@kernel(inner=True)
def contact_half_planes(own, neighbours, count, candidates, found, step_s, lines, last):  # type: ignore[no-untyped-def]
    """Write firm half-planes that keep a pair's discs apart for one step, if both keep to theirs, to the columns of
    `lines` before `last`; returns the first of these columns.

    Along the line between the two, own-ship may use half of the gap and the neighbour the other half. Both halves move
    with what the pair flies in common, but never so far that one of the two could not stand still. So if all stand
    still they meet all half-planes at once, however many there are. Inside a disc neither comes nearer.

    Only discs without a part for errors are held so: one that is wider than the truth may be entered a little, and
    standing still would lose more. If a neighbour that avoids nobody is about there are none: nothing is then worth
    more than to keep away from it.
    """
    limit = own[LIMIT]
    p_1, p_2, v_1, v_2 = own[POSITION], own[POSITION + 1], own[VELOCITY], own[VELOCITY + 1]
    reach, half_step = 2.0 * limit * step_s, 0.5 / step_s
    for b in range(-(-found // LANES)):
        for k in range(LANES):
            if candidates[b, NOW + 2 * LANES + k] > -limit and candidates[b, RECIPROCAL + k] == 0.0:
                return last
    first = last
    for b in range(count):
        block, near = neighbours[b], False
        for k in range(LANES):
            near |= is_in_contact(block, k, reach)
        if not near:
            continue
        first -= LANES
        for k in range(LANES):
            out_1, out_2 = p_1 - block[N_POSITION + k], p_2 - block[N_POSITION + LANES + k]
            distance = math.sqrt(out_1 * out_1 + out_2 * out_2)
            n_1, n_2 = out_1 / larger(distance, EPSILON), out_2 / larger(distance, EPSILON)
            gap = block[GAP + k]
            most = half_step * larger(gap, 0.0)
            common = n_1 * (v_1 + block[N_VELOCITY + k]) + n_2 * (v_2 + block[N_VELOCITY + LANES + k])
            bound = smaller(larger(0.5 * common, -most), most) - most
            matters = is_in_contact(block, k, reach) & (distance > EPSILON)
            lines[N_1, first + k], lines[N_2, first + k] = n_1, n_2
            lines[BOUND, first + k] = bound if matters else -math.inf
    return first
