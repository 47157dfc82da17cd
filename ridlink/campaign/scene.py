"""Start positions, goals and obstacles of the vehicles of a campaign.

Axes: north-east, metres; all vehicles share one altitude. Vectors have shape (N, 2).

Source of the built-in scenes: paper, section VI-B. It does not print the radius and the sides; 100 m, 600 m and an
obstacle of 80 m reproduce its mission times.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ridlink.checked_toml import LARGEST
from ridlink.errors import ConfigError
from ridlink.scenario import Scenario, Wind
from ridlink.scenario.built_in import CIRCLE_RADIUS_M, SQUARE_OBSTACLE_SIDE_M, SQUARE_SIDE_M
from ridlink.separation.reference import MAX_AIRFRAME_M

FloatArray = NDArray[np.float64]

Polygon = tuple[tuple[float, float], ...]

MOST_DRAWN = 1000
"""Size of the largest drawn fleet."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Geometry of a world.

    Args:
        name: Name for tables.
        start_ne_m: Start position of each vehicle, shape (N, 2).
        goal_ne_m: Goal of each vehicle, shape (N, 2).
        polygons_ne_m: Static obstacles.
        speed_mps: Cruise speeds, shape (N,); None: drawn for every run.
        airframe_m: Airframe sizes, shape (N,); None: drawn for every run.
        cooperative: False for a vehicle that flies straight on and avoids nobody, shape (N,); None: all avoid.
        sigma_m: Standard deviations of the position errors, shape (N,); None: that of the plan.
        extended: False for a sender of standard Remote ID only, whose error and size are unknown to others, shape (N,);
            None: all send the extension.

    Raises:
        ValueError: If a shape does not fit or a value is not finite or out of range.
    """

    name: str
    start_ne_m: FloatArray
    goal_ne_m: FloatArray
    polygons_ne_m: tuple[Polygon, ...] = ()
    speed_mps: FloatArray | None = None
    airframe_m: FloatArray | None = None
    cooperative: NDArray[np.bool_] | None = None
    sigma_m: FloatArray | None = None
    extended: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        count = len(self.start_ne_m)
        for name, shape in (
            ("start_ne_m", (count, 2)), ("goal_ne_m", (count, 2)), ("speed_mps", (count,)), ("airframe_m", (count,)),
            ("sigma_m", (count,)),
        ):  # fmt: skip
            value = getattr(self, name)
            if value is None:
                continue
            array = np.asarray(value, dtype=np.float64)
            if array.shape != shape:
                raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
            if not np.all(np.isfinite(array)):
                raise ValueError(f"{name} must be finite, got {array[~np.isfinite(array)][0]}")
            if name == "sigma_m" and np.any(array < 0.0):
                raise ValueError(f"{name} must not be negative, got {array.min()}")
            if name in ("speed_mps", "airframe_m") and np.any(array <= 0.0):
                raise ValueError(f"{name} must be positive, got {array.min()}")
            object.__setattr__(self, name, array)
        for name in ("cooperative", "extended"):
            if getattr(self, name) is None:
                continue
            flags = np.asarray(getattr(self, name), dtype=np.bool_)
            if flags.shape != (count,):
                raise ValueError(f"{name} must have shape ({count},), got {flags.shape}")
            object.__setattr__(self, name, flags)

    @property
    def avoiding(self) -> NDArray[np.bool_]:
        """Mask of the vehicles that avoid, shape (N,)."""
        return np.ones(len(self), np.bool_) if self.cooperative is None else self.cooperative

    def __len__(self) -> int:
        return len(self.start_ne_m)


def circle(count: int = 8, radius_m: float = CIRCLE_RADIUS_M) -> Scene:
    """Vehicles on a circle, with each goal opposite to the start."""
    angle = 2.0 * math.pi * np.arange(count) / count
    start = radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Scene(f"circle{count}", start, -start)


def square(count: int = 24, side_m: float = SQUARE_SIDE_M, obstacle_side_m: float = SQUARE_OBSTACLE_SIDE_M) -> Scene:
    """Vehicles on all four sides of a square, goals straight across, a square obstacle in the middle.

    Raises:
        ValueError: If the vehicles cannot be spread evenly over the sides.
    """
    if count <= 0 or count % 4:
        raise ValueError(f"a square has the same number of vehicles on each side: got {count}")
    half, per_side = side_m / 2.0, count // 4
    along = (np.arange(per_side) + 0.5) * side_m / per_side - half
    near, far = np.full(per_side, -half), np.full(per_side, half)
    sides = [(near, along, far, along), (along, near, along, far), (far, along, near, along), (along, far, along, near)]
    start = np.concatenate([np.stack([north, east], axis=1) for north, east, _, _ in sides])
    goal = np.concatenate([np.stack([north, east], axis=1) for _, _, north, east in sides])
    edge = obstacle_side_m / 2.0
    block = ((-edge, -edge), (edge, -edge), (edge, edge), (-edge, edge))
    return Scene(f"square{count}", start, goal, (block,))


def drawn_scene(name: str) -> Scene | None:
    """A scene with drawn fleets, by name: `circle8` and `square24` of the paper, or similar ones.

    Args:
        name: `circleN` or `squareN` for N vehicles, `circleN@R` for another radius, `squareN@S` for another side, in
            metres; the obstacle in the square grows with it.

    Returns:
        The scene; None if the name has another form.

    Raises:
        ConfigError: If the name has this form, but there is no such scene.
    """
    match = re.fullmatch(r"(circle|square)([0-9]{1,9})(?:@([0-9]{1,9}(?:\.[0-9]{1,9})?))?", name)
    if match is None:
        return None
    kind, count, size = match[1], int(match[2]), float(match[3]) if match[3] else None
    if not 2 <= count <= MOST_DRAWN:
        raise ConfigError(f"{name}: 2 to {MOST_DRAWN} vehicles, not {count}")
    if size is not None and not 0.0 < size <= LARGEST:
        raise ConfigError(
            f"{name}: the {'radius' if kind == 'circle' else 'side'} must be positive, and at most {LARGEST:g} m"
        )
    if kind == "square" and count % 4:
        raise ConfigError(f"{name}: a square has the same number of vehicles on each side: give a multiple of 4")
    if kind == "circle":
        scene = circle(count, size or CIRCLE_RADIUS_M)
    else:
        side_m = size or SQUARE_SIDE_M
        scene = square(count, side_m, SQUARE_OBSTACLE_SIDE_M * (side_m / SQUARE_SIDE_M))
    apart_m = float(np.linalg.norm(scene.start_ne_m[1:] - scene.start_ne_m[0], axis=1).min())
    if apart_m <= MAX_AIRFRAME_M:
        raise ConfigError(f"{name}: vehicles start {apart_m:.2f} m apart, airframes of {MAX_AIRFRAME_M:g} m touch")
    return scene if size is None else replace(scene, name=name)


EMULATED_KEYS = ("route_ned_m", "ghost", "silent", "interval_s", "airframe", "autopilot")
"""Keys of a vehicle in a scenario that only the emulator supports."""


def not_flown(scenario: Scenario) -> list[str]:
    """Contents of a scenario that a campaign ignores."""
    return [
        *(["wind"] if scenario.wind != Wind() else []),
        *(["events"] if scenario.events else []),
        *(key for key in EMULATED_KEYS if any(getattr(vehicle, key) for vehicle in scenario.vehicles)),
    ]


def scene_of(scenario: Scenario, sigma_m: float) -> Scene:
    """The scene of a scenario, with the speeds and sizes that the scenario gives.

    Args:
        scenario: Built in or read from a file.
        sigma_m: Standard deviation of vehicles that have none in the scenario.

    Raises:
        ConfigError: If the scenario has no vehicles, or they are not all at one height.
    """
    vehicles = scenario.vehicles
    if not vehicles:
        raise ConfigError(f"{scenario.name}: a campaign needs vehicles, and there are none")
    start, goal = np.array([v.start_ned_m for v in vehicles]), np.array([v.goal_ned_m for v in vehicles])
    downs = np.unique(np.concatenate([start[:, 2], goal[:, 2]]))
    if len(downs) > 1:
        raise ConfigError(
            f"{scenario.name}: a campaign flies at one height, and here are starts and goals from down = {downs[0]:g} "
            f"to {downs[-1]:g}"
        )
    return Scene(
        scenario.name, start[:, :2], goal[:, :2], tuple(obstacle.polygon_ne_m for obstacle in scenario.obstacles),
        speed_mps=np.array([v.speed_mps for v in vehicles]), airframe_m=np.array([v.airframe_m for v in vehicles]),
        cooperative=np.array([v.cooperative for v in vehicles]),
        sigma_m=np.array([sigma_m if v.sigma_m is None else v.sigma_m for v in vehicles]),
        extended=np.array([v.extended for v in vehicles]),
    )  # fmt: skip
