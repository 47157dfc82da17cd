"""Without errors and delays: everybody arrives, nobody comes nearer than the disc, everybody passes on the right."""

from __future__ import annotations

import numpy as np
import pytest

from tests.avoidance.exact import fly, on_circle

CENTIMETRE = 0.01


@pytest.mark.parametrize("count", range(2, 31))
def test_a_circle_of_any_size_goes_round(count):
    """Radius 200 m, discs of 7.5 m each, 15.4 m/s. Solvers that freeze here leave everybody hovering for ever."""
    start = on_circle(count, 200.0)
    flown = fly(start, -start, 15.0, 15.4)
    assert np.isfinite(flown.time_s).all()
    assert flown.last <= (1.3 if count <= 24 else 1.6)
    assert flown.least_m > 15.0 - CENTIMETRE


def _left_abeam(flown, vehicle: int) -> float:
    """How far to the left of its first course a vehicle had the other at their closest approach [m]."""
    first, other = flown.path_ne_m[:, vehicle], flown.path_ne_m[:, 1 - vehicle]
    closest = np.nanargmin(np.linalg.norm(first - other, axis=1))
    course = first[1] - first[0]
    north, east = other[closest] - first[closest]
    return float((course[1] * north - course[0] * east) / np.linalg.norm(course))


HEAD_ON = ([[-250.0, 0.0], [250.0, 0.0]], [[250.0, 0.0], [-250.0, 0.0]])
CROSSING = ([[-250.0, 0.0], [0.0, -250.0]], [[250.0, 0.0], [0.0, 250.0]])
OVERTAKING = ([[-250.0, 0.0], [-150.0, 0.0]], [[250.0, 0.0], [350.0, 0.0]])


@pytest.mark.parametrize(
    ("pair", "speed", "cooperative"),
    [
        (HEAD_ON, 10.0, None),
        (HEAD_ON, 10.0, [True, False]),
        (CROSSING, 10.0, None),
        (CROSSING, 10.0, [True, False]),
        (OVERTAKING, [10.0, 5.0], None),
        (OVERTAKING, [10.0, 5.0], [True, False]),
    ],
    ids=["head-on", "head-on, one avoids", "crossing", "crossing, one avoids", "overtaking", "overtaking, one avoids"],
)
def test_two_vehicles_in_perfect_symmetry_pass(pair, speed, cooperative):
    flown = fly(*pair, 15.0, speed, cooperative=cooperative)
    avoids = np.ones(2, bool) if cooperative is None else np.array(cooperative)
    assert np.isfinite(flown.time_s[avoids]).all()
    assert flown.least_m > 15.0 - CENTIMETRE
    if cooperative is None:
        assert flown.last <= 1.1


@pytest.mark.parametrize("cooperative", [None, [True, False]])
def test_head_on_and_overtaking_vehicles_pass_on_the_right(cooperative):
    """Each leaves the other on its left, as at sea and in the air."""
    met = fly(*HEAD_ON, 15.0, 10.0, cooperative=cooperative)
    assert _left_abeam(met, 0) > 0.0
    past = fly(*OVERTAKING, 15.0, [10.0, 5.0], cooperative=cooperative)
    assert _left_abeam(past, 0) > 0.0


def test_a_tight_circle_arrives():
    """Radius 52 m: neighbours start and end 39.8 m apart, discs are 30 m."""
    start = on_circle(8, 52.0)
    flown = fly(start, -start, 30.0, 15.4)
    assert np.isfinite(flown.time_s).all() and flown.least_m > 30.0 - CENTIMETRE


@pytest.mark.parametrize("disc_m", [45.0, 70.0, 90.0])
def test_discs_that_overlap_at_the_start_open_never_close_and_let_one_after_the_other_in(disc_m):
    """And too large to stand side by side at the goals: whoever arrives has waited for its turn; nothing is shrunk."""
    start = on_circle(8, 52.0)
    flown = fly(start, -start, disc_m, 15.4, duration_s=300.0)
    assert flown.least_m == pytest.approx(2.0 * 52.0 * np.sin(np.pi / 8), abs=CENTIMETRE)
    assert flown.came_closer_m < CENTIMETRE
    assert np.isfinite(flown.time_s).all()


def test_who_has_no_room_at_its_goal_does_not_arrive_and_nothing_is_shrunk_for_it():
    """One that avoids nobody stands a disc's radius from the goal of the other."""
    flown = fly(
        [[-100.0, 0.0], [0.0, 20.0]], [[0.0, 0.0], [0.0, 20.001]], 40.0, [10.0, 1e-6], cooperative=[True, False],
        arrived_m=1e-4,
    )  # fmt: skip
    assert np.isinf(flown.time_s[0]) and flown.least_m > 40.0 - CENTIMETRE


def test_a_world_that_is_flown_twice_is_the_same():
    start = on_circle(12, 100.0)
    first, again = (fly(start, -start, 15.0, 15.4) for _ in range(2))
    assert np.array_equal(first.path_ne_m, again.path_ne_m, equal_nan=True)
