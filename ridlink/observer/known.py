"""Known aircraft, found by source, identity, position and name, at a cost that does not grow with their number.

Any sender can claim to be a thousand aircraft, so every search here is a table look-up.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass

from ridlink.remote_id.report import RemoteIdReport, SourceKey
from ridlink.remote_id.text import display_text

SAME_AIRCRAFT_M = 50.0
"""Two senders with the same identity within this distance are one aircraft, heard directly and relayed."""

SAME_INSTANT_S = 0.051
"""Half a step of the time in a 25-byte message, plus the rounding error of a float."""

SAME_HEIGHT_M = 0.6


@dataclass(slots=True, eq=False)
class Aircraft:
    """One aircraft.

    Attributes:
        number: Its number as long as it is in the air, even if its name changes.
        name: Its identity, else system and component id, with everything but printable ASCII as ``\\xNN``; unique.
        report: Its last report with a position.
        north_m, east_m: Position in that report, about the origin.
        interval_s: Smoothed time between reports, as told before one is measured.
        first_heard_s, last_heard_s: First and last time heard, on the caller's clock.
        reports: Number of its reports.
    """

    number: int
    name: str
    report: RemoteIdReport
    north_m: float
    east_m: float
    interval_s: float
    first_heard_s: float
    last_heard_s: float
    reports: int = 1

    @property
    def velocity_ne_mps(self) -> tuple[float, float]:
        """Reported velocity, zero if unknown."""
        velocity = self.report.velocity_ned_mps
        return (0.0, 0.0) if velocity is None else (velocity[0], velocity[1])


class Known:
    """Aircraft by source, and further sources of aircraft that are already known under another source.

    Args:
        most: Limit of aircraft, and of further sources; the one heard, or joined, longest ago is removed first.

    Attributes:
        aircraft: Aircraft by source, in the order in which they were first heard.
    """

    def __init__(self, most: int) -> None:
        self.aircraft: dict[SourceKey, Aircraft] = {}
        self._most = most
        self._last_number = 0
        self._by_silence: OrderedDict[SourceKey, None] = OrderedDict()
        self._same_as: OrderedDict[SourceKey, SourceKey] = OrderedDict()
        self._aliases: dict[SourceKey, set[SourceKey]] = {}
        self._places: dict[SourceKey, list[tuple[object, ...]]] = {}
        self._at: dict[tuple[object, ...], dict[SourceKey, Aircraft]] = {}
        self._names = _Names()

    def source_of(self, key: SourceKey) -> SourceKey:
        """The source under which the aircraft of this source is known, or would be."""
        return self._same_as.get(key, key)

    def meet(self, report: RemoteIdReport, north_m: float, east_m: float, interval_s: float, now_s: float) -> Aircraft:
        """Add a new aircraft."""
        if len(self.aircraft) >= self._most:
            self.remove(next(iter(self._by_silence)))
        self._last_number += 1
        name = self._names.take(called(report))
        new = Aircraft(self._last_number, name, report, north_m, east_m, interval_s, now_s, now_s)
        self.aircraft[report.key] = new
        self._by_silence[report.key] = None
        self._place(report.key, new)
        return new

    def move(self, key: SourceKey, report: RemoteIdReport, north_m: float, east_m: float) -> None:
        """Move an aircraft to the position of a report."""
        one = self.aircraft[key]
        one.report, one.north_m, one.east_m = report, north_m, east_m
        self._unplace(key)
        self._place(key, one)

    def heard(self, key: SourceKey, now_s: float) -> None:
        """Note that an aircraft was heard."""
        self.aircraft[key].last_heard_s = now_s
        self._by_silence.move_to_end(key)

    def rename(self, key: SourceKey) -> None:
        """Rename an aircraft by its present report."""
        one = self.aircraft[key]
        self._names.release(one.name)
        one.name = self._names.take(called(one.report))

    def remove(self, key: SourceKey) -> Aircraft:
        """Remove an aircraft and its further sources."""
        for alias in self._aliases.pop(key, ()):
            del self._same_as[alias]
        del self._by_silence[key]
        self._unplace(key)
        one = self.aircraft.pop(key)
        self._names.release(one.name)
        return one

    def join(self, key: SourceKey, into: SourceKey) -> None:
        """Join a source, and the further sources of its own aircraft, to an aircraft known under another source."""
        others = self._aliases.pop(key, set())
        if key in self.aircraft:
            self.remove(key)
        for alias in (*others, key):
            self._same_as[alias] = into
        self._aliases.setdefault(into, set()).update(others, (key,))
        while len(self._same_as) > self._most:
            alias, of = self._same_as.popitem(last=False)
            self._aliases[of].discard(alias)

    def twin(
        self, report: RemoteIdReport, north_m: float, east_m: float, besides: SourceKey | None = None
    ) -> SourceKey | None:
        """The source under which the same aircraft is already known: the one heard first."""
        found = [
            (one.number, key)
            for place in _looked_at(report, north_m, east_m)
            for key, one in self._at.get(place, {}).items()
            if key != besides and _is_same(report, north_m, east_m, one)
        ]
        return min(found)[1] if found else None

    def _place(self, key: SourceKey, one: Aircraft) -> None:
        self._places[key] = list(_found_at(one.report, one.north_m, one.east_m))
        for place in self._places[key]:
            self._at.setdefault(place, {})[key] = one

    def _unplace(self, key: SourceKey) -> None:
        for place in self._places.pop(key):
            here = self._at[place]
            del here[key]
            if not here:
                del self._at[place]


def _found_at(report: RemoteIdReport, north_m: float, east_m: float, around: int = 0) -> Iterator[tuple[object, ...]]:
    """Keys of an aircraft in the table: by its identity and position, and by the content and instant of its report.

    Args:
        report: Its report.
        north_m: Its position.
        east_m: Its position.
        around: Number of grid squares, and of time steps, to every side.
    """
    steps = range(-around, around + 1)
    if report.uas_id is not None:
        row, column = math.floor(north_m / SAME_AIRCRAFT_M), math.floor(east_m / SAME_AIRCRAFT_M)
        for north in steps:
            for east in steps:
                yield report.uas_id, row + north, column + east
    if report.timestamp_s is not None:
        instant = math.floor(report.timestamp_s / SAME_INSTANT_S)
        for later in steps:
            yield report.latitude_deg, report.longitude_deg, instant + later, "instant"


def _looked_at(report: RemoteIdReport, north_m: float, east_m: float) -> Iterator[tuple[object, ...]]:
    """Table keys of aircraft that may be the same one."""
    return _found_at(report, north_m, east_m, around=1)


def _is_same(report: RemoteIdReport, north_m: float, east_m: float, one: Aircraft) -> bool:
    if report.uas_id is None or one.report.uas_id is None:
        return is_repeated(report, one.report)
    near = math.hypot(one.north_m - north_m, one.east_m - east_m) <= SAME_AIRCRAFT_M
    return near and one.report.uas_id == report.uas_id


def is_repeated(report: RemoteIdReport, other: RemoteIdReport) -> bool:
    """Whether both reports have the same content and instant; 25-byte messages round their time."""
    return (
        report.timestamp_s is not None
        and other.timestamp_s is not None
        and abs(report.timestamp_s - other.timestamp_s) <= SAME_INSTANT_S
        and (report.latitude_deg, report.longitude_deg) == (other.latitude_deg, other.longitude_deg)
        and abs((report.altitude_geodetic_m or 0.0) - (other.altitude_geodetic_m or 0.0)) <= SAME_HEIGHT_M
    )


def called(report: RemoteIdReport) -> str:
    """Name of an aircraft by its report, if the name is free."""
    if report.uas_id:
        return display_text(report.uas_id)
    name = "/".join(map(str, report.source))
    if report.id_or_mac is not None:
        name += f"/{report.id_or_mac.rstrip(bytes(1)).hex(':')}"
    return name


class _Names:
    """Unique names: the second aircraft of a name becomes name#2."""

    def __init__(self) -> None:
        # Given names with the wanted name; for each wanted name, the least number that may be free, and the number of
        # users.
        self._taken: dict[str, str] = {}
        self._least_free: dict[str, int] = {}
        self._count: dict[str, int] = {}

    def take(self, wanted: str) -> str:
        """The wanted name, or the name with the least number that is free."""
        name, number = wanted, self._least_free.get(wanted, 2)
        if name in self._taken:
            while (name := f"{wanted}#{number}") in self._taken:
                number += 1
            self._least_free[wanted] = number
        self._taken[name] = wanted
        self._count[wanted] = self._count.get(wanted, 0) + 1
        return name

    def release(self, name: str) -> None:
        """Release a name."""
        wanted = self._taken.pop(name)
        self._count[wanted] -= 1
        if not self._count[wanted]:
            del self._count[wanted]
            self._least_free.pop(wanted, None)
        elif name != wanted:
            number = int(name.rpartition("#")[2])
            self._least_free[wanted] = min(self._least_free.get(wanted, number), number)
