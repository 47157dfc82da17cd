"""The referee: collisions between samples, vertical overlap, uNMAC entries, obstacles, arrivals, the verdict."""

from __future__ import annotations

import json
import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ridlink.scenario import ObstacleSpec, Scenario, VehicleSpec
from sitl_sim.referee import Referee
from sitl_sim.verdict import Outcome

FloatArray = npt.NDArray[np.float64]

FAR_AWAY = (5000.0, 5000.0, -50.0)


def scenario(*starts: tuple[float, float, float], airframe_m: float = 1.0, tower: bool = False) -> Scenario:
    """Vehicles at some places whose goals are out of the way."""
    vehicles = tuple(VehicleSpec(start, FAR_AWAY, airframe_m=airframe_m) for start in starts)
    obstacles = (ObstacleSpec(((-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0))),) if tower else ()
    return Scenario("test", 60.0, vehicles, obstacles)


class Match:
    """A referee fed with straight moves, everybody in the air and on a mission unless said otherwise."""

    def __init__(self, played: Scenario) -> None:
        self.position = np.array([vehicle.start_ned_m for vehicle in played.vehicles])
        self.referee = Referee(played, self.position)
        self.time_s = 0.0

    def move(self, *by: tuple[float, float, float], active: list[bool] | None = None) -> list[int]:
        self.position = self.position + np.array(by)
        self.time_s += 1.0
        everybody = np.ones(len(by), dtype=np.bool_)
        return self.referee.observe(
            self.time_s,
            1.0,
            self.position,
            self.position,
            in_air=everybody,
            active=everybody if active is None else np.array(active),
        ).tolist()


def test_a_collision_between_two_samples_is_seen() -> None:
    # they swap places in one step and are 200 m apart at both ends of it
    match = Match(scenario((-100.0, 0.3, -50.0), (100.0, 0.0, -50.0)))
    assert match.move((200.0, 0.0, 0.0), (-200.0, 0.0, 0.0)) == [0, 1]
    verdict = match.referee.verdict()
    assert verdict.macs == 1
    assert verdict.min_separation_m == pytest.approx(0.3)
    # they touch at a distance of 1 m, so a little before the middle of the step
    contact_s = 0.5 - math.sqrt(1.0 - 0.09) / 400.0
    assert match.referee.collisions[0].time_s == pytest.approx(contact_s)
    assert [detail.outcome for detail in verdict.details] == [Outcome.COLLIDED, Outcome.COLLIDED]
    assert not verdict.passed


@pytest.mark.parametrize("aside_m, collides", [(0.99, True), (1.01, False)])
def test_a_collision_is_nearer_than_half_the_sum_of_airframes(aside_m: float, collides: bool) -> None:
    match = Match(scenario((-5.0, 0.0, -50.0), (5.0, aside_m, -50.0)))
    assert bool(match.move((10.0, 0.0, 0.0), (-10.0, 0.0, 0.0))) is collides
    assert match.referee.verdict().min_separation_m == pytest.approx(aside_m)


@pytest.mark.parametrize("above_m, collides", [(0.49, True), (0.51, False)])
def test_airframes_must_overlap_vertically_to_collide(above_m: float, collides: bool) -> None:
    # airframes of 1 m are taken to be 0.5 m high
    match = Match(scenario((-5.0, 0.0, -50.0), (5.0, 0.0, -50.0 - above_m)))
    assert bool(match.move((10.0, 0.0, 0.0), (-10.0, 0.0, 0.0))) is collides


def test_passing_over_at_different_moments_is_no_collision() -> None:
    # the second one comes down through the height of the first, but beside it; both overlaps never coincide
    match = Match(scenario((-8.0, 0.0, -50.0), (0.0, 0.0, -60.0)))
    assert match.move((16.0, 0.0, 0.0), (0.0, 0.0, 12.0)) == []
    # the same descent, arriving at the height just when the first one is below
    together = Match(scenario((-8.0, 0.0, -50.0), (0.0, 0.0, -60.0)))
    assert together.move((16.0, 0.0, 0.0), (0.0, 0.0, 20.0)) == [0, 1]


def test_who_has_collided_is_not_hit_again() -> None:
    match = Match(scenario((-5.0, 0.0, -50.0), (5.0, 0.0, -50.0), (0.0, -6.0, -50.0)))
    hit = match.move((10.0, 0.0, 0.0), (-10.0, 0.0, 0.0), (0.0, 11.0, 0.0))
    assert hit == [0, 1]
    assert match.referee.removed.tolist() == [True, True, False]


@settings(max_examples=60, deadline=None)
@given(
    gap=st.tuples(*[st.floats(-12.0, 12.0)] * 2),
    motion=st.tuples(*[st.floats(-15.0, 15.0)] * 2),
)
def test_smallest_separation_is_that_of_a_thousand_samples(
    gap: tuple[float, float], motion: tuple[float, float]
) -> None:
    assume(math.hypot(*gap) > 1.1)
    match = Match(scenario((0.0, 0.0, -50.0), (*gap, -50.0)))
    match.move((0.0, 0.0, 0.0), (*motion, 0.0))
    shares = np.linspace(0.0, 1.0, 1001)[:, None]
    sampled_m = np.linalg.norm(np.array(gap) + shares * np.array(motion), axis=1).min()
    found_m = match.referee.verdict().min_separation_m
    assert found_m is not None
    assert found_m <= sampled_m + 1e-9
    assert found_m == pytest.approx(sampled_m, abs=0.02)


def test_nearest_neighbour_and_its_time_are_kept_for_each_vehicle() -> None:
    match = Match(scenario((0.0, 0.0, -50.0), (60.0, 0.0, -50.0), (0.0, 100.0, -50.0)))
    match.move((30.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    match.move((-30.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    first, second, third = match.referee.verdict().details
    assert (first.nearest_system_id, first.min_separation_m, first.nearest_time_s) == (2, 30.0, 1.0)
    assert second.nearest_system_id == 1
    assert (third.nearest_system_id, third.min_separation_m) == (1, 100.0)


def test_separation_is_judged_within_one_slice_and_on_missions_only() -> None:
    apart = Match(scenario((0.0, 0.0, -50.0), (3.0, 0.0, -80.0)))
    apart.move((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert apart.referee.verdict().min_separation_m is None
    landing = Match(scenario((0.0, 0.0, -50.0), (8.0, 0.0, -50.0)))
    landing.move((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), active=[True, False])
    assert landing.referee.verdict().min_separation_m is None
    # but it can still be hit
    assert landing.move((8.0, 0.0, 0.0), (0.0, 0.0, 0.0), active=[True, False]) == [0, 1]


def radii(radius_m: float, count: int = 2) -> FloatArray:
    return np.full((count, count), radius_m)


def test_unmac_is_violated_by_entering_and_once_per_pair() -> None:
    referee = Referee(scenario((0.0, 0.0, -50.0), (100.0, 0.0, -50.0)), [[0.0, 0.0, -50.0], [100.0, 0.0, -50.0]])
    both = np.array([True, True])
    for reported_m, true_m in ((100.0, 100.0), (20.0, 35.0), (10.0, 30.0), (100.0, 100.0), (20.0, 35.0)):
        true = np.array([[0.0, 0.0, -50.0], [true_m, 0.0, -50.0]])
        reported = np.array([[0.0, 0.0, -50.0], [reported_m, 0.0, -50.0]])
        referee.observe_reports(true, reported, radii(24.0), active=both)
    verdict = referee.verdict()
    assert (verdict.unmac_violations, verdict.unmac_violations_true) == (1, 0)
    referee.observe_reports(reported, true, radii(24.0), active=both)
    assert referee.verdict().unmac_violations_true == 1


def test_a_mission_that_begins_inside_a_radius_counts_only_after_it_was_clear() -> None:
    places = [[0.0, 0.0, -50.0], [10.0, 0.0, -50.0]]
    both = np.array([True, True])
    referee = Referee(scenario((0.0, 0.0, -50.0), (10.0, 0.0, -50.0)), places)
    inside, clear = np.array(places), np.array([[0.0, 0.0, -50.0], [50.0, 0.0, -50.0]])
    referee.observe_reports(inside, inside, radii(24.0), active=both)
    assert referee.verdict().unmac_violations == 0
    referee.observe_reports(clear, clear, radii(24.0), active=both)
    referee.observe_reports(inside, inside, radii(24.0), active=both)
    assert referee.verdict().unmac_violations == 1


@pytest.mark.parametrize(("up_m", "error_m", "entered"), [(0.0, 15.0, 1), (29.0, 15.0, 1), (32.0, 15.0, 0),
                                                          (14.0, 1.0, 1), (16.0, 1.0, 0), (16.0, None, 0)])  # fmt: skip
def test_a_disc_counts_only_inside_the_height_bound_of_the_pair(
    up_m: float, error_m: float | None, entered: int
) -> None:
    both = np.array([True, True])
    clear = np.array([[0.0, 0.0, -50.0], [50.0, 0.0, -50.0 - up_m]])
    inside = clear - [[0.0, 0.0, 0.0], [40.0, 0.0, 0.0]]
    referee = Referee(scenario(*map(tuple, clear.tolist())), clear)
    errors = None if error_m is None else np.array([error_m, error_m])
    for positions in (clear, inside):
        referee.observe_reports(positions, positions, radii(24.0), active=both, vertical_error_m=errors)
    assert (referee.verdict().unmac_violations, referee.verdict().unmac_violations_true) == (entered, entered)


def test_coming_down_into_the_cylinder_of_a_neighbour_below_is_an_entry() -> None:
    both, errors = np.array([True, True]), np.array([15.0, 15.0])
    above = np.array([[0.0, 0.0, -50.0], [10.0, 0.0, -90.0]])
    down = np.array([[0.0, 0.0, -50.0], [10.0, 0.0, -70.0]])
    referee = Referee(scenario((0.0, 0.0, -50.0), (10.0, 0.0, -90.0)), above)
    for positions, entered in ((above, 0), (down, 1)):
        referee.observe_reports(positions, positions, radii(24.0), active=both, vertical_error_m=errors)
        assert referee.verdict().unmac_violations == entered


def test_an_obstacle_is_hit_by_the_airframe_and_never_jumped() -> None:
    match = Match(scenario((-60.0, 0.0, -50.0), (-60.0, 41.0, -50.0), (-60.0, -40.4, -50.0), tower=True))
    # a step that carries all three from one side to the other: one through it, one past it, one with a rotor in it
    assert match.move((120.0, 0.0, 0.0), (120.0, 0.0, 0.0), (120.0, 0.0, 0.0)) == [0, 2]
    verdict = match.referee.verdict()
    assert verdict.obstacle_hits == 2
    assert verdict.details[0].outcome is Outcome.HIT_OBSTACLE
    assert verdict.details[1].outcome is Outcome.FLYING


def test_arrival_counts_true_or_reported_position_within_5_m_once() -> None:
    vehicles = tuple(VehicleSpec((0.0, 100.0 * k, -50.0), (50.0, 100.0 * k, -50.0)) for k in range(3))
    referee = Referee(Scenario("test", 60.0, vehicles), [v.start_ned_m for v in vehicles])
    everybody = np.ones(3, dtype=np.bool_)
    true = np.array([[46.0, 0.0, -50.0], [30.0, 100.0, -50.0], [44.0, 200.0, -50.0]])
    reported = np.array([[30.0, 0.0, -50.0], [46.0, 100.0, -50.0], [44.0, 200.0, -50.0]])
    for time_s in (10.0, 20.0):
        referee.observe(time_s, 1.0, true, reported, in_air=everybody, active=everybody)
    assert referee.arrived.tolist() == [True, True, False]
    verdict = referee.verdict()
    assert (verdict.arrived, verdict.mission_time_median_s, verdict.mission_time_max_s) == (2, 10.0, 10.0)
    assert not verdict.passed


def test_verdict_is_json_without_nan() -> None:
    match = Match(scenario((0.0, 0.0, -50.0), (60.0, 0.0, -50.0)))
    text = json.dumps(match.referee.verdict().as_dict(), allow_nan=False)
    assert json.loads(text)["mission_time_s"] == {"median": None, "max": None}
    match.move((30.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    result = json.loads(json.dumps(match.referee.verdict().as_dict(), allow_nan=False))
    assert result["min_separation_m"] == 30.0
    assert [detail["system_id"] for detail in result["details"]] == [1, 2]


@pytest.mark.parametrize("count", [0, 1])
def test_an_empty_or_lonely_sky_has_a_verdict(count: int) -> None:
    match = Match(scenario(*[(0.0, 0.0, -50.0)] * count))
    match.position = match.position.reshape(count, 3)
    everybody = np.ones(count, dtype=np.bool_)
    hit = match.referee.observe(1.0, 1.0, match.position, match.position, in_air=everybody, active=everybody)
    assert hit.tolist() == []
    assert match.referee.verdict().min_separation_m is None


def test_begin_forgets_what_was_before_the_mission() -> None:
    match = Match(scenario((0.0, 0.0, -50.0), (60.0, 0.0, -50.0)))
    match.move((50.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    match.move((-20.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert match.referee.verdict().min_separation_m == pytest.approx(10.0)
    match.referee.begin(match.position)
    match.move((-20.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert match.referee.verdict().min_separation_m == pytest.approx(30.0)
