"""Positions by track, written when all are known; in constant memory for tracks of any length."""

from __future__ import annotations

import os
import tempfile
from array import array
from collections.abc import Iterator
from typing import IO, Any, NamedTuple, Self

from ridlink.captures.columns import NO_TIME_US
from ridlink.captures.lines import clock_time
from ridlink.captures.tlog import LATEST_TIME_US

HALF_TURN_DEG = 180.0
POSITIONS_IN_MEMORY = 512
"""Positions of each track in memory; 32 bytes each."""


class Position(NamedTuple):
    """One position of one track; ``about`` holds what else is known."""

    track: str
    time_us: int | None
    longitude_deg: float
    latitude_deg: float
    altitude_m: float | None
    about: dict[str, Any]


class Tracks:
    """Positions of all tracks, packed; an unnamed temporary file holds those that exceed the limit in memory.

    Attributes:
        by_name: The tracks, in the order in which they began.
    """

    def __init__(self) -> None:
        self.by_name: dict[str, Track] = {}
        self._file: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (closed by __exit__)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, position: Position) -> None:
        """Append a position to its track."""
        track = self.by_name.setdefault(position.track, Track())
        track.add(position)
        if len(track.times) == POSITIONS_IN_MEMORY:
            track.parts.append(self._file.seek(0, os.SEEK_END))
            track.times.tofile(self._file)
            track.numbers.tofile(self._file)
            track.times, track.numbers = array("q"), array("d")

    def _parts(self, track: Track) -> Iterator[tuple[array[int], array[float]]]:
        for at in track.parts:
            times, numbers = array("q"), array("d")
            self._file.seek(at)
            times.fromfile(self._file, POSITIONS_IN_MEMORY)
            numbers.fromfile(self._file, 3 * POSITIONS_IN_MEMORY)
            yield times, numbers
        yield track.times, track.numbers

    def times(self, track: Track) -> Iterator[int]:
        """Time of each position [us since 1970]."""
        for times, _ in self._parts(track):
            yield from times

    def positions(self, name: str) -> Iterator[Position]:
        """The positions of a track whose positions all have altitudes; what else was known about them is not kept."""
        for times, numbers in self._parts(self.by_name[name]):
            for at, time_us in enumerate(times):
                time_or_none = None if time_us == NO_TIME_US else time_us
                longitude_deg, latitude_deg, altitude_m = numbers[3 * at : 3 * at + 3]
                yield Position(name, time_or_none, longitude_deg, latitude_deg, altitude_m, {})

    def line(self, track: Track) -> Iterator[list[float]]:
        """Longitude and latitude [deg] of each position, and altitude [m] if all of them have one."""
        width = 3 if track.has_altitudes else 2
        for _, numbers in self._parts(track):
            for at in range(0, len(numbers), 3):
                yield numbers[at : at + width].tolist()


class Track:
    """One track.

    Attributes:
        parts: Where in the file the first positions are, so many each time.
        times, numbers: The last positions: times, and longitude, latitude, altitude.
        count: Positions.
        has_altitudes: All have an altitude.
        first_us, last_us: Earliest and latest time, ``None`` where there is none.
        has_dates: All have a time that a calendar has.
    """

    def __init__(self) -> None:
        self.parts: list[int] = []
        self.times = array("q")
        self.numbers = array("d")
        self.count = 0
        self.has_altitudes = self.has_dates = True
        self.first_us: int | None = None
        self.last_us: int | None = None
        self.crosses_antimeridian = False
        self._longitude_deg: float | None = None

    def add(self, position: Position) -> None:
        """Append a position."""
        altitude_m, time_us = position.altitude_m, position.time_us
        self.count += 1
        self.has_altitudes = self.has_altitudes and altitude_m is not None
        self.has_dates = self.has_dates and time_us is not None and 0 <= time_us <= LATEST_TIME_US
        if time_us is not None:
            self.first_us = time_us if self.first_us is None else min(self.first_us, time_us)
            self.last_us = time_us if self.last_us is None else max(self.last_us, time_us)
        if self._longitude_deg is not None and abs(position.longitude_deg - self._longitude_deg) > HALF_TURN_DEG:
            self.crosses_antimeridian = True
        self._longitude_deg = position.longitude_deg
        self.times.append(NO_TIME_US if time_us is None else time_us)
        self.numbers.extend((position.longitude_deg, position.latitude_deg, 0.0 if altitude_m is None else altitude_m))

    def time_range(self) -> dict[str, str]:
        """Earliest and latest time, if a calendar has them."""
        if self.first_us is None or self.last_us is None or self.last_us > LATEST_TIME_US:
            return {}
        return {"first_time": clock_time(self.first_us), "last_time": clock_time(self.last_us)}
