"""Aircraft in the air: Remote ID of any number of senders, joined, named, and forgotten when a sender falls silent.

Positions are in metres north and east of one origin, which is the first position heard unless another is given. Older
positions are extrapolated with their reported velocity. Senders are not trusted: memory is bounded, and names are
printable.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

import numpy as np
from msgspec.structs import replace

from ridlink.geodesy import Geodetic, offset_m
from ridlink.mavlink.codec import decode_message
from ridlink.mavlink.frames import Frame
from ridlink.observer.known import Aircraft, Known, is_repeated
from ridlink.observer.scene import FloatArray, Scene
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.bridge import REMOTE_ID_IDS, messages_of
from ridlink.remote_id.messages import RemoteIdMessage
from ridlink.remote_id.quantities import FieldRejects
from ridlink.remote_id.report import RemoteIdReport, SourceKey
from ridlink.separation.reference import REPORT_INTERVAL_S
from ridlink.traffic.track import UNKNOWN_INTERVAL_S, next_interval_s

FORGET_AFTER_S = 10.0
"""Silence after which an aircraft is no longer in the air: ten messages of a standard sender."""

MAX_AIRCRAFT = 2000
MERGED_KEPT = 256
UNKNOWN = (math.nan, math.nan, math.nan)


class Sky:
    """The aircraft in the air.

    Args:
        origin: Origin of positions; by default the first position heard.
        forget_after_s: Silence after which an aircraft is gone.
        max_aircraft: Limit of aircraft; the one heard longest ago is removed first.
        convention: How accuracy codes are read.

    Attributes:
        aircraft: Aircraft by source.
        rejects: Messages and fields that were not taken, by cause.
        origin: None until a position was heard.
        met: Number of aircraft so far, without those that turned out to be another one.
    """

    def __init__(
        self,
        *,
        origin: Geodetic | None = None,
        forget_after_s: float = FORGET_AFTER_S,
        max_aircraft: int = MAX_AIRCRAFT,
        convention: AccuracyConvention | str = DEFAULT_CONVENTION,
    ) -> None:
        self._known = Known(max_aircraft)
        self.aircraft = self._known.aircraft
        self.rejects = FieldRejects()
        self.origin = origin
        self.met = 0
        self._forget_after_s = forget_after_s
        self._assembler = ReportAssembler(max_aircraft, convention=convention)
        self._merged: deque[int] = deque(maxlen=MERGED_KEPT)

    def receive(self, frame: Frame, now_s: float) -> Aircraft | None:
        """Receive a frame; returns the aircraft that it moved or completed, if any.

        Args:
            frame: A frame as parsed; frames without Remote ID change nothing.
            now_s: Time of receipt, on a clock that never goes back.
        """
        if not frame.checked or frame.msgid not in REMOTE_ID_IDS:
            return None
        return self.hear(frame, messages_of(decode_message(frame), self.rejects), now_s)

    def hear(self, frame: Frame, said: Iterable[RemoteIdMessage], now_s: float) -> Aircraft | None:
        """The same of a frame whose messages are known already."""
        moved = None
        for part in said:
            report = self._assembler.receive((frame.sysid, frame.compid), part, now_s)
            if report is not None:
                moved = self.take(report, now_s) or moved
        return moved

    def forget_silent(self, now_s: float) -> list[Aircraft]:
        """Remove and return aircraft that were silent for too long."""
        gone = [key for key, one in self.aircraft.items() if now_s - one.last_heard_s > self._forget_after_s]
        return [self._known.remove(key) for key in gone]

    def at(self, now_s: float, *, missed: float = math.inf, settled_s: float = 0.0) -> Scene:
        """All aircraft in the air, at their present positions.

        Args:
            now_s: The instant.
            missed: Leave out aircraft that were silent for more than this number of their own intervals.
            settled_s: Leave out aircraft heard for less than this time that have not sent their error yet.
        """
        flying = [
            one
            for one in self.aircraft.values()
            if not one.report.on_ground
            and now_s - one.last_heard_s <= missed * max(one.interval_s, REPORT_INTERVAL_S)
            and (one.report.extended or now_s - one.first_heard_s >= settled_s)
        ]
        age = np.array([max(0.0, now_s - one.last_heard_s) for one in flying], np.float64)
        position = np.array([(one.north_m, one.east_m) for one in flying], np.float64).reshape(-1, 2)
        velocity = np.array([one.velocity_ne_mps for one in flying], np.float64).reshape(-1, 2)
        command = [one.report.commanded_ned_mps or UNKNOWN for one in flying]

        def column(name: str) -> FloatArray:
            values = [getattr(one.report, name) for one in flying]
            return np.array([math.nan if value is None else value for value in values], np.float64)

        return Scene(
            time_s=now_s,
            numbers=tuple(one.number for one in flying),
            names=tuple(one.name for one in flying),
            position_ne_m=position + velocity * age[:, None],
            velocity_ne_mps=velocity,
            speed_mps=column("speed_horizontal_mps"),
            airframe_m=column("airframe_size_m"),
            error_bound_m=column("horizontal_error_m"),
            accuracy_bound_m=column("accuracy_bound_m"),
            interval_s=np.array([one.interval_s for one in flying], np.float64),
            age_s=age,
            altitude_m=column("altitude_geodetic_m"),
            climb_mps=column("climb_mps"),
            vertical_error_m=column("vertical_error_m"),
            airframe_height_m=column("airframe_height_m"),
            command_ne_mps=np.array(command, np.float64).reshape(-1, 3)[:, :2],
            avoiding=np.array([one.report.avoiding for one in flying], np.bool_),
            merged=frozenset(self._merged),
        )

    def forget(self, key: SourceKey) -> Aircraft | None:
        """Remove an aircraft: it is gone, or better known under another source."""
        return self._known.remove(key) if key in self.aircraft else None

    def take(self, report: RemoteIdReport, now_s: float) -> Aircraft | None:
        """Receive a complete report; returns the aircraft that it moved, if any.

        Args:
            report: The report.
            now_s: Time of receipt, on the clock of `receive`.
        """
        if report.latitude_deg is None or report.longitude_deg is None:
            return None
        if self.origin is None:
            self.origin = Geodetic(report.latitude_deg, report.longitude_deg, 0.0)
        origin = (self.origin.latitude_deg, self.origin.longitude_deg)
        north_m, east_m = offset_m(origin, (report.latitude_deg, report.longitude_deg))
        key = self._known.source_of(report.key)
        if key not in self.aircraft:
            twin = self._known.twin(report, north_m, east_m)
            if twin is None:
                self.met += 1
                return self._known.meet(report, north_m, east_m, report.update_interval_s or UNKNOWN_INTERVAL_S, now_s)
            self._known.join(key, twin)
            key = twin
        known = self.aircraft[key]
        if report.received_at_s < known.report.received_at_s:  # completed late, and a newer one came over another link
            return None
        if report.received_at_s > known.report.received_at_s:
            if is_repeated(report, known.report):  # by its sender, or over another link
                if known.report.extended or not report.extended:
                    return None
                report = replace(report, received_at_s=known.report.received_at_s)
            else:
                known.interval_s = next_interval_s(known.interval_s, now_s - known.last_heard_s)
                self._known.heard(key, now_s)
                known.reports += 1
        if known.reports == 1:  # no interval was measured yet
            known.interval_s = report.update_interval_s or known.interval_s
        if report.uas_id is None and known.report.uas_id is not None:  # its relay sent the identity, it did not
            report = replace(report, uas_id=known.report.uas_id)
        renamed = report.uas_id != known.report.uas_id
        self._known.move(key, report, north_m, east_m)
        if renamed:
            twin = self._known.twin(report, north_m, east_m, besides=key)
            if twin is not None:
                self._merged.append(known.number)
                self.met -= 1
                self._known.join(key, twin)
                return self.aircraft[twin]
            self._known.rename(key)
        return known
