"""The classic pcap format: packets with their times and link type, in constant memory and despite any damage.

A record header must be plausible. If the next header is not, the true end of the record is searched within the record.
After damage, a header is searched at every byte, and must be followed by another one or by the end. An incomplete tail
is ``truncated``. A file header in the place of a record header (after ``cat`` of several files) applies from there on.

Source: https://datatracker.ietf.org/doc/draft-ietf-opsawg-pcap/
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator

from ridlink.captures.packet_window import MAX_PACKET_LENGTH, MICROSECONDS, Packet, Window

PLAUSIBLE_STEP_S = 3 * 24 * 3600
NANOSECONDS = 1_000_000_000
PCAP_MAGICS = {
    b"\xd4\xc3\xb2\xa1": ("<", MICROSECONDS),
    b"\xa1\xb2\xc3\xd4": (">", MICROSECONDS),
    b"\x4d\x3c\xb2\xa1": ("<", NANOSECONDS),
    b"\xa1\xb2\x3c\x4d": (">", NANOSECONDS),
}
"""Byte order, and units of a second."""
FILE_HEADER_LENGTH = 24
_FILE_HEADER = re.compile(
    b"|".join(re.escape(magic + struct.pack(order + "HHQ", 2, 4, 0)) for magic, (order, _) in PCAP_MAGICS.items())
)
"""Magic, version 2.4, and two fields that are always 0. A record header has the length of its packet there, which is
not 0."""
PACKET_HEADER_LENGTH = 16
LINK_TYPE_MASK = 0x03FFFFFF
"""The bits above say whether packets end with a checksum; the readers here tolerate one."""


class PcapReader:
    """The classic format: one header, then one record after the other.

    Args:
        window: Begins with a file header, whose magic and length have been checked.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self._begin()

    def _begin(self) -> None:
        """Read a file header."""
        window = self._window
        order, per_second = PCAP_MAGICS[window.peek(0, 4)]
        self._header = struct.Struct(order + "IIII")
        self._per_second = per_second
        self._link_type = struct.unpack(order + "I", window.peek(20, 24))[0] & LINK_TYPE_MASK
        # quick test for a header: fraction and captured length are small, and the length is not 0
        high = rb"[\x00-\x0f]" if per_second == MICROSECONDS else rb"[\x00-\x3b]"
        fraction, length = (high + rb"\x00", rb"[\x00-\x04]\x00")
        if per_second == NANOSECONDS:
            fraction = rb"." + high
        pattern = rb".{4}.." + fraction + rb".." + length
        if order == ">":
            fraction = rb"\x00" + high if per_second == MICROSECONDS else high + rb"."
            pattern = rb".{4}" + fraction + rb"..\x00[\x00-\x04].."
        record = rb"(?!.{8}\x00{4})(?=" + pattern + rb")"
        self._first_sight = re.compile(record + rb"|(?=" + _FILE_HEADER.pattern + rb")", re.DOTALL)
        self._last_s: int | None = None
        window.skip(FILE_HEADER_LENGTH)

    def packets(self) -> Iterator[Packet]:
        """All packets, in the order of the file; damage goes into the rejects of the window."""
        window = self._window
        while window.reach(PACKET_HEADER_LENGTH):
            length = self._record_length(0)
            if length is None and self._is_file(0):
                self._begin()
                continue
            if length is None or self._ends_within(length) or self._is_of_another_time(length):
                self._resynchronise()
                continue
            if window.left < length:
                break
            seconds, fraction, _, _ = self._header.unpack(window.peek(0, PACKET_HEADER_LENGTH))
            self._last_s = seconds
            time_us = seconds * MICROSECONDS + fraction * MICROSECONDS // self._per_second
            yield Packet(time_us, self._link_type, window.peek(PACKET_HEADER_LENGTH, length), window.offset)
            window.skip(length)
        window.refuse_rest()

    def _record_length(self, start: int) -> int | None:
        """Length of the record that starts at this distance, ``None`` if its header is not plausible."""
        header = self._window.peek(start, start + PACKET_HEADER_LENGTH)
        if len(header) < PACKET_HEADER_LENGTH:
            return None
        _, fraction, captured, original = self._header.unpack(header)
        if fraction >= self._per_second or not 0 < captured <= original <= MAX_PACKET_LENGTH:
            return None
        return PACKET_HEADER_LENGTH + int(captured)

    def _is_file(self, start: int) -> bool:
        """Whether another file begins at this distance."""
        window = self._window
        return (
            window.reach(start + FILE_HEADER_LENGTH) and _FILE_HEADER.match(window.data, window.at + start) is not None
        )

    def _goes_on(self, start: int) -> bool:
        """Whether a record or another file begins at this distance."""
        return self._record_length(start) is not None or self._is_file(start)

    def _ends_within(self, length: int) -> bool:
        """Whether the record ends before its stated length: no header follows, but there is one within it."""
        window = self._window
        window.reach(length + PACKET_HEADER_LENGTH)
        follows = window.left - length
        if follows >= 0 and (follows < PACKET_HEADER_LENGTH or self._goes_on(length)):
            return False
        return self._find_record(PACKET_HEADER_LENGTH, length) is not None

    def _is_of_another_time(self, length: int) -> bool:
        """Whether its time is far from that of the record before, and within it there is a record whose time is near.

        If four bytes are missing, the fraction is read as the seconds, and both lengths are plausible.
        """
        return not self._is_near(0, self._last_s) and self._find_record(1, length) is not None

    def _find_record(self, start: int, end: int) -> int | None:
        """First position in a range where another file starts, or a record that a record, a file or the end follows."""
        window = self._window
        while True:
            seen = self._first_sight.search(window.data, window.at + start, window.at + end + PACKET_HEADER_LENGTH)
            if seen is None:
                return None
            start = seen.start() - window.at
            if start >= end:
                return None
            if self._is_record(start) or self._is_file(start):
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
        if self._record_length(start + length) is None:
            return self._is_file(start + length)
        return self._is_near(start + length, seconds)

    def _is_near(self, start: int, reference_s: int | None) -> bool:
        seconds = self._header.unpack(self._window.peek(start, start + PACKET_HEADER_LENGTH))[0]
        return reference_s is None or abs(seconds - reference_s) <= PLAUSIBLE_STEP_S

    def _resynchronise(self) -> None:
        """Continue at the next record, one byte from here at the earliest; at the end if there is none."""
        window, start = self._window, 1
        while True:
            judged = max(start, window.left - PACKET_HEADER_LENGTH + 1)
            found = self._find_record(start, judged)
            if found is not None:
                window.refuse(found)
                return
            if not window.reach(judged + PACKET_HEADER_LENGTH):  # the window may have grown during the search
                window.refuse(window.left)
                return
            window.refuse(judged)
            start = 0
