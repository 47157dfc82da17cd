"""The navigation solution of a vehicle, with the error of its receiver.

Units and axes: metres, metres a second; north-east-down about the scenario's home. No value is the truth, except the
acceleration, which an inertial sensor measures without a receiver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ridlink.geodesy import Geodetic, geodetic_from_ned
from sitl_sim.vehicle import VehicleState
from sitl_sim.world import World

Vector = tuple[float, float, float]


class Place(NamedTuple):
    """Geodetic position of the estimator, and the altitude of the receiver alone."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    receiver_altitude_m: float


@dataclass(frozen=True, slots=True)
class Navigation:
    """One vehicle at one tick. Accuracies are one standard deviation, as receivers give them."""

    time_s: float
    position_ned_m: Vector
    velocity_ned_mps: Vector
    acceleration_ned_mps2: Vector
    place: Callable[[], Place]
    h_acc_m: float
    v_acc_m: float
    vel_acc_mps: float
    bound_3sigma_m: float
    fix_type: int
    ekf_h_acc_m: float
    innovation_ratio: float
    battery_remaining: float
    battery_v: float
    battery_a: float
    link_on: bool
    state: VehicleState

    @property
    def in_air(self) -> bool:
        """Whether it flies or lands."""
        return self.state in (VehicleState.AIRBORNE, VehicleState.LANDING)


class _Places:
    """Geodetic positions of a fleet at one tick, computed on first use: most ticks do not need them, and they take
    longer than the rest of the navigation solution."""

    def __init__(
        self, position_ned_m: npt.NDArray[np.float64], receiver_down_m: npt.NDArray[np.float64], home: Geodetic
    ) -> None:
        self._given = position_ned_m, receiver_down_m, home

    @cached_property
    def _all(self) -> list[Place]:
        position, receiver_down_m, home = self._given
        latitude, longitude, altitude = geodetic_from_ned(position, home)
        receiver_altitude = altitude + position[:, 2] - receiver_down_m
        columns = (each.tolist() for each in (latitude, longitude, altitude, receiver_altitude))
        return list(map(Place._make, zip(*columns, strict=True)))

    def of(self, index: int) -> Place:
        return self._all[index]


class FleetNavigation:
    """The navigation solutions of a fleet: copied from the world once a tick, returned one by one.

    The emulator's geoid is its ellipsoid: altitudes above mean sea level and above the ellipsoid are the same.
    """

    def __init__(self, world: World, home: Geodetic) -> None:
        self.home = home
        self._world = world
        self._solutions: list[Navigation] = []
        self.refresh()

    def refresh(self) -> None:
        """Copy the present world."""
        world, receivers = self._world, self._world.receivers
        position = world.reported_position_ned_m
        places = _Places(position, world.receiver_down_m, self.home)
        vectors = zip(
            position.tolist(),
            world.reported_velocity_ned_mps.tolist(),
            world.acceleration_ned_mps2.tolist(),
            strict=True,
        )
        figures = zip(
            (partial(places.of, index) for index in range(len(position))),
            receivers.h_acc_m.tolist(),
            receivers.v_acc_m.tolist(),
            receivers.vel_acc_mps.tolist(),
            receivers.bound_3sigma_m.tolist(),
            receivers.fix_type.tolist(),
            receivers.ekf_h_acc_m.tolist(),
            receivers.innovation_ratio.tolist(),
            world.battery.remaining.tolist(),
            world.battery.voltage_v.tolist(),
            world.battery.current_a.tolist(),
            (world.link_on & ~world.is_ghost).tolist(),
            map(VehicleState, world.state.tolist()),
            strict=True,
        )
        self._solutions = [
            Navigation(world.time_s, (*at,), (*velocity,), (*acceleration,), *rest)
            for (at, velocity, acceleration), rest in zip(vectors, figures, strict=True)
        ]

    def __getitem__(self, index: int) -> Navigation:
        return self._solutions[index]
