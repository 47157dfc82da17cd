"""Velocities that can be commanded next if commands may change by a limited amount only.

They fill a circle round the last command. The programme takes a polygon within that circle, so that everything stays
linear. At the end, because of rounding and of obstacles that could not be met, the circle itself is applied.

Axes: north-east, m/s.
"""

from __future__ import annotations

import math

from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.programme import BOUND, N_1, N_2, exceeds
from ridlink.avoidance.rows import COMMAND

REACH_SIDES = 32
"""Sides of the polygon that stands for the circle of velocities in reach: half a per cent within it. A multiple of
LANES."""


@kernel(forceinline=True, inner=True)
def reach_half_planes(own, change_mps, lines, first):  # type: ignore[no-untyped-def]
    """Write hard half-planes round the velocities that can be commanded next to `lines`, from column `first` on: the
    sides of a polygon within the circle of velocities no further than `change_mps` from the last command. Returns the
    column after them."""
    for k in range(REACH_SIDES):
        n_1, n_2 = math.cos(2.0 * math.pi / REACH_SIDES * k), math.sin(2.0 * math.pi / REACH_SIDES * k)
        lines[N_1, first + k], lines[N_2, first + k] = n_1, n_2
        apothem = change_mps * math.cos(math.pi / REACH_SIDES)
        lines[BOUND, first + k] = n_1 * own[COMMAND] + n_2 * own[COMMAND + 1] - apothem
    return first + REACH_SIDES


@kernel(forceinline=True, inner=True)
def keep_within(own, change_mps, limit, x):  # type: ignore[no-untyped-def]
    """Take a velocity back within the limit and within reach of the last command; True if it was outside."""
    outside = exceeds(x[0], x[1], limit)
    if outside:
        speed = norm(x[0], x[1])
        x[0], x[1] = x[0] * limit / speed, x[1] * limit / speed
    if math.isinf(change_mps):
        return outside
    off_1, off_2 = x[0] - own[COMMAND], x[1] - own[COMMAND + 1]
    change = norm(off_1, off_2)
    if change > change_mps:
        x[0] = own[COMMAND] + off_1 * change_mps / change
        x[1] = own[COMMAND + 1] + off_2 * change_mps / change
        outside = True
    return outside
