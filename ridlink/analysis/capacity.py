"""Capacity of an airspace: how many vehicles it holds, and how often they come into conflict, by a formula and a
simulation.

The gas model: vehicles are spread evenly over the plane, fly straight on with equally likely headings, and nobody
avoids. A vehicle that meets others of density n at relative speed w sweeps a strip of width 2 R, so it enters the discs
of others `2 n E[R w]` times in a unit of time. A unit of area has `n^2 E[R w]` such conflicts, since each takes two
vehicles. With equal speeds `E[w] = 4 V / pi`. The model counts conflicts that avoidance has to solve, not collisions.

Sources: J.C. Maxwell's mean free path in two dimensions, for aircraft: B. Alexander, "Aircraft density and midair
collision", Proc. IEEE 58 (1970); S. Endoh, "Aircraft collision models", MIT FTL R82-2 (1982). Densest packing of equal
discs: `2 / sqrt(3) / R^2` centres at least R apart in a unit of area (A. Thue 1910, L. Fejes Toth 1940).

Units: metres, seconds, m/s; densities per km2, rates per hour.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.campaign.statistics import LEAST_RUNS, Interval
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention, coded_bound_m
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import Definition, Reported, separation_discs
from ridlink.separation.distributions import TruncatedNormal
from ridlink.separation.reference import CATEGORIES, MAX_AIRFRAME_M, MIN_AIRFRAME_M
from ridlink.words import counted

FloatArray = NDArray[np.float64]

M2_PER_KM2 = 1e6
S_PER_H = 3600.0
PROBABILITY = 0.997
"""Share of pairs whose radius is not above the reported quantile; the value of the paper."""

VEHICLES = 40
"""Vehicles in each simulated world."""

CROSSINGS = 2.0
"""Number of times that the fastest pair crosses a simulated world."""

FEW = f"of fewer than {LEAST_RUNS} worlds no interval says how far a simulated figure can be trusted"

MOST_OF_NONE = -math.log(0.025)
"""Upper bound of the expected number of events if none is counted: Poisson's two-sided 95 %."""

NORMAL = 1.959964
"""Two-sided 95 % of a normal distribution, in standard deviations."""

_HEADINGS, _SPEEDS = 720, 64


@dataclass(frozen=True, slots=True)
class Airspace:
    """Vehicles of an airspace, and their separation.

    Args:
        definition: Separation definition.
        sigma_m: Standard deviation of the position error per axis, of every vehicle; it reports three times this.
        interval_s: Time between two reports.
        category: Category of Table III: speeds are normal about V_c (Eq. 4), from a third of it to V_max; airframes are
            uniform between 0.1 and 7.5 m.
        eta: For the definition `chance`.
        convention: For the definition `odid-accuracy`: how accuracy codes are read.

    Raises:
        ValueError: If a figure is negative or not finite, or the category is unknown.
    """

    definition: Definition
    sigma_m: float
    interval_s: float
    category: int
    eta: float = DEFAULT_ETA
    convention: AccuracyConvention | str = DEFAULT_CONVENTION

    def __post_init__(self) -> None:
        for name in ("sigma_m", "interval_s"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ValueError(f"{name} must be finite and not negative, got {getattr(self, name)}")
        if self.category not in CATEGORIES:
            raise ValueError(f"category must be one of {', '.join(map(str, CATEGORIES))}, got {self.category}")
        object.__setattr__(self, "definition", Definition(self.definition))

    @property
    def speed(self) -> TruncatedNormal:
        """Speeds of the fleet [m/s]."""
        drawn = CATEGORIES[self.category]
        mean = drawn.cruise_speed_mps
        return TruncatedNormal(mean, drawn.speed_sigma_mps, mean / 3.0, drawn.max_speed_mps)

    def radius_m(
        self, airframe_m: ArrayLike, other_airframe_m: ArrayLike, speed_mps: ArrayLike, other_speed_mps: ArrayLike
    ) -> FloatArray:
        """Radius of the disc of pairs [m]; all arguments broadcast."""
        error_m, coded_m = 3.0 * self.sigma_m, coded_bound_m(3.0 * self.sigma_m, self.convention)
        own = Reported(airframe_m, error_m, coded_m, speed_mps)
        other = Reported(other_airframe_m, error_m, coded_m, other_speed_mps)
        return separation_discs(self.definition, own, other, interval_s=self.interval_s, eta=self.eta).radius_m


@dataclass(frozen=True, slots=True)
class Gas:
    """The figures of the formula.

    Attributes:
        radius_m: Mean radius of a pair.
        relative_speed_mps: Mean relative speed.
        swept_m2ps: Area that a vehicle sweeps, 2 E[R w].
        mac_swept_m2ps: Swept area with the MAC radius, half the sum of both airframes.
    """

    radius_m: float
    relative_speed_mps: float
    swept_m2ps: float
    mac_swept_m2ps: float

    @property
    def packed_per_km2(self) -> float:
        """Largest number of hovering vehicles that fit, the mean radius apart."""
        return M2_PER_KM2 * 2.0 / math.sqrt(3.0) / self.radius_m**2

    def conflicts_per_flight_hour(self, density_per_km2: float) -> float:
        """Rate at which one vehicle enters discs of others."""
        return self.swept_m2ps * density_per_km2 / M2_PER_KM2 * S_PER_H

    def conflicts_per_km2_hour(self, density_per_km2: float) -> float:
        """Rate of conflicts in a square kilometre."""
        return self.conflicts_per_flight_hour(density_per_km2) * density_per_km2 / 2.0

    def macs_per_flight_hour(self, density_per_km2: float) -> float:
        """Rate of collisions of one vehicle if nobody avoided."""
        return self.mac_swept_m2ps * density_per_km2 / M2_PER_KM2 * S_PER_H

    def density_per_km2(self, conflicts_per_flight_hour: float) -> float:
        """Density at which each vehicle has this rate of conflicts, or the packed density if that is less."""
        wanted = conflicts_per_flight_hour / S_PER_H * M2_PER_KM2 / self.swept_m2ps
        return min(wanted, self.packed_per_km2)


def gas_model(airspace: Airspace) -> Gas:
    """The formula: means over both speeds, by their quantiles, and over all headings.

    Radii are linear in the airframes, which are independent of everything else, so their mean is used.
    """
    drawn = airspace.speed.quantile((np.arange(_SPEEDS) + 0.5) / _SPEEDS)
    own, other = drawn[:, None], drawn[None, :]
    angle = 2.0 * math.pi * np.arange(_HEADINGS) / _HEADINGS
    # law of cosines; a periodic mean over equal steps is exact up to rounding, except where the speeds are equal
    squares = own[..., None] ** 2 + other[..., None] ** 2 - 2.0 * own[..., None] * other[..., None] * np.cos(angle)
    relative = np.sqrt(np.maximum(squares, 0.0)).mean(axis=-1)
    airframe = (MIN_AIRFRAME_M + MAX_AIRFRAME_M) / 2.0
    radius = np.broadcast_to(airspace.radius_m(airframe, airframe, own, other), relative.shape)
    return Gas(
        float(radius.mean()), float(relative.mean()), 2.0 * float((radius * relative).mean()),
        2.0 * airframe * float(relative.mean()),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Simulated:
    """Results of a simulated gas.

    Attributes:
        conflicts: Counted entries into discs.
        conflicts_per_flight_hour: Rate at the requested density.
        ci95: Interval of the rate, from the spread of the worlds; None for fewer than `LEAST_RUNS`. If nothing was
            counted, the bound for zero events, for any number of worlds.
        radius_quantile_m: Radius that `PROBABILITY` of the pairs do not exceed.
    """

    conflicts: int
    conflicts_per_flight_hour: float
    ci95: Interval | None
    radius_quantile_m: float


def simulate_gas(
    airspace: Airspace, density_per_km2: float, random: np.random.Generator, worlds: int = 400
) -> Simulated:  # fmt: skip
    """Count every entry into the disc of another among vehicles that fly straight on over a torus.

    The formula is not used. Since paths are straight, entries are found exactly, on all images of the torus.

    Args:
        airspace: Vehicles and separation.
        density_per_km2: Other vehicles in a square kilometre.
        random: Draws fleets, positions and headings.
        worlds: Number of worlds of 40 vehicles.

    Raises:
        ValueError: If the density is not positive, or there are fewer than two worlds.
    """
    if not (math.isfinite(density_per_km2) and density_per_km2 > 0.0):
        raise ValueError(f"density_per_km2 must be positive and finite, got {density_per_km2}")
    if worlds < 2:
        raise ValueError(f"worlds must be at least 2, got {worlds}")
    side_m = math.sqrt((VEHICLES - 1) / density_per_km2 * M2_PER_KM2)
    duration_s = CROSSINGS * side_m / (2.0 * CATEGORIES[airspace.category].max_speed_mps)
    counts, radii = zip(*(_world(airspace, side_m, duration_s, random) for _ in range(worlds)), strict=True)
    per_hour = 2.0 / VEHICLES / duration_s * S_PER_H
    mean = float(np.mean(counts)) * per_hour
    quantile = float(np.quantile(np.concatenate(radii), PROBABILITY))
    spread = None
    if not any(counts):
        spread = MOST_OF_NONE / worlds * per_hour
    elif worlds >= LEAST_RUNS:
        spread = students_t(worlds - 1) * float(np.std(counts, ddof=1)) / math.sqrt(worlds) * per_hour
    interval = None if spread is None else (max(mean - spread, 0.0), mean + spread)
    return Simulated(sum(counts), mean, interval, quantile)


def students_t(freedom: int) -> float:
    """Half the width of a two-sided 95 % interval of a mean, in estimated standard errors.

    Source: Abramowitz and Stegun 26.7.5; within 0.2 % from 5 degrees of freedom up.
    """
    z = NORMAL
    return (
        z
        + (z**3 + z) / (4.0 * freedom)
        + (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * freedom**2)
        + (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / (384.0 * freedom**3)
    )


def _world(airspace: Airspace, side_m: float, duration_s: float, random: np.random.Generator) -> tuple[int, FloatArray]:
    """Entries in one world, and the radii of its pairs."""
    airframe = random.uniform(MIN_AIRFRAME_M, MAX_AIRFRAME_M, VEHICLES)
    speed = airspace.speed.sample(random, VEHICLES)
    heading = random.uniform(0.0, 2.0 * math.pi, VEHICLES)
    place = random.uniform(0.0, side_m, (VEHICLES, 2))
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    i, j = np.triu_indices(VEHICLES, 1)
    radius = np.broadcast_to(airspace.radius_m(airframe[i], airframe[j], speed[i], speed[j]), i.shape)
    w = velocity[j] - velocity[i]
    w_north, w_east = w[:, :1], w[:, 1:]
    far = math.ceil(CROSSINGS + 1.0 + float(radius.max()) / side_m)
    steps = np.arange(-far, far + 1) * side_m
    d = place[j] - place[i]
    r_north, r_east = (d[:, axis, None] + image.ravel() for axis, image in enumerate(np.meshgrid(steps, steps)))
    # |r + w t| = R, the first of the two times; most images pass outside
    speed_2 = (w**2).sum(axis=-1)
    inside = (radius**2 * speed_2)[:, None] - (r_north * w_east - r_east * w_north) ** 2
    passes = np.nonzero(inside > 0.0)
    pair = passes[0]
    closing = -(r_north[passes] * w[pair, 0] + r_east[passes] * w[pair, 1])
    entry_s = (closing - np.sqrt(inside[passes])) / np.maximum(speed_2[pair], 1e-12)
    return int(((entry_s > 0.0) & (entry_s <= duration_s)).sum()), radius


@dataclass(frozen=True, slots=True)
class Capacity:
    """Formula and simulation at one density.

    Attributes:
        airspace: Vehicles and separation.
        density_per_km2: Vehicles in a square kilometre.
        gas: The formula.
        simulated: The simulation.
        bearable: Conflicts that a vehicle may have in an hour.
    """

    airspace: Airspace
    density_per_km2: float
    gas: Gas
    simulated: Simulated
    bearable: float

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        gas, density = self.gas, self.density_per_km2
        return {
            **asdict(self.airspace),
            "radius_m": gas.radius_m,
            "radius_quantile_m": self.simulated.radius_quantile_m,
            "relative_speed_mps": gas.relative_speed_mps,
            "density_per_km2": density,
            "conflicts_per_flight_hour": gas.conflicts_per_flight_hour(density),
            "simulated_per_flight_hour": self.simulated.conflicts_per_flight_hour,
            "simulated_ci95": self.simulated.ci95,
            "conflicts_per_km2_hour": gas.conflicts_per_km2_hour(density),
            "macs_per_flight_hour_unavoided": gas.macs_per_flight_hour(density),
            "bearable_per_flight_hour": self.bearable,
            "capacity_per_km2": gas.density_per_km2(self.bearable),
            "packed_per_km2": gas.packed_per_km2,
        }


def capacities(
    airspaces: list[Airspace], density_per_km2: float, bearable: float, seed: int, worlds: int
) -> Iterator[Capacity]:  # fmt: skip
    """Formula and simulation of several airspaces, all with the same draws.

    Raises:
        ValueError: As `simulate_gas`, or if more vehicles fly than fit.
    """
    for airspace in airspaces:
        gas = gas_model(airspace)
        if density_per_km2 > gas.packed_per_km2:
            raise ValueError(
                f"a square kilometre has no room for {counted(density_per_km2, 'vehicle', 'g')} "
                f"{gas.radius_m:.1f} m apart ({airspace.definition}): at most {gas.packed_per_km2:.3g} fit"
            )
        simulated = simulate_gas(airspace, density_per_km2, np.random.default_rng(seed), worlds)
        yield Capacity(airspace, density_per_km2, gas, simulated, bearable)
