"""Distributions: closed forms against each other, against integration, and against seeded draws."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.separation.components import MAC_DISTANCE_M, fleet_speed, unmac_radius_distribution
from ridlink.separation.distributions import (
    Distribution,
    HalfNormal,
    Normal,
    Triangular,
    TruncatedNormal,
)
from ridlink.separation.sums import HalfNormalSum

EVERY: dict[str, Distribution] = {
    "triangular as in the text": MAC_DISTANCE_M["text"],
    "triangular as printed": MAC_DISTANCE_M["printed density"],
    "triangular that only falls": Triangular(1.0, 1.0, 3.0),
    "triangular that only rises": Triangular(-1.0, 3.0, 3.0),
    "normal": Normal(-2.0, 3.0),
    "truncated as the fleet": fleet_speed(),
    "truncated on one side": TruncatedNormal(1.0, 2.0, 2.0, math.inf),
    "half-normal": HalfNormal(4.85),
    "two equal half-normals": HalfNormalSum(3.5, 3.5),
    "two half-normals": HalfNormalSum(1.9, 10.0),
    "two very different half-normals": HalfNormalSum(0.01, 10.0),
    "radius of a uNMAC": unmac_radius_distribution(3.5, 0.1),
}
every = pytest.mark.parametrize("distribution", EVERY.values(), ids=EVERY)


@every
def test_density_integrates_to_one_and_to_the_distribution_function(distribution: Distribution) -> None:
    low, high = distribution.quantile([1e-9, 1.0 - 1e-9])
    x = np.linspace(low, high, 40_001)
    middle, step = (x[1:] + x[:-1]) / 2.0, x[1] - x[0]
    reached = np.cumsum(distribution.pdf(middle)) * step
    assert reached[-1] == pytest.approx(1.0, abs=2e-5)
    assert np.abs(reached - (distribution.cdf(x[1:]) - distribution.cdf(low))).max() < 1e-4


@every
def test_mean_and_deviation_are_those_of_the_density(distribution: Distribution) -> None:
    low, high = distribution.quantile([1e-12, 1.0 - 1e-12])
    x = np.linspace(low, high, 100_001)
    middle, weight = (x[1:] + x[:-1]) / 2.0, (x[1] - x[0]) * distribution.pdf((x[1:] + x[:-1]) / 2.0)
    mean = np.sum(weight * middle)
    assert distribution.mean == pytest.approx(mean, abs=2e-4)
    assert distribution.sd == pytest.approx(math.sqrt(np.sum(weight * (middle - mean) ** 2)), rel=2e-4)


@every
def test_quantile_is_the_inverse(distribution: Distribution) -> None:
    p = np.concatenate(([1e-6, 1e-3], np.linspace(0.05, 0.95, 19), [0.997, 0.999, 1.0 - 1e-6]))
    assert distribution.cdf(distribution.quantile(p)) == pytest.approx(p, abs=1e-6)
    assert np.all(np.diff(distribution.quantile(p)) > 0.0)
    for impossible in (-1e-9, 1.0 + 1e-9, math.nan):
        with pytest.raises(ValueError, match="between 0 and 1"):
            distribution.quantile(impossible)


@every
def test_draws_follow_the_distribution(distribution: Distribution) -> None:
    """Kolmogorov and Smirnov: the largest difference stays below the bound that is exceeded once in a thousand."""
    count = 20_000
    drawn = np.sort(distribution.sample(np.random.default_rng(11), (count // 4, 4)).ravel())
    steps = np.arange(count + 1) / count
    reached = distribution.cdf(drawn)
    assert max(np.max(reached - steps[:-1]), np.max(steps[1:] - reached)) < 1.95 / math.sqrt(count)
    again = distribution.sample(np.random.default_rng(11), (count // 4, 4))
    assert np.array_equal(np.sort(again.ravel()), drawn)


@every
def test_nothing_lies_beyond_the_ends_and_arrays_keep_their_shape(distribution: Distribution) -> None:
    far = np.array([[-1e4, 1e4]])
    assert distribution.cdf(far) == pytest.approx(np.array([[0.0, 1.0]]), abs=1e-12)
    assert distribution.pdf(far) == pytest.approx(np.array([[0.0, 0.0]]), abs=1e-12)
    assert distribution.quantile(np.full((2, 3), 0.5)).shape == (2, 3)
    assert distribution.sample(np.random.default_rng(0), (2, 3)).shape == (2, 3)
    assert np.ndim(distribution.sample(np.random.default_rng(0))) == 0


@given(st.floats(-5.0, 5.0), st.floats(0.1, 10.0), st.floats(0.0, 1.0))
def test_a_wide_truncation_is_none(mu: float, sigma: float, p: float) -> None:
    wide, plain = TruncatedNormal(mu, sigma, mu - 40.0 * sigma, mu + 40.0 * sigma), NormalDist(mu, sigma)
    assert wide.mean == pytest.approx(mu, abs=1e-9) and wide.sd == pytest.approx(sigma)
    if 1e-9 < p < 1.0 - 1e-9:
        assert wide.quantile(p) == pytest.approx(plain.inv_cdf(p), abs=1e-6)
    assert wide.low <= wide.quantile(p) <= wide.high


@pytest.mark.parametrize("mode", [0.0, 0.3, 1.0])
def test_a_triangular_density_is_highest_at_its_mode(mode: float) -> None:
    assert Triangular(0.0, mode, 1.0).pdf([mode, -1e-9, 1.0 + 1e-9]).tolist() == [2.0, 0.0, 0.0]


@pytest.mark.parametrize(
    "meaningless",
    [
        lambda: Triangular(1.0, 0.5, 2.0),
        lambda: Triangular(2.0, 2.0, 2.0),
        lambda: Triangular(0.0, math.nan, 1.0),
        lambda: Normal(0.0, 0.0),
        lambda: Normal(math.nan, 1.0),
        lambda: HalfNormal(-1.0),
        lambda: TruncatedNormal(0.0, 1.0, 2.0, 1.0),
        lambda: TruncatedNormal(0.0, 1.0, 30.0, 31.0),
    ],
)
def test_a_meaningless_distribution_is_refused(meaningless) -> None:
    with pytest.raises(ValueError):
        meaningless()
