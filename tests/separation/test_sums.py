"""Sums: closed forms against integrals over the plane, and the table against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.separation.distributions import Distribution, HalfNormal, Normal, Triangular
from ridlink.separation.sums import HalfNormalSum, Sum

sigmas = st.floats(0.1, 100.0)


@settings(max_examples=40)
@given(sigmas, sigmas, st.floats(0.01, 0.9999))
def test_sum_of_half_normals_is_what_a_line_cuts_off_a_plane(sigma_i: float, sigma_j: float, p: float) -> None:
    """Both errors, each over its sigma, are a point with the density of a disc: what lies beyond the line of a constant
    sum, `x / hypot(sigmas)` from the centre, is an integral over the angle from its normal to either axis."""
    both = HalfNormalSum(sigma_i, sigma_j)
    x = float(both.quantile(p))
    distance, normal = x / math.hypot(sigma_i, sigma_j), math.atan2(sigma_j, sigma_i)
    edges = np.linspace(-normal, math.pi / 2.0 - normal, 20_001)
    angle = (edges[1:] + edges[:-1]) / 2.0
    beyond = np.mean(np.exp(-((distance / np.cos(angle)) ** 2) / 2.0))
    assert both.cdf(x) == pytest.approx(p, abs=1e-9)
    assert both.cdf(x) == pytest.approx(1.0 - beyond, abs=1e-6)


@given(sigmas, st.floats(0.0, 0.999999))
def test_equal_sigmas_have_the_closed_form(sigma: float, p: float) -> None:
    """CDF `erf(x / 2 sigma)^2`, which the general integral must meet, and its inverse."""
    nearly = HalfNormalSum(sigma, sigma * (1.0 + 1e-12))
    x = HalfNormalSum(sigma, sigma).quantile(p)
    assert math.erf(float(x) / (2.0 * sigma)) ** 2 == pytest.approx(p, abs=1e-12)
    assert nearly.cdf(x) == pytest.approx(p, abs=1e-9)
    assert HalfNormalSum(sigma, sigma).mean == pytest.approx(1.59577 * sigma, rel=1e-5)


@given(sigmas, sigmas, st.floats(0.0, 500.0))
def test_sum_of_half_normals_does_not_care_about_order(sigma_i: float, sigma_j: float, x: float) -> None:
    one, other = HalfNormalSum(sigma_i, sigma_j), HalfNormalSum(sigma_j, sigma_i)
    assert one.cdf(x) == pytest.approx(other.cdf(x), abs=1e-12)
    assert one.pdf(x) == pytest.approx(other.pdf(x), rel=1e-9, abs=1e-300)
    assert 0.0 <= one.cdf(x) <= 1.0


def test_a_sum_of_normals_is_normal() -> None:
    table, closed = Sum((Normal(1.0, 3.0), Normal(-2.0, 4.0))), Normal(-1.0, 5.0)
    assert (table.mean, table.sd) == (closed.mean, closed.sd)
    p = np.array([0.001, 0.1, 0.5, 0.9, 0.997, 0.999])
    assert table.quantile(p) == pytest.approx(closed.quantile(p), abs=1e-3)
    assert table.pdf([-1.0, 4.0]) == pytest.approx(closed.pdf([-1.0, 4.0]), rel=1e-4)


@pytest.mark.parametrize(
    ("parts", "closed"),
    [
        ((HalfNormal(2.0),), HalfNormal(2.0)),
        ((HalfNormal(2.0), HalfNormal(2.0)), HalfNormalSum(2.0, 2.0)),
        ((HalfNormal(2.0), HalfNormal(0.2)), HalfNormalSum(2.0, 0.2)),
        ((Triangular(0.0, 0.0, 1.0),), Triangular(0.0, 0.0, 1.0)),
    ],
    ids=["a jump", "two jumps", "a narrow one", "a falling one"],
)
def test_a_sum_is_its_closed_form_where_there_is_one(parts: tuple[Distribution, ...], closed: Distribution) -> None:
    p = np.array([1e-4, 1e-3, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999])
    assert closed.cdf(Sum(parts).quantile(p)) == pytest.approx(p, abs=6e-6)
    assert Sum(parts).cdf(closed.quantile(p)) == pytest.approx(p, abs=6e-6)


@pytest.mark.parametrize(
    "meaningless", [lambda: HalfNormalSum(1.0, 0.0), lambda: HalfNormalSum(math.inf, 1.0), lambda: Sum(())]
)
def test_a_meaningless_sum_is_refused(meaningless) -> None:
    with pytest.raises(ValueError):
        meaningless()
