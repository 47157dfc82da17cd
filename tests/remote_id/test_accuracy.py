"""Accuracy codes: inverted, strictly bounded, and never better than the truth."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.remote_id import accuracy

# (value, code) as opendroneid-core-c 2.0 encodes them
CORE_C_HORIZONTAL = [
    (-1, 0), (0.5, 12), (0.999, 12), (2.999, 11), (3, 10), (9.99, 10), (29.9, 9), (30, 8), (92.5, 8), (92.6, 7),
    (185.2, 6), (555.5, 6), (555.7, 5), (925.9, 5), (926, 4), (1852, 3), (3704, 2), (7407, 2), (7408, 1), (18519, 1),
]  # fmt: skip
CORE_C_VERTICAL = [(-1, 0), (2.9, 5), (3, 4), (10, 3), (24.9, 3), (25, 2), (44.9, 2)]
CORE_C_SPEED = [(-1, 0), (0.29, 4), (0.3, 3), (0.99, 3), (1, 2), (2.9, 2), (3, 1)]
CORE_C_TIME = [(0.05, 1), (0.2, 2), (0.5, 5), (1.01, 11), (1.5, 15), (1.51, 0)]


@pytest.mark.parametrize(("value", "code"), CORE_C_HORIZONTAL)
def test_horizontal_code_is_what_core_c_encodes(value: float, code: int) -> None:
    assert accuracy.horizontal_code(value) == code


@pytest.mark.parametrize(("value", "code"), CORE_C_VERTICAL)
def test_vertical_code_is_what_core_c_encodes(value: float, code: int) -> None:
    assert accuracy.vertical_code(value) == code


@pytest.mark.parametrize(("value", "code"), CORE_C_SPEED)
def test_speed_code_is_what_core_c_encodes(value: float, code: int) -> None:
    assert accuracy.speed_code(value) == code


@pytest.mark.parametrize(("value", "code"), CORE_C_TIME)
def test_time_code_is_what_core_c_encodes(value: float, code: int) -> None:
    assert accuracy.time_code(value) == code


@pytest.mark.parametrize("encode", [accuracy.horizontal_code, accuracy.vertical_code, accuracy.speed_code])
def test_an_exact_value_takes_the_best_code_and_a_hopeless_one_is_unknown(encode: object) -> None:
    assert callable(encode)
    assert encode(0.0) == encode(1e-9) > 0
    assert encode(18520.0) == encode(math.inf) == encode(math.nan) == encode(None) == 0


def test_time_code_of_unknown_is_unknown() -> None:
    assert accuracy.time_code(None) == accuracy.time_code(math.nan) == accuracy.time_code(-0.1) == 0
    assert accuracy.time_code(0.0) == 1


@pytest.mark.parametrize("code", [0, 13, 15, 255])
def test_unknown_and_reserved_codes_have_no_bound(code: int) -> None:
    assert accuracy.horizontal_bound_m(code) is None
    assert accuracy.three_sigma_bound_m(code) is None
    assert accuracy.vertical_bound_m(code) is None
    assert accuracy.speed_bound_mps(code) is None


def test_time_bounds_end_at_fifteen_steps() -> None:
    assert accuracy.time_bound_s(0) is None
    assert accuracy.time_bound_s(1) == 0.1
    assert accuracy.time_bound_s(15) == 1.5
    assert accuracy.time_bound_s(16) is None


def test_core_c_prints_7808_for_code_2_but_four_nautical_miles_are_7408_m() -> None:
    assert accuracy.horizontal_bound_m(2) == 4 * 1852.0


@given(st.floats(min_value=0.0, max_value=30000.0))
def test_a_code_never_promises_more_than_the_truth(value_m: float) -> None:
    bound = accuracy.horizontal_bound_m(accuracy.horizontal_code(value_m))
    assert bound is None or value_m < bound


@given(st.floats(0.0, 20000.0), st.sampled_from(list(accuracy.AccuracyConvention)))
def test_three_sigma_survives_the_code_under_the_same_convention(
    error_m: float, convention: accuracy.AccuracyConvention
) -> None:
    bound = accuracy.three_sigma_bound_m(accuracy.code_of_three_sigma(error_m, convention), convention)
    assert bound is None or bound >= error_m


def test_conventions_read_the_same_code_differently() -> None:
    # 95 % of a 2-D normal lies within sqrt(-2 ln 0.05) = 2.4477 standard deviations
    factor = accuracy.THREE_SIGMA_PER_95_PERCENT_RADIUS
    assert factor == pytest.approx(1.2256, abs=1e-4)
    assert accuracy.three_sigma_bound_m(10) == pytest.approx(12.256, abs=1e-3)
    assert accuracy.three_sigma_bound_m(10, "one-sigma") == 30.0
    assert accuracy.three_sigma_bound_m(10, "as-is") == 10.0
    with pytest.raises(ValueError, match="guess"):
        accuracy.three_sigma_bound_m(10, "guess")


def test_by_default_a_thirty_metre_code_is_better_than_none() -> None:
    bound = accuracy.three_sigma_bound_m(9)
    assert bound is not None and bound < 40.0


@pytest.mark.parametrize(
    ("convention", "bound_m"),
    [("letter", 10.0 * accuracy.THREE_SIGMA_PER_95_PERCENT_RADIUS), ("one-sigma", 30.0), ("as-is", 10.0)],
)
def test_what_is_left_of_an_error_in_its_code_is_what_the_code_is_taken_for(convention: str, bound_m: float) -> None:
    """Three sigma of 10.5 m are 8.6 m by the letter: the code of less than 10 m."""
    assert accuracy.coded_bound_m(10.5, convention) == pytest.approx(bound_m)


def test_of_an_error_without_a_code_nothing_is_left() -> None:
    assert math.isnan(accuracy.coded_bound_m(30_000.0))
