"""Diameters and radii of Eq. 5 to 9, and the reference figures behind them."""

import math

import numpy as np
import pytest

from ridlink.separation import mac_radius, unmac_diameter, unmac_radius
from ridlink.separation.reference import CATEGORIES, GPS_SIGMA_M, MAX_AIRFRAME_M


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


def test_volumes_broadcast_over_leading_axes():
    radius = unmac_radius(np.full((4, 3, 2), 1.0), [2.0, 3.0], np.full((3, 2), 10.0), np.array([0.1, 0.2, 0.3]))
    assert radius.shape == (4, 3)
    assert radius[0] == pytest.approx([1 + 5 + 2, 1 + 5 + 4, 1 + 5 + 6])


@pytest.mark.parametrize(
    "arguments",
    [
        ([1.0, -1.0], [1.0, 1.0], [1.0, 1.0], 0.1),
        ([1.0, 1.0], [1.0, math.nan], [1.0, 1.0], 0.1),
        ([1.0, 1.0], [1.0, 1.0], [math.inf, 1.0], 0.1),
        ([1.0, 1.0], [1.0, 1.0], [1.0, 1.0], -0.1),
        ([1.0, 1.0, 1.0], [1.0, 1.0], [1.0, 1.0], 0.1),
    ],
)
def test_a_meaningless_value_is_refused(arguments):
    with pytest.raises(ValueError):
        unmac_diameter(*arguments)


def test_monte_carlo_radius_of_category_3_agrees_with_the_equations():
    """Mean 12.5 m and 99.9 % quantile 25.1 m at sigma 3.5, half-normal errors, dt 0.1 s."""
    random = np.random.default_rng(5)
    count = 200_000
    category = CATEGORIES[3]
    radius = unmac_radius(
        random.uniform(0.1, MAX_AIRFRAME_M, (count, 2)),
        np.abs(random.normal(0.0, GPS_SIGMA_M[1], (count, 2))),
        np.abs(random.normal(category.cruise_speed_mps, category.speed_sigma_mps, (count, 2))),
        0.1,
    )
    assert radius.mean() == pytest.approx(12.5, abs=0.1)
    assert np.quantile(radius, 0.999) == pytest.approx(25.1, abs=0.5)


@pytest.mark.parametrize(("number", "line"), [(1, 35.774), (2, 27.206), (3, 50.618), (4, 88.343)])
def test_speed_sigma_gives_the_mobility_lines_of_the_categories(number, line):
    """99.7 % of the displacement of two vehicles in a second, 2 V_c + 2.7478 sqrt(2) sigma_v."""
    category = CATEGORIES[number]
    quantile = 2 * category.cruise_speed_mps + 2.7478 * math.sqrt(2) * category.speed_sigma_mps
    assert quantile == pytest.approx(line, abs=2e-3)
