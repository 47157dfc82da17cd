"""A raw MAVLink stream, as received from a serial port or a TCP connection: frames without times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ridlink.captures.records import Record, Rejects
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import BadFrame, Cause, Frame, FrameParser, parse_datagram


def read_raw(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Record]:
    """Records of a raw stream in constant memory, for any chunk sizes and any bytes.

    Args:
        chunks: The stream from its first byte.
        rejects: Counts what is not a frame.
    """
    parser = FrameParser(CRC_EXTRAS)
    for chunk in chunks:
        yield from _taken(parser.feed(chunk), rejects)
    yield from _taken(parser.flush(), rejects)


def _taken(found: list[Frame | BadFrame], rejects: Rejects) -> Iterator[Record]:
    for item in found:
        if isinstance(item, Frame):
            yield Record(None, item, item.offset)
        else:
            rejects.add(item.cause, item.offset, item.length)


def parse_alone(data: bytes) -> Iterator[Frame | BadFrame]:
    """Frames and rejects of one datagram or line.

    Bytes between a refused frame and the next good one count as part of the refused frame.
    """
    refused = False
    for item in parse_datagram(data, CRC_EXTRAS, limit=None):
        if isinstance(item, Frame) or not (refused and item.cause is Cause.GARBAGE):
            yield item
        refused = isinstance(item, BadFrame)
