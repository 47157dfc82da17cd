"""The traffic picture: reports in, the neighbours that count as arrays out.

Positions leave as north-east-down metres about the own position of the instant, never about a cached origin. What does
not count is said by a counter: echoes of ourselves, vehicles on the ground, vehicles that are known to be far above or
below. Nothing here trusts a sender, and nothing grows without bound.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Hashable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.remote_id.report import RemoteIdReport
from ridlink.traffic.altitude import known_apart, vertical_bound
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.position_filter import offset_m
from ridlink.traffic.track import SENDER_AGE_S, Relation, Track, TrackKey, Update, hours_apart_s, new_track

FloatArray = NDArray[np.float64]

VEHICLES_PER_IDENTITY = 4
DISPLACED_AFTER_S = 2.0
"""So many vehicles with one identity are followed side by side; one silent for so long gives way to another."""


@dataclass(frozen=True, slots=True)
class PictureSettings:
    """What counts as traffic.

    Args:
        unknown_error_m: Three-sigma error of a report that states none.
        unusable_error_m: A stated error from here on is counted: nobody can be separated by it.
        unknown_speed_mps: Speed of a vehicle that states none.
        max_tracks: Tracks kept at most; the least urgent one gives way.
        max_considered: Tracks handed to the solver at most, the most urgent ones: its time grows with their number.
        filtered: Smooth reported positions, see `PositionFilter`.
        own_height_m: Vertical extent of the own airframe; None: unknown, so that everybody flies at our height.
        vertical_horizon_s: Climb rates count for so long: a gap in height that closes within it is none.
        all_heights: Hand out those who are known to fly far above or below as well, marked as such.
        echo_margin_m: Own reports come back this far from where we are, beyond errors and a second of flight.
    """

    unknown_error_m: float
    unusable_error_m: float
    unknown_speed_mps: float
    max_tracks: int = 2000
    max_considered: int = 256
    filtered: bool = True
    own_height_m: float | None = None
    vertical_horizon_s: float = 8.0
    all_heights: bool = False
    echo_margin_m: float = 5.0


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Neighbours that count now, n of them, most urgent first where there are too many.

    Attributes:
        tracks: The tracks themselves.
        position_ned_m: Positions as reported, about the own position now, shape (n, 3).
        velocity_ned_mps: Reported velocities, zero where unknown, shape (n, 3).
        command_ned_mps: Broadcast commanded velocities, NaN where none is given, shape (n, 3).
        age_s: Ages of the positions, shape (n,).
        speed_mps: Horizontal speeds, NaN where unknown, shape (n,).
        blind_growth_m: How far a vehicle of unknown direction may have gone since, shape (n,).
        error_bound_m: Reported three-sigma errors, NaN where unknown, shape (n,).
        accuracy_bound_m: The same from the accuracy code, shape (n,).
        airframe_m: Reported sizes, NaN where unknown, shape (n,).
        above_m: How far each is above us now, NaN where that cannot be said, shape (n,).
        climb_mps: Climb rates, NaN where unknown, shape (n,).
        vertical_bound_m: Gap in height that is none, at this instant and without reserve, infinite where unknown,
            shape (n,).
        apart: Known to fly far above or below, so that it need not be avoided; only with `all_heights`, shape (n,).
        avoiding: Who takes its half, shape (n,).
        memory: What the solver keeps of each encounter, shape (n,).
    """

    tracks: tuple[Track, ...]
    position_ned_m: FloatArray
    velocity_ned_mps: FloatArray
    command_ned_mps: FloatArray
    age_s: FloatArray
    speed_mps: FloatArray
    blind_growth_m: FloatArray
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
        """Those who are not known to fly far above or below."""
        if not self.apart.any():
            return self
        chosen = np.flatnonzero(~self.apart)
        arrays = {item.name: getattr(self, item.name)[chosen] for item in fields(self) if item.name != "tracks"}
        return replace(self, tracks=tuple(self.tracks[k] for k in chosen), **arrays)


NAN3 = (math.nan, math.nan, math.nan)


def _bare(identity: bytes | None) -> bytes | None:
    """An identity without the zeros that fill its field."""
    return None if identity is None else identity.rstrip(b"\x00")


class TrafficPicture:
    """All tracks of one own-ship.

    Attributes:
        counters: Reports by what became of them, and why tracks do not count.
        tracks: By key.
    """

    def __init__(self, settings: PictureSettings) -> None:
        self.settings = settings
        self.counters: Counter[str] = Counter()
        self.tracks: dict[TrackKey, Track] = {}
        self._own: OwnState | None = None
        self._least_urgent: list[Track] | None = None

    def __len__(self) -> int:
        return len(self.tracks)

    # --- in -------------------------------------------------------------------------------------------------------

    def receive(
        self,
        link: Hashable,
        report: RemoteIdReport,
        *,
        utc_s: float | None = None,
        own_sysid: int | None = None,
        own_uas_id: bytes | None = None,
    ) -> None:
        """Take a report.

        Args:
            link: Where it was heard; the same sender heard on two links makes two tracks.
            report: The report.
            utc_s: UTC when it was received, of which only the part of the hour counts; without it the sender's own
                timestamp says nothing about its age.
            own_sysid: Own system id.
            own_uas_id: Own identity in Remote ID.
        """
        age_s = self._sender_age_s(report, utc_s)
        relations = self._relations((link, *report.key), report, trusted_clock=age_s is not None)
        following = [track for track, relation in relations.items() if relation is Relation.FOLLOWS]
        track = min(following, key=lambda each: each.metres_to(report)) if following else None
        if self._is_echo(report, track, own_sysid, own_uas_id):
            self.counters["own_echo"] += 1
        elif track is not None:
            self._update(track, report, report.received_at_s - (age_s or 0.0))
        elif Relation.OUTDATED in relations.values():
            last = [each.report.timestamp_s for each, relation in relations.items() if relation is Relation.OUTDATED]
            self.counters[Update.REPEATED if report.timestamp_s in last else Update.OLDER] += 1
        else:
            self._begin((link, *report.key), relations, report, age_s)

    def _relations(
        self, identity: tuple[Any, ...], report: RemoteIdReport, *, trusted_clock: bool
    ) -> dict[Track, Relation]:
        """The tracks with the identity of a report, and what it is to each."""
        found = (self.tracks.get((*identity, number)) for number in range(VEHICLES_PER_IDENTITY))
        return {
            track: track.relation(
                report,
                trusted_clock=trusted_clock,
                unknown_error_m=self.settings.unknown_error_m,
                unknown_speed_mps=self.settings.unknown_speed_mps,
            )
            for track in found
            if track is not None
        }

    def _update(self, track: Track, report: RemoteIdReport, measured_at_s: float) -> None:
        update = track.update(report, measured_at_s, self.settings.unknown_error_m)
        if update not in (Update.MOVED, Update.COMPLETED):
            self.counters[update] += 1
        elif (report.horizontal_error_m or 0.0) >= self.settings.unusable_error_m:
            self.counters["position_unusable"] += 1

    def _begin(
        self, identity: tuple[Any, ...], others: Collection[Track], report: RemoteIdReport, age_s: float | None
    ) -> None:
        """A new track; beside others with the same identity where there are some."""
        if report.latitude_deg is None:
            self.counters[Update.NO_POSITION] += 1
            return
        if others:
            self.counters["identity_doubtful"] += 1
        taken = {track.key[-1] for track in others}
        number = next((k for k in range(VEHICLES_PER_IDENTITY) if k not in taken), None)
        if number is None:
            longest_silent = min(others, key=lambda track: track.received_at_s)
            if report.received_at_s - longest_silent.received_at_s < DISPLACED_AFTER_S:
                self.counters["track_refused"] += 1
                return
            number = longest_silent.key[-1]
            del self.tracks[longest_silent.key]
        track = new_track(
            (*identity, number),
            report,
            report.received_at_s - (age_s or 0.0),
            filtered=self.settings.filtered,
            trusted_clock=age_s is not None,
        )
        if track is None:
            return
        if self._own is not None:
            here = (self._own.position.latitude_deg, self._own.position.longitude_deg)
            track.first_heard_m = math.hypot(*offset_m(here, (track.latitude_deg, track.longitude_deg)))
            track.urgency_s = self._urgency_of(track, self._own)
        if len(self.tracks) >= self.settings.max_tracks and not self._make_room(track):
            self.counters["track_refused"] += 1
            return
        self.tracks[track.key] = track

    def _is_echo(
        self, report: RemoteIdReport, track: Track | None, own_sysid: int | None, own_uas_id: bytes | None
    ) -> bool:
        """Our own report come back: our identity *and* our place. Our identity elsewhere is an intruder, and stays one
        when it comes near: its next report is nearer to its last one than to us."""
        by_sysid = own_sysid is not None and report.source[0] == own_sysid and report.id_or_mac is None
        by_uas_id = own_uas_id is not None and _bare(own_uas_id) in (_bare(report.uas_id), _bare(report.id_or_mac))
        if not (by_sysid or by_uas_id):
            return False
        own = self._own
        if own is None or report.latitude_deg is None or report.longitude_deg is None:
            return True  # without a place there is nothing to track, and nothing to steer either
        here = (own.position.latitude_deg, own.position.longitude_deg)
        distance = math.hypot(*offset_m(here, (report.latitude_deg, report.longitude_deg)))
        bound = self.settings.unknown_error_m if report.horizontal_error_m is None else report.horizontal_error_m
        bound = min(bound, self.settings.unusable_error_m)
        if distance <= own.error_bound_m + bound + 2.0 * own.speed_mps + self.settings.echo_margin_m:
            return track is None or not track.seen_elsewhere or track.metres_to(report) >= distance
        if track is not None:
            track.seen_elsewhere = True
        self.counters["own_id_elsewhere"] += 1
        return False

    def _sender_age_s(self, report: RemoteIdReport, utc_s: float | None) -> float | None:
        """Age of a report by its own timestamp; None where that is missing or does not agree with our UTC."""
        if utc_s is None or report.timestamp_s is None:
            return None
        age = hours_apart_s(utc_s, report.timestamp_s)
        if not SENDER_AGE_S[0] <= age <= SENDER_AGE_S[1]:
            self.counters["timestamp_implausible"] += 1
            return None
        return max(age, 0.0)

    def _make_room(self, newcomer: Track) -> bool:
        """Drop the least urgent track if it is less urgent than the newcomer."""
        if self._least_urgent is None:
            self._least_urgent = sorted(self.tracks.values(), key=lambda track: track.urgency_s)
        while self._least_urgent:
            last = self._least_urgent[-1]
            if self.tracks.get(last.key) is not last:
                self._least_urgent.pop()
                continue
            if last.urgency_s <= newcomer.urgency_s:
                return False
            self._least_urgent.pop()
            del self.tracks[last.key]
            self.counters["track_evicted"] += 1
            return True
        return False

    def _blind_speed_mps(self, track: Track) -> float:
        """Speed in an unknown direction [m/s]: how fast the area in which the vehicle may be grows."""
        if track.report.velocity_ned_mps is not None:
            return 0.0
        speed = track.report.speed_horizontal_mps
        return self.settings.unknown_speed_mps if speed is None else speed

    # --- out ------------------------------------------------------------------------------------------------------

    def drop_silent(self, now_s: float) -> None:
        """Drop tracks that were not heard for too long; called every step, own state or not."""
        silent = [key for key, track in self.tracks.items() if track.expired(now_s)]
        for key in silent:
            del self.tracks[key]
        self.counters["track_lost"] += len(silent)

    def _urgency_of(self, track: Track, own: OwnState) -> float:
        here = (own.position.latitude_deg, own.position.longitude_deg)
        north, east = offset_m(here, (track.latitude_deg, track.longitude_deg))
        distance = math.hypot(north, east)
        velocity = track.velocity_ned_mps
        closing = self._blind_speed_mps(track)
        if distance > 0.0:
            closing += (own.velocity_ned_mps[0] - velocity[0]) * north / distance
            closing += (own.velocity_ned_mps[1] - velocity[1]) * east / distance
        return distance / max(closing, 1.0)

    def snapshot(self, own: OwnState, now_s: float) -> Snapshot:
        """The neighbours that count now.

        Args:
            own: Own state now; its position is the origin.
            now_s: Monotonic time.
        """
        self._own = own
        self._least_urgent = None
        candidates = [track for track in self.tracks.values() if not track.on_ground]
        count = len(candidates)
        rows = np.array(  # None becomes NaN
            [
                (
                    track.latitude_deg,
                    track.longitude_deg,
                    *track.velocity_ned_mps,
                    *(track.report.commanded_ned_mps or NAN3),
                    now_s - track.measured_at_s,
                    track.report.speed_horizontal_mps,
                    self._blind_speed_mps(track),
                    track.report.horizontal_error_m,
                    track.report.accuracy_bound_m,
                    track.report.airframe_size_m,
                    track.report.altitude_geodetic_m,
                    track.report.vertical_error_m,
                    track.report.airframe_height_m,
                    track.report.climb_mps,
                )
                for track in candidates
            ],
            dtype=np.float64,
        ).reshape(count, 18)
        age = np.maximum(rows[:, 8], 0.0)
        own_altitude = own.altitude_ellipsoid_m
        altitude = rows[:, 14]
        # Unknown altitude, ours or theirs: the same height, so that it counts.
        comparable = np.isfinite(altitude) & (own_altitude is not None)
        origin_altitude = own.position.altitude_m if own_altitude is None else own_altitude
        altitude = np.where(comparable, altitude, origin_altitude)
        origin = Geodetic(own.position.latitude_deg, own.position.longitude_deg, origin_altitude)
        position = ned_from_geodetic(rows[:, 0], rows[:, 1], altitude, origin)
        climb = rows[:, 17]
        # Not the plane's "down": that sinks with the curvature of the Earth.
        above = np.where(comparable, altitude - origin_altitude + climb * age, np.nan)
        bound, apart = self._heights(own, rows, age, above)
        self.counters["other_altitude"] += int(apart.sum())
        self.counters["on_ground"] += len(self.tracks) - count

        velocity = rows[:, 2:5]
        now_ne = position[:, :2] + velocity[:, :2] * age[:, None]
        distance = np.hypot(now_ne[:, 0], now_ne[:, 1])
        towards = now_ne / np.maximum(distance, 1e-9)[:, None]
        closing = ((np.asarray(own.velocity_ned_mps[:2]) - velocity[:, :2]) * towards).sum(axis=1) + rows[:, 10]
        urgency = distance / np.maximum(closing, 1.0)
        for track, value in zip(candidates, urgency.tolist(), strict=True):
            track.urgency_s = value
            track.in_conflict = False
        chosen = self._most_urgent(np.flatnonzero(~apart), urgency)
        self.counters["not_considered"] += count - len(chosen) - int(apart.sum())
        if self.settings.all_heights:
            chosen = np.concatenate([chosen, self._most_urgent(np.flatnonzero(apart), urgency)])
        kept = tuple(candidates[k] for k in chosen)
        return Snapshot(
            tracks=kept,
            position_ned_m=position[chosen],
            velocity_ned_mps=velocity[chosen],
            command_ned_mps=rows[chosen, 5:8],
            age_s=age[chosen],
            speed_mps=rows[chosen, 9],
            blind_growth_m=(rows[:, 10] * age)[chosen],
            error_bound_m=rows[chosen, 11],
            accuracy_bound_m=rows[chosen, 12],
            airframe_m=rows[chosen, 13],
            above_m=above[chosen],
            climb_mps=climb[chosen],
            vertical_bound_m=bound[chosen],
            apart=apart[chosen],
            avoiding=np.array([track.report.avoiding for track in kept], dtype=np.bool_),
            memory=np.array([track.memory for track in kept], dtype=np.int8),
        )

    def _most_urgent(self, chosen: NDArray[np.intp], urgency_s: FloatArray) -> NDArray[np.intp]:
        """As many of the chosen as may be considered, in their order where that is all of them."""
        most = self.settings.max_considered
        return chosen if len(chosen) <= most else chosen[np.argsort(urgency_s[chosen], kind="stable")[:most]]

    def _heights(
        self, own: OwnState, rows: FloatArray, age: FloatArray, above: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """The vertical bound of this instant, and who is known to stay further up or down within the horizon."""
        unknowable = (own.vertical_error_bound_m, self.settings.own_height_m)
        own_error, own_height = (math.nan if value is None else value for value in unknowable)
        error, height, climb = rows[:, 15], rows[:, 16], (-own.velocity_ned_mps[2], rows[:, 17])
        now = vertical_bound(
            above, error_m=(own_error, error), height_m=(own_height, height), climb_mps=climb, reserve_m=0.0
        )
        within = vertical_bound(
            above,
            error_m=(own_error, error),
            height_m=(own_height, height),
            climb_mps=climb,
            age_s=age,
            horizon_s=self.settings.vertical_horizon_s,
        )
        return now, known_apart(above, within)
