"""Whether the navigation solution of an autopilot may be believed, and how wrong it may be.

Source: GPS_RAW_INT (24), ESTIMATOR_STATUS (230) of PX4, EKF_STATUS_REPORT (193) of ArduPilot. After the loss of GNSS
both autopilots go on sending positions. ArduPilot also keeps its accuracy figure, so that alone proves nothing. The
"variances" of its EKF report are innovation ratios that read 0.0 when all is lost, so they are not used.
"""

from __future__ import annotations

import math

from ridlink.mavlink.codec import Message
from ridlink.separation.reference import ERROR_CAP_M, UNKNOWN_ERROR_BOUND_M
from ridlink.units import m_from_mm

FIX_3D = 3
POSITION_HORIZONTAL_ABSOLUTE = 16
"""ESTIMATOR_POS_HORIZ_ABS and EKF_POS_HORIZ_ABS."""

ACCURACY_VALID_S = 5.0
"""GPS_RAW_INT comes at 1 to 8 Hz and ESTIMATOR_STATUS at 1 Hz; older figures do not count."""
UNKNOWN_ACCURACY_MM = (0, 0xFFFFFFFF)
LARGEST_UNDULATION_M = 120.0
"""The geoid lies 107 m below the ellipsoid at most, and 86 m above it (EGM96). A receiver that says more has one of
both heights wrong, and would put all others at another height."""


class NavigationTrust:
    """Takes what receiver and estimator say of themselves."""

    def __init__(self) -> None:
        self._fix_type = FIX_3D
        self._gps_at_s = self._estimator_at_s = -math.inf
        self._horizontal_error_m: float | None = None
        self._vertical_error_m: float | None = None
        self._velocity_error_mps: float | None = None
        self._estimator_accuracy_m = 0.0
        self._absolute = True
        self.undulation_m: float | None = None

    def receiver(self, message: Message, now_s: float) -> None:
        """Take a GPS_RAW_INT."""
        self._gps_at_s = now_s
        self._fix_type = message.fix_type
        self._horizontal_error_m = None if message.h_acc in UNKNOWN_ACCURACY_MM else 3.0 * m_from_mm(message.h_acc)
        self._vertical_error_m = None if message.v_acc in UNKNOWN_ACCURACY_MM else 3.0 * m_from_mm(message.v_acc)
        self._velocity_error_mps = None if message.vel_acc in UNKNOWN_ACCURACY_MM else 3.0 * m_from_mm(message.vel_acc)
        undulation_m = m_from_mm(message.alt_ellipsoid - message.alt)
        plausible = message.alt_ellipsoid != 0 and abs(undulation_m) <= LARGEST_UNDULATION_M
        self.undulation_m = undulation_m if plausible else None

    def estimator(self, flags: int, accuracy_m: float, now_s: float) -> None:
        """Take the flags of an estimator, and its accuracy if it has one (one standard deviation, else 0)."""
        self._estimator_at_s = now_s
        self._absolute = bool(flags & POSITION_HORIZONTAL_ABSOLUTE)
        self._estimator_accuracy_m = accuracy_m if math.isfinite(accuracy_m) and accuracy_m > 0.0 else 0.0

    def receiver_silent_s(self, now_s: float) -> float:
        """Time since the last message of the receiver [s]; infinite without one."""
        return now_s - self._gps_at_s

    def estimator_silent(self, now_s: float) -> bool:
        """Whether an estimator spoke and does so no more."""
        return ACCURACY_VALID_S < now_s - self._estimator_at_s < math.inf

    @property
    def trusted(self) -> bool:
        """Whether there is a 3-D fix and, if an estimator speaks, an absolute horizontal solution.

        Figures become old, a loss does not: it lasts until its sender says otherwise.
        """
        return self._fix_type >= FIX_3D and self._absolute

    def error_m(self, now_s: float) -> float:
        """Three-sigma error of a fresh position [m]: the larger of what receiver and estimator say."""
        error = self._horizontal_error_m
        if error is None or now_s - self._gps_at_s > ACCURACY_VALID_S:
            error = UNKNOWN_ERROR_BOUND_M
        if now_s - self._estimator_at_s <= ACCURACY_VALID_S:
            error = max(error, 3.0 * self._estimator_accuracy_m)
        return min(error, ERROR_CAP_M)

    def vertical_error_m(self, now_s: float) -> float | None:
        """Three-sigma vertical error of a fresh position [m]; None if the receiver does not tell."""
        return self._vertical_error_m if now_s - self._gps_at_s <= ACCURACY_VALID_S else None

    def velocity_error_mps(self, now_s: float) -> float | None:
        """Three-sigma error of a fresh velocity [m/s]; None if the receiver does not tell."""
        return self._velocity_error_mps if now_s - self._gps_at_s <= ACCURACY_VALID_S else None

    def measured(self, now_s: float) -> bool:
        """Whether the receiver has a fix and says how wrong it is, so that `error_m` is no assumption."""
        fresh = now_s - self._gps_at_s <= ACCURACY_VALID_S
        return fresh and self._horizontal_error_m is not None and self.trusted
