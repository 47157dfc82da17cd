"""What the emulated autopilot tells: its streams, and every figure in them."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from ridlink.mavlink.codec import Encoder
from sitl_sim.autopilot import FLAVOURS, Start
from sitl_sim.autopilot.ekf_status import ekf_status_fields
from sitl_sim.autopilot.link import Link
from sitl_sim.autopilot.rates import default_intervals
from tests.sitl_sim.flight import (
    ACCEPTED,
    COMPANION,
    DENIED,
    FAILED,
    GROUND_STATION,
    HOME,
    NAN,
    REQUEST,
    SET_INTERVAL,
    START_NED_M,
    Flight,
    airborne,
    both,
    one_vehicle,
)


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


@pytest.mark.parametrize("asked", ["interval", "group", "once"])
def test_ardupilot_tells_the_state_of_its_estimator_when_asked(asked: str) -> None:
    """DroneKit does not call a vehicle armable before it has heard it, and the daemon asks for it."""
    flight = Flight("ardupilot", Start.AIRBORNE)
    flight.advance(1.0)
    assert not flight.messages("EKF_STATUS_REPORT")
    flight.world.receivers.set_outage(0, True)
    for flags, after_s in ((831, 6.0), (37, 2.0)):
        flight.advance(after_s)
        if asked == "interval":
            assert flight.command(SET_INTERVAL, 193, 5e5) == ACCEPTED
        elif asked == "group":
            flight.send("REQUEST_DATA_STREAM", target_system=1, req_stream_id=0, req_message_rate=2, start_stop=1)
        else:
            assert flight.command(REQUEST, 193) == ACCEPTED
        flight.advance(0.6)
        assert flight.last("EKF_STATUS_REPORT", GROUND_STATION).flags == flags


def test_pymavlink_reads_the_state_of_the_estimator_of_ardupilot() -> None:
    frame = Link(GROUND_STATION, Encoder(1, 1), 0.0).message("EKF_STATUS_REPORT", ekf_status_fields(has_position=True))
    read = ardupilotmega.MAVLink(None).parse_char(bytearray(frame))
    assert (read.get_type(), read.flags, read.pos_horiz_variance) == (
        "EKF_STATUS_REPORT", 831, pytest.approx(0.009)
    )  # fmt: skip


@pytest.mark.parametrize("flavour", ["px4", "ideal"])
def test_px4_has_no_report_of_ardupilots_estimator(flavour: str) -> None:
    flight = Flight(flavour)
    assert flight.command(REQUEST, 193) == DENIED
    flight.send("REQUEST_DATA_STREAM", target_system=1, req_stream_id=0, req_message_rate=2, start_stop=1)
    flight.advance(1.0)
    assert not flight.messages("EKF_STATUS_REPORT", GROUND_STATION)


def test_telemetry_tells_the_navigation_solution_and_never_the_truth() -> None:
    flight = Flight(start=Start.AIRBORNE, scenario=one_vehicle(sigma_m=10.0))
    flight.advance(1.0)
    local, truth = flight.last("LOCAL_POSITION_NED"), flight.world.position_ned_m[0]
    told = np.array([local.x + START_NED_M[0], local.y, local.z + flight.autopilot.pilot.home.error_m])
    assert told == pytest.approx(flight.world.reported_position_ned_m[0], abs=0.05)
    assert np.linalg.norm(told - truth) > 1.0
    globally = flight.last("GLOBAL_POSITION_INT")
    north_m = (globally.lat / 1e7 - HOME.latitude_deg) * 111_180.0
    assert north_m == pytest.approx(told[0], abs=1.0)
    assert globally.relative_alt / 1e3 == pytest.approx(-local.z, abs=0.2)


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


def test_airspeed_is_what_either_autopilot_says_without_a_sensor() -> None:
    """Of PX4 none; of ArduPilot its speed in space: in their recordings it knows of no wind."""
    for flavour in ("px4", "ardupilot"):
        flight = airborne(flavour)
        flight.fly(6.0, 3.0, 0.0, -2.0)
        hud = flight.last("VFR_HUD")
        assert hud.groundspeed == pytest.approx(3.0, abs=0.8)
        if flavour == "px4":
            assert math.isnan(hud.airspeed)
        else:
            assert hud.airspeed == pytest.approx(math.hypot(hud.groundspeed, hud.climb), abs=1e-5) and hud.climb > 1.5


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


@pytest.mark.parametrize(("flavour", "result"), [("px4", DENIED), ("ardupilot", FAILED)])
def test_a_message_that_is_not_there_is_not_sent_when_asked_for(flavour: str, result: int) -> None:
    (answer,) = Flight(flavour).send("COMMAND_LONG", target_system=1, command=REQUEST, param1=300.0)
    assert (answer.name, answer.result) == ("COMMAND_ACK", result)


@both
def test_intervals_are_told(flavour: str) -> None:
    flight = Flight(flavour)
    unknown = ACCEPTED if flavour == "px4" else FAILED
    for change, wanted in ((None, 100_000), (50_000, 50_000), (-1, -1), (3e9, 2**31 - 1)):
        if change is not None:
            flight.command(SET_INTERVAL, 33, change)
        answers = flight.send("COMMAND_LONG", target_system=1, command=510, param1=33.0)
        assert [answer.name for answer in answers] == ["COMMAND_ACK", "MESSAGE_INTERVAL"]
        assert (answers[0].result, answers[1].message_id, answers[1].interval_us) == (ACCEPTED, 33, wanted)
    answers = flight.send("COMMAND_LONG", target_system=1, command=510, param1=105.0)
    assert (answers[0].result, answers[1].message_id, answers[1].interval_us) == (unknown, 105, 0)


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


@pytest.mark.parametrize(
    ("autopilot", "version", "below"),
    [("px4", (1, 17, 0, 64), (1, 17, 0, 64)), ("ardupilot", (4, 6, 0, 0), (0, 0, 0, 0))],
)
def test_each_autopilot_says_the_version_that_was_measured(
    autopilot: str, version: tuple[int, ...], below: tuple[int, ...]
) -> None:
    flight = Flight(autopilot)
    *_, answer = flight.send("COMMAND_LONG", target_system=1, command=REQUEST, param1=148)
    assert tuple(answer.flight_sw_version.to_bytes(4, "big")) == version
    assert tuple(answer.middleware_sw_version.to_bytes(4, "big")) == below


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
