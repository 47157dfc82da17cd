"""Flights with tracks of pairs: the same as with one picture where nothing is lost, and reproducible where it is."""

from dataclasses import replace

import numpy as np
import pytest

from ridlink.avoidance import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.campaign import tracks
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.channel import Channel
from ridlink.campaign.flight import PairBatch, fly
from ridlink.campaign.plan import IDEAL_HALFPLANES, Plan, baseline, graded_plan, paper_plan
from ridlink.campaign.scene import Scene, circle, square
from ridlink.campaign.worlds import Outcomes, SharedBatch
from ridlink.geodesy import moved, offset_m
from ridlink.separation import Definition
from ridlink.traffic.position_filter import PositionFilter
from tests.campaign.outcomes import assert_same_rows

REAL = {"halfplane": HalfplaneSettings(), "graded": GradedSettings(), "rotation": RotationSettings()}
LOSSY = Channel(0.3, 5.0, (0.05, 0.25))


def meeting(**arguments) -> Scene:
    start, goal = np.array([[-200.0, 0.0], [200.0, 3.0]]), np.array([[200.0, 0.0], [-200.0, 3.0]])
    return Scene("meeting", start, goal, speed_mps=np.array([10.0, 10.0]), airframe_m=np.ones(2), **arguments)


@pytest.mark.parametrize(
    "plan",
    [
        Plan(circle(), errors=ErrorModel.WHITE),
        paper_plan(circle(), Definition.CANDIDATE2),
        graded_plan(circle(), errors=ErrorModel.GAUSS_MARKOV),
    ],
    ids=lambda plan: plan.solver,
)
def test_with_nothing_lost_everybody_has_the_same_picture(plan):
    assert plan.is_heard_at_once
    at_once, by_pairs = SharedBatch(plan, range(6)).fly(None), PairBatch(plan, range(6)).fly(None)
    assert np.array_equal(at_once.arrival_s, by_pairs.arrival_s)
    assert np.array_equal(at_once.collided, by_pairs.collided)
    assert at_once.distance_m == pytest.approx(by_pairs.distance_m, abs=1e-9)
    assert np.array_equal(at_once.decisions, by_pairs.decisions)


@pytest.mark.parametrize("solver", list(REAL))
def test_a_run_is_the_same_alone_and_in_any_batch(solver):
    plan = Plan(
        circle(), settings=REAL[solver], channel=LOSSY, dynamics="px4", interval_s=0.5, step_s=0.1, displaced_s=0.1,
        stock_share=0.3, unresponsive_share=0.1, common_share=0.3, bias_m=1.0, filtered=solver == "graded",
        duration_s=40.0,
    )  # fmt: skip
    together = fly(plan, range(3, 8))
    assert_same_rows(together, fly(plan, range(3, 8), batch=2))
    alone = fly(plan, range(6, 7))
    assert np.array_equal(alone.arrival_s[0], together.arrival_s[3])
    assert alone.distance_m[0] == together.distance_m[3]


@pytest.mark.parametrize("dynamics", ["px4", "ardupilot"])
def test_vehicles_that_take_their_time_keep_apart(dynamics):
    plan = Plan(
        replace(circle(), speed_mps=np.full(8, 10.0)), settings=HalfplaneSettings(), sigma_m=3.5, dynamics=dynamics,
        channel=Channel(0.3, None, (0.1, 0.3)),
    )  # fmt: skip
    out = fly(plan, range(8))
    assert out.macs == 0
    assert out.arrived == out.flights
    assert np.median(out.mission_s) < 40.0
    alone = fly(baseline(plan), range(8))
    assert alone.macs > 30


def test_without_avoidance_flights_are_straight_whatever_the_reports_are():
    for interval_s in (0.1, 2.0):
        out = fly(baseline(Plan(meeting(), interval_s=interval_s)), range(2))
        assert out.arrival_s == pytest.approx(39.6, abs=0.11)
        assert out.distance_m == pytest.approx(3.0, abs=1e-9)
        assert out.decisions.sum() == 0


def test_who_hears_nothing_of_the_other_flies_straight_on():
    large = replace(meeting(), airframe_m=np.full(2, 8.0))
    # a horizon so short that nothing is done yet while the other is coasted
    constants = HalfplaneSettings(horizon_s=3.0)
    plan = Plan(large, settings=constants, sigma_m=0.0, channel=Channel(0.999, 1e6), dynamics="px4")
    deaf, hearing = fly(plan, range(3)), fly(replace(plan, channel=Channel()), range(3))
    # known at the start, coasted for 10 s while in conflict, and then nothing
    assert np.all(deaf.distance_m < 8.0)
    assert np.all(hearing.distance_m > 18.0)
    near = fly(replace(plan, channel=Channel(), range_m=5.0), range(1))
    assert near.distance_m[0] < 8.0


@pytest.mark.parametrize(
    "chosen", [RotationSettings.paper(), GradedSettings.g2(), IDEAL_HALFPLANES], ids=["rotation", "graded", "halfplane"]
)
def test_who_may_have_turned_unheard_is_given_the_room_for_it(chosen):
    """Reports of exact positions that are all late by a second: discs grow by 5 m."""
    crossing = Scene(
        "crossing", np.array([[-200.0, 0.0], [0.0, -200.0]]), np.array([[200.0, 0.0], [0.0, 200.0]]),
        speed_mps=np.full(2, 10.0), airframe_m=np.ones(2),
    )  # fmt: skip
    plan = Plan(crossing, settings=chosen, sigma_m=0.5, channel=Channel(latency_s=(1.0, 1.0)))
    nearest = [
        fly(replace(plan, settings=replace(chosen, age_acceleration_mps2=most)), range(12)).distance_m.mean()
        for most in (0.0, chosen.age_acceleration_mps2)
    ]
    assert nearest[1] > nearest[0] + 0.3


def test_stock_senders_and_those_that_avoid_nobody_are_given_more_room():
    plan = Plan(meeting(), settings=HalfplaneSettings(), sigma_m=1.0, dynamics="px4", errors=ErrorModel.BIAS)
    nearest = {
        name: fly(replace(plan, **share), range(4)).distance_m.mean()
        for name, share in (("all", {}), ("stock", {"stock_share": 1.0}), ("unresponsive", {"unresponsive_share": 1.0}))
    }
    assert nearest["unresponsive"] == pytest.approx(3.0, abs=0.2)
    assert nearest["stock"] > nearest["all"] + 20.0


def test_a_longer_interval_in_the_papers_reading_makes_larger_discs_and_slower_flights():
    plan = paper_plan(square(), Definition.CANDIDATE2)
    medians = [np.median(fly(replace(plan, interval_s=each), range(12)).mission_s) for each in (0.1, 0.5)]
    assert medians[1] > medians[0] + 1.0


def test_a_track_is_filtered_as_the_daemon_filters_it():
    random = np.random.default_rng(3)
    origin = (47.0, 8.0)
    smoother = PositionFilter()
    track = np.zeros(tracks.TRACK_COLUMNS)
    report = np.zeros(tracks.REPORT_COLUMNS)
    for k in range(60):
        at_s = 0.1 * k + 0.03 * random.random()
        jump = 40.0 if k > 40 else 0.0
        report[0:2] = random.normal((3.0 * at_s + jump, -2.0 * at_s), 3.0)
        report[2:4], report[tracks.AT] = (3.0 + 0.1 * k, -2.0), at_s
        there = moved(*origin, *report[0:2])
        filtered = smoother.update(*there, (*report[2:4], 0.0), 9.0, at_s)
        tracks.take_report(report, at_s, 9.0, 2.0, 0.0, track)
        assert track[0:2] == pytest.approx(offset_m(origin, filtered), abs=0.01)
    assert smoother.resets == 1


def test_of_a_gap_between_two_reports_the_track_knows_the_end():
    """A vehicle that obeys at once flew the last interval at the velocity that it reports; before that, who knows."""
    track, report = np.zeros(tracks.TRACK_COLUMNS), np.zeros(tracks.REPORT_COLUMNS)
    report[2:4] = 30.0, 0.0
    for at_s, place, velocity in ((0.0, 0.0, 30.0), (0.1, -1.0, -10.0), (0.5, 3.0, 30.0)):
        report[0], report[2], report[tracks.AT] = place, velocity, at_s
        tracks.take_report(report, at_s, 90.0, 1e9, 0.1, track)
        # filtered without end, it counts reports alike
        first, second, third = 0.0, -1.0, 1.0 / 3.0 * 3.0 + 2.0 / 3.0 * (-1.0 + 0.1 * 30.0 + 0.3 * (30.0 - 10.0) / 2.0)
        assert track[0] == pytest.approx({0.0: first, 0.1: second, 0.5: third}[at_s])


def test_runs_that_are_none_are_refused():
    plan = Plan(meeting(), channel=Channel(0.1))
    for runs, batch in ((range(0), 8), (range(-1, 3), 8), (range(3), 0)):
        with pytest.raises(ValueError, match="runs"):
            fly(plan, runs, batch=batch)


def test_large_worlds_are_flown_few_at_a_time_and_bring_forth_the_same():
    """A shard of 64 worlds of 1000 vehicles with tracks of pairs wanted 32 GB."""
    few = Plan(circle(300, 2000.0), settings=REAL["rotation"], channel=LOSSY, duration_s=0.2)
    seen: list[int] = []
    flown = fly(few, range(4), watch=lambda instant: seen.append(len(instant.present)))
    assert seen == [2, 2, 2, 2], "two batches of two steps"
    assert_same_rows(flown, Outcomes.joined([fly(few, range(k, k + 1)) for k in range(4)]))
