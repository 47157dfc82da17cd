"""Scenarios from GeoJSON tracks (RFC 7946): one LineString a vehicle, flown from its first point to its last.

Coordinates are longitude, latitude and altitude above the ellipsoid. Properties of a feature that are read:
``speed_mps``, ``cooperative``, those of ``vehicle_keys``, and ``times`` (seconds, one a point), which gives the speed
if ``speed_mps`` is missing. Other properties are ignored. Tracks are flown as drawn; a vehicle with ``cooperative``
true has the last point as its goal and finds its own way.

Home is the middle of all points, 50 m below the lowest; a track without altitudes is flown 50 m above it.
"""

from __future__ import annotations

import json
import math
import reprlib
from itertools import pairwise
from pathlib import Path
from typing import Any

from ridlink.checked_toml import MOST_FAULTS, UNREADABLE, CheckedTable, TomlSource, finite_number
from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.scenario.model import DEFAULT_SPEED_MPS, MOST_SPEED_MPS, Point3, Scenario, VehicleSpec
from ridlink.scenario.vehicle_keys import read_vehicle_keys
from ridlink.units import wrap_deg

FLOOR_M = 50.0
"""Height of the lowest point above home."""

PATIENCE = 3.0
"""A scenario of tracks ends after this many times its longest straight flight, but not before a minute."""

LEAST_DURATION_S = 60.0

MIN_LENGTH_M = 1.0


def load_tracks(path: str | Path, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """A scenario from a GeoJSON file.

    Args:
        path: The file.
        speed_mps: Speed of tracks for which the file gives none.

    Raises:
        ConfigError: If the file is no GeoJSON, or a feature is no track: file, feature, key, what would be right. One
            line for each mistake, the first as its text, up to four more as `others`.
        OSError: If the file cannot be read.
    """
    name = str(path)
    try:
        document = json.loads(Path(path).read_bytes())
    except UnicodeDecodeError as error:
        raise ConfigError(f"{name}: is not UTF-8 text: {error.reason}") from error
    except json.JSONDecodeError as error:
        raise ConfigError(f"{name}:{error.lineno}: is not JSON: {error.msg}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{name}: {UNREADABLE}") from error
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise ConfigError(f"{name}: is not a GeoJSON FeatureCollection")
    tracks, faults = [], list[ConfigError]()
    for number, feature in enumerate(features, start=1):
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        if isinstance(geometry, dict) and geometry.get("type") == "LineString":
            try:
                tracks.append(_Track(name, number, feature, geometry))
            except ConfigError as error:
                faults.append(error)
    _refuse(faults)
    if not tracks:
        raise ConfigError(f"{name}: has no feature with a LineString, which is what a track is")
    points = [point for track in tracks for point in track.points]
    altitudes = [point[2] for point in points if point[2] is not None]
    home = Geodetic(
        _middle([point[1] for point in points]),
        _middle_longitude([point[0] for point in points]),
        min(altitudes) - FLOOR_M if altitudes else 0.0,
    )
    made = [track.vehicle(home, speed_mps, faults) for track in tracks]
    _refuse(faults)
    vehicles = tuple(vehicle for vehicle in made if vehicle is not None)
    duration_s = max(PATIENCE * _length_m(vehicle) / vehicle.speed_mps for vehicle in vehicles)
    try:
        return Scenario(
            Path(path).stem,
            max(duration_s, LEAST_DURATION_S),
            vehicles,
            home_deg_m=(home.latitude_deg, home.longitude_deg, home.altitude_m),
        )
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None


def _middle(values: list[float]) -> float:
    return (min(values) + max(values)) / 2.0


def _middle_longitude(values_deg: list[float]) -> float:
    if max(values_deg) - min(values_deg) <= 180.0:
        return _middle(values_deg)
    return wrap_deg(_middle([value % 360.0 for value in values_deg]))  # across the date line


def _refuse(faults: list[ConfigError]) -> None:
    if faults:
        raise ConfigError(*map(str, faults[:MOST_FAULTS]))


class _Track:
    """One feature, checked."""

    def __init__(self, name: str, number: int, feature: dict[str, Any], geometry: dict[str, Any]) -> None:
        self._where = f"{name}: feature {number}"
        properties = feature.get("properties") or {}
        if not isinstance(properties, dict):
            raise ConfigError(f"{self._where}: properties must be an object")
        self._table = CheckedTable(TomlSource(name, ""), properties, "feature", number)
        coordinates = geometry.get("coordinates")
        if not isinstance(coordinates, list) or len(coordinates) < 2:
            raise ConfigError(f"{self._where}: coordinates must list at least two points")
        self.points = [self._point(position) for position in coordinates]

    def _point(self, position: object) -> tuple[float, float, float | None]:
        if not isinstance(position, list) or not 2 <= len(position) <= 4:
            raise ConfigError(
                f"{self._where}: coordinates: a point is [longitude, latitude, altitude], not {position!r}"
            )
        numbers: list[float] = []
        for value in position:
            number = finite_number(value)
            if number is None:
                raise ConfigError(f"{self._where}: coordinates: {reprlib.repr(value)} is not a finite number")
            numbers.append(number)
        longitude, latitude = numbers[:2]
        if not (abs(longitude) <= 180.0 and abs(latitude) <= 90.0):
            raise ConfigError(f"{self._where}: coordinates: {position!r} is no place on Earth (longitude comes first)")
        return longitude, latitude, numbers[2] if len(numbers) > 2 else None

    def vehicle(self, home: Geodetic, speed_mps: float, faults: list[ConfigError]) -> VehicleSpec | None:
        """The vehicle that flies this track; None if the track has mistakes, which are added to ``faults``."""
        return self._table.read(lambda table: self._spec(table, home, speed_mps), faults)

    def _spec(self, table: CheckedTable, home: Geodetic, speed_mps: float) -> VehicleSpec:
        route: list[Point3] = []
        for longitude, latitude, altitude in self.points:
            height = home.altitude_m + FLOOR_M if altitude is None else altitude
            north, east, down = ned_from_geodetic(latitude, longitude, height, home).tolist()
            if abs(north) > 1e5 or abs(east) > 1e5:
                raise ConfigError(
                    f"{self._where}: lies {math.hypot(north, east) / 1e3:.0f} km from the middle of the tracks"
                )
            route.append((round(north, 3), round(east, 3), min(round(down, 3), -1.0)))
        length_m = sum(math.dist(*leg) for leg in pairwise(route))
        if length_m < MIN_LENGTH_M:
            raise ConfigError(f"{self._where}: the track goes nowhere")
        keys = read_vehicle_keys(table)
        cooperative = table.truth("cooperative", False)
        if cooperative and keys["ghost"]:
            raise table.error("cooperative", "must be false: a ghost avoids nobody")
        return VehicleSpec(
            start_ned_m=route[0],
            goal_ned_m=route[-1],
            speed_mps=table.number(
                "speed_mps",
                self._timed_speed_mps(table, length_m) or speed_mps,
                above=0.0,
                most=MOST_SPEED_MPS if table.has("speed_mps") else None,
            ),
            cooperative=cooperative,
            route_ned_m=() if cooperative else tuple(route[1:-1]),
            **keys,
        )

    def _timed_speed_mps(self, table: CheckedTable, length_m: float) -> float | None:
        if not table.has("times"):
            return None
        times = table.take("times")
        numbers = isinstance(times, list) and all(finite_number(t) is not None for t in times)
        if not numbers or len(times) != len(self.points):
            raise ConfigError(f"{self._where}: times must be seconds, one for each of {len(self.points)} points")
        if not times[-1] > times[0]:
            raise ConfigError(f"{self._where}: times must rise")
        return float(length_m / (times[-1] - times[0]))


def _length_m(vehicle: VehicleSpec) -> float:
    route = (vehicle.start_ned_m, *vehicle.route_ned_m, vehicle.goal_ned_m)
    return sum(math.dist(*leg) for leg in pairwise(route))
