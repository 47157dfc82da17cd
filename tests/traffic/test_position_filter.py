"""The position filter: it follows, it smooths, and it lets go when a report is no noise."""

from __future__ import annotations

import numpy as np
import pytest

from ridlink.geodesy import moved, offset_m
from ridlink.traffic.position_filter import PositionFilter

HERE = (47.3977, 8.5456)
STILL = (0.0, 0.0, 0.0)


def test_white_noise_becomes_less_and_the_velocity_is_followed_without_lag() -> None:
    random = np.random.default_rng(1)
    smoother = PositionFilter()
    errors = []
    for tick in range(600):
        truth = moved(*HERE, 1.0 * tick, 0.5 * tick)
        noise = random.normal(0.0, 3.5, 2)
        got = smoother.update(*moved(*truth, *noise), (10.0, 5.0, 0.0), 10.5, tick * 0.1)
        errors.append(offset_m(truth, got))
    settled = np.array(errors[100:])
    assert np.all(settled.std(axis=0) < 1.2)  # of 3.5
    assert np.all(np.abs(settled.mean(axis=0)) < 0.5)


def test_one_outlier_within_twice_the_bound_does_not_restart_and_two_do() -> None:
    smoother = PositionFilter()
    for tick in range(50):
        smoother.update(*HERE, STILL, 10.0, tick * 0.1)
    out = moved(*HERE, 12.0, 0.0)
    smoother.update(*out, STILL, 10.0, 5.0)
    assert smoother.resets == 0
    assert smoother.update(*out, STILL, 10.0, 5.1) == out
    assert smoother.resets == 1


def test_a_jump_restarts_at_once() -> None:
    smoother = PositionFilter()
    smoother.update(*HERE, STILL, 10.0, 0.0)
    far = moved(*HERE, 0.0, 21.0)
    assert smoother.update(*far, STILL, 10.0, 0.1) == far
    assert smoother.resets == 1


@pytest.mark.parametrize("constant", [0.0, 2.0])
def test_without_a_velocity_or_a_time_constant_reports_pass_as_they_are(constant: float) -> None:
    smoother = PositionFilter(constant)
    smoother.update(*HERE, STILL, 10.0, 0.0)
    there = moved(*HERE, 1.0, 1.0)
    velocity = None if constant else STILL
    assert smoother.update(*there, velocity, 10.0, 0.1) == there
    assert smoother.extrapolate(1.0, (2.0, 0.0, 0.0)) == pytest.approx(moved(*there, 2.0, 0.0))


def test_a_velocity_that_was_unknown_was_not_zero() -> None:
    smoother, fast = PositionFilter(), (20.0, 0.0, 0.0)
    for second, velocity in enumerate([fast, fast, fast, None, fast, fast]):
        there = moved(*HERE, 20.0 * second, 0.0)
        assert smoother.update(*there, velocity, 3.0, float(second)) == pytest.approx(there, abs=1e-9)
    assert smoother.resets == 0
    smoother.update(*there, None, 3.0, 6.0)
    smoother.update(*moved(*there, 40.0, 0.0), fast, 3.0, 7.0)  # 20 m further than it flies
    assert smoother.resets == 1


def test_time_that_goes_back_restarts() -> None:
    smoother = PositionFilter()
    smoother.update(*HERE, STILL, 10.0, 5.0)
    there = moved(*HERE, 1.0, 0.0)
    assert smoother.update(*there, STILL, 10.0, 4.0) == there
