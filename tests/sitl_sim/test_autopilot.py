"""The emulated autopilot does what real ones were seen to do, and survives what no client would send."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.mavlink.codec import MESSAGES, message_spec
from ridlink.mavlink.frames import encode_frame
from sitl_sim.autopilot import Start
from sitl_sim.autopilot.mission_items import UNUSED_INT
from sitl_sim.vehicle import VehicleState
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
    PX4_HOLD,
    PX4_LAND,
    PX4_OFFBOARD,
    PX4_RETURN,
    PX4_TAKEOFF,
    REPOSITION,
    REQUEST,
    RETURN,
    SET_MODE,
    START_NED_M,
    TAKEOFF,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    UTC_S,
    Flight,
    airborne,
    both,
    offboard,
    one_vehicle,
)

# --- heartbeat, modes, arming -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flavour", "autopilot", "base_mode", "custom_mode"), [("px4", 12, 29, PX4_HOLD), ("ardupilot", 3, 81, 0)]
)
def test_heartbeat_presents_the_autopilot(flavour: str, autopilot: int, base_mode: int, custom_mode: int) -> None:
    flight = Flight(flavour)
    flight.advance(5.0)
    heartbeat = flight.last("HEARTBEAT")
    assert (heartbeat.type, heartbeat.autopilot) == (2, autopilot)
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (base_mode, custom_mode, 3)
    assert len(flight.messages("HEARTBEAT")) == 5


@pytest.mark.parametrize(
    ("flavour", "recorded"),
    [
        ("px4", [(29, 3), (17, 3), (145, 4), (157, 4)]),
        ("ardupilot", [(81, 3), (89, 3), (217, 3), (217, 4), (209, 4)]),
    ],
)
def test_heartbeats_of_a_flight_have_the_flags_and_states_of_the_recorded_ones(flavour: str, recorded: Any) -> None:
    """Base mode and system status before arming, armed on the ground, in the air and landing, as both were recorded."""
    flight = Flight(flavour)
    flight.fly(1.1)
    offboard(flight)
    flight.fly(1.1)
    flight.command(ARM, 1)
    flight.fly(1.1)
    if flavour == "ardupilot":
        flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0)
        flight.advance(5.0)
    flight.fly(3.0, 0.0, 0.0, -2.0)
    flight.command(LAND)
    flight.advance(1.0)
    told = [(beat.base_mode, beat.system_status) for _, beat in flight.messages("HEARTBEAT")]
    assert [*dict.fromkeys(told)] == recorded


def test_ardupilot_says_that_it_arms_and_disarms() -> None:
    flight = Flight("ardupilot")
    for wanted in (1, 1, 0):
        flight.command(ARM, wanted)
        flight.advance(0.1)
    assert flight.texts == ["Arming motors", "Disarming motors"]


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


@pytest.mark.parametrize(
    ("flavour", "parameters", "result"),
    [
        ("ardupilot", (0, 4, 3), DENIED),  # without the flag of a mode in its own numbers
        ("ardupilot", (NAN, NAN, NAN), DENIED),
        *(("ardupilot", (1, number, 0), FAILED) for number in (7, 77, -1, 1e30)),
        *(("px4", parameters, ACCEPTED) for parameters in ((0, 4, 3), (NAN, NAN, NAN), (1, 77, 0), (1, -1, 0))),
        ("px4", (1, 4, 99), TEMPORARILY_REJECTED),
        ("px4", (1, 5, 0), TEMPORARILY_REJECTED),  # acrobatics want a pilot
        ("px4", (1, 7, 0), TEMPORARILY_REJECTED),
    ],
)
def test_modes_that_do_not_exist_change_nothing(flavour: str, parameters: tuple[float, ...], result: int) -> None:
    """PX4 accepts what it does not know, unless it is a sub mode of AUTO."""
    flight = Flight(flavour)
    before = flight.autopilot.pilot.mode
    assert flight.command(SET_MODE, *parameters) == result
    assert flight.autopilot.pilot.mode is before


@pytest.mark.parametrize(
    ("parameters", "custom_mode"),
    [((1, 6, 5), PX4_OFFBOARD), ((1, 3, 7), 0x00030000), ((1, 1, NAN), 0x00010000), ((1, 4, 5), PX4_RETURN)],
)
def test_only_auto_of_px4_has_sub_modes(parameters: tuple[float, ...], custom_mode: int) -> None:
    flight = Flight("px4", Start.HOLDING)
    flight.setpoint(0.0, 0.0, 0.0)
    assert flight.command(SET_MODE, *parameters) == ACCEPTED
    flight.advance(0.02)
    assert flight.mode == custom_mode


@both
@pytest.mark.parametrize("value", [2.0, -1.0, 0.4])
def test_arming_is_one_and_disarming_zero(flavour: str, value: float) -> None:
    """PX4 rounds, and gives no answer to any other number."""
    flight = Flight(flavour)
    answers = flight.send("COMMAND_LONG", target_system=1, target_component=1, command=ARM, param1=value)
    flight.advance(0.1)
    assert not flight.armed
    if flavour == "ardupilot":
        assert [answer.result for answer in answers] == [UNSUPPORTED]
    elif value == 0.4:
        assert [answer.result for answer in answers] == [ACCEPTED]
    else:
        assert answers == [] and flight.texts == [f"Unsupported ARM_DISARM param: {value:.3f}"]


@pytest.mark.parametrize(("flavour", "mode", "command"), [("px4", PX4_RETURN, 176), ("ardupilot", GUIDED, 11)])
def test_legacy_set_mode_message_is_understood_and_acknowledged(flavour: str, mode: int, command: int) -> None:
    flight = Flight(flavour, Start.HOLDING)
    wrong = (ACCEPTED, ACCEPTED) if flavour == "px4" else (DENIED, FAILED)
    asked = {"base_mode": 1}, {}, {"base_mode": 1, "custom_mode": 99}
    for fields, result in zip(asked, (ACCEPTED, *wrong), strict=True):
        (answer,) = flight.send("SET_MODE", target_system=1, **({"custom_mode": mode} | fields))
        assert (answer.name, answer.command, answer.result, answer.target_system) == (
            "COMMAND_ACK",
            command,
            result,
            255,
        )
    flight.advance(0.1)
    assert flight.mode == mode


@both
def test_arming_twice_is_as_good_as_once_and_nobody_disarms_in_the_air(flavour: str) -> None:
    flight = Flight(flavour)
    assert [flight.command(ARM, 1), flight.command(ARM, 1)] == [ACCEPTED, ACCEPTED]
    assert [flight.command(ARM, 0), flight.command(ARM, 0)] == [ACCEPTED, ACCEPTED]
    flying = airborne(flavour)
    assert flying.command(ARM, 0, 21196) == (TEMPORARILY_REJECTED if flavour == "px4" else FAILED)
    flying.advance(0.1)
    assert flying.armed


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


@both
def test_px4_takes_no_command_that_is_for_every_system(flavour: str) -> None:
    """As clients send it that have heard no heartbeat yet. It gets no answer, but for two old requests."""
    flight = Flight(flavour)
    taken = flavour == "ardupilot"
    for command, answered in ((ARM, taken), (REQUEST, taken), (520, True)):
        answers = flight.send("COMMAND_LONG", target_system=0, target_component=0, command=command, param1=1.0)
        assert [answer.result for answer in answers if answer.name == "COMMAND_ACK"] == [ACCEPTED] * answered
    flight.advance(0.1)
    assert flight.armed is taken and flight.texts == (["Arming motors"] if taken else [])


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


def test_px4_that_is_told_to_take_off_does_so_when_it_is_armed() -> None:
    """QGroundControl sends the take-off first, and arms once it is accepted."""
    flight = Flight()
    assert flight.command(TAKEOFF, -1, 0, 0, NAN, NAN, NAN, HOME.altitude_m + 8.0) == ACCEPTED
    flight.advance(3.0)
    assert flight.mode == PX4_TAKEOFF and not flight.armed and flight.height_m == 0.0
    assert flight.last("EXTENDED_SYS_STATE").landed_state == 1
    assert flight.command(ARM, 1) == ACCEPTED
    flight.advance(8.0)
    assert flight.mode == PX4_HOLD and flight.height_m == pytest.approx(8.0, abs=0.5)


def test_px4_that_is_higher_than_its_takeoff_altitude_says_so_and_stays() -> None:
    """As with a height above home, which PX4 reads as one above the sea."""
    flight = Flight()
    flight.command(ARM, 1)
    assert flight.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 10.0) == ACCEPTED
    flight.advance(5.0)
    assert flight.height_m == 0.0 and flight.texts == ["Already higher than takeoff altitude"]
    assert flight.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, HOME.altitude_m + 6.0) == ACCEPTED
    flight.advance(8.0)
    assert flight.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, HOME.altitude_m + 3.0) == ACCEPTED
    flight.advance(3.0)
    assert flight.height_m == pytest.approx(6.0, abs=0.5) and flight.mode == PX4_HOLD
    assert flight.texts.count("Already higher than takeoff altitude") == 2


def test_a_second_takeoff_in_the_air_climbs_on_or_is_refused() -> None:
    px4, ardupilot = flights = Flight("px4"), Flight("ardupilot")
    for flight, base_m in zip(flights, (HOME.altitude_m, 0.0), strict=True):
        flight.command(SET_MODE, 1, GUIDED)
        flight.command(ARM, 1)
        for _ in range(2):  # the acknowledgement may have been lost
            assert flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, base_m + 5.0) == ACCEPTED
            flight.advance(0.5)
        flight.advance(7.0)
    assert px4.command(TAKEOFF, 0, 0, 0, 0, 0, 0, HOME.altitude_m + 9.0) == ACCEPTED
    assert ardupilot.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 9.0) == FAILED
    px4.advance(6.0)
    ardupilot.advance(6.0)
    assert px4.height_m == pytest.approx(9.0, abs=0.5) and ardupilot.height_m == pytest.approx(5.0, abs=0.5)
    assert px4.command(TAKEOFF) == ACCEPTED  # by the usual height more
    px4.advance(4.0)
    assert px4.height_m == pytest.approx(11.5, abs=0.5)


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


@pytest.mark.parametrize(("down", "name"), [(LAND, "LAND"), (RETURN, "RTL")])
def test_ardupilot_is_not_armed_in_the_mode_in_which_it_has_landed(down: int, name: str) -> None:
    flight = Flight("ardupilot", Start.AIRBORNE, scenario=one_vehicle(start_ned_m=(-200.0, 0.0, -3.0)))
    flight.send("PARAM_SET", target_system=1, param_id="RTL_ALT", param_value=300.0)
    flight.command(down)
    flight.advance(10.0)
    assert not flight.armed
    assert flight.command(ARM, 1) == FAILED
    flight.advance(0.1)
    assert f"arming refused: {name} mode not armable" in flight.texts
    flight.set_mode(17)  # BRAKE, which MAVSDK takes for its hold before it arms again
    assert flight.command(ARM, 1) == ACCEPTED


@pytest.mark.parametrize(
    ("before", "down"), [(PX4_HOLD, LAND), (PX4_HOLD, RETURN), (PX4_OFFBOARD, LAND), (PX4_OFFBOARD, None)]
)
def test_px4_is_in_the_mode_before_the_landing_when_it_has_disarmed(before: int, down: int | None) -> None:
    """As it was recorded: who landed it from OFFBOARD finds it there again, and it does not arm without a stream."""
    flight = Flight("px4", Start.HOLDING, scenario=one_vehicle(start_ned_m=(-200.0, 0.0, -4.0)))
    flight.send("PARAM_SET", target_system=1, param_id="RTL_RETURN_ALT", param_value=4.0, param_type=9)
    flight.advance(0.1)
    if before == PX4_OFFBOARD:
        offboard(flight)
    if down is not None:
        flight.command(down)
    flight.advance(2.0)  # of silence, which is a failsafe in OFFBOARD
    assert flight.mode in (PX4_LAND, PX4_RETURN) and flight.armed
    flight.advance(20.0)
    assert flight.mode == before and not flight.armed
    assert flight.last("HEARTBEAT").system_status == 3
    assert flight.command(ARM, 1) == (ACCEPTED if before == PX4_HOLD else TEMPORARILY_REJECTED)


@pytest.mark.parametrize("down", [LAND, RETURN])
def test_px4_is_not_armed_in_a_mode_that_goes_down(down: int) -> None:
    flight = Flight("px4")
    flight.command(down)
    flight.advance(0.1)
    assert flight.command(ARM, 1) == TEMPORARILY_REJECTED
    flight.advance(0.1)
    assert "arming refused: mode not suitable for takeoff" in flight.texts
    assert flight.mode == (PX4_LAND if down == LAND else PX4_RETURN) and not flight.armed
    flight.set_mode(4, 3)  # as MAVSDK does by itself before it arms
    assert flight.command(ARM, 1) == ACCEPTED


@both
def test_who_stands_and_is_sent_home_says_so_and_disarms(flavour: str) -> None:
    flight = Flight(flavour)
    assert flight.command(RETURN) == ACCEPTED
    flight.advance(0.1)
    assert flight.mode == (PX4_RETURN if flavour == "px4" else 6) and not flight.armed
    flight.set_mode(4, 3) if flavour == "px4" else flight.set_mode(GUIDED)
    flight.command(ARM, 1)
    assert flight.command(RETURN) == ACCEPTED
    flight.advance(0.1)
    assert flight.mode == (PX4_HOLD if flavour == "px4" else 6) and not flight.armed


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


def reposition(flight: Flight, form: str, height: float, **fields: Any) -> int:
    """To 30 m north of the start; the result."""
    latitude = HOME.latitude_deg + (START_NED_M[0] + 30.0) / 111_180.0
    usual: dict[str, Any] = {"target_system": 1, "command": REPOSITION, "param2": 1.0, "param4": NAN}
    if form == "COMMAND_INT":
        usual |= {"frame": 5, "x": round(latitude * 1e7), "y": round(HOME.longitude_deg * 1e7), "z": height}
    else:
        usual |= {"param5": latitude, "param6": HOME.longitude_deg, "param7": height}
    (answer,) = flight.send(form, **(usual | fields))
    return int(answer.result)


@pytest.mark.parametrize(
    ("flavour", "form"), [("px4", "COMMAND_LONG"), ("px4", "COMMAND_INT"), ("ardupilot", "COMMAND_INT")]
)
def test_reposition_flies_to_the_point_and_stays(flavour: str, form: str) -> None:
    flight = airborne(flavour)
    assert reposition(flight, form, HOME.altitude_m + 45.0) == ACCEPTED
    flight.advance(30.0)
    target = (START_NED_M[0] + 30.0, 0.0, -45.0)
    assert flight.world.position_ned_m[0] == pytest.approx(target, abs=1.5)
    assert flight.mode == (PX4_HOLD if flavour == "px4" else GUIDED)


@pytest.mark.parametrize("form", ["COMMAND_LONG", "COMMAND_INT"])
def test_px4_keeps_what_a_reposition_leaves_open_and_takes_zero_for_a_value(form: str) -> None:
    nowhere = {"x": UNUSED_INT, "y": UNUSED_INT} if form == "COMMAND_INT" else {"param5": NAN, "param6": NAN}
    flight = airborne("px4")
    flight.autopilot.pilot.nose.yaw_rad = 1.0

    def target() -> list[float]:
        flight.advance(0.5)
        told = flight.last("POSITION_TARGET_LOCAL_NED")
        return [told.x, told.y, told.z]

    assert reposition(flight, form, NAN) == ACCEPTED
    assert target() == pytest.approx([30.0, 0.0, -50.0], abs=1.0)  # at the height that it has
    flight.advance(3.0)
    assert reposition(flight, form, HOME.altitude_m + 45.0, **nowhere) == ACCEPTED
    assert target() == pytest.approx([30.0, 0.0, -45.0], abs=1.0)  # where it was going
    assert flight.autopilot.pilot.yaw_rad == pytest.approx(1.0)
    assert reposition(flight, form, NAN, param4=0.0, **nowhere) == ACCEPTED
    flight.advance(3.0)
    assert target()[:2] == pytest.approx([30.0, 0.0], abs=1.0)
    assert flight.autopilot.pilot.yaw_rad == pytest.approx(0.0, abs=1e-6)  # to the north
    assert reposition(flight, form, NAN, **nowhere) == ACCEPTED
    here = flight.autopilot.pilot.local_position_ned_m
    assert target() == pytest.approx(here, abs=3.0)  # all left open: stay here
    assert reposition(flight, form, 0.0, **nowhere) == ACCEPTED
    assert target()[2] == pytest.approx(HOME.altitude_m, abs=1.0)  # the sea, below the ground
    null_island = {"x": 0, "y": 0} if form == "COMMAND_INT" else {"param5": 0.0, "param6": 0.0}
    assert reposition(flight, form, NAN, **null_island) == ACCEPTED
    assert math.hypot(*target()[:2]) > 1e6


@pytest.mark.parametrize("flags", [0.0, NAN, 2.0, 3.0])
def test_px4_calls_a_reposition_without_the_flag_of_the_mode_unsupported_and_flies_there_in_hold(flags: float) -> None:
    for mode, north_m in ((PX4_HOLD, START_NED_M[0] + 30.0), (PX4_OFFBOARD, START_NED_M[0])):
        flight = airborne("px4")
        if mode == PX4_HOLD:
            flight.set_mode(4, 3)
        assert reposition(flight, "COMMAND_INT", HOME.altitude_m + 50.0, param2=flags) == UNSUPPORTED
        flight.fly(20.0, 0.0, 0.0, 0.0)
        assert flight.mode == mode
        assert flight.world.position_ned_m[0, 0] == pytest.approx(north_m, abs=1.5)


def test_ardupilot_needs_no_flag_of_the_mode_in_guided() -> None:
    flight = airborne("ardupilot")
    assert reposition(flight, "COMMAND_INT", HOME.altitude_m + 50.0, param2=0.0) == ACCEPTED
    flight.set_mode(17)
    assert reposition(flight, "COMMAND_INT", HOME.altitude_m + 50.0, param2=0.0) == DENIED


@both
def test_a_reposition_on_the_ground_changes_the_mode_and_flies_nowhere(flavour: str) -> None:
    flight = Flight(flavour)
    flight.set_mode(2)
    assert reposition(flight, "COMMAND_INT", HOME.altitude_m + 50.0) == ACCEPTED
    flight.advance(1.0)
    assert flight.mode == (PX4_HOLD if flavour == "px4" else GUIDED)
    flight.command(ARM, 1)
    flight.advance(5.0)
    assert flight.height_m == 0.0


@pytest.mark.parametrize(
    ("flavour", "height", "leaves"),
    [("px4", HOME.altitude_m + 20.0, True), ("px4", NAN, False), ("ardupilot", HOME.altitude_m + 20.0, False)],
)
def test_px4_that_stands_armed_takes_off_for_a_reposition_above_it(flavour: str, height: float, leaves: bool) -> None:
    flight = Flight(flavour)
    flight.advance(0.1)
    flight.set_mode(*((4, 3) if flavour == "px4" else (GUIDED,)))
    assert flight.command(ARM, 1) == ACCEPTED
    assert reposition(flight, "COMMAND_INT", height) == ACCEPTED
    flight.advance(30.0)
    assert flight.mode == (PX4_HOLD if flavour == "px4" else GUIDED)
    there = (START_NED_M[0] + 30.0, 0.0, -20.0) if leaves else (*START_NED_M[:2], 0.0)
    assert flight.world.position_ned_m[0] == pytest.approx(there, abs=1.5)


def test_a_reposition_on_the_meridian_of_greenwich_is_no_other_than_elsewhere() -> None:
    for flavour in ("px4", "ardupilot"):
        flight = airborne(flavour)
        assert reposition(flight, "COMMAND_INT", HOME.altitude_m + 50.0, y=0) == ACCEPTED
        flight.advance(0.5)
        assert flight.last("POSITION_TARGET_LOCAL_NED").y < -100e3


@pytest.mark.parametrize(
    "fields",
    [{"x": 0, "y": 0}, {"x": UNUSED_INT, "y": UNUSED_INT}, {"frame": 6, "z": 0.0}],
    ids=["zero", "unused", "height"],
)
def test_ardupilot_is_not_repositioned_by_what_says_no_place(fields: dict[str, Any]) -> None:
    flight = airborne("ardupilot")
    assert reposition(flight, "COMMAND_INT", HOME.altitude_m + 45.0, **fields) == DENIED
    flight.advance(3.0)
    assert flight.velocity == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


def test_ardupilot_is_not_repositioned_by_a_command_without_a_frame() -> None:
    flight = airborne("ardupilot")
    assert reposition(flight, "COMMAND_LONG", HOME.altitude_m + 45.0) == UNSUPPORTED
    flight.advance(3.0)
    assert flight.velocity == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("frame", [3, 6, 10, 11])
def test_px4_reads_every_altitude_of_a_reposition_as_one_above_the_sea(frame: int) -> None:
    """A height above home is below the ground then, which is where it goes."""
    px4, ardupilot = airborne("px4"), airborne("ardupilot")
    for flight in (px4, ardupilot):
        assert reposition(flight, "COMMAND_INT", 45.0, frame=frame) == ACCEPTED
        flight.advance(12.0)
    assert px4.height_m < 40.0
    assert ardupilot.height_m == pytest.approx(45.0, abs=1.0)
    assert px4.last("POSITION_TARGET_LOCAL_NED").z == pytest.approx(HOME.altitude_m - 45.0, abs=0.1)


@pytest.mark.parametrize(("frame", "result"), [(3, ACCEPTED), (0, DENIED), (5, DENIED), (6, DENIED)])
def test_ardupilot_takes_off_in_one_frame_only(frame: int, result: int) -> None:
    flight = Flight("ardupilot")
    flight.set_mode(GUIDED)
    flight.command(ARM, 1)
    (answer,) = flight.send("COMMAND_INT", target_system=1, command=TAKEOFF, frame=frame, z=6.0)
    assert answer.result == result


@both
def test_return_comes_home_and_lands(flavour: str) -> None:
    flight = airborne(flavour, start_ned_m=(-200.0, 0.0, -10.0))
    flight.send("PARAM_SET", target_system=1, param_id="RTL_RETURN_ALT", param_value=15.0, param_type=9)
    flight.fly(3.0, 8.0, 0.0, 0.0)
    assert flight.command(RETURN) == ACCEPTED
    flight.advance(45.0)
    assert flight.world.position_ned_m[0] == pytest.approx((START_NED_M[0], 0.0, 0.0), abs=1.5)
    assert not flight.armed


@both
def test_home_is_where_the_vehicle_was_armed_and_the_local_frame_keeps_its_origin(flavour: str) -> None:
    flight = Flight(flavour, scenario=one_vehicle(start_ned_m=(*START_NED_M[:2], -5.0)))

    def take_off() -> None:
        if flavour == "ardupilot":
            flight.set_mode(GUIDED)
        else:
            flight.set_mode(4, 3)
        assert flight.command(ARM, 1) == ACCEPTED
        flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0 if flavour == "ardupilot" else HOME.altitude_m + 5.0)
        flight.advance(6.0)
        offboard(flight)

    def place(name: str, *fields: str) -> list[int]:
        number = {"HOME_POSITION": 242, "GLOBAL_POSITION_INT": 33, "GPS_GLOBAL_ORIGIN": 49}[name]
        _, message = flight.send("COMMAND_LONG", target_system=1, command=512, param1=number)
        return [message.fields[field] for field in fields]

    origin = place("GPS_GLOBAL_ORIGIN", "latitude", "longitude")
    assert place("HOME_POSITION", "latitude", "longitude", "x") == [*origin, 0.0]
    take_off()
    flight.fly(10.0, mask=0x0DF8, x=20.0, z=-5.0)
    flight.command(LAND)
    flight.advance(15.0)
    assert not flight.armed and place("HOME_POSITION", "latitude") == origin[:1]
    take_off()
    home = place("HOME_POSITION", "latitude", "longitude", "x")
    assert home[0] - origin[0] == pytest.approx(20.0 / 0.0111, rel=0.1) and home[2] == pytest.approx(20.0, abs=2.0)
    assert place("GPS_GLOBAL_ORIGIN", "latitude", "longitude") == origin
    assert flight.last("LOCAL_POSITION_NED").x == pytest.approx(home[2], abs=1.0)
    flight.fly(8.0, mask=0x0DF8, x=5.0, z=-5.0)  # places of setpoints still count from where it started
    assert float(flight.world.position_ned_m[0, 0]) == pytest.approx(START_NED_M[0] + 5.0, abs=1.0)
    assert flight.command(RETURN) == ACCEPTED
    flight.advance(60.0)
    assert not flight.armed
    assert float(flight.world.position_ned_m[0, 0]) == pytest.approx(START_NED_M[0] + home[2], abs=1.5)


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
    flight.autopilot.begin_mission()
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


@pytest.mark.parametrize(
    ("setpoint", "flies"),
    [
        ({"mask": 0x0DF8, "z": -4.0}, True),
        ({"mask": 0x0DF8, "x": 4.0, "z": 0.0}, False),
        ({"mask": 0x0C3F, "afz": -1.0}, True),
        ({"mask": 0x0C3F, "afx": 1.0}, False),
    ],
)
def test_px4_leaves_the_ground_for_a_place_or_an_acceleration_above_it_too(setpoint: Any, flies: bool) -> None:
    flight = Flight("px4")
    flight.command(ARM, 1)
    flight.fly(0.3, **setpoint)
    assert flight.set_mode(6) == ACCEPTED
    flight.fly(4.0, **setpoint)
    assert (flight.height_m > 1.0) is flies
    assert (flight.last("EXTENDED_SYS_STATE").landed_state == 1) is not flies


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


@both
def test_who_asks_for_logs_is_told_at_once_that_there_are_none(flavour: str) -> None:
    """MAVSDK and ground stations wait for seconds where nobody answers, and report an error."""
    (entry,) = Flight(flavour).send("LOG_REQUEST_LIST", target_system=1, target_component=1, start=0, end=0xFFFF)
    assert (entry.name, entry.id, entry.num_logs, entry.last_log_num) == ("LOG_ENTRY", 0, 0, 0)


# --- what no client would send ----------------------------------------------------------------------------------------

HANDLED = ["HEARTBEAT", "PING", "TIMESYNC", "SET_MODE", "COMMAND_LONG", "COMMAND_INT", "SET_POSITION_TARGET_LOCAL_NED",
           "SET_POSITION_TARGET_GLOBAL_INT", "RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL", "ADSB_VEHICLE",
           "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET", "REQUEST_DATA_STREAM", "FILE_TRANSFER_PROTOCOL",
           "LOG_REQUEST_LIST", "SET_ATTITUDE_TARGET",
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


@both
def test_orders_that_come_with_a_takeoff_find_the_vehicle_in_the_air(flavour: str) -> None:
    flight = Flight(flavour)
    flight.advance(0.1)
    if flavour == "ardupilot":
        assert flight.set_mode(GUIDED) == ACCEPTED
    assert flight.command(ARM, 1) == ACCEPTED
    above_m = HOME.altitude_m if flavour == "px4" else 0.0
    assert flight.command(TAKEOFF, 0.0, 0.0, 0.0, NAN, 0.0, 0.0, above_m + 5.0) == ACCEPTED
    assert flight.command(ARM, 0) == (TEMPORARILY_REJECTED if flavour == "px4" else FAILED)
    assert flight.command(LAND) == ACCEPTED  # all within one tick
    flight.advance(5.0)
    assert not flight.armed and flight.world.state[0] == VehicleState.GROUNDED


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
