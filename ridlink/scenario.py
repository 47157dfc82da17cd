"""Scenarios: where vehicles start and go, and what stands in the way; from a TOML file or built in.

Units and axes: metres and seconds; north-east-down about the home point, the ground is down = 0, so a flying vehicle
has a negative down. System ids are 1, 2, ... in the order of the vehicles.

A scenario file is checked completely before anything flies.

Built-in geometry: paper, section VI-B (circle of eight, square of twenty-four). The paper does not print the radius and
the sides; 100 m, 600 m and the 80 m obstacle are the reading under which its mission times come out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ridlink.checked_toml import CheckedTable, read_toml
from ridlink.errors import ConfigError

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]

DEFAULT_SPEED_MPS = 10.0
"""Cruise speed where nobody says anything: what a small multirotor holds against its own drag."""

DEFAULT_AIRFRAME_M = 0.6
"""Largest horizontal extent of a common small multirotor, rotors turning."""

DEFAULT_INTERVAL_S = 0.1
"""Time between two Remote ID updates: Takeaway 1 of the paper."""

MAX_AIRFRAME_HEIGHT_M = 1.5
"""Assumed: even the largest airframes of the paper's database (7.5 m of wing) are hardly taller."""

ALTITUDE_DOWN_M = -50.0
"""All built-in vehicles share one altitude slice, as in the paper."""


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """One vehicle of a scenario.

    Args:
        start_ned_m: Where its mission starts, in the air.
        goal_ned_m: Where it wants to go.
        speed_mps: Cruise speed.
        airframe_m: Largest horizontal extent (a diameter).
        sigma_m: Standard deviation of its position error per horizontal axis; 0 = exact, None = whatever the caller
            gives to vehicles that say nothing.
        cooperative: False: flies straight on, broadcasts, avoids nobody.
        extended: False: a stock sender, without RIDLINK_SEPARATION.
    """

    start_ned_m: Point3
    goal_ned_m: Point3
    speed_mps: float = DEFAULT_SPEED_MPS
    airframe_m: float = DEFAULT_AIRFRAME_M
    sigma_m: float | None = None
    cooperative: bool = True
    extended: bool = True

    @property
    def airframe_height_m(self) -> float:
        """Largest vertical extent [m], assumed: half the airframe size, at most 1.5 m."""
        return min(0.5 * self.airframe_m, MAX_AIRFRAME_HEIGHT_M)


@dataclass(frozen=True, slots=True)
class ObstacleSpec:
    """A static obstacle: a simple polygon in the horizontal plane, north and east [m], of any height."""

    polygon_ne_m: tuple[Point2, ...]


@dataclass(frozen=True, slots=True)
class Scenario:
    """Vehicles, obstacles and the time after which nobody waits any longer.

    Raises:
        ConfigError: If two airframes touch at the start, or a vehicle starts or ends in an obstacle.
    """

    name: str
    duration_s: float
    vehicles: tuple[VehicleSpec, ...]
    obstacles: tuple[ObstacleSpec, ...] = ()
    interval_s: float = DEFAULT_INTERVAL_S

    def __post_init__(self) -> None:
        polygons = [np.array(obstacle.polygon_ne_m) for obstacle in self.obstacles]
        for number, vehicle in enumerate(self.vehicles, start=1):
            for key, point in (("start_ned_m", vehicle.start_ned_m), ("goal_ned_m", vehicle.goal_ned_m)):
                for which, polygon in enumerate(polygons, start=1):
                    if distance_to_polygon(np.array(point[:2]), polygon) < vehicle.airframe_m / 2.0:
                        raise ConfigError(f"vehicle {number}: {key} {_point(point)} lies in obstacle {which}")
        self._check_starts()

    def _check_starts(self) -> None:
        """Two airframes that touch before anybody moves are a mistake in the file, not a collision."""
        starts = np.array([vehicle.start_ned_m for vehicle in self.vehicles]).reshape(-1, 3)
        airframe_m = np.array([vehicle.airframe_m for vehicle in self.vehicles])
        height_m = np.array([vehicle.airframe_height_m for vehicle in self.vehicles])
        for i in range(len(starts) - 1):
            apart = starts[i + 1 :] - starts[i]
            touching = (np.hypot(apart[:, 0], apart[:, 1]) < (airframe_m[i + 1 :] + airframe_m[i]) / 2.0) & (
                np.abs(apart[:, 2]) < (height_m[i + 1 :] + height_m[i]) / 2.0
            )
            if np.any(touching):
                j = i + 1 + int(np.argmax(touching))
                raise ConfigError(
                    f"vehicles {i + 1} and {j + 1} start in the same place: "
                    f"{np.linalg.norm(starts[j] - starts[i]):.2f} m apart, their airframes touch"
                )


def distance_to_polygon(point_ne_m: npt.ArrayLike, polygon_ne_m: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Horizontal distance of points to a simple polygon [m], 0 inside.

    Args:
        point_ne_m: North and east, shape (..., 2).
        polygon_ne_m: Corners in order, shape (k, 2).

    Returns:
        Distance, shape (...).
    """
    point = np.asarray(point_ne_m, dtype=np.float64)[..., None, :]
    start = np.asarray(polygon_ne_m, dtype=np.float64)
    edge = np.roll(start, -1, axis=0) - start
    along = np.clip(((point - start) * edge).sum(-1) / np.maximum((edge * edge).sum(-1), 1e-12), 0.0, 1.0)
    gap = point - (start + along[..., None] * edge)
    distance = np.sqrt((gap * gap).sum(-1).min(-1))
    # a ray to the north crosses the outline an odd number of times from inside
    crosses = (start[:, 1] > point[..., 1]) != (start[:, 1] + edge[:, 1] > point[..., 1])
    slope = edge[:, 0] / np.where(edge[:, 1] == 0.0, 1.0, edge[:, 1])
    north_of_crossing = start[:, 0] + (point[..., 1] - start[:, 1]) * slope
    inside = (crosses & (point[..., 0] < north_of_crossing)).sum(-1) % 2 == 1
    return np.where(inside, 0.0, distance)


def _point(point: Point3) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"


# --- built-in scenarios -----------------------------------------------------------------------------------------------

CIRCLE_RADIUS_M = 100.0
SQUARE_SIDE_M = 600.0
SQUARE_OBSTACLE_SIDE_M = 80.0
PAIR_PATH_M = 400.0

_PATIENCE = 9.0
"""A built-in scenario is given up after this many times the straight flight, ..."""

_LEAST_PATIENCE_S = 300.0
"""... but not before this: under the largest discs vehicles wait for each other at their goals for minutes."""


def _cut_off_s(path_m: float, speed_mps: float) -> float:
    return max(_PATIENCE * path_m / speed_mps, _LEAST_PATIENCE_S)


def _circle(count: int | None, speed_mps: float) -> Scenario:
    """Vehicles on a circle of 100 m, every goal opposite its start."""
    count = 8 if count is None else count
    vehicles = []
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        north, east = CIRCLE_RADIUS_M * math.cos(angle), CIRCLE_RADIUS_M * math.sin(angle)
        vehicles.append(_vehicle((north, east), (-north, -east), speed_mps))
    return Scenario("circle8", _cut_off_s(2.0 * CIRCLE_RADIUS_M, speed_mps), tuple(vehicles))


def _square(count: int | None, speed_mps: float) -> Scenario:
    """Vehicles on all four sides of a square of 600 m, goals straight across, an obstacle of 80 m in the middle."""
    count = 24 if count is None else count
    if count % 4:
        raise ConfigError(f"square24 has the same number of vehicles on each side: give a multiple of 4, not {count}")
    half, per_side = SQUARE_SIDE_M / 2.0, count // 4
    along = [(k + 0.5) * SQUARE_SIDE_M / per_side - half for k in range(per_side)]
    south_north = [_vehicle((-half, at), (half, at), speed_mps) for at in along]
    west_east = [_vehicle((at, -half), (at, half), speed_mps) for at in along]
    north_south = [_vehicle((half, at), (-half, at), speed_mps) for at in along]
    east_west = [_vehicle((at, half), (at, -half), speed_mps) for at in along]
    side = SQUARE_OBSTACLE_SIDE_M / 2.0
    obstacle = ObstacleSpec(((-side, -side), (side, -side), (side, side), (-side, side)))
    return Scenario(
        "square24",
        _cut_off_s(SQUARE_SIDE_M, speed_mps),
        (*south_north, *west_east, *north_south, *east_west),
        (obstacle,),
    )


def _head_on(count: int | None, speed_mps: float) -> Scenario:
    """Two vehicles 400 m apart that fly at each other, exactly opposed."""
    far = PAIR_PATH_M / 2.0
    return _pair(
        "head-on",
        count,
        speed_mps,
        [_vehicle((-far, 0.0), (far, 0.0), speed_mps), _vehicle((far, 0.0), (-far, 0.0), speed_mps)],
    )


def _crossing(count: int | None, speed_mps: float) -> Scenario:
    """Two vehicles that meet at a right angle."""
    far = PAIR_PATH_M / 2.0
    return _pair(
        "crossing",
        count,
        speed_mps,
        [_vehicle((-far, 0.0), (far, 0.0), speed_mps), _vehicle((0.0, -far), (0.0, far), speed_mps)],
    )


def _overtake(count: int | None, speed_mps: float) -> Scenario:
    """A vehicle behind another that flies the same way at half its speed; it has passed well before either goal."""
    return _pair(
        "overtake",
        count,
        speed_mps,
        [_vehicle((-200.0, 0.0), (300.0, 0.0), speed_mps), _vehicle((-100.0, 0.0), (200.0, 0.0), speed_mps / 2.0)],
    )


def _vehicle(start_ne_m: Point2, goal_ne_m: Point2, speed_mps: float) -> VehicleSpec:
    return VehicleSpec((*start_ne_m, ALTITUDE_DOWN_M), (*goal_ne_m, ALTITUDE_DOWN_M), speed_mps=speed_mps)


def _pair(name: str, count: int | None, speed_mps: float, vehicles: list[VehicleSpec]) -> Scenario:
    if count is not None and count > len(vehicles):
        raise ConfigError(f"{name} has {len(vehicles)} vehicles, not {count}; circle8 and square24 take other numbers")
    return Scenario(name, _cut_off_s(PAIR_PATH_M, speed_mps), tuple(vehicles[:count]))


BUILT_IN: Mapping[str, Callable[[int | None, float], Scenario]] = {
    "circle8": _circle,
    "square24": _square,
    "head-on": _head_on,
    "crossing": _crossing,
    "overtake": _overtake,
}
"""Scenarios that need no file, by name."""


def built_in(name: str, count: int | None = None, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """A scenario that needs no file.

    Args:
        name: One of ``BUILT_IN``.
        count: Number of vehicles; any for circle8, multiples of four for square24, fewer for a pair; 0 is an empty sky.
        speed_mps: Cruise speed (of the faster one in overtake); the cut-off follows it.

    Raises:
        ConfigError: If there is no such scenario, or it cannot hold so many vehicles.
    """
    if name not in BUILT_IN:
        raise ConfigError(f"unknown scenario '{name}': known are {', '.join(BUILT_IN)}, or the path of a .toml file")
    if count is not None and count < 0:
        raise ConfigError(f"a scenario cannot have {count} vehicles")
    if not (math.isfinite(speed_mps) and speed_mps > 0.0):
        raise ConfigError(f"the speed must be positive and finite, not {speed_mps}")
    return BUILT_IN[name](count, speed_mps)


def resolve_scenario(name_or_path: str, count: int | None = None, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """What ``--scenario`` names: a built-in one, or a file (anything that ends in .toml or has a slash).

    Args:
        name_or_path: Name or path.
        count: Number of vehicles; of a file, its first ones.
        speed_mps: Cruise speed of vehicles that state none.

    Raises:
        ConfigError: If the name is unknown, the file is wrong, or there are not so many vehicles.
        OSError: If the file cannot be read.
    """
    if not (name_or_path.endswith(".toml") or "/" in name_or_path):
        return built_in(name_or_path, count, speed_mps=speed_mps)
    scenario = load_scenario(name_or_path, speed_mps=speed_mps)
    if count is None:
        return scenario
    if not 0 <= count <= len(scenario.vehicles):
        raise ConfigError(f"{name_or_path}: has {len(scenario.vehicles)} vehicles, not {count}")
    return replace(scenario, vehicles=scenario.vehicles[:count])


# --- scenario files ---------------------------------------------------------------------------------------------------


def load_scenario(path: str | Path, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """A scenario from a TOML file.

    Args:
        path: The file.
        speed_mps: Cruise speed of vehicles that state none.

    Raises:
        ConfigError: If it is not TOML, a key is missing, unknown, of the wrong type or out of range, or the geometry is
            impossible. One line: file, line where known, key, what would be right.
        OSError: If the file cannot be read.
    """
    top = read_toml(path)
    vehicles = tuple(_vehicle_spec(table, speed_mps) for table in top.tables("vehicle"))
    obstacles = tuple(_obstacle_spec(table) for table in top.tables("obstacle", needed=False))
    name, duration_s = top.text("name"), top.number("duration_s", above=0.0)
    interval_s = top.number("interval_s", DEFAULT_INTERVAL_S, above=0.0)
    top.nothing_else()
    try:
        return Scenario(name, duration_s, vehicles, obstacles, interval_s)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _vehicle_spec(table: CheckedTable, speed_mps: float) -> VehicleSpec:
    spec = VehicleSpec(
        start_ned_m=_point3(table, "start_ned_m"),
        goal_ned_m=_point3(table, "goal_ned_m"),
        speed_mps=table.number("speed_mps", speed_mps, above=0.0),
        airframe_m=table.number("airframe_m", DEFAULT_AIRFRAME_M, above=0.0),
        sigma_m=table.number("sigma_m", 0.0, least=0.0) if table.has("sigma_m") else None,
        cooperative=table.truth("cooperative", True),
        extended=table.truth("extended", True),
    )
    table.nothing_else()
    for key, point in (("start_ned_m", spec.start_ned_m), ("goal_ned_m", spec.goal_ned_m)):
        if point[2] >= 0.0:
            raise table.error(key, f"is not in the air: down must be negative (home is the ground), not {point[2]:g}")
    return spec


def _point3(table: CheckedTable, key: str) -> Point3:
    north, east, down = table.point(key, table.take(key), "north, east, down")
    return north, east, down


def _obstacle_spec(table: CheckedTable) -> ObstacleSpec:
    key = "polygon_ne_m"
    value = table.take(key)
    if not isinstance(value, list) or len(value) < 3:
        raise table.error(key, "must list at least three corners [north, east]")
    corners = tuple((corner[0], corner[1]) for corner in (table.point(key, corner, "north, east") for corner in value))
    table.nothing_else()
    if not _is_simple(corners):
        raise table.error(key, "must be a polygon with an area whose edges do not cross")
    return ObstacleSpec(corners)


def _is_simple(corners: tuple[Point2, ...]) -> bool:
    """Whether a polygon has an area and no two of its edges cross."""

    def side(a: Point2, b: Point2, c: Point2) -> float:
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    count = len(corners)
    twice_area = sum(corners[k - 1][0] * corners[k][1] - corners[k][0] * corners[k - 1][1] for k in range(count))
    if abs(twice_area) < 1e-6:
        return False
    edges = [(corners[k], corners[(k + 1) % count]) for k in range(count)]
    for first in range(count):
        for second in range(first + 2, count - (first == 0)):
            (a, b), (c, d) = edges[first], edges[second]
            if side(a, b, c) * side(a, b, d) <= 0.0 and side(c, d, a) * side(c, d, b) <= 0.0:
                return False
    return True
