"""Distributions of the parts of a separation distance; for those of their sums, see `sums`.

Source: paper, Eq. 4, 10 and 11 and section IV. Each has `pdf`, `cdf`, `quantile`, `mean`, `sd` and `sample`, over
arrays, in the unit of its parameters: metres for distances, metres per second for speeds. Closed forms are used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.separation.gaussian import checked_probability, erf, normal_cdf, normal_quantile

FloatArray = NDArray[np.float64]

ROOT_TWO = math.sqrt(2.0)
DENSITY_AT_ZERO = 1.0 / math.sqrt(2.0 * math.pi)


class Distribution(Protocol):
    """Interface of all distributions."""

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
        """Independent draws of a given shape."""


def check_parameter(name: str, value: float, *, positive: bool = True) -> None:
    """Refuse a parameter of a distribution that is not finite or, with `positive`, not positive.

    Raises:
        ValueError: With its name and value.
    """
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
        ValueError: If the limits are not finite or not in order, or the mode lies outside them.
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
    """Normal distribution, for speeds and for the distance flown in a given time.

    Args:
        mu: Mean.
        sigma: Standard deviation.

    Raises:
        ValueError: If the mean is not finite, or the deviation not positive and finite.
    """

    mu: float
    sigma: float

    def __post_init__(self) -> None:
        check_parameter("mu", self.mu, positive=False)
        check_parameter("sigma", self.sigma)

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
    """Normal distribution whose draws outside limits are drawn again.

    Args:
        mu: Mean before the truncation.
        sigma: Standard deviation before the truncation.
        low: Lower limit, may be infinite.
        high: Upper limit, may be infinite.

    Raises:
        ValueError: If `Normal` would refuse mean or deviation, the limits are not in order, or less than a millionth of
            all draws lies between them.
    """

    mu: float
    sigma: float
    low: float
    high: float

    def __post_init__(self) -> None:
        check_parameter("mu", self.mu, positive=False)
        check_parameter("sigma", self.sigma)
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
        sigma: Standard deviation of that error; that of its magnitude is 0.603 times as large.

    Raises:
        ValueError: If it is not positive and finite.
    """

    sigma: float

    def __post_init__(self) -> None:
        check_parameter("sigma", self.sigma)

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
