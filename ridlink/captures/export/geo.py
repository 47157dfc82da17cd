"""Tracks and points for maps: GeoJSON (RFC 7946) and KML.

Aircraft come from joined Remote ID, one track for each identity, and vehicles from their GLOBAL_POSITION_INT, one track
for each ``system/component``. Positions without latitude and longitude are left out. Altitudes are WGS-84 where the
sender gives them, else what it has: pressure altitude, or (of GLOBAL_POSITION_INT) above mean sea level.

Points are written as they come; of a track 32 bytes a point are kept until the end.
"""

from __future__ import annotations

import itertools
from array import array
from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO, NamedTuple
from xml.sax.saxutils import escape

import msgspec

from ridlink.captures.export.fields import Fields
from ridlink.captures.export.join import JOINED_NAMES, Joiner
from ridlink.captures.lines import clock_time, exact_seconds
from ridlink.captures.tlog import LATEST_TIME_US

VEHICLE_POSITION = "GLOBAL_POSITION_INT"
MAPPED_NAMES = (*JOINED_NAMES, VEHICLE_POSITION)
"""The messages that maps are made of."""

NO_TIME_US = -1
_POINT_PROPERTIES = ("ua_type", "status", "speed_horizontal_mps", "speed_vertical_mps", "direction_deg", "height_m",
                     "horizontal_error_m", "horizontal_accuracy_m", "transports")  # fmt: skip
_encode = msgspec.json.Encoder().encode


class Position(NamedTuple):
    """One position of one track; ``about`` holds what else is known."""

    track: str
    time_us: int | None
    longitude_deg: float
    latitude_deg: float
    altitude_m: float | None
    about: dict[str, Any]


def positions(messages: Iterable[Fields]) -> Iterator[Position]:
    """Positions of aircraft and vehicles in the order of time."""
    joiner = Joiner()
    for message in messages:
        if message.name == VEHICLE_POSITION:
            fields = message.fields
            if fields["lat"] or fields["lon"]:
                longitude_deg, latitude_deg = fields["lon"] / 1e7, fields["lat"] / 1e7
                if abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0:
                    yield Position(
                        message.source, message.time_us, longitude_deg, latitude_deg, fields["alt"] / 1e3, {}
                    )
        else:
            yield from _of_rows(joiner.receive(message))
    yield from _of_rows(joiner.flush())


def _of_rows(rows: Iterable[dict[str, Any]]) -> Iterator[Position]:
    for row in rows:
        if row["latitude_deg"] is None or row["longitude_deg"] is None:
            continue
        altitude_m = row["altitude_geodetic_m"]
        yield Position(
            f"{row['uas_id']}" if row["uas_id"] is not None else f"unidentified {row['sources']}",
            row["t"],
            row["longitude_deg"],
            row["latitude_deg"],
            row["altitude_barometric_m"] if altitude_m is None else altitude_m,
            {name: row[name] for name in _POINT_PROPERTIES if row[name] is not None},
        )


class _Track:
    """Positions of one track, packed."""

    def __init__(self) -> None:
        self.times = array("q")
        self.numbers = array("d")
        self.has_altitudes = True

    def add(self, position: Position) -> None:
        altitude_m = position.altitude_m
        self.has_altitudes = self.has_altitudes and altitude_m is not None
        self.times.append(NO_TIME_US if position.time_us is None else position.time_us)
        self.numbers.extend((position.longitude_deg, position.latitude_deg, 0.0 if altitude_m is None else altitude_m))

    def coordinates(self) -> list[list[float]]:
        width = 3 if self.has_altitudes else 2
        return [list(self.numbers[at : at + width]) for at in range(0, len(self.numbers), 3)]


def cut_at_antimeridian(line: list[list[float]]) -> list[list[list[float]]]:
    """A line in pieces that do not cross 180 degrees, as RFC 7946 section 3.1.9 has it."""
    pieces = [[line[0]]]
    for before, after in itertools.pairwise(line):
        span = after[0] - before[0]
        if abs(span) > 180.0:
            edge = 180.0 if before[0] > 0.0 else -180.0
            across = after[0] + 2.0 * edge - before[0]
            share = (edge - before[0]) / across if across else 0.0
            rest = [b + share * (a - b) for b, a in zip(before[1:], after[1:], strict=True)]
            pieces[-1].append([edge, *rest])
            pieces.append([[-edge, *rest]])
        pieces[-1].append(after)
    return pieces


def _time_range(track: _Track) -> dict[str, Any]:
    known = [time_us for time_us in track.times if time_us != NO_TIME_US]
    if not known or max(known) > LATEST_TIME_US:
        return {}
    return {"first_time": clock_time(min(known)), "last_time": clock_time(max(known))}


def write_geojson(messages: Iterable[Fields], out: BinaryIO) -> int:
    """One FeatureCollection: a Point for each position, then the track of each aircraft; how many positions."""
    tracks: dict[str, _Track] = {}
    out.write(b'{"type":"FeatureCollection","features":[')
    before = b"\n"
    count = 0
    for position in positions(messages):
        count += 1
        tracks.setdefault(position.track, _Track()).add(position)
        coordinates = [position.longitude_deg, position.latitude_deg]
        if position.altitude_m is not None:
            coordinates.append(position.altitude_m)
        properties: dict[str, Any] = {"track": position.track}
        if position.time_us is not None:
            properties["time"] = clock_time(position.time_us)
            properties["t"] = msgspec.Raw(exact_seconds(position.time_us).encode())
        point = {"type": "Point", "coordinates": coordinates}
        out.write(before + _encode({"type": "Feature", "geometry": point, "properties": properties | position.about}))
        before = b",\n"
    for name, track in tracks.items():
        line = track.coordinates()
        if len(line) < 2:
            continue
        pieces = cut_at_antimeridian(line)
        geometry: dict[str, Any] = (
            {"type": "LineString", "coordinates": pieces[0]}
            if len(pieces) == 1
            else {"type": "MultiLineString", "coordinates": pieces}
        )
        properties = {"track": name, "positions": len(line), **_time_range(track)}
        out.write(before + _encode({"type": "Feature", "geometry": geometry, "properties": properties}))
        before = b",\n"
    out.write(b"\n]}\n")
    return count


def write_kml(messages: Iterable[Fields], out: BinaryIO) -> int:
    """One placemark for each track, with times where the capture has them; how many positions."""
    tracks: dict[str, _Track] = {}
    count = 0
    for position in positions(messages):
        count += 1
        tracks.setdefault(position.track, _Track()).add(position)
    out.write(
        b'<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
        b'xmlns:gx="http://www.google.com/kml/ext/2.2">\n<Document>\n<name>ridlink</name>\n'
    )
    for name, track in tracks.items():
        out.write(f"<Placemark>\n<name>{escape(name)}</name>\n".encode())
        mode = "absolute" if track.has_altitudes else "clampToGround"
        line = track.coordinates()
        if any(not 0 <= time_us <= LATEST_TIME_US for time_us in track.times):
            text = " ".join(",".join(f"{value!r}" for value in place) for place in line)
            kind = "LineString" if len(line) > 1 else "Point"
            out.write(
                f"<{kind}><altitudeMode>{mode}</altitudeMode><coordinates>{text}</coordinates></{kind}>\n".encode()
            )
        else:
            out.write(f"<gx:Track>\n<altitudeMode>{mode}</altitudeMode>\n".encode())
            for time_us in track.times:
                out.write(f"<when>{clock_time(time_us)}</when>\n".encode())
            for place in line:
                out.write(f"<gx:coord>{' '.join(f'{value!r}' for value in place)}</gx:coord>\n".encode())
            out.write(b"</gx:Track>\n")
        out.write(b"</Placemark>\n")
    out.write(b"</Document>\n</kml>\n")
    return count
