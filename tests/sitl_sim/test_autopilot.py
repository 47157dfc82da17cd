"""The emulated autopilot does what real ones were seen to do, and survives what no client would send."""

from __future__ import annotations

import itertools
import math
import struct
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.mavlink.codec import MESSAGES, Encoder, message_spec
from ridlink.mavlink.frames import encode_frame
from sitl_sim.autopilot import FLAVOURS, Start
from sitl_sim.autopilot.rates import default_intervals
from sitl_sim.world import VehicleState
from tests.sitl_sim.flight import (
    COMPANION,
    GROUND_STATION,
    GUIDED,
    HOME,
    PX4_HOLD,
    PX4_LAND,
    PX4_OFFBOARD,
    PX4_RETURN,
    PX4_TAKEOFF,
    START_NED_M,
    UTC_S,
    Flight,
    one_vehicle,
)

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
ARM, TAKEOFF, LAND, RETURN, SET_MODE, REPOSITION = 400, 22, 21, 20, 176, 192
SET_INTERVAL, REQUEST = 511, 512
NAN = math.nan

both = pytest.mark.parametrize("flavour", ["px4", "ardupilot"])


def offboard(flight: Flight) -> int:
    """Bring a vehicle into OFFBOARD or GUIDED, as a client of either autopilot does."""
    if flight.flavour == "ardupilot":
        return flight.set_mode(GUIDED)
    flight.setpoint(0.0, 0.0, 0.0)
    return flight.set_mode(6)


def airborne(flavour: str, **details: Any) -> Flight:
    flight = Flight(flavour, Start.HOLDING, scenario=one_vehicle(**details))
    flight.advance(0.1)
    assert offboard(flight) == ACCEPTED
    return flight


# --- heartbeat, modes, arming -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flavour", "autopilot", "base_mode", "custom_mode"), [("px4", 12, 0x1D, PX4_HOLD), ("ardupilot", 3, 0x11, 0)]
)
def test_heartbeat_presents_the_autopilot(flavour: str, autopilot: int, base_mode: int, custom_mode: int) -> None:
    flight = Flight(flavour)
    flight.advance(5.0)
    heartbeat = flight.last("HEARTBEAT")
    assert (heartbeat.type, heartbeat.autopilot) == (2, autopilot)
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (base_mode, custom_mode, 3)
    assert len(flight.messages("HEARTBEAT")) == 5


def test_ideal_vehicle_presents_itself_as_px4_and_obeys_at_once() -> None:
    flight = Flight("ideal", Start.AIRBORNE)
    flight.fly(0.2, 5.0, 0.0, 0.0)
    assert flight.last("HEARTBEAT").autopilot == 12
    assert flight.velocity == [5.0, 0.0, 0.0]


def test_every_change_of_mode_or_arming_has_a_heartbeat_of_its_own() -> None:
    flight = Flight("ardupilot")
    flight.advance(1.3)
    before = len(flight.messages("HEARTBEAT"))
    flight.command(ARM, 1)
    flight.advance(0.02)
    flight.set_mode(GUIDED)
    flight.advance(0.02)
    assert len(flight.messages("HEARTBEAT")) == before + 2
    assert flight.armed and flight.mode == GUIDED


@pytest.mark.parametrize(
    ("flavour", "parameters", "custom_mode"),
    [
        ("px4", (129, 4, 3), PX4_HOLD),
        ("px4", (1, 4, 6), PX4_LAND),
        ("px4", (129, 3, 0), 0x00030000),
        ("ardupilot", (1, 4, 0), GUIDED),
        ("ardupilot", (1, 5, NAN), 5),
        ("ardupilot", (129, 17, 0), 17),
        ("ardupilot", (1, 9, 0), 9),
    ],
)
def test_modes_are_set_and_told_in_the_numbers_of_the_autopilot(
    flavour: str, parameters: tuple[float, ...], custom_mode: int
) -> None:
    flight = Flight(flavour, Start.AIRBORNE)
    flight.advance(0.1)
    assert flight.command(SET_MODE, *parameters) == ACCEPTED
    flight.advance(0.02)
    assert flight.mode == custom_mode


@pytest.mark.parametrize("parameters", [(0, 4, 3), (1, 77, 0), (1, -1, 0), (1, 1e30, 0), (NAN, NAN, NAN), (1, 4, 4)])
def test_modes_that_do_not_exist_are_denied(parameters: tuple[float, ...]) -> None:
    flight = Flight()
    assert flight.command(SET_MODE, *parameters) == DENIED
    assert flight.autopilot.pilot.mode == "hold"


def test_legacy_set_mode_message_is_understood() -> None:
    flight = Flight("ardupilot")
    flight.send("SET_MODE", target_system=1, base_mode=1, custom_mode=GUIDED)
    flight.advance(0.1)
    assert flight.mode == GUIDED


@both
def test_arming_twice_is_as_good_as_once_and_nobody_disarms_in_the_air(flavour: str) -> None:
    flight = Flight(flavour)
    assert [flight.command(ARM, 1), flight.command(ARM, 1)] == [ACCEPTED, ACCEPTED]
    assert [flight.command(ARM, 0), flight.command(ARM, NAN)] == [ACCEPTED, ACCEPTED]
    flying = airborne(flavour)
    assert flying.command(ARM, 0, 21196) == (TEMPORARILY_REJECTED if flavour == "px4" else FAILED)
    flying.advance(0.1)
    assert flying.armed


# --- telemetry --------------------------------------------------------------------------------------------------------


@both
def test_streams_of_a_fresh_link_have_their_default_rates(flavour: str) -> None:
    flight = Flight(flavour)
    intervals = default_intervals(FLAVOURS[flavour])
    flight.advance(10.0)
    counted = Counter(message.name for _, message in flight.heard[COMPANION])
    assert dict(counted) == pytest.approx({name: 10.0 / interval_s for name, interval_s in intervals.items()}, abs=1)


def test_ardupilot_has_no_estimator_status() -> None:
    flight = Flight("ardupilot")
    flight.advance(3.0)
    assert not flight.messages("ESTIMATOR_STATUS")


def test_telemetry_tells_the_navigation_solution_and_never_the_truth() -> None:
    flight = Flight(start=Start.AIRBORNE, scenario=one_vehicle(sigma_m=10.0))
    flight.advance(1.0)
    local, truth = flight.last("LOCAL_POSITION_NED"), flight.world.position_ned_m[0]
    told = np.array([local.x + START_NED_M[0], local.y, local.z])
    assert told == pytest.approx(flight.world.reported_position_ned_m[0], abs=0.05)
    assert np.linalg.norm(told - truth) > 1.0
    globally = flight.last("GLOBAL_POSITION_INT")
    north_m = (globally.lat / 1e7 - HOME.latitude_deg) * 111_180.0
    assert north_m == pytest.approx(told[0], abs=1.0)
    assert globally.relative_alt / 1e3 == pytest.approx(-told[2], abs=0.2)


@pytest.mark.parametrize(("sigma_m", "h_acc", "v_acc", "vel_acc"), [(3.5, 3500, 5250, 100), (0.0, 1, 1, 1)])
def test_receiver_tells_its_accuracy_in_millimetres(sigma_m: float, h_acc: int, v_acc: int, vel_acc: int) -> None:
    flight = Flight(start=Start.AIRBORNE, scenario=one_vehicle(sigma_m=sigma_m))
    flight.advance(0.5)
    gps = flight.last("GPS_RAW_INT")
    assert (gps.h_acc, gps.v_acc, gps.vel_acc, gps.fix_type) == (h_acc, v_acc, vel_acc, 3)
    assert gps.alt_ellipsoid == gps.alt
    assert flight.last("ESTIMATOR_STATUS").pos_horiz_accuracy == pytest.approx(0.32 * h_acc / 1e3)


@both
def test_losing_the_fix_shows_as_it_does_on_the_real_autopilot(flavour: str) -> None:
    flight = Flight(flavour, Start.AIRBORNE, scenario=one_vehicle(sigma_m=0.3))
    flight.advance(1.0)
    flight.world.receivers.set_outage(0, True)
    flight.advance(7.0)
    gps = flight.last("GPS_RAW_INT")
    if flavour == "ardupilot":
        assert (gps.fix_type, gps.h_acc) == (1, 300)  # it goes on telling the accuracy that it had
        return
    assert (gps.fix_type, gps.h_acc) == (0, 100_000)
    estimator = flight.last("ESTIMATOR_STATUS")
    assert not estimator.flags & 16
    assert estimator.pos_horiz_accuracy > 1.0


@both
def test_heartbeat_and_health_are_what_mavsdk_asks_for(flavour: str) -> None:
    flight = Flight(flavour)
    flight.advance(1.0)
    status = flight.last("SYS_STATUS")
    needed = 0x1 | 0x2 | 0x4 | 0x20 | 0x10000000
    assert status.onboard_control_sensors_health & needed == needed
    fence = status.onboard_control_sensors_health & 0x100000  # without it MAVProxy says "fence breach"
    assert bool(fence) == (flavour == "ardupilot") and not status.onboard_control_sensors_present & 0x100000
    home = flight.last("HOME_POSITION")
    assert home.altitude == pytest.approx(HOME.altitude_m * 1e3, abs=10)
    position = flight.last("GLOBAL_POSITION_INT")
    assert (home.latitude, home.longitude) == pytest.approx((position.lat, position.lon), abs=2)


def test_attitude_leans_into_the_acceleration_and_the_quaternion_agrees() -> None:
    flight = airborne("px4")
    flight.fly(0.5, 0.0, 5.0, 0.0)
    attitude, quaternion = flight.last("ATTITUDE"), flight.last("ATTITUDE_QUATERNION")
    assert attitude.roll > 0.1 and abs(attitude.pitch) < 0.01  # accelerating east with the nose to the north
    w, x, y, z = quaternion.q1, quaternion.q2, quaternion.q3, quaternion.q4
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(attitude.roll, abs=1e-3)


def test_intervals_are_set_and_stopped_and_reset_for_one_link_only() -> None:
    flight = Flight()
    flight.advance(0.5)
    flight.send("HEARTBEAT", type=6)
    assert flight.command(SET_INTERVAL, 49, 1_000_000) == ACCEPTED
    assert flight.command(SET_INTERVAL, 33, 20_000) == ACCEPTED
    assert flight.command(SET_INTERVAL, 32, -1) == ACCEPTED
    assert flight.command(SET_INTERVAL, 331, 500_000) == ACCEPTED
    flight.heard.clear()
    flight.advance(2.0)
    rates = Counter(message.name for _, message in flight.heard[GROUND_STATION])
    others = Counter(message.name for _, message in flight.heard[COMPANION])
    assert rates["GLOBAL_POSITION_INT"] == pytest.approx(100, abs=2)
    assert (rates["LOCAL_POSITION_NED"], rates["ODOMETRY"], rates["GPS_GLOBAL_ORIGIN"]) == (0, 4, 2)
    assert others["GLOBAL_POSITION_INT"] == others["LOCAL_POSITION_NED"] == 20 and others["ODOMETRY"] == 2
    assert flight.command(SET_INTERVAL, 33, NAN) == ACCEPTED
    assert flight.command(SET_INTERVAL, 32, 0) == ACCEPTED
    flight.heard.clear()
    flight.advance(2.0)
    rates = Counter(message.name for _, message in flight.heard[GROUND_STATION])
    assert rates["GLOBAL_POSITION_INT"] == rates["LOCAL_POSITION_NED"] == 20


def test_message_that_cannot_be_streamed_is_answered_as_the_autopilot_does() -> None:
    assert Flight("px4").command(SET_INTERVAL, 105, 100_000) == ACCEPTED
    ardupilot = Flight("ardupilot")
    ardupilot.advance(0.1)
    assert ardupilot.command(SET_INTERVAL, 230, 100_000) == DENIED
    ardupilot.advance(0.1)
    assert any("message interval" in text for text in ardupilot.texts)


@pytest.mark.parametrize(
    ("number", "parameter", "name"),
    [
        (REQUEST, 148, "AUTOPILOT_VERSION"),
        (REQUEST, 242, "HOME_POSITION"),
        (410, 0, "HOME_POSITION"),
        (520, 1, "AUTOPILOT_VERSION"),
        (REQUEST, 49, "GPS_GLOBAL_ORIGIN"),
    ],
)
def test_messages_are_sent_when_asked_for(number: int, parameter: float, name: str) -> None:
    flight = Flight()
    answers = flight.send("COMMAND_LONG", target_system=1, command=number, param1=parameter)
    assert [answer.name for answer in answers] == ["COMMAND_ACK", name]
    assert answers[0].result == ACCEPTED


def test_legacy_stream_request_sets_rates_of_a_group() -> None:
    flight = Flight("ardupilot")
    flight.advance(0.1)
    flight.send("REQUEST_DATA_STREAM", target_system=1, req_stream_id=6, req_message_rate=4, start_stop=1)
    flight.send("REQUEST_DATA_STREAM", target_system=1, req_stream_id=10, req_message_rate=4, start_stop=0)
    flight.advance(0.2)
    flight.heard.clear()
    flight.advance(5.0)
    assert len(flight.messages("GLOBAL_POSITION_INT", GROUND_STATION)) == pytest.approx(20, abs=1)
    assert not flight.messages("ATTITUDE", GROUND_STATION)
    assert len(flight.messages("ATTITUDE")) == 50


# --- commands ---------------------------------------------------------------------------------------------------------


@both
def test_commands_come_in_both_forms_and_for_component_zero(flavour: str) -> None:
    flight = Flight(flavour)
    for name in ("COMMAND_LONG", "COMMAND_INT"):
        (answer,) = flight.send(name, target_system=1, target_component=0, command=ARM, param1=1.0)
        assert (answer.name, answer.result, answer.target_component) == ("COMMAND_ACK", ACCEPTED, 190)
    assert flight.autopilot.pilot.armed


def test_commands_for_somebody_else_are_not_answered() -> None:
    flight = Flight()
    assert flight.send("COMMAND_LONG", target_system=2, target_component=1, command=ARM, param1=1.0) == []
    assert flight.send("COMMAND_LONG", target_system=1, target_component=154, command=1000) == []
    assert not flight.autopilot.pilot.armed


@pytest.mark.parametrize("number", [0, 31000, 246, 65535])
def test_unknown_commands_are_unsupported_and_said_so(number: int) -> None:
    flight = Flight()
    flight.advance(0.02)
    assert flight.command(number) == UNSUPPORTED
    flight.advance(0.02)
    assert flight.texts == [f"command {number}: unsupported"]


@pytest.mark.parametrize("unused", [0.0, NAN])
def test_px4_takes_off_to_its_parameter_and_holds(unused: float) -> None:
    flight = Flight()
    flight.advance(0.1)
    assert flight.command(TAKEOFF, *[unused] * 7) == TEMPORARILY_REJECTED  # not armed
    flight.command(ARM, 1)
    assert flight.command(TAKEOFF, *[unused] * 7) == ACCEPTED
    flight.advance(0.5)
    assert flight.mode == PX4_TAKEOFF and flight.last("EXTENDED_SYS_STATE").landed_state == 3
    assert flight.command(TAKEOFF, *[unused] * 7) == ACCEPTED
    flight.advance(4.0)
    assert flight.mode == PX4_HOLD and flight.last("EXTENDED_SYS_STATE").landed_state == 2
    assert flight.height_m == pytest.approx(2.5, abs=0.4)


def test_px4_takes_a_takeoff_altitude_as_one_above_the_sea() -> None:
    flight = Flight()
    flight.command(ARM, 1)
    assert flight.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, HOME.altitude_m + 8.0) == ACCEPTED
    flight.advance(8.0)
    assert flight.height_m == pytest.approx(8.0, abs=0.5)


def test_ardupilot_takes_off_in_guided_to_the_height_given() -> None:
    flight = Flight("ardupilot")
    flight.command(ARM, 1)
    assert flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 6.0) == FAILED
    flight.set_mode(GUIDED)
    assert flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 6.0) == ACCEPTED
    flight.advance(10.0)
    assert flight.mode == GUIDED and flight.height_m == pytest.approx(6.0, abs=0.5)


def test_ardupilot_tells_a_place_while_it_climbs_as_its_guided_take_off_does() -> None:
    """A velocity that changes in GUIDED would look as if somebody else sent setpoints."""
    flight = Flight("ardupilot")
    flight.command(SET_MODE, 1, GUIDED)
    flight.command(ARM, 1)
    flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 6.0)
    flight.advance(1.0)
    target = flight.last("POSITION_TARGET_LOCAL_NED")
    assert target.type_mask == 0x0DF8 and target.z == -6.0


def test_a_setpoint_during_takeoff_ends_the_climb_of_ardupilot() -> None:
    flight = Flight("ardupilot")
    flight.command(ARM, 1)
    flight.set_mode(GUIDED)
    flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 20.0)
    flight.advance(3.0)
    flight.fly(5.0, 0.0, 0.0, 0.0)
    assert flight.height_m < 10.0


@both
def test_takeoff_height_is_held_although_the_receiver_is_metres_off(flavour: str) -> None:
    flight = Flight(flavour, scenario=one_vehicle(sigma_m=10.0), gnss="bias")
    flight.command(ARM, 1)
    flight.set_mode(GUIDED)
    flight.send("PARAM_SET", target_system=1, param_id="MIS_TAKEOFF_ALT", param_value=10.0, param_type=9)
    flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0 if flavour == "ardupilot" else NAN)
    flight.advance(12.0)
    assert flight.height_m == pytest.approx(10.0, abs=0.8)


@both
def test_landing_ends_on_the_ground_and_disarms(flavour: str) -> None:
    flight = airborne(flavour)
    flight.world.position_ned_m[0, 2] = -3.0
    flight.autopilot.pilot.estimate.down_m = -3.0
    assert flight.command(LAND) == ACCEPTED
    assert flight.command(LAND) == ACCEPTED
    flight.advance(1.0)
    assert flight.last("EXTENDED_SYS_STATE").landed_state == 4
    flight.advance(6.0)
    assert flight.height_m == 0.0 and not flight.armed
    assert flight.last("EXTENDED_SYS_STATE").landed_state == 1
    assert flight.command(LAND) == ACCEPTED


@both
def test_a_landing_can_be_called_off(flavour: str) -> None:
    flight = airborne(flavour)
    flight.command(LAND)
    flight.advance(3.0)
    assert offboard(flight) == ACCEPTED
    flight.fly(3.0, 0.0, 0.0, 0.0)
    height_m = flight.height_m
    flight.fly(3.0, 0.0, 0.0, 0.0)
    assert flight.height_m == pytest.approx(height_m, abs=0.1)


@both
@pytest.mark.parametrize("form", ["COMMAND_LONG", "COMMAND_INT"])
def test_reposition_flies_to_the_point_and_stays(flavour: str, form: str) -> None:
    flight = airborne(flavour)
    latitude = HOME.latitude_deg + (START_NED_M[0] + 30.0) / 111_180.0
    fields: dict[str, Any] = {"param2": 1.0, "param4": NAN}
    if form == "COMMAND_INT":
        fields |= {"frame": 5, "x": round(latitude * 1e7), "y": round(HOME.longitude_deg * 1e7)}
        fields["z"] = HOME.altitude_m + 45.0
    else:
        fields |= {"param5": latitude, "param6": HOME.longitude_deg, "param7": HOME.altitude_m + 45}
    (answer,) = flight.send(form, target_system=1, command=REPOSITION, **fields)
    assert answer.result == ACCEPTED
    flight.advance(30.0)
    target = (START_NED_M[0] + 30.0, 0.0, -45.0)
    assert flight.world.position_ned_m[0] == pytest.approx(target, abs=1.5)
    assert flight.mode == (PX4_HOLD if flavour == "px4" else GUIDED)


@both
def test_return_comes_home_and_lands(flavour: str) -> None:
    flight = airborne(flavour, start_ned_m=(-200.0, 0.0, -10.0))
    flight.send("PARAM_SET", target_system=1, param_id="RTL_RETURN_ALT", param_value=15.0, param_type=9)
    flight.fly(3.0, 8.0, 0.0, 0.0)
    assert flight.command(RETURN) == ACCEPTED
    flight.advance(45.0)
    assert flight.world.position_ned_m[0] == pytest.approx((START_NED_M[0], 0.0, 0.0), abs=1.5)
    assert not flight.armed


# --- setpoints --------------------------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize(
    ("mask", "frame"),
    [(0x0DC7, 1), (0x09C7, 1), (0x05C7, 1), (0x0FC7, 1), (0x0C07, 1), (0x0DC7, 7), (0x0FC7, 8), (0x05C7, 9)],
)
def test_every_clients_velocity_mask_moves_the_vehicle_alike(flavour: str, mask: int, frame: int) -> None:
    flight = airborne(flavour)
    flight.fly(3.0, 4.0, 0.0, 0.0, mask=mask, frame=frame)
    assert flight.velocity == pytest.approx([4.0, 0.0, 0.0], abs=1.0)
    target = flight.last("POSITION_TARGET_LOCAL_NED")
    assert (target.vx, target.vy, target.vz) == pytest.approx((4.0, 0.0, 0.0), abs=1e-5)


def test_body_frames_turn_with_the_nose() -> None:
    flight = airborne("px4")
    flight.fly(3.0, 0.0, 0.0, 0.0, mask=0x09C7, yaw=math.pi / 2.0)
    assert flight.last("GLOBAL_POSITION_INT").hdg == 9000
    flight.fly(4.0, 3.0, 0.0, 0.0, frame=8)
    assert flight.velocity == pytest.approx([0.0, 3.0, 0.0], abs=0.8)


def test_ardupilot_turns_its_nose_into_the_flight_and_px4_does_not() -> None:
    headings = {}
    for flavour in ("px4", "ardupilot"):
        flight = airborne(flavour)
        flight.fly(4.0, 0.0, 4.0, 0.0)
        headings[flavour] = flight.last("GLOBAL_POSITION_INT").hdg
    assert headings == {"px4": 0, "ardupilot": 9000}


@both
@pytest.mark.parametrize("axis", [0x008, 0x010, 0x020])
def test_ignoring_one_velocity_axis_stops_the_vehicle(flavour: str, axis: int) -> None:
    flight = airborne(flavour)
    flight.fly(2.0, 4.0, 2.0, 0.0)
    flight.fly(6.0, 4.0, 2.0, 0.0, mask=0x0DC7 | axis)
    assert math.hypot(*flight.velocity[:2]) < 0.6


@both
def test_what_is_not_finite_is_not_taken_and_said_so(flavour: str) -> None:
    flight = airborne(flavour)
    flight.fly(3.0, 4.0, 0.0, 0.0)
    flight.setpoint(0.0, NAN, 0.0)
    flight.setpoint(math.inf, 0.0, 0.0)
    flight.setpoint(3e38, 3e38, 0.0, frame=8)
    flight.advance(0.1)
    kept = 4.0 if flavour == "px4" else 0.0  # ArduPilot stops
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(kept)
    assert sum("not finite" in text for text in flight.texts) == 1  # the same text once a second


def test_unknown_frames_are_refused_in_words() -> None:
    flight = airborne("px4")
    flight.setpoint(1.0, 0.0, 0.0, frame=12)
    flight.advance(0.1)
    assert any("frame 12" in text for text in flight.texts)


@both
def test_setpoints_outside_their_mode_are_dropped_without_a_word(flavour: str) -> None:
    flight = Flight(flavour, Start.HOLDING)
    flight.fly(2.0, 5.0, 0.0, 0.0)
    flight.setpoint(NAN, 0.0, 0.0)
    flight.advance(0.1)
    assert flight.velocity == [0.0, 0.0, 0.0]
    assert flight.texts == []


@both
def test_position_setpoints_are_flown_to(flavour: str) -> None:
    flight = airborne(flavour)
    flight.fly(20.0, mask=0x0DF8, x=10.0, y=-5.0, z=-48.0)
    assert flight.world.position_ned_m[0] == pytest.approx((START_NED_M[0] + 10.0, -5.0, -48.0), abs=1.0)


def test_setpoints_of_ardupilot_may_name_another_component_and_those_of_px4_may_not() -> None:
    for flavour, moved in (("ardupilot", True), ("px4", False)):
        flight = Flight(flavour, Start.AIRBORNE)
        fields: dict[str, Any] = {"coordinate_frame": 1, "type_mask": 0x0DC7, "vx": 3.0}
        flight.send("SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=195, **fields)
        flight.send("SET_POSITION_TARGET_LOCAL_NED", target_system=2, target_component=1, **fields)
        flight.advance(2.0)
        assert (flight.velocity[0] > 0.5) is moved


# --- silence ----------------------------------------------------------------------------------------------------------


def test_px4_refuses_offboard_without_a_stream() -> None:
    flight = Flight(start=Start.HOLDING)
    flight.advance(0.1)
    assert flight.set_mode(6) == TEMPORARILY_REJECTED
    flight.setpoint(1.0, 0.0, 0.0)
    flight.advance(1.5)
    assert flight.set_mode(6) == TEMPORARILY_REJECTED  # too old
    flight.setpoint(1.0, 0.0, 0.0)
    assert flight.set_mode(6) == ACCEPTED


def test_px4_returns_after_a_second_of_silence_and_takes_the_stream_up_again() -> None:
    flight = airborne("px4")
    flight.fly(6.0, 5.0, 0.0, 0.0)
    flight.advance(0.8)
    assert flight.mode == PX4_OFFBOARD
    flight.advance(0.4)
    assert flight.mode == PX4_RETURN and flight.last("HEARTBEAT").system_status == 5
    assert "Failsafe activated: no offboard signal, return" in flight.texts
    flight.advance(4.0)
    assert flight.velocity[0] < -2.0  # back to where it came from, whoever may be there
    flight.fly(0.2, 5.0, 0.0, 0.0)
    assert flight.mode == PX4_OFFBOARD


def test_px4_does_not_return_to_offboard_once_somebody_chose_a_mode() -> None:
    flight = airborne("px4")
    flight.fly(1.0, 5.0, 0.0, 0.0)
    flight.advance(1.2)
    assert flight.set_mode(4, 3) == ACCEPTED
    flight.fly(1.0, 5.0, 0.0, 0.0)
    assert flight.mode == PX4_HOLD


def test_ardupilot_flies_blind_for_three_seconds_and_brakes() -> None:
    flight = airborne("ardupilot")
    flight.fly(5.0, 5.0, 0.0, 0.0)
    flight.advance(2.8)
    assert flight.velocity[0] == pytest.approx(5.0, abs=0.2)
    flight.advance(4.0)
    assert abs(flight.velocity[0]) < 0.3
    assert flight.mode == GUIDED


@both
def test_an_airborne_start_waits_for_its_first_setpoint_as_long_as_it_takes(flavour: str) -> None:
    flight = Flight(flavour, Start.AIRBORNE)
    flight.advance(20.0)
    assert flight.armed and flight.mode == (PX4_OFFBOARD if flavour == "px4" else GUIDED)
    assert flight.world.position_ned_m[0] == pytest.approx(START_NED_M)
    flight.fly(3.0, 0.0, 3.0, 0.0)
    assert flight.velocity[1] > 1.5


def test_daemon_is_heard_by_its_heartbeat_and_its_setpoints() -> None:
    flight = Flight(start=Start.AIRBORNE)
    daemon = Encoder(1, 196)
    flight.fly(0.5, 1.0, 0.0, 0.0)
    assert not flight.autopilot.is_avoiding  # somebody steers, but no daemon
    flight.send("HEARTBEAT", sender=daemon, type=18, autopilot=8)
    flight.fly(0.5, 1.0, 0.0, 0.0)
    assert flight.autopilot.is_avoiding
    flight.fly(3.0, 1.0, 0.0, 0.0)
    assert not flight.autopilot.is_avoiding  # its heartbeat has stopped
    flight.send("HEARTBEAT", sender=daemon, type=18, autopilot=8)
    flight.advance(1.2)
    assert not flight.autopilot.is_avoiding  # its setpoints have


# --- the world has its say --------------------------------------------------------------------------------------------


@both
def test_who_has_arrived_lands_and_takes_no_orders(flavour: str) -> None:
    short = one_vehicle(start_ned_m=(-200.0, 0.0, -5.0), goal_ned_m=(-185.0, 0.0, -5.0))
    flight = Flight(flavour, Start.AIRBORNE, scenario=short)
    flight.fly(6.0, 5.0, 0.0, 0.0)
    assert flight.world.arrived[0]
    assert flight.mode == (PX4_LAND if flavour == "px4" else 9)
    assert offboard(flight) == (TEMPORARILY_REJECTED if flavour == "px4" else FAILED)
    flight.advance(20.0)
    assert not flight.armed and flight.height_m == 0.0


@both
@pytest.mark.parametrize("start", [Start.GROUND, Start.AIRBORNE])
def test_who_avoids_nobody_flies_straight_to_its_goal_by_itself(flavour: str, start: Start) -> None:
    flight = Flight(flavour, start, scenario=one_vehicle(cooperative=False, goal_ned_m=(-100.0, 0.0, -50.0)))
    flight.advance(25.0 if start is Start.GROUND else 1.0)
    assert flight.world.position_ned_m[0] == pytest.approx(START_NED_M, abs=1.0)
    assert flight.armed and flight.mode == (0x04040000 if flavour == "px4" else 3)
    assert flight.set_mode(4, 3) == (TEMPORARILY_REJECTED if flavour == "px4" else FAILED)
    flight.world.begin_mission()
    flight.autopilot.pilot.begin_mission()
    flight.fly(3.0, 0.0, 5.0, 0.0)
    assert flight.velocity[0] > 4.0 and abs(flight.velocity[1]) < 0.1
    flight.advance(20.0)
    assert flight.world.arrived[0]


def test_px4_leaves_the_ground_on_a_climbing_setpoint_and_ardupilot_does_not() -> None:
    for flavour, flies in (("px4", True), ("ardupilot", False)):
        flight = Flight(flavour)
        flight.command(ARM, 1)
        assert offboard(flight) == ACCEPTED
        flight.fly(2.0, 0.0, 0.0, -2.0)
        assert (flight.height_m > 1.0) is flies


def test_a_wreck_is_silent() -> None:
    flight = Flight(start=Start.AIRBORNE)
    flight.advance(1.0)
    flight.world.state[0] = VehicleState.GONE
    flight.advance(0.02)
    flight.heard.clear()
    flight.advance(2.0)
    assert flight.send("PING", seq=1) == []
    assert flight.heard == {}


# --- parameters, clocks, peers ----------------------------------------------------------------------------------------


@both
def test_parameters_are_listed_read_and_set(flavour: str) -> None:
    flight = Flight(flavour)
    listed = flight.send("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    names = [value.param_id.rstrip(b"\x00").decode() for value in listed]
    assert [value.param_index for value in listed] == list(range(listed[0].param_count))
    assert {"px4": {"MIS_TAKEOFF_ALT", "RTL_RETURN_ALT", "MPC_XY_VEL_MAX"}, "ardupilot": {"RTL_ALT", "WPNAV_SPEED"}}[
        flavour
    ] <= set(names)
    name = "RTL_RETURN_ALT" if flavour == "px4" else "WPNAV_SPEED"
    by_name = flight.send("PARAM_REQUEST_READ", target_system=1, param_id=name, param_index=-1)
    assert by_name == flight.send("PARAM_REQUEST_READ", target_system=1, param_index=names.index(name))
    (echo,) = flight.send("PARAM_SET", target_system=1, param_id=name, param_value=42.5, param_type=9)
    assert echo.param_value == 42.5
    (refused,) = flight.send("PARAM_SET", target_system=1, param_id=name, param_value=NAN, param_type=9)
    assert refused.param_value == 42.5
    assert flight.send("PARAM_REQUEST_READ", target_system=1, param_id="NO_SUCH", param_index=-1) == []


def test_integers_are_bits_for_px4_and_values_for_ardupilot() -> None:
    (px4,) = Flight().send("PARAM_REQUEST_READ", target_system=1, param_id="SYS_AUTOSTART", param_index=-1)
    assert (struct.unpack("<i", struct.pack("<f", px4.param_value))[0], px4.param_type) == (10040, 6)
    flight = Flight("ardupilot")
    (ardupilot,) = flight.send("PARAM_SET", target_system=1, param_id="RTL_ALT", param_value=2000.0, param_type=6)
    assert (ardupilot.param_value, ardupilot.param_type) == (2000.0, 6)


def test_timesync_and_ping_are_answered_once() -> None:
    flight = Flight()
    flight.advance(1.0)
    (answer,) = flight.send("TIMESYNC", tc1=0, ts1=123)
    assert (answer.ts1, answer.tc1) == (123, 1_000_000_000)
    assert flight.send("TIMESYNC", tc1=5, ts1=123) == []
    (pong,) = flight.send("PING", time_usec=9, seq=3)
    assert (pong.seq, pong.time_usec, pong.target_system, pong.target_component) == (3, 9, 255, 190)
    assert flight.send("PING", seq=3, target_system=1, target_component=1) == []
    assert flight.last("SYSTEM_TIME").time_unix_usec == UTC_S * 1e6


@both
def test_file_transfer_is_refused_at_once_so_that_nobody_waits_for_it(flavour: str) -> None:
    """MAVProxy asks for a file of parameters first, and knows none of them until it has an answer."""
    flight = Flight(flavour)

    def ask(opcode: int) -> tuple[Any, ...]:
        request = struct.pack("<HBBBBBBI", 7, 3, opcode, 0, 0, 0, 0, 0)
        (answer,) = flight.send("FILE_TRANSFER_PROTOCOL", target_system=1, target_component=1, payload=request)
        assert (answer.target_system, answer.target_component) == (255, 190)
        return (*struct.unpack_from("<HBBBB", answer.payload), answer.payload[12])

    open_for_reading, terminate = 4, 1
    assert ask(open_for_reading) == (8, 3, 129, 1, open_for_reading, 7)  # NAK, unknown command
    assert ask(terminate) == (8, 3, 128, 0, terminate, 0)
    answer_of_somebody = bytes([0, 0, 0, 128])
    assert flight.send("FILE_TRANSFER_PROTOCOL", target_system=1, payload=answer_of_somebody) == []


def test_four_others_are_served_beside_the_companion_until_they_fall_silent() -> None:
    flight = Flight()
    flight.advance(0.1)
    others = [("127.0.0.1", 50000 + k) for k in range(5)]
    for address in others:
        answer = flight.send("PING", address=address, seq=1)
        assert answer[0].name == "PING"  # the fifth is answered, but gets no streams
    flight.advance(1.0)
    assert [len(flight.messages("HEARTBEAT", address)) for address in [COMPANION, *others]] == [2, 1, 1, 1, 1, 0]
    flight.advance(5.0)
    flight.send("HEARTBEAT", address=others[0], type=6)
    flight.advance(6.0)
    flight.heard.clear()
    flight.advance(1.0)
    assert set(flight.heard) == {COMPANION, others[0]}
    flight.send("HEARTBEAT", address=others[4], type=6)
    flight.advance(1.0)
    assert flight.messages("HEARTBEAT", others[4])


def test_sequence_numbers_of_a_link_have_no_gaps() -> None:
    flight = Flight()
    flight.advance(0.1)
    flight.send("HEARTBEAT", type=6)
    seen: list[int] = []
    for _ in range(100):
        flight.now_s += 0.02
        flight.world.step(0.02)
        for datagram, address in flight.autopilot.tick(flight.now_s) + flight.autopilot.receive(
            flight.client.encode("PING", seq=1), GROUND_STATION, flight.now_s
        ):
            if address == GROUND_STATION:
                at = 0
                while at < len(datagram):
                    seen.append(datagram[at + 4])
                    at += 12 + datagram[at + 1]
    assert len(seen) > 150
    assert all((one + 1) % 256 == other for one, other in itertools.pairwise(seen))


# --- what no client would send ----------------------------------------------------------------------------------------

HANDLED = ["HEARTBEAT", "PING", "TIMESYNC", "SET_MODE", "COMMAND_LONG", "COMMAND_INT", "SET_POSITION_TARGET_LOCAL_NED",
           "SET_POSITION_TARGET_GLOBAL_INT", "RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL", "ADSB_VEHICLE",
           "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET", "REQUEST_DATA_STREAM", "FILE_TRANSFER_PROTOCOL",
           *(f"MISSION_{name}" for name in ("COUNT", "ITEM_INT", "ITEM", "REQUEST_LIST", "REQUEST_INT", "REQUEST",
                                            "CLEAR_ALL", "SET_CURRENT", "WRITE_PARTIAL_LIST", "ACK"))]  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes_are_survived(datagram: bytes) -> None:
    flight = Flight(start=Start.AIRBORNE)
    assert flight.autopilot.receive(datagram, GROUND_STATION, flight.now_s) is not None
    flight.advance(0.02)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(HANDLED), st.binary(max_size=60)), min_size=1, max_size=8), st.data())
def test_any_fields_of_well_formed_frames_are_survived(sent: list[tuple[str, bytes]], data: st.DataObject) -> None:
    """Checksums are right, targets are ours, everything else is whatever it is; the vehicle goes on talking."""
    flight = Flight(data.draw(st.sampled_from(["px4", "ardupilot"])), data.draw(st.sampled_from(list(Start))))
    for name, noise in sent:
        spec = message_spec(name)
        payload = bytearray(noise.ljust(spec.size, b"\x00")[: spec.size])
        offset = 0
        for field, kind, length in zip(spec.fields, spec.types, spec.array_lengths, strict=True):
            if field in ("target_system", "target_component"):
                payload[offset] = 1
            offset += struct.calcsize({"char": "c", "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H",
                                       "int32_t": "i", "uint32_t": "I", "float": "f", "int64_t": "q", "uint64_t": "Q",
                                       "double": "d"}[kind]) * max(length, 1)  # fmt: skip
        frame = encode_frame(spec.msgid, bytes(payload), spec.crc_extra, seq=0, sysid=255, compid=190)
        flight.autopilot.receive(frame, GROUND_STATION, flight.now_s)
        flight.advance(0.04)
    assert np.all(np.isfinite(flight.world.position_ned_m))
    flight.advance(1.02)
    assert flight.messages("HEARTBEAT")


def test_frames_of_every_other_message_are_ignored() -> None:
    flight = Flight(start=Start.AIRBORNE)
    flight.advance(0.1)
    for spec in MESSAGES.values():
        if spec.name not in HANDLED:
            frame = encode_frame(spec.msgid, b"\xff" * spec.size, spec.crc_extra, seq=0, sysid=255, compid=190)
            assert flight.autopilot.receive(frame, GROUND_STATION, flight.now_s) == []
    assert flight.autopilot.counters["taken"] == 0


def test_a_datagram_is_read_frame_by_frame_up_to_a_limit_with_garbage_between() -> None:
    flight = Flight()
    ping = [flight.client.encode("PING", seq=k) for k in range(80)]
    answers = flight._note(flight.autopilot.receive(b"\x00\xfd\x12".join(ping), GROUND_STATION, flight.now_s))
    assert 40 <= len(answers) <= 64
    assert flight.autopilot.receive(b"", GROUND_STATION, flight.now_s) == []
    assert flight.autopilot.receive(b"\xfd" * 65507, GROUND_STATION, flight.now_s) == []
