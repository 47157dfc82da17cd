"""Framing: whatever the bytes, no exception, no lost good frame, no frame that was not sent."""

from __future__ import annotations

import random
import time
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from ridlink.errors import FrameError
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, decode_message
from ridlink.mavlink.crc import checksum
from ridlink.mavlink.frames import (
    MAX_FALSE_STARTS,
    MAX_FRAME_LENGTH,
    MAX_FRAMES_PER_DATAGRAM,
    BadFrame,
    Cause,
    Frame,
    FrameParser,
    encode_frame,
    parse_datagram,
)

unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine is no failure."""

POISON = bytes.fromhex("fdff0000000001010000")
"""A HEARTBEAT header that claims 255 bytes of payload: an unguarded parser waits for them and swallows what follows."""

HEARTBEAT_V1 = bytes.fromhex("fe0900010100000000000203000403d014")
"""type 2, autopilot 3, base mode 0, system status 4, as MAVLink 1 (pymavlink with force_mavlink1)."""

UNKNOWN_ID = 0x7FFFFF


def frames_in(found: list[Frame | BadFrame]) -> list[Frame]:
    return [item for item in found if isinstance(item, Frame)]


def rejects_in(found: list[Frame | BadFrame]) -> list[BadFrame]:
    return [item for item in found if isinstance(item, BadFrame)]


def location(latitude: int = 508_700_000, seq: int = 0) -> bytes:
    encoder = Encoder(1, 1)
    encoder.seq = seq
    return encoder.encode(
        "OPEN_DRONE_ID_LOCATION",
        latitude=latitude,
        longitude=44_000_000,
        direction=36100,
        speed_vertical=-200,
        altitude_geodetic=120.5,
        timestamp=1234.5,
        timestamp_accuracy=1,
    )


def unknown_frame(payload: bytes = b"\x01\x02\x03", msgid: int = UNKNOWN_ID) -> bytes:
    return encode_frame(msgid, payload, 0, seq=9, sysid=3, compid=4)


def signed(frame: bytes, crc_extra: int, signature: bytes = bytes(range(13))) -> bytes:
    body = bytes((frame[1], 0x01)) + frame[3:-2]
    return b"\xfd" + body + checksum(body, crc_extra).to_bytes(2, "little") + signature


frame_bytes = st.builds(
    encode_frame,
    st.sampled_from([0, 33, 12900, 12901, 61400, 61401]),
    st.binary(min_size=1, max_size=255),
    st.just(0),
    seq=st.integers(0, 255),
    sysid=st.integers(0, 255),
    compid=st.integers(0, 255),
)
"""Frames of known ids with arbitrary payloads; the checksum seed is put right by ``sealed``."""


def sealed(frame: bytes) -> bytes:
    msgid = int.from_bytes(frame[7:10], "little")
    return frame[:-2] + checksum(frame[1:-2], CRC_EXTRAS[msgid]).to_bytes(2, "little")


good_frames = frame_bytes.map(sealed)
noise = st.binary(max_size=40).map(lambda data: data.replace(b"\xfd", b"\x00").replace(b"\xfe", b"\x00"))


class TestOneFrame:
    def test_version_2_golden(self) -> None:
        raw = bytes.fromhex("fd0900000701010000000000000002030004030965")
        (frame,) = parse_datagram(raw, CRC_EXTRAS)
        assert isinstance(frame, Frame)
        assert frame == Frame(2, 0, 0, 7, 1, 1, 0, bytes.fromhex("000000000203000403"), b"", True, 0, raw)
        assert decode_message(frame).autopilot == 3

    def test_version_1_golden(self) -> None:
        (frame,) = parse_datagram(HEARTBEAT_V1, CRC_EXTRAS)
        assert isinstance(frame, Frame)
        assert (frame.version, frame.msgid, frame.sysid, frame.compid, frame.checked) == (1, 0, 1, 1, True)
        assert decode_message(frame).fields["type"] == 2
        body = bytes.fromhex("09c80203000000000002030004") + b"\x03"  # another sender, and number 200
        (numbered,) = frames_in(parse_datagram(b"\xfe" + body + b"\0\0", {}))
        assert (numbered.seq, numbered.sysid, numbered.compid, numbered.checked) == (200, 2, 3, False)

    def test_the_lengths_and_bounds_of_the_format(self) -> None:
        assert MAX_FRAME_LENGTH == 280, "10 of header, 255 of payload, 2 of checksum, 13 of signature"
        assert (MAX_FRAMES_PER_DATAGRAM, MAX_FALSE_STARTS) == (64, 1024)

    def test_every_bit_of_header_numbers_is_written(self) -> None:
        for msgid, seq in ((0x0001FF, 0x1FF), (0x01FFFF, 0x100), (0x01FF00, 255), (0x010100, 0)):
            frame = encode_frame(msgid, b"\x01", 7, seq=seq, sysid=2, compid=3)
            assert frame[1:10] == bytes((1, 0, 0, seq % 256, 2, 3, *msgid.to_bytes(3, "little")))

    def test_trailing_zeros_are_cut_but_one_byte_stays(self) -> None:
        frame = encode_frame(0, bytes(9), CRC_EXTRAS[0], seq=0, sysid=1, compid=1)
        assert len(frame) == 13
        assert frames_in(parse_datagram(frame, CRC_EXTRAS))[0].payload == b"\x00"

    def test_sequence_number_wraps(self) -> None:
        encoder = Encoder(1, 1)
        numbers = [encoder.encode("HEARTBEAT")[4] for _ in range(257)]
        assert numbers == [*range(256), 0]

    def test_signed_frame_keeps_its_signature(self) -> None:
        raw = signed(location(), CRC_EXTRAS[12901])
        first, second = frames_in(parse_datagram(raw + location(), CRC_EXTRAS))
        assert (first.incompat_flags, first.signature, first.checked) == (1, bytes(range(13)), True)
        assert len(first.raw) == len(location()) + 13
        assert second.signature == b""
        assert decode_message(first) == decode_message(second)

    def test_signed_frame_without_its_signature_is_truncated(self) -> None:
        raw = signed(location(), CRC_EXTRAS[12901])[:-1]
        assert frames_in(parse_datagram(raw, CRC_EXTRAS)) == []
        assert rejects_in(parse_datagram(raw, CRC_EXTRAS))[0].cause is Cause.TRUNCATED

    @pytest.mark.parametrize("flags", [0x02, 0x03, 0x80, 0xFF])
    def test_unknown_incompat_flags_are_refused(self, flags: int) -> None:
        frame = bytearray(location())
        frame[2] = flags
        frame[-2:] = checksum(bytes(frame[1:-2]), CRC_EXTRAS[12901]).to_bytes(2, "little")
        found = parse_datagram(bytes(frame) + location(), CRC_EXTRAS)
        assert [f.raw for f in frames_in(found)] == [location()]
        assert rejects_in(found)[0].cause is Cause.INCOMPATIBLE_FLAGS

    def test_unknown_compat_flags_are_accepted(self) -> None:
        frame = bytearray(location())
        frame[3] = 0x80
        frame[-2:] = checksum(bytes(frame[1:-2]), CRC_EXTRAS[12901]).to_bytes(2, "little")
        assert frames_in(parse_datagram(bytes(frame), CRC_EXTRAS))[0].compat_flags == 0x80

    @pytest.mark.parametrize(("sysid", "compid"), [(256, 1), (1, -1)])
    def test_ids_that_do_not_fit_are_refused(self, sysid: int, compid: int) -> None:
        with pytest.raises(ValueError, match="0 to 255"):
            Encoder(sysid, compid)

    @pytest.mark.parametrize(
        ("part", "value"),
        [
            ("sysid", 256),
            ("sysid", -1),
            ("compid", 256),
            ("msgid", 1 << 24),
            ("msgid", -1),
            ("payload", bytes(255) + b"x"),
        ],
    )
    def test_what_makes_no_frame_says_which_part(self, part: str, value: Any) -> None:
        given = {"msgid": 0, "payload": b"x", "sysid": 1, "compid": 1} | {part: value}
        with pytest.raises(FrameError, match=f"{part} of a frame is 0 to ") as caught:
            encode_frame(crc_extra=0, seq=0, **given)
        assert caught.value.part == part


class TestUnknownIds:
    @pytest.mark.parametrize("follows", [b"", location(), HEARTBEAT_V1])
    def test_taken_unchecked_where_a_frame_or_the_end_follows(self, follows: bytes) -> None:
        frames = frames_in(parse_datagram(unknown_frame() + follows, CRC_EXTRAS))
        assert (frames[0].msgid, frames[0].payload, frames[0].checked) == (UNKNOWN_ID, b"\x01\x02\x03", False)
        assert all(frame.checked for frame in frames[1:])
        assert b"".join(frame.raw for frame in frames[1:]) == follows

    def test_not_taken_where_anything_else_follows(self) -> None:
        found = parse_datagram(unknown_frame() + b"\x00" + location(), CRC_EXTRAS)
        assert [frame.msgid for frame in frames_in(found)] == [12901]
        assert rejects_in(found)[0].cause is Cause.UNKNOWN_UNCONFIRMED

    @pytest.mark.parametrize("msgid", [256 * 5, 0x010000, 0xFFFFFF])
    def test_ids_have_24_bits(self, msgid: int) -> None:
        assert frames_in(parse_datagram(unknown_frame(msgid=msgid), CRC_EXTRAS))[0].msgid == msgid


SWALLOWER = b"\xfd" + bytes((40, 0, 0, 1, 7, 7)) + UNKNOWN_ID.to_bytes(3, "little")
"""What damage may leave: a header of an unknown id, 42 bytes behind which ends the frame that it seems to begin."""


class TestUnknownIdsInStreams:
    """A stream may be damaged anywhere, and chance leaves magic bytes: what checks is believed before what cannot."""

    @pytest.mark.parametrize(
        "good",
        [HEARTBEAT_V1, Encoder(1, 1).encode("HEARTBEAT", type=2), signed(Encoder(1, 1).encode("HEARTBEAT"), 50)],
        ids=["version 1", "version 2", "signed"],
    )
    @pytest.mark.parametrize("follows", [b"", location()], ids=["the end", "a frame"])
    def test_a_frame_that_checks_is_not_swallowed_by_one_that_would_end_with_it(
        self, good: bytes, follows: bytes
    ) -> None:
        data = SWALLOWER + b"\xfd\xfe" * 3 + bytes(36 - len(good)) + good + follows
        parser = FrameParser(CRC_EXTRAS)
        found = parser.feed(data) + parser.flush()
        assert b"".join(frame.raw for frame in frames_in(found)) == good + follows
        assert rejects_in(found)[0] == BadFrame(0, Cause.UNKNOWN_UNCONFIRMED, 1)

    def test_a_stray_magic_byte_does_not_swallow_a_frame_of_the_length_it_claims(self) -> None:
        body = bytes((0xFD, 7, 1, 200, 0)) + bytes(range(253))
        long = b"\xfe" + body + checksum(body, CRC_EXTRAS[0]).to_bytes(2, "little")
        parser = FrameParser(CRC_EXTRAS)
        frames = frames_in(parser.feed(b"\xfe" + long + location()))
        assert [frame.raw for frame in frames] == [long, location()]

    def test_a_magic_byte_may_end_a_frame(self) -> None:
        raw = unknown_frame()[:-1] + b"\xfe"
        assert [frame.raw for frame in frames_in(FrameParser(CRC_EXTRAS).feed(raw + location()))] == [raw, location()]

    def test_a_datagram_is_taken_as_it_came(self) -> None:
        data = SWALLOWER + bytes(42 - len(HEARTBEAT_V1)) + HEARTBEAT_V1
        assert [frame.msgid for frame in frames_in(parse_datagram(data, CRC_EXTRAS))] == [UNKNOWN_ID]

    @pytest.mark.parametrize(
        "carried",
        [HEARTBEAT_V1, HEARTBEAT_V1 + b"\x00\x07", HEARTBEAT_V1 + b"\xfd", HEARTBEAT_V1[:-2], location()[:-2]],
        ids=["whole", "and more", "and a magic byte", "but for its checksum", "but for its checksum, version 2"],
    )
    def test_a_tunnel_keeps_what_it_carries(self, carried: bytes) -> None:
        tunnel = unknown_frame(payload=b"\x01" + carried)
        parser = FrameParser(CRC_EXTRAS)
        frames = frames_in(parser.feed(tunnel + location()))
        assert [(frame.raw, frame.checked) for frame in frames] == [(tunnel, False), (location(), True)]


class TestDatagrams:
    def test_empty(self) -> None:
        assert parse_datagram(b"", CRC_EXTRAS) == []

    @pytest.mark.parametrize("poison", [POISON, POISON * 3, unknown_frame()[:-1], b"\xfd", b"\xfe\xff", POISON[:9]])
    def test_poison_loses_no_good_frame_of_its_datagram(self, poison: bytes) -> None:
        for data in (poison + location(), location() + poison, location() + poison + location(seq=1)):
            assert [f.raw for f in frames_in(parse_datagram(data, CRC_EXTRAS))] == [
                location(seq=i) for i in range(data.count(location()[10:-2]))
            ]

    def test_poison_cannot_reach_the_next_datagram(self) -> None:
        for _ in range(3):
            assert frames_in(parse_datagram(POISON, CRC_EXTRAS)) == []
            assert [f.raw for f in frames_in(parse_datagram(location(), CRC_EXTRAS))] == [location()]

    def test_takes_64_frames_and_ignores_the_rest(self) -> None:
        data = b"".join(location(seq=i) for i in range(100))
        frames = frames_in(parse_datagram(data, CRC_EXTRAS))
        assert [frame.seq for frame in frames] == list(range(MAX_FRAMES_PER_DATAGRAM))

    def test_largest_datagram_of_noise_still_gives_its_frame(self) -> None:
        data = random.Random(2).randbytes(65_507 - len(location()) * 2)
        frames = frames_in(parse_datagram(location() + data + location(seq=1), CRC_EXTRAS))
        assert [frame.seq for frame in frames if frame.checked] == [0, 1]

    @pytest.mark.parametrize("unit", [b"\xfe", b"\xfd\x00", POISON])
    def test_a_datagram_made_of_false_starts_is_given_up(self, unit: bytes) -> None:
        starts = unit * MAX_FALSE_STARTS
        patient = parse_datagram(location() + starts[: -2 * len(unit)] + location(seq=1), CRC_EXTRAS)
        assert [frame.seq for frame in frames_in(patient)] == [0, 1]
        found = parse_datagram(location() + starts + location(seq=1), CRC_EXTRAS)
        assert [frame.seq for frame in frames_in(found)] == [0]
        assert sum(item.length if isinstance(item, BadFrame) else len(item.raw) for item in found) == len(
            location() + starts + location(seq=1)
        )

    def test_neighbouring_rejects_of_one_cause_are_one_entry(self) -> None:
        found = parse_datagram(b"\x00" * 5 + location() + b"\xfd" * 1000, CRC_EXTRAS)
        assert found[0] == BadFrame(0, Cause.GARBAGE, 5)
        assert [bad.cause for bad in rejects_in(found)[1:]] == [Cause.INCOMPATIBLE_FLAGS, Cause.TRUNCATED]

    @pytest.mark.parametrize("unit", [b"\xfd", b"\xfe", b"\xfd\xff\x00", POISON, b"\xfd\xff\x00\x00", b"\x00"])
    def test_time_grows_with_the_length_only(self, unit: bytes) -> None:
        def cost(size: int) -> float:
            data = (unit * (size // len(unit) + 1))[:size]
            best = float("inf")
            for _ in range(3):
                begin = time.process_time()
                parse_datagram(data, CRC_EXTRAS, limit=1_000_000)
                best = min(best, time.process_time() - begin)
            return best

        # eight times the bytes: 8 if linear, 64 if quadratic; the constant keeps short timings out of it
        assert cost(64_000) < 20 * cost(8_000) + 0.02

    @unhurried
    @given(st.binary(max_size=400))
    def test_any_bytes_are_accounted_for(self, data: bytes) -> None:
        found = parse_datagram(data, CRC_EXTRAS)
        at = 0
        for item in found:
            assert item.offset == at
            at += len(item.raw) if isinstance(item, Frame) else item.length
        assert at == len(data)

    @unhurried
    @given(st.lists(st.sampled_from([0xFD, 0xFE, 0x00, 0x01, 0x02, 0xFF]), max_size=300).map(bytes))
    def test_any_bytes_that_look_like_headers_are_accounted_for(self, data: bytes) -> None:
        found = parse_datagram(data, CRC_EXTRAS, limit=1000)
        assert sum(len(i.raw) if isinstance(i, Frame) else i.length for i in found) == len(data)

    @unhurried
    @given(st.lists(st.tuples(noise, good_frames), max_size=8), noise)
    def test_frames_with_garbage_between_all_come_out(self, parts: list[tuple[bytes, bytes]], tail: bytes) -> None:
        data = b"".join(garbage + frame for garbage, frame in parts) + tail
        found = parse_datagram(data, CRC_EXTRAS)
        assert [frame.raw for frame in frames_in(found)] == [frame for _, frame in parts]
        assert all(bad.cause is Cause.GARBAGE for bad in rejects_in(found))
        assert sum(bad.length for bad in rejects_in(found)) == sum(len(g) for g, _ in parts) + len(tail)


class TestStreams:
    @unhurried
    @given(
        st.lists(st.one_of(good_frames, st.binary(max_size=30), st.just(POISON), st.just(unknown_frame())), max_size=6),
        st.lists(st.integers(0, 600), max_size=10),
    )
    def test_split_feeds_equal_the_whole_feed(self, parts: list[bytes], cuts: list[int]) -> None:
        data = b"".join(parts)
        whole = FrameParser(CRC_EXTRAS)
        expected = whole.feed(data) + whole.flush()
        pieces = FrameParser(CRC_EXTRAS)
        found: list[Frame | BadFrame] = []
        edges = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
        for begin, end in pairwise(edges):
            found += pieces.feed(data[begin:end])
            assert pieces.pending <= MAX_FRAME_LENGTH
        found += pieces.flush()
        assert frames_in(found) == frames_in(expected)
        for cause in Cause:
            lengths = [sum(b.length for b in rejects_in(f) if b.cause is cause) for f in (found, expected)]
            assert lengths[0] == lengths[1], cause

    def test_byte_by_byte_with_offsets(self) -> None:
        data = b"xyz" + location() + HEARTBEAT_V1 + unknown_frame() + location(seq=1)
        parser = FrameParser(CRC_EXTRAS)
        found = [item for at in range(len(data)) for item in parser.feed(data[at : at + 1])] + parser.flush()
        frames = frames_in(found)
        assert [frame.msgid for frame in frames] == [12901, 0, UNKNOWN_ID, 12901]
        assert all(data[f.offset : f.offset + len(f.raw)] == f.raw for f in frames)

    def test_an_unknown_frame_waits_for_what_confirms_it(self) -> None:
        parser = FrameParser(CRC_EXTRAS)
        assert parser.feed(unknown_frame()) == []
        assert [f.msgid for f in frames_in(parser.feed(location()))] == [UNKNOWN_ID, 12901]

    def test_a_known_frame_comes_out_with_its_last_byte(self) -> None:
        parser = FrameParser(CRC_EXTRAS)
        assert parser.feed(location()[:-1]) == []
        assert len(parser.feed(location()[-1:])) == 1
        assert parser.pending == 0

    def test_flush_finds_the_frame_behind_a_false_length(self) -> None:
        parser = FrameParser(CRC_EXTRAS)
        assert parser.feed(POISON + location()) == []
        assert [frame.raw for frame in frames_in(parser.flush())] == [location()]


class TestDamage:
    @pytest.mark.parametrize("name", ["OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION", "HEARTBEAT"])
    def test_no_single_flipped_bit_passes_as_another_message(self, name: str) -> None:
        encoder = Encoder(7, 1)
        id_or_mac = {} if name == "HEARTBEAT" else {"id_or_mac": bytes(range(100, 120))}
        good = encoder.encode(name, **id_or_mac)
        for bit in range(len(good) * 8):
            damaged = bytearray(good)
            damaged[bit // 8] ^= 1 << bit % 8
            assert not [f for f in frames_in(parse_datagram(bytes(damaged), CRC_EXTRAS)) if f.checked], bit

    @unhurried
    @given(good_frames, st.data())
    def test_no_flipped_bit_of_a_payload_passes(self, good: bytes, data: st.DataObject) -> None:
        damaged = bytearray(good)
        damaged[data.draw(st.integers(10, len(good) - 3))] ^= 1 << data.draw(st.integers(0, 7))
        # a whole valid frame inside the payload may still come out: only the outer one is damaged
        assert not [f for f in frames_in(parse_datagram(bytes(damaged), CRC_EXTRAS)) if f.checked and f.offset == 0]

    def test_recovers_more_than_pymavlink(self) -> None:
        seed, count = 20_240_501, 20_000
        generator = random.Random(seed)
        sent = [location(latitude=generator.randrange(1, 2**30), seq=i & 0xFF) for i in range(count)]
        stream = bytearray(b"".join(sent))
        damaged = set()
        for at in range(len(stream)):
            if generator.random() < 1e-3:
                stream[at] ^= 1 << generator.randrange(8)
                damaged.add(at // len(sent[0]))
        assert {len(frame) for frame in sent} == {len(sent[0])}, "all of one length, so that offsets tell frames"

        originals = {(i * len(frame), frame) for i, frame in enumerate(sent)}
        parser = FrameParser(CRC_EXTRAS)
        found = [f for f in frames_in(parser.feed(bytes(stream)) + parser.flush()) if f.checked]
        ours = sum((frame.offset, frame.raw) in originals for frame in found)

        reader = common.MAVLink(None)
        reader.robust_parsing = True
        messages = reader.parse_buffer(bytes(stream))
        contents = {bytes(frame) for frame in sent}
        theirs = sum(bytes(message.get_msgbuf()) in contents for message in messages)

        print(f"seed {seed}: {count - len(damaged)} of {count} intact, ridlink {ours}, pymavlink {theirs}")
        assert len(found) == ours, "nothing came out that was not sent"
        assert ours >= theirs
        assert ours >= 0.999 * (count - len(damaged))
