"""What is drawn in a run: the fleet, and the position errors of its vehicles.

Every run has a generator of its own for each source of chance, so that a run can be flown alone, in any batch and under
any definition or solver, with equal draws.

Units: metres, m/s, seconds; one standard deviation is per horizontal axis unless a name says otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray

from ridlink.separation.reference import CATEGORIES, MAX_AIRFRAME_M, MIN_AIRFRAME_M

FloatArray = NDArray[np.float64]

PAPER_SPEED_RANGE_MPS = (10.0, CATEGORIES[4].max_speed_mps)
"""Speeds outside are drawn again: the paper's fleet flies, it does not hover."""

CORRELATION_TIME_S = 10.0
"""Time constant of the Gauss-Markov errors: real receivers wander over tens of seconds."""


class Source(IntEnum):
    """Sources of chance; the numbers are part of what a seed means and never change."""

    FLEET = 1
    POSITION = 2


class ErrorModel(StrEnum):
    """How a standard deviation becomes a position error.

    WHITE_RADIAL: the paper's, `|N(0, sigma^2)| (cos phi, sin phi)`, new in every report. Its radius is half-normal, so
        one axis has a standard deviation of sigma / sqrt(2) only.
    WHITE: normal on each axis, new in every report.
    GAUSS_MARKOV: normal on each axis, correlated over 10 s.
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


def draw_fleet(count: int, seed: int, run: int) -> Fleet:
    """The fleet of the paper: AF ~ U(0.1, 7.5) m, V ~ N(30.7, 5.1^2) m/s drawn again until within [10, 51.5].

    Source: Tables III and IV, Eq. 4. The paper names category 3, whose maximum is 30.7 m/s; only with that as the mean
    do its mission times come out.
    """
    random = generator(seed, run, Source.FLEET)
    mean, sigma = CATEGORIES[3].max_speed_mps, CATEGORIES[3].speed_sigma_mps
    airframe, speed = np.empty(count), np.empty(count)
    for k in range(count):
        airframe[k] = random.uniform(MIN_AIRFRAME_M, MAX_AIRFRAME_M)
        speed[k] = random.normal(mean, sigma)
        while not PAPER_SPEED_RANGE_MPS[0] <= speed[k] <= PAPER_SPEED_RANGE_MPS[1]:
            speed[k] = random.normal(mean, sigma)
    return Fleet(airframe, speed)


class PositionErrors:
    """Position errors of a batch of runs, one report after the other.

    Args:
        model: How sigma becomes an error.
        sigma_m: Standard deviation, of all or of each, shape (N,).
        count: Vehicles in a run.
        seed: Seed of the campaign.
        runs: The runs of the batch, W of them.
        interval_s: Time between two reports.
    """

    _BLOCK = 32

    def __init__(
        self, model: ErrorModel, sigma_m: float | FloatArray, *, count: int, seed: int, runs: range, interval_s: float
    ) -> None:
        self._model = ErrorModel(model)
        self._sigma_m: FloatArray = np.broadcast_to(np.asarray(sigma_m, dtype=np.float64), (count,))
        self._count = count
        self._random = [generator(seed, run, Source.POSITION) for run in runs]
        self._keep = math.exp(-interval_s / CORRELATION_TIME_S)
        self._drawn = np.empty((0, 0, 0, 2))
        self._next = 0
        self._present: FloatArray | None = None

    def next(self) -> FloatArray:
        """Errors of the next report, shape (W, N, 2)."""
        if self._model is ErrorModel.BIAS and self._present is not None:
            return self._present
        if self._next == self._drawn.shape[1]:
            self._drawn = np.stack([self._block(random) for random in self._random])
            self._next = 0
        drawn = self._drawn[:, self._next]
        self._next += 1
        if self._model is ErrorModel.GAUSS_MARKOV and self._present is not None:
            drawn = self._keep * self._present + math.sqrt(1.0 - self._keep**2) * drawn
        self._present = drawn
        return drawn

    def keep(self, runs: NDArray[np.bool_]) -> None:
        """Go on with some runs of the batch only."""
        self._random = [random for random, kept in zip(self._random, runs, strict=True) if kept]
        self._drawn = self._drawn[runs]
        if self._present is not None:
            self._present = self._present[runs]

    def _block(self, random: np.random.Generator) -> FloatArray:
        """Draws of one run for the next reports, shape (block, N, 2)."""
        shape = (self._BLOCK, self._count)
        if self._model is not ErrorModel.WHITE_RADIAL:
            return self._sigma_m[:, None] * random.standard_normal((*shape, 2))
        radius = self._sigma_m * np.abs(random.standard_normal(shape))
        angle = random.uniform(0.0, 2.0 * math.pi, shape)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
