"""Bytes to MAVLink frames and back: versions 1 and 2, checksums, signed frames, resynchronisation.

Nothing here opens a socket or keeps state between datagrams. ``parse_datagram`` parses each datagram on its own, so ten
bytes that claim a long payload cannot swallow the next datagram. For a byte stream (file, TCP, serial) use a
``FrameParser``, which holds back at most one unfinished frame.

After a bad frame, scanning continues one byte later, so frames behind a damaged length byte are found. A message id
that the dialect does not know has no checksum seed. Its frame is taken, as ``checked=False``, only if another magic
byte or the end follows. In a stream, which may be damaged, there is a second condition: no frame with a right checksum
may end in the same place. Such a frame was really sent, and the unknown one only seems to contain it, starting within a
damaged frame. The work per byte is bounded (for each magic byte one checksum over at most 265 bytes, in a stream two),
so the time grows linearly with the length of the input, whatever the bytes are.

Source: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

from ridlink.errors import FrameError
from ridlink.mavlink.crc import checksum

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
INCOMPAT_SIGNED = 0x01
SIGNATURE_LENGTH = 13
HEADER_LENGTH_V1 = 6
HEADER_LENGTH_V2 = 10
MAX_FRAME_LENGTH = HEADER_LENGTH_V2 + 255 + 2 + SIGNATURE_LENGTH
_OVERHEAD_V1, _OVERHEAD_V2 = HEADER_LENGTH_V1 + 2, HEADER_LENGTH_V2 + 2
MAX_FRAMES_PER_DATAGRAM = 64
MAX_FALSE_STARTS = 1024
"""Limit for one datagram: twice what random bytes put into the largest one. Without it, parsing a datagram of magic
bytes would take longer than the time between two setpoints."""

_MAGIC = re.compile(b"[\xfd\xfe]")


class Cause(StrEnum):
    """Reason why bytes were not taken as a frame."""

    GARBAGE = "garbage"
    BAD_CHECKSUM = "bad_checksum"
    INCOMPATIBLE_FLAGS = "incompatible_flags"
    UNKNOWN_UNCONFIRMED = "unknown_unconfirmed"
    TRUNCATED = "truncated"


class Frame(NamedTuple):
    """One frame as received; ``checked`` says whether its checksum was verified."""

    version: int
    incompat_flags: int
    compat_flags: int
    seq: int
    sysid: int
    compid: int
    msgid: int
    payload: bytes
    signature: bytes
    checked: bool
    offset: int
    raw: bytes


class BadFrame(NamedTuple):
    """Bytes that were not taken: offset, cause and length. Neighbouring bytes refused for one cause are one entry."""

    offset: int
    cause: Cause
    length: int


def _frame_at(data: bytes, at: int, offset: int, crc_extras: Mapping[int, int], final: bool) -> Frame | Cause:
    """The frame that starts at the magic byte ``data[at]``, or why there is none; ``TRUNCATED`` needs more bytes."""
    length = len(data)
    if data[at] == MAGIC_V2:
        if length - at < HEADER_LENGTH_V2:
            return Cause.TRUNCATED
        incompat, compat = data[at + 2], data[at + 3]
        if incompat & ~INCOMPAT_SIGNED:
            return Cause.INCOMPATIBLE_FLAGS
        payload_start, version = at + HEADER_LENGTH_V2, 2
        seq, sysid, compid = data[at + 4], data[at + 5], data[at + 6]
        msgid = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
    else:
        if length - at < HEADER_LENGTH_V1:
            return Cause.TRUNCATED
        incompat = compat = 0
        payload_start, version = at + HEADER_LENGTH_V1, 1
        seq, sysid, compid, msgid = data[at + 2], data[at + 3], data[at + 4], data[at + 5]
    payload_end = payload_start + data[at + 1]
    end = checksum_end = payload_end + 2
    if incompat:
        end += SIGNATURE_LENGTH
    if length < end:
        return Cause.TRUNCATED
    extra = crc_extras.get(msgid)
    if extra is not None:
        if checksum(data[at + 1 : payload_end], extra) != data[payload_end] | data[payload_end + 1] << 8:
            return Cause.BAD_CHECKSUM
    elif length == end:
        if not final:  # in a stream the byte that confirms the frame has not arrived yet
            return Cause.TRUNCATED
    elif data[end] != MAGIC_V2 and data[end] != MAGIC_V1:
        return Cause.UNKNOWN_UNCONFIRMED
    return Frame(
        version,
        incompat,
        compat,
        seq,
        sysid,
        compid,
        msgid,
        data[payload_start:payload_end],
        data[checksum_end:end],
        extra is not None,
        offset + at,
        data[at:end],
    )


def _ends_with_another(raw: bytes, crc_extras: Mapping[int, int]) -> bool:
    """Whether a frame with a right checksum lies within these bytes and ends with them."""
    for magic in _MAGIC.finditer(raw, 1, len(raw) - 1):
        start = magic.start()
        overhead = len(raw) - start - raw[start + 1]
        if overhead in (_OVERHEAD_V1, _OVERHEAD_V2, _OVERHEAD_V2 + SIGNATURE_LENGTH):
            found = _frame_at(raw, start, 0, crc_extras, final=True)
            if isinstance(found, Frame) and found.checked and start + len(found.raw) == len(raw):
                return True
    return False


def _scan(
    data: bytes,
    crc_extras: Mapping[int, int],
    *,
    offset: int,
    final: bool,
    stream: bool,
    limit: int | None = None,
    patience: int | None = None,
) -> tuple[list[Frame | BadFrame], int]:
    """All frames and rejects in ``data`` in order, and how many bytes were examined.

    After ``limit`` frames the rest is ignored; after ``patience`` false starts the rest is refused with the last of
    them.
    """
    found: list[Frame | BadFrame] = []
    frames = false_starts = at = refused_from = inner_end = 0
    refused: Cause | None = None
    length = len(data)
    while at < length:
        step = 1
        if data[at] == MAGIC_V2 or data[at] == MAGIC_V1:
            result = _frame_at(data, at, offset, crc_extras, final)
            if result is Cause.TRUNCATED and not final:
                break
            if stream and isinstance(result, Frame) and not result.checked:
                end = at + len(result.raw)
                if end == inner_end or _ends_with_another(result.raw, crc_extras):
                    result, inner_end = Cause.UNKNOWN_UNCONFIRMED, end
            if not isinstance(result, Frame):
                false_starts += 1
                if false_starts == patience:
                    step = length - at
        else:
            magic = _MAGIC.search(data, at)
            step = (magic.start() if magic else length) - at
            result = Cause.GARBAGE
        if refused is not None and result is not refused:
            found.append(BadFrame(offset + refused_from, refused, at - refused_from))
            refused = None
        if isinstance(result, Frame):
            found.append(result)
            step = len(result.raw)
            frames += 1
            if frames == limit:
                return found, length
        elif refused is None:
            refused_from, refused = at, result
        at += step
    if refused is not None:
        found.append(BadFrame(offset + refused_from, refused, at - refused_from))
    return found, at


def parse_datagram(
    data: bytes, crc_extras: Mapping[int, int], *, limit: int | None = MAX_FRAMES_PER_DATAGRAM
) -> list[Frame | BadFrame]:
    """Frames and rejects of one datagram, in order; never raises, whatever the bytes.

    Args:
        data: The datagram.
        crc_extras: CRC_EXTRA by message id, as ``ridlink.mavlink.codec.CRC_EXTRAS``.
        limit: Frames taken at most; what follows is ignored. ``None`` takes all.
    """
    found, _ = _scan(data, crc_extras, offset=0, final=True, stream=False, limit=limit, patience=MAX_FALSE_STARTS)
    return found


class FrameParser:
    """Finds the frames in a byte stream that arrives in pieces; the frames do not depend on how it is cut.

    A run of refused bytes gives one entry for each piece that it is cut into. A damaged length byte near the end of the
    stream makes the parser wait for bytes that never come; ``flush`` parses what is left.
    """

    def __init__(self, crc_extras: Mapping[int, int]) -> None:
        self._crc_extras = crc_extras
        self._pending = b""
        self._offset = 0

    @property
    def pending(self) -> int:
        """Bytes held back because they may be the start of a frame; at most ``MAX_FRAME_LENGTH``."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Frame | BadFrame]:
        """Frames and rejects that are complete now; offsets count from the first byte ever fed."""
        return self._take(data, final=False)

    def flush(self) -> list[Frame | BadFrame]:
        """Frames and rejects in the bytes held back; call it when the stream has ended."""
        return self._take(b"", final=True)

    def _take(self, data: bytes, *, final: bool) -> list[Frame | BadFrame]:
        data = self._pending + data
        found, judged = _scan(data, self._crc_extras, offset=self._offset, final=final, stream=True)
        self._pending = data[judged:]
        self._offset += judged
        return found


def encode_frame(msgid: int, payload: bytes, crc_extra: int, *, seq: int, sysid: int, compid: int) -> bytes:
    """A MAVLink 2 frame, unsigned.

    Args:
        msgid: 24-bit message id.
        payload: Full payload, at most 255 bytes; trailing zeros are cut off as MAVLink 2 demands, the first byte stays.
        crc_extra: Checksum seed of the message.
        seq: Sequence number, taken modulo 256.
        sysid: System id of the sender, 0 to 255.
        compid: Component id of the sender, 0 to 255.

    Raises:
        FrameError: If an id or the payload does not fit.
    """
    trimmed = payload.rstrip(b"\x00") or payload[:1]
    try:
        header = bytes((len(trimmed), 0, 0, seq & 0xFF, sysid, compid, msgid & 0xFF, msgid >> 8 & 0xFF, msgid >> 16))
    except ValueError as error:
        parts = (
            ("payload", len(trimmed), 0xFF),
            ("msgid", msgid, 0xFFFFFF),
            ("sysid", sysid, 0xFF),
            ("compid", compid, 0xFF),
        )
        part, value, most = next(each for each in parts if not 0 <= each[1] <= each[2])
        raise FrameError(f"{part} of a frame is 0 to {most}, not {value}", part=part) from error
    body = header + trimmed
    return b"\xfd" + body + checksum(body, crc_extra).to_bytes(2, "little")
