"""Captures as columns: one structured array for each message, a hundred times as fast as message by message.

Columns have the names and units of the XML (`units` says which), after ``t_us, sysid, compid, seq, offset``:
microseconds since 1970 (-1 if there is no time), sender, sequence number, and the byte offset of the record in the
file. A field that is itself called ``seq`` is the column ``seq_field``. Messages that are not in the dialect are in
``UNKNOWN``, with ``msgid``, ``length`` and the raw ``payload``.

The same records are taken and refused as in `ridlink.captures.open_capture`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator

import numpy as np

from ridlink.captures.fast import copying, loading, tables
from ridlink.captures.fast.block import empty_words, structured
from ridlink.captures.fast.blocks import BlockReader
from ridlink.captures.fast.calling import announce, plain
from ridlink.captures.records import Rejects
from ridlink.captures.statistics import SourceCount
from ridlink.captures.tlog import TIME_LENGTH
from ridlink.errors import UnknownMessageError
from ridlink.mavlink.codec import message_spec

NO_TIME_US = -1
"""``t_us`` of a message without a time."""

MAX_OVERHEAD = 12
"""Bytes of an unsigned MAVLink 2 frame beside its payload."""

GROWTH = 1.5
HEADROOM = 1.05


class Columns(dict[str, np.ndarray]):
    """Structured arrays by message name, in the order of message ids; plus counts of damage and of senders.

    Attributes:
        rejects: Damage by cause.
        sources: Messages, gaps and lost messages by system and component id.
    """

    def __init__(self, rejects: Rejects, sources: dict[tuple[int, int], SourceCount]) -> None:
        super().__init__()
        self.rejects = rejects
        self.sources = sources


def units(name: str) -> dict[str, str]:
    """Units of the fields of a message, as in the XML.

    Raises:
        UnknownMessageError: If the dialect has no such message.
    """
    return {tables.column_of(field): unit for field, unit in message_spec(name).units.items()}


def decode(path: str | os.PathLike[str], types: Iterable[str] | None = None, *, kind: str = "auto") -> Columns:
    """All messages of a capture.

    All of them are in memory at once: 24 bytes and the full payload for each, which is 1.2 times the size of a tlog of
    Remote ID (620 MB for 9 million messages in 510 MB), plus 170 MB for the interpreter and the compiler. `iter_blocks`
    takes 200 MB for any size.

    Args:
        path: File, or ``-`` for standard input.
        types: Names of messages to take; ``None`` for all.
        kind: Format, as `ridlink.captures.open_capture` takes it.

    Returns:
        Structured arrays by message name, only for messages that occur.

    Raises:
        CaptureError: If it is not a supported capture.
        OSError: If it cannot be read.
        UnknownMessageError: If the dialect has no such message.
    """
    wanted = _wanted_slots(types)
    reader = BlockReader(path, kind)
    buffers: dict[int, np.ndarray] = {}
    rows: dict[int, int] = {}
    for block in reader:
        for slot, count in block.present():
            if wanted is not None and slot not in wanted:
                continue
            row = rows.get(slot, 0)
            buffer = buffers.get(slot)
            if buffer is None or row + count > len(buffer):
                # room for the rest of the file, estimated from the rate so far: untouched pages cost nothing
                share = HEADROOM * reader.size / block.end if reader.size else GROWTH
                room = max(int((row + count) * max(share, 1.0)), int(GROWTH * row)) + 16
                larger = empty_words(slot, room)
                if buffer is not None:
                    larger[:row] = buffer[:row]
                buffers[slot] = buffer = larger
            rows[slot] = block.gather(slot, buffer, row)
    columns = Columns(reader.rejects, reader.sources)
    for slot in sorted(buffers):
        columns[tables.layouts()[slot].name] = structured(slot, buffers[slot][: rows[slot]])
    return columns


def iter_blocks(
    path: str | os.PathLike[str], types: Iterable[str] | None = None, *, kind: str = "auto"
) -> Iterator[dict[str, np.ndarray]]:
    """The messages of a capture piece by piece, in constant memory.

    Args:
        path: File, or ``-`` for standard input.
        types: Names of messages to take; ``None`` for all.
        kind: Format, as `ridlink.captures.open_capture` takes it.

    Yields:
        Structured arrays by message name, of half a megabyte of the file at a time.

    Raises:
        CaptureError: If it is not a supported capture.
        OSError: If it cannot be read.
        UnknownMessageError: If the dialect has no such message.
    """
    wanted = _wanted_slots(types)
    for block in BlockReader(path, kind):
        yield {
            tables.layouts()[slot].name: block.columns(slot)
            for slot, _ in block.present()
            if wanted is None or slot in wanted
        }


def zeros(name: str, count: int) -> np.ndarray:
    """Records of a message with all fields zero, to be filled in and passed to `encode`.

    Raises:
        UnknownMessageError: If the dialect has no such message.
    """
    slot = tables.slot_of()[message_spec(name).name]
    return np.zeros(count, tables.layouts()[slot].dtype)


def encode(name: str, rows: np.ndarray, *, timed: bool = False) -> bytes:
    """Records of one message as MAVLink 2 frames, one after the other; the inverse of `decode`.

    Args:
        name: The message.
        rows: Records as `decode` and `zeros` give them; ``seq, sysid, compid`` are used unchanged.
        timed: Put ``t_us`` in front of each frame: records of a tlog.

    Raises:
        UnknownMessageError: If the dialect has no such message.
        ValueError: If the records are those of another message.
    """
    spec = message_spec(name)
    layout = tables.layouts()[tables.slot_of()[name]]
    if rows.dtype.names != layout.dtype.names:
        raise ValueError(f"these are not records of {name}")
    packed = np.ascontiguousarray(rows, layout.dtype)  # arrays that numpy concatenated may have another memory layout
    words = (
        packed.view(np.uint8).reshape(len(packed), -1) if len(packed) else np.empty((0, layout.dtype.itemsize), "u1")
    )
    longest = TIME_LENGTH * timed + MAX_OVERHEAD + layout.size
    out = np.empty(loading.MARGIN + len(packed) * longest + loading.MARGIN, np.uint8)
    announce(copying.pack)
    end = copying.pack(
        words, spec.msgid, layout.size, spec.crc_extra, plain(tables.checksum_table()), plain(tables.initial_table()),
        timed, out, loading.MARGIN,
    )  # fmt: skip
    return out[loading.MARGIN : end].tobytes()


def _wanted_slots(types: Iterable[str] | None) -> frozenset[int] | None:
    if types is None:
        return None
    names = (types,) if isinstance(types, str) else tuple(types)
    unknown = next((name for name in names if name not in tables.slot_of()), None)
    if unknown is not None:
        raise UnknownMessageError(unknown, tables.slot_of())
    return frozenset(tables.slot_of()[name] for name in names)
