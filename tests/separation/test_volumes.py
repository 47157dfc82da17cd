"""Diameters and radii of Eq. 5 to 9, and the reference figures behind them."""

import math

import numpy as np
import pytest

from ridlink.separation import mac_radius, uncertainty_diameter, unmac_diameter, unmac_radius


def test_table_iv_in_diameters_is_half_of_it_in_radii():
    assert unmac_diameter([7.5, 7.5], [40.0, 40.0], [0.0, 0.0], 0.1) == pytest.approx(15.0 + 160.0)
    assert unmac_radius([7.5, 7.5], [40.0, 40.0], [0.0, 0.0], 0.1) == pytest.approx(87.5)
    assert mac_radius([7.5, 7.5]) == pytest.approx(7.5)


def test_displacement_counts_on_both_sides_unless_the_direction_is_known():
    still = unmac_diameter([1.0, 2.0], [3.0, 4.0], [0.0, 0.0], 0.5)
    moving = unmac_diameter([1.0, 2.0], [3.0, 4.0], [10.0, 20.0], 0.5)
    known = unmac_diameter([1.0, 2.0], [3.0, 4.0], [10.0, 20.0], 0.5, direction_known=True)
    assert moving - still == pytest.approx(2 * 0.5 * 30.0)
    assert known - still == pytest.approx(0.5 * 30.0)
    assert unmac_radius([1.0, 2.0], [3.0, 4.0], [10.0, 20.0], 0.5, direction_known=True) == pytest.approx(known / 2)


def test_the_diameter_of_a_pair_is_the_sum_of_two_areas_of_uncertainty():
    """Eq. 5 and 6, one vehicle; Eq. 7, both."""
    airframe, error, speed = np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([10.0, 20.0])
    assert uncertainty_diameter(1.0, 3.0, 10.0, 0.5) == 1.0 + 2.0 * (3.0 + 5.0)
    assert uncertainty_diameter(1.0, 3.0, 10.0, 0.5, direction_known=True) == 1.0 + 2.0 * 3.0 + 5.0
    for known in (False, True):
        each = uncertainty_diameter(airframe, error, speed, 0.5, direction_known=known)
        assert unmac_diameter(airframe, error, speed, 0.5, direction_known=known) == pytest.approx(each.sum())
    with pytest.raises(ValueError, match="speed_mps"):
        uncertainty_diameter(1.0, 3.0, -10.0, 0.5)


def test_volumes_broadcast_over_leading_axes():
    radius = unmac_radius(np.full((4, 3, 2), 1.0), [2.0, 3.0], np.full((3, 2), 10.0), np.array([0.1, 0.2, 0.3]))
    assert radius.shape == (4, 3)
    assert radius[0] == pytest.approx([1 + 5 + 2, 1 + 5 + 4, 1 + 5 + 6])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (([1.0, -1.0], [1.0, 1.0], [1.0, 1.0], 0.1), "airframe_m .* got -1"),
        (([1.0, 1.0], [1.0, math.nan], [1.0, 1.0], 0.1), "error_bound_m .* got nan"),
        (([1.0, 1.0], [1.0, 1.0], [math.inf, 1.0], 0.1), "speed_mps .* got inf"),
        (([1.0, 1.0], [1.0, 1.0], [1.0, 1.0], -0.1), "interval_s .* got -0.1"),
        (([1.0, 1.0, 1.0], [1.0, 1.0], [1.0, 1.0], 0.1), r"airframe_m .* got shape \(3,\)"),
    ],
)
def test_a_meaningless_value_is_refused_by_name(arguments, named):
    with pytest.raises(ValueError, match=named):
        unmac_diameter(*arguments)
