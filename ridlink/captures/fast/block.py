"""The frames of one block of a capture: an index into its bytes, from which columns are gathered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from ridlink.captures.fast import copying, loading, tables
from ridlink.captures.fast.calling import plain
from ridlink.captures.fast.scanning import NO_TIME
from ridlink.captures.records import Record
from ridlink.mavlink.frames import (
    HEADER_LENGTH_V1,
    HEADER_LENGTH_V2,
    INCOMPAT_SIGNED,
    MAGIC_V2,
    SIGNATURE_LENGTH,
)

LONGER_BY_V1, LONGER_BY_V2 = HEADER_LENGTH_V1 + 2, HEADER_LENGTH_V2 + 2
"""Bytes of an unsigned frame beside its payload."""
SHORTEST_FRAME = LONGER_BY_V1


class Block:
    """The frames of one block, as an index into its bytes; valid until the next block is read.

    Attributes:
        count: Frames.
        times: Time of each frame in microseconds since 1970, `NO_TIME` where there is none.
        end: Byte of the file up to which it has been judged.
        slots: Slot of each frame, in the order of the file.
        transport: What carried all of them, ``None`` where the capture does not say.
    """

    def __init__(
        self, data: np.ndarray, base: int, starts: np.ndarray, slots: np.ndarray, times: np.ndarray, count: int,
        end: int, lead: int, offsets: np.ndarray | None = None, transport: str | None = None,
    ) -> None:  # fmt: skip
        self.count = count
        self.end = end
        self.slots = slots[:count]
        self.times = times[:count]
        self.transport = transport
        self._data = data
        self._starts = starts
        self._times = times
        self._base = base - lead  # a record of a tlog starts at its time
        self._offsets = offsets
        self._order = np.empty(count, np.int32)
        self._bounds = np.empty(len(tables.layouts()) + 1, np.int64)
        copying.group(slots, count, self._bounds, self._order)

    def present(self) -> list[tuple[int, int]]:
        """Slots that have frames here, and how many."""
        counts = np.diff(self._bounds)
        return [(int(slot), int(counts[slot])) for slot in np.flatnonzero(counts)]

    def entries(self, slot: int) -> np.ndarray:
        """Places of the frames of a slot among all of this block."""
        return self._order[self._bounds[slot] : self._bounds[slot + 1]]

    def heads(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sequence number, system id and component id of each frame, in the order of the file."""
        starts = self._starts[: self.count]
        seq_at = starts + np.where(self._data[starts] == MAGIC_V2, 4, 2)
        return self._data[seq_at], self._data[seq_at + 1], self._data[seq_at + 2]

    def sysids(self) -> np.ndarray:
        """System id of each frame, in the order of the file."""
        return self.heads()[1]

    def offset(self, entry: int) -> int:
        """Byte of the file where the record of a frame starts."""
        return int(self._base + self._starts[entry] if self._offsets is None else self._offsets[entry])

    def frame(self, entry: int) -> bytes:
        """The bytes of one frame."""
        return self._data[self._starts[entry] : self._ends[entry]].tobytes()

    @cached_property
    def _ends(self) -> np.ndarray:
        return frame_ends(self._data, self._starts[: self.count])

    def gather(self, slot: int, words: np.ndarray, row: int) -> int:
        """Write the frames of a slot into an array of words, from a row on; the row after them."""
        first, stop = int(self._bounds[slot]), int(self._bounds[slot + 1])
        layout = tables.layouts()[slot]
        copying.gather(
            plain(self._data), self._base, self._order, first, stop, self._starts, self._times, layout.size,
            layout.words, words, row,
        )  # fmt: skip
        if self._offsets is not None:
            words[row : row + stop - first, 1] = self._offsets[self.entries(slot)]
        return row + stop - first

    def columns(self, slot: int) -> np.ndarray:
        """The frames of a slot as a new structured array."""
        words = empty_words(slot, len(self.entries(slot)))
        self.gather(slot, words, 0)
        return structured(slot, words)


def empty_words(slot: int, rows: int) -> np.ndarray:
    """Room for records of a slot."""
    return np.empty((rows, tables.layouts()[slot].dtype.itemsize // 8), np.uint64)


def structured(slot: int, words: np.ndarray) -> np.ndarray:
    """The same memory as records of a slot."""
    return words.view(np.uint8).view(tables.layouts()[slot].dtype).reshape(-1)


def frame_ends(data: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Where frames end that start there."""
    version_2 = data[starts] == MAGIC_V2
    signature = np.where(version_2 & (data[starts + 2] & INCOMPAT_SIGNED != 0), SIGNATURE_LENGTH, 0)
    found: np.ndarray = starts + np.where(version_2, LONGER_BY_V2, LONGER_BY_V1) + data[starts + 1] + signature
    return found


class Index:
    """Room for the index of one block.

    Attributes:
        starts, slots, times: Of each frame.
    """

    def __init__(self, capacity: int) -> None:
        self.starts = np.empty(capacity, np.int32)
        self.slots = np.empty(capacity, np.int16)
        self.times = np.empty(capacity, np.uint64)


def with_margins(parts: Iterable[bytes]) -> np.ndarray:
    """Bytes one after the other, as the kernels want them."""
    margin = bytes(loading.MARGIN)
    return np.frombuffer(bytearray(b"".join((margin, *parts, margin))), np.uint8)


def block_of_records(records: Sequence[Record], end: int) -> Block:
    """The frames of records, which are read up to a byte of the file."""
    index = Index(len(records))
    start = loading.MARGIN
    slots = tables.slot_by_id()
    for entry, (time_us, frame, _) in enumerate(records):
        index.starts[entry] = start
        index.slots[entry] = slots.get(frame.msgid, 0)
        index.times[entry] = NO_TIME if time_us is None else time_us
        start += len(frame.raw)
    data = with_margins(record.frame.raw for record in records)
    offsets = np.array([record.offset for record in records], np.uint64)
    return Block(data, 0, index.starts, index.slots, index.times, len(records), end, 0, offsets)
