"""Units of the wire and SI: exact both ways, and never an understated uncertainty."""

from __future__ import annotations

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ridlink import units

unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine is no failure."""


@unhurried
@given(st.integers(-(2**31), 2**31 - 1))
def test_degrees_come_back_exactly(value: int) -> None:
    assert units.dege7_from_deg(units.deg_from_dege7(value)) == value


@unhurried
@given(st.integers(-(2**31), 2**31 - 1))
def test_millimetres_come_back_exactly(value: int) -> None:
    assert units.mm_from_m(units.m_from_mm(value)) == value


@unhurried
@given(st.integers(-(2**15), 2**16 - 1))
def test_centimetres_a_second_come_back_exactly(value: int) -> None:
    assert units.cmps_from_mps(units.mps_from_cmps(value)) == value


@pytest.mark.parametrize(
    ("got", "expected"),
    [
        (units.deg_from_dege7(508_703_210), 50.870321),
        (units.dege7_from_deg(-151.20929), -1_512_092_900),
        (units.m_from_mm(-1500), -1.5),
        (units.mm_from_m(0.0004), 0),
        (units.mps_from_cmps(1025), 10.25),
        (units.cmps_from_mps(-0.006), -1),
        (units.m_from_cm(60), 0.6),
    ],
)
def test_golden_values(got: float, expected: float) -> None:
    assert got == expected


@unhurried
@given(st.floats(0.0, 1e6), st.sampled_from([0.001, 0.01, 0.02, 0.1, 0.5, 1.0]))
def test_rounding_up_never_understates_by_more_than_noise(value: float, unit: float) -> None:
    count = units.ceil_units(value, unit)
    assert count * unit >= value - 1.1e-6 * unit - 1e-12 * value
    assert (count - 1) * unit < value or count == 0


@unhurried
@given(st.integers(0, 65535), st.sampled_from([0.001, 0.01, 0.02, 0.1, 0.5]))
def test_whole_units_are_not_rounded_up(count: int, unit: float) -> None:
    assert units.ceil_units(count * unit, unit) == count


@pytest.mark.parametrize(
    ("value", "unit", "count"), [(3 * 0.1, 0.01, 30), (0.301, 0.01, 31), (0.0, 0.01, 0), (1e-3, 0.01, 1)]
)
def test_rounding_up_golden(value: float, unit: float, count: int) -> None:
    assert units.ceil_units(value, unit) == count


@unhurried
@given(st.floats(-1e6, 1e6))
def test_wrapped_angle_is_the_same_angle(value: float) -> None:
    wrapped = units.wrap_deg(value)
    assert -180.0 <= wrapped < 180.0
    turns = (value - wrapped) / 360.0
    assert math.isclose(turns, round(turns), abs_tol=1e-9)


@pytest.mark.parametrize(
    ("value", "wrapped"), [(0.0, 0.0), (180.0, -180.0), (-180.0, -180.0), (359.0, -1.0), (-541.0, 179.0)]
)
def test_wrap_golden(value: float, wrapped: float) -> None:
    assert units.wrap_deg(value) == wrapped
