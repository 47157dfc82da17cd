"""Doubt widens discs and drops nobody; floods are let in by measure."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from ridlink.geodesy import moved
from ridlink.traffic.doubt import MOST_M, Doubt
from ridlink.traffic.flood import MOST_SOURCES, NewcomerGate
from ridlink.traffic.position_filter import PositionFilter
from tests.traffic.reports import HERE, OWN, SETTINGS, picture, report, still


def test_doubt_decays_and_demands_no_more_than_silence() -> None:
    doubt = Doubt()
    assert doubt.widening_m(0.0) == 0.0 and MOST_M == 40.0
    doubt.add(20.0, 0.0)
    assert [doubt.widening_m(t) for t in (0.0, 5.0, 10.0, 11.0)] == pytest.approx([20.0, 10.0, 0.0, 0.0])
    assert doubt.widening_m(-5.0) == 20.0, "never more than it was"
    doubt.add(5.0, 5.0)
    assert doubt.widening_m(5.0) == pytest.approx(10.0), "a smaller doubt takes nothing back"
    doubt.add(1e9, 6.0)
    assert doubt.widening_m(6.0) == MOST_M
    slight = Doubt()
    slight.add(1.0, 3.0)
    assert slight.widening_m(3.0) == 1.0


def test_f07_a_sender_that_moves_as_its_figures_cannot_is_widened_and_kept() -> None:
    made = picture()
    for k in range(20):
        when = {"timestamp_s": 100.0 + 0.1 * k, "received_at_s": 10.0 + 0.1 * k}
        made.receive("rid", still(north=100.0 + 8.0 * (k % 2), **when))
    (track,) = made.tracks.values()
    assert track.doubt.widening_m(11.9) == pytest.approx(8.0 - 3.0, abs=0.5)
    wider = made.snapshot(OWN, 11.9).widening_m[0]
    honest = picture()
    for k in range(20):
        honest.receive("rid", still(timestamp_s=100.0 + 0.1 * k, received_at_s=10.0 + 0.1 * k))
    assert wider > honest.snapshot(OWN, 11.9).widening_m[0] + 4.0


def test_f07_a_teleport_keeps_both_places_for_three_seconds_and_the_new_one_is_doubted() -> None:
    made = picture()
    for k in range(10):
        made.receive("rid", still(north=300.0, timestamp_s=100.0 + 0.1 * k, received_at_s=10.0 + 0.1 * k))
    for k in range(10, 41):
        made.receive("rid", still(north=-300.0, timestamp_s=100.0 + 0.1 * k, received_at_s=10.0 + 0.1 * k))
        made.drop_silent(10.0 + 0.1 * k)
    snapshot = made.snapshot(OWN, 14.0)
    assert sorted(snapshot.position_ned_m[:, 0]) == pytest.approx([-300.0, 300.0], abs=1.0), "never the mean of both"
    assert made.counters["identity_doubtful"] == 1
    tentative = next(track for track in made.tracks.values() if track.key[-1] == 1)
    assert tentative.doubt.widening_m(14.0) > 0.0


def test_f10_a_silent_track_grows_faster_and_faster_up_to_a_cap() -> None:
    made = picture(still())
    growth = [made.snapshot(OWN, 10.0 + age).widening_m[0] for age in (0.0, 0.1, 1.0, 3.0, 5.0, 10.0, 100.0)]
    assert growth == pytest.approx([0.0, 0.025, 2.5, 22.5, 62.5, 185.0, 185.0])
    assert made.snapshot(OWN, 9.0).widening_m[0] == 0.0, "a report from the future is one of now"


def test_f12_newcomers_are_let_in_by_measure_and_each_source_has_its_own() -> None:
    gate = NewcomerGate(10.0)
    assert [gate.admit("a", 0.0) for _ in range(12)] == [True] * 10 + [False] * 2
    assert gate.admit("b", 0.0)
    assert [gate.admit("a", 0.3) for _ in range(4)] == [True] * 3 + [False]
    assert gate.admit("a", 0.2) is False, "a clock that goes back buys nothing"


def test_f12_many_sources_share_a_bucket_that_is_nobody_elses() -> None:
    gate = NewcomerGate(5.0)
    admitted = sum(gate.admit(k, 0.0) for k in range(10 * MOST_SOURCES))
    assert admitted == MOST_SOURCES + 5 == 261
    assert [gate.admit(0, 0.0) for _ in range(5)] == [True] * 4 + [False], "whoever was there first"


def test_f12_a_source_that_asks_no_more_makes_room() -> None:
    gate = NewcomerGate(5.0)
    for k in range(2 * MOST_SOURCES):
        gate.admit(k, 0.001 * k)
    assert [gate.admit("soon", 0.999) for _ in range(5)] == [True] * 2 + [False] * 3, "the others may ask again yet"
    assert [gate.admit("later", 1.0) for _ in range(6)] == [True] * 5 + [False], "a bucket of its own"
    assert [gate.admit("one more", 1.0) for _ in range(3)] == [False] * 3, "in place of one that is full again, no more"


def test_f12_the_picture_refuses_newcomers_beyond_the_measure_and_hears_who_is_known() -> None:
    made = picture(report(sysid=200, timestamp_s=99.0), settings=replace(SETTINGS, new_per_second=50.0))
    for k in range(200):
        made.receive("rid", report(sysid=k % 100, id_or_mac=b"ghost%d" % k), source="air")
    made.receive("rid", report(sysid=200, north=99.0, received_at_s=10.1), source="air")
    assert len(made) == 51
    assert made.counters["newcomer_refused"] == 150
    assert next(iter(made.tracks.values())).received_at_s == 10.1


def test_f12_forged_urgency_displaces_nobody_who_has_long_been_in_conflict() -> None:
    made = picture(report(sysid=200, north=150.0), settings=replace(SETTINGS, max_tracks=4))
    made.receive("rid", report(sysid=200, north=120.0, timestamp_s=103.0, received_at_s=13.0))
    made.snapshot(OWN, 13.0)
    (real,) = made.tracks.values()
    real.in_conflict = True
    for k in range(20):
        made.receive("rid", report(sysid=10 + k, north=20.0 - 0.1 * k, received_at_s=13.0))
    assert real in made.tracks.values()
    assert len(made) == 4
    assert made.counters["track_evicted"] == 3, "the others do give way to whoever is nearer"


def test_f12_half_of_the_picture_can_always_be_taken() -> None:
    made = picture(*(report(sysid=k, north=100.0 + k) for k in range(1, 5)), settings=replace(SETTINGS, max_tracks=4))
    for k in range(1, 5):
        made.receive("rid", report(sysid=k, north=80.0 + k, timestamp_s=103.0, received_at_s=13.0))
    made.snapshot(OWN, 13.0)
    for track in made.tracks.values():
        track.in_conflict = True
    for k in range(20):
        made.receive("rid", report(sysid=50 + k, north=20.0 - 0.1 * k, received_at_s=13.0))
    assert sum(track.key[1] >= 50 for track in made.tracks.values()) == 2


def test_f20_the_measured_interval_leaves_with_the_snapshot() -> None:
    made = picture()
    for k in range(40):
        when = {"timestamp_s": 100.0 + 0.3 * k, "received_at_s": 10.0 + 0.3 * k}
        made.receive("rid", still(**when))
    assert made.snapshot(OWN, 22.0).interval_s[0] == pytest.approx(0.3, abs=0.01)


def test_without_filtering_doubt_is_seen_all_the_same() -> None:
    unfiltered = PositionFilter(time_constant_s=0.0)
    for k, north in enumerate((0.0, 1.0, 30.0)):
        place = moved(*HERE, north, 0.0)
        assert unfiltered.update(*place, (10.0, 0.0, 0.0), 3.0, 0.1 * k) == pytest.approx(place, abs=1e-9)
    assert unfiltered.resets == 1
    assert unfiltered.innovation_m == pytest.approx(28.0, abs=0.1)
    assert math.isfinite(unfiltered.latitude_deg)
