"""What the emulated autopilot makes of setpoints, and of their silence."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ridlink.mavlink.codec import Encoder
from sitl_sim.autopilot import Start
from tests.sitl_sim.flight import (
    ACCEPTED,
    GUIDED,
    LAND,
    NAN,
    PX4_HOLD,
    PX4_OFFBOARD,
    PX4_RETURN,
    START_NED_M,
    TEMPORARILY_REJECTED,
    Flight,
    airborne,
    both,
)


@both
@pytest.mark.parametrize(
    ("mask", "frame"),
    [(0x0DC7, 1), (0x09C7, 1), (0x05C7, 1), (0x0FC7, 1), (0x0C07, 1), (0x0FC7, 8), (0x05C7, 8)],
)
def test_every_clients_velocity_mask_moves_the_vehicle_alike(flavour: str, mask: int, frame: int) -> None:
    flight = airborne(flavour)
    flight.fly(3.0, 4.0, 0.0, 0.0, mask=mask, frame=frame)
    assert flight.velocity == pytest.approx([4.0, 0.0, 0.0], abs=1.0)
    target = flight.last("POSITION_TARGET_LOCAL_NED")
    assert (target.vx, target.vy, target.vz) == pytest.approx((4.0, 0.0, 0.0), abs=1e-5)


@pytest.mark.parametrize("frame", [7, 9])
def test_frames_of_offsets_are_ardupilots_and_px4_misses_its_stream(frame: int) -> None:
    for flavour, moves in (("px4", False), ("ardupilot", True)):
        flight = airborne(flavour)
        flight.fly(1.5, 4.0, 0.0, 0.0, frame=frame)
        assert (flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(4.0)) is moves
        critical = [m for _, m in flight.messages("STATUSTEXT") if f"frame {frame}".encode() in m.text]
        assert bool(critical) is not moves
        assert flight.mode == (GUIDED if moves else PX4_RETURN)


def test_a_position_in_a_body_frame_is_flown_by_ardupilot_only() -> None:
    for flavour, flown in (("px4", False), ("ardupilot", True)):
        flight = airborne(flavour)
        flight.fly(4.0, mask=0x0DF8, frame=8, x=10.0)
        assert (float(flight.world.position_ned_m[0, 0]) - START_NED_M[0] > 3.0) is flown
        assert any("nothing in it to fly" in text for text in flight.texts) is not flown
    flight = airborne("px4")
    flight.fly(
        2.0, 3.0, 0.0, 0.0, mask=0x0DC0, frame=8, x=-30.0
    )  # of a position with a velocity PX4 flies the velocity
    assert flight.velocity[0] > 1.5


@both
def test_a_setpoint_that_asks_for_nothing_is_none_for_px4(flavour: str) -> None:
    flight = airborne(flavour)
    flight.fly(1.5, mask=0x0FFF)
    assert flight.mode == (PX4_RETURN if flavour == "px4" else GUIDED)


@both
def test_px4_flies_a_velocity_at_a_height_and_to_a_place_at_a_climb_rate(flavour: str) -> None:
    """It reads the mask axis by axis; ArduPilot takes a position and a velocity as a whole."""
    flight = airborne(flavour)
    flight.fly(8.0, 3.0, 0.0, 9.0, mask=0x0DE3, z=-45.0)  # north and east of the velocity, down of the position
    assert flight.mode == (PX4_OFFBOARD if flavour == "px4" else GUIDED)
    if flavour == "ardupilot":
        assert flight.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
        return
    assert flight.height_m == pytest.approx(45.0, abs=0.5) and flight.velocity[0] > 2.0
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(3.0)
    flight.fly(12.0, 9.0, 9.0, -1.0, mask=0x0DDC, x=10.0)  # the other way round
    assert flight.velocity == pytest.approx([0.0, 0.0, -1.0], abs=0.3)
    assert flight.world.position_ned_m[0, 0] == pytest.approx(START_NED_M[0] + 10.0, abs=1.5)
    flight.fly(8.0, 1.0, 0.0, 9.0, mask=0x0DE0, x=10.0, z=-50.0)  # a velocity beside a place is added
    assert flight.world.position_ned_m[0, 0] == pytest.approx(START_NED_M[0] + 10.0 + 1.0 / 0.6, abs=1.0)


@pytest.mark.parametrize("mask", [0x0DE1, 0x0DE7, 0x0DD7, 0x0DFB])
def test_px4_wants_north_and_east_together_and_something_for_each_axis(mask: int) -> None:
    flight = airborne("px4")
    flight.fly(2.0, 3.0, 0.0, 0.0)
    flight.fly(4.0, 3.0, 3.0, -1.0, mask=mask, x=40.0, y=40.0, z=-60.0)
    assert flight.mode == PX4_OFFBOARD and flight.last("POSITION_TARGET_LOCAL_NED").vx == 0.0
    assert flight.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.8)


@both
def test_a_force_is_not_flown(flavour: str) -> None:
    flight = airborne(flavour)
    flight.setpoint(mask=0x0E3F, afx=2.0)
    flight.advance(0.1)
    assert any("force" in text for text in flight.texts)
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == 0.0
    flight.setpoint(3.0, 0.0, 0.0, mask=0x0FC7)  # the bit alone, as MAVProxy sets it, means nothing
    flight.advance(0.1)
    assert flight.last("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(3.0)


def test_body_frames_turn_with_the_nose() -> None:
    flight = airborne("px4")
    flight.fly(3.0, 0.0, 0.0, 0.0, mask=0x09C7, yaw=math.pi / 2.0)
    assert flight.last("GLOBAL_POSITION_INT").hdg == 9000
    flight.fly(4.0, 3.0, 0.0, 0.0, frame=8)
    assert flight.velocity == pytest.approx([0.0, 3.0, 0.0], abs=0.8)


def test_beside_a_body_frame_a_heading_of_ardupilot_counts_from_its_nose() -> None:
    headings = {}
    for flavour in ("px4", "ardupilot"):
        flight = airborne(flavour)
        flight.fly(3.0, mask=0x09C7, yaw=math.pi / 2.0)
        flight.fly(3.0, 3.0, 0.0, 0.0, frame=8, mask=0x09C7, yaw=0.0)
        headings[flavour] = flight.last("GLOBAL_POSITION_INT").hdg
    assert headings == {"px4": 0, "ardupilot": 9000}
    assert flight.velocity == pytest.approx([0.0, 3.0, 0.0], abs=0.8)


def test_ardupilot_turns_its_nose_into_the_flight_and_px4_does_not() -> None:
    headings = {}
    for flavour in ("px4", "ardupilot"):
        flight = airborne(flavour)
        flight.fly(4.0, 0.0, 4.0, 0.0)
        headings[flavour] = flight.last("GLOBAL_POSITION_INT").hdg
    assert headings == {"px4": 0, "ardupilot": 9000}


@both
def test_a_rate_of_turn_ends_with_the_setpoints_that_ask_for_it(flavour: str) -> None:
    flight = airborne(flavour)
    flight.fly(1.0, mask=0x05C7, yaw_rate=0.5)
    assert flight.last("ATTITUDE").yawspeed == pytest.approx(0.5)
    flight.fly(0.3)
    heading = flight.last("ATTITUDE").yaw
    assert (heading, flight.last("ATTITUDE").yawspeed) == (pytest.approx(0.5, abs=0.1), 0.0)
    flight.fly(0.5, mask=0x05C7, yaw_rate=0.5)
    flight.command(LAND)
    flight.advance(1.0)
    assert flight.last("ATTITUDE").yawspeed == 0.0
    flight = airborne(flavour)
    flight.fly(0.5, mask=0x05C7, yaw_rate=0.5)
    flight.advance(3.5)
    assert flight.last("ATTITUDE").yawspeed == 0.0


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
def test_attitude_setpoints_are_not_flown_and_said_so(flavour: str) -> None:
    for start, said in ((Start.AIRBORNE, 1), (Start.HOLDING, 0)):
        flight = Flight(flavour, start)
        for _ in range(2):
            assert flight.send("SET_ATTITUDE_TARGET", target_system=1, target_component=1, thrust=0.7) == []
        flight.advance(0.1)
        assert sum("attitude setpoint" in text for text in flight.texts) == said
        assert flight.velocity == [0.0, 0.0, 0.0]


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
