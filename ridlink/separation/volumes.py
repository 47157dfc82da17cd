"""Collision and near-collision volumes of one pair of vehicles: diameters and radii in metres.

Source: paper, Eq. 5 to 9. Two readings are stated here once. The equations sum *diameters*; every distance between
centres is compared with the *radius*, half of that (Eq. 8), so
`r_uNMAC = (AF_i + AF_j)/2 + eps_i + eps_j + dt (v_i + v_j)`. Eq. 6, known direction of motion, adds the displacement
`v dt` once along the motion, not on both sides: the diameter grows by half as much as with unknown direction, and the
volume is no longer centred on the report.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def checked_lengths(name: str, values: ArrayLike) -> FloatArray:
    """Lengths as an array.

    Raises:
        ValueError: If a value is negative or not finite; it is named.
    """
    array = np.asarray(values, dtype=np.float64)
    allowed = np.isfinite(array) & (array >= 0.0)
    if not np.all(allowed):
        raise ValueError(f"{name} must be finite and not negative, got {array[~allowed].flat[0]:g}")
    return array


def _pairs(name: str, values: ArrayLike) -> FloatArray:
    array = checked_lengths(name, values)
    if array.ndim == 0 or array.shape[-1] != 2:
        raise ValueError(f"{name} needs a last axis of 2, one value for each vehicle, got shape {array.shape}")
    return array


def mac_radius(airframe_m: ArrayLike) -> FloatArray:
    """Distance between centres below which two airframes touch [m].

    Source: paper Eq. 9 (eq:MAC), half the sum of two diameters.

    Args:
        airframe_m: Airframe sizes (diameters) of both vehicles, shape (..., 2).

    Returns:
        Radius, shape (...).

    Raises:
        ValueError: If a size is negative or not finite.
    """
    return np.asarray(_pairs("airframe_m", airframe_m).sum(axis=-1) / 2.0)


def uncertainty_diameter(
    airframe_m: ArrayLike,
    error_bound_m: ArrayLike,
    speed_mps: ArrayLike,
    interval_s: ArrayLike,
    *,
    direction_known: bool = False,
) -> FloatArray:
    """Diameter of the area in which one vehicle may be [m].

    Source: paper Eq. 5 (eq:d_unmac); with `direction_known` Eq. 6.

    Args:
        airframe_m: Airframe size (diameter); all arguments broadcast.
        error_bound_m: Localization error bound, three sigma or reported.
        speed_mps: Ground speed.
        interval_s: Time between two Remote ID messages.
        direction_known: Count the displacement once, ahead of the vehicle, and not on both sides.

    Raises:
        ValueError: If any length, speed or interval is negative or not finite.
    """
    sides = 1.0 if direction_known else 2.0
    flown = checked_lengths("interval_s", interval_s) * checked_lengths("speed_mps", speed_mps)
    error = checked_lengths("error_bound_m", error_bound_m)
    return np.asarray(checked_lengths("airframe_m", airframe_m) + 2.0 * error + sides * flown)


def unmac_diameter(
    airframe_m: ArrayLike,
    error_bound_m: ArrayLike,
    speed_mps: ArrayLike,
    interval_s: ArrayLike,
    *,
    direction_known: bool = False,
) -> FloatArray:
    """Pairwise uNMAC diameter [m].

    Source: paper Eq. 7 (eq:d_uNMAC); with `direction_known` the sum of two Eq. 6.

    Args:
        airframe_m: Airframe sizes (diameters) of both vehicles, shape (..., 2).
        error_bound_m: Localization error bounds, three sigma or reported, shape (..., 2).
        speed_mps: Ground speeds, shape (..., 2).
        interval_s: Time between two Remote ID messages, scalar or shape (...).
        direction_known: Count the displacement once, ahead of the vehicle, and not on both sides.

    Returns:
        Diameter, shape (...).

    Raises:
        ValueError: If any length, speed or interval is negative or not finite.
    """
    airframe = _pairs("airframe_m", airframe_m)
    error = _pairs("error_bound_m", error_bound_m)
    speed = _pairs("speed_mps", speed_mps)
    interval = checked_lengths("interval_s", interval_s)[..., None]
    return np.asarray(
        uncertainty_diameter(airframe, error, speed, interval, direction_known=direction_known).sum(axis=-1)
    )


def unmac_radius(
    airframe_m: ArrayLike,
    error_bound_m: ArrayLike,
    speed_mps: ArrayLike,
    interval_s: ArrayLike,
    *,
    direction_known: bool = False,
) -> FloatArray:
    """Separation of centres that keeps two uncertainty areas apart [m].

    Source: paper Eq. 8 (eq:separation), half of `unmac_diameter`. Arguments and errors as for that.

    Returns:
        Radius, shape (...).
    """
    diameter = unmac_diameter(airframe_m, error_bound_m, speed_mps, interval_s, direction_known=direction_known)
    return np.asarray(diameter / 2.0)
