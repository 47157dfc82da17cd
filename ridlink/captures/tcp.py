"""MAVLink over TCP: finds the frames in the byte stream of each direction of a connection.

Packets are taken in the order of the capture. Repeated bytes are taken once. Missing or late bytes are a gap, which is
counted. The beginning of a direction decides whether it is MAVLink.

Source: https://www.rfc-editor.org/rfc/rfc9293
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from itertools import dropwhile
from typing import NamedTuple

from ridlink.captures.records import Origin, Rejects, TracedRecord
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import BadFrame, Frame, FrameParser

TCP_TRANSPORT = "tcp"
TCP_GAP = "tcp_gap"

JUDGED_BYTES = 1024
"""A stream without a valid frame in its first bytes, this many, is some other protocol."""

MOST_STREAMS = 1024
"""Streams kept at once; the one that has been silent longest is removed first."""

REACH = 1 << 24
"""A sequence number this far behind belongs to another connection, whose beginning was not captured."""

NUMBERS = 1 << 32

Direction = tuple[bytes, bytes, int, int]
"""Addresses and ports, of the sender first."""


class Segment(NamedTuple):
    """TCP segment of a packet.

    Attributes:
        direction: Addresses and ports of sender and receiver.
        sequence: Sequence number of its header.
        begins: Whether it opens the connection (SYN); its first byte then has the next number.
        payload: Its bytes.
    """

    direction: Direction
    sequence: int
    begins: bool
    payload: bytes


class _Stream:
    """One direction; `expected` is the sequence number of the next byte."""

    __slots__ = ("expected", "is_foreign", "is_ours", "parser", "place", "seen", "unjudged")

    def __init__(self, expected: int) -> None:
        self.expected, self.seen = expected, 0
        self.parser = FrameParser(CRC_EXTRAS)
        self.is_ours = self.is_foreign = False
        self.unjudged: list[Frame | BadFrame] = []
        self.place: tuple[int | None, int] = (None, 0)

    def judge(self, found: list[Frame | BadFrame]) -> list[Frame | BadFrame]:
        """The items found, once the stream is known to be MAVLink, without the incomplete frame at its beginning."""
        if self.is_ours:
            return found
        self.unjudged += found
        self.is_ours = any(isinstance(item, Frame) and item.checked for item in found)
        self.is_foreign = not self.is_ours and self.seen > JUDGED_BYTES
        if not (self.is_ours or self.is_foreign):
            return []
        frames = dropwhile(lambda item: isinstance(item, BadFrame), self.unjudged)
        self.unjudged = []
        return [*frames] if self.is_ours else []


class TcpStreams:
    """All connections of a capture.

    Args:
        rejects: Counts gaps and bytes that are no frame, in MAVLink streams only.
    """

    def __init__(self, rejects: Rejects) -> None:
        self._rejects = rejects
        self._streams: OrderedDict[Direction, _Stream] = OrderedDict()

    def records(self, segment: Segment, time_us: int | None, offset: int) -> Iterator[TracedRecord]:
        """Frames that a segment completes.

        Args:
            segment: The next one of the capture.
            time_us: Time of its packet, microseconds since 1970.
            offset: Byte of the file where its packet starts.
        """
        first = (segment.sequence + segment.begins) % NUMBERS
        stream = self._streams.get(segment.direction)
        ahead = 0 if stream is None else (first - stream.expected + NUMBERS // 2) % NUMBERS - NUMBERS // 2
        if stream is None or segment.begins or ahead < -REACH:
            if stream is not None:
                yield from self._cut(stream)
            stream, ahead = _Stream(first), 0
            self._streams[segment.direction] = stream
        self._streams.move_to_end(segment.direction)
        if len(self._streams) > MOST_STREAMS:
            yield from self._cut(self._streams.popitem(last=False)[1])
        payload = segment.payload[max(-ahead, 0) :]
        if stream.is_foreign or not payload:
            return
        if ahead > 0:
            yield from self._cut(stream)
            if stream.is_ours:
                self._rejects.add_one(TCP_GAP, offset)
        stream.expected = (first + len(segment.payload)) % NUMBERS
        stream.seen += len(payload)
        stream.place = time_us, offset
        yield from self._taken(stream, stream.parser.feed(payload))

    def finish(self) -> Iterator[TracedRecord]:
        """Frames in the bytes held back; call it at the end of the capture."""
        for stream in self._streams.values():
            yield from self._cut(stream)
        self._streams.clear()

    def _cut(self, stream: _Stream) -> Iterator[TracedRecord]:
        """Parse the bytes held back: the stream ends, or has a gap."""
        yield from self._taken(stream, stream.parser.flush())

    def _taken(self, stream: _Stream, found: list[Frame | BadFrame]) -> Iterator[TracedRecord]:
        time_us, offset = stream.place
        for item in stream.judge(found):
            if isinstance(item, Frame):
                yield TracedRecord(time_us, item, offset, Origin(TCP_TRANSPORT))
            else:
                self._rejects.add_one(item.cause, offset)
