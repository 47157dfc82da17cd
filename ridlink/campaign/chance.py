"""Random draws of a run: the fleet, and the position errors of its vehicles.

Every run has its own generator for each source of chance. So a run has the same draws when it is flown alone, in any
batch, and under any definition or solver.

Units: metres, m/s, seconds; one standard deviation is per horizontal axis unless a name says otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ridlink.separation.reference import CATEGORIES, MAX_AIRFRAME_M, MIN_AIRFRAME_M
from ridlink.words import Named

FloatArray = NDArray[np.float64]

PAPER_MEAN_SPEED_MPS = CATEGORIES[3].max_speed_mps
"""Mean speed of the fleets in the paper's simulation."""

PAPER_SPEED_RANGE_MPS = (10.0, CATEGORIES[4].max_speed_mps)
"""Speeds outside are drawn again, since the paper's fleet does not hover."""

CORRELATION_TIME_S = 10.0
"""Time constant of the Gauss-Markov errors: real receivers wander over tens of seconds."""


class Source(IntEnum):
    """Sources of chance; the numbers determine the draws of a seed and never change."""

    FLEET = 1
    POSITION = 2
    MIX = 3
    RADIO = 4
    COMMON = 5
    BIAS = 6
    PHASE = 7


class ErrorModel(Named):
    """How a standard deviation becomes a position error.

    WHITE_RADIAL: the paper's model, `|N(0, sigma^2)| (cos phi, sin phi)`, new in every report. Its radius is
    half-normal, so
        one axis has a standard deviation of sigma / sqrt(2) only.
    WHITE: normal on each axis, new in every report.
    GAUSS_MARKOV: normal on each axis, correlated over 10 s unless said otherwise.
    BIAS: normal on each axis, one draw for the whole flight.
    """

    WHITE_RADIAL = "white-radial"
    WHITE = "white"
    GAUSS_MARKOV = "gauss-markov"
    BIAS = "bias"


def generator(seed: int, run: int, source: Source) -> np.random.Generator:
    """The generator of one source of chance in one run."""
    return np.random.default_rng(np.random.SeedSequence([seed, run, int(source)]))


@dataclass(frozen=True, slots=True)
class Fleet:
    """Airframe sizes (diameters) [m] and cruise speeds [m/s] of one run, shape (N,) each."""

    airframe_m: FloatArray
    speed_mps: FloatArray


def draw_fleet(count: int, seed: int, run: int, category: int | None = None) -> Fleet:
    """Draw a fleet: AF ~ U(0.1, 7.5) m, and normal cruise speeds, drawn again while out of range.

    Source: Tables III and IV, Eq. 4. The paper names category 3, whose maximum is 30.7 m/s; only with that as the mean
    are its mission times reproduced.

    Args:
        count: Number of vehicles.
        seed: Seed of the campaign.
        run: Number of the run.
        category: Column of Table III: speeds about V_c, from a third of it to V_max. None: the paper's simulation,
            V ~ N(30.7, 5.1^2) m/s within [10, 51.5].
    """
    random = generator(seed, run, Source.FLEET)
    if category is None:
        mean, sigma = PAPER_MEAN_SPEED_MPS, CATEGORIES[3].speed_sigma_mps
        slowest, fastest = PAPER_SPEED_RANGE_MPS
    else:
        drawn = CATEGORIES[category]
        mean, sigma = drawn.cruise_speed_mps, drawn.speed_sigma_mps
        slowest, fastest = mean / 3.0, drawn.max_speed_mps
    airframe, speed = np.empty(count), np.empty(count)
    for k in range(count):
        airframe[k] = random.uniform(MIN_AIRFRAME_M, MAX_AIRFRAME_M)
        speed[k] = random.normal(mean, sigma)
        while not slowest <= speed[k] <= fastest:
            speed[k] = random.normal(mean, sigma)
    return Fleet(airframe, speed)


@dataclass(frozen=True, slots=True)
class Mix:
    """Special vehicles in the fleet of one run, shape (N,) each.

    Attributes:
        stock: Vehicles that send standard Remote ID only.
        unresponsive: Vehicles that avoid nobody; they do not set the flag that says they avoid.
    """

    stock: NDArray[np.bool_]
    unresponsive: NDArray[np.bool_]


def draw_mix(count: int, seed: int, run: int, *, stock_share: float, unresponsive_share: float) -> Mix:
    """Draw special vehicles with these probabilities; a larger share includes the vehicles of a smaller one."""
    drawn = generator(seed, run, Source.MIX).random((2, count))
    return Mix(drawn[0] < stock_share, drawn[1] < unresponsive_share)


class PositionErrors:
    """Position errors of a batch of runs, report by report.

    Args:
        model: How sigma becomes an error.
        sigma_m: Standard deviation, one for all or one for each, shape (N,).
        count: Vehicles in a run.
        seed: Seed of the campaign.
        runs: The runs of the batch, W of them.
        interval_s: Time between two reports.
        correlation_s: Time constant of the Gauss-Markov errors.
        common_share: Part of the variance that all vehicles of a run share, since they see the same satellites.
        bias_m: Standard deviation per axis of an additional offset that lasts the whole flight and is in no error
            bound.
    """

    def __init__(
        self, model: ErrorModel, sigma_m: float | FloatArray, *, count: int, seed: int, runs: range, interval_s: float,
        correlation_s: float = CORRELATION_TIME_S, common_share: float = 0.0, bias_m: float = 0.0,
    ) -> None:  # fmt: skip
        sigma: FloatArray = np.broadcast_to(np.asarray(sigma_m, dtype=np.float64), (count,))
        keep = math.exp(-interval_s / correlation_s)

        def walk(source: Source, size_m: FloatArray) -> _Walk:
            return _Walk(ErrorModel(model), size_m, [generator(seed, run, source) for run in runs], keep)

        self._own = walk(Source.POSITION, math.sqrt(1.0 - common_share) * sigma)
        self._common = walk(Source.COMMON, np.ones(1)) if common_share > 0.0 else None
        self._common_m = math.sqrt(common_share) * sigma[:, None]
        self._bias: FloatArray | None = None
        if bias_m > 0.0:
            drawn = [generator(seed, run, Source.BIAS).standard_normal((count, 2)) for run in runs]
            self._bias = bias_m * np.stack(drawn)

    def next(self) -> FloatArray:
        """Errors of the next report, shape (W, N, 2)."""
        errors = self._own.next()
        if self._common is not None:
            errors = errors + self._common_m * self._common.next()
        return errors if self._bias is None else errors + self._bias

    def keep(self, runs: NDArray[np.bool_]) -> None:
        """Keep only some runs of the batch."""
        self._own.keep(runs)
        if self._common is not None:
            self._common.keep(runs)
        if self._bias is not None:
            self._bias = self._bias[runs]


class _Walk:
    """Errors of one vehicle per size, from one generator per run."""

    _BLOCK = 32

    def __init__(self, model: ErrorModel, size_m: FloatArray, random: list[np.random.Generator], keep: float) -> None:
        self._model, self._size_m, self._random, self._keep = model, size_m, random, keep
        self._drawn = np.empty((0, 0, 0, 2))
        self._next = 0
        self._present: FloatArray | None = None

    def next(self) -> FloatArray:
        """Shape (W, N, 2)."""
        if self._model is ErrorModel.BIAS and self._present is not None:
            return self._present
        if self._next == self._drawn.shape[1]:
            self._drawn = self._blocks()
            self._next = 0
        drawn = self._drawn[:, self._next]
        self._next += 1
        if self._model is ErrorModel.GAUSS_MARKOV and self._present is not None:
            drawn = self._keep * self._present + math.sqrt(1.0 - self._keep**2) * drawn
        self._present = drawn
        return drawn

    def keep(self, runs: NDArray[np.bool_]) -> None:
        """Keep only some runs of the batch."""
        self._random = [random for random, kept in zip(self._random, runs, strict=True) if kept]
        self._drawn = self._drawn[runs]
        if self._present is not None:
            self._present = self._present[runs]

    def _blocks(self) -> FloatArray:
        """Draws of every run for the next reports, shape (W, block, N, 2)."""
        shape = (len(self._random), self._BLOCK, len(self._size_m))
        if self._model is not ErrorModel.WHITE_RADIAL:
            drawn = np.empty((*shape, 2))
            for random, part in zip(self._random, drawn, strict=True):
                random.standard_normal(out=part)
            drawn *= self._size_m[:, None]
            return drawn
        radius, angle = np.empty(shape), np.empty(shape)
        for k, random in enumerate(self._random):
            random.standard_normal(out=radius[k])
            random.random(out=angle[k])
        radius = self._size_m * np.abs(radius)
        angle *= 2.0 * math.pi
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
