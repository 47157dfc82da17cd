"""Discs of the separation definitions: Table IV, unknown values, clamps, monotony."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.separation import ChanceBound, Definition, Reported, mac_radius, separation_discs
from ridlink.separation.definitions import bounded_airframe, bounded_error, bounded_interval, bounded_speed

OWN = Reported(airframe_m=1.0, error_bound_m=10.5, accuracy_bound_m=12.0, speed_mps=10.0)
OTHER = Reported(
    airframe_m=np.array([2.0]),
    error_bound_m=np.array([5.7]),
    accuracy_bound_m=np.array([30.0]),
    speed_mps=np.array([5.0]),
)
UNKNOWN = Reported()
EXACT = (OWN, OTHER)
VALUES = [(side, name) for side in (0, 1) for name in Reported.__slots__]


def with_value(value, side, name):
    """The exact pair, but for one value of own-ship (0) or of the other (1)."""
    pair = list(EXACT)
    pair[side] = replace(pair[side], **{name: value})
    return pair


anything = st.floats(allow_nan=True, allow_infinity=True)
definitions = st.sampled_from(list(Definition))


@pytest.mark.parametrize(
    ("definition", "radius", "error"),
    [
        ("snmac", 15.0, 0.0),
        ("remote-id", 7.5 + 80.0 + 1.5, 80.0),
        ("odid-accuracy", 7.5 + 42.0 + 1.5, 42.0),
        ("candidate1", 7.5 + 16.2 + 1.5, 16.2),
        ("candidate2", 1.5 + 16.2 + 1.5, 16.2),
        ("chance", 1.5 + 12.306731 + 1.5, 12.306731),  # 3.0902 standard deviations, of hypot(3.5, 1.9) m
    ],
)
def test_radius_of_each_definition(definition, radius, error):
    discs = separation_discs(Definition(definition), *EXACT)
    assert discs.radius_m == pytest.approx([radius])
    assert discs.error_sum_m == pytest.approx([error])
    assert discs.airframe_m + discs.error_sum_m + discs.displacement_m == pytest.approx(discs.radius_m)


def test_without_any_report_every_definition_that_adds_bounds_is_remote_id():
    expected = separation_discs(Definition.REMOTE_ID, UNKNOWN, UNKNOWN).radius_m
    assert expected == pytest.approx(7.5 + 80.0 + 0.1 * 2 * 30.7)
    for definition in set(Definition) - {Definition.SNMAC, Definition.CHANCE}:
        assert separation_discs(definition, UNKNOWN, UNKNOWN).radius_m == pytest.approx(expected)


def test_without_any_report_chance_takes_the_standards_bounds_in_quadrature():
    radius = separation_discs(Definition.CHANCE, UNKNOWN, UNKNOWN, eta=0.999).radius_m
    assert radius == pytest.approx(7.5 + 3.0902 * math.hypot(40.0, 40.0) / 3.0 + 0.1 * 2 * 30.7, abs=1e-3)


def test_an_airframe_beyond_the_assumed_maximum_counts_in_full_under_every_definition():
    giants = replace(OWN, airframe_m=30.0), replace(OTHER, airframe_m=np.array([40.0]))
    for definition in Definition:
        discs = separation_discs(definition, *giants)
        assert discs.airframe_m == pytest.approx([30.0]), "clamped to 30 m each"
        assert discs.error_sum_m == pytest.approx(separation_discs(definition, *EXACT).error_sum_m)


def test_definitions_are_ordered_as_in_the_paper():
    radius = {definition: separation_discs(definition, *EXACT).radius_m[0] for definition in Definition}
    assert radius[Definition.SNMAC] < radius[Definition.CANDIDATE2] < radius[Definition.CANDIDATE1]
    assert radius[Definition.CANDIDATE1] < radius[Definition.REMOTE_ID]
    assert radius[Definition.CHANCE] < radius[Definition.CANDIDATE2]


@pytest.mark.parametrize(
    ("bounded", "given_value", "expected"),
    [
        (bounded_airframe, math.nan, 7.5),
        (bounded_airframe, 0.0, 7.5),
        (bounded_airframe, -3.0, 7.5),
        (bounded_airframe, 0.05, 0.1),
        (bounded_airframe, 655.35, 30.0),
        (bounded_airframe, math.inf, 30.0),
        (bounded_error, math.nan, 40.0),
        (bounded_error, -1.0, 40.0),
        (bounded_error, 0.0, 0.0),
        (bounded_error, 18520.0, 185.0),
        (bounded_error, math.inf, 185.0),
        (bounded_speed, math.nan, 30.7),
        (bounded_speed, -1.0, 30.7),
        (bounded_speed, math.inf, 254.25),
        (bounded_interval, 0.02, 0.1),
        (bounded_interval, 7.0, 1.0),
    ],
)
def test_reports_are_clamped(bounded, given_value, expected):
    assert bounded(given_value) == expected


@pytest.mark.parametrize("definition", list(Definition))
def test_one_vehicle_against_many_and_many_against_many(definition):
    one = separation_discs(definition, OWN, replace(OTHER, airframe_m=np.array([1.0, 2.0, np.nan])))
    assert one.radius_m.shape == one.error_sum_m.shape == (3,)
    many = separation_discs(
        definition, replace(OWN, airframe_m=np.ones((4, 5, 1))), replace(OTHER, airframe_m=np.ones((4, 1, 5)))
    )
    assert many.radius_m.shape == many.error_sum_m.shape == (4, 5, 5)


def test_the_interval_is_measured_per_track():
    discs = separation_discs(
        Definition.CANDIDATE2, *with_value(np.array([5.0, 5.0]), 1, "speed_mps"), interval_s=np.array([0.1, 1.0])
    )
    assert np.diff(discs.radius_m) == pytest.approx([0.9 * 15.0])
    for wrong in (math.nan, -0.5, math.inf):
        with pytest.raises(ValueError, match=f"interval_s must be .* got {wrong:g}"):
            separation_discs(Definition.CANDIDATE2, *EXACT, interval_s=np.array([0.1, wrong]))


@given(definitions, st.lists(anything, min_size=8, max_size=8))
def test_the_disc_is_finite_and_never_below_the_mac_radius(definition, values):
    own, other = Reported(*values[:4]), Reported(*values[4:])
    discs = separation_discs(definition, own, other)
    airframes = [float(bounded_airframe(own.airframe_m)), float(bounded_airframe(other.airframe_m))]
    assert np.all(np.isfinite(discs.radius_m)) and np.all(np.isfinite(discs.error_sum_m))
    assert discs.radius_m >= mac_radius(airframes)
    assert 0.0 <= discs.error_sum_m <= discs.radius_m + 1e-9 or definition is Definition.SNMAC


@given(
    definitions,
    st.sampled_from(VALUES),
    st.floats(0.1, 40.0),
    st.floats(0.0, 40.0),
)
def test_the_disc_grows_with_every_reported_value(definition, which, value, more):
    small = separation_discs(definition, *with_value(value, *which))
    large = separation_discs(definition, *with_value(value + more, *which))
    assert large.radius_m >= small.radius_m
    assert large.error_sum_m >= small.error_sum_m


@given(
    st.floats(0.01, 0.99), st.floats(0.0, 0.009), st.integers(0, 200), st.integers(0, 200), st.sampled_from(ChanceBound)
)
def test_the_disc_of_chance_grows_with_eta_and_with_the_number_of_neighbours(eta, more, neighbours, others, bound):
    def radius(eta, neighbours):
        return separation_discs(Definition.CHANCE, *EXACT, eta=eta, neighbours=neighbours, bound=bound).radius_m

    assert radius(eta, neighbours) <= radius(eta + more, neighbours) + 1e-12
    assert radius(eta, neighbours) <= radius(eta, neighbours + others) + 1e-12


@given(definitions, st.sampled_from(VALUES), st.floats(0.0, 1.0))
def test_unknown_is_never_better_than_a_value_within_the_standard(definition, which, share):
    most = {"airframe": 7.5, "error": 40.0, "accuracy": 40.0, "speed": 30.7}
    bound = next(limit for key, limit in most.items() if key in which[1])
    known = separation_discs(definition, *with_value(max(share * bound, 0.1), *which))
    unknown = separation_discs(definition, *with_value(math.nan, *which))
    assert unknown.radius_m >= known.radius_m - 1e-9


def test_many_are_indexed_and_set_against_each_other_as_arrays_are():
    three = Reported(np.array([1.0, 2.0, 3.0]), np.array([5.0, 6.0, 7.0]), np.full(3, 30.0), np.full(3, 10.0))
    everybody = separation_discs(Definition.CANDIDATE2, three[:, None], three)
    assert everybody.radius_m.shape == (3, 3) and np.array_equal(everybody.radius_m, everybody.radius_m.T)
    first = separation_discs(Definition.CANDIDATE2, three[0], three[1:])
    assert np.array_equal(first.radius_m, everybody.radius_m[0, 1:])


def test_shapes_that_do_not_fit_are_told_by_their_names() -> None:
    others = Reported(airframe_m=np.ones(2), speed_mps=np.ones(3))
    told = r"shapes do not broadcast: others.airframe_m \(2,\), others.speed_mps \(3,\)$"
    with pytest.raises(ValueError, match=told):
        separation_discs(Definition.CANDIDATE2, Reported(0.6), others)
