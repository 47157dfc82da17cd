"""Habits of real autopilots that a client can see: setpoints, failsafes, links; as measured on both."""

from __future__ import annotations

import math
import re
import struct
from pathlib import Path
from typing import Any

import pytest

from ridlink.geodesy import geodetic_from_ned
from ridlink.mavlink.codec import Encoder
from sitl_sim.autopilot import FLAVOURS, Start
from sitl_sim.autopilot.parameters import Parameters
from tests.sitl_sim.flight import (
    ACCEPTED,
    ARM,
    DENIED,
    FAILED,
    GROUND_STATION,
    GUIDED,
    HOME,
    LAND,
    NAN,
    PX4_ALTITUDE,
    PX4_HOLD,
    PX4_LAND,
    PX4_OFFBOARD,
    PX4_RETURN,
    SET_MODE,
    START_NED_M,
    TAKEOFF,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Flight,
    airborne,
    both,
    offboard,
    one_vehicle,
)

CONDITION_YAW, LOITER, CHANGE_SPEED = 115, 17, 178
ARDUPILOT_LOITER, ARDUPILOT_RETURN, ARDUPILOT_LAND = 5, 6, 9


def flying(flavour: str, **details: Any) -> Flight:
    """Obeying setpoints in the air."""
    flight = Flight(flavour, Start.AIRBORNE, scenario=one_vehicle(**details))
    flight.advance(0.1)
    flight.fly(0.2)
    return flight


def global_setpoint(flight: Flight, north: float, east: float, height: float, frame: int, **fields: Any) -> None:
    latitude, longitude, _ = geodetic_from_ned((START_NED_M[0] + north, START_NED_M[1] + east, 0.0), HOME)
    place = {"lat_int": round(float(latitude) * 1e7), "lon_int": round(float(longitude) * 1e7), "alt": height}
    target = {"target_system": 1, "target_component": 1, "coordinate_frame": frame, "type_mask": 0x09F8}
    flight.send("SET_POSITION_TARGET_GLOBAL_INT", **(target | place | fields))


def set_parameter(flight: Flight, name: str, value: float) -> None:
    """As the autopilot of the flight wants it."""
    (listed,) = flight.send("PARAM_REQUEST_READ", target_system=1, param_id=name, param_index=-1)
    if listed.param_type == 6 and flight.flavour == "px4":
        value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
    flight.send("PARAM_SET", target_system=1, param_id=name, param_value=value, param_type=listed.param_type)


# --- setpoints --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flavour", "frame", "above"),
    [
        ("px4", 5, HOME.altitude_m),
        ("px4", 6, 0.0),
        ("px4", 11, 0.0),
        ("ardupilot", 5, HOME.altitude_m),
        ("ardupilot", 0, HOME.altitude_m),
        ("ardupilot", 3, 0.0),
        ("ardupilot", 6, 0.0),
        ("ardupilot", 10, 0.0),
        ("ardupilot", 11, 0.0),
    ],
)
def test_global_positions_are_flown_to(flavour: str, frame: int, above: float) -> None:
    flight = flying(flavour)
    for _ in range(90):
        global_setpoint(flight, 8.0, 4.0, above + 47.0, frame)
        flight.advance(0.1)
    wanted = (START_NED_M[0] + 8.0, 4.0, -47.0)
    assert flight.world.position_ned_m[0] == pytest.approx(wanted, abs=1.0)
    target = flight.last("POSITION_TARGET_LOCAL_NED")
    assert (target.x, target.y, target.z) == pytest.approx((8.0, 4.0, -47.0), abs=0.1)
    flight.command(512, 87)
    echoed = flight.last("POSITION_TARGET_GLOBAL_INT", GROUND_STATION)
    assert echoed.alt == pytest.approx(HOME.altitude_m + 47.0, abs=0.1)


@both
@pytest.mark.parametrize(
    "fields", [{"lat_int": 910_000_000}, {"lon_int": 1_900_000_000}, {"alt": NAN}, {"coordinate_frame": 1}]
)
def test_global_positions_that_are_none_are_refused_in_words(flavour: str, fields: Any) -> None:
    flight = flying(flavour)
    global_setpoint(flight, 5.0, 0.0, 50.0, 6, **fields)
    flight.advance(0.1)
    assert any(text.startswith("setpoint") for text in flight.texts)
    assert flight.mode == (PX4_OFFBOARD if flavour == "px4" else GUIDED)


@pytest.mark.parametrize("frame", [0, 3, 10])
def test_px4_wants_the_int_frames_for_a_global_position_and_none_for_a_velocity(frame: int) -> None:
    flight = flying("px4")
    global_setpoint(flight, 8.0, 4.0, 47.0, frame)
    flight.advance(0.1)
    assert any(f"frame {frame}" in text for text in flight.texts)


@both
@pytest.mark.parametrize("frame", [0, 12])
def test_a_global_velocity_has_no_frame(flavour: str, frame: int) -> None:
    flight = flying(flavour)
    global_setpoint(flight, 0.0, 0.0, 0.0, frame, type_mask=0x0DC7, vx=3.0)
    flight.advance(0.1)
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(3.0)


@both
def test_an_acceleration_alone_is_flown_up_to_the_speed_limit(flavour: str) -> None:
    flight = flying(flavour)
    flight.fly(2.0, mask=0x0C3F, afx=1.0)
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(2.0, abs=0.15)
    flight.fly(20.0, mask=0x0C3F, afx=1.0)
    limit = 12.0 if flavour == "px4" else 10.0
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(limit, abs=0.1)
    flight.fly(1.0, 3.0, 0.0, 0.0, mask=0x0C07, afx=0.0)  # velocity and acceleration: the velocity is flown
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(3.0)


def test_a_position_with_an_acceleration_and_no_velocity_stops_ardupilot_only() -> None:
    for flavour in ("px4", "ardupilot"):
        flight = flying(flavour)
        flight.fly(2.0, mask=0x0C38, x=30.0, z=-50.0)
        assert (flight.velocity[0] > 1.0) == (flavour == "px4")


def test_an_unknown_frame_stops_ardupilot_and_costs_px4_its_stream() -> None:
    ardupilot = flying("ardupilot")
    ardupilot.fly(4.0, 4.0, 0.0, 0.0)
    ardupilot.fly(0.5, 4.0, 0.0, 0.0, frame=12)
    assert ardupilot.last("POSITION_TARGET_LOCAL_NED").vx == 0.0 and ardupilot.mode == GUIDED
    px4 = flying("px4")
    px4.fly(2.0, 4.0, 0.0, 0.0)
    px4.fly(1.3, 4.0, 0.0, 0.0, frame=12)
    assert px4.mode == PX4_RETURN
    critical = [m for _, m in px4.messages("STATUSTEXT") if b"frame 12" in m.text]
    assert critical and critical[0].severity == 2


# --- modes, arming ----------------------------------------------------------------------------------------------------


def test_px4_acknowledges_a_mode_twice_the_first_time_whatever_comes_of_it() -> None:
    flight = Flight(start=Start.HOLDING)
    flight.advance(0.1)

    def acknowledged(main: float, sub: float) -> list[int]:
        fields = {"target_system": 1, "target_component": 1, "command": SET_MODE, "param1": 129.0}
        answers = flight.send("COMMAND_LONG", param2=main, param3=sub, **fields)
        return [answer.result for answer in answers if answer.name == "COMMAND_ACK"]

    assert acknowledged(6, 0) == [ACCEPTED, TEMPORARILY_REJECTED]
    assert acknowledged(4, 3) == [ACCEPTED, ACCEPTED]
    assert acknowledged(4, 99) == [ACCEPTED, TEMPORARILY_REJECTED]
    assert acknowledged(99, 0) == [ACCEPTED, ACCEPTED]  # and nothing changes


def test_px4_on_the_ground_accepts_offboard_without_a_stream_and_refuses_to_arm() -> None:
    flight = Flight()
    flight.advance(0.1)
    assert flight.set_mode(6) == ACCEPTED
    flight.advance(0.1)
    assert flight.mode == PX4_OFFBOARD
    assert flight.command(ARM, 1) == TEMPORARILY_REJECTED
    flight.setpoint()
    assert flight.command(ARM, 1) == ACCEPTED
    flight.advance(0.1)
    assert "arming refused: no offboard signal" in flight.texts


@both
def test_arming_wants_a_position(flavour: str) -> None:
    flight = Flight(flavour)
    flight.advance(0.5)
    flight.world.receivers.set_outage(0, True)
    flight.advance(1.0)
    assert not flight.last("SYS_STATUS").onboard_control_sensors_health & 0x10000020
    assert flight.command(ARM, 1) == (TEMPORARILY_REJECTED if flavour == "px4" else FAILED)
    flight.advance(0.1)
    assert "arming refused: no position" in flight.texts


def test_ardupilot_sinks_in_loiter_unless_the_throttle_stick_is_held() -> None:
    flight = flying("ardupilot")
    assert flight.command(LOITER) == ACCEPTED
    flight.advance(6.0)
    assert flight.mode == ARDUPILOT_LOITER and flight.velocity[2] == pytest.approx(2.5, abs=0.1)
    for _ in range(40):
        flight.send("RC_CHANNELS_OVERRIDE", target_system=1, target_component=1, chan3_raw=1500)
        flight.advance(0.1)
    assert abs(flight.velocity[2]) < 0.1
    flight.send("MANUAL_CONTROL", target=1, z=500)
    flight.advance(2.5)
    assert abs(flight.velocity[2]) < 0.1
    flight.send("MANUAL_CONTROL", target=1, z=0)
    flight.advance(3.0)
    assert flight.velocity[2] > 1.0


@pytest.mark.parametrize(("value", "sinks"), [(0, True), (65535, False)])
def test_ardupilot_lets_a_stick_go_that_is_released_but_not_one_that_is_left_alone(value: int, sinks: bool) -> None:
    flight = flying("ardupilot")
    assert flight.command(LOITER) == ACCEPTED
    for channel_us in (1500, value):
        flight.send("RC_CHANNELS_OVERRIDE", target_system=1, target_component=1, chan3_raw=channel_us)
        flight.advance(1.4)
    assert (flight.velocity[2] > 0.5) is sinks


def test_a_change_of_speed_is_of_the_kind_that_each_autopilot_knows() -> None:
    flight = flying("ardupilot")
    speeds = flight.autopilot.pilot.speeds
    for kind, speed_mps in ((1, 4.0), (2, 1.2), (3, 0.9)):
        assert flight.command(CHANGE_SPEED, kind, speed_mps) == ACCEPTED
    assert (speeds.cruise_mps, speeds.climb_mps, speeds.descent_mps) == pytest.approx((4.0, 1.2, 0.9))
    assert flight.command(CHANGE_SPEED, 1, -1) == flight.command(CHANGE_SPEED, 1, NAN) == DENIED
    assert flight.command(CHANGE_SPEED, 4, 2.0) == FAILED
    assert speeds.cruise_mps == 4.0
    for mode, result in ((ARDUPILOT_LOITER, FAILED), (ARDUPILOT_LAND, FAILED), (ARDUPILOT_RETURN, ACCEPTED)):
        flight.set_mode(mode)
        assert flight.command(CHANGE_SPEED, 1, 4.0) == result
    flight = flying("px4")
    speeds = flight.autopilot.pilot.speeds
    usual = speeds.cruise_mps, speeds.climb_mps, speeds.descent_mps
    assert flight.command(CHANGE_SPEED, 2, 4.0) == ACCEPTED
    assert (speeds.cruise_mps, speeds.climb_mps, speeds.descent_mps) == (4.0, *usual[1:])
    assert flight.command(CHANGE_SPEED, 1, -1) == ACCEPTED
    assert speeds.cruise_mps == usual[0]


@both
def test_a_change_of_speed_lasts_until_the_mode_changes(flavour: str) -> None:
    flight = flying(flavour)
    speeds = flight.autopilot.pilot.speeds
    usual_mps = speeds.cruise_mps
    for mode in ((4, 5), (4, 3)) if flavour == "px4" else ((ARDUPILOT_RETURN,), (GUIDED,)):
        assert flight.command(CHANGE_SPEED, 1, 2.0) == ACCEPTED
        assert speeds.cruise_mps == 2.0
        assert flight.set_mode(*mode) == ACCEPTED
        assert speeds.cruise_mps == usual_mps


@both
def test_a_change_of_speed_is_of_the_present_way_too(flavour: str) -> None:
    flight = flying(flavour)
    assert flight.set_mode(*((4, 5) if flavour == "px4" else (ARDUPILOT_RETURN,))) == ACCEPTED
    flight.world.position_ned_m[0, 0] += 200.0
    flight.autopilot.pilot.estimate.north_m += 200.0
    flight.advance(8.0)
    assert flight.velocity[0] < -4.0
    assert flight.command(CHANGE_SPEED, 1, 2.0) == ACCEPTED
    flight.advance(8.0)
    assert flight.velocity[0] == pytest.approx(-2.0, abs=0.3)


def test_ardupilot_turns_its_nose_when_told_and_px4_has_no_such_command() -> None:
    flight = flying("ardupilot")
    assert flight.command(CONDITION_YAW, 90.0, 0.0, 1.0, 0.0) == ACCEPTED
    flight.advance(2.0)
    assert flight.last("ATTITUDE").yaw == pytest.approx(math.pi / 2, abs=0.02)
    assert flight.command(CONDITION_YAW, 45.0, 0.0, -1.0, 1.0) == ACCEPTED
    flight.advance(2.0)
    assert flight.last("ATTITUDE").yaw == pytest.approx(math.pi / 4, abs=0.02)
    for wrong in ((-90.0, 0.0, 1.0, 0.0), (361.0, 0.0, 1.0, 0.0), (NAN,), (90.0, 0.0, 1.0, 2.0)):
        assert flight.command(CONDITION_YAW, *wrong) == FAILED
    flight.advance(1.0)
    assert flight.last("ATTITUDE").yaw == pytest.approx(math.pi / 4, abs=0.02)
    assert flying("px4").command(CONDITION_YAW, 90.0) == UNSUPPORTED


# --- failsafes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("action", "mode"), [(0, PX4_RETURN), (3, PX4_RETURN), (4, PX4_LAND), (5, PX4_HOLD)])
def test_what_px4_does_in_silence_is_a_parameter(action: int, mode: int) -> None:
    flight = flying("px4")
    set_parameter(flight, "COM_OBL_RC_ACT", action)
    flight.fly(0.5, 2.0, 0.0, 0.0)
    flight.advance(1.3)
    assert flight.mode == mode
    flight.fly(0.2, 2.0, 0.0, 0.0)
    assert flight.mode == PX4_OFFBOARD


def standing(flavour: str, *, flown: bool, **parameters: float) -> Flight:
    """Armed on the ground, be it that it has come down there by setpoints."""
    flight = Flight(flavour, scenario=one_vehicle(start_ned_m=(-200.0, 0.0, -3.0)))
    for name, value in parameters.items():
        set_parameter(flight, name, value)
    flight.advance(0.1)
    assert offboard(flight) == ACCEPTED and flight.command(ARM, 1) == ACCEPTED
    if flown:
        if flavour == "ardupilot":
            flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 3.0)
            flight.advance(5.0)
        flight.fly(3.0, 0.0, 0.0, -1.0)
        assert flight.height_m > 1.0
        come_down(flight, 0.0, 0.0, 1.0)
    return flight


def come_down(flight: Flight, *velocity: float) -> None:
    """Until it stands."""
    for _ in range(200):
        if not flight.world.in_air[0]:
            return
        flight.fly(0.1, *velocity)
    raise AssertionError("it flies on")


DISARMS = [
    ("px4", False, {}, 10.0, "Disarmed by auto preflight disarming"),
    ("px4", True, {}, 2.0, "Disarmed by landing"),
    ("px4", False, {"COM_DISARM_PRFLT": 4.0}, 4.0, "Disarmed by auto preflight disarming"),
    ("px4", True, {"COM_DISARM_LAND": 4.0}, 4.0, "Disarmed by landing"),
    ("ardupilot", False, {}, 10.0, "Disarming motors"),
    ("ardupilot", True, {}, 10.0, "Disarming motors"),
    ("ardupilot", True, {"DISARM_DELAY": 4.0}, 4.0, "Disarming motors"),
]


@pytest.mark.parametrize(("flavour", "flown", "parameters", "after_s", "said"), DISARMS)
def test_who_stands_armed_disarms_after_a_while(
    flavour: str, flown: bool, parameters: dict[str, float], after_s: float, said: str
) -> None:
    flight = standing(flavour, flown=flown, **parameters)
    for _ in range(round(10.0 * (after_s - 0.5))):
        flight.fly(0.1, 0.0, 0.0, 1.0)
    assert flight.armed and said not in flight.texts
    flight.fly(1.0, 0.0, 0.0, 1.0)
    assert not flight.armed and flight.texts[-1] == said
    assert flight.command(ARM, 1) == ACCEPTED  # and it begins anew
    flight.advance(0.3)
    assert flight.armed


@pytest.mark.parametrize(
    ("flavour", "flown", "parameters"),
    [
        ("px4", False, {"COM_DISARM_PRFLT": -1.0}),
        ("px4", True, {"COM_DISARM_LAND": -1.0}),
        ("ardupilot", True, {"DISARM_DELAY": 0.0}),
    ],
)
def test_who_is_told_to_stays_armed(flavour: str, flown: bool, parameters: dict[str, float]) -> None:
    flight = standing(flavour, flown=flown, **parameters)
    flight.fly(30.0, 0.0, 0.0, 1.0)
    assert flight.armed


def test_an_ardupilot_whose_throttle_stick_is_held_stays_armed() -> None:
    flight = standing("ardupilot", flown=False)
    for _ in range(30):
        flight.send("MANUAL_CONTROL", target=1, z=500)
        flight.advance(1.0)
    assert flight.armed
    flight.advance(11.5)
    assert flight.armed  # the stick counts for 3 s more
    flight.advance(1.0)
    assert not flight.armed


def test_a_px4_that_has_landed_tells_so_before_it_disarms() -> None:
    flight = airborne("px4", start_ned_m=(-200.0, 0.0, -3.0))
    set_parameter(flight, "COM_DISARM_LAND", 5.0)
    flight.command(LAND)
    come_down(flight)
    flight.advance(4.0)
    assert flight.armed and flight.mode == PX4_LAND and flight.last("EXTENDED_SYS_STATE").landed_state == 1
    flight.advance(1.5)
    assert not flight.armed


def test_losing_the_position_in_the_air_lands_ardupilot_for_good() -> None:
    flight = flying("ardupilot")
    flight.world.receivers.set_outage(0, True)
    flight.fly(7.9, 1.0, 0.0, 0.0)
    assert flight.mode == GUIDED
    flight.fly(0.4, 1.0, 0.0, 0.0)
    assert flight.mode == ARDUPILOT_LAND and flight.last("HEARTBEAT").system_status == 5
    assert "EKF Failsafe: changed to LAND Mode" in flight.texts
    assert flight.set_mode(GUIDED) == FAILED
    (answer,) = flight.send("COMMAND_INT", target_system=1, command=192, frame=6, param2=1.0, x=1, y=1, z=9.0)
    assert answer.result == FAILED
    flight.advance(8.0)
    last_s = flight.messages("LOCAL_POSITION_NED")[-1][0]
    assert flight.now_s - last_s == pytest.approx(1.2, abs=0.3)  # it ceased 15 s after the loss
    assert flight.now_s - flight.messages("GLOBAL_POSITION_INT")[-1][0] < 0.2
    flight.world.receivers.set_outage(0, False)
    flight.advance(2.0)
    assert flight.now_s - flight.messages("LOCAL_POSITION_NED")[-1][0] < 0.2
    assert flight.mode == ARDUPILOT_LAND
    assert flight.set_mode(GUIDED) == ACCEPTED


def test_losing_the_position_in_the_air_sinks_px4_and_the_fix_brings_it_home() -> None:
    flight = flying("px4")
    flight.world.receivers.set_outage(0, True)
    flight.fly(5.0, 1.0, 0.0, 0.0)
    assert flight.mode == PX4_OFFBOARD and flight.last("ESTIMATOR_STATUS").flags & 16
    flight.fly(4.0, 1.0, 0.0, 0.0)
    assert flight.mode == PX4_ALTITUDE and not flight.last("ESTIMATOR_STATUS").flags & 16
    assert flight.velocity[2] == pytest.approx(0.7, abs=0.1)
    assert flight.now_s - flight.messages("LOCAL_POSITION_NED")[-1][0] < 0.2  # it goes on telling a position
    assert flight.set_mode(4, 3) == TEMPORARILY_REJECTED
    flight.world.receivers.set_outage(0, False)
    flight.advance(0.5)
    assert flight.mode == PX4_RETURN


@pytest.mark.parametrize(
    ("flavour", "parameters", "mode"),
    [
        ("px4", {}, PX4_HOLD),
        ("px4", {"NAV_DLL_ACT": 2, "COM_DL_LOSS_T": 5}, PX4_RETURN),
        ("px4", {"NAV_DLL_ACT": 3, "COM_DL_LOSS_T": 5}, PX4_LAND),
        ("ardupilot", {}, 17),
        ("ardupilot", {"FS_GCS_ENABLE": 1}, ARDUPILOT_RETURN),
        ("ardupilot", {"FS_GCS_ENABLE": 5}, ARDUPILOT_LAND),
    ],
)
def test_losing_the_ground_station_matters_only_where_it_is_set_up(flavour: str, parameters: Any, mode: int) -> None:
    flight = Flight(flavour, Start.HOLDING)
    flight.advance(0.1)
    before = flight.mode
    for name, value in parameters.items():
        set_parameter(flight, name, value)
    for _ in range(4):
        flight.send("HEARTBEAT", type=6, autopilot=8)
        flight.advance(1.0)
    assert flight.mode == before
    flight.advance(5.0)
    assert flight.mode == mode
    flight.send("HEARTBEAT", type=6, autopilot=8)
    flight.advance(0.2)
    assert flight.mode == mode


# --- links ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("flavour", "count"), [("px4", 3), ("ardupilot", 0)])
def test_px4_tells_its_own_remote_id_on_every_link(flavour: str, count: int) -> None:
    flight = Flight(flavour, Start.AIRBORNE)
    flight.advance(3.0)
    assert len(flight.messages("OPEN_DRONE_ID_LOCATION")) == len(flight.messages("OPEN_DRONE_ID_SYSTEM")) == count
    if not count:
        assert flight.command(512, 12900) == FAILED
        return
    location = flight.last("OPEN_DRONE_ID_LOCATION")
    assert (location.timestamp, location.status, location.id_or_mac) == (65535.0, 2, bytes(20))
    assert location.horizontal_accuracy == 12  # of a receiver that says 1 mm
    assert flight.command(512, 12900) == ACCEPTED
    assert flight.last("OPEN_DRONE_ID_BASIC_ID", GROUND_STATION).uas_id.startswith(b"RDLK40001")


def test_ardupilot_asks_for_the_time() -> None:
    flight = Flight("ardupilot")
    flight.advance(0.2)
    assert (flight.last("TIMESYNC").tc1, flight.last("TIMESYNC").ts1 > 0) == (0, True)


# --- parameters -------------------------------------------------------------------------------------------------------


def test_ardupilot_does_not_look_at_the_type_of_a_parameter_and_px4_does() -> None:
    wrong = {"target_system": 1, "target_component": 1, "param_value": 20.0, "param_type": 2}
    (px4,) = Flight("px4").send("PARAM_SET", param_id="RTL_RETURN_ALT", **wrong)
    (ardupilot,) = Flight("ardupilot").send("PARAM_SET", param_id="WPNAV_SPEED", **wrong)
    assert (px4.param_value, ardupilot.param_value) == (30.0, 20.0)


@both
def test_parameters_out_of_range_or_unknown_are_refused(flavour: str) -> None:
    flight = Flight(flavour)
    flight.advance(0.1)
    name = "MPC_XY_VEL_MAX" if flavour == "px4" else "WPNAV_SPEED"
    target = {"target_system": 1, "target_component": 1}
    (before,) = flight.send("PARAM_REQUEST_READ", param_id=name, param_index=-1, **target)
    for value in (-5.0, 0.0, 1e9, math.inf, NAN):
        (after,) = flight.send("PARAM_SET", param_id=name, param_value=value, param_type=9, **target)
        assert after.param_value == before.param_value
    assert flight.send("PARAM_SET", param_id="NO_SUCH", param_value=1.0, param_type=9, **target) == []
    assert flight.send("PARAM_REQUEST_READ", param_index=30000, **target) == []
    flight.advance(0.1)
    assert any(f"{name}: only" in text for text in flight.texts)
    assert any("unknown parameter: NO_SUCH" in text for text in flight.texts) == (flavour == "px4")


def test_every_test_that_the_document_names_exists() -> None:
    document = (Path(__file__).parents[2] / "docs" / "emulator.md").read_text()
    named = set(re.findall(r"`(test_\w+)`", document))
    written = {
        name
        for file in Path(__file__).parent.glob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(), re.M)
    }
    assert named and named <= written, named - written
    habits = document.split("### Habits of the real ones")[1].split("**Not emulated:**")[0]
    rows = [line for line in habits.splitlines() if line.startswith("| ") and "---" not in line]
    unheld = [row for row in rows if "`test_" not in row and not row.endswith("| held by |")]
    assert len(rows) > 40 and unheld == []


def test_every_parameter_is_documented() -> None:
    document = (Path(__file__).parents[2] / "docs" / "emulator.md").read_text()
    for flavour in FLAVOURS.values():
        for name in Parameters(flavour, 1).names:
            assert f"`{name}`" in document, name


@both
def test_a_stream_that_still_runs_counts_at_once_when_its_mode_returns(flavour: str) -> None:
    """A pilot's mode wins at once; the setpoints that went on meanwhile are flown as soon as the mode is back."""
    flight = flying(flavour)
    flight.fly(3.0, 4.0, 0.0, 0.0)
    hold, steer = ((4, 3), (6, 0)) if flavour == "px4" else ((17, 0), (GUIDED, 0))
    assert flight.set_mode(*hold) == ACCEPTED
    flight.fly(7.0, 4.0, 0.0, 0.0)
    assert math.hypot(*flight.velocity[:2]) < 1.0
    assert flight.set_mode(*steer) == ACCEPTED
    flight.fly(0.2, 4.0, 0.0, 0.0)
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(4.0)
    flight.fly(3.0, 4.0, 0.0, 0.0)
    assert flight.velocity[0] > 2.5


@pytest.mark.parametrize(("flavour", "every_s", "mode"), [("px4", 0.66, PX4_OFFBOARD), ("ardupilot", 0.5, GUIDED)])
def test_a_slow_stream_is_enough(flavour: str, every_s: float, mode: int) -> None:
    """Measured: 1.5 Hz kept PX4 in OFFBOARD, 2 Hz is enough for ArduPilot."""
    flight = flying(flavour)
    for _ in range(12):
        flight.setpoint(4.0, 0.0, 0.0)
        flight.advance(every_s)
    assert flight.mode == mode and flight.velocity[0] > 3.0


def test_ardupilot_takes_guided_without_a_position_and_does_not_arm() -> None:
    flight = Flight("ardupilot")
    flight.advance(0.1)
    flight.world.receivers.set_outage(0, True)
    flight.advance(1.0)
    assert flight.set_mode(GUIDED) == ACCEPTED
    assert flight.command(ARM, 1) == FAILED


@both
def test_whoever_speaks_is_obeyed_and_the_last_one_wins(flavour: str) -> None:
    flight = flying(flavour)
    target = {"target_system": 1, "target_component": 1, "coordinate_frame": 1, "type_mask": 0x0DC7}
    for speed, sender in ((2.0, Encoder(1, 195)), (3.0, Encoder(42, 1)), (4.0, Encoder(255, 190))):
        flight.send("SET_POSITION_TARGET_LOCAL_NED", sender=sender, vx=speed, **target)
        flight.advance(0.1)
        assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(speed)
