"""All aircraft in the air at one instant, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ridlink.separation.definitions import Reported
from ridlink.traffic.altitude import RESERVE_M, known_apart, vertical_bound

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Places = NDArray[np.intp]
"""Indices of vehicles in a scene."""

VERTICAL_HORIZON_S = 8.0
CONSIDERED_M = 2000.0
"""Pairs further apart than this do not count."""


@dataclass(frozen=True, slots=True)
class Scene:
    """All n aircraft in the air at one instant. NaN is unknown.

    Attributes:
        time_s: The instant, on the caller's clock.
        numbers: Numbers of the aircraft; an aircraft keeps its number.
        names: Present names; the name of an aircraft changes when its identity is heard.
        position_ne_m: Present positions, extrapolated with the reported velocity, shape (n, 2).
        velocity_ne_mps: Reported velocities, zero where unknown, shape (n, 2).
        speed_mps: Horizontal speeds, shape (n,).
        airframe_m: Reported sizes, shape (n,).
        error_bound_m: Reported three-sigma errors, shape (n,).
        accuracy_bound_m: The same from the accuracy code, shape (n,).
        interval_s: Times between reports, shape (n,).
        age_s: Ages of the positions, shape (n,).
        altitude_m: Above the ellipsoid, shape (n,).
        climb_mps: Climb rates, shape (n,).
        vertical_error_m: Three sigma, shape (n,).
        airframe_height_m: Vertical extents, shape (n,).
        command_ne_mps: Velocities that they report as commanded to their autopilots, shape (n, 2).
        avoiding: Whether it says that it does its half of every avoidance manoeuvre, shape (n,).
        merged: Numbers of aircraft that turned out to be known ones, heard over another link.
    """

    time_s: float
    numbers: tuple[int, ...]
    names: tuple[str, ...]
    position_ne_m: FloatArray
    velocity_ne_mps: FloatArray
    speed_mps: FloatArray
    airframe_m: FloatArray
    error_bound_m: FloatArray
    accuracy_bound_m: FloatArray
    interval_s: FloatArray
    age_s: FloatArray
    altitude_m: FloatArray
    climb_mps: FloatArray
    vertical_error_m: FloatArray
    airframe_height_m: FloatArray
    command_ne_mps: FloatArray
    avoiding: BoolArray
    merged: frozenset[int] = frozenset()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def reported(self) -> Reported:
        """The fields that size discs."""
        return Reported(self.airframe_m, self.error_bound_m, self.accuracy_bound_m, self.speed_mps)

    def only(self, which: BoolArray) -> Scene:
        """The aircraft for which the mask is true, shape (n,)."""
        kept = np.flatnonzero(which)
        arrays = {
            field_.name: getattr(self, field_.name)[kept]
            for field_ in fields(self)
            if isinstance(getattr(self, field_.name), np.ndarray)
        }
        return replace(
            self,
            numbers=tuple(self.numbers[at] for at in kept),
            names=tuple(self.names[at] for at in kept),
            **arrays,
        )

    def apart_at(self, first: Places, second: Places) -> BoolArray:
        """Whether given pairs are known to fly at safely different heights.

        Args:
            first, second: Indices of the two of each pair, shape (k,).

        Returns:
            Shape (k,).
        """
        above = self.altitude_m[second] - self.altitude_m[first]
        apart = np.zeros(above.shape, np.bool_)
        far = np.flatnonzero(np.abs(above) > RESERVE_M)  # no bound is below its reserve
        if not len(far):
            return apart
        upwards = above[far] > 0.0
        i, j = np.where(upwards, first[far], second[far]), np.where(upwards, second[far], first[far])
        above = np.abs(above[far])
        error, height, climb = self.vertical_error_m, self.airframe_height_m, self.climb_mps
        bound = vertical_bound(
            above,
            error_m=(error[i], error[j]),
            height_m=(height[i], height[j]),
            climb_mps=(climb[i], climb[j]),
            age_s=np.maximum(self.age_s[i], self.age_s[j]),
            horizon_s=VERTICAL_HORIZON_S,
        )
        apart[far] = known_apart(above, bound)
        return apart
