"""All aircraft in the air at one instant, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

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


@dataclass(frozen=True, slots=True, eq=False)
class Gaps:
    """Distances and closing speeds of the n vehicles of a scene, independent of the definition.

    Attributes:
        distance_m, distance_square_m2: Between centres, shape (n, n).
        counted: Mask of pairs within 2 km and not at safely different heights, without the diagonal, shape (n, n).
        nearing: Flat indices into (n, n) of counted pairs that come nearer, each once, shape (k,).
        closing: For these pairs, offset times relative velocity, positive [m2/s], shape (k,).
        square: For these pairs, square of the relative speed [m2/s2], shape (k,).
    """

    distance_m: FloatArray
    distance_square_m2: FloatArray
    counted: BoolArray
    nearing: NDArray[np.intp]
    closing: FloatArray
    square: FloatArray


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
    _apart: list[BoolArray] = field(default_factory=list, init=False, repr=False)
    _gaps: list[Gaps] = field(default_factory=list, init=False, repr=False)

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

    def apart(self) -> BoolArray:
        """Pairs that are known to fly at safely different heights, shape (n, n); computed once, do not change it."""
        if not self._apart:
            self._apart.append(self._known_apart())
        return self._apart[0]

    def gaps(self) -> Gaps:
        """Distances and closing speeds of all pairs; computed once, do not change it."""
        if not self._gaps:
            self._gaps.append(self._between())
        return self._gaps[0]

    def _between(self) -> Gaps:
        # One axis at a time: arrays whose last axis has length 2 are several times as slow.
        north, east = np.ascontiguousarray(self.position_ne_m.T)
        to_north, to_east = np.ascontiguousarray(self.velocity_ne_mps.T)
        r_north, r_east = north - north[:, None], east - east[:, None]
        distance_square = r_north * r_north + r_east * r_east
        counted = ~self.apart() & (distance_square <= CONSIDERED_M**2)
        np.fill_diagonal(counted, False)
        # Each pair once, the first of a row before the second.
        each = np.flatnonzero(counted & np.less.outer(np.arange(len(self)), np.arange(len(self))))
        i, j = np.divmod(each, max(len(self), 1))
        v_north, v_east = to_north[j] - to_north[i], to_east[j] - to_east[i]
        closing = -(r_north.take(each) * v_north + r_east.take(each) * v_east)
        nearing = np.flatnonzero(closing > 0.0)
        v_north, v_east = v_north.take(nearing), v_east.take(nearing)
        return Gaps(
            np.sqrt(distance_square),
            distance_square,
            counted,
            each.take(nearing),
            closing.take(nearing),
            v_north * v_north + v_east * v_east,
        )

    def _known_apart(self) -> BoolArray:
        apart = np.zeros((len(self), len(self)), np.bool_)
        i, j = np.nonzero(self.altitude_m - self.altitude_m[:, None] > RESERVE_M)  # each pair once
        apart[i, j] = apart[j, i] = self.apart_at(i, j)
        return apart

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
