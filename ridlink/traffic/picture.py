"""The traffic picture: reports in, the neighbours that count as arrays out.

Positions leave as north-east-down metres about the present own position, never about a cached origin. Counters tell
what does not count: echoes of ourselves, vehicles on the ground, vehicles known to be far above or below. Nothing here
trusts a sender, and nothing grows without bound. New tracks are let in at a bounded rate. If there is no room the least
urgent track gives way, but none that has been heard for a while and is in conflict.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Hashable
from typing import Any

import numpy as np

from ridlink.geodesy import offset_m
from ridlink.remote_id.report import RemoteIdReport
from ridlink.traffic.flood import NewcomerGate
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.snapshot import PictureSettings, Snapshot, blind_speed_mps, look
from ridlink.traffic.track import SENDER_AGE_S, Relation, Track, TrackKey, Update, bound_m, hours_apart_s, new_track

VEHICLES_PER_IDENTITY = 4
DISPLACED_AFTER_S = 3.0
"""VEHICLES_PER_IDENTITY vehicles with one identity are followed side by side. One that is silent for DISPLACED_AFTER_S,
or less urgent, gives way to another."""


ESTABLISHED_S = 2.0


def _established(track: Track) -> bool:
    """Whether a track is safe from newcomers: heard for a while and in conflict; for half of the picture at most."""
    return track.in_conflict and track.received_at_s - track.began_at_s >= ESTABLISHED_S


def _bare(identity: bytes | None) -> bytes | None:
    """An identity without the zeros that fill its field."""
    return None if identity is None else identity.rstrip(b"\x00")


class TrafficPicture:
    """All tracks of one own-ship.

    Attributes:
        counters: Reports by what happened to them, and why tracks do not count.
        tracks: Tracks by key.
    """

    def __init__(self, settings: PictureSettings) -> None:
        self.settings = settings
        self.counters: Counter[str] = Counter()
        self.tracks: dict[TrackKey, Track] = {}
        self._own: OwnState | None = None
        self._least_urgent: list[Track] | None = None
        self._gate = NewcomerGate(settings.new_per_second)

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
        own_names: Collection[bytes] = (),
        source: Hashable = None,
    ) -> None:
        """Take a report.

        Args:
            link: Link on which it was heard; the same sender heard on two links makes two tracks.
            report: The report.
            utc_s: UTC when it was received, of which only the part within the hour counts; without it the sender's own
                timestamp says nothing about its age.
            own_sysid: Own system id.
            own_names: Own identities in Remote ID, without the zeros that fill their field.
            source: Address of the sender.
        """
        age_s = self._sender_age_s(report, utc_s)
        relations = self._relations((link, *report.key), report, trusted_clock=age_s is not None)
        following = [track for track, relation in relations.items() if relation is Relation.FOLLOWS]
        track = following[0] if following else None
        if len(following) > 1:
            track = min(following, key=lambda each: each.metres_to(report))
        if self._is_echo(report, track, own_sysid, own_names):
            self.counters["own_echo"] += 1
            if track is not None and not track.seen_elsewhere:  # begun before our name was known
                del self.tracks[track.key]
        elif track is not None:
            self._update(track, report, age_s)
        elif Relation.OUTDATED in relations.values():
            last = [each.report.timestamp_s for each, relation in relations.items() if relation is Relation.OUTDATED]
            self.counters[Update.REPEATED if report.timestamp_s in last else Update.OLDER] += 1
        else:
            self._begin((link, *report.key), relations, report, age_s, source)

    def _relations(
        self, identity: tuple[Any, ...], report: RemoteIdReport, *, trusted_clock: bool
    ) -> dict[Track, Relation]:
        """Tracks with the identity of a report, and the relation of the report to each."""
        relations: dict[Track, Relation] = {}
        for number in range(VEHICLES_PER_IDENTITY):
            track = self.tracks.get((*identity, number))
            if track is not None:
                relations[track] = track.relation(
                    report,
                    trusted_clock=trusted_clock,
                    unknown_error_m=self.settings.unknown_error_m,
                    unknown_speed_mps=self.settings.unknown_speed_mps,
                )
        return relations

    def _update(self, track: Track, report: RemoteIdReport, age_s: float | None) -> None:
        update = track.update(report, report.received_at_s - (age_s or 0.0), self.settings.unknown_error_m)
        if update is Update.MOVED:
            track.trusted_clock = age_s is not None
        if update not in (Update.MOVED, Update.COMPLETED):
            self.counters[update] += 1
        else:
            self._flag(report)

    def _flag(self, report: RemoteIdReport) -> None:
        """Count figures that are taken for less than they say."""
        if (report.horizontal_error_m or 0.0) >= self.settings.unusable_error_m:
            self.counters["position_unusable"] += 1
        if (report.airframe_size_m or 0.0) > self.settings.absurd_airframe_m:
            self.counters["airframe_absurd"] += 1

    def _begin(
        self,
        identity: tuple[Any, ...],
        others: Collection[Track],
        report: RemoteIdReport,
        age_s: float | None,
        source: Hashable,
    ) -> None:
        """Begin a new track, beside any others with the same identity."""
        if report.latitude_deg is None or report.longitude_deg is None:
            self.counters[Update.NO_POSITION] += 1
            return
        if not self._gate.admit(source, report.received_at_s):
            self.counters["newcomer_refused"] += 1
            return
        if others:
            self.counters["identity_doubtful"] += 1
        track = new_track(
            (*identity, len(others)),
            report,
            report.received_at_s - (age_s or 0.0),
            filtered=self.settings.filtered,
            trusted_clock=age_s is not None,
        )
        if others:  # nobody can say which of them is the true one
            track.doubt.add(bound_m(report, self.settings.unknown_error_m), report.received_at_s)
        if self._own is not None:
            here = (self._own.position.latitude_deg, self._own.position.longitude_deg)
            track.first_heard_m = math.hypot(*offset_m(here, (track.latitude_deg, track.longitude_deg)))
            track.urgency_s = math.inf if report.on_ground else self._urgency_of(track, self._own)
        number = self._number_among(others, track)
        if number is None:
            self.counters["track_refused"] += 1
            return
        if len(self.tracks) >= self.settings.max_tracks and not self._make_room(track):
            self.counters["track_refused"] += 1
            return
        track.key = (*identity, number)
        self.tracks[track.key] = track
        self._flag(report)

    def _number_among(self, others: Collection[Track], newcomer: Track) -> int | None:
        """Number of a newcomer among the vehicles with its identity; None if there is no free one and none gives way.

        One that has fallen silent gives way, and one that is less urgent: four that are far away must not hide a fifth.
        """
        taken = {track.key[-1] for track in others}
        free = next((k for k in range(VEHICLES_PER_IDENTITY) if k not in taken), None)
        if free is not None:
            return free
        gives_way = min(others, key=lambda track: track.received_at_s)
        if newcomer.received_at_s - gives_way.received_at_s < DISPLACED_AFTER_S:
            passing = [track for track in others if not _established(track)]
            gives_way = max(passing, key=lambda track: track.urgency_s, default=newcomer)
            if gives_way.urgency_s <= newcomer.urgency_s:
                return None
        del self.tracks[gives_way.key]
        self.counters["track_displaced"] += 1
        return gives_way.key[-1]

    def _is_echo(
        self, report: RemoteIdReport, track: Track | None, own_sysid: int | None, own_names: Collection[bytes]
    ) -> bool:
        """Whether a report is our own, come back: our identity *and* our position. Our identity elsewhere is an
        intruder, and stays one when it comes near: its next report is nearer to its last one than to us. A vehicle that
        has our system id, as all fresh autopilots have the same one, but another name than ours is somebody else,
        wherever it is."""
        by_sysid = own_sysid is not None and report.source[0] == own_sysid and report.id_or_mac is None
        by_name = _bare(report.uas_id) in own_names or _bare(report.id_or_mac) in own_names
        differs = bool(own_names) and report.uas_id is not None and not by_name
        if not by_name and (not by_sysid or differs):
            return False
        own = self._own
        if own is None or report.latitude_deg is None or report.longitude_deg is None:
            # without a place there is nothing to track, and nothing to steer either
            return track is None or not track.seen_elsewhere
        here = (own.position.latitude_deg, own.position.longitude_deg)
        distance = math.hypot(*offset_m(here, (report.latitude_deg, report.longitude_deg)))
        bound = self.settings.unknown_error_m if report.horizontal_error_m is None else report.horizontal_error_m
        bound = min(bound, self.settings.unusable_error_m)
        gate_m = own.error_bound_m + bound + 2.0 * own.speed_mps + self.settings.echo_margin_m
        if distance <= gate_m:
            if track is not None and (track.first_heard_m or 0.0) > gate_m:  # it came here from afar, so it is not us
                track.seen_elsewhere = True
            return track is None or not track.seen_elsewhere or track.metres_to(report) >= distance
        if track is not None:
            track.seen_elsewhere = True
        self.counters["own_id_elsewhere"] += 1
        return False

    def _sender_age_s(self, report: RemoteIdReport, utc_s: float | None) -> float | None:
        """Age of a report by its own timestamp; None if that is missing or does not agree with our UTC."""
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
            # Urgency is cheap to forge, persistence less so: half of the room is for tracks that have shown it.
            ranked = sorted(self.tracks.values(), key=lambda track: track.urgency_s)
            kept = [track for track in ranked if _established(track)][: self.settings.max_tracks // 2]
            stay = set(kept)
            self._least_urgent = [track for track in ranked if track not in stay]
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

    # --- out ------------------------------------------------------------------------------------------------------

    def drop_silent(self, now_s: float) -> None:
        """Drop tracks that were not heard for too long; called every step, with or without own state."""
        silent = [key for key, track in self.tracks.items() if track.expired(now_s)]
        for key in silent:
            del self.tracks[key]
        self.counters["track_lost"] += len(silent)

    def forget_own_state(self) -> None:
        """Forget the own state once it is unknown, so that new reports are not compared with an old position."""
        self._own = None

    def _urgency_of(self, track: Track, own: OwnState) -> float:
        here = (own.position.latitude_deg, own.position.longitude_deg)
        north, east = offset_m(here, (track.latitude_deg, track.longitude_deg))
        distance = math.hypot(north, east)
        velocity = track.velocity_ned_mps
        closing = blind_speed_mps(track, self.settings)
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
        airborne = [track for track in self.tracks.values() if not track.report.on_ground]
        self.counters["on_ground"] += len(self.tracks) - len(airborne)
        sight = look(airborne, own, now_s, self.settings)
        for track in self.tracks.values():  # tracks that do not count must not hold the room of others
            track.urgency_s, track.in_conflict = math.inf, False
        matters_s = np.where(sight.everybody.apart & (not self.settings.all_heights), math.inf, sight.urgency_s)
        for track, value in zip(airborne, matters_s.tolist(), strict=True):
            track.urgency_s = value
        return sight.chosen(self.settings.max_considered, self.counters, all_heights=self.settings.all_heights)
