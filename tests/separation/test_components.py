"""The paper's figures: Tables II and III, Eq. 4, and what follows from its distributions, to the printed digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ridlink.campaign.chance import draw_fleet
from ridlink.separation.components import (
    EXACT,
    MAC_DISTANCE_M,
    PRINTED,
    TEXT,
    cruise_speed,
    displacement,
    displacement_line,
    fleet_speed,
    localization_error,
    unmac_radius_distribution,
)
from ridlink.separation.reference import (
    CATEGORIES,
    GPS_SIGMA_M,
    GPS_STANDARDS,
    MAX_AIRFRAME_M,
    MIN_AIRFRAME_M,
)
from ridlink.technologies import TECHNOLOGIES


def test_tables_ii_and_iii() -> None:
    assert [3.0 * sigma for sigma in GPS_SIGMA_M] == pytest.approx([5.7, 10.5, 14.55, 30.0])
    assert len(GPS_STANDARDS) == len(GPS_SIGMA_M)
    assert GPS_SIGMA_M[2] != pytest.approx(13.85 / 3.0, abs=0.1), "printed 13.85 m is not three of the printed 4.85 m"
    assert [c.max_takeoff_mass_kg for c in CATEGORIES.values()] == [1.8, 9.0, 9.0, 25.0]
    assert [c.cruise_speed_mps for c in CATEGORIES.values()] == [12.9, 10.3, 15.4, 30.7]
    assert [c.max_speed_mps for c in CATEGORIES.values()] == [20.6, 15.4, 30.7, 51.5]
    assert [c.speed_sigma_mps for c in CATEGORIES.values()] == pytest.approx([2.5667, 1.7, 5.1, 6.9333], abs=1e-4)


@pytest.mark.parametrize(
    ("reading", "mean", "deviation", "quantile"),
    [(TEXT, 3.7667, 1.5107, 7.2096), (PRINTED, 3.75, 1.5309, 7.2095), (EXACT, 3.8, 1.5105, 7.2134)],
)
def test_mac_distance(reading: str, mean: float, deviation: float, quantile: float) -> None:
    distribution = MAC_DISTANCE_M[reading]
    assert distribution.mean == pytest.approx(mean, abs=5e-5)
    assert distribution.sd == pytest.approx(deviation, abs=5e-5)
    assert distribution.quantile(0.997) == pytest.approx(quantile, abs=5e-5)


def test_half_the_sum_of_two_uniform_airframes_is_the_exact_triangle() -> None:
    drawn = np.random.default_rng(3).uniform(MIN_AIRFRAME_M, MAX_AIRFRAME_M, (200_000, 2)).sum(axis=1) / 2.0
    steps = np.arange(1, len(drawn) + 1) / len(drawn)
    distance = {name: np.abs(known.cdf(np.sort(drawn)) - steps).max() for name, known in MAC_DISTANCE_M.items()}
    assert distance[EXACT] < 1.63 / math.sqrt(len(drawn)), "one per cent of Kolmogorov and Smirnov"
    assert distance[EXACT] < min(distance[TEXT], distance[PRINTED])


@pytest.mark.parametrize(
    ("sigma", "mean", "printed_mean", "quantile", "printed_quantile"),
    [
        (1.9, 3.032, 3.0, 9.353, 9.34),
        (3.5, 5.585, 5.6, 17.229, 17.3),
        (4.85, 7.740, None, 23.874, 23.94),  # 7.4 m is printed, and does not follow from the equation
        (10.0, 15.958, 16.0, 49.224, 49.5),
    ],
)
def test_localization_error_of_two_equal_receivers(sigma, mean, printed_mean, quantile, printed_quantile) -> None:
    distribution = localization_error(sigma)
    assert distribution.mean == pytest.approx(mean, abs=6e-4)
    assert distribution.quantile(0.999) == pytest.approx(quantile, abs=6e-4)
    assert printed_quantile == pytest.approx(float(distribution.quantile(0.999)), rel=0.006)
    if printed_mean is not None:
        assert printed_mean == pytest.approx(distribution.mean, abs=0.05)


@pytest.mark.parametrize(
    ("sigma_i", "sigma_j", "mean", "quantile"), [(1.9, 10.0, 9.495, 34.66), (3.5, 4.85, 6.662, 20.81)]
)
def test_localization_error_of_two_different_receivers(sigma_i, sigma_j, mean, quantile) -> None:
    distribution = localization_error(sigma_i, sigma_j)
    assert distribution.mean == pytest.approx(mean, abs=6e-4)
    assert distribution.quantile(0.999) == pytest.approx(quantile, abs=6e-3)


@pytest.mark.parametrize(("number", "line"), [(1, 35.774), (2, 27.206), (3, 50.618), (4, 88.343)])
def test_mobility_lines(number: int, line: float) -> None:
    category = CATEGORIES[number]
    assert displacement_line(category, 1.0) == pytest.approx(line, abs=6e-4)
    assert displacement_line(category, 0.1) == pytest.approx(displacement_line(category, 1.0) / 10.0)
    by_hand = 2 * category.cruise_speed_mps + 2.7478 * math.sqrt(2) * category.speed_sigma_mps
    assert displacement_line(category, 1.0) == pytest.approx(by_hand, abs=1e-3)


def test_two_categories_fly_apart_with_both_variances() -> None:
    mixed = displacement(CATEGORIES[1], 2.0, CATEGORIES[4])
    assert mixed.mean == pytest.approx(2.0 * (12.9 + 30.7))
    assert mixed.sd == pytest.approx(2.0 * math.hypot(CATEGORIES[1].speed_sigma_mps, CATEGORIES[4].speed_sigma_mps))
    assert cruise_speed(CATEGORIES[3]).quantile(0.5) == pytest.approx(15.4)


@pytest.mark.parametrize(
    ("sigma", "mean", "q997", "q999"),
    [(10.0, 22.8, 52.1, 56.4), (4.85, 14.6, 29.3, 31.4), (3.5, 12.5, 23.5, 25.1), (1.9, 9.9, 16.8, 17.8)],
)
def test_unmac_radius_of_category_3(sigma: float, mean: float, q997: float, q999: float) -> None:
    distribution = unmac_radius_distribution(sigma, 0.1)
    assert distribution.mean == pytest.approx(mean, abs=0.05)
    assert distribution.quantile([0.997, 0.999]) == pytest.approx([q997, q999], abs=0.08)
    drawn = distribution.sample(np.random.default_rng(7), 100_000)
    assert drawn.mean() == pytest.approx(distribution.mean, abs=4.0 * distribution.sd / math.sqrt(len(drawn)))
    exceeded = int(np.sum(drawn > distribution.quantile(0.997)))
    assert abs(exceeded - 300) < 4.0 * math.sqrt(300)


def test_the_fleet_of_a_campaign_is_drawn_from_these() -> None:
    """Kolmogorov and Smirnov at one in a thousand, for airframes and for the truncated speeds."""
    fleet = draw_fleet(2000, 5, 0)
    bound = 1.95 / math.sqrt(2000)
    steps = np.arange(1, 2001) / 2000
    assert np.abs(fleet_speed().cdf(np.sort(fleet.speed_mps)) - steps).max() < bound
    uniform = (np.sort(fleet.airframe_m) - MIN_AIRFRAME_M) / (MAX_AIRFRAME_M - MIN_AIRFRAME_M)
    assert np.abs(uniform - steps).max() < bound
    assert (fleet_speed().low, fleet_speed().high) == (10.0, 51.5)


def test_lora_interval_is_its_duty_cycle() -> None:
    """Semtech's airtime: 8 + 4.25 symbols of preamble, 25 bytes at SF7, 125 kHz, coding rate 4/5, with a header."""
    symbol_s = 2**7 / 125e3
    payload = 8 + math.ceil((8 * 25 - 4 * 7 + 28 + 16) / (4 * 7)) * 5
    assert TECHNOLOGIES["lora"].period_s == pytest.approx(100.0 * (12.25 + payload) * symbol_s, abs=0.05)
