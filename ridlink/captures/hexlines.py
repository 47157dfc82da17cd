"""Lines of hexadecimal, without times: each is one message of 25 bytes, one message pack, or one frame.

A frame is one of MAVLink, or one of the air that needs no capture around it: 802.11 without radiotap, Bluetooth from
its access address on. Whether a checksum at the end of these is right is not known, as in `ridlink.remote_id.radio`.

Spaces, colons, dashes, ``0x`` and comments (from ``#``) are allowed, empty lines too. Rejects are reported by line.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from ridlink.captures.broadcasts import Relay
from ridlink.captures.raw import parse_alone
from ridlink.captures.records import Record, Rejects
from ridlink.mavlink.frames import MAGIC_V1, MAGIC_V2, Frame
from ridlink.remote_id.astm import MESSAGE_LENGTH, Refusal
from ridlink.remote_id.astm_pack import Member, is_pack, split_broadcast
from ridlink.remote_id.radio import Heard, Unheard, read_80211, read_ble

MAX_LINE_LENGTH = 4096
NOT_HEX = "not_hexadecimal"
LINE_TOO_LONG = "line_too_long"

_FILLING = re.compile(rb"[\s:,;-]+|0[xX]")
_DETECTED_LINES = 64


def read_hex(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Record]:
    """Records of lines of hexadecimal in constant memory, whatever the bytes are.

    Args:
        chunks: The file from its first byte.
        rejects: Counts lines, and members of packs, that were not taken; their places are line numbers from 1.
    """
    rejects.unit = "line"
    relay = Relay(rejects)
    for number, (offset, line) in enumerate(_lines(chunks), 1):
        if line is None:
            rejects.add_one(LINE_TOO_LONG, number)
            continue
        data = _data_of(line)
        if data is None:
            rejects.add_one(NOT_HEX, number)
        elif data[:1] in (bytes((MAGIC_V1,)), bytes((MAGIC_V2,))):
            for item in parse_alone(data):
                if isinstance(item, Frame):
                    yield Record(None, item, offset)
                else:
                    rejects.add_one(item.cause, number)
        elif data and (is_pack(data) or len(data) == MESSAGE_LENGTH):
            yield from relay.records(data, None, offset, place=number)
        elif found := _on_the_air(data):
            yield from relay.heard(found, None, offset, place=number)
        elif data:
            rejects.add_one(Refusal.WRONG_LENGTH, number)


def looks_like_hex(head: bytes) -> bool:
    """Whether the first lines of a text contain a message, a pack or a frame in hexadecimal."""
    if not head.isascii() or b"\x00" in head:
        return False
    for line in head.split(b"\n", _DETECTED_LINES)[:_DETECTED_LINES]:
        data = _data_of(line) if len(line) <= MAX_LINE_LENGTH else None
        if not data:
            continue
        if any(isinstance(item, Frame) and item.checked for item in parse_alone(data)):
            return True
        if is_pack(data) or len(data) == MESSAGE_LENGTH:
            return any(isinstance(item, Member) for item in split_broadcast(data))
        if _on_the_air(data):
            return True
    return False


def _on_the_air(data: bytes) -> list[Heard | Unheard]:
    return read_80211(data) or read_ble(data)


def _data_of(line: bytes) -> bytes | None:
    """Bytes of a line, empty for an empty line or a comment; ``None`` if it is not hexadecimal."""
    digits = _FILLING.sub(b"", line.partition(b"#")[0])
    try:
        return bytes.fromhex(digits.decode("ascii"))
    except ValueError:
        return None


def _lines(chunks: Iterable[bytes]) -> Iterator[tuple[int, bytes | None]]:
    """Lines with their byte offsets; ``None`` for a line that is too long."""
    pending, offset, too_long = b"", 0, False
    for chunk in chunks:
        *complete, rest = chunk.split(b"\n")
        for part in complete:
            line = pending + part
            yield offset, None if too_long or len(line) > MAX_LINE_LENGTH else line
            offset += len(line) + 1
            pending, too_long = b"", False
        pending += rest
        if len(pending) > MAX_LINE_LENGTH:
            offset += len(pending)
            pending, too_long = b"", True
    if pending or too_long:
        yield offset, None if too_long else pending
