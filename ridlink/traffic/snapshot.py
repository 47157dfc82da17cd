"""The neighbours that count at one instant, as arrays: positions about the own one, and how far off these may be.

Axes: north, east, down; metres, m/s, seconds. Unknown is NaN.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.traffic.altitude import known_apart, vertical_bound
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.track import Track

FloatArray = NDArray[np.float64]

COAST_ACCELERATION_MPS2 = 5.0
"""A neighbour that is not heard may have turned or braked as hard as this. Its position is extrapolated with its last
velocity, and its disc grows by a t^2 / 2, with the time t since its report."""
COAST_CAP_M = 185.0
"""0.1 nautical miles, the most that one neighbour can demand."""


@dataclass(frozen=True, slots=True)
class PictureSettings:
    """Settings of the traffic picture.

    Args:
        unknown_error_m: Three-sigma error of a report that states none.
        unusable_error_m: A stated error from here on is counted: it allows no separation.
        absurd_airframe_m: A stated size beyond this is counted, and taken for no more than this.
        unknown_speed_mps: Speed of a vehicle that states none.
        max_tracks: Tracks kept at most; the least urgent one gives way.
        max_considered: Tracks handed to the solver at most, the most urgent ones: its time grows with their number.
        filtered: Smooth reported positions, see `PositionFilter`.
        own_height_m: Vertical extent of the own airframe; None: unknown, so that all others count as at our height.
        vertical_horizon_s: Climb rates count for this long: a gap in height that closes within it is none.
        new_per_second: New tracks per second of one source at most.
        all_heights: Give also the vehicles that are known to fly far above or below, marked as such.
        echo_margin_m: Own reports may come back this far from our position, in addition to errors and a second of
            flight.
    """

    unknown_error_m: float
    unusable_error_m: float
    unknown_speed_mps: float
    absurd_airframe_m: float = 30.0
    max_tracks: int = 2000
    max_considered: int = 256
    filtered: bool = True
    own_height_m: float | None = None
    vertical_horizon_s: float = 8.0
    new_per_second: float = 500.0
    all_heights: bool = False
    echo_margin_m: float = 5.0


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Neighbours that count now, n of them, the most urgent first if there are too many.

    Attributes:
        tracks: The tracks themselves.
        position_ned_m: Positions as reported, about the present own position, shape (n, 3).
        velocity_ned_mps: Reported velocities, zero if unknown, shape (n, 3).
        command_ned_mps: Broadcast commanded velocities, NaN if none is given, shape (n, 3).
        age_s: Ages of the positions, shape (n,).
        speed_mps: Horizontal speeds, NaN if unknown, shape (n,).
        interval_s: Measured times between the reports of each, shape (n,).
        widening_m: How far a vehicle may be from its assumed position, beyond its errors: if its direction is unknown,
            if it was not heard for a while, or if it is doubtful, shape (n,).
        error_bound_m: Reported three-sigma errors, NaN if unknown, shape (n,).
        accuracy_bound_m: Three-sigma errors of the accuracy codes, shape (n,).
        airframe_m: Reported sizes, NaN if unknown, shape (n,).
        above_m: Height of each above us now, NaN if unknown, shape (n,).
        climb_mps: Climb rates, NaN if unknown, shape (n,).
        vertical_bound_m: Gap in height within which a pair is level, at this instant and without reserve, infinite if
            unknown, shape (n,).
        apart: Known to fly far above or below, so that it need not be avoided; only with `all_heights`, shape (n,).
        avoiding: True for neighbours that take their half of the avoidance, shape (n,).
        memory: Solver's memory of each encounter, shape (n,).
    """

    tracks: tuple[Track, ...]
    position_ned_m: FloatArray
    velocity_ned_mps: FloatArray
    command_ned_mps: FloatArray
    age_s: FloatArray
    speed_mps: FloatArray
    interval_s: FloatArray
    widening_m: FloatArray
    error_bound_m: FloatArray
    accuracy_bound_m: FloatArray
    airframe_m: FloatArray
    above_m: FloatArray
    climb_mps: FloatArray
    vertical_bound_m: FloatArray
    apart: NDArray[np.bool_]
    avoiding: NDArray[np.bool_]
    memory: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.tracks)

    def at_our_height(self) -> Snapshot:
        """Neighbours that are not known to fly far above or below."""
        return self.only(np.flatnonzero(~self.apart)) if self.apart.any() else self

    def only(self, chosen: NDArray[np.intp]) -> Snapshot:
        """Snapshot of the chosen neighbours."""
        arrays = {item.name: getattr(self, item.name)[chosen] for item in fields(self) if item.name != "tracks"}
        return Snapshot(tracks=tuple(self.tracks[k] for k in chosen), **arrays)


NAN3 = (math.nan, math.nan, math.nan)


def blind_speed_mps(track: Track, settings: PictureSettings) -> float:
    """Speed in an unknown direction [m/s]: how fast the area in which the vehicle may be grows."""
    if track.report.velocity_ned_mps is not None:
        return 0.0
    speed = track.report.speed_horizontal_mps
    return settings.unknown_speed_mps if speed is None else speed


@dataclass(frozen=True, slots=True)
class Sight:
    """All tracks in the air at one instant; `chosen` picks those that count.

    Attributes:
        everybody: All of them as a snapshot, shape (n,) throughout.
        urgency_s: Time until each matters, shape (n,).
    """

    everybody: Snapshot
    urgency_s: FloatArray

    def chosen(self, most: int, counters: Counter[str], *, all_heights: bool) -> Snapshot:
        """The most urgent ones at our height and, if wanted, as many of those far above or below."""
        apart = self.everybody.apart
        picked = _most_urgent(np.flatnonzero(~apart), self.urgency_s, most)
        counters["not_considered"] += len(apart) - len(picked) - int(apart.sum())
        counters["other_altitude"] += int(apart.sum())
        if all_heights:
            picked = np.concatenate([picked, _most_urgent(np.flatnonzero(apart), self.urgency_s, most)])
        return self.everybody.only(picked)


class _Said(NamedTuple):
    """Reports of all tracks at one instant, a column each, shape (n,), NaN for unknown; vectors north, east, down."""

    velocity_mps: FloatArray
    command_mps: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    age_s: FloatArray
    speed_mps: FloatArray
    blind_speed_mps: FloatArray
    error_m: FloatArray
    accuracy_m: FloatArray
    airframe_m: FloatArray
    altitude_m: FloatArray
    vertical_error_m: FloatArray
    height_m: FloatArray
    climb_mps: FloatArray
    interval_s: FloatArray
    doubt_m: FloatArray


def _said_by(tracks: Sequence[Track], now_s: float, settings: PictureSettings) -> _Said:
    rows = np.array(  # None becomes NaN
        [
            (
                *track.velocity_ned_mps,
                *(track.report.commanded_ned_mps or NAN3),
                track.latitude_deg,
                track.longitude_deg,
                max(now_s - track.measured_at_s, 0.0),
                track.report.speed_horizontal_mps,
                blind_speed_mps(track, settings),
                track.report.horizontal_error_m,
                track.report.accuracy_bound_m,
                track.report.airframe_size_m,
                track.report.altitude_geodetic_m,
                track.report.vertical_error_m,
                track.report.airframe_height_m,
                track.report.climb_mps,
                track.interval_s,
                track.doubt.widening_m(now_s),
            )
            for track in tracks
        ],
        dtype=np.float64,
    ).reshape(len(tracks), 20)
    return _Said(rows[:, :3], rows[:, 3:6], *rows[:, 6:].T)


def look(tracks: Sequence[Track], own: OwnState, now_s: float, settings: PictureSettings) -> Sight:
    """All tracks in the air, as seen from own-ship at this instant.

    Args:
        tracks: Tracks that are in the air.
        own: Own state now; its position is the origin.
        now_s: Monotonic time.
        settings: Settings of the traffic picture.
    """
    said = _said_by(tracks, now_s, settings)
    position, above = _positions(own, said)
    bound, apart = _heights(own, said, above, settings)
    now_ne = position[:, :2] + said.velocity_mps[:, :2] * said.age_s[:, None]
    distance = np.hypot(now_ne[:, 0], now_ne[:, 1])
    towards = now_ne / np.maximum(distance, 1e-9)[:, None]
    approach = np.asarray(own.velocity_ned_mps[:2]) - said.velocity_mps[:, :2]
    closing = (approach * towards).sum(axis=1) + said.blind_speed_mps
    coasting = np.minimum(0.5 * COAST_ACCELERATION_MPS2 * said.age_s**2, COAST_CAP_M)
    everybody = Snapshot(
        tracks=tuple(tracks),
        position_ned_m=position,
        velocity_ned_mps=said.velocity_mps,
        command_ned_mps=said.command_mps,
        age_s=said.age_s,
        speed_mps=said.speed_mps,
        interval_s=said.interval_s,
        widening_m=said.blind_speed_mps * said.age_s + coasting + said.doubt_m,
        error_bound_m=said.error_m,
        accuracy_bound_m=said.accuracy_m,
        airframe_m=said.airframe_m,
        above_m=above,
        climb_mps=said.climb_mps,
        vertical_bound_m=bound,
        apart=apart,
        avoiding=np.array([track.report.avoiding for track in tracks], dtype=np.bool_),
        memory=np.array([track.memory for track in tracks], dtype=np.int8),
    )
    return Sight(everybody, distance / np.maximum(closing, 1.0))


def _positions(own: OwnState, said: _Said) -> tuple[FloatArray, FloatArray]:
    """Positions about the own one [m], and the height of each above us now, NaN if unknown."""
    own_altitude = own.altitude_ellipsoid_m
    # Unknown altitude, ours or theirs: the same height, so that the vehicle counts.
    comparable = np.isfinite(said.altitude_m) & (own_altitude is not None)
    origin_altitude = own.position.altitude_m if own_altitude is None else own_altitude
    altitude = np.where(comparable, said.altitude_m, origin_altitude)
    origin = Geodetic(own.position.latitude_deg, own.position.longitude_deg, origin_altitude)
    position = ned_from_geodetic(said.latitude_deg, said.longitude_deg, altitude, origin)
    # Not the plane's "down": that sinks with the curvature of the Earth.
    above = np.where(comparable, altitude - origin_altitude + said.climb_mps * said.age_s, np.nan)
    return position, above


def _most_urgent(chosen: NDArray[np.intp], urgency_s: FloatArray, most: int) -> NDArray[np.intp]:
    """The most urgent of the chosen, `most` at most; in their order if that is all of them."""
    return chosen if len(chosen) <= most else chosen[np.argsort(urgency_s[chosen], kind="stable")[:most]]


def _heights(
    own: OwnState, said: _Said, above: FloatArray, settings: PictureSettings
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Present vertical bound, and whether each is known to stay further up or down within the horizon."""
    unknowable = (own.vertical_error_bound_m, settings.own_height_m)
    own_error, own_height = (math.nan if value is None else value for value in unknowable)
    bound = partial(
        vertical_bound,
        above,
        error_m=(own_error, said.vertical_error_m),
        height_m=(own_height, said.height_m),
        climb_mps=(-own.velocity_ned_mps[2], said.climb_mps),
    )
    now = bound(reserve_m=0.0)
    within = bound(age_s=said.age_s, horizon_s=settings.vertical_horizon_s)
    return now, known_apart(above, within)
