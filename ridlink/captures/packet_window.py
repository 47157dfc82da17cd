"""Packets of a file that is read from front to back, and the window through which its formats are read.

No length that stands in the file is believed before it is checked, and no more is held than what it takes to judge the
next packet.

Source: https://datatracker.ietf.org/doc/draft-ietf-opsawg-pcap/ and .../draft-ietf-opsawg-pcapng/
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ridlink.captures.records import Rejects
from ridlink.mavlink.frames import Cause

MAX_PACKET_LENGTH = 262_144
BAD_HEADER = "bad_packet_header"
MICROSECONDS = 1_000_000


class Packet(NamedTuple):
    """One packet: microseconds since 1970 or ``None``, link type, bytes, byte of the file where its record starts."""

    time_us: int | None
    link_type: int
    data: bytes
    offset: int


class Window:
    """A view on a stream that moves forwards only and holds no more than it is asked for, and a chunk.

    Args:
        chunks: The stream from its first byte.
        rejects: Counts what is damaged.

    Attributes:
        data, at: What is held, and where in it the view begins.
        ended: All of the stream has been taken.
    """

    def __init__(self, chunks: Iterable[bytes], rejects: Rejects) -> None:
        self._chunks = iter(chunks)
        self._rejects = rejects
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

    def refuse(self, length: int) -> None:
        """Move on over damage, and count it."""
        self._rejects.add(BAD_HEADER, self.offset, length)
        self.skip(length)

    def refuse_rest(self) -> None:
        """Count what a file that ends too early leaves."""
        if self.left:
            self._rejects.add(Cause.TRUNCATED, self.offset, self.left)
