"""Tracks: what moves them, what only completes them, and what is not allowed to touch them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from ridlink.remote_id.report import RemoteIdReport
from ridlink.traffic.track import Relation, Track, Update, hours_apart_s, new_track

REPORT = RemoteIdReport(
    source=(5, 1), status=2, latitude_deg=47.0, longitude_deg=8.0, velocity_ned_mps=(3.0, 4.0, 0.0),
    speed_horizontal_mps=5.0, horizontal_error_m=3.0, update_interval_s=0.1, timestamp_s=100.0, received_at_s=10.0,
)  # fmt: skip


def track(report: RemoteIdReport = REPORT, *, filtered: bool = False) -> Track:
    return new_track(("rid", *report.key, 0), report, report.received_at_s, filtered=filtered)


def update(at: Track, report: RemoteIdReport) -> Update:
    return at.update(report, report.received_at_s, 40.0)


@given(st.floats(0, 3600), st.floats(-1799, 1799))
def test_times_past_the_hour_wrap(earlier: float, apart: float) -> None:
    assert hours_apart_s((earlier + apart) % 3600.0, earlier) == pytest.approx(apart, abs=1e-6)


def test_a_newer_report_moves() -> None:
    moved = track()
    assert update(moved, replace(REPORT, latitude_deg=47.001, timestamp_s=100.1, received_at_s=10.1)) is Update.MOVED
    assert (moved.latitude_deg, moved.measured_at_s, moved.received_at_s) == (47.001, 10.1, 10.1)
    assert moved.age_s(10.3) == pytest.approx(0.2)
    assert moved.age_s(10.0) == 0.0


def test_f05_across_the_full_hour() -> None:
    moved = track(replace(REPORT, timestamp_s=3599.9))
    assert update(moved, replace(REPORT, timestamp_s=0.1, received_at_s=10.2)) is Update.MOVED
    assert update(moved, replace(REPORT, timestamp_s=3599.9, received_at_s=10.3)) is Update.OLDER


def test_f06_a_repeat_changes_and_refreshes_nothing() -> None:
    seen = track()
    before = seen.report
    for later in (0.5, 2.0, 4.0):
        repeat = replace(REPORT, latitude_deg=47.9, received_at_s=10.0 + later)
        assert update(seen, repeat) is Update.REPEATED
    assert seen.report == before
    assert (seen.latitude_deg, seen.received_at_s) == (47.0, 10.0)
    assert seen.expired(15.1)


def test_an_older_report_never_rolls_back() -> None:
    seen = track()
    assert update(seen, replace(REPORT, latitude_deg=46.0, timestamp_s=99.9, received_at_s=10.1)) is Update.OLDER
    assert seen.latitude_deg == 47.0


def test_a_separation_completes_the_same_instant_once() -> None:
    seen = track()
    complete = replace(REPORT, extended=True, airframe_size_m=0.6, horizontal_error_m=2.0)
    assert update(seen, complete) is Update.COMPLETED
    assert seen.report.airframe_size_m == 0.6
    assert update(seen, complete) is Update.COMPLETED
    assert update(seen, replace(complete, received_at_s=11.0)) is Update.REPEATED
    # Late, behind a duplicate of its LOCATION: still what completes it, and still no refreshment.
    late = replace(complete, horizontal_error_m=2.5, received_at_s=11.0)
    assert update(seen, late) is Update.COMPLETED
    assert seen.report.horizontal_error_m == 2.5
    assert seen.received_at_s == seen.report.received_at_s == 10.0
    elsewhere = replace(late, latitude_deg=47.5, airframe_size_m=9.0)
    assert update(seen, elsewhere) is Update.REPEATED


def test_without_timestamps_receive_time_tells_instants_apart() -> None:
    seen = track(replace(REPORT, timestamp_s=None))
    assert update(seen, replace(REPORT, timestamp_s=None, received_at_s=10.1)) is Update.MOVED


def test_a_report_without_a_position_leaves_the_track_coasting() -> None:
    seen = track()
    nowhere = replace(REPORT, latitude_deg=None, longitude_deg=None, timestamp_s=101.0, received_at_s=11.0)
    assert update(seen, nowhere) is Update.NO_POSITION
    assert seen.received_at_s == 10.0
    with pytest.raises(ValueError, match="position"):
        new_track(("rid", 1, 1, None, 0), nowhere, 0.0, filtered=True)


def test_f10_fast_senders_are_dropped_after_five_seconds_and_slow_ones_after_ten() -> None:
    fast = track()
    assert not fast.expired(14.9) and fast.expired(15.1)
    fast.in_conflict = True
    assert not fast.expired(19.9) and fast.expired(20.1)
    slow = track(replace(REPORT, update_interval_s=1.0))
    assert not slow.expired(19.9) and slow.expired(20.1)
    silent = replace(REPORT, update_interval_s=None)
    untold = track(silent)
    assert not untold.expired(14.9) and untold.expired(15.1), "heard once, as every one of a flood"
    update(untold, replace(silent, timestamp_s=101.0, received_at_s=11.0))
    assert not untold.expired(20.9) and untold.expired(21.1)
    for tenth in range(1, 4):
        update(untold, replace(silent, timestamp_s=101.0 + tenth / 10.0, received_at_s=11.0 + tenth / 10.0))
    assert not untold.expired(16.2) and untold.expired(16.4), "it is a fast one"
    once_a_second = track()
    for second in range(1, 4):
        update(once_a_second, replace(REPORT, timestamp_s=100.0 + second, received_at_s=10.0 + second))
    assert not once_a_second.expired(22.9) and once_a_second.expired(23.1), "whatever it tells"


def relation(at: Track, report: RemoteIdReport, *, trusted_clock: bool = False) -> Relation:
    return at.relation(report, trusted_clock=trusted_clock, unknown_error_m=40.0, unknown_speed_mps=30.0)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, Relation.FOLLOWS),  # 3 m of error each, and one and a half times 30 m/s for a second
        ({"latitude_deg": 47.0 + 50.0 / 111_000}, Relation.FOLLOWS),
        ({"latitude_deg": 47.0 + 52.0 / 111_000}, Relation.STRANGE),
        ({"latitude_deg": 47.0 + 80.0 / 111_000, "speed_horizontal_mps": 50.0}, Relation.FOLLOWS),
        ({"latitude_deg": 47.0 + 80.0 / 111_000, "horizontal_error_m": None}, Relation.FOLLOWS),
        ({"timestamp_s": None}, Relation.FOLLOWS),
        ({"timestamp_s": None, "latitude_deg": 47.1}, Relation.STRANGE),
        ({"timestamp_s": 100.0}, Relation.FOLLOWS),  # the same instant, perhaps with its extension
        ({"timestamp_s": 100.0, "latitude_deg": 47.1}, Relation.OUTDATED),
        ({"timestamp_s": 99.9}, Relation.OUTDATED),
        ({"timestamp_s": 103.0}, Relation.FOLLOWS),
        ({"timestamp_s": 103.1}, Relation.STRANGE),  # two seconds ahead of what has passed
        ({"latitude_deg": None, "longitude_deg": None}, Relation.STRANGE),
        ({"longitude_deg": None}, Relation.STRANGE),
    ],
)
def test_f07_what_a_report_is_to_a_track(fields: dict[str, object], expected: Relation) -> None:
    assert relation(track(), replace(REPORT, **({"timestamp_s": 101.0, "received_at_s": 11.0} | fields))) is expected


def test_f07_how_far_a_vehicle_may_have_come() -> None:
    at_once = {"timestamp_s": 100.5, "received_at_s": 10.0}
    assert relation(track(), replace(REPORT, **at_once, latitude_deg=47.0 + 5.0 / 111_000)) is Relation.FOLLOWS
    assert relation(track(), replace(REPORT, **at_once, latitude_deg=47.0 + 8.0 / 111_000)) is Relation.STRANGE
    fast, away = track(replace(REPORT, speed_horizontal_mps=50.0)), {"timestamp_s": 101.0, "received_at_s": 11.0}
    slowed = replace(REPORT, **away, latitude_deg=47.0 + 80.0 / 111_000, speed_horizontal_mps=None)
    assert relation(fast, slowed) is Relation.FOLLOWS, "it flew 50 m/s a moment ago"
    assert relation(track(), slowed) is Relation.STRANGE


def test_a_track_begins_with_nothing_remembered_of_it() -> None:
    made = track()
    assert (made.memory, made.urgency_s, made.in_conflict, made.seen_elsewhere) == (0, 0.0, False, False)
    assert (made.began_at_s, made.interval_s, made.trusted_clock) == (10.0, 0.1, False)
    assert made.first_heard_m is None and made.doubt.widening_m(10.0) == 0.0


def test_an_interval_that_is_told_after_the_first_position_counts_at_once() -> None:
    """As all do that send RIDLINK_SEPARATION behind their LOCATION; what is measured is not overwritten."""
    bare = replace(REPORT, extended=False, update_interval_s=None)
    made = track(bare)
    assert made.interval_s == 1.0
    assert made.update(replace(bare, extended=True, update_interval_s=0.1), 10.0, 40.0) is Update.COMPLETED
    assert made.interval_s == 0.1
    later = replace(bare, timestamp_s=100.3, received_at_s=10.3)
    made.update(later, 10.3, 40.0)
    made.update(replace(later, extended=True, update_interval_s=0.1), 10.3, 40.0)
    assert made.interval_s == pytest.approx(0.1 + 0.3 * 0.2)


def test_the_interval_follows_what_is_measured_by_three_tenths() -> None:
    made = track()
    update(made, replace(REPORT, timestamp_s=100.3, received_at_s=10.3))
    assert made.interval_s == pytest.approx(0.1 + 0.3 * 0.2)
    update(made, replace(REPORT, timestamp_s=111.0, received_at_s=21.0))
    assert made.interval_s == pytest.approx(0.16), "an outage is no interval"


def test_unfiltered_every_report_is_taken_as_it_is() -> None:
    made = track()
    for k in range(1, 5):
        latitude = 47.0 + (k % 2) * 1.0 / 111_000
        update(made, replace(REPORT, latitude_deg=latitude, timestamp_s=100.0 + 0.1 * k, received_at_s=10.0 + 0.1 * k))
        assert made.latitude_deg == pytest.approx(latitude, abs=1e-9)


@pytest.mark.parametrize("missing", ["latitude_deg", "longitude_deg"])
def test_half_a_position_is_none(missing: str) -> None:
    half = replace(REPORT, **{missing: None}, timestamp_s=101.0, received_at_s=11.0)
    assert update(track(), half) is Update.NO_POSITION
    with pytest.raises(ValueError, match="position"):
        new_track(("rid", 5, 1, None, 0), half, 11.0, filtered=True)


def test_reports_without_a_time_are_dated_by_their_receipt() -> None:
    for first, then in ((None, 101.0), (100.0, None), (None, None)):
        made = track(replace(REPORT, timestamp_s=first))
        assert update(made, replace(REPORT, timestamp_s=then, received_at_s=10.0)) is not Update.MOVED
        assert update(made, replace(REPORT, timestamp_s=then, received_at_s=10.1)) is Update.MOVED


def test_f05_a_clock_that_is_known_to_be_right_is_believed_against_one_that_is_not() -> None:
    seen, earlier = track(), replace(REPORT, timestamp_s=99.0, received_at_s=11.0)
    assert relation(seen, earlier) is Relation.OUTDATED
    assert relation(seen, earlier, trusted_clock=True) is Relation.STRANGE
    newer = replace(REPORT, timestamp_s=100.5, received_at_s=10.5)
    assert relation(track(), newer, trusted_clock=True) is Relation.FOLLOWS
    seen.trusted_clock = True
    assert relation(seen, earlier, trusted_clock=True) is Relation.OUTDATED


def test_nowhere_is_infinitely_far() -> None:
    nowhere = replace(REPORT, longitude_deg=None)
    seen = track()
    assert seen.metres_to(REPORT) == 0.0 and seen.metres_to(nowhere) == math.inf
    seen.report = nowhere
    assert seen.metres_to(REPORT) == math.inf
    seen.report = replace(REPORT, latitude_deg=None)
    assert seen.metres_to(REPORT) == math.inf


def test_unknown_velocity_is_no_velocity() -> None:
    blind = track(replace(REPORT, velocity_ned_mps=None))
    assert blind.velocity_ned_mps == (0.0, 0.0, 0.0)


def test_on_the_ground() -> None:
    assert replace(REPORT, status=1).on_ground
    assert not REPORT.on_ground


def test_the_accuracy_code_bounds_the_filter_where_nothing_better_is_known() -> None:
    for bound, smoothed in ((30.0, True), (1.0, False)):
        seen = track(replace(REPORT, velocity_ned_mps=(0.0, 0.0, 0.0)), filtered=True)
        report = replace(
            REPORT, velocity_ned_mps=(0.0, 0.0, 0.0), latitude_deg=47.0001, timestamp_s=100.1, received_at_s=10.1,
            horizontal_error_m=None, accuracy_bound_m=bound,
        )  # fmt: skip
        update(seen, report)
        assert (seen.latitude_deg < 47.0001) is smoothed
