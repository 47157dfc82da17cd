"""Missions: up and down, in order and out of it, flown to the end."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ridlink.mavlink.codec import Encoder
from sitl_sim.autopilot import Start
from sitl_sim.autopilot.mission_items import MAX_ITEMS
from sitl_sim.autopilot.results import MissionResult
from tests.sitl_sim.flight import (
    COMPANION,
    GROUND_STATION,
    GUIDED,
    HOME,
    PX4_HOLD,
    PX4_MISSION,
    PX4_OFFBOARD,
    PX4_RETURN,
    START_NED_M,
    UNSUPPORTED,
    Flight,
    offboard,
    one_vehicle,
)
from tests.sitl_sim.missions import (
    ACCEPTED,
    ARM,
    AUTO,
    BRAKE,
    CAMERA,
    CONDITION_YAW,
    DELAY,
    DENIED,
    FAILED,
    JUMP,
    LAND,
    LOITER_TIME,
    MISSION_START,
    NAN,
    PAUSE_CONTINUE,
    RETURN,
    SET_CURRENT,
    SPEED,
    TAKEOFF,
    TEMPORARILY_REJECTED,
    WAYPOINT,
    advance_until,
    at_once,
    download,
    give,
    holding,
    item,
    planned,
    reached,
    start,
    to_vehicle,
    upload,
)

both = pytest.mark.parametrize("flavour", ["px4", "ardupilot"])

IN_AIR = 2
"""MAV_LANDED_STATE."""


# --- up and down ------------------------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize("name", ["MISSION_ITEM_INT", "MISSION_ITEM"])
def test_what_was_written_is_read_back(flavour: str, name: str) -> None:
    flight = holding(flavour)
    home = item(frame=0)
    items = [home, item(north=10.0, param2=1.5, param4=NAN), at_once(SPEED, param1=1.0, param2=3.0), item(LAND)]
    sent = items
    if name == "MISSION_ITEM":
        sent = [{**each, "x": each.get("x", 0) / 1e7, "y": each.get("y", 0) / 1e7} for each in items]
    assert upload(flight, sent, name) == MissionResult.ACCEPTED
    back = download(flight)
    first = 0 if flavour == "px4" else 1  # item 0 of ArduPilot is home, wherever it was said to be
    for seq, (message, wanted) in enumerate(zip(back, items, strict=True)):
        assert (message.seq, message.command) == (seq, wanted["command"])
        if seq >= first:
            tolerance = 0 if name == "MISSION_ITEM_INT" else 20  # a float has a metre at this longitude
            assert (message.x, message.y) == pytest.approx((wanted.get("x", 0), wanted.get("y", 0)), abs=tolerance)
            assert (message.z, message.frame) == (wanted.get("z", 0.0), wanted["frame"])
    assert back[1].param2 == 1.5 and math.isnan(back[1].param4) and back[2].param2 == 3.0
    if flavour == "ardupilot":
        assert back[0].z == pytest.approx(HOME.altitude_m, abs=0.01) and back[0].frame == 0
    (old_form,) = to_vehicle(flight, "MISSION_REQUEST", seq=1)
    assert old_form.name == "MISSION_ITEM" and old_form.x == pytest.approx(items[1]["x"] / 1e7, abs=1e-5)


def test_a_mission_is_cleared_and_other_kinds_are_empty() -> None:
    flight = holding("px4")
    assert upload(flight, [item()]) == ACCEPTED
    for kind in (1, 2):
        (count,) = to_vehicle(flight, "MISSION_REQUEST_LIST", mission_type=kind)
        assert (count.count, count.mission_type) == (0, kind)
        (refused,) = to_vehicle(flight, "MISSION_COUNT", count=3, mission_type=kind)
        assert (refused.type, refused.mission_type) == (MissionResult.UNSUPPORTED, kind)
        (fine,) = to_vehicle(flight, "MISSION_CLEAR_ALL", mission_type=kind)
        assert (fine.type, fine.mission_type) == (MissionResult.ACCEPTED, kind)
    assert len(download(flight)) == 1
    (cleared,) = to_vehicle(flight, "MISSION_CLEAR_ALL", mission_type=255)
    assert (cleared.type, cleared.mission_type) == (MissionResult.ACCEPTED, 255)
    assert download(flight) == []
    flight.advance(1.1)
    assert (flight.last("MISSION_CURRENT").total, flight.last("MISSION_CURRENT").mission_state) == (0, 1)
    assert start(flight) == TEMPORARILY_REJECTED
    assert flight.command(MISSION_START) == DENIED


def test_ardupilot_fails_to_start_a_mission_that_it_does_not_have() -> None:
    flight = holding("ardupilot")
    assert start(flight) == flight.command(MISSION_START) == FAILED


@both
def test_an_item_that_comes_twice_is_asked_for_again_and_one_that_comes_early_is_no_use(flavour: str) -> None:
    flight = holding(flavour)
    to_vehicle(flight, "MISSION_COUNT", count=3)
    to_vehicle(flight, "MISSION_ITEM_INT", seq=0, **item())
    (again,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=0, **item())
    assert (again.name, again.seq) == ("MISSION_REQUEST_INT" if flavour == "px4" else "MISSION_REQUEST", 1)
    (early,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=2, **item())
    if flavour == "px4":
        assert (early.name, early.seq) == ("MISSION_REQUEST_INT", 1)
    else:
        assert (early.name, early.type) == ("MISSION_ACK", MissionResult.INVALID_SEQUENCE)
    to_vehicle(flight, "MISSION_ITEM_INT", seq=1, **item())
    (done,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=2, **item())
    assert done.type == MissionResult.ACCEPTED
    (uninvited,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=3, **item())
    assert uninvited.type == MissionResult.ERROR


@both
def test_the_last_item_comes_twice_where_its_acknowledgement_was_lost(flavour: str) -> None:
    flight = holding(flavour)
    items = planned(flavour, [item(), item(north=10.0)])
    assert upload(flight, items) == ACCEPTED
    last = len(items) - 1
    (again,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=last, **items[last])
    assert again.type == (MissionResult.ACCEPTED if flavour == "px4" else MissionResult.ERROR)
    (other,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=last - 1, **items[last - 1])
    assert other.type == MissionResult.ERROR
    stranger = {"sender": Encoder(254, 191), "address": ("127.0.0.1", 50001)}
    (refused,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=last, **items[last], **stranger)
    assert (refused.type, refused.target_system) == (MissionResult.ERROR, 254)
    assert len(download(flight)) == len(items)


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (item(31000), MissionResult.UNSUPPORTED),
        (item(frame=1), MissionResult.UNSUPPORTED_FRAME),
        (at_once(WAYPOINT), MissionResult.UNSUPPORTED_FRAME),
        (item(param1=math.inf), MissionResult.INVALID_PARAM1),
        (item(param4=-math.inf), MissionResult.INVALID_PARAM4),
        (item(x=900_000_001), MissionResult.INVALID_PARAM5_X),
        (item(y=-1_800_000_001), MissionResult.INVALID_PARAM6_Y),
        (item(height=NAN), MissionResult.INVALID_PARAM7),
        (item(height=1e9), MissionResult.INVALID_PARAM7),
        (at_once(JUMP, param1=2.0), MissionResult.INVALID_PARAM1),
        (at_once(JUMP, param1=-1.0), MissionResult.INVALID_PARAM1),
    ],
)
def test_a_bad_item_refuses_the_upload_and_leaves_the_old_mission(bad: Any, why: MissionResult) -> None:
    flight = holding("px4")
    assert upload(flight, [item(north=5.0)]) == ACCEPTED
    assert upload(flight, [item(), bad]) == why
    assert len(download(flight)) == 1
    flight.advance(0.1)
    assert flight.texts == [f"mission refused: {why.name.lower().replace('_', ' ')}"]


def test_numbers_out_of_range_are_refused() -> None:
    flight = holding("px4")
    assert upload(flight, [item()]) == ACCEPTED
    for seq in (1, 65535):
        (refused,) = to_vehicle(flight, "MISSION_REQUEST_INT", seq=seq)
        assert (refused.name, refused.type) == ("MISSION_ACK", MissionResult.INVALID_SEQUENCE)
        (still,) = to_vehicle(flight, "MISSION_SET_CURRENT", seq=seq)
        assert (still.name, still.seq) == ("MISSION_CURRENT", 0)
        assert flight.command(SET_CURRENT, seq) == DENIED
    assert flight.command(SET_CURRENT, NAN) == ACCEPTED
    assert flight.command(MISSION_START, 7) == DENIED
    (too_many,) = to_vehicle(flight, "MISSION_COUNT", count=MAX_ITEMS + 1)
    assert too_many.type == MissionResult.NO_SPACE
    (partial,) = to_vehicle(flight, "MISSION_WRITE_PARTIAL_LIST", start_index=0, end_index=0)
    assert partial.type == MissionResult.UNSUPPORTED


def test_ardupilot_starts_a_mission_where_it_is_and_px4_where_it_is_told() -> None:
    for flavour, result in (("px4", ACCEPTED), ("ardupilot", DENIED)):
        flight = holding(flavour)
        assert upload(flight, planned(flavour, [item(), item(north=5.0)])) == ACCEPTED
        assert flight.command(MISSION_START, 1) == result
        assert flight.command(MISSION_START) == ACCEPTED


def test_px4_starts_a_mission_with_its_first_item_unless_it_is_told_minus_one() -> None:
    flight = holding("px4")
    assert upload(flight, [item(north=5.0), item(north=40.0)]) == ACCEPTED
    assert flight.command(MISSION_START, NAN) == DENIED
    assert flight.command(MISSION_START, -2) == DENIED
    assert flight.command(MISSION_START, 1) == ACCEPTED
    assert flight.command(MISSION_START, -1) == ACCEPTED
    assert flight.autopilot.pilot.mission.current == 1
    assert flight.command(MISSION_START, 0) == ACCEPTED
    assert flight.autopilot.pilot.mission.current == 0


def test_a_lost_item_is_asked_for_again_until_the_vehicle_gives_up() -> None:
    flight = holding("px4")
    to_vehicle(flight, "MISSION_COUNT", count=2)
    flight.advance(2.2)
    requests = flight.messages("MISSION_REQUEST_INT", GROUND_STATION)
    assert [message.seq for _, message in requests] == [0, 0, 0]
    to_vehicle(flight, "MISSION_ITEM_INT", seq=0, **item())
    flight.advance(6.0)
    assert flight.last("MISSION_ACK", GROUND_STATION).type == MissionResult.OPERATION_CANCELLED
    assert not flight.messages("MISSION_REQUEST_INT", COMPANION)
    assert download(flight) == []


OTHER: dict[str, Any] = {"sender": Encoder(254, 191), "address": ("127.0.0.1", 50001)}
"""Another ground station."""


@both
def test_one_peer_writes_at_a_time_and_may_call_it_off(flavour: str) -> None:
    flight = holding(flavour)
    to_vehicle(flight, "MISSION_COUNT", count=2)
    (busy,) = to_vehicle(flight, "MISSION_COUNT", count=1, **OTHER)
    why = MissionResult.ERROR if flavour == "px4" else MissionResult.DENIED
    assert (busy.type, busy.target_system) == (why, 254)
    to_vehicle(flight, "MISSION_ACK", type=int(MissionResult.OPERATION_CANCELLED))
    (free,) = to_vehicle(flight, "MISSION_COUNT", count=1, **OTHER)
    assert free.name.startswith("MISSION_REQUEST")


@both
def test_an_upload_goes_on_whoever_else_clears_the_mission(flavour: str) -> None:
    flight = holding(flavour)
    old, new = planned(flavour, [item()]), planned(flavour, [item(north=5.0), item(north=9.0)])
    assert upload(flight, old) == ACCEPTED
    asked = to_vehicle(flight, "MISSION_COUNT", count=len(new))
    results = [answer.type for answer in to_vehicle(flight, "MISSION_CLEAR_ALL", **OTHER)]
    assert results == ([ACCEPTED] if flavour == "px4" else [MissionResult.DENIED, MissionResult.ERROR])
    flight.advance(1.1)
    left = 0 if flavour == "px4" else 1
    assert flight.last("MISSION_CURRENT").total == left  # PX4's two links know nothing of each other
    assert give(flight, asked, dict(enumerate(new))) == ACCEPTED
    assert len(download(flight)) == len(new)
    (cleared,) = to_vehicle(flight, "MISSION_CLEAR_ALL", **OTHER)
    assert cleared.type == ACCEPTED and download(flight) == []


def test_ardupilot_does_not_clear_the_mission_that_it_flies() -> None:
    flight = holding("ardupilot")
    plan = planned("ardupilot", [item(north=60.0)])
    assert upload(flight, plan) == ACCEPTED
    assert start(flight) == ACCEPTED
    flight.advance(0.1)
    (refused,) = to_vehicle(flight, "MISSION_CLEAR_ALL")
    assert refused.type == MissionResult.ERROR and len(download(flight)) == len(plan)
    assert flight.set_mode(GUIDED) == ACCEPTED
    flight.advance(0.1)
    (cleared,) = to_vehicle(flight, "MISSION_CLEAR_ALL")
    assert cleared.type == ACCEPTED and download(flight) == []

    assert upload(flight, plan) == start(flight) == ACCEPTED
    flight.advance(0.1)
    (emptied,) = to_vehicle(flight, "MISSION_COUNT", count=0)  # an upload of nothing is not refused
    assert emptied.type == ACCEPTED and download(flight) == []


@pytest.mark.parametrize("name", ["MISSION_ITEM_INT", "MISSION_ITEM"])
def test_home_of_ardupilot_is_read_as_item_0_without_a_mission(name: str) -> None:
    """DroneKit asks for item 0 although there are none, and gives up without it."""
    flight = holding("ardupilot")
    asked = {"MISSION_ITEM_INT": "MISSION_REQUEST_INT", "MISSION_ITEM": "MISSION_REQUEST"}[name]
    (home,) = to_vehicle(flight, asked, seq=0)
    assert (home.name, home.seq, home.command, home.frame) == (name, 0, WAYPOINT, 0)
    latitude_deg = home.x / 1e7 if name == "MISSION_ITEM_INT" else home.x
    assert latitude_deg == pytest.approx(flight.last("HOME_POSITION").latitude / 1e7, abs=1e-5)
    (refused,) = to_vehicle(flight, asked, seq=1)
    assert refused.type == MissionResult.INVALID_SEQUENCE
    (none,) = to_vehicle(holding("px4"), asked, seq=0)
    assert none.type == MissionResult.INVALID_SEQUENCE


@pytest.mark.parametrize("name", ["MISSION_ITEM_INT", "MISSION_ITEM"])
def test_ardupilot_in_guided_flies_to_an_item_that_is_for_now(name: str) -> None:
    """DroneKit's simple_goto: a waypoint whose `current` is 2, which is no part of a mission."""
    flight = holding("ardupilot")
    now = {**item(north=40.0), "current": 2, "seq": 0}
    if name == "MISSION_ITEM":
        now |= {"x": now["x"] / 1e7, "y": now["y"] / 1e7}
    (refused,) = to_vehicle(flight, name, **now)
    assert refused.type == MissionResult.ERROR  # another mode
    assert flight.set_mode(GUIDED) == ACCEPTED
    (fine,) = to_vehicle(flight, name, **now)
    assert (fine.name, fine.type) == ("MISSION_ACK", MissionResult.ACCEPTED)
    flight.advance(4.0)
    assert flight.velocity[0] > 2.0 and download(flight) == []
    for wrong, why in (
        ({"command": TAKEOFF}, MissionResult.ERROR),
        ({"x": 0, "y": 0}, MissionResult.ERROR),
        ({"frame": 12}, MissionResult.UNSUPPORTED_FRAME),
    ):
        (refused,) = to_vehicle(flight, name, **(now | wrong))
        assert refused.type == why
    (upload_only,) = to_vehicle(holding("px4"), name, **now)
    assert upload_only.type == MissionResult.ERROR


def test_ardupilot_knows_three_kinds_of_items_and_no_word_for_all_of_them() -> None:
    flight = holding("ardupilot")
    plan = planned("ardupilot", [item()])
    assert upload(flight, plan) == ACCEPTED
    for name in ("MISSION_CLEAR_ALL", "MISSION_REQUEST_LIST"):
        (refused,) = to_vehicle(flight, name, mission_type=255)
        assert (refused.name, refused.type, refused.mission_type) == ("MISSION_ACK", MissionResult.UNSUPPORTED, 255)
    assert len(download(flight)) == len(plan)


@both
def test_who_uploads_and_then_clears_has_no_mission(flavour: str) -> None:
    flight = holding(flavour)
    to_vehicle(flight, "MISSION_COUNT", count=2)
    (cleared,) = to_vehicle(flight, "MISSION_CLEAR_ALL")
    assert cleared.type == ACCEPTED
    (late,) = to_vehicle(flight, "MISSION_ITEM_INT", seq=0, **item())
    assert late.type == MissionResult.ERROR


def test_nobody_reads_a_mission_of_ardupilot_while_it_is_written() -> None:
    for flavour, reads in (("px4", True), ("ardupilot", False)):
        flight = holding(flavour)
        assert upload(flight, planned(flavour, [item()])) == ACCEPTED
        to_vehicle(flight, "MISSION_COUNT", count=2)
        answers = [
            *to_vehicle(flight, "MISSION_REQUEST_LIST", **OTHER),
            *to_vehicle(flight, "MISSION_REQUEST_INT", seq=0, **OTHER),
        ]
        assert (
            all(answer.name == "MISSION_ACK" and answer.type == MissionResult.DENIED for answer in answers) is not reads
        )


def test_ardupilot_takes_some_items_in_the_place_of_others() -> None:
    flight = holding("ardupilot")
    items = planned("ardupilot", [item(north=float(north)) for north in (5, 10, 15)])
    assert upload(flight, items) == ACCEPTED
    assert flight.command(SET_CURRENT, 3) == ACCEPTED
    others = {2: item(north=-10.0), 3: item(north=-15.0), 4: item(north=-20.0)}
    first, last = 2, 4  # one more than there are: it is put behind them
    answers = to_vehicle(flight, "MISSION_WRITE_PARTIAL_LIST", start_index=first, end_index=last)
    assert give(flight, answers, others) == ACCEPTED
    read = [message.x for message in download(flight)]
    assert read[1:] == [items[1]["x"], *(others[seq]["x"] for seq in (2, 3, 4))]
    flight.advance(1.1)
    assert flight.last("MISSION_CURRENT").seq == 3
    assert start(flight) == ACCEPTED
    flight.advance(4.0)
    assert flight.velocity[0] < -1.0


@pytest.mark.parametrize(("first", "last"), [(-1, 0), (1, 0), (0, 3), (3, 3)])
def test_items_in_the_place_of_none_are_refused(first: int, last: int) -> None:
    flight = holding("ardupilot")
    assert upload(flight, planned("ardupilot", [item()])) == ACCEPTED
    (refused,) = to_vehicle(flight, "MISSION_WRITE_PARTIAL_LIST", start_index=first, end_index=last)
    assert refused.type == MissionResult.ERROR
    assert len(download(flight)) == 2


def test_the_item_that_is_home_moves_with_it() -> None:
    flight = Flight("ardupilot", scenario=one_vehicle(sigma_m=3.5), seed=2)
    assert upload(flight, planned("ardupilot", [item()])) == ACCEPTED
    before = download(flight)[0].z
    flight.advance(60.0)  # an estimator wanders
    assert flight.command(ARM, 1) == ACCEPTED
    after = download(flight)[0]
    assert after.z == pytest.approx(flight.autopilot.telemetry.fields("HOME_POSITION")["altitude"] / 1e3, abs=0.001)
    assert abs(after.z - before) > 0.05


def test_the_first_items_of_a_mission_may_come_as_a_part_of_it() -> None:
    flight = holding("ardupilot")
    answers = to_vehicle(flight, "MISSION_WRITE_PARTIAL_LIST", start_index=0, end_index=0)
    (busy,) = to_vehicle(flight, "MISSION_WRITE_PARTIAL_LIST", start_index=0, end_index=0)
    assert busy.type == MissionResult.DENIED
    assert give(flight, answers, {0: at_once(WAYPOINT, frame=0)}) == ACCEPTED
    (home,) = download(flight)
    assert home.z == pytest.approx(HOME.altitude_m, abs=0.01)


# --- in flight --------------------------------------------------------------------------------------------------------


@both
def test_a_mission_is_flown_to_its_end_and_told_item_by_item(flavour: str) -> None:
    flight = holding(flavour)
    items = [
        at_once(SPEED, param1=1.0, param2=4.0),
        item(north=8.0),
        at_once(CAMERA, param3=1.0),
        item(north=8.0, east=8.0, height=53.0, param1=1.0),
        item(LOITER_TIME, north=0.0, east=8.0, param1=0.5),
    ]
    assert upload(flight, planned(flavour, items)) == ACCEPTED
    flight.advance(1.1)
    assert (flight.last("MISSION_CURRENT").mission_state, flight.last("MISSION_CURRENT").total) == (2, 5)
    assert start(flight) == ACCEPTED
    flight.advance(2.0)
    assert flight.last("MISSION_CURRENT").mission_state == 3
    assert 1.0 < math.hypot(*flight.velocity[:2]) < 4.5
    first = 0 if flavour == "px4" else 1
    advance_until(flight, lambda: len(reached(flight)) == 5)
    assert reached(flight) == list(range(first, first + 5))
    flight.advance(2.0)
    assert flight.world.position_ned_m[0] == pytest.approx((START_NED_M[0], 8.0, -50.0), abs=2.5)
    assert flight.last("MISSION_CURRENT").mission_state == 5
    assert flight.mode == (PX4_HOLD if flavour == "px4" else AUTO)  # ArduPilot stays in AUTO
    told = [message.seq for _, message in flight.messages("MISSION_CURRENT")]
    assert told == sorted(told) and {told[0], told[-1]} == {0, first + 4}  # what takes no time may be passed over


def test_px4_takes_off_by_itself_for_a_mission_and_lands_with_its_last_item() -> None:
    flight = Flight(scenario=one_vehicle(start_ned_m=(*START_NED_M[:2], -5.0)))
    flight.advance(0.1)
    assert upload(flight, [item(height=3.0), item(north=6.0, height=3.0), item(LAND, north=6.0, height=0.0)]) == 0
    assert flight.set_mode(4, 4) == ACCEPTED
    flight.advance(1.0)
    assert flight.height_m == 0.0
    assert flight.command(ARM, 1) == ACCEPTED
    advance_until(flight, lambda: not flight.armed and len(reached(flight)) == 3)
    assert flight.height_m == 0.0
    assert float(flight.world.position_ned_m[0, 0]) == pytest.approx(START_NED_M[0] + 6.0, abs=1.5)
    flight.advance(0.1)
    assert flight.mode == PX4_HOLD


def test_px4_that_lands_amid_its_mission_goes_on_and_disarms_after_its_end() -> None:
    flight = Flight("px4", Start.HOLDING, scenario=one_vehicle(start_ned_m=(*START_NED_M[:2], -2.0)))
    flight.advance(0.1)
    assert upload(flight, [item(LAND, height=0.0), item(TAKEOFF, height=2.0), item(LAND, height=0.0)]) == ACCEPTED
    assert start(flight) == ACCEPTED
    advance_until(flight, lambda: reached(flight) == [0])
    assert flight.height_m == pytest.approx(0.0, abs=0.1) and flight.armed
    advance_until(flight, lambda: reached(flight) == [0, 1])
    assert flight.height_m > 1.5
    advance_until(flight, lambda: reached(flight) == [0, 1, 2])
    flight.advance(1.5)
    assert flight.armed and flight.mode == PX4_HOLD
    flight.advance(1.0)
    assert not flight.armed and flight.texts == ["Mission finished, landed", "Disarmed by landing"]


def test_ardupilot_wants_a_takeoff_item_and_the_command_to_start() -> None:
    flight = Flight("ardupilot")
    flight.advance(0.1)
    assert upload(flight, planned("ardupilot", [item(height=3.0)])) == ACCEPTED
    assert flight.set_mode(AUTO) == FAILED
    flight.advance(0.1)
    assert "mission refused: Missing Takeoff Cmd" in flight.texts
    assert upload(flight, planned("ardupilot", [item(TAKEOFF, height=3.0), item(LAND, height=0.0)])) == ACCEPTED
    assert flight.command(MISSION_START) == FAILED  # not armed
    assert flight.command(ARM, 1) == ACCEPTED
    assert flight.set_mode(AUTO) == ACCEPTED
    flight.advance(2.0)
    assert flight.height_m == 0.0
    assert flight.command(MISSION_START) == ACCEPTED
    advance_until(flight, lambda: flight.height_m > 2.0)
    advance_until(flight, lambda: not flight.armed)
    assert reached(flight) == [1, 2]
    assert flight.command(ARM, 1) == FAILED  # AUTO is no mode to arm in


def test_ardupilot_on_the_ground_leaves_it_for_a_takeoff_item_alone() -> None:
    flight = Flight("ardupilot")
    flight.advance(0.1)
    assert upload(flight, planned("ardupilot", [item(TAKEOFF, height=3.0), item(north=6.0, height=3.0)])) == ACCEPTED
    assert flight.command(ARM, 1) == ACCEPTED
    assert flight.set_mode(AUTO) == ACCEPTED
    assert flight.command(SET_CURRENT, 2) == ACCEPTED  # past the take-off
    assert flight.command(MISSION_START) == ACCEPTED
    flight.advance(2.0)
    assert flight.height_m == 0.0 and flight.armed
    assert flight.command(SET_CURRENT, 1) == ACCEPTED
    advance_until(flight, lambda: flight.height_m > 2.0)


def test_ardupilot_flies_an_item_0_that_is_not_home() -> None:
    flight = holding("ardupilot")
    assert upload(flight, [item(north=3.0), item(east=3.0)]) == ACCEPTED
    assert start(flight) == ACCEPTED
    advance_until(flight, lambda: reached(flight) == [0, 1])
    assert [message.frame for message in download(flight)] == [3, 3]


def test_px4_arms_for_the_command_to_start() -> None:
    flight = Flight(scenario=one_vehicle(start_ned_m=(*START_NED_M[:2], -5.0)))
    flight.advance(0.1)
    assert upload(flight, [item(TAKEOFF, height=2.0), item(RETURN)]) == ACCEPTED
    assert flight.command(MISSION_START) == ACCEPTED
    advance_until(flight, lambda: flight.mode == PX4_RETURN)
    assert flight.armed and reached(flight) == [0, 1]


def test_ardupilot_stays_in_auto_while_its_mission_returns_home() -> None:
    flight = Flight("ardupilot", Start.HOLDING, scenario=one_vehicle(start_ned_m=(*START_NED_M[:2], -5.0)))
    flight.advance(0.1)
    assert upload(flight, planned("ardupilot", [item(north=20.0, height=5.0), item(RETURN)])) == ACCEPTED
    assert start(flight) == ACCEPTED
    advance_until(flight, lambda: flight.height_m > 8.0)
    assert (flight.mode, flight.last("MISSION_CURRENT").seq, reached(flight)) == (AUTO, 2, [1])
    assert flight.last("EXTENDED_SYS_STATE").landed_state == IN_AIR
    advance_until(flight, lambda: flight.height_m > 14.5)
    advance_until(flight, lambda: not flight.armed)
    assert (flight.mode, reached(flight), flight.height_m) == (AUTO, [1, 2], 0.0)
    assert float(flight.world.position_ned_m[0, 0]) == pytest.approx(START_NED_M[0], abs=1.5)


@both
def test_a_mission_that_goes_on_has_its_own_speed_again_in_px4_alone(flavour: str) -> None:
    flight = holding(flavour)
    items = [at_once(SPEED, param1=1.0, param2=2.0), item(north=100.0), at_once(SPEED, param1=1.0, param2=1.0), item()]
    assert upload(flight, planned(flavour, items)) == ACCEPTED
    assert start(flight) == ACCEPTED
    flight.advance(4.0)
    assert flight.velocity[0] == pytest.approx(2.0, abs=0.4)
    assert flight.command(SPEED, 1.0, 3.0) == ACCEPTED  # on its way
    flight.advance(4.0)
    assert flight.velocity[0] == pytest.approx(3.0, abs=0.5)
    assert (flight.set_mode(4, 3) if flavour == "px4" else flight.set_mode(BRAKE)) == ACCEPTED
    assert start(flight) == ACCEPTED
    flight.advance(6.0)
    assert flight.velocity[0] == pytest.approx(2.0 if flavour == "px4" else 10.0, abs=1.0)


@both
def test_a_mission_is_left_and_goes_on_where_it_was(flavour: str) -> None:
    flight = holding(flavour)
    assert upload(flight, planned(flavour, [item(north=5.0), item(north=40.0)])) == ACCEPTED
    assert start(flight) == ACCEPTED
    advance_until(flight, lambda: len(reached(flight)) == 1)
    assert flight.set_mode(*((4, 3) if flavour == "px4" else (BRAKE,))) == ACCEPTED
    flight.advance(5.0)
    assert math.hypot(*flight.velocity[:2]) < 0.5 and flight.last("MISSION_CURRENT").mission_state == 4
    assert start(flight) == ACCEPTED
    advance_until(flight, lambda: len(reached(flight)) == 2)


def test_ardupilot_pauses_in_auto_and_in_guided_and_stays_in_the_mode() -> None:
    flight = holding("ardupilot")
    assert flight.command(PAUSE_CONTINUE, 0) == flight.command(PAUSE_CONTINUE, 1) == FAILED  # in BRAKE
    assert upload(flight, planned("ardupilot", [item(north=5.0), item(north=40.0)])) == ACCEPTED
    assert start(flight) == ACCEPTED
    advance_until(flight, lambda: len(reached(flight)) == 1)
    assert flight.command(PAUSE_CONTINUE, 0) == ACCEPTED
    flight.advance(5.0)
    assert flight.mode == AUTO and math.hypot(*flight.velocity[:2]) < 0.5
    assert flight.last("MISSION_CURRENT").mission_state == 4
    assert flight.command(PAUSE_CONTINUE, 2) == DENIED
    assert flight.command(PAUSE_CONTINUE, 1) == ACCEPTED
    advance_until(flight, lambda: len(reached(flight)) == 2)
    flight.set_mode(GUIDED)
    assert flight.command(PAUSE_CONTINUE, 0) == ACCEPTED
    flight.fly(3.0, 2.0, 0.0, 0.0)
    assert math.hypot(*flight.velocity[:2]) < 0.5
    assert flight.command(PAUSE_CONTINUE, 1) == ACCEPTED
    flight.fly(3.0, 2.0, 0.0, 0.0)
    assert flight.velocity[0] == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("number", [17, PAUSE_CONTINUE])
def test_px4_has_no_commands_to_loiter_and_to_pause(number: int) -> None:
    flight = holding("px4")
    offboard(flight)
    assert flight.command(number) == UNSUPPORTED
    flight.fly(0.5, 0.0, 0.0, 0.0)
    assert flight.mode == PX4_OFFBOARD


def test_jumps_are_counted_and_a_circle_of_them_hovers() -> None:
    flight = holding("px4")
    laps = [item(north=3.0), item(), at_once(JUMP, param1=0.0, param2=1.0), at_once(CONDITION_YAW, param1=90.0)]
    assert upload(flight, laps) == ACCEPTED
    assert start(flight) == ACCEPTED
    flight.advance(0.1)
    advance_until(flight, lambda: flight.mode == PX4_HOLD)
    assert reached(flight) == [0, 1, 2, 0, 1, 2, 3]
    flight.advance(2.0)
    assert flight.last("ATTITUDE").yaw == pytest.approx(math.pi / 2, abs=0.05)
    assert upload(flight, [at_once(JUMP, param1=0.0, param2=-1.0)]) == ACCEPTED
    assert start(flight) == ACCEPTED
    flight.advance(1.0)
    assert flight.mode == PX4_MISSION and math.hypot(*flight.velocity) < 0.5


@both
def test_a_relative_heading_turns_the_way_it_says(flavour: str) -> None:
    flight = holding(flavour)
    left = at_once(CONDITION_YAW, param1=45.0, param3=-1.0, param4=1.0)
    assert upload(flight, planned(flavour, [left, at_once(DELAY, param1=60.0)])) == ACCEPTED
    assert start(flight) == ACCEPTED
    flight.advance(2.0)
    assert flight.last("GLOBAL_POSITION_INT").hdg == 31500


def test_items_can_be_left_out_and_a_new_mission_begins_at_once() -> None:
    flight = holding("px4")
    assert upload(flight, [item(north=200.0), item(DELAY, param1=1.0), item(east=6.0)]) == ACCEPTED
    (current,) = to_vehicle(flight, "MISSION_SET_CURRENT", seq=1)
    assert current.seq == 1
    assert start(flight) == ACCEPTED
    advance_until(flight, lambda: 2 in reached(flight))
    assert start(flight) == ACCEPTED  # complete: from the beginning
    flight.advance(1.0)
    assert flight.last("MISSION_CURRENT").seq == 0
    assert upload(flight, [item(north=-30.0)]) == ACCEPTED
    flight.advance(5.0)
    assert flight.mode == PX4_MISSION and flight.velocity[0] < -2.0
    to_vehicle(flight, "MISSION_CLEAR_ALL")
    flight.advance(0.1)
    assert flight.mode == PX4_HOLD
