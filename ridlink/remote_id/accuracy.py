"""Accuracy codes of Open Drone ID and the bounds that they stand for, metres and metres a second.

The codes are inverted: a larger code is better, 0 is unknown, and codes beyond the best one are reserved. A code
promises that the accuracy is *smaller* than its bound. So a value equal to a bound goes into the next worse bucket, and
a value worse than the worst bucket is sent as unknown.

The standard (ASTM F3411, based on ADS-B's NACp) defines the horizontal accuracy as the radius that holds 95 % of
positions. The separation discs use three standard deviations of either horizontal axis. Autopilots fill the field with
the one-sigma figure of their receiver, unscaled. `AccuracyConvention` names these three readings. The default is
`DEFAULT_CONVENTION`, and all senders here write the field as the standard defines it.

Source: MAV_ODID_HOR_ACC, MAV_ODID_VER_ACC, MAV_ODID_SPEED_ACC and MAV_ODID_TIME_ACC of common.xml.
"""

from __future__ import annotations

import math

from ridlink.units import ceil_units
from ridlink.words import Named

HORIZONTAL_BOUNDS_M: dict[int, float] = {
    1: 18520.0,
    2: 7408.0,
    3: 3704.0,
    4: 1852.0,
    5: 926.0,
    6: 555.6,
    7: 185.2,
    8: 92.6,
    9: 30.0,
    10: 10.0,
    11: 3.0,
    12: 1.0,
}
VERTICAL_BOUNDS_M: dict[int, float] = {1: 150.0, 2: 45.0, 3: 25.0, 4: 10.0, 5: 3.0, 6: 1.0}
"""Of the geodetic and of the barometric altitude."""
SPEED_BOUNDS_MPS: dict[int, float] = {1: 10.0, 2: 3.0, 3: 1.0, 4: 0.3}

UNKNOWN_CODE = 0
WORST_TIME_CODE = 15
TIME_STEP_S = 0.1

THREE_SIGMA_PER_95_PERCENT_RADIUS = 3.0 / math.sqrt(-2.0 * math.log(0.05))
"""1.2256: with equal errors on both axes 95 % of positions lie within 2.4477 standard deviations."""


class AccuracyConvention(Named):
    """How a horizontal accuracy is read.

    LETTER: the radius that holds 95 % of positions, as the standard defines it. The default, since it is what a sender
        can be held to and what senders of this project write. It also keeps a 30 m code below the 40 m of an unknown
        one, so a sender that knows its error to 30 m gains nothing by hiding it.
    ONE_SIGMA: one standard deviation, which PX4 and ArduPilot put there. Use it where vehicles fly with the code that
        their autopilot fills in: under LETTER their errors may be 2.4 times as large as assumed. For senders that
        follow the standard it demands 2.4 times what is needed.
    AS_IS: three standard deviations already. The paper's reading of "error bound".
    """

    LETTER = "letter"
    ONE_SIGMA = "one-sigma"
    AS_IS = "as-is"


DEFAULT_CONVENTION = AccuracyConvention.LETTER


_THREE_SIGMA_FACTOR = {
    AccuracyConvention.LETTER: THREE_SIGMA_PER_95_PERCENT_RADIUS,
    AccuracyConvention.ONE_SIGMA: 3.0,
    AccuracyConvention.AS_IS: 1.0,
}
_THREE_SIGMA_M: dict[str, dict[int, float]] = {
    convention: {code: bound * factor for code, bound in HORIZONTAL_BOUNDS_M.items()}
    for convention, factor in _THREE_SIGMA_FACTOR.items()
}


def horizontal_bound_m(code: int) -> float | None:
    """Bound of a horizontal accuracy code [m]; ``None`` for 0 and reserved codes."""
    return HORIZONTAL_BOUNDS_M.get(code)


def vertical_bound_m(code: int) -> float | None:
    """Bound of a vertical or barometer accuracy code [m]; ``None`` for 0 and reserved codes."""
    return VERTICAL_BOUNDS_M.get(code)


def speed_bound_mps(code: int) -> float | None:
    """Bound of a speed accuracy code [m/s]; ``None`` for 0 and reserved codes."""
    return SPEED_BOUNDS_MPS.get(code)


def time_bound_s(code: int) -> float | None:
    """Bound of a timestamp accuracy code [s]; ``None`` for 0 and reserved codes."""
    return code / 10.0 if UNKNOWN_CODE < code <= WORST_TIME_CODE else None


def _code(value: float | None, bounds: dict[int, float]) -> int:
    if value is None or not value >= 0.0:  # also catches NaN
        return UNKNOWN_CODE
    return max((code for code, bound in bounds.items() if value < bound), default=UNKNOWN_CODE)


def horizontal_code(accuracy_m: float | None) -> int:
    """Horizontal accuracy code of an accuracy [m]; unknown, negative and 18,520 m or more give 0."""
    return _code(accuracy_m, HORIZONTAL_BOUNDS_M)


def vertical_code(accuracy_m: float | None) -> int:
    """Vertical or barometer accuracy code of an accuracy [m]; unknown, negative and 150 m or more give 0."""
    return _code(accuracy_m, VERTICAL_BOUNDS_M)


def speed_code(accuracy_mps: float | None) -> int:
    """Speed accuracy code of an accuracy [m/s]; unknown, negative and 10 m/s or more give 0."""
    return _code(accuracy_mps, SPEED_BOUNDS_MPS)


def time_code(accuracy_s: float | None) -> int:
    """Timestamp accuracy code of an accuracy [s], in steps of 0.1 s rounded up; unknown and beyond 1.5 s give 0."""
    if accuracy_s is None or not 0.0 <= accuracy_s <= WORST_TIME_CODE * TIME_STEP_S:
        return UNKNOWN_CODE
    return max(1, ceil_units(accuracy_s, TIME_STEP_S))


def three_sigma_bound_m(code: int, convention: AccuracyConvention | str = DEFAULT_CONVENTION) -> float | None:
    """Three standard deviations of either horizontal axis [m] that a horizontal accuracy code allows.

    Args:
        code: Horizontal accuracy code.
        convention: How the code is read.

    Returns:
        The bound, ``None`` for 0 and reserved codes.

    Raises:
        ValueError: If the convention is unknown.
    """
    bounds = _THREE_SIGMA_M.get(convention)  # an enumeration is hashed and compared as the text that it is
    return (_THREE_SIGMA_M[AccuracyConvention(convention)] if bounds is None else bounds).get(code)


def code_of_three_sigma(error_3sigma_m: float | None, convention: AccuracyConvention | str = DEFAULT_CONVENTION) -> int:
    """Horizontal accuracy code that a sender gives for its three-sigma error [m].

    Raises:
        ValueError: If the convention is unknown.
    """
    factor = _THREE_SIGMA_FACTOR[AccuracyConvention(convention)]
    return horizontal_code(None if error_3sigma_m is None else error_3sigma_m / factor)


def coded_bound_m(error_3sigma_m: float, convention: AccuracyConvention | str = DEFAULT_CONVENTION) -> float:
    """Three-sigma error [m] that a receiver assumes if it hears only the accuracy code of a three-sigma error.

    Args:
        error_3sigma_m: Three standard deviations of either horizontal axis; the sender encodes them by LETTER.
        convention: How the receiver reads the code.

    Returns:
        Three standard deviations [m], NaN if the code is "unknown".

    Raises:
        ValueError: If the convention is unknown.
    """
    bound = three_sigma_bound_m(code_of_three_sigma(error_3sigma_m, AccuracyConvention.LETTER), convention)
    return math.nan if bound is None else bound
