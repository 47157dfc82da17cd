"""The pcapng format: packets with their times and link types, in constant memory and despite any damage.

A block is taken if the lengths before and after it agree. After damage, the next such block is searched at every byte.
An incomplete tail is ``truncated``.

Source: https://datatracker.ietf.org/doc/draft-ietf-opsawg-pcapng/
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import NamedTuple

from ridlink.captures.packet_window import BAD_HEADER, MAX_PACKET_LENGTH, MICROSECONDS, Packet, Window
from ridlink.captures.records import Rejects

MAX_BLOCK_LENGTH = MAX_PACKET_LENGTH + 65_536
"""A packet and its options."""
MAX_INTERFACES = 1024
UNKNOWN_INTERFACE = "unknown_interface"
TOO_MANY_INTERFACES = "too_many_interfaces"
LARGEST_TIME_US = 2**63 - 1
"""What 64 bits with a sign hold; a packet of a later time has none."""

PCAPNG_MAGIC = b"\x0a\x0d\x0d\x0a"
INTERFACE, OLD_PACKET, SIMPLE_PACKET, ENHANCED_PACKET = 1, 2, 3, 6
MIN_BLOCK_LENGTH = 12
BYTE_ORDERS = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
OPTION_RESOLUTION, OPTION_OFFSET = 9, 14


class _Interface(NamedTuple):
    """Facts of an interface description that apply to its packets."""

    link_type: int
    snap_length: int
    units_per_second: int
    offset_s: int


class PcapngReader:
    """The block format: sections with interfaces and packets. Each block has its length before and after it."""

    def __init__(self, window: Window, rejects: Rejects) -> None:
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
        """All packets, in the order of the file; damage goes into the rejects."""
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
        window.refuse_rest()

    def _block_length(self, start: int) -> int | None:
        """Length of the block that starts at this distance; ``None`` if there is no whole block."""
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
        """Byte order, and the length that a block states; 0 if it is impossible."""
        order = BYTE_ORDERS.get(head[8:12], "") if head.startswith(PCAPNG_MAGIC) else self._order
        length: int = struct.unpack_from(order + "I", head, 4)[0]
        plausible = order and length % 4 == 0 and MIN_BLOCK_LENGTH <= length <= MAX_BLOCK_LENGTH
        return order, length if plausible else 0

    def _is_cut(self) -> bool:
        """Whether the file ends before the stated end of the block that starts here."""
        length = self._claim(self._window.peek(0, MIN_BLOCK_LENGTH))[1]
        return length > self._window.left and self._window.ended

    def _resynchronise(self, *, cut: bool) -> bool:
        """Continue at the next whole block; False if there is none.

        Args:
            cut: Whether all of the file is available; if there is no block, it stays available.
        """
        window, start = self._window, 1
        while True:
            seen = self._first_sight.search(window.data, window.at + start)
            if seen is not None:
                start = seen.start() - window.at
                if self._block_length(start) is not None:
                    window.refuse(start)
                    return True
                start += 1
                continue
            if cut:
                return False
            judged = max(start, window.left - 3)
            if not window.reach(window.left + 1):
                window.refuse(window.left)
                return False
            window.refuse(judged)
            start = 0

    def _take(self, block: bytes, offset: int) -> Packet | None:
        """Read a block; return its packet, if it has one."""
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
        except struct.error:  # shorter than its type requires
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
            if not 0 <= time_us <= LARGEST_TIME_US:
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
