"""Scenarios from TOML files: checked completely before anything flies.

One line for each mistake says what is wrong: file, line where known, key, and what would be right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from ridlink.checked_toml import CheckedTable, read_toml
from ridlink.errors import ConfigError
from ridlink.scenario.built_in import built_in
from ridlink.scenario.events import read_event
from ridlink.scenario.geojson import load_tracks
from ridlink.scenario.model import (
    DEFAULT_INTERVAL_S,
    DEFAULT_SPEED_MPS,
    LEAST_INTERVAL_S,
    MOST_INTERVAL_S,
    MOST_SPEED_MPS,
    ObstacleSpec,
    Point2,
    Point3,
    Scenario,
    VehicleSpec,
    Wind,
)
from ridlink.scenario.vehicle_keys import read_vehicle_keys
from ridlink.words import counted

Made = TypeVar("Made")


def resolve_scenario(name_or_path: str, count: int | None = None, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """The scenario that ``--scenario`` names: a built-in one, or a file: .geojson, or TOML (any other name with a
    suffix .toml or a slash).

    Args:
        name_or_path: Name or path.
        count: Number of vehicles; of a file the first ones, with their events.
        speed_mps: Cruise speed of vehicles for which the file gives none.

    Raises:
        ConfigError: If the name is unknown, the file is wrong, or it has fewer vehicles than ``count``.
        OSError: If the file cannot be read.
    """
    if name_or_path.endswith((".geojson", ".json")):
        scenario = load_tracks(name_or_path, speed_mps=speed_mps)
    elif name_or_path.endswith(".toml") or "/" in name_or_path:
        scenario = load_scenario(name_or_path, speed_mps=speed_mps)
    else:
        return built_in(name_or_path, count, speed_mps=speed_mps)
    if count is None:
        return scenario
    if not 0 <= count <= len(scenario.vehicles):
        raise ConfigError(f"{name_or_path}: has {counted(len(scenario.vehicles), 'vehicle')}, not {count}")
    events = tuple(event for event in scenario.events if event.vehicle <= count)
    return replace(scenario, vehicles=scenario.vehicles[:count], events=events)


def load_scenario(path: str | Path, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """A scenario from a TOML file.

    Args:
        path: The file.
        speed_mps: Cruise speed of vehicles for which the file gives none.

    Raises:
        ConfigError: If it is not TOML, a key is missing, unknown, of the wrong type or out of range, or the geometry is
            impossible. One line for each mistake, the first as its text, up to four more as `others`: file, line where
            known, key, what would be right.
        OSError: If the file cannot be read.
    """
    top = read_toml(path)
    faults: list[ConfigError] = []

    def made(tables: Iterable[CheckedTable], make: Callable[[CheckedTable], Made]) -> list[Made]:
        found = [table.read(make, faults) for table in tables]
        return [each for each in found if each is not None]

    of_vehicles = list(top.tables("vehicle"))
    vehicles = made(of_vehicles, lambda table: _vehicle_spec(table, speed_mps))
    obstacles = made(top.tables("obstacle", needed=False), _obstacle_spec)
    events = made(top.tables("event", needed=False), lambda table: read_event(table, vehicles=len(of_vehicles)))
    winds = made([top.table("wind")], _wind) if top.has("wind") else [Wind()]
    whole = top.read(_whole, faults)
    if whole is None or faults:
        raise ConfigError(*map(str, faults))
    events.sort(key=lambda event: event.at_s)
    name, duration_s, interval_s, home_deg_m = whole
    try:
        return Scenario(
            name, duration_s, tuple(vehicles), tuple(obstacles), interval_s, tuple(events), winds[0], home_deg_m
        )
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _whole(top: CheckedTable) -> tuple[str, float, float, Point3 | None]:
    """Name, duration, interval and home."""
    found = (
        top.text("name"),
        top.number("duration_s", above=0.0),
        top.number("interval_s", DEFAULT_INTERVAL_S, least=LEAST_INTERVAL_S, most=MOST_INTERVAL_S),
        _home(top) if top.has("home") else None,
    )
    top.nothing_else()
    return found


def _vehicle_spec(table: CheckedTable, speed_mps: float) -> VehicleSpec:
    keys = read_vehicle_keys(table)
    ghost = keys["ghost"]
    spec = VehicleSpec(
        start_ned_m=_point3(table, "start_ned_m"),
        goal_ned_m=_point3(table, "goal_ned_m"),
        speed_mps=table.number("speed_mps", speed_mps, above=0.0, most=MOST_SPEED_MPS),
        cooperative=table.truth("cooperative", not ghost),
        route_ned_m=_route(table),
        transmitter_ned_m=_point3(table, "transmitter_ned_m") if table.has("transmitter_ned_m") else None,
        **keys,
    )
    table.nothing_else()
    if ghost and spec.cooperative:
        raise table.error("cooperative", "must be false: a ghost avoids nobody")
    if spec.route_ned_m and spec.cooperative:
        raise table.error("route_ned_m", "is for vehicles with cooperative = false: the others find their own way")
    if spec.transmitter_ned_m is not None and not ghost:
        raise table.error("transmitter_ned_m", "is for ghosts: a vehicle sends from where it is")
    points = [("route_ned_m", point) for point in spec.route_ned_m]
    for key, point in (("start_ned_m", spec.start_ned_m), ("goal_ned_m", spec.goal_ned_m), *points):
        if point[2] >= 0.0:
            raise table.fault(key, f"is not in the air: down must be negative (home is the ground), not {point[2]:g}")
    return spec


def _route(table: CheckedTable) -> tuple[Point3, ...]:
    key = "route_ned_m"
    value = table.take(key, [])
    if not isinstance(value, list):
        raise table.fault(key, "must list points [north, east, down]")
    points = (table.point(key, point, "north, east, down") for point in value)
    return tuple((north, east, down) for north, east, down in points)


def _wind(table: CheckedTable) -> Wind:
    key, calm = "velocity_ne_mps", Wind()
    north, east = table.point(key, table.take(key, [0.0, 0.0]), "north, east")
    wind = Wind(
        (north, east),
        table.number("gust_sigma_mps", calm.gust_sigma_mps, least=0.0),
        table.number("gust_time_s", calm.gust_time_s, above=0.0),
    )
    table.nothing_else()
    return wind


def _home(top: CheckedTable) -> Point3:
    key = "home"
    latitude, longitude, altitude = top.point(key, top.take(key), "latitude [deg], longitude [deg], altitude")
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and -500.0 <= altitude <= 9000.0):
        raise top.fault(key, f"is no place on Earth: {latitude:g}, {longitude:g}, {altitude:g}")
    return latitude, longitude, altitude


def _point3(table: CheckedTable, key: str) -> Point3:
    north, east, down = table.point(key, table.take(key), "north, east, down")
    return north, east, down


def _obstacle_spec(table: CheckedTable) -> ObstacleSpec:
    key = "polygon_ne_m"
    value = table.take(key)
    if not isinstance(value, list) or len(value) < 3:
        raise table.fault(key, "must list at least three corners [north, east]")
    corners = tuple((corner[0], corner[1]) for corner in (table.point(key, corner, "north, east") for corner in value))
    table.nothing_else()
    if corners[-1] == corners[0] and len(corners) > 3:  # closed, as polygons of GeoJSON are
        corners = corners[:-1]
    if not _is_simple(corners):
        raise table.fault(key, "must be a polygon with an area whose edges do not cross")
    return ObstacleSpec(corners)


def _is_simple(corners: tuple[Point2, ...]) -> bool:
    """Whether a polygon has an area and no two of its edges cross."""

    def side(a: Point2, b: Point2, c: Point2) -> float:
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    def apart(a: Point2, b: Point2, c: Point2, d: Point2) -> bool:  # as the ends of both arms of a U are, in one line
        return any(max(a[k], b[k]) < min(c[k], d[k]) or max(c[k], d[k]) < min(a[k], b[k]) for k in (0, 1))

    count = len(corners)
    twice_area = sum(corners[k - 1][0] * corners[k][1] - corners[k][0] * corners[k - 1][1] for k in range(count))
    if abs(twice_area) < 1e-6:
        return False
    edges = [(corners[k], corners[(k + 1) % count]) for k in range(count)]
    for first in range(count):
        for second in range(first + 2, count - (first == 0)):
            (a, b), (c, d) = edges[first], edges[second]
            crossing = side(a, b, c) * side(a, b, d) <= 0.0 and side(c, d, a) * side(c, d, b) <= 0.0
            if crossing and not apart(a, b, c, d):
                return False
    return True
