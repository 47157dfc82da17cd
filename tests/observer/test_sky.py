"""Who is in the air: joined, named, merged, forgotten, and never more than there is room for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.observer import Sky
from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.bridge import messages_of
from ridlink.remote_id.quantities import FieldRejects
from ridlink.traffic.picture import TrafficPicture
from tests.observer.flights import HOME, Flyer, frames, seen
from tests.traffic.reports import SETTINGS

ONE = Flyer(1, (0.0, 0.0), (10.0, 0.0), b"ALPHA")
TWO = Flyer(2, (400.0, 30.0), (-10.0, 0.0))
FIRST = np.array([0])


def test_everybody_is_where_he_says_in_metres_about_the_origin() -> None:
    scene = seen([ONE, TWO], 3.0).at(3.5)
    assert scene.names == ("ALPHA", "2/1")
    assert scene.position_ne_m == pytest.approx(np.array([ONE.at(3.5), TWO.at(3.5)]), abs=0.05)
    assert scene.velocity_ne_mps == pytest.approx(np.array([[10.0, 0.0], [-10.0, 0.0]]), abs=0.02)
    assert scene.error_bound_m == pytest.approx([10.5, 10.5])
    assert scene.age_s == pytest.approx([0.6, 0.6])
    assert scene.interval_s == pytest.approx([0.1, 0.1])


@pytest.mark.parametrize("extended", [True, False])
@pytest.mark.parametrize("period_s", [0.1, 0.7, 7.0])
def test_an_interval_is_the_one_that_the_daemon_counts(period_s: float, extended: bool) -> None:
    """Told or not, and measured: after every frame."""
    sky, assembler, picture = Sky(), ReportAssembler(), TrafficPicture(SETTINGS)
    for time_s, frame in frames([replace(ONE, extended=extended)], 5.0 * period_s, period_s=period_s):
        sky.receive(frame, time_s)
        for part in messages_of(decode_message(frame), FieldRejects()):
            report = assembler.receive((frame.sysid, frame.compid), part, time_s)
            if report is not None:
                picture.receive("rid", report)
        intervals = [one.interval_s for one in sky.aircraft.values()]
        assert intervals == [track.interval_s for track in picture.tracks.values()]
    assert len(intervals) == 1


def test_the_first_position_is_the_origin_unless_one_is_given() -> None:
    sky = Sky()
    for time_s, frame in frames([TWO], 0.2):
        sky.receive(frame, time_s)
    assert sky.at(0.0).position_ne_m == pytest.approx(np.zeros((1, 2)), abs=2.0)


def test_what_a_stock_sender_does_not_say_is_unknown_and_never_zero() -> None:
    scene = seen([replace(TWO, extended=False)], 1.0).at(1.0)
    assert np.isnan([scene.error_bound_m[0], scene.airframe_m[0], scene.vertical_error_m[0]]).all()
    assert scene.accuracy_bound_m[0] > 0.0


def test_who_falls_silent_is_forgotten_and_named() -> None:
    sky = seen([ONE, TWO], 1.0, forget_after_s=5.0)
    assert not sky.forget_silent(5.5)
    for time_s, frame in frames([ONE], 8.0):
        sky.receive(frame, time_s)
    assert [one.name for one in sky.forget_silent(8.0)] == ["2/1"]
    assert sky.at(8.0).names == ("ALPHA",)


def test_one_aircraft_heard_directly_and_relayed_is_one() -> None:
    relayed = replace(ONE, sysid=200, id_or_mac=b"relay".ljust(20, b"\0"))
    sky = seen([ONE, relayed], 2.0)
    assert [one.name for one in sky.aircraft.values()] == ["ALPHA"]


def test_a_relay_that_says_the_same_of_the_same_instant_is_no_second_aircraft() -> None:
    anonymous = replace(ONE, identity=None)
    relayed = replace(anonymous, sysid=200, id_or_mac=b"relay".ljust(20, b"\0"))
    sky = seen([anonymous, relayed], 2.0)
    assert [one.name for one in sky.aircraft.values()] == ["1/1"]
    assert sky.at(2.0).interval_s == pytest.approx([0.1], abs=0.01), "heard twice is not twice as often"


def test_a_late_repetition_does_not_move_an_aircraft_in_time() -> None:
    sky = Sky(origin=HOME)
    for time_s, frame in frames([ONE], 2.0):
        sky.receive(frame, time_s)
    again = [frame for time_s, frame in frames([ONE], 2.0) if time_s == 1.9]
    for frame in again:
        sky.receive(frame, 2.4)
    assert sky.at(2.4).age_s == pytest.approx([0.5])


def test_a_late_extension_takes_nobody_back_to_where_it_belongs() -> None:
    """The vehicle's own RIDLINK_SEPARATION comes after a relay has told where the vehicle has flown since."""
    relayed = replace(ONE, sysid=200, id_or_mac=b"relay".ljust(20, b"\0"))
    *direct, extension = (frame for _, frame in frames([ONE], 0.1))
    sky = Sky(origin=HOME)
    for frame in direct:
        sky.receive(frame, 0.0)
    for time_s, frame in frames([relayed], 0.3):
        sky.receive(frame, time_s)
    assert sky.receive(extension, 0.25) is None
    assert sky.at(0.25).position_ne_m == pytest.approx(np.array([ONE.at(0.25)]), abs=0.05)


def test_two_that_turn_out_to_be_one_are_merged_into_the_first() -> None:
    late = replace(ONE, sysid=200, identity_from_s=1.0, id_or_mac=b"relay".ljust(20, b"\0"))
    behind = replace(late, start_ne_m=(-1.0, 0.0))
    assert len(seen([ONE, behind], 0.9).aircraft) == 2
    sky = seen([ONE, behind], 2.0)
    assert [(one.name, one.number) for one in sky.aircraft.values()] == [("ALPHA", 1)]
    assert sky.at(2.0).merged == {2}


def test_a_part_of_a_scene_is_a_scene() -> None:
    scene = seen([ONE, TWO, replace(TWO, sysid=3, altitude_m=700.0)], 1.0).at(1.0)
    part = scene.only(np.array([True, False, True]))
    assert part.names == (scene.names[0], scene.names[2]) and part.numbers == (scene.numbers[0], scene.numbers[2])
    assert part.position_ne_m == pytest.approx(scene.position_ne_m[[0, 2]]) and part.avoiding.shape == (2,)
    assert scene.apart_at(FIRST, FIRST + 2) and part.apart_at(FIRST, FIRST + 1)


def test_who_missed_reports_can_be_left_out() -> None:
    sky = seen([ONE], 1.0)
    assert len(sky.at(1.1, missed=3.0)) == 1
    assert len(sky.at(1.5, missed=3.0)) == 0
    assert len(sky.at(1.5)) == 1


def test_two_aircraft_with_one_identity_stay_two() -> None:
    twin = replace(TWO, identity=b"ALPHA")
    assert sorted(one.name for one in seen([ONE, twin], 1.0).aircraft.values()) == ["ALPHA", "ALPHA#2"]


def test_names_are_inert() -> None:
    hostile = replace(ONE, identity=b"\x1b[2J<img>\n")
    [one] = seen([hostile], 0.5).aircraft.values()
    assert one.name == "\\x1b[2J<img>\\x0a"


def test_whoever_was_heard_longest_ago_gives_way() -> None:
    crowd = [Flyer(sysid, (10.0 * sysid, 0.0), (0.0, 1.0)) for sysid in range(1, 40)]
    sky = seen(crowd, 0.3, max_aircraft=20)
    assert len(sky.aircraft) == 20


def test_who_stands_on_the_ground_is_not_in_the_air() -> None:
    sky = seen([ONE], 0.5)
    [one] = sky.aircraft.values()
    one.report = structs.replace(one.report, status=1)
    assert len(sky.at(0.5)) == 0


def test_heights_that_are_known_to_differ_are_apart_and_unknown_ones_are_not() -> None:
    high = replace(TWO, altitude_m=700.0)
    assert seen([ONE, high], 1.0).at(1.0).apart_at(FIRST, FIRST + 1)
    assert not seen([ONE, replace(high, extended=False)], 1.0).at(1.0).apart_at(FIRST, FIRST + 1)
    assert not seen([ONE, TWO], 1.0).at(1.0).apart_at(FIRST, FIRST + 1)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.binary(max_size=120), max_size=20))
def test_no_bytes_whatever_raise(datagrams: list[bytes]) -> None:
    sky = Sky()
    for number, data in enumerate(datagrams):
        for found in parse_datagram(b"\xfd" + data, CRC_EXTRAS):
            if isinstance(found, Frame):
                sky.receive(found, float(number))
    assert np.isfinite(sky.at(1e3).position_ne_m).all()
