"""Where own-ship is and how wrong that may be, for the traffic picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ridlink.geodesy import Geodetic


@dataclass(frozen=True, slots=True)
class OwnState:
    """Own state at one instant.

    Attributes:
        position: Latitude, longitude, altitude above mean sea level, extrapolated to this instant.
        altitude_ellipsoid_m: The same altitude above the ellipsoid; None if the receiver does not tell.
        velocity_ned_mps: Velocity.
        error_bound_m: Horizontal error, three standard deviations of either axis, grown while the position is old.
        vertical_error_bound_m: Vertical error, three standard deviations, grown while the position is old; None if the
            receiver does not tell.
        home_altitude_m: Altitude above mean sea level from which the autopilot counts its relative altitude.
        age_s: Time since the position came.
    """

    position: Geodetic
    altitude_ellipsoid_m: float | None
    velocity_ned_mps: tuple[float, float, float]
    error_bound_m: float
    vertical_error_bound_m: float | None
    home_altitude_m: float
    age_s: float

    @property
    def speed_mps(self) -> float:
        """Horizontal speed."""
        return math.hypot(self.velocity_ned_mps[0], self.velocity_ned_mps[1])
