"""The join of LOCATION, RIDLINK_SEPARATION and BASIC_ID into reports."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.messages import BasicId, Location, RemoteIdMessage, SelfId, Separation, System
from ridlink.remote_id.report import RemoteIdReport

SOURCE = (7, 1)
HERE = Location(latitude_deg=47.4, longitude_deg=8.5, timestamp_s=10.0, horizontal_accuracy=10)
ERRORS = Separation(timestamp_s=10.0, horizontal_error_m=30.0, airframe_size_m=0.6, flags=1)


def one(message: RemoteIdMessage, at_s: float = 100.0, source: tuple[int, int] = SOURCE) -> RemoteIdReport:
    report = ReportAssembler().receive(source, message, at_s)
    assert report is not None
    return report


def test_a_stock_sender_gives_a_report_without_extension() -> None:
    report = one(HERE)
    assert (report.latitude_deg, report.longitude_deg, report.received_at_s) == (47.4, 8.5, 100.0)
    assert not report.extended and not report.avoiding
    assert report.horizontal_error_m is report.airframe_size_m is report.commanded_ned_mps is None
    assert report.accuracy_bound_m == pytest.approx(12.256, abs=1e-3)
    assert report.key == (7, 1, None)


def test_the_separation_that_follows_completes_the_same_report() -> None:
    assembler = ReportAssembler()
    first = assembler.receive(SOURCE, HERE, 100.0)
    completed = assembler.receive(SOURCE, ERRORS, 100.02)
    assert first is not None and completed is not None
    assert (
        structs.replace(completed, extended=False, avoiding=False, horizontal_error_m=None, airframe_size_m=None)
        == first
    )
    assert completed.extended and completed.avoiding and completed.horizontal_error_m == 30.0
    assert completed.received_at_s == 100.0


def test_the_separation_that_comes_first_is_joined_at_once_and_its_repeat_says_nothing() -> None:
    assembler = ReportAssembler()
    assert assembler.receive(SOURCE, ERRORS, 99.99) is None
    report = assembler.receive(SOURCE, HERE, 100.0)
    assert report is not None and report.extended
    assert assembler.receive(SOURCE, ERRORS, 100.01) is None


def test_a_lost_separation_is_bridged_for_a_second_and_a_half() -> None:
    for age_s, extended in ((1.4, True), (1.6, False)):
        assembler = ReportAssembler()
        assembler.receive(SOURCE, ERRORS, 100.0)
        report = assembler.receive(SOURCE, structs.replace(HERE, timestamp_s=10.0 + age_s), 100.0 + age_s)
        assert report is not None and report.extended is extended


def test_an_equal_timestamp_joins_late_but_not_an_hour_later() -> None:
    for age_s, extended in ((3.0, True), (3600.0, False)):
        assembler = ReportAssembler()
        assembler.receive(SOURCE, ERRORS, 100.0)
        report = assembler.receive(SOURCE, HERE, 100.0 + age_s)
        assert report is not None and report.extended is extended


def test_a_separation_of_another_instant_waits_for_its_location() -> None:
    assembler = ReportAssembler()
    assembler.receive(SOURCE, HERE, 100.0)
    assert assembler.receive(SOURCE, structs.replace(ERRORS, timestamp_s=10.1), 100.1) is None
    report = assembler.receive(SOURCE, structs.replace(HERE, timestamp_s=10.1), 100.1)
    assert report is not None and report.extended


def test_without_timestamps_neighbours_in_time_belong_together() -> None:
    for age_s, completes in ((0.1, True), (2.0, False)):
        assembler = ReportAssembler()
        assembler.receive(SOURCE, structs.replace(HERE, timestamp_s=None), 100.0)
        report = assembler.receive(SOURCE, structs.replace(ERRORS, timestamp_s=None), 100.0 + age_s)
        assert (report is not None) is completes


@pytest.mark.parametrize("other", [(8, 1), (7, 236)])
def test_nobody_speaks_for_another(other: tuple[int, int]) -> None:
    assembler = ReportAssembler()
    assembler.receive(SOURCE, HERE, 100.0)
    assert assembler.receive(other, ERRORS, 100.0) is None
    assert assembler.receive(SOURCE, structs.replace(ERRORS, id_or_mac=b"\x01" * 20), 100.0) is None
    report = assembler.receive(SOURCE, HERE, 100.1)
    assert report is not None and not report.extended


def test_identity_is_remembered_and_a_serial_number_is_kept() -> None:
    assembler = ReportAssembler()
    assembler.receive(SOURCE, BasicId(1, 2, b"SERIAL"), 100.0)
    assembler.receive(SOURCE, BasicId(2, 0, b"REGISTRATION"), 100.1)
    assembler.receive(SOURCE, BasicId(0, 0, b""), 100.2)
    assembler.receive(SOURCE, System(), 100.3)
    report = assembler.receive(SOURCE, HERE, 100.4)
    assert report is not None and (report.uas_id, report.ua_type) == (b"SERIAL", 2)


@pytest.mark.parametrize(
    ("speed", "direction", "climb", "velocity"),
    [
        (10.0, 90.0, 2.0, (0.0, 10.0, -2.0)),
        (10.0, 180.0, None, (-10.0, 0.0, 0.0)),
        (0.0, None, None, (0.0, 0.0, 0.0)),  # a hovering autopilot sends direction 361
        (0.0, 45.0, -1.0, (0.0, 0.0, 1.0)),
        (10.0, None, 0.0, None),
        (None, 90.0, 0.0, None),
    ],
)
def test_velocity_is_north_east_down(
    speed: float | None, direction: float | None, climb: float | None, velocity: tuple[float, float, float] | None
) -> None:
    report = one(Location(speed_horizontal_mps=speed, direction_deg=direction, speed_vertical_mps=climb))
    assert report.velocity_ned_mps == (None if velocity is None else pytest.approx(velocity, abs=1e-12))
    assert report.speed_horizontal_mps == speed
    if report.velocity_ned_mps is not None:
        assert math.copysign(1.0, report.velocity_ned_mps[2]) == 1.0 or report.velocity_ned_mps[2] < 0.0


def test_half_a_position_is_none() -> None:
    assert one(Location(latitude_deg=47.0)).latitude_deg is None
    assert one(Location(longitude_deg=8.0)).longitude_deg is None


def test_commanded_velocity_is_whole_or_absent() -> None:
    assembler = ReportAssembler()
    assembler.receive(SOURCE, structs.replace(ERRORS, commanded_vx_mps=1.0, commanded_vy_mps=2.0), 100.0)
    report = assembler.receive(SOURCE, HERE, 100.0)
    assert report is not None and report.commanded_ned_mps is None
    whole = structs.replace(ERRORS, commanded_vx_mps=1.0, commanded_vy_mps=2.0, commanded_vz_mps=0.0)
    report = assembler.receive(SOURCE, whole, 100.0)
    assert report is not None and report.commanded_ned_mps == (1.0, 2.0, 0.0)


def test_the_convention_decides_what_a_code_is_worth() -> None:
    report = ReportAssembler(convention="one-sigma").receive(SOURCE, HERE, 0.0)
    assert report is not None and report.accuracy_bound_m == 30.0


def test_a_flood_of_names_forgets_the_one_unheard_for_longest() -> None:
    assembler = ReportAssembler(max_sources=3)
    for sysid in (1, 2, 3):
        assembler.receive((sysid, 1), BasicId(1, 2, b"ID%d" % sysid), 0.0)
    assembler.receive((1, 1), SelfId(0, b"still here"), 0.1)
    for sysid in range(4, 250):
        assembler.receive((sysid, 1), HERE, 1.0)
        assembler.receive((1, 1), HERE, 1.0)
        assert len(assembler) == 3
    known, forgotten = assembler.receive((1, 1), HERE, 2.0), assembler.receive((2, 1), HERE, 2.0)
    assert known is not None and known.uas_id == b"ID1"
    assert forgotten is not None and forgotten.uas_id is None


def test_a_stranger_who_only_tells_stories_takes_no_place() -> None:
    assembler = ReportAssembler()
    assembler.receive(SOURCE, SelfId(0, b"hello"), 0.0)
    assembler.receive(SOURCE, System(), 0.0)
    assert len(assembler) == 0


def test_memory_for_nobody_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        ReportAssembler(max_sources=0)


MESSAGES: st.SearchStrategy[RemoteIdMessage] = st.one_of(
    st.builds(Location, timestamp_s=st.sampled_from([None, 1.0, 2.0]), latitude_deg=st.just(1.0)),
    st.builds(Separation, timestamp_s=st.sampled_from([None, 1.0, 2.0]), flags=st.integers(0, 15)),
    st.builds(BasicId, st.integers(0, 4), st.integers(0, 2), st.binary(max_size=3)),
)


@given(st.lists(st.tuples(st.integers(1, 4), MESSAGES, st.floats(0.0, 2.0)), max_size=40))
def test_every_location_and_nothing_but_locations_and_completions_reports(
    events: list[tuple[int, RemoteIdMessage, float]],
) -> None:
    assembler = ReportAssembler(max_sources=3)
    now_s = 0.0
    for sysid, message, later_s in events:
        now_s += later_s
        report = assembler.receive((sysid, 1), message, now_s)
        assert len(assembler) <= 3
        if isinstance(message, Location):
            assert report is not None and report.received_at_s == now_s
        elif report is not None:
            assert isinstance(message, Separation) and report.extended and report.timestamp_s == message.timestamp_s
