"""Heights: how far above or below another vehicle must be known to fly before the two need not avoid each other.

The bound of a pair is the sum of

- both vertical errors, three standard deviations each,
- half of both airframe heights,
- what the present climb rates of both take away from the gap within the conflict horizon, and
- a reserve for a climb that has not begun yet, which grows while the neighbour is not heard.

Both vehicles calculate the same bound. Anything unknown makes it infinite. Heights above different references (the
ellipsoid, mean sea level, standard pressure, take-off, ground) cannot be compared, and a neighbour that cannot be
compared counts as at our height. Metres and m/s, positive upwards; unknown is NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

RESERVE_M = 10.0
"""A climb of 2 m/s that begins now, and five seconds to see it and to fly round. Without it a level pair would leave
the bound at the very moment in which that can first be seen."""

UNHEARD_CLIMB_MPS = 2.0
"""The same climb, for as long as the neighbour was not heard."""


def vertical_bound(
    above_m: ArrayLike,
    *,
    error_m: tuple[ArrayLike, ArrayLike],
    height_m: tuple[ArrayLike, ArrayLike],
    climb_mps: tuple[ArrayLike, ArrayLike],
    age_s: ArrayLike = 0.0,
    horizon_s: float = 0.0,
    reserve_m: float = RESERVE_M,
) -> FloatArray:
    """Gap in height beyond which a pair need not avoid each other [m], infinite if anything is unknown.

    Args:
        above_m: Height of the neighbour above own-ship now, NaN if unknown.
        error_m: Vertical errors, own and the neighbour's, three standard deviations.
        height_m: Vertical extents of the airframes, own and the neighbour's.
        climb_mps: Climb rates, own and the neighbour's.
        age_s: Time for which the neighbour was not heard.
        horizon_s: How long climb rates are taken to last; 0 for the present bound.
        reserve_m: Reserve for a climb that has not begun.

    Returns:
        Bound, in the shape of the arguments broadcast together.
    """
    above = np.asarray(above_m, dtype=np.float64)
    own_climb, climb = (np.asarray(each, dtype=np.float64) for each in climb_mps)
    parts = [np.asarray(each, dtype=np.float64) for each in (*error_m, *height_m)]
    known = np.isfinite(above) & np.isfinite(own_climb) & np.isfinite(climb)
    closing = np.maximum(-np.sign(above) * np.where(known, climb - own_climb, 0.0), 0.0)
    bound = parts[0] + parts[1] + (parts[2] + parts[3]) / 2.0 + closing * horizon_s
    bound = bound + reserve_m + UNHEARD_CLIMB_MPS * np.asarray(age_s, dtype=np.float64)
    # An error or a height below zero counts as unknown.
    sound = known & np.isfinite(bound) & np.all(np.broadcast_arrays(*(part >= 0.0 for part in parts)), axis=0)
    return np.asarray(np.where(sound, bound, np.inf))


def known_apart(above_m: ArrayLike, bound_m: ArrayLike) -> BoolArray:
    """Whether a neighbour is known to be further above or below than the bound; False if the height is unknown."""
    return np.asarray(np.abs(np.asarray(above_m, dtype=np.float64)) > np.asarray(bound_m, dtype=np.float64))
