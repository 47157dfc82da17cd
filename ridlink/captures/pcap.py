"""pcap and pcapng: packets with their times and link types, in constant memory and whatever the damage.

No length that stands in the file is believed before it is checked: a packet has at most 262,144 bytes, a header must
be plausible, and where the next one is not, the true end of the record is looked for within it. After damage the next
header is looked for at every byte, and must be followed by another one or the end. A cut tail is ``truncated``.

Source: https://datatracker.ietf.org/doc/draft-ietf-opsawg-pcap/ and .../draft-ietf-opsawg-pcapng/
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ridlink.captures.records import Rejects
from ridlink.mavlink.frames import Cause

MAX_PACKET_LENGTH = 262_144
MAX_BLOCK_LENGTH = MAX_PACKET_LENGTH + 65_536
"""A packet and its options."""
MAX_INTERFACES = 1024
BAD_HEADER = "bad_packet_header"
UNKNOWN_INTERFACE = "unknown_interface"
TOO_MANY_INTERFACES = "too_many_interfaces"
PLAUSIBLE_STEP_S = 3 * 24 * 3600
MAX_TIME_US = 2**63 - 1

MICROSECONDS, NANOSECONDS = 1_000_000, 1_000_000_000
PCAP_MAGICS = {
    b"\xd4\xc3\xb2\xa1": ("<", MICROSECONDS),
    b"\xa1\xb2\xc3\xd4": (">", MICROSECONDS),
    b"\x4d\x3c\xb2\xa1": ("<", NANOSECONDS),
    b"\xa1\xb2\x3c\x4d": (">", NANOSECONDS),
}
FILE_HEADER_LENGTH = 24
PACKET_HEADER_LENGTH = 16
LINK_TYPE_MASK = 0x03FFFFFF
"""Above it stands whether packets end with a checksum; nothing that is read here is hurt by one."""

PCAPNG_MAGIC = b"\x0a\x0d\x0d\x0a"
SECTION_HEADER, INTERFACE, OLD_PACKET, SIMPLE_PACKET, ENHANCED_PACKET = 0x0A0D0D0A, 1, 2, 3, 6
MIN_BLOCK_LENGTH = 12
BYTE_ORDERS = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
OPTION_RESOLUTION, OPTION_OFFSET = 9, 14
MAGICS = (*PCAP_MAGICS, PCAPNG_MAGIC)


class Packet(NamedTuple):
    """One packet: microseconds since 1970 or ``None``, link type, bytes, byte of the file where its record starts."""

    time_us: int | None
    link_type: int
    data: bytes
    offset: int


def read_packets(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Packet]:
    """Packets of a pcap or pcapng file, however it is cut into chunks and whatever the bytes are.

    Args:
        chunks: The file from its first byte.
        rejects: Counts what is damaged.
    """
    window = _Window(chunks)
    window.reach(FILE_HEADER_LENGTH)
    magic = window.peek(0, 4)
    if magic in PCAP_MAGICS and window.left >= FILE_HEADER_LENGTH:
        yield from _PcapReader(window, rejects, *PCAP_MAGICS[magic]).packets()
    elif magic == PCAPNG_MAGIC:
        yield from _PcapngReader(window, rejects).packets()
    elif window.left:
        rejects.add(Cause.TRUNCATED if magic in PCAP_MAGICS else Cause.GARBAGE, 0, window.left)


class _Window:
    """A view on a stream that moves forwards only and holds no more than it is asked for, and a chunk."""

    def __init__(self, chunks: Iterable[bytes]) -> None:
        self._chunks = iter(chunks)
        self._base = 0
        self.data = b""
        self.at = 0
        self.ended = False

    @property
    def left(self) -> int:
        """Bytes at hand."""
        return len(self.data) - self.at

    @property
    def offset(self) -> int:
        """Byte of the stream where the view begins."""
        return self._base + self.at

    def reach(self, length: int) -> bool:
        """Have so many bytes at hand; ``False`` where the stream ends before."""
        if self.left >= length:
            return True
        parts = [self.data[self.at :]]
        had = self.left
        while had < length and not self.ended:
            chunk = next(self._chunks, None)
            if chunk is None:
                self.ended = True
            else:
                parts.append(chunk)
                had += len(chunk)
        self._base, self.at, self.data = self._base + self.at, 0, b"".join(parts)
        return had >= length

    def peek(self, start: int, end: int) -> bytes:
        """Bytes at hand, counted from where the view begins."""
        return self.data[self.at + start : self.at + end]

    def skip(self, length: int) -> None:
        """Move on."""
        self.at += length


class _PcapReader:
    """The classic format: one header, then one record after the other."""

    def __init__(self, window: _Window, rejects: Rejects, order: str, per_second: int) -> None:
        self._window = window
        self._rejects = rejects
        self._header = struct.Struct(order + "IIII")
        self._per_second = per_second
        self._link_type = struct.unpack(order + "I", window.peek(20, 24))[0] & LINK_TYPE_MASK
        # what a header looks like at first sight: fraction and captured length are small, and the length is not 0
        high = rb"[\x00-\x0f]" if per_second == MICROSECONDS else rb"[\x00-\x3b]"
        fraction, length = (high + rb"\x00", rb"[\x00-\x04]\x00")
        if per_second == NANOSECONDS:
            fraction = rb"." + high
        pattern = rb".{4}.." + fraction + rb".." + length
        if order == ">":
            fraction = rb"\x00" + high if per_second == MICROSECONDS else high + rb"."
            pattern = rb".{4}" + fraction + rb"..\x00[\x00-\x04].."
        self._first_sight = re.compile(rb"(?!.{8}\x00{4})(?=" + pattern + rb")", re.DOTALL)
        self._last_s: int | None = None

    def packets(self) -> Iterator[Packet]:
        window = self._window
        window.skip(FILE_HEADER_LENGTH)
        while window.reach(PACKET_HEADER_LENGTH):
            length = self._record_length(0)
            if length is None or self._ends_within(length):
                self._resynchronise()
                continue
            if window.left < length:
                break
            seconds, fraction, _, _ = self._header.unpack(window.peek(0, PACKET_HEADER_LENGTH))
            self._last_s = seconds
            time_us = seconds * MICROSECONDS + fraction * MICROSECONDS // self._per_second
            yield Packet(time_us, self._link_type, window.peek(PACKET_HEADER_LENGTH, length), window.offset)
            window.skip(length)
        if window.left:
            self._rejects.add(Cause.TRUNCATED, window.offset, window.left)

    def _record_length(self, start: int) -> int | None:
        """Length of the record that starts so far on, ``None`` where its header is not plausible."""
        header = self._window.peek(start, start + PACKET_HEADER_LENGTH)
        if len(header) < PACKET_HEADER_LENGTH:
            return None
        _, fraction, captured, original = self._header.unpack(header)
        if fraction >= self._per_second or not 0 < captured <= MAX_PACKET_LENGTH or captured > original:
            return None
        return PACKET_HEADER_LENGTH + int(captured)

    def _ends_within(self, length: int) -> bool:
        """The record does not end where it says: what follows is no header, but within it there is one."""
        window = self._window
        window.reach(length + PACKET_HEADER_LENGTH)
        follows = window.left - length
        if follows >= 0 and (follows < PACKET_HEADER_LENGTH or self._record_length(length) is not None):
            return False
        return self._find_record(PACKET_HEADER_LENGTH, length) is not None

    def _find_record(self, start: int, end: int) -> int | None:
        """Where between two places the next record starts that another one, or the end of the file, follows."""
        window = self._window
        while True:
            seen = self._first_sight.search(window.data, window.at + start, window.at + end + PACKET_HEADER_LENGTH)
            if seen is None:
                return None
            start = seen.start() - window.at
            if start >= end:
                return None
            if self._is_record(start):
                return start
            start += 1

    def _is_record(self, start: int) -> bool:
        length = self._record_length(start)
        if length is None:
            return False
        window = self._window
        window.reach(start + length + PACKET_HEADER_LENGTH)
        follows = window.left - start - length
        if follows < 0 or not self._is_near(start, self._last_s):
            return False
        if follows < PACKET_HEADER_LENGTH:
            return window.ended
        seconds = self._header.unpack(window.peek(start, start + PACKET_HEADER_LENGTH))[0]
        return self._record_length(start + length) is not None and self._is_near(start + length, seconds)

    def _is_near(self, start: int, reference_s: int | None) -> bool:
        seconds = self._header.unpack(self._window.peek(start, start + PACKET_HEADER_LENGTH))[0]
        return reference_s is None or abs(seconds - reference_s) <= PLAUSIBLE_STEP_S

    def _resynchronise(self) -> None:
        """Go on where the next record starts, one byte from here at the earliest; to the end if there is none."""
        window, start = self._window, 1
        while True:
            judged = max(start, window.left - PACKET_HEADER_LENGTH + 1)
            found = self._find_record(start, judged)
            if found is not None:
                self._refuse(found)
                return
            if not window.reach(window.left + 1):
                self._refuse(window.left)
                return
            self._refuse(judged)
            start = 0

    def _refuse(self, length: int) -> None:
        self._rejects.add(BAD_HEADER, self._window.offset, length)
        self._window.skip(length)


class _Interface(NamedTuple):
    """What an interface description says about its packets."""

    link_type: int
    snap_length: int
    units_per_second: int
    offset_s: int


class _PcapngReader:
    """The block format: sections with interfaces and packets, each block between its length and its length."""

    def __init__(self, window: _Window, rejects: Rejects) -> None:
        self._window = window
        self._rejects = rejects
        self._interfaces: list[_Interface] = []
        self._set_order("<")

    def _set_order(self, order: str) -> None:
        self._order = order
        kinds = rb"[\x01-\x06]\x00\x00\x00" if order == "<" else rb"\x00\x00\x00[\x01-\x06]"
        self._first_sight = re.compile(rb"(?=\x0a\x0d\x0d\x0a|" + kinds + rb")")

    def _unpack(self, layout: str, data: bytes, at: int = 0) -> tuple[int, ...]:
        return struct.unpack_from(self._order + layout, data, at)

    def packets(self) -> Iterator[Packet]:
        window = self._window
        while window.reach(MIN_BLOCK_LENGTH):
            length = self._block_length(0)
            if length is None:
                if not self._resynchronise(cut=self._is_cut()):
                    break
                continue
            block, offset = window.peek(0, length), window.offset
            window.skip(length)
            packet = self._take(block, offset)
            if packet is not None:
                yield packet
        if window.left:
            self._rejects.add(Cause.TRUNCATED, window.offset, window.left)

    def _block_length(self, start: int) -> int | None:
        """Length of the block that starts so far on; ``None`` where there is no whole block."""
        window = self._window
        window.reach(start + MIN_BLOCK_LENGTH)
        head = window.peek(start, start + MIN_BLOCK_LENGTH)
        if len(head) < MIN_BLOCK_LENGTH:
            return None
        order, length = self._claim(head)
        if not length or not window.reach(start + length):
            return None
        repeated = struct.unpack(order + "I", window.peek(start + length - 4, start + length))[0]
        return length if repeated == length else None

    def _claim(self, head: bytes) -> tuple[str, int]:
        """Byte order, and what a block says its length is; 0 where it cannot be."""
        order = BYTE_ORDERS.get(head[8:12], "") if head.startswith(PCAPNG_MAGIC) else self._order
        length: int = struct.unpack_from(order + "I", head, 4)[0]
        plausible = order and length % 4 == 0 and MIN_BLOCK_LENGTH <= length <= MAX_BLOCK_LENGTH
        return order, length if plausible else 0

    def _is_cut(self) -> bool:
        """The file ends before the block that starts here says it does."""
        length = self._claim(self._window.peek(0, MIN_BLOCK_LENGTH))[1]
        return length > self._window.left and self._window.ended

    def _resynchronise(self, *, cut: bool) -> bool:
        """Go on where the next whole block starts, and say whether there is one.

        Args:
            cut: All of the file is at hand, and stays so if there is none.
        """
        window, start = self._window, 1
        while True:
            seen = self._first_sight.search(window.data, window.at + start)
            if seen is not None:
                start = seen.start() - window.at
                if self._block_length(start) is not None:
                    self._refuse(start)
                    return True
                start += 1
                continue
            if cut:
                return False
            judged = max(start, window.left - 3)
            if not window.reach(window.left + 1):
                self._refuse(window.left)
                return False
            self._refuse(judged)
            start = 0

    def _refuse(self, length: int) -> None:
        self._rejects.add(BAD_HEADER, self._window.offset, length)
        self._window.skip(length)

    def _take(self, block: bytes, offset: int) -> Packet | None:
        """Take a block; the packet, if it holds one."""
        if block.startswith(PCAPNG_MAGIC):
            self._set_order(BYTE_ORDERS[block[8:12]])
            self._interfaces = []
            return None
        (kind,) = self._unpack("I", block)
        body = block[8:-4]
        try:
            if kind == INTERFACE:
                self._describe(body, offset)
            elif kind == ENHANCED_PACKET:
                number, high, low, captured, _ = self._unpack("IIIII", body)
                return self._packet(number, high << 32 | low, body[20:], captured, offset)
            elif kind == OLD_PACKET:
                number, _, high, low, captured, _ = self._unpack("HHIIII", body)
                return self._packet(number, high << 32 | low, body[20:], captured, offset)
            elif kind == SIMPLE_PACKET:
                (original,) = self._unpack("I", body)
                snap_length = self._interfaces[0].snap_length if self._interfaces else 0
                captured = min(original, snap_length or original, len(body) - 4)
                return self._packet(0, None, body[4:], captured, offset)
        except struct.error:  # shorter than its kind must be
            self._rejects.add_one(BAD_HEADER, offset)
        return None

    def _packet(self, number: int, units: int | None, data: bytes, captured: int, offset: int) -> Packet | None:
        if number >= len(self._interfaces):
            self._rejects.add_one(UNKNOWN_INTERFACE, offset)
            return None
        if captured > min(len(data), MAX_PACKET_LENGTH):
            self._rejects.add_one(BAD_HEADER, offset)
            return None
        interface = self._interfaces[number]
        time_us: int | None = None
        if units is not None:
            time_us = units * MICROSECONDS // interface.units_per_second + interface.offset_s * MICROSECONDS
            if not 0 <= time_us <= MAX_TIME_US:
                time_us = None
        return Packet(time_us, interface.link_type, data[:captured], offset)

    def _describe(self, body: bytes, offset: int) -> None:
        link_type, _, snap_length = self._unpack("HHI", body)
        units_per_second, offset_s = MICROSECONDS, 0
        at = 8
        while at + 4 <= len(body):
            code, length = self._unpack("HH", body, at)
            value = body[at + 4 : at + 4 + length]
            if code == OPTION_RESOLUTION and len(value) == 1:
                units_per_second = 2 ** (value[0] & 0x7F) if value[0] & 0x80 else 10 ** value[0]
            elif code == OPTION_OFFSET and len(value) == 8:
                (offset_s,) = self._unpack("q", value)
            at += 4 + -(-length // 4) * 4
        if len(self._interfaces) >= MAX_INTERFACES:
            self._rejects.add_one(TOO_MANY_INTERFACES, offset)
            return
        self._interfaces.append(_Interface(link_type, snap_length, units_per_second, offset_s))
