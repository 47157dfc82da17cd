"""Signatures: what pymavlink signs we believe and the other way round; what a forger sends changes nothing."""

from __future__ import annotations

import hashlib
import itertools
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from ridlink.errors import FrameError
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import SIGNATURE_LENGTH, Frame, parse_datagram
from ridlink.mavlink.signing import (
    EPOCH_UTC_S,
    LATEST_CLOCK,
    MOST_AHEAD,
    MOST_BEHIND,
    MOST_STREAMS,
    UNITS_PER_S,
    SignatureCause,
    Signing,
    signing_timestamp,
)
from tests.captures.drawn import version_1

KEY = hashlib.sha256(b"correct horse").digest()
OTHER_KEY = hashlib.sha256(b"battery staple").digest()
NOW_S = EPOCH_UTC_S + 1_000_000.0
HEARTBEAT = CRC_EXTRAS[0]


def frame_of(data: bytes) -> Frame:
    [frame] = parse_datagram(data, CRC_EXTRAS)
    assert isinstance(frame, Frame)
    return frame


def signed(
    key: bytes = KEY, *, at_s: float = NOW_S, link_id: int = 0, sysid: int = 1, signer: Signing | None = None
) -> bytes:
    heartbeat = Encoder(sysid, 1).encode("HEARTBEAT", type=2, autopilot=12, mavlink_version=3)
    return (signer or Signing(key, link_id=link_id)).sign(heartbeat, HEARTBEAT, at_s)


def peer(key: bytes) -> Any:
    """pymavlink with signing on, as a ground station would have it."""
    link = common.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key = key
    link.signing.sign_outgoing = True
    link.signing.link_id = 3
    link.signing.timestamp = signing_timestamp(NOW_S)
    return link


def test_a_golden_frame() -> None:
    """Key 0..31, link 5, timestamp 0x0102030405: computed once with pymavlink 2.4.50."""
    key = bytes(range(32))
    heartbeat = Encoder(1, 1).encode("HEARTBEAT", type=2, autopilot=12, mavlink_version=3)
    out = Signing(key, link_id=5, timestamp=0x0102030404).sign(heartbeat, HEARTBEAT, 0.0)
    assert out.hex() == "fd09010000010100000000000000020c000003302605050403020100ea695d649368"


def test_pymavlink_believes_us_and_we_believe_pymavlink() -> None:
    theirs = peer(KEY)
    [message] = theirs.parse_buffer(signed())
    assert message.get_type() == "HEARTBEAT" and message.get_signed()
    packed = common.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(theirs)
    assert Signing(KEY).refusal(frame_of(packed), NOW_S) is None


def test_pymavlink_refuses_what_another_key_signed() -> None:
    with pytest.raises(common.MAVError):
        peer(OTHER_KEY).parse_buffer(signed())


def test_every_byte_counts() -> None:
    data, refused = signed(), 0
    for at in range(1, len(data)):
        for bit in (1, 128):
            tampered = bytearray(data)
            tampered[at] ^= bit
            judge = Signing(KEY)
            for found in parse_datagram(bytes(tampered), CRC_EXTRAS):
                if isinstance(found, Frame):
                    assert judge.refusal(found, NOW_S) is not None
                    refused += 1
            assert not judge.streams and judge.timestamp == 0
    assert refused >= 2 * SIGNATURE_LENGTH  # of the rest of the frame the checksum tells


def test_a_forged_frame_moves_no_clock_and_locks_nobody_out() -> None:
    judge = Signing(KEY)
    assert judge.refusal(frame_of(signed(at_s=NOW_S)), NOW_S) is None
    forged = signed(OTHER_KEY, at_s=NOW_S + 1e6)
    assert judge.refusal(frame_of(forged), NOW_S) is SignatureCause.WRONG
    assert judge.refusal(frame_of(signed(at_s=NOW_S + 0.1)), NOW_S + 0.1) is None


def test_a_frame_is_believed_once_also_after_a_restart() -> None:
    judge = Signing(KEY)
    frame = frame_of(signed())
    assert judge.refusal(frame, NOW_S) is None
    assert judge.refusal(frame, NOW_S + 1.0) is SignatureCause.REPLAYED
    restarted = Signing(KEY, timestamp=judge.timestamp, streams=dict(judge.streams))
    assert restarted.refusal(frame, NOW_S + 2.0) is SignatureCause.REPLAYED


def test_streams_are_apart() -> None:
    judge = Signing(KEY)
    for link_id in (0, 1):
        for sysid in (1, 2):
            assert judge.refusal(frame_of(signed(link_id=link_id, sysid=sysid)), NOW_S) is None
    assert len(judge.streams) == 4


@pytest.mark.parametrize(
    ("ahead_s", "cause"),
    [
        (-MOST_BEHIND / UNITS_PER_S - 1.0, SignatureCause.TOO_OLD),
        (-MOST_BEHIND / UNITS_PER_S + 1.0, None),
        (MOST_AHEAD / UNITS_PER_S - 1.0, None),
        (MOST_AHEAD / UNITS_PER_S + 1.0, SignatureCause.TOO_NEW),
    ],
)
def test_the_first_of_a_stream_is_near_our_clock(ahead_s: float, cause: SignatureCause | None) -> None:
    assert Signing(KEY).refusal(frame_of(signed(at_s=NOW_S + ahead_s)), NOW_S) is cause


def test_a_known_stream_may_fall_behind_but_never_go_back() -> None:
    judge = Signing(KEY)
    assert judge.refusal(frame_of(signed(at_s=NOW_S)), NOW_S) is None
    assert judge.refusal(frame_of(signed(at_s=NOW_S + 1.0)), NOW_S + 3600.0) is None


def test_unsigned_and_version_1_frames_are_refused() -> None:
    unsigned = frame_of(Encoder(1, 1).encode("HEARTBEAT", type=2, mavlink_version=3))
    old = frame_of(version_1(unsigned.msgid, unsigned.payload, HEARTBEAT))
    assert (unsigned.version, old.version) == (2, 1)
    for frame in (unsigned, old):
        assert Signing(KEY).refusal(frame, NOW_S) is SignatureCause.UNSIGNED


@given(st.lists(st.floats(-1e9, 1e10), min_size=1, max_size=20))
def test_our_timestamps_only_grow_whatever_the_clock_does(times_s: list[float]) -> None:
    signer = Signing(KEY)
    stamps = [
        int.from_bytes(frame_of(signed(signer=signer, at_s=EPOCH_UTC_S + t)).signature[1:7], "little") for t in times_s
    ]
    assert all(late > early for early, late in itertools.pairwise(stamps))


def test_no_more_streams_than_there_is_room_for() -> None:
    judge = Signing(KEY)
    for sysid in range(1, MOST_STREAMS + 20):
        assert judge.refusal(frame_of(signed(sysid=sysid)), NOW_S) is None
    assert len(judge.streams) == MOST_STREAMS
    kept = [sysid for sysid, _, _ in judge.streams]
    assert kept == list(range(20, MOST_STREAMS + 20)), "the one heard longest ago goes"


def test_the_numbers_of_the_specification_and_ours() -> None:
    assert datetime(2015, 1, 1, tzinfo=UTC).timestamp() == EPOCH_UTC_S
    assert (UNITS_PER_S, MOST_BEHIND, MOST_AHEAD, MOST_STREAMS) == (100_000, 6_000_000, 60_000_000, 64)
    plain = Signing(KEY)
    assert plain.timestamp == 0 and not plain.streams
    out = plain.sign(Encoder(1, 1).encode("HEARTBEAT"), HEARTBEAT, EPOCH_UTC_S + 1.0)
    assert out[-13:-6] == bytes((0, *(100_000).to_bytes(6, "little"))), "link 0, one second after the epoch"


def test_timestamps_stay_within_their_48_bits() -> None:
    assert signing_timestamp(0.0) == 0
    assert signing_timestamp(1e18) == LATEST_CLOCK
    assert signing_timestamp(EPOCH_UTC_S + 1.5) == 150_000


def test_keys_and_frames_of_the_wrong_kind_are_refused() -> None:
    with pytest.raises(ValueError, match="32 bytes, not 5"):
        Signing(b"short")
    with pytest.raises(ValueError, match="link ids are 0 to 255, not 256"):
        Signing(KEY, link_id=256)
    for frame, part in ((signed(), "incompat_flags"), (b"\xfe" + signed()[1:], "magic")):
        with pytest.raises(FrameError, match="unsigned MAVLink 2") as caught:
            Signing(KEY).sign(frame, HEARTBEAT, NOW_S)
        assert caught.value.part == part
