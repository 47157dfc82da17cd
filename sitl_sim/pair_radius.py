"""Radii of all pairs of a fleet whose violations the referee counts, in metres, shape (n, n)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention, coded_bound_m
from ridlink.scenario import Scenario
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import Definition, Reported, bounded_interval, separation_discs
from ridlink.separation.volumes import unmac_radius

FloatArray = npt.NDArray[np.float64]


class Flown(Protocol):
    """The data that radii are computed from; a `World` has them."""

    @property
    def scenario(self) -> Scenario:
        """The scenario, with airframes."""

    @property
    def interval_s(self) -> FloatArray:
        """Time between two Remote ID updates of each vehicle, shape (n,)."""

    @property
    def bound_3sigma_m(self) -> FloatArray:
        """Three sigma of each vehicle's position error."""

    @property
    def velocity_ned_mps(self) -> FloatArray:
        """True velocities, shape (n, 3)."""

    @property
    def reported_velocity_ned_mps(self) -> FloatArray:
        """Velocities as the vehicles report them, shape (n, 3)."""


def eq8_pair_radius(world: Flown) -> FloatArray:
    """uNMAC radii of all pairs from true sizes, bounds, speeds and intervals [m], shape (n, n).

    Source: paper Eq. 8. The radius of a pair is the sum of one share of each, so n shares are enough: a share is the
    radius with a point that stands still and has no error.
    """

    def beside_nothing(values: FloatArray) -> FloatArray:
        return np.stack([values, np.zeros_like(values)], axis=-1)

    speed_mps = np.hypot(world.velocity_ned_mps[:, 0], world.velocity_ned_mps[:, 1])
    share = unmac_radius(
        beside_nothing(_airframes_m(world)),
        beside_nothing(world.bound_3sigma_m),
        beside_nothing(speed_mps),
        world.interval_s,
    )
    return np.asarray(share[:, None] + share[None, :])


def pair_radius_under(
    definition: Definition,
    eta: float = DEFAULT_ETA,
    convention: AccuracyConvention | str = DEFAULT_CONVENTION,
) -> Callable[[Flown], FloatArray]:
    """Pair radii of a whole fleet under a definition, shape (n, n), from what the vehicles broadcast of themselves.

    These are the data that others can know, as in a recording: a vehicle that sends standard Remote ID alone has
    neither size nor error. For a vehicle that broadcasts nothing, its own size and error are used.

    Args:
        definition: Separation definition, which decides what fields count.
        eta: Parameter of ``chance`` only.
        convention: For ``odid-accuracy`` only: how accuracy codes are read.
    """

    def radii(world: Flown) -> FloatArray:
        bound = world.bound_3sigma_m
        is_told = np.array([vehicle.extended or vehicle.silent for vehicle in world.scenario.vehicles])
        speed = np.hypot(world.reported_velocity_ned_mps[:, 0], world.reported_velocity_ned_mps[:, 1])
        coded = np.array([coded_bound_m(each, convention) for each in bound.tolist()])
        airframe, error = (np.where(is_told, figures, np.nan) for figures in (_airframes_m(world), bound))
        fleet = Reported(airframe, error, coded, speed)
        neighbours = max(len(bound) - 1, 1)
        interval = bounded_interval(world.interval_s)
        return separation_discs(
            definition,
            fleet[:, None],
            fleet,
            interval_s=np.maximum(interval[:, None], interval),
            eta=eta,
            neighbours=neighbours,
        ).radius_m

    return radii


def _airframes_m(world: Flown) -> FloatArray:
    return np.array([vehicle.airframe_m for vehicle in world.scenario.vehicles], dtype=np.float64)
