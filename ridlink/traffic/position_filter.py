"""Smoothing of reported positions, so that their white noise does not become jitter of the discs.

    x <- x + v dt,   x <- x + K (report - x),   K = max(1/(k+1), 1 - exp(-dt/T))

with k reports so far. It makes no disc smaller: the reported error bound stays as it is. An innovation beyond that
bound twice in a row, or beyond twice the bound at once, is no noise (a jump, a manoeuvre, another aircraft), and the
filter then starts again from the report. Once is not enough: one white error in ninety is beyond three sigma.
"""

from __future__ import annotations

import math

from ridlink.geodesy import moved, offset_m

TIME_CONSTANT_S = 2.0
"""Long against reports at 10 Hz, short against the 10 s over which GNSS errors drift."""


class PositionFilter:
    """Filter of one vehicle.

    Args:
        time_constant_s: T above; 0 passes every report on as it is.

    Attributes:
        latitude_deg: Filtered position at the time of the last report.
        longitude_deg: The same.
        resets: Number of resets by innovations beyond the bound.
        innovation_m: Distance of the last report from its prediction; 0 if there was none.
    """

    __slots__ = (
        "_at_s", "_beyond", "_reports", "_time_constant_s", "_velocity", "innovation_m", "latitude_deg",
        "longitude_deg", "resets",
    )  # fmt: skip

    def __init__(self, time_constant_s: float = TIME_CONSTANT_S) -> None:
        self._time_constant_s = time_constant_s
        self._reports = 0
        self._beyond = False
        self._at_s = 0.0
        self._velocity: tuple[float, float, float] | None = None
        self.latitude_deg = self.longitude_deg = 0.0
        self.resets = 0
        self.innovation_m = 0.0

    def extrapolate(self, elapsed_s: float, velocity_ned_mps: tuple[float, float, float]) -> tuple[float, float]:
        """Position a given time after the last report [deg]."""
        north, east = velocity_ned_mps[0] * elapsed_s, velocity_ned_mps[1] * elapsed_s
        return moved(self.latitude_deg, self.longitude_deg, north, east)

    def _gain(self, elapsed_s: float) -> float:
        if self._time_constant_s <= 0.0:
            return 1.0
        return max(1.0 / (self._reports + 1), 1.0 - math.exp(-elapsed_s / self._time_constant_s))

    def update(
        self,
        latitude_deg: float,
        longitude_deg: float,
        velocity_ned_mps: tuple[float, float, float] | None,
        bound_m: float,
        at_s: float,
    ) -> tuple[float, float]:
        """Take a report.

        Args:
            latitude_deg: Reported position.
            longitude_deg: Reported position.
            velocity_ned_mps: Reported velocity; without one the filter cannot predict, and passes the report on.
            bound_m: Reported three-sigma error of the position.
            at_s: Time for which the report holds.

        Returns:
            Filtered latitude and longitude at that time.
        """
        elapsed = at_s - self._at_s
        self.innovation_m = 0.0
        if self._reports > 0 and elapsed >= 0.0 and velocity_ned_mps is not None:
            # The mean of both velocities gives the displacement of a vehicle that changed its velocity steadily.
            north_now, east_now, _ = velocity_ned_mps
            north_before, east_before, _ = self._velocity or velocity_ned_mps
            mean = (north_before + north_now) / 2.0, (east_before + east_now) / 2.0, 0.0
            predicted = self.extrapolate(elapsed, mean)
            north, east = offset_m(predicted, (latitude_deg, longitude_deg))
            self.innovation_m = math.hypot(north, east)
            beyond, self._beyond = self._beyond, self.innovation_m > bound_m
            if self.innovation_m <= 2.0 * bound_m and not (beyond and self._beyond):
                gain = self._gain(elapsed)
                latitude_deg, longitude_deg = moved(*predicted, gain * north, gain * east)
                self._reports += 1
            else:
                self.resets += 1
                self._reports = 1
                self._beyond = False
        else:
            self._reports = 1
        self._velocity = velocity_ned_mps
        self._at_s = at_s
        self.latitude_deg, self.longitude_deg = latitude_deg, longitude_deg
        return latitude_deg, longitude_deg
