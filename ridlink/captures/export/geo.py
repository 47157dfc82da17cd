"""Tracks and points for maps: GeoJSON (RFC 7946) and KML.

Aircraft are taken from joined Remote ID, one track for each identity. A vehicle whose system id sends no position by
Remote ID is taken from its GLOBAL_POSITION_INT, one track for each ``system/component``. On request the telemetry of
all other vehicles is included, too; these then have two tracks. Positions without latitude and longitude are left out.
Altitudes are WGS-84 if the sender gives them, else pressure altitude, or (for GLOBAL_POSITION_INT) above mean sea
level.

Points are written in the order of the input, tracks at the end.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

import msgspec

from ridlink.captures.export.fields import Fields
from ridlink.captures.export.join import JOINED_NAMES, LOCATION, Joiner
from ridlink.captures.export.tracks import HALF_TURN_DEG, Position, Tracks
from ridlink.captures.lines import clock_time, exact_seconds

VEHICLE_POSITION = "GLOBAL_POSITION_INT"
MAPPED_NAMES = (*JOINED_NAMES, VEHICLE_POSITION)
"""The messages that maps need."""

_POINT_PROPERTIES = ("ua_type", "status", "speed_horizontal_mps", "speed_vertical_mps", "direction_deg", "height_m",
                     "horizontal_error_m", "horizontal_accuracy_m", "transports")  # fmt: skip
_encode = msgspec.json.Encoder().encode


def positions(messages: Iterable[Fields], *, telemetry: bool = False) -> Iterator[Position]:
    """Positions of aircraft in the order of time, then those of vehicles that send none by Remote ID.

    Args:
        messages: In the order of the file.
        telemetry: Positions of all vehicles, in between.
    """
    joiner, identified = Joiner(), set()
    with Tracks() as aside:
        for message in messages:
            if message.name == VEHICLE_POSITION:
                position = _of_telemetry(message)
                if position is not None and telemetry:
                    yield position
                elif position is not None:
                    aside.add(position)
                continue
            if message.name == LOCATION and _is_of_its_sender(message):
                identified.add(_system(message.source))
            yield from _of_rows(joiner.receive(message))
        yield from _of_rows(joiner.flush())
        for source in aside.by_name:
            if _system(source) not in identified:
                yield from aside.positions(source)


def _is_of_its_sender(location: Fields) -> bool:
    """Whether a position is the sender's own: over MAVLink it then has no address; receivers relay others with one."""
    fields = location.fields
    return "/" in location.source and fields["id_or_mac"] is None and fields["latitude_deg"] is not None


def _system(source: str) -> str:
    return source.partition("/")[0]


def _of_telemetry(message: Fields) -> Position | None:
    fields = message.fields
    longitude_deg, latitude_deg = fields["lon"] / 1e7, fields["lat"] / 1e7
    if not (fields["lat"] or fields["lon"]) or abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
        return None
    return Position(message.source, message.time_us, longitude_deg, latitude_deg, fields["alt"] / 1e3, {})


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


def cut_at_antimeridian(line: Iterable[list[float]]) -> Iterator[list[float] | None]:
    """A line in pieces that do not cross 180 degrees, as RFC 7946 section 3.1.9 has it; ``None`` where one begins."""
    before: list[float] | None = None
    for after in line:
        if before is not None and abs(after[0] - before[0]) > HALF_TURN_DEG:
            edge = HALF_TURN_DEG if before[0] > 0.0 else -HALF_TURN_DEG
            across = after[0] + 2.0 * edge - before[0]
            share = (edge - before[0]) / across if across else 0.0
            rest = [b + share * (a - b) for b, a in zip(before[1:], after[1:], strict=True)]
            yield [edge, *rest]
            yield None
            yield [-edge, *rest]
        yield after
        before = after


def write_geojson(messages: Iterable[Fields], out: BinaryIO, *, telemetry: bool = False) -> int:
    """One FeatureCollection: a Point for each position, then the track of each aircraft; how many positions."""
    out.write(b'{"type":"FeatureCollection","features":[')
    before = b"\n"
    count = 0
    with Tracks() as tracks:
        for position in positions(messages, telemetry=telemetry):
            count += 1
            tracks.add(position)
            coordinates = [position.longitude_deg, position.latitude_deg]
            if position.altitude_m is not None:
                coordinates.append(position.altitude_m)
            properties: dict[str, Any] = {"track": position.track}
            if position.time_us is not None:
                properties["time"] = clock_time(position.time_us)
                properties["t"] = msgspec.Raw(exact_seconds(position.time_us).encode())
            point = {"type": "Point", "coordinates": coordinates}
            feature = {"type": "Feature", "geometry": point, "properties": properties | position.about}
            out.write(before + _encode(feature))
            before = b",\n"
        for name, track in tracks.by_name.items():
            if track.count < 2:
                continue
            out.write(before + b'{"type":"Feature","geometry":')
            _write_line(tracks.line(track), track.crosses_antimeridian, out)
            out.write(b',"properties":%b}' % _encode({"track": name, "positions": track.count, **track.time_range()}))
    out.write(b"\n]}\n")
    return count


def _write_line(line: Iterable[list[float]], in_pieces: bool, out: BinaryIO) -> None:
    """The geometry of a track, one position after the other."""
    out.write(b'{"type":"MultiLineString","coordinates":[[' if in_pieces else b'{"type":"LineString","coordinates":[')
    between = b""
    for place in cut_at_antimeridian(line):
        if place is None:
            out.write(b"],[")
            between = b""
        else:
            out.write(between + _encode(place))
            between = b","
    out.write(b"]]}" if in_pieces else b"]}")


def write_kml(messages: Iterable[Fields], out: BinaryIO, *, telemetry: bool = False) -> int:
    """One placemark for each track, with times where the capture has them; how many positions."""
    count = 0
    out.write(
        b'<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
        b'xmlns:gx="http://www.google.com/kml/ext/2.2">\n<Document>\n<name>ridlink</name>\n'
    )
    with Tracks() as tracks:
        for position in positions(messages, telemetry=telemetry):
            count += 1
            tracks.add(position)
        for name, track in tracks.by_name.items():
            out.write(f"<Placemark>\n<name>{escape(name)}</name>\n".encode())
            mode = "absolute" if track.has_altitudes else "clampToGround"
            if track.has_dates:
                out.write(f"<gx:Track>\n<altitudeMode>{mode}</altitudeMode>\n".encode())
                for time_us in tracks.times(track):
                    out.write(f"<when>{clock_time(time_us)}</when>\n".encode())
                for place in tracks.line(track):
                    out.write(f"<gx:coord>{' '.join(map(repr, place))}</gx:coord>\n".encode())
                out.write(b"</gx:Track>\n")
            else:
                kind = b"LineString" if track.count > 1 else b"Point"
                out.write(b"<%b><altitudeMode>%b</altitudeMode><coordinates>" % (kind, mode.encode()))
                for number, place in enumerate(tracks.line(track)):
                    out.write(f"{' ' if number else ''}{','.join(map(repr, place))}".encode())
                out.write(b"</coordinates></%b>\n" % kind)
            out.write(b"</Placemark>\n")
    out.write(b"</Document>\n</kml>\n")
    return count
