"""From how far a neighbour must be heard, against the response study's figures; and what the air is seen to give."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.engine.detection import (
    ARDUPILOT_REACTION,
    PX4_REACTION,
    DetectionWatch,
    needed_range,
    reaction_of,
    reaction_time,
)
from ridlink.own_ship import ARDUPILOT, PX4
from ridlink.remote_id.report import RemoteIdReport
from ridlink.separation.definitions import Definition, Reported, separation_discs
from ridlink.traffic.track import Track, new_track
from tests.daemon.emulated import Emulated
from tests.engine.flight import STEP_S, Flight, config


def head_on_m(speed_mps: float, sigma_m: float, reciprocal: bool) -> float:
    """Range needed by two equal vehicles of 0.6 m head-on, ArduPilot, buffer of a third of both errors."""
    error_m = 3.0 * sigma_m
    one = Reported(0.6, error_m, error_m, speed_mps)
    discs = separation_discs(Definition.CANDIDATE2, one, one)
    disc_m = discs.radius_m + discs.error_sum_m / 3.0
    return float(needed_range(disc_m, [speed_mps], [reciprocal], speed_mps=speed_mps, reaction=ARDUPILOT_REACTION)[0])


@pytest.mark.parametrize(
    ("sigma_m", "range_m", "both_avoid_mps", "intruder_mps"),
    [
        (1.9, 100.0, 14.0, 10.5), (3.5, 100.0, 11.5, 8.0), (10.0, 100.0, 5.0, None),
        (1.9, 150.0, 20.0, 16.0), (3.5, 150.0, 17.0, 13.0), (10.0, 150.0, 11.0, None),
        (10.0, 400.0, None, 22.0),
    ],
)  # fmt: skip
def test_the_largest_speeds_of_the_response_study(
    sigma_m: float, range_m: float, both_avoid_mps: float | None, intruder_mps: float | None
) -> None:
    """The study prints speeds in halves of a metre per second; "never" and "> 25" are told by the next two tests."""
    for reciprocal, largest in ((True, both_avoid_mps), (False, intruder_mps)):
        if largest is not None:
            assert head_on_m(largest, sigma_m, reciprocal) <= range_m
            assert head_on_m(largest + 1.5, sigma_m, reciprocal) > range_m


@pytest.mark.parametrize("speed_mps", [0.5, 2.0, 5.0, 10.0, 25.0])
def test_at_equal_speeds_an_intruder_must_be_heard_from_twice_the_disc_however_slow(speed_mps: float) -> None:
    assert head_on_m(speed_mps, 10.0, reciprocal=False) > 2.0 * 80.6
    for range_m in (100.0, 150.0):
        assert head_on_m(speed_mps, 10.0, reciprocal=False) > range_m


@pytest.mark.parametrize(
    ("sigma_m", "reciprocal"), [(1.9, True), (1.9, False), (3.5, True), (3.5, False), (10.0, True)]
)
def test_400_m_are_enough_for_25_mps(sigma_m: float, reciprocal: bool) -> None:
    assert head_on_m(25.0, sigma_m, reciprocal) < 400.0


@pytest.mark.parametrize(
    ("aside_m", "speed_mps", "expected_s"),
    [
        (5.0, 10.0, 0.7 + 2.0),  # still speeding up: sqrt(2 * 5 / 2.5)
        (20.0, 10.0, 0.7 + 4.0),  # just there: V^2 / (2 a) = 20
        (30.0, 10.0, 0.7 + 4.0 + 1.0),
        (0.0, 10.0, 0.7),
    ],
)
def test_reaction_time(aside_m: float, speed_mps: float, expected_s: float) -> None:
    assert float(reaction_time(aside_m, speed_mps, ARDUPILOT_REACTION)) == pytest.approx(expected_s)


def test_a_sender_at_one_hertz_costs_a_second_of_closing() -> None:
    figures = {"speed_mps": 10.0, "reaction": PX4_REACTION}
    fast, slow = needed_range([20.0, 20.0], [5.0, 5.0], [False, False], interval_s=[0.1, 1.0], **figures)  # type: ignore[arg-type]
    assert slow - fast == pytest.approx(15.0)


def test_the_autopilot_and_the_limit_of_setpoints_make_the_reaction() -> None:
    assert reaction_of(ARDUPILOT, 5.0) == ARDUPILOT_REACTION
    assert reaction_of(PX4, 5.0) == PX4_REACTION
    assert reaction_of(None, 5.0) == ARDUPILOT_REACTION
    assert reaction_of(PX4, 1.0).acceleration_mps2 == 1.0


@given(
    disc=st.floats(0.0, 300.0), more=st.floats(0.0, 100.0), speed=st.floats(0.5, 30.0), other=st.floats(0.0, 60.0),
    reciprocal=st.booleans(),
)  # fmt: skip
def test_a_larger_disc_and_a_faster_neighbour_need_more(
    disc: float, more: float, speed: float, other: float, reciprocal: bool
) -> None:
    def needed(disc_m: float, other_mps: float, avoids: bool) -> float:
        (value,) = needed_range([disc_m], [other_mps], [avoids], speed_mps=speed, reaction=PX4_REACTION)
        return float(value)

    assert needed(disc + more, other, reciprocal) >= needed(disc, other, reciprocal)
    assert needed(disc, other + more, reciprocal) >= needed(disc, other, reciprocal)
    assert needed(disc, other, True) <= needed(disc, other, False)
    assert math.isfinite(needed(disc, other, reciprocal))


# --- what the air gives -----------------------------------------------------------------------------------------------


def heard(sysid: int, at_s: float, distance_m: float | None, status: int = 2) -> Track:
    report = RemoteIdReport(
        source=(sysid, 1), status=status, latitude_deg=47.0, longitude_deg=8.0, received_at_s=at_s
    )  # fmt: skip
    track = new_track(("rid", sysid, 1, None, 0), report, at_s, filtered=False)
    track.first_heard_m = distance_m
    return track


def comes(watch: DetectionWatch, *tracks: Track, at_s: float, flying: bool = True) -> None:
    """They are heard, and are as near as a stranger must be heard."""
    watch.hear({track.key: track for track in tracks}, flying, at_s)
    watch.near(tracks)


@pytest.fixture
def watch() -> Iterator[DetectionWatch]:
    """In flight since time zero."""
    made = DetectionWatch()
    made.hear({}, True, 0.0)
    yield made


def test_nothing_is_said_without_evidence(watch: DetectionWatch) -> None:
    for sysid, at_s in ((2, 20.0), (3, 21.0)):
        comes(watch, heard(sysid, at_s, 50.0), at_s=at_s)
    judged = watch.judge(500.0, True)
    assert (judged.given_m, judged.short, watch.warning(judged, 30.0)) == (None, False, "")
    comes(watch, heard(4, 22.0, 60.0), at_s=22.0)
    judged = watch.judge(500.0, True)
    assert judged.given_m == pytest.approx(55.0) and judged.short
    assert watch.warning(judged, 30.0) == "Remote ID heard from 55 m, 500 m needed"


@pytest.mark.parametrize(
    ("track", "flying"),
    [
        (heard(9, 5.0, 50.0), True),  # was in range when we took off
        (heard(9, 20.0, 50.0, status=1), True),  # stands on the ground
        (heard(9, 20.0, None), True),  # we did not know where we were
        (heard(9, 20.0, 50.0), False),  # we stand ourselves
        (heard(2, 20.0, 50.0), True),  # was heard before
    ],
)
def test_what_is_no_evidence(watch: DetectionWatch, track: Track, flying: bool) -> None:
    comes(watch, *(heard(sysid, 11.0, 300.0) for sysid in (2, 3, 4)), at_s=11.0)
    comes(watch, track, at_s=20.0, flying=flying)
    for _ in range(4):
        comes(watch, track, at_s=21.0, flying=flying)
    assert watch.given_m == 300.0


def test_who_comes_from_behind_a_house_does_not_shrink_the_air(watch: DetectionWatch) -> None:
    distances = [300.0, 310.0, 290.0, 305.0, 20.0, 35.0]
    for sysid, distance in enumerate(distances, start=2):
        comes(watch, heard(sysid, 20.0, distance), at_s=20.0 + sysid)
    assert watch.given_m is None or watch.given_m > 300.0


@given(st.lists(st.floats(400.0, 2e7), max_size=60), st.lists(st.floats(10.0, 100.0), min_size=3, max_size=9))
def test_reports_from_far_away_do_not_hide_that_those_who_come_near_are_heard_late(
    far_m: list[float], late_m: list[float]
) -> None:
    watch = DetectionWatch()
    watch.hear({}, True, 0.0)
    far = [heard(100 + k, 20.0, distance_m) for k, distance_m in enumerate(far_m)]
    watch.hear({track.key: track for track in far}, True, 20.0)
    assert watch.given_m is None, "whoever stays away shows nothing"
    late = [heard(2 + k, 21.0, distance_m) for k, distance_m in enumerate(late_m)]
    watch.hear({track.key: track for track in (*far, *late)}, True, 21.0)
    watch.near(late)
    judged = watch.judge(400.0, True)
    assert judged.short and judged.given_m is not None and judged.given_m <= max(late_m)


def test_who_was_heard_in_time_is_evidence_once_it_comes_near_and_forgotten_with_its_track(
    watch: DetectionWatch,
) -> None:
    tracks = [heard(sysid, 20.0, 500.0) for sysid in (2, 3, 4, 5)]
    watch.hear({track.key: track for track in tracks}, True, 20.0)
    assert watch.given_m is None
    watch.hear({track.key: track for track in tracks[:3]}, True, 40.0)  # the last one is gone
    for _ in range(2):
        watch.near(tracks[:2])
    watch.near(tracks[3:])
    assert watch.given_m is None, "two, and each counts once"
    watch.near(tracks[2:3])
    assert watch.given_m == 500.0


def test_judgement_has_hysteresis_and_warnings_have_a_pause(watch: DetectionWatch) -> None:
    tracks = [heard(sysid, 20.0, 100.0) for sysid in (2, 3, 4)]
    comes(watch, *tracks, at_s=20.0)
    assert not watch.judge(100.0, True).short
    assert watch.judge(101.0, True).short
    assert watch.judge(95.0, True).short
    assert watch.judge(500.0, False).short  # nobody there: as before, and nobody to need it
    assert not watch.judge(90.0, True).short
    assert not watch.judge(500.0, False).short
    short = watch.judge(120.0, True)
    said = [watch.warning(short, float(now)) for now in range(30, 120)]
    assert np.flatnonzero(said).tolist() == [0, 60]
    assert all(len(text) <= 50 for text in said)


def neighbours_ahead(flight: Flight, sysids: tuple[int, ...], distance_m: float, north_mps: float) -> None:
    """Let others be heard from now on, from a distance ahead on both sides of the way."""
    north = float(flight.vehicle.position[0]) + distance_m
    for k, sysid in enumerate(sysids):
        other = Emulated(sysid, ned_m=(north, 10.0 * (k - 1), -50.0))
        other.velocity = np.array([north_mps, 0.0, 0.0])
        flight.others.append(lambda now_s, other=other: other.remote_id(now_s) + (other.advance(STEP_S) or b""))  # type: ignore[misc]


@pytest.mark.parametrize(("heard_from_m", "north_mps", "short"), [(30.0, 10.0, True), (400.0, -10.0, False)])
def test_an_air_that_gives_too_little_is_said_once(heard_from_m: float, north_mps: float, short: bool) -> None:
    flight = Flight(settings=config(2000.0))
    flight.step(150)
    before = flight.outputs[-1].decision.detection
    assert before is not None and before.given_m is None and before.needed_m > 350.0  # whoever says nothing of itself
    neighbours_ahead(flight, (5, 6, 7), heard_from_m, north_mps)
    flight.step(200)
    detection = flight.outputs[-1].decision.detection
    assert detection is not None and detection.given_m is not None
    assert (detection.given_m < detection.needed_m) == detection.short == short
    texts = [text for output in flight.outputs for text in output.warnings]
    assert [message.text.rstrip(b"\0").decode() for message in flight.heard("STATUSTEXT")] == texts
    assert len(texts) == short


@pytest.mark.parametrize(("distance_m", "north_mps"), [(1e7, 0.0), (2000.0, -50.0), (800.0, 0.0)])
def test_ghosts_that_are_told_of_from_far_away_do_not_silence_that_others_are_heard_late(
    distance_m: float, north_mps: float
) -> None:
    flight = Flight(settings=config(2000.0))
    flight.step(150)
    for first in range(20, 29, 3):
        neighbours_ahead(flight, (first, first + 1, first + 2), distance_m, north_mps)
    flight.step(20)
    neighbours_ahead(flight, (5, 6, 7), 30.0, 10.0)
    flight.step(20)
    detection = flight.outputs[-1].decision.detection
    assert detection is not None and detection.short and detection.given_m is not None and detection.given_m < 100.0
