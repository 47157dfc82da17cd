"""A raw MAVLink stream, as it comes out of a serial port or a TCP connection: frames, and no times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ridlink.captures.records import Record, Rejects
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import BadFrame, Cause, Frame, FrameParser, parse_datagram


def read_raw(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Record]:
    """Records of a raw stream in constant memory, however it is cut into chunks and whatever the bytes are.

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
    """Frames and rejects of bytes that came alone, as a datagram or a line.

    What stands between a frame that was refused and the next good one is part of it.
    """
    refused = False
    for item in parse_datagram(data, CRC_EXTRAS, limit=None):
        if isinstance(item, Frame) or not (refused and item.cause is Cause.GARBAGE):
            yield item
        refused = isinstance(item, BadFrame)
