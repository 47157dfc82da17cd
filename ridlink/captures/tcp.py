"""MAVLink over TCP: finds the frames in the byte stream of each direction of a connection.

Bytes are taken in the order of their sequence numbers, repeated ones once. What follows missing bytes waits for them,
but not for long: then they are a gap, which is counted. The beginning of a direction decides whether it is MAVLink.

Source: https://www.rfc-editor.org/rfc/rfc9293
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from heapq import heappop, heappush
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
"""A sequence number further away than this belongs to another connection, whose beginning was not captured."""

LONGEST_WAIT_US = 2_000_000
"""Time of the capture for which missing bytes are waited for, and up to another LOOK_US."""

LOOK_US = 1_000_000
"""Time of the capture between two looks for what has been missing too long."""

MOST_WAITING_BYTES = 4 << 20
"""What waits in all streams together, counted with SEGMENT_BYTES each; beyond that nothing waits."""

SEGMENT_BYTES = 256
"""Memory of a waiting segment beside its bytes."""

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


class _Piece(NamedTuple):
    """Bytes of a segment: their place in the stream, and the packet that brought them."""

    position: int
    offset: int
    time_us: int | None
    payload: bytes

    @property
    def cost(self) -> int:
        return len(self.payload) + SEGMENT_BYTES


class _Stream:
    """One direction.

    Attributes:
        begin, expected: Sequence numbers of its first and of its next byte; they go on where those of TCP wrap.
        waiting: Heap of pieces behind missing bytes.
        place: Offset and time of the packet that completed what has been parsed.
    """

    __slots__ = ("begin", "expected", "is_foreign", "is_ours", "parser", "place", "seen", "unjudged", "waiting")

    def __init__(self, begin: int) -> None:
        self.begin = self.expected = begin
        self.seen = 0
        self.parser = FrameParser(CRC_EXTRAS)
        self.is_ours = self.is_foreign = False
        self.unjudged: list[Frame | BadFrame] = []
        self.waiting: list[_Piece] = []
        self.place: tuple[int, int | None] = (-1, None)

    def ahead(self, sequence: int) -> int:
        """Distance of a sequence number from that of the next byte."""
        return (sequence - self.expected + NUMBERS // 2) % NUMBERS - NUMBERS // 2

    def is_overdue(self, now_us: int) -> bool:
        """Whether the missing bytes have been waited for long enough, and nothing else is parsed meanwhile."""
        since_us = max(self.waiting[0].time_us or 0, self.place[1] or 0)
        return abs(now_us - since_us) > LONGEST_WAIT_US

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

    Attributes:
        waiting_bytes: What waits behind missing bytes, with what a segment costs beside its bytes.
    """

    def __init__(self, rejects: Rejects) -> None:
        self._rejects = rejects
        self._streams: OrderedDict[Direction, _Stream] = OrderedDict()
        self.waiting_bytes = 0
        self._looked_us = 0

    def records(self, segment: Segment, time_us: int | None, offset: int) -> Iterator[TracedRecord]:
        """Frames that a segment completes.

        Args:
            segment: The next one of the capture.
            time_us: Time of its packet, microseconds since 1970.
            offset: Byte of the file where its packet starts.
        """
        if not (segment.payload or segment.begins):
            return
        first = (segment.sequence + segment.begins) % NUMBERS
        stream = self._streams.pop(segment.direction, None)
        if stream is not None:
            is_repeated = segment.begins and first == stream.begin
            if abs(stream.ahead(first)) > REACH or (segment.begins and not is_repeated):
                yield from self._end(stream)
                stream = None
        stream = stream or _Stream(first)
        self._streams[segment.direction] = stream
        if len(self._streams) > MOST_STREAMS:
            yield from self._end(self._streams.popitem(last=False)[1])
        if stream.is_foreign or not segment.payload:
            return
        piece = _Piece(stream.expected + stream.ahead(first), offset, time_us, segment.payload)
        heappush(stream.waiting, piece)
        self.waiting_bytes += piece.cost
        while stream.waiting and (
            stream.is_foreign
            or stream.waiting[0].position <= stream.expected
            or self.waiting_bytes > MOST_WAITING_BYTES
        ):
            yield from self._next(stream)

    def overdue(self, now_us: int | None) -> Iterator[TracedRecord]:
        """Frames behind bytes that are still missing, once these have been waited for long enough.

        Args:
            now_us: Time of the present packet of the capture; looked at once a second.
        """
        if now_us is None or abs(now_us - self._looked_us) < LOOK_US:
            return
        self._looked_us = now_us
        for stream in self._streams.values():
            while stream.waiting and stream.is_overdue(now_us):
                yield from self._next(stream)

    def finish(self) -> Iterator[TracedRecord]:
        """Frames in the bytes held back; call it at the end of the capture."""
        for stream in self._streams.values():
            yield from self._end(stream)
        self._streams.clear()

    def _end(self, stream: _Stream) -> Iterator[TracedRecord]:
        """Parse what waits, and the bytes held back: the stream ends."""
        while stream.waiting:
            yield from self._next(stream)
        yield from self._cut(stream)

    def _next(self, stream: _Stream) -> Iterator[TracedRecord]:
        """Parse the first of what waits; if bytes are missing before it, they are a gap."""
        piece = heappop(stream.waiting)
        self.waiting_bytes -= piece.cost
        ahead = piece.position - stream.expected
        payload = piece.payload[max(-ahead, 0) :]
        if stream.is_foreign or not payload:
            return
        if ahead > 0:
            yield from self._cut(stream)
            if stream.is_ours:
                self._rejects.add_one(TCP_GAP, piece.offset)
        stream.expected = piece.position + len(piece.payload)
        stream.seen += len(payload)
        stream.place = max(stream.place, (piece.offset, piece.time_us))
        yield from self._taken(stream, stream.parser.feed(payload))

    def _cut(self, stream: _Stream) -> Iterator[TracedRecord]:
        """Parse the bytes held back: the stream ends, or has a gap."""
        yield from self._taken(stream, stream.parser.flush())

    def _taken(self, stream: _Stream, found: list[Frame | BadFrame]) -> Iterator[TracedRecord]:
        offset, time_us = stream.place
        for item in stream.judge(found):
            if isinstance(item, Frame):
                yield TracedRecord(time_us, item, offset, Origin(TCP_TRANSPORT))
            else:
                self._rejects.add_one(item.cause, offset)
