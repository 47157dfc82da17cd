"""The chance constraint: its three forms, the risk shared by neighbours, and what is left of it after a mission."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from ridlink.separation import ChanceBound, Definition, separation_discs
from ridlink.separation.chance import (
    chance_error_sum,
    eta_of_mission,
    independent_draws,
    instant_probability,
    mission_probability,
    pair_risk,
)

SIGMA_M = 10.0
BOUND_M = 3.0 * SIGMA_M


@pytest.mark.parametrize(
    ("eta", "contours", "covariance", "halfplane"),
    [(0.95, 54.2, 34.6, 23.3), (0.99, 65.1, 42.9, 32.9), (0.999, 78.0, 52.6, 43.7)],
)
def test_distance_beyond_the_airframes_of_two_vehicles_with_ten_metres(eta, contours, covariance, halfplane):
    """Beside them the paper's three sigma each, 60 m whatever eta is."""
    printed = {"contours": contours, "covariance": covariance, "halfplane": halfplane}
    for bound, expected in printed.items():
        kept = chance_error_sum(BOUND_M, BOUND_M, eta=eta, bound=ChanceBound(bound))
        assert kept == pytest.approx(expected, abs=0.05)
    relative = SIGMA_M * math.sqrt(2.0)
    assert chance_error_sum(BOUND_M, BOUND_M, eta=eta) == pytest.approx(NormalDist(sigma=relative).inv_cdf(eta))
