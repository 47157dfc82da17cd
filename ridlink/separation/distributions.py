"""Distributions of the parts of a separation distance, and of their sum.

Source: paper, Eq. 4 and 10 to 12 and section IV. Each has `pdf`, `cdf`, `quantile`, `mean`, `sd` and `sample`, over
arrays, in the unit of its parameters: metres for distances, metres a second for speeds. What has a closed form uses it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.separation.gaussian import checked_probability, erf, normal_cdf, normal_quantile

FloatArray = NDArray[np.float64]

ROOT_TWO = math.sqrt(2.0)
DENSITY_AT_ZERO = 1.0 / math.sqrt(2.0 * math.pi)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_BISECTIONS = 60
"""Each halves the error: enough for every bit of a double."""


class Distribution(Protocol):
    """What all of them can be asked."""

    @property
    def mean(self) -> float:
        """Mean."""

    @property
    def sd(self) -> float:
        """Standard deviation."""

    def pdf(self, x: ArrayLike) -> FloatArray:
        """Probability density."""

    def cdf(self, x: ArrayLike) -> FloatArray:
        """Probability of at most `x`."""

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Value that is not exceeded with a probability; `ValueError` unless that is within 0 and 1."""

    def sample(self, generator: np.random.Generator, size: int | tuple[int, ...] = ()) -> FloatArray:
        """Independent draws of a shape."""


def _bisected(cdf: Callable[[FloatArray], FloatArray], p: FloatArray, low: float, high: float) -> FloatArray:
    """Where a distribution function between two ends reaches p."""
    below, above = np.full(p.shape, low), np.full(p.shape, high)
    for _ in range(_BISECTIONS):
        middle = (below + above) / 2.0
        short = cdf(middle) < p
        below, above = np.where(short, middle, below), np.where(short, above, middle)
    return np.asarray((below + above) / 2.0)


def _checked(name: str, value: float, *, positive: bool = True) -> None:
    if not math.isfinite(value) or (positive and value <= 0.0):
        raise ValueError(f"{name} must be {'positive and ' if positive else ''}finite, got {value:g}")


@dataclass(frozen=True, slots=True)
class Triangular:
    """Triangular distribution.

    Args:
        low: Lower limit.
        mode: Most likely value.
        high: Upper limit.

    Raises:
        ValueError: If the limits are not finite or in no order, or the mode lies outside of them.
    """

    low: float
    mode: float
    high: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"limits must be finite and differ, got {self.low:g} and {self.high:g}")
        if not self.low <= self.mode <= self.high:
            raise ValueError(f"mode must lie within the limits, got {self.mode:g}")

    @property
    def mean(self) -> float:
        return (self.low + self.mode + self.high) / 3.0

    @property
    def sd(self) -> float:
        a, c, b = self.low, self.mode, self.high
        return math.sqrt((a * a + b * b + c * c - a * b - a * c - b * c) / 18.0)

    def pdf(self, x: ArrayLike) -> FloatArray:
        peak, value = 2.0 / (self.high - self.low), np.asarray(x, dtype=np.float64)
        sides = np.interp(value, [self.low, self.mode, self.high], [0.0, peak, 0.0], left=0.0, right=0.0)
        return np.where(value == self.mode, peak, sides)

    def cdf(self, x: ArrayLike) -> FloatArray:
        value = np.clip(np.asarray(x, dtype=np.float64), self.low, self.high)
        width = self.high - self.low
        rising = (value - self.low) ** 2 / (width * max(self.mode - self.low, math.ulp(width)))
        falling = 1.0 - (self.high - value) ** 2 / (width * max(self.high - self.mode, math.ulp(width)))
        return np.where(value < self.mode, rising, falling)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        p = checked_probability(probability)
        width = self.high - self.low
        rising = self.low + np.sqrt(p * width * (self.mode - self.low))
        falling = self.high - np.sqrt((1.0 - p) * width * (self.high - self.mode))
        return np.where(p * width < self.mode - self.low, rising, falling)

    def sample(self, generator: np.random.Generator, size: int | tuple[int, ...] = ()) -> FloatArray:
        return np.asarray(generator.triangular(self.low, self.mode, self.high, size))


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal distribution; of speeds and of what is flown in a given time.

    Args:
        mu: Mean.
        sigma: Standard deviation.

    Raises:
        ValueError: If the mean is not finite, or the deviation not positive and finite.
    """

    mu: float
    sigma: float

    def __post_init__(self) -> None:
        _checked("mu", self.mu, positive=False)
        _checked("sigma", self.sigma)

    @property
    def mean(self) -> float:
        return self.mu

    @property
    def sd(self) -> float:
        return self.sigma

    def pdf(self, x: ArrayLike) -> FloatArray:
        z = (np.asarray(x, dtype=np.float64) - self.mu) / self.sigma
        return np.asarray(DENSITY_AT_ZERO / self.sigma * np.exp(-(z**2) / 2.0))

    def cdf(self, x: ArrayLike) -> FloatArray:
        return normal_cdf((np.asarray(x, dtype=np.float64) - self.mu) / self.sigma)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        return np.asarray(self.mu + self.sigma * normal_quantile(probability))

    def sample(self, generator: np.random.Generator, size: int | tuple[int, ...] = ()) -> FloatArray:
        return np.asarray(generator.normal(self.mu, self.sigma, size))


@dataclass(frozen=True, slots=True)
class TruncatedNormal:
    """Normal distribution of which draws outside of limits are drawn again.

    Args:
        mu: Mean before the truncation.
        sigma: Standard deviation before the truncation.
        low: Lower limit, may be infinite.
        high: Upper limit, may be infinite.

    Raises:
        ValueError: If mean or deviation are as `Normal` refuses them, the limits are in no order, or less than a
            millionth of all draws lies between them.
    """

    mu: float
    sigma: float
    low: float
    high: float

    def __post_init__(self) -> None:
        _checked("mu", self.mu, positive=False)
        _checked("sigma", self.sigma)
        if not self.low < self.high:
            raise ValueError(f"limits must differ, got {self.low:g} and {self.high:g}")
        if not self._mass > 1e-6:
            raise ValueError(f"next to nothing lies between {self.low:g} and {self.high:g}: draws would never end")

    @property
    def _untruncated(self) -> Normal:
        return Normal(self.mu, self.sigma)

    @property
    def _below(self) -> float:
        return float(self._untruncated.cdf(self.low))

    @property
    def _mass(self) -> float:
        return float(self._untruncated.cdf(self.high)) - self._below

    def _ends(self) -> tuple[float, float, float, float]:
        """Both limits in standard deviations, and the standard normal density there."""
        a, b = (self.low - self.mu) / self.sigma, (self.high - self.mu) / self.sigma
        return a, b, DENSITY_AT_ZERO * math.exp(-a * a / 2.0), DENSITY_AT_ZERO * math.exp(-b * b / 2.0)

    @property
    def mean(self) -> float:
        _, _, at_low, at_high = self._ends()
        return self.mu + self.sigma * (at_low - at_high) / self._mass

    @property
    def sd(self) -> float:
        a, b, at_low, at_high = self._ends()
        low = a * at_low if math.isfinite(a) else 0.0
        high = b * at_high if math.isfinite(b) else 0.0
        shift = (at_low - at_high) / self._mass
        return self.sigma * math.sqrt(1.0 + (low - high) / self._mass - shift**2)

    def pdf(self, x: ArrayLike) -> FloatArray:
        value = np.asarray(x, dtype=np.float64)
        inside = (value >= self.low) & (value <= self.high)
        return np.where(inside, self._untruncated.pdf(value) / self._mass, 0.0)

    def cdf(self, x: ArrayLike) -> FloatArray:
        value = np.clip(np.asarray(x, dtype=np.float64), self.low, self.high)
        return np.asarray((self._untruncated.cdf(value) - self._below) / self._mass)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        p = checked_probability(probability)
        value = self._untruncated.quantile(np.clip(self._below + p * self._mass, 0.0, 1.0))
        return np.asarray(np.clip(value, self.low, self.high))

    def sample(self, generator: np.random.Generator, size: int | tuple[int, ...] = ()) -> FloatArray:
        drawn = np.array(generator.normal(self.mu, self.sigma, size), dtype=np.float64)
        while np.any(outside := (drawn < self.low) | (drawn > self.high)):
            drawn[outside] = generator.normal(self.mu, self.sigma, int(outside.sum()))
        return drawn


@dataclass(frozen=True, slots=True)
class HalfNormal:
    """Magnitude of a normal error of mean zero, `|N(0, sigma^2)|`: the paper's localization error, Eq. 11.

    Args:
        sigma: Standard deviation of that error, of which the magnitude's is 0.603.

    Raises:
        ValueError: If it is not positive and finite.
    """

    sigma: float

    def __post_init__(self) -> None:
        _checked("sigma", self.sigma)

    @property
    def mean(self) -> float:
        return self.sigma * math.sqrt(2.0 / math.pi)

    @property
    def sd(self) -> float:
        return self.sigma * math.sqrt(1.0 - 2.0 / math.pi)

    def pdf(self, x: ArrayLike) -> FloatArray:
        value = np.asarray(x, dtype=np.float64)
        return np.where(value >= 0.0, 2.0 * Normal(0.0, self.sigma).pdf(value), 0.0)

    def cdf(self, x: ArrayLike) -> FloatArray:
        return erf(np.maximum(np.asarray(x, dtype=np.float64), 0.0) / (ROOT_TWO * self.sigma))

    def quantile(self, probability: ArrayLike) -> FloatArray:
        return np.asarray(-self.sigma * normal_quantile((1.0 - checked_probability(probability)) / 2.0))

    def sample(self, generator: np.random.Generator, size: int | tuple[int, ...] = ()) -> FloatArray:
        return np.asarray(np.abs(generator.normal(0.0, self.sigma, size)))


@dataclass(frozen=True, slots=True)
class HalfNormalSum:
    """Sum of two independent half-normal errors, `eps_i + eps_j` of Eq. 12.

    Args:
        sigma_i: Standard deviation of the one.
        sigma_j: Standard deviation of the other.

    Raises:
        ValueError: If one of them is not positive and finite.
    """

    sigma_i: float
    sigma_j: float

    def __post_init__(self) -> None:
        _checked("sigma_i", self.sigma_i)
        _checked("sigma_j", self.sigma_j)

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

        It goes over the smaller error, `f(y) F(x - y)`: the other's distribution function is smoother than its density.
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

    The radius of a uNMAC is such a sum: half of both airframes, both errors, what both fly between two reports. Nobody
    has a closed form for it; the table is good to some millionths of probability, to some hundred-thousandths where one
    part begins with a jump and the others are hundreds of times narrower.

    Args:
        parts: What is added up.

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
        # Cells begin where the widest part does, for its density may begin with a jump, and lie centred on the others.
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
