"""What an engine reads of a datagram, and under which cause it counts the rest."""

from __future__ import annotations

import struct

import pytest

from ridlink.engine.intake import EKF_STATUS_REPORT, VEHICLE_IDS, Intake
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.crc import checksum
from ridlink.mavlink.frames import encode_frame
from ridlink.remote_id.bridge import REMOTE_ID_IDS, pack_to_mavlink
from ridlink.remote_id.messages import BasicId, Location, Separation

HEARTBEAT = Encoder(1, 1).encode("HEARTBEAT", autopilot=12)
EKF_CRC_EXTRA = 71


def names(intake: Intake, datagram: bytes, wanted: frozenset[int] = VEHICLE_IDS) -> list[str]:
    return [message.name for _, message in intake.messages(datagram, wanted)]


def v1_heartbeat() -> bytes:
    body = bytes((9, 0, 1, 1, 0)) + struct.pack("<IBBBBB", 0, 2, 12, 0, 0, 3)
    return b"\xfe" + body + checksum(body, CRC_EXTRAS[0]).to_bytes(2, "little")


def ekf_status(payload: bytes) -> bytes:
    return encode_frame(EKF_STATUS_REPORT, payload, EKF_CRC_EXTRA, seq=0, sysid=1, compid=1)


def test_what_nobody_asked_for_is_neither_read_nor_counted() -> None:
    intake = Intake()
    attitude = Encoder(1, 1).encode("ATTITUDE", roll=0.1)
    assert names(intake, attitude + HEARTBEAT) == ["HEARTBEAT"]
    assert names(intake, HEARTBEAT, REMOTE_ID_IDS) == []
    assert not intake.counters


def test_what_is_refused_is_counted_by_its_cause() -> None:
    intake = Intake()
    bad = HEARTBEAT[:-1] + bytes([HEARTBEAT[-1] ^ 1])
    unknown = encode_frame(54321, b"\x01", 9, seq=0, sysid=1, compid=1)
    assert names(intake, b"junk" + bad + HEARTBEAT + unknown) == ["HEARTBEAT"]
    assert intake.counters == {"garbage": 2, "bad_checksum": 1, "unknown_message": 1}


@pytest.mark.parametrize("allowed", [False, True])
def test_f06_version_1_is_read_where_it_is_allowed(allowed: bool) -> None:
    intake = Intake(allow_v1=allowed)
    assert names(intake, v1_heartbeat()) == (["HEARTBEAT"] if allowed else [])
    assert intake.counters["mavlink_1_frame"] == (not allowed)
    assert names(Intake(), v1_heartbeat()) == [], "it is not, unless somebody says so"


def test_ardupilots_estimator_is_read_by_hand_also_where_zeros_were_cut_off() -> None:
    intake = Intake()
    ((frame, message),) = intake.messages(ekf_status(struct.pack("<fffffH", 1, 2, 3, 4, 5, 0x033F)), VEHICLE_IDS)
    assert (message.name, message.msgid, message.flags, frame.sysid) == ("EKF_STATUS_REPORT", 193, 0x033F, 1)
    ((_, message),) = intake.messages(ekf_status(struct.pack("<fffff", 1, 2, 3, 4, 5)), VEHICLE_IDS)
    assert message.flags == 0
    assert intake.messages(ekf_status(struct.pack("<fffff", 1, 2, 3, 4, 5)), REMOTE_ID_IDS) == []
    assert not intake.counters


def test_every_remote_id_message_is_read_of_either_link_and_nothing_else_of_the_air() -> None:
    assert {12900, 12901, 12902, 12903, 12904, 12905, 12915, 61400} <= REMOTE_ID_IDS <= VEHICLE_IDS
    assert all(12900 <= msgid <= 12920 or msgid == 61400 for msgid in REMOTE_ID_IDS)
    assert {0, 24, 32, 33, 42, 75, 76, 85, 193, 230, 242, 245, 253} == VEHICLE_IDS - REMOTE_ID_IDS


def test_of_a_pack_the_location_comes_last_so_that_it_makes_one_report() -> None:
    intake = Intake()
    parts = [Location(status=2, latitude_deg=47.0, longitude_deg=8.0), BasicId(1, 2, b"SERIAL")]
    name, fields = pack_to_mavlink(parts)
    ((_, message),) = intake.messages(Encoder(9, 1).encode(name, **fields), REMOTE_ID_IDS)
    assert [type(part) for part in intake.remote_id(message)] == [BasicId, Location]
    ((_, alone),) = intake.messages(Encoder(9, 1).encode("RIDLINK_SEPARATION", horizontal_error=9), REMOTE_ID_IDS)
    assert [type(part) for part in intake.remote_id(alone)] == [Separation]
    ((_, none),) = intake.messages(HEARTBEAT, VEHICLE_IDS)
    assert intake.remote_id(none) == []
