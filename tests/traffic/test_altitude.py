"""The vertical bound: infinite when anything is unknown, monotone in what it is made of, the same from either end."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.traffic.altitude import RESERVE_M, UNHEARD_CLIMB_MPS, known_apart, vertical_bound

lengths = st.floats(0.0, 200.0)
climbs = st.floats(-10.0, 10.0)
heights = st.floats(-1000.0, 1000.0)
FIGURES = ("above", "own_error", "error", "own_height", "height", "own_climb", "climb")


def bound(
    above: float, own_error: float, error: float, own_height: float, height: float, own_climb: float, climb: float,
    age: float = 0.0,
) -> float:  # fmt: skip
    return float(
        vertical_bound(
            above, error_m=(own_error, error), height_m=(own_height, height), climb_mps=(own_climb, climb), age_s=age,
            horizon_s=8.0,
        )
    )  # fmt: skip


encounters = st.tuples(heights, lengths, lengths, lengths, lengths, climbs, climbs)


@pytest.mark.parametrize(
    ("figures", "expected"),
    [
        ((100.0, 5.0, 6.0, 0.4, 0.6, 0.0, 0.0), 11.0 + 0.5 + RESERVE_M),
        ((100.0, 5.0, 6.0, 0.4, 0.6, 2.0, 0.0), 11.5 + 16.0 + RESERVE_M),  # we climb towards it
        ((100.0, 5.0, 6.0, 0.4, 0.6, 2.0, -1.0), 11.5 + 24.0 + RESERVE_M),
        ((100.0, 5.0, 6.0, 0.4, 0.6, -2.0, 1.0), 11.5 + RESERVE_M),  # both move away: no credit for what is to come
        ((-100.0, 5.0, 6.0, 0.4, 0.6, -2.0, 1.0), 11.5 + 24.0 + RESERVE_M),
        ((100.0, 5.0, 6.0, 0.4, 0.6, 2.0, 2.0), 11.5 + RESERVE_M),  # in formation
    ],
)
def test_what_the_bound_is_made_of(figures: tuple[float, ...], expected: float) -> None:
    assert bound(*figures) == pytest.approx(expected)


def test_who_is_not_heard_may_have_begun_to_climb() -> None:
    figures = (100.0, 5.0, 6.0, 0.4, 0.6, 0.0, 0.0)
    assert bound(*figures, age=4.0) - bound(*figures) == pytest.approx(4.0 * UNHEARD_CLIMB_MPS) == 8.0


def test_without_a_horizon_the_bound_is_that_of_this_instant() -> None:
    now = vertical_bound(100.0, error_m=(5.0, 6.0), height_m=(0.4, 0.6), climb_mps=(2.0, -1.0))
    assert now == pytest.approx(11.5 + RESERVE_M)


@given(figures=encounters, which=st.sampled_from(range(7)), unknown=st.sampled_from((math.nan, math.inf, -math.inf)))
def test_the_gate_never_opens_when_any_quantity_is_unknown(
    figures: tuple[float, ...], which: int, unknown: float
) -> None:
    spoilt = list(figures)
    spoilt[which] = math.nan if which == 0 else unknown
    assert bound(*spoilt) == math.inf
    assert not known_apart(spoilt[0], bound(*spoilt)), FIGURES[which]


@given(figures=encounters, which=st.sampled_from((1, 2, 3, 4)))
def test_a_length_below_zero_is_no_length(figures: tuple[float, ...], which: int) -> None:
    spoilt = list(figures)
    spoilt[which] = -1.0
    assert bound(*spoilt) == math.inf


@given(figures=encounters, which=st.sampled_from((1, 2, 3, 4)), more=st.floats(0.0, 100.0))
def test_the_bound_grows_with_every_error_and_every_size(figures: tuple[float, ...], which: int, more: float) -> None:
    larger = list(figures)
    larger[which] += more
    assert bound(*larger) >= bound(*figures)


@given(figures=encounters, faster=st.floats(0.0, 10.0))
def test_the_bound_grows_with_a_faster_approach(figures: tuple[float, ...], faster: float) -> None:
    above, *rest, climb = figures
    assert bound(above, *rest, climb - math.copysign(faster, above)) >= bound(*figures) - 1e-9


@given(figures=encounters)
def test_both_ends_see_the_same_bound(figures: tuple[float, ...]) -> None:
    above, own_error, error, own_height, height, own_climb, climb = figures
    swapped = (-above, error, own_error, height, own_height, climb, own_climb)
    assert bound(*swapped) == pytest.approx(bound(*figures))


@given(figures=encounters)
def test_whoever_is_apart_stays_out_of_the_errors_for_the_whole_horizon(figures: tuple[float, ...]) -> None:
    above, own_error, error, own_height, height, own_climb, climb = figures
    if not known_apart(above, bound(*figures)):
        return
    for time_s in np.linspace(0.0, 8.0, 5):
        assert abs(above + (climb - own_climb) * time_s) > own_error + error + (own_height + height) / 2.0
