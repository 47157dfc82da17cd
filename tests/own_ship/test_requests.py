"""What is asked of an autopilot, and when."""

from __future__ import annotations

import itertools

import pytest

from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, Encoder, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.own_ship import OwnShipTelemetry
from ridlink.own_ship.requests import (
    HOME_POSITION_US,
    POSITION_US,
    TARGET_US,
    UNTOLD_US,
    WANTED_MESSAGES_US,
    Requests,
    command,
    message_requests,
    steers,
)
from tests.own_ship.autopilot import Autopilot

OURS = Encoder(1, 196)
EKF = Message("EKF_STATUS_REPORT", 193, {"flags": 831})
SECONDS = 12
Asked = list[tuple[float, dict[int, int]]]


def said(frame: bytes) -> Message:
    (found,) = parse_datagram(frame, CRC_EXTRAS)
    assert isinstance(found, Frame)
    return decode_message(found)


def test_messages_are_asked_for_by_id_and_interval() -> None:
    for wanted in (WANTED_MESSAGES_US, HOME_POSITION_US):
        asked = [said(frame) for frame in message_requests(Encoder(7, 196), 7, wanted)]
        intervals = {int(message.param1): int(message.param2) for message in asked}
        assert intervals == wanted
        assert {(message.command, message.target_system, message.target_component) for message in asked} == {
            (511, 7, 1)
        }


def test_what_an_own_state_is_made_of_comes_often_enough() -> None:
    told_hz = {MESSAGES[msgid].name: 1e6 / every_us for msgid, every_us in WANTED_MESSAGES_US.items() if msgid != 193}
    assert told_hz == {
        "GLOBAL_POSITION_INT": 20.0,
        "GPS_RAW_INT": 5.0,
        "POSITION_TARGET_LOCAL_NED": 1e6 / 70_000,
        "EXTENDED_SYS_STATE": 2.0,
    }
    assert WANTED_MESSAGES_US[193] == 500_000, "EKF_STATUS_REPORT, which is not in the dialect"
    assert {MESSAGES[msgid].name: every_us for msgid, every_us in HOME_POSITION_US.items()} == {
        "HOME_POSITION": 2_000_000
    }


def test_setpoints_and_commands_steer_and_words_and_requests_do_not() -> None:
    encoder = Encoder(1, 196)
    assert steers(encoder.encode("SET_POSITION_TARGET_LOCAL_NED"))
    assert steers(command(encoder, 176, (1.0, 6.0, 0.0), 1))
    assert not any(steers(frame) for frame in message_requests(encoder, 1, WANTED_MESSAGES_US))
    assert not steers(encoder.encode("HEARTBEAT")) and not steers(encoder.encode("STATUSTEXT", text=b"x"))


def asked(steering: bool = True, broadcasting: bool = False, **every_s: float) -> Asked:
    """Time and intervals of all requests to an ArduPilot that tells messages so often; 0: never."""
    telemetry = OwnShipTelemetry()
    autopilot = Autopilot(telemetry)
    requests, found = Requests(steers=steering, broadcasts=broadcasting), []
    tell = {
        "position": autopilot.position,
        "receiver": autopilot.receiver,
        "estimator": lambda now_s: telemetry.receive(1, 1, EKF, now_s, "a"),
        "landed": lambda now_s: autopilot.say(now_s, "EXTENDED_SYS_STATE", landed_state=2),
        "target": lambda now_s: autopilot.say(now_s, "POSITION_TARGET_LOCAL_NED", type_mask=0x0DC7),
    }
    every_s = {"position": 0.05, "receiver": 0.2, "estimator": 0.5, "landed": 0.5, "target": 0.05} | every_s
    for tick in range(20 * SECONDS):
        now_s = 0.05 * tick
        if tick % 20 == 0:
            autopilot.heartbeat(now_s, autopilot=3, mode=4)
        for name, interval_s in every_s.items():
            if interval_s and tick % round(interval_s / 0.05) == 0:
                tell[name](now_s)
        if frames := requests.due(OURS, telemetry, now_s):
            messages = [said(frame) for frame in frames]
            found.append((round(now_s, 2), {int(each.param1): int(each.param2) for each in messages}))
    return found


def test_an_autopilot_that_tells_all_is_asked_for_nothing() -> None:
    assert asked() == []


@pytest.mark.parametrize(("interval_s", "seldom"), [(0.25, False), (0.35, True), (1.0, True)])
def test_positions_that_a_ground_station_has_slowed_down_are_asked_for_again(interval_s: float, seldom: bool) -> None:
    for steering in (True, False):
        found = asked(steering, position=interval_s)
        assert [intervals for _, intervals in found] == [POSITION_US] * len(found)
        assert [b - a for (a, _), (b, _) in itertools.pairwise(found)] == [5.0] * (len(found) - 1)
        assert bool(found) is seldom


def test_whether_it_stands_and_what_it_flies_after_matters_to_those_who_steer() -> None:
    assert [intervals for _, intervals in asked(landed=0.0)] == [UNTOLD_US] * 3
    assert [intervals for _, intervals in asked(target=0.1)] == [TARGET_US] * 3
    assert asked(steering=False, landed=0.0, target=0.1) == []


@pytest.mark.parametrize("silent", ["position", "receiver", "estimator"])
def test_an_autopilot_that_no_longer_says_where_it_is_is_asked_for_all_each_second(silent: str) -> None:
    found = asked(**{silent: 60.0})
    assert len(found) >= 6 and all(intervals == WANTED_MESSAGES_US for _, intervals in found)
    assert all(abs(b - a - 1.0) < 1e-9 for (a, _), (b, _) in itertools.pairwise(found))


def test_home_matters_to_those_who_broadcast() -> None:
    assert asked(broadcasting=True) == [(0.0, HOME_POSITION_US), (5.0, HOME_POSITION_US), (10.0, HOME_POSITION_US)]


def test_nobody_is_asked_before_an_autopilot_is_heard_nor_when_it_has_fallen_silent() -> None:
    telemetry = OwnShipTelemetry()
    requests = Requests(steers=True, broadcasts=True)
    assert requests.due(OURS, telemetry, 0.0) == []
    Autopilot(telemetry).heartbeat(0.0)
    assert len(requests.due(OURS, telemetry, 2.0)) == len(WANTED_MESSAGES_US) + 1
    assert requests.due(OURS, telemetry, 3.5) == []
