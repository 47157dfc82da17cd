"""What is drawn: distributions, and that a run's draws are its own."""

import math

import numpy as np
import pytest

from ridlink.campaign.chance import ErrorModel, PositionErrors, draw_fleet
from ridlink.separation.reference import CATEGORIES

SIGMA_M = 10.0


def reports(model, count=400, runs=range(3), vehicles=20, interval_s=0.1):
    errors = PositionErrors(model, SIGMA_M, count=vehicles, seed=4, runs=runs, interval_s=interval_s)
    return np.stack([errors.next() for _ in range(count)])


def test_white_errors_have_sigma_on_every_axis_and_no_memory():
    drawn = reports(ErrorModel.WHITE)
    assert drawn.shape == (400, 3, 20, 2)
    assert drawn.std() == pytest.approx(SIGMA_M, rel=0.02)
    assert abs(np.mean(drawn[1:] * drawn[:-1])) < 0.03 * SIGMA_M**2


def test_radial_errors_have_a_half_normal_radius_and_less_on_each_axis():
    drawn = reports(ErrorModel.WHITE_RADIAL)
    assert np.hypot(drawn[..., 0], drawn[..., 1]).mean() == pytest.approx(SIGMA_M * math.sqrt(2.0 / math.pi), rel=0.02)
    assert drawn.std() == pytest.approx(SIGMA_M / math.sqrt(2.0), rel=0.02)


def test_gauss_markov_errors_forget_themselves_within_ten_seconds():
    drawn = reports(ErrorModel.GAUSS_MARKOV, interval_s=1.0)
    assert drawn.std() == pytest.approx(SIGMA_M, rel=0.05)
    for lag in (1, 10):
        correlation = np.mean(drawn[lag:] * drawn[:-lag]) / np.mean(drawn**2)
        assert correlation == pytest.approx(math.exp(-lag / 10.0), abs=0.04)


def test_a_bias_lasts_for_the_whole_flight():
    drawn = reports(ErrorModel.BIAS, count=40, runs=range(100))
    assert np.array_equal(drawn[0], drawn[-1])
    assert drawn[0].std() == pytest.approx(SIGMA_M, rel=0.04)


@pytest.mark.parametrize("model", list(ErrorModel))
def test_a_run_errs_alike_in_any_batch_and_after_others_have_left_it(model):
    together = PositionErrors(model, SIGMA_M, count=5, seed=4, runs=range(3, 9), interval_s=0.1)
    alone = PositionErrors(model, SIGMA_M, count=5, seed=4, runs=range(7, 8), interval_s=0.1)
    for _ in range(70):
        assert np.array_equal(together.next()[4], alone.next()[0])
    together.keep(np.array([False, True, False, False, True, True]))
    for _ in range(70):
        assert np.array_equal(together.next()[1], alone.next()[0])


def test_the_fleet_of_the_paper():
    fleets = [draw_fleet(24, 1, run) for run in range(200)]
    airframe = np.concatenate([fleet.airframe_m for fleet in fleets])
    speed = np.concatenate([fleet.speed_mps for fleet in fleets])
    assert 0.1 <= airframe.min() < 0.2 < 7.4 < airframe.max() <= 7.5
    assert airframe.mean() == pytest.approx(3.8, abs=0.1)
    assert speed.mean() == pytest.approx(30.7, abs=0.2)
    assert speed.std() == pytest.approx(5.1, abs=0.2)
    assert speed.min() >= 10.0 and speed.max() <= 51.5


@pytest.mark.parametrize("category", list(CATEGORIES))
def test_a_fleet_of_a_category_stays_below_its_maximum(category):
    fleet = draw_fleet(300, 1, 2, category)
    assert fleet.speed_mps.max() <= CATEGORIES[category].max_speed_mps
    assert fleet.speed_mps.mean() == pytest.approx(CATEGORIES[category].cruise_speed_mps, rel=0.05)


def test_a_larger_fleet_begins_with_the_smaller_one():
    assert np.array_equal(draw_fleet(24, 1, 3).speed_mps[:8], draw_fleet(8, 1, 3).speed_mps)
    assert not np.array_equal(draw_fleet(8, 1, 3).speed_mps, draw_fleet(8, 1, 4).speed_mps)
    assert not np.array_equal(draw_fleet(8, 2, 3).speed_mps, draw_fleet(8, 1, 3).speed_mps)
