"""What the solver accepts: every value that is not finite or out of range is named."""

import math
import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from ridlink.avoidance import HalfplaneSettings, OwnShip, ProgressWatch, Traffic, rows

OWN = OwnShip(np.zeros(2), np.zeros(2), np.zeros(2), 0.5, 10.0)
PAIR, ONE = np.ones((1, 2)), np.ones(1)
TRAFFIC = Traffic(PAIR, PAIR, PAIR, ONE, ONE, ONE, np.ones(1, np.bool_), np.zeros(1, np.int8))


def test_the_kernels_read_the_settings_in_field_order():
    names = {
        "horizon_s": rows.HORIZON,
        "response_time_s": rows.RESPONSE,
        "barrier_gain_per_s": rows.BARRIER,
        "barrier_share": rows.BARRIER_SHARE,
        "smoothing": rows.SMOOTHING,
        "right_turn_rad": rows.RIGHT_TURN,
        "start_turn_rad": rows.START_TURN,
        "age_acceleration_mps2": rows.AGE_ACCELERATION,
        "buffer_share": rows.BUFFER_SHARE,
        "arrival_deceleration_mps2": rows.ARRIVAL,
        "head_on_cosine": rows.HEAD_ON_COSINE,
        "head_on_speed_mps": rows.HEAD_ON_SPEED,
        "obstacle_horizon_s": rows.OBSTACLE_HORIZON,
        "obstacle_deceleration_mps2": rows.OBSTACLE_DECELERATION,
        "obstacle_response_s": rows.OBSTACLE_RESPONSE,
        "route_margin_m": rows.ROUTE_MARGIN,
        "contact_step_s": rows.CONTACT_STEP,
        "acceleration_mps2": rows.ACCELERATION,
    }
    assert list(names) == [item.name for item in fields(HalfplaneSettings)]
    assert list(names.values()) == list(range(len(names)))
    assert HalfplaneSettings().as_vector() == pytest.approx([getattr(HalfplaneSettings(), name) for name in names])


@pytest.mark.parametrize("name", [item.name for item in fields(HalfplaneSettings)])
def test_every_setting_refuses_nan_and_a_value_out_of_range(name):
    up_to = ("smoothing", "barrier_share", "head_on_cosine", "right_turn_rad", "start_turn_rad")
    out_of_range = 3.0 if name in up_to else -1.0
    for value in (math.nan, -math.inf, out_of_range):
        with pytest.raises(ValueError, match=name):
            replace(HalfplaneSettings(), **{name: value})


@pytest.mark.parametrize("name", ["position_ne_m", "velocity_ne_mps", "command_ne_mps"])
def test_own_ship_refuses_vectors_that_are_not_finite(name):
    with pytest.raises(ValueError, match=name):
        replace(OWN, **{name: np.array([1.0, math.nan])})
    with pytest.raises(ValueError, match=name):
        replace(OWN, **{name: np.zeros(3)})


@pytest.mark.parametrize("name", ["airframe_m", "speed_limit_mps"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_own_ship_refuses_sizes_and_limits_that_are_not_positive(name, value):
    with pytest.raises(ValueError, match=name):
        replace(OWN, **{name: value})


@pytest.mark.parametrize("name", ["position_ne_m", "velocity_ne_mps", "age_s", "radius_m", "error_sum_m"])
def test_traffic_refuses_values_that_are_not_finite(name):
    broken = np.array(getattr(TRAFFIC, name))
    broken[...] = math.nan
    with pytest.raises(ValueError, match=name):
        replace(TRAFFIC, **{name: broken})


@pytest.mark.parametrize("name", [item.name for item in fields(Traffic)])
@pytest.mark.parametrize("value", [7.0, None, "text", [[1.0, 2.0], [3.0]], [[[300]]]])
def test_traffic_names_what_has_no_such_shape_or_holds_no_such_numbers(name, value):
    with pytest.raises(ValueError, match=name):
        replace(TRAFFIC, **{name: value})


@pytest.mark.parametrize("value", [math.nan, 0.5, "no"])
def test_nobody_avoids_because_a_value_is_no_truth_value(value):
    with pytest.raises(ValueError, match="reciprocal must be true or false"):
        replace(TRAFFIC, reciprocal=[value])
    assert replace(TRAFFIC, reciprocal=[1]).reciprocal.tolist() == [True]


@pytest.mark.parametrize("name", ["age_s", "radius_m", "error_sum_m"])
def test_traffic_refuses_negative_values_and_wrong_lengths(name):
    with pytest.raises(ValueError, match=name):
        replace(TRAFFIC, **{name: np.array([-1.0])})
    with pytest.raises(ValueError, match=name):
        replace(TRAFFIC, **{name: np.ones(2)})


def test_a_neighbour_need_not_say_what_it_commands():
    assert len(replace(TRAFFIC, command_ne_mps=np.full((1, 2), math.nan))) == 1


def test_what_was_kept_of_an_encounter_is_checked():
    """No flag that there is not, and no neighbour that is passed on both sides."""
    for wrong in (3, 7, 8, 127, -1, -128):
        with pytest.raises(ValueError, match=rf"memory must hold 1 sets of Memory flags, got \[{wrong}\]"):
            replace(TRAFFIC, memory=np.array([wrong], np.int8))
    for right in (0, 1, 2, 4, 5, 6):
        assert replace(TRAFFIC, memory=np.array([right], np.int8)).memory == right


def test_the_package_itself_does_not_load_the_compiler():
    code = "import sys, ridlink.avoidance; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_extra_turn_grows_while_stalled_and_goes_away_with_progress():
    watch = ProgressWatch(window_s=5.0, share=0.1, growth_rad_per_s=0.1, most_rad=0.5)
    clock = np.arange(0.0, 20.0, 0.1)
    stalled = [watch.update(now, 100.0, 10.0) for now in clock]
    assert stalled[45] == 0.0
    assert stalled[99] == pytest.approx(0.5, abs=0.02)
    assert max(stalled) == pytest.approx(0.5)
    moving = [watch.update(20.0 + now, 100.0 - 10.0 * now, 10.0) for now in np.arange(0.0, 9.0, 0.1)]
    assert moving[-1] == 0.0


def test_a_vehicle_at_its_goal_is_not_stalled():
    watch = ProgressWatch()
    assert max(watch.update(now, 2.0, 10.0) for now in np.arange(0.0, 20.0, 0.1)) == 0.0
    with pytest.raises(ValueError, match="goal_distance_m"):
        watch.update(30.0, math.nan, 10.0)


@pytest.mark.parametrize("name", ["position_ne_m", "velocity_ne_mps"])
def test_a_number_whose_square_would_overflow_is_refused_with_its_value(name):
    for valid in (OWN, TRAFFIC):
        with pytest.raises(ValueError, match=f"{name} must lie within 1e\\+09.*1e\\+200"):
            replace(valid, **{name: np.full(np.shape(getattr(valid, name)), 1e200)})
