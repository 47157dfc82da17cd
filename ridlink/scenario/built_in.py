"""Scenarios that need no file.

Geometry: paper, section VI-B (circle of eight, square of twenty-four). The paper does not print the radius and the
sides; with 100 m, 600 m and an obstacle of 80 m its mission times come out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from ridlink.errors import ConfigError
from ridlink.scenario.model import DEFAULT_SPEED_MPS, ObstacleSpec, Point2, Scenario, VehicleSpec
from ridlink.words import unknown_name

ALTITUDE_DOWN_M = -50.0
"""All built-in vehicles fly at one altitude, as in the paper."""

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
        ConfigError: If there is no such scenario, or it cannot hold this many vehicles.
    """
    if name not in BUILT_IN:
        other = "; circle8 and square24 take other numbers by -n" if re.match(r"(circle|square)\d", name) else ""
        told = unknown_name("scenario", name, BUILT_IN)
        raise ConfigError(f"{told}, or the path of a .toml or .geojson file{other}")
    if count is not None and count < 0:
        raise ConfigError(f"a scenario cannot have {count} vehicles")
    if not (math.isfinite(speed_mps) and speed_mps > 0.0):
        raise ConfigError(f"the speed must be positive and finite, not {speed_mps}")
    return BUILT_IN[name](count, speed_mps)
