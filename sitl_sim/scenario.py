"""Scenarios: where vehicles start and go, and what stands in the way; from a TOML file or built in.

Units and axes: metres and seconds; north-east-down about the home point, the ground is down = 0, so a flying vehicle has
a negative down. System ids are 1, 2, ... in the order of the vehicles.

A scenario file is checked completely before anything flies: one line of text names the file, the line where it can, the
key, and what would be right.

Built-in geometry: paper, section VI-B (circle of eight, square of twenty-four). The paper does not print the radius and the
sides; 100 m, 600 m and the 80 m obstacle are the reading under which its mission times come out.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

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


def load_scenario(path: str | Path, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """A scenario file; ConfigError (one line) when it is wrong, OSError when it cannot be read."""
    raise NotImplementedError


def built_in(name: str, count: int | None = None, *, speed_mps: float = DEFAULT_SPEED_MPS) -> Scenario:
    """circle8, square24, head-on, crossing or overtake; count 0 is an empty sky."""
    raise NotImplementedError


def resolve_scenario(
    name_or_path: str, count: int | None = None, *, speed_mps: float = DEFAULT_SPEED_MPS
) -> Scenario:
    """What `--scenario` names: a built-in, or a file."""
    raise NotImplementedError
