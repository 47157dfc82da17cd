"""Packets of a file that is read from front to back, and the buffer through which pcap and pcapng are read.

No length in the file is used before it is checked, and only as many bytes are held as the next packet needs.

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
    """One packet: microseconds since 1970 or ``None``, link type, bytes, byte offset of its record in the file."""

    time_us: int | None
    link_type: int
    data: bytes
    offset: int


class Window:
    """A view of a stream that only moves forward. It holds no more than was requested, plus a chunk.

    Args:
        chunks: The stream from its first byte.
        rejects: Counts damage.

    Attributes:
        data, at: The bytes held, and the index in them where the view begins.
        ended: Whether all of the stream has been read.
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
        """Bytes available."""
        return len(self.data) - self.at

    @property
    def offset(self) -> int:
        """Byte offset in the stream where the view begins."""
        return self._base + self.at

    def reach(self, length: int) -> bool:
        """Make this many bytes available; ``False`` if the stream ends before."""
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
        """Available bytes, counted from where the view begins."""
        return self.data[self.at + start : self.at + end]

    def skip(self, length: int) -> None:
        """Move on."""
        self.at += length

    def refuse(self, length: int) -> None:
        """Skip damage, and count it."""
        self._rejects.add(BAD_HEADER, self.offset, length)
        self.skip(length)

    def refuse_rest(self) -> None:
        """Count the incomplete rest of a file that ends too early."""
        if self.left:
            self._rejects.add(Cause.TRUNCATED, self.offset, self.left)
