"""One neighbour: its last report, how far that may be believed, how old it is, and which reports may follow it.

A track holds what was reported; nothing is extrapolated here. `age_s` is the time since the position was measured;
users of the position extrapolate it by that. Units and frames as in `RemoteIdReport`.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from enum import StrEnum

from msgspec.structs import replace

from ridlink.geodesy import offset_m
from ridlink.remote_id.quantities import SECONDS_PER_HOUR
from ridlink.remote_id.report import RemoteIdReport
from ridlink.traffic.doubt import Doubt
from ridlink.traffic.position_filter import PositionFilter

TrackKey = tuple[Hashable, int, int, bytes | None, int]
"""Link, system id, component id, for relayed data `id_or_mac`, and the number of the vehicle among those that use this
identity, from 0."""

SLOW_INTERVAL_S = 0.5
"""A sender with more time between reports is a standard one at 1 Hz."""

UNKNOWN_INTERVAL_S = 1.0
"""Time between the reports of a sender that does not tell it, until it is measured: the standard asks for one a
second."""

COAST_FAST_S = 5.0
COAST_SLOW_S = 10.0
"""A track that was not heard for this long is dropped: fifty lost reports in a row, or ten."""

SENDER_AGE_S = (-1.0, 5.0)
"""Plausible ages of a sender's timestamp; with any other age, its clock is wrong."""

CLOCK_SLACK_S = 2.0
"""A sender's clock runs as ours does, except for the delay of its datagrams."""

REACH_FACTOR = 1.5
"""Factor on the speed of a vehicle: a report further away from its last position is another vehicle's."""


class Update(StrEnum):
    """What a report did to its track."""

    MOVED = "moved"
    COMPLETED = "completed"
    """Same instant, with the errors, size and intent of a RIDLINK_SEPARATION."""
    REPEATED = "report_repeated"
    OLDER = "report_older"
    NO_POSITION = "report_without_position"


class Relation(StrEnum):
    """Relation of a report to a track with the same identity."""

    FOLLOWS = "follows"
    OUTDATED = "outdated"
    """As old as the last report, or older."""
    STRANGE = "strange"
    """Too far away, or too far ahead of its clock: another vehicle with this identity, or a forgery."""


def hours_apart_s(later_s: float, earlier_s: float) -> float:
    """Difference of two times past the full hour, within half an hour either way [s]."""
    return (later_s - earlier_s + SECONDS_PER_HOUR / 2.0) % SECONDS_PER_HOUR - SECONDS_PER_HOUR / 2.0


@dataclass(slots=True, eq=False)
class Track:
    """One neighbour.

    Attributes:
        key: Identity.
        report: Last report that moved or completed it.
        latitude_deg: Position at the time of that report, filtered.
        longitude_deg: The same.
        measured_at_s: Monotonic time at which the position was measured.
        received_at_s: Monotonic time of the last report with something new.
        began_at_s: Monotonic time of the first report.
        first_heard_m: Distance from us at the first report; None if our position was unknown.
        interval_s: Smoothed time between reports, as told before one is measured.
        memory: Solver's memory of the encounter.
        urgency_s: Time until it matters, as of the last snapshot; the larger, the sooner the track is given up.
        in_conflict: Whether it was predicted to enter our disc, as of the last decision.
        filter: Position filter.
        trusted_clock: Whether the timestamp of the report that moved it last agreed with our UTC.
        seen_elsewhere: Whether it bears our identity and was where we were not.
        doubt: Doubt about its figures.
    """

    key: TrackKey
    report: RemoteIdReport
    latitude_deg: float
    longitude_deg: float
    measured_at_s: float
    received_at_s: float
    filter: PositionFilter
    began_at_s: float = 0.0
    first_heard_m: float | None = None
    interval_s: float = UNKNOWN_INTERVAL_S
    memory: int = 0
    urgency_s: float = 0.0
    in_conflict: bool = False
    trusted_clock: bool = False
    seen_elsewhere: bool = False
    doubt: Doubt = field(default_factory=Doubt)

    @property
    def velocity_ned_mps(self) -> tuple[float, float, float]:
        """Reported velocity; zero if unknown."""
        return self.report.velocity_ned_mps or (0.0, 0.0, 0.0)

    def age_s(self, now_s: float) -> float:
        """Time since the position was measured."""
        return max(now_s - self.measured_at_s, 0.0)

    def expired(self, now_s: float) -> bool:
        """Whether it was not heard for so long that it is given up; later if it is slow, or in conflict."""
        silent = now_s - self.received_at_s
        # Who was heard once and tells no interval is not known to be slow: a flood consists of nobody else.
        known = self.received_at_s > self.began_at_s or self.report.update_interval_s is not None
        slow = known and self.interval_s > SLOW_INTERVAL_S
        return silent > (COAST_SLOW_S if slow or self.in_conflict else COAST_FAST_S)

    def metres_to(self, report: RemoteIdReport) -> float:
        """Distance of a reported position from the last one; infinite if one of them is missing."""
        last = self.report
        if last.latitude_deg is None or last.longitude_deg is None:
            return math.inf
        if report.latitude_deg is None or report.longitude_deg is None:
            return math.inf
        return math.hypot(
            *offset_m((last.latitude_deg, last.longitude_deg), (report.latitude_deg, report.longitude_deg))
        )

    def relation(
        self, report: RemoteIdReport, *, trusted_clock: bool, unknown_error_m: float, unknown_speed_mps: float
    ) -> Relation:
        """Relation of a report with a position to this track.

        An identity is no proof: two vehicles may have the same one, and anybody can forge it. A report that cannot be
        this vehicle's next one neither moves the track nor makes its true reports look late.

        Args:
            report: A report of the same identity.
            trusted_clock: True if its timestamp agrees with our UTC.
            unknown_error_m: Error bound of a report that states none.
            unknown_speed_mps: Speed of a vehicle that states none, and of one that may have become faster.
        """
        last = self.report
        gap = max(report.received_at_s - last.received_at_s, 0.0)
        if report.timestamp_s is not None and last.timestamp_s is not None:
            newer_s = hours_apart_s(report.timestamp_s, last.timestamp_s)
            if newer_s > gap + CLOCK_SLACK_S or (newer_s < 0.0 and trusted_clock and not self.trusted_clock):
                return Relation.STRANGE
            if newer_s < 0.0:
                return Relation.OUTDATED
            outdated = newer_s == 0.0
        else:
            outdated = False
        fastest = max(unknown_speed_mps, last.speed_horizontal_mps or 0.0, report.speed_horizontal_mps or 0.0)
        reach = REACH_FACTOR * fastest * gap + bound_m(last, unknown_error_m) + bound_m(report, unknown_error_m)
        if self.metres_to(report) <= reach:
            return Relation.FOLLOWS
        return Relation.OUTDATED if outdated else Relation.STRANGE

    def update(self, report: RemoteIdReport, measured_at_s: float, unknown_error_m: float) -> Update:
        """Take a report of the same sender.

        A timestamp already seen moves nothing and refreshes nothing, however often it comes; it may only complete the
        report with its extension. An older one, modulo the hour, is a late or replayed datagram.

        Args:
            report: The report.
            measured_at_s: Monotonic time at which its position was measured.
            unknown_error_m: Error bound of a report that states none.
        """
        last = self.report
        same_instant = report.received_at_s == last.received_at_s
        if report.timestamp_s is not None and last.timestamp_s is not None:
            newer_s = hours_apart_s(report.timestamp_s, last.timestamp_s)
            if newer_s < 0.0:
                return Update.OLDER
            same_instant = newer_s == 0.0
        if same_instant:
            if report == last:  # its RIDLINK_SEPARATION said nothing new
                return Update.COMPLETED
            report = replace(report, received_at_s=last.received_at_s)
            same_place = report.latitude_deg == last.latitude_deg and report.longitude_deg == last.longitude_deg
            if not report.extended or not same_place or report == last:
                return Update.REPEATED
            self.report = report
            if self.received_at_s == self.began_at_s:  # none was measured yet
                self.interval_s = report.update_interval_s or self.interval_s
            return Update.COMPLETED
        if report.latitude_deg is None or report.longitude_deg is None:
            return Update.NO_POSITION
        bound, resets = bound_m(report, unknown_error_m), self.filter.resets
        self.latitude_deg, self.longitude_deg = self.filter.update(
            report.latitude_deg, report.longitude_deg, report.velocity_ned_mps, bound, measured_at_s
        )
        if self.filter.resets > resets:
            self.doubt.add(self.filter.innovation_m - bound, report.received_at_s)
        gap = report.received_at_s - self.received_at_s
        self.interval_s = next_interval_s(self.interval_s, gap)
        self.report = report
        self.measured_at_s = measured_at_s
        self.received_at_s = report.received_at_s
        return Update.MOVED


def next_interval_s(interval_s: float, gap_s: float) -> float:
    """Smoothed time between reports after one more gap; an outage is no interval [s]."""
    return interval_s + 0.3 * (gap_s - interval_s) if 0.0 < gap_s < COAST_SLOW_S else interval_s


def bound_m(report: RemoteIdReport, unknown_error_m: float) -> float:
    """Three-sigma error of a report: as stated, else by its accuracy code, else `unknown_error_m`."""
    bound = report.horizontal_error_m if report.horizontal_error_m is not None else report.accuracy_bound_m
    return unknown_error_m if bound is None else bound


def new_track(
    key: TrackKey, report: RemoteIdReport, measured_at_s: float, *, filtered: bool, trusted_clock: bool = False
) -> Track:
    """Track that begins with a report.

    Raises:
        ValueError: If the report has no position.
    """
    if report.latitude_deg is None or report.longitude_deg is None:
        raise ValueError("a track begins with a position")
    smoother = PositionFilter() if filtered else PositionFilter(time_constant_s=0.0)
    smoother.update(report.latitude_deg, report.longitude_deg, report.velocity_ned_mps, 0.0, measured_at_s)
    return Track(
        key=key,
        report=report,
        latitude_deg=report.latitude_deg,
        longitude_deg=report.longitude_deg,
        measured_at_s=measured_at_s,
        received_at_s=report.received_at_s,
        filter=smoother,
        began_at_s=report.received_at_s,
        interval_s=report.update_interval_s or UNKNOWN_INTERVAL_S,
        trusted_clock=trusted_clock,
    )
