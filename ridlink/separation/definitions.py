"""Separation definitions: what two vehicles report -> radius of the disc that must stay empty, metres.

Source: paper, section VI-B and Table IV (its figures are diameters of a pair; ours are radii, see `volumes`).
Unknown is NaN and becomes the standard's upper bound, never zero: 40 m of error, 7.5 m of airframe, 30.7 m/s of speed.
Values come from strangers, so they are clamped here and nothing raises on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.separation.reference import (
    AIRFRAME_CAP_M,
    ERROR_CAP_M,
    MAX_AIRFRAME_M,
    MIN_AIRFRAME_M,
    REPORT_INTERVAL_S,
    SNMAC_PAIR_RADIUS_M,
    SPEED_CAP_MPS,
    UNKNOWN_ERROR_BOUND_M,
    UNKNOWN_SPEED_MPS,
)

FloatArray = NDArray[np.float64]


class Definition(StrEnum):
    """Which fields of a report size the disc of a pair.

    SNMAC: a fixed radius of 15 m. Guarantees nothing about position errors: two vehicles that keep it by their reports
        may collide once the errors add up to more than 15 m less the airframes.
    REMOTE_ID: the worst of everything that standard Remote ID allows, 40 m of error and 7.5 m of airframe each. Keeps
        airframes apart for any error within 40 m, at the largest price in airspace.
    ODID_ACCURACY: largest airframe, and the error bound behind the accuracy code that standard Remote ID already
        carries. As good as the code, which is coarse and often filled with an unscaled one-sigma figure.
    CANDIDATE1: largest airframe, reported three-sigma error. Keeps airframes apart while both errors are within their
        reported bounds (98.9 % of positions each, for errors normal on both axes).
    CANDIDATE2: reported airframe, reported three-sigma error. The same statement with the true size of both airframes.
    """

    SNMAC = "snmac"
    REMOTE_ID = "remote-id"
    ODID_ACCURACY = "odid-accuracy"
    CANDIDATE1 = "candidate1"
    CANDIDATE2 = "candidate2"


@dataclass(frozen=True, slots=True)
class Discs:
    """Discs of one vehicle against n others.

    Attributes:
        radius_m: Radius of the pair's disc, R_ij, shape (...).
        error_sum_m: Part of it that stands for the localization errors of both, eps_i + eps_j, shape (...).
    """

    radius_m: FloatArray
    error_sum_m: FloatArray


def bounded_airframe(airframe_m: ArrayLike) -> FloatArray:
    """Airframe size [m] between 0.1 and 30; unknown (NaN) and meaningless (zero, negative) sizes become 7.5."""
    size = np.asarray(airframe_m, dtype=np.float64)
    known = np.where(size > 0.0, size, MAX_AIRFRAME_M)
    return np.asarray(np.clip(known, MIN_AIRFRAME_M, AIRFRAME_CAP_M))


def bounded_error(error_bound_m: ArrayLike) -> FloatArray:
    """Error bound [m] between 0 and 185; unknown (NaN) and meaningless (negative) bounds become 40."""
    bound = np.asarray(error_bound_m, dtype=np.float64)
    known = np.where(bound >= 0.0, bound, UNKNOWN_ERROR_BOUND_M)
    return np.asarray(np.minimum(known, ERROR_CAP_M))


def bounded_speed(speed_mps: ArrayLike) -> FloatArray:
    """Ground speed [m/s] between 0 and 254.25; unknown (NaN) and meaningless (negative) speeds become 30.7."""
    speed = np.asarray(speed_mps, dtype=np.float64)
    known = np.where(speed >= 0.0, speed, UNKNOWN_SPEED_MPS)
    return np.asarray(np.minimum(known, SPEED_CAP_MPS))


def separation_discs(
    definition: Definition,
    *,
    own_airframe_m: ArrayLike,
    own_error_bound_m: ArrayLike,
    own_accuracy_bound_m: ArrayLike,
    own_speed_mps: ArrayLike,
    airframe_m: ArrayLike,
    error_bound_m: ArrayLike,
    accuracy_bound_m: ArrayLike,
    speed_mps: ArrayLike,
    interval_s: ArrayLike = REPORT_INTERVAL_S,
) -> Discs:
    """Pair radii and error sums [m] of one vehicle, or of many, against others, under one definition.

    Source: paper Eq. 7 to 9 and Table IV. All arguments broadcast against each other; NaN is "unknown". The radius is
    never below the MAC radius of the pair, never NaN, and grows with every size, error, speed and interval.

    Args:
        definition: Which fields count; see `Definition` for what each guarantees.
        own_airframe_m: Own airframe size (diameter).
        own_error_bound_m: Own three-sigma position error per axis.
        own_accuracy_bound_m: Own three-sigma error as far as the accuracy code tells it.
        own_speed_mps: Own ground speed.
        airframe_m: Airframe sizes of the others, shape (n,).
        error_bound_m: Their three-sigma position errors per axis, from RIDLINK_SEPARATION, shape (n,).
        accuracy_bound_m: Their three-sigma errors derived from the accuracy code of standard Remote ID, shape (n,).
        speed_mps: Their ground speeds, shape (n,).
        interval_s: Time between two reports, one for all or shape (n,).

    Returns:
        Discs with the broadcast shape.

    Raises:
        ValueError: If an interval is negative or not finite, or the definition is unknown.
    """
    definition = Definition(definition)
    interval = np.asarray(interval_s, dtype=np.float64)
    if not np.all(np.isfinite(interval)) or np.any(interval < 0.0):
        raise ValueError("interval_s must be finite and not negative")
    mac_radius = (bounded_airframe(own_airframe_m) + bounded_airframe(airframe_m)) / 2.0
    displacement = interval * (bounded_speed(own_speed_mps) + bounded_speed(speed_mps))
    reported_error = bounded_error(own_error_bound_m) + bounded_error(error_bound_m)
    coded_error = bounded_error(own_accuracy_bound_m) + bounded_error(accuracy_bound_m)
    mac_radius, displacement, reported_error, coded_error = np.broadcast_arrays(
        mac_radius, displacement, reported_error, coded_error
    )
    match definition:
        case Definition.SNMAC:
            error_sum = np.zeros_like(reported_error)
            radius = np.full_like(mac_radius, SNMAC_PAIR_RADIUS_M)
        case Definition.REMOTE_ID:
            error_sum = np.full_like(reported_error, 2.0 * UNKNOWN_ERROR_BOUND_M)
            radius = MAX_AIRFRAME_M + error_sum + displacement
        case Definition.ODID_ACCURACY:
            error_sum = coded_error.copy()
            radius = MAX_AIRFRAME_M + error_sum + displacement
        case Definition.CANDIDATE1:
            error_sum = reported_error.copy()
            radius = MAX_AIRFRAME_M + error_sum + displacement
        case Definition.CANDIDATE2:
            error_sum = reported_error.copy()
            radius = mac_radius + error_sum + displacement
    return Discs(radius_m=np.maximum(radius, mac_radius), error_sum_m=error_sum)
