"""Types of a scenario: starts and goals of vehicles, obstacles, wind, events.

Units and axes: metres and seconds; north-east-down about the home point, the ground is down = 0, so a flying vehicle
has a negative down. System ids are 1, 2, ... in the order of the vehicles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ridlink.errors import ConfigError
from ridlink.scenario.events import Event

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]

DEFAULT_SPEED_MPS = 10.0
"""Default cruise speed: a small multirotor holds it against its own drag."""

DEFAULT_AIRFRAME_M = 0.6
"""Largest horizontal extent of a common small multirotor, rotors turning."""

DEFAULT_INTERVAL_S = 0.1
"""Time between two Remote ID updates: Takeaway 1 of the paper."""

LEAST_INTERVAL_S = 0.02
"""Shortest time between two updates that a file may ask for: the emulator's tick."""

MOST_INTERVAL_S = 60.0
"""The longest one; no technology is as slow."""

MOST_SPEED_MPS, MOST_AIRFRAME_M, MOST_SIGMA_M = 300.0, 100.0, 1000.0
"""Airliners, as ghosts, fly no faster and are no larger; an error of a kilometre is no position any more."""

MAX_AIRFRAME_HEIGHT_M = 1.5
"""Assumed: even the largest airframes of the paper's database (7.5 m of wing) are hardly taller."""

AUTOPILOTS = ("px4", "ardupilot")
"""Autopilots that a scenario may give to one vehicle."""


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """One vehicle of a scenario.

    Args:
        start_ned_m: Where its mission starts, in the air.
        goal_ned_m: Where it wants to go.
        speed_mps: Cruise speed.
        airframe_m: Largest horizontal extent (a diameter).
        sigma_m: Standard deviation of its position error per horizontal axis; 0 = exact, None = the default of the
            caller.
        cooperative: False: flies straight on, broadcasts, avoids no other vehicle.
        extended: False: a stock sender, without RIDLINK_SEPARATION.
        route_ned_m: Points on the way to the goal, for a vehicle that is not cooperative.
        ghost: True: there is no such vehicle, only its Remote ID, sent by a spoofer. It has no collisions and hears
            nothing.
        transmitter_ned_m: True position of the transmitter of a ghost; None: the position that the ghost claims.
        silent: True: flies without sending Remote ID.
        interval_s: Time between its Remote ID updates; None: the scenario's.
        airframe: Type of airframe, by name or file; None: the one with which its autopilot was measured.
        autopilot: One of `AUTOPILOTS`; None: the fleet's.
    """

    start_ned_m: Point3
    goal_ned_m: Point3
    speed_mps: float = DEFAULT_SPEED_MPS
    airframe_m: float = DEFAULT_AIRFRAME_M
    sigma_m: float | None = None
    cooperative: bool = True
    extended: bool = True
    route_ned_m: tuple[Point3, ...] = ()
    ghost: bool = False
    transmitter_ned_m: Point3 | None = None
    silent: bool = False
    interval_s: float | None = None
    airframe: str | None = None
    autopilot: str | None = None

    @property
    def airframe_height_m(self) -> float:
        """Largest vertical extent [m], assumed: half the airframe size, at most 1.5 m."""
        return min(0.5 * self.airframe_m, MAX_AIRFRAME_HEIGHT_M)


@dataclass(frozen=True, slots=True)
class ObstacleSpec:
    """A static obstacle: a simple polygon in the horizontal plane, north and east [m], of any height."""

    polygon_ne_m: tuple[Point2, ...]


@dataclass(frozen=True, slots=True)
class Wind:
    """Wind and gusts.

    Args:
        velocity_ne_mps: Mean velocity of the air, in the direction it moves to.
        gust_sigma_mps: Standard deviation of gusts per axis.
        gust_time_s: Their correlation time.
    """

    velocity_ne_mps: Point2 = (0.0, 0.0)
    gust_sigma_mps: float = 0.0
    gust_time_s: float = 3.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """Vehicles, obstacles, events and the time at which a flight is cut off.

    Args:
        name: For people.
        duration_s: Time of the cut-off.
        vehicles: In the order of their system ids.
        obstacles: Static obstacles.
        interval_s: Time between two Remote ID updates.
        events: Events in the order of time.
        wind: Wind for all vehicles.
        home_deg_m: Latitude, longitude [deg] and altitude [m] of the origin; None: the default of the caller.

    Raises:
        ConfigError: If two airframes touch at the start, or a vehicle starts or ends in an obstacle.
    """

    name: str
    duration_s: float
    vehicles: tuple[VehicleSpec, ...]
    obstacles: tuple[ObstacleSpec, ...] = ()
    interval_s: float = DEFAULT_INTERVAL_S
    events: tuple[Event, ...] = ()
    wind: Wind = Wind()
    home_deg_m: Point3 | None = None

    def __post_init__(self) -> None:
        polygons = [np.array(obstacle.polygon_ne_m) for obstacle in self.obstacles]
        for number, vehicle in enumerate(self.vehicles, start=1):
            if vehicle.ghost:
                continue  # a ghost has no body that an obstacle could stop
            for key, point in (("start_ned_m", vehicle.start_ned_m), ("goal_ned_m", vehicle.goal_ned_m)):
                for which, polygon in enumerate(polygons, start=1):
                    if distance_to_polygon(np.array(point[:2]), polygon) < vehicle.airframe_m / 2.0:
                        raise ConfigError(f"vehicle {number}: {key} {_point(point)} lies in obstacle {which}")
        self._check_starts()
        for event in self.events:
            if event.vehicle > len(self.vehicles):
                raise ConfigError(f"event '{event.what}': there is no vehicle {event.vehicle}")

    def _check_starts(self) -> None:
        """Refuse airframes that touch at the start: that is a mistake in the file, not a collision."""
        real = [(number, vehicle) for number, vehicle in enumerate(self.vehicles, start=1) if not vehicle.ghost]
        numbers = [number for number, _ in real]
        starts = np.array([vehicle.start_ned_m for _, vehicle in real]).reshape(-1, 3)
        airframe_m = np.array([vehicle.airframe_m for _, vehicle in real])
        height_m = np.array([vehicle.airframe_height_m for _, vehicle in real])
        for i in range(len(starts) - 1):
            apart = starts[i + 1 :] - starts[i]
            touching = (np.hypot(apart[:, 0], apart[:, 1]) < (airframe_m[i + 1 :] + airframe_m[i]) / 2.0) & (
                np.abs(apart[:, 2]) < (height_m[i + 1 :] + height_m[i]) / 2.0
            )
            if np.any(touching):
                j = i + 1 + int(np.argmax(touching))
                raise ConfigError(
                    f"vehicles {numbers[i]} and {numbers[j]} start in the same place: "
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
    end = np.roll(start, -1, axis=0)
    edge = end - start
    along = np.clip(((point - start) * edge).sum(-1) / np.maximum((edge * edge).sum(-1), 1e-12), 0.0, 1.0)
    gap = point - (start + along[..., None] * edge)
    distance = np.sqrt((gap * gap).sum(-1).min(-1))
    # a ray to the north crosses the outline an odd number of times from inside; a corner is compared as it is for both
    # of its edges, since a rounded one would be passed by one of them only
    crosses = (start[:, 1] > point[..., 1]) != (end[:, 1] > point[..., 1])
    slope = edge[:, 0] / np.where(edge[:, 1] == 0.0, 1.0, edge[:, 1])
    north_of_crossing = start[:, 0] + (point[..., 1] - start[:, 1]) * slope
    inside = (crosses & (point[..., 0] < north_of_crossing)).sum(-1) % 2 == 1
    return np.where(inside, 0.0, distance)


def _point(point: Point3) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
