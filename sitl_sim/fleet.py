"""What is drawn once per vehicle, and the random generator that each vehicle has to itself.

Every source of chance has a stream, every vehicle its own generator in it: vehicle k sees the same errors, losses and
parameters whatever the size of the fleet, and whatever the others draw.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ridlink.separation.reference import CATEGORIES, MAX_AIRFRAME_M, MIN_AIRFRAME_M

if TYPE_CHECKING:
    from ridlink.scenario import Scenario

FloatArray = npt.NDArray[np.float64]

PAPER_SPEED_RANGE_MPS = (10.0, CATEGORIES[4].max_speed_mps)
"""Cruise speeds outside are drawn again: the paper's fleet flies, it does not hover."""


class Stream(IntEnum):
    """Sources of chance; the numbers are part of what a seed means and never change."""

    GNSS = 1
    FLEET = 3
    PHASE = 4
    WIND = 5
    GNSS_COMMON = 6


def vehicle_generator(seed: int | Sequence[int], stream: Stream, index: int) -> np.random.Generator:
    """The generator of one vehicle (or receiver) in one stream.

    Args:
        seed: Seed of the run; several integers where a run is one of a campaign.
        stream: Source of chance.
        index: Number of the vehicle from 0, or of the receiver; not negative.
    """
    words = [seed] if isinstance(seed, int) else [*seed]
    return np.random.default_rng(np.random.SeedSequence([*words, int(stream), index]))


@dataclass(frozen=True, slots=True)
class FleetParameters:
    """Drawn parameters, shape (n,) each: airframe sizes (diameters) [m] and cruise speeds [m/s]."""

    airframe_m: FloatArray
    speed_mps: FloatArray


def draw_fleet(count: int, seed: int | Sequence[int], *, category: int) -> FleetParameters:
    """A fleet of one category: AF ~ U(0.1, 7.5) m, V ~ N(V_c, sigma_v^2) drawn again until within [V_c / 2, V_max].

    Source: Tables III and IV, Eq. 4.

    Raises:
        ValueError: If there is no such category.
    """
    if category not in CATEGORIES:
        raise ValueError(f"unknown category {category}: known are {', '.join(map(str, CATEGORIES))}")
    chosen = CATEGORIES[category]
    mean_mps = chosen.cruise_speed_mps
    return _draw(count, seed, mean_mps, chosen.speed_sigma_mps, (mean_mps / 2.0, chosen.max_speed_mps))


def draw_paper_fleet(count: int, seed: int | Sequence[int]) -> FleetParameters:
    """The fleet of the paper's simulation: AF ~ U(0.1, 7.5) m, V ~ N(30.7, 5.1^2) m/s within [10, 51.5].

    The paper names category 3, whose maximum speed is 30.7 m/s and whose sigma (Eq. 4) is 5.1 m/s; only with 30.7 as
    the mean do its mission times come out, so that is the reading taken here.
    """
    spread = CATEGORIES[3]
    return _draw(count, seed, spread.max_speed_mps, spread.speed_sigma_mps, PAPER_SPEED_RANGE_MPS)


def _draw(
    count: int, seed: int | Sequence[int], mean_mps: float, sigma_mps: float, range_mps: tuple[float, float]
) -> FleetParameters:
    lowest_mps, highest_mps = range_mps
    airframe_m, speed_mps = np.empty(count), np.empty(count)
    for index in range(count):
        generator = vehicle_generator(seed, Stream.FLEET, index)
        airframe_m[index] = generator.uniform(MIN_AIRFRAME_M, MAX_AIRFRAME_M)
        speed = generator.normal(mean_mps, sigma_mps)
        while not lowest_mps <= speed <= highest_mps:
            speed = generator.normal(mean_mps, sigma_mps)
        speed_mps[index] = speed
    return FleetParameters(airframe_m, speed_mps)


def with_parameters(scenario: Scenario, parameters: FleetParameters) -> Scenario:
    """The same scenario flown by a drawn fleet.

    Raises:
        ValueError: If the numbers of vehicles differ.
        ConfigError: If two airframes touch at the start.
    """
    vehicles = tuple(
        replace(vehicle, airframe_m=float(airframe_m), speed_mps=float(speed_mps))
        for vehicle, airframe_m, speed_mps in zip(
            scenario.vehicles, parameters.airframe_m, parameters.speed_mps, strict=True
        )
    )
    return replace(scenario, vehicles=vehicles)
