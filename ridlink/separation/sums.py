"""Distributions of sums of the parts of a separation distance: of two errors (Eq. 12), and of any parts.

Source: paper, Eq. 12 and section IV. Each has the interface of `Distribution`, over arrays, in the unit of the parts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ridlink.separation.distributions import (
    DENSITY_AT_ZERO,
    ROOT_TWO,
    Distribution,
    FloatArray,
    HalfNormal,
    check_parameter,
)
from ridlink.separation.gaussian import checked_probability, erf

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_BISECTIONS = 60
"""Each halves the error: enough for every bit of a double."""


@dataclass(frozen=True, slots=True)
class HalfNormalSum:
    """Sum of two independent half-normal errors, `eps_i + eps_j` of Eq. 12.

    Args:
        sigma_i: Standard deviation of the first error.
        sigma_j: Standard deviation of the second error.

    Raises:
        ValueError: If a standard deviation is not positive and finite.
    """

    sigma_i: float
    sigma_j: float

    def __post_init__(self) -> None:
        check_parameter("sigma_i", self.sigma_i)
        check_parameter("sigma_j", self.sigma_j)

    @property
    def _pair(self) -> float:
        return math.hypot(self.sigma_i, self.sigma_j)

    @property
    def mean(self) -> float:
        return (self.sigma_i + self.sigma_j) * math.sqrt(2.0 / math.pi)

    @property
    def sd(self) -> float:
        return self._pair * math.sqrt(1.0 - 2.0 / math.pi)

    def pdf(self, x: ArrayLike) -> FloatArray:
        """Eq. 12 as printed."""
        value = np.maximum(np.asarray(x, dtype=np.float64), 0.0)
        scaled = value / (ROOT_TWO * self._pair)
        ratio = self.sigma_i / self.sigma_j
        both = erf(ratio * scaled) + erf(scaled / ratio)
        return np.asarray(2.0 * DENSITY_AT_ZERO / self._pair * np.exp(-(scaled**2)) * both)

    def cdf(self, x: ArrayLike) -> FloatArray:
        """Probability of at most `x`: `erf(x / 2 sigma)^2` for equal sigmas, otherwise one integral.

        The integral is over the smaller error, `f(y) F(x - y)`: the distribution function of the other is smoother than
        its density.
        """
        value = np.maximum(np.asarray(x, dtype=np.float64), 0.0)
        small, large = (HalfNormal(sigma) for sigma in sorted((self.sigma_i, self.sigma_j)))
        if small == large:
            return np.asarray(erf(value / (2.0 * self.sigma_i)) ** 2)
        half = np.minimum(value, 9.0 * small.sigma)[..., None] / 2.0
        y = half * (_NODES + 1.0)
        return np.asarray(np.clip((half * small.pdf(y) * large.cdf(value[..., None] - y)) @ _WEIGHTS, 0.0, 1.0))

    def quantile(self, probability: ArrayLike) -> FloatArray:
        p = checked_probability(probability)
        if self.sigma_i == self.sigma_j:
            return HalfNormal(ROOT_TWO * self.sigma_i).quantile(np.sqrt(p))
        found = _bisected(self.cdf, p, 0.0, 10.0 * (self.sigma_i + self.sigma_j))
        return np.where(p == 1.0, np.inf, found)

    def sample(self, generator: np.random.Generator, size: int | tuple[int, ...] = ()) -> FloatArray:
        return HalfNormal(self.sigma_i).sample(generator, size) + HalfNormal(self.sigma_j).sample(generator, size)


@dataclass(frozen=True)
class Sum:
    """Sum of independent parts, tabulated once by convolution.

    The radius of a uNMAC is such a sum: half of both airframes, both errors, the distances that both fly between two
    reports. It has no known closed form. The table is good to some millionths of probability, or to some
    hundred-thousandths if one part begins with a jump and the others are hundreds of times narrower.

    Args:
        parts: Parts to add up.

    Raises:
        ValueError: If there are none.
    """

    parts: tuple[Distribution, ...]

    CELLS = 2048
    TAIL = 1e-10

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError("a sum needs parts")

    @property
    def mean(self) -> float:
        return math.fsum(part.mean for part in self.parts)

    @property
    def sd(self) -> float:
        return math.sqrt(math.fsum(part.sd**2 for part in self.parts))

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Values, one cell apart, and the probability of at most each."""
        spans = [part.quantile([self.TAIL, 1.0 - self.TAIL]).tolist() for part in self.parts]
        cell = max(high - low for low, high in spans) / self.CELLS
        counts = [math.ceil((high - low) / cell) for low, high in spans]
        # Cells begin where the widest part does, for its density may begin with a jump; on the others they are centred.
        firsts = [(low + high - cell * count) / 2.0 for (low, high), count in zip(spans, counts, strict=True)]
        length = sum(counts)
        transform = np.ones(length // 2 + 1, dtype=np.complex128)
        for part, first, count in zip(self.parts, firsts, counts, strict=True):
            mass = np.diff(part.cdf(first + cell * np.arange(count + 1)))
            transform *= np.fft.rfft(mass, length)
        total = np.maximum(np.fft.irfft(transform, length), 0.0)
        reached = np.concatenate(([0.0], np.cumsum(total)))
        begin = math.fsum(firsts) + cell * (len(self.parts) - 1) / 2.0  # the mass of a cell stands for its middle
        values: FloatArray = begin + cell * np.arange(len(reached), dtype=np.float64)
        return values, reached / reached[-1]

    def pdf(self, x: ArrayLike) -> FloatArray:
        values, reached = self._table
        middle, cell = (values[1:] + values[:-1]) / 2.0, values[1] - values[0]
        density = np.diff(reached) / cell
        return np.asarray(np.interp(np.asarray(x, dtype=np.float64), middle, density, left=0.0, right=0.0))

    def cdf(self, x: ArrayLike) -> FloatArray:
        return np.asarray(np.interp(np.asarray(x, dtype=np.float64), *self._table))

    def quantile(self, probability: ArrayLike) -> FloatArray:
        values, reached = self._table
        return np.asarray(np.interp(checked_probability(probability), reached, values))

    def sample(self, generator: np.random.Generator, size: int | tuple[int, ...] = ()) -> FloatArray:
        return np.asarray(sum(part.sample(generator, size) for part in self.parts))


def _bisected(cdf: Callable[[FloatArray], FloatArray], p: FloatArray, low: float, high: float) -> FloatArray:
    """Value between two ends at which a distribution function reaches p."""
    below, above = np.full(p.shape, low), np.full(p.shape, high)
    for _ in range(_BISECTIONS):
        middle = (below + above) / 2.0
        short = cdf(middle) < p
        below, above = np.where(short, middle, below), np.where(short, above, middle)
    return np.asarray((below + above) / 2.0)
