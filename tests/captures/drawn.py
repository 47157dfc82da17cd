"""Frames as hypothesis draws them: of both versions, known or not, whole or not."""

from __future__ import annotations

from hypothesis import strategies as st

from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, MESSAGES_BY_NAME
from ridlink.mavlink.crc import checksum
from ridlink.mavlink.frames import encode_frame
from tests.captures.conftest import START_US


def version_1(msgid: int, payload: bytes, extra: int) -> bytes:
    body = bytes([len(payload), 7, 1, 1, msgid]) + payload
    return b"\xfe" + body + checksum(body, extra).to_bytes(2, "little")


def signed(msgid: int, payload: bytes, extra: int) -> bytes:
    body = bytes([len(payload), 1, 0, 7, 2, 1, *msgid.to_bytes(3, "little")]) + payload
    return b"\xfd" + body + checksum(body, extra).to_bytes(2, "little") + bytes(range(13))


@st.composite
def frames(draw: st.DrawFn) -> bytes:
    """Frames of both versions, signed or not, known or not, with too little and too much payload."""
    msgid = draw(st.sampled_from([0, 33, 12901, 12902, 61400, 385, 54321, 0x123456, 200]))
    payload = draw(st.binary(min_size=1, max_size=draw(st.sampled_from([4, 60, 255]))))
    extra = CRC_EXTRAS.get(msgid, 9)
    shape = draw(st.integers(0, 3))
    if shape == 0 and msgid < 256:
        return version_1(msgid, payload, extra)
    if shape == 1:
        return signed(msgid, payload, extra)
    sysid, seq = draw(st.integers(0, 3)), draw(st.integers(0, 255))
    return encode_frame(msgid, payload, extra, seq=seq, sysid=sysid, compid=1)


TIMES = st.one_of(
    st.integers(START_US, START_US + 10**7),
    st.sampled_from([0, 5, 33_333, 2**62, 2**63 - 1, 2**64 - 1, START_US + 400 * 86400 * 10**6, 10**15]),
)


PIECES = st.lists(
    st.one_of(
        st.tuples(TIMES, frames()),
        st.tuples(TIMES, frames()),
        st.tuples(st.none(), st.binary(max_size=40)),
        st.tuples(st.none(), st.lists(st.sampled_from([0xFD, 0xFE, 0, 1, 255]), max_size=20).map(bytes)),
    ),
    max_size=14,
)


@st.composite
def packs(draw: st.DrawFn) -> bytes:
    """Message packs with members of every type, and with what is no member."""
    members = draw(st.lists(st.tuples(st.sampled_from([0, 1, 2, 3, 4, 5, 7, 15]), st.binary(max_size=24)), max_size=9))
    body = b"".join(bytes([kind << 4 | 2]) + rest.ljust(24, b"\x00") for kind, rest in members)
    size, count = draw(st.sampled_from([25, 25, 25, 24])), draw(st.just(len(members)) | st.integers(0, 255))
    payload = bytes(22) + bytes([size, count]) + body
    spec = MESSAGES_BY_NAME["OPEN_DRONE_ID_MESSAGE_PACK"]
    return encode_frame(spec.msgid, payload.ljust(spec.size, b"\x00"), spec.crc_extra, seq=draw(st.integers(0, 255)),
                        sysid=1, compid=1)  # fmt: skip


PACK_MEMBER = bytes.fromhex("0212") + b"AIRCRAFT-1".ljust(23, b"\x00")


NAMES = sorted(MESSAGES_BY_NAME)


ABOUT_REMOTE_ID = [name for name in NAMES if name.startswith(("OPEN_DRONE_ID", "RIDLINK"))]


EDGES = st.sampled_from([0, 1, 36000, 36001, 36100, 25425, 25426, 25500, 6200, 6201, 6300, 65535, 2**31 - 1, 900000000])


@st.composite
def any_frame(draw: st.DrawFn) -> bytes:
    spec = MESSAGES_BY_NAME[draw(st.sampled_from(ABOUT_REMOTE_ID) | st.sampled_from(NAMES))]
    payload = bytearray(draw(st.binary(max_size=spec.size)).ljust(spec.size, b"\x00"))
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, max(0, spec.size - 2)))
        payload[at : at + 2] = (draw(EDGES) & 0xFFFF).to_bytes(2, "little")
    if spec.name == "OPEN_DRONE_ID_MESSAGE_PACK" and draw(st.booleans()):
        members = PACK_MEMBER * draw(st.integers(1, 3))
        payload[:] = (b"\x00" * 22 + bytes((25, len(members) // 25)) + members).ljust(spec.size, b"\x00")
    msgid = draw(st.sampled_from([spec.msgid, spec.msgid, spec.msgid, 54321]))
    extra = MESSAGES[msgid].crc_extra if msgid in MESSAGES else 1
    return encode_frame(msgid, bytes(payload), extra, seq=draw(st.integers(0, 255)), sysid=draw(st.integers(0, 255)),
                        compid=draw(st.sampled_from([0, 1, 255])))  # fmt: skip
