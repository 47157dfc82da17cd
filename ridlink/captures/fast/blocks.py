"""Captures in blocks: a file is read a block at a time, and each block becomes an index of its frames.

Every block lies in the same buffer, so what is wanted of it is gathered before the next one is asked for.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numba import config

from ridlink.captures.fast import copying, loading, scanning, tables
from ridlink.captures.reader import STDIN, Capture, CaptureKind, open_capture
from ridlink.captures.records import Record, Rejects
from ridlink.captures.statistics import SourceCount
from ridlink.compiled import is_compiled
from ridlink.errors import CaptureError
from ridlink.mavlink.frames import MAGIC_V2

BLOCK_LENGTH = 512 * 1024
RECORDS_PER_BLOCK = 8192
SHORTEST_FRAME = 8
KINDS = (CaptureKind.TLOG, CaptureKind.MAVLINK)

_CARRIED = scanning.LOOKAHEAD + loading.MARGIN
_START = loading.MARGIN + _CARRIED


class Block:
    """The frames of one block, as an index into its bytes; valid until the next block is read.

    Attributes:
        count: Frames.
        times: Time of each frame in microseconds since 1970, all bits set where there is none.
        end: Byte of the file up to which it has been judged.
        slots: Slot of each frame, in the order of the file.
    """

    def __init__(
        self, data: np.ndarray, base: int, starts: np.ndarray, slots: np.ndarray, times: np.ndarray, count: int,
        end: int, lead: int, offsets: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.count = count
        self.end = end
        self.slots = slots[:count]
        self.times = times[:count]
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
        start = int(self._starts[entry])
        version_2 = self._data[start] == MAGIC_V2
        length = int(self._data[start + 1]) + (12 if version_2 else 8)
        if version_2 and self._data[start + 2] & 1:
            length += 13
        return self._data[start : start + length].tobytes()

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


class BlockReader:
    """Reads a capture as blocks; iterate once, then look at ``rejects`` and ``sources``.

    Attributes:
        name: Name of the capture as it is shown.
        kind: Its format.
        size: Its length in bytes, ``None`` where it is not known.
        position: Bytes judged so far.
        rejects: Damage, complete when the last block has been read.
        sources: Messages and sequence gaps by system and component id, likewise.

    Raises:
        CaptureError: If it is empty or no capture that is read.
        OSError: If it cannot be read.
        ValueError: If the kind is unknown.
    """

    def __init__(self, path: str | os.PathLike[str], kind: str = "auto", *, block_length: int = BLOCK_LENGTH) -> None:
        self.position = 0
        self._block_length = block_length
        self.rejects = Rejects()
        self.sources: dict[tuple[int, int], SourceCount] = {}
        capture = open_capture(path, kind)
        self.name, self.kind, self.size = capture.name, capture.kind, capture.size
        self._state = np.zeros(scanning.STATE_LENGTH, np.int64)
        self._state[scanning.LAST_CAUSE] = self._state[scanning.LAST_END] = -1
        self._state[scanning.IN_STEP] = 1
        self._sources = np.zeros(65536 * scanning.SOURCE_LENGTH, np.int64)
        self._capture: Capture | None = None
        if os.fspath(path) != STDIN and Path(path).is_file() and self.kind in KINDS:
            self._path = path
            capture.close()
        else:
            self._capture = capture

    def __iter__(self) -> Iterator[Block]:
        """Blocks in the order of the file.

        Raises:
            CaptureError: At the end, if there was no frame.
            OSError: If the file cannot be read any further.
        """
        frames = 0
        for block in self._from_records(self._capture) if self._capture is not None else self._from_file():
            frames += block.count
            yield block
        if not frames:
            what = "is empty" if self.position == 0 else f"has no MAVLink frame ({self.kind})"
            raise CaptureError(f"{self.name} {what}")

    def _from_file(self) -> Iterator[Block]:
        length = self._block_length
        data = np.zeros(_START + length + loading.MARGIN, np.uint8)
        view = data.data
        index = _Index((length + _CARRIED) // SHORTEST_FRAME + 1)
        reference = np.zeros(1, np.uint64)
        state, is_tlog = self._state, self.kind is CaptureKind.TLOG
        scan = scanning.scan_tlog if is_tlog else scanning.scan_raw
        more = (reference,) if is_tlog else ()
        announce(scan)
        arguments = tuple(map(plain, (tables.id_table(), tables.checksum_table(), tables.initial_table())))
        begin, read = _START, 0
        with open(self._path, "rb", buffering=0) as stream:
            while True:
                got = _read_into(stream, view[_START : _START + length], self.name)
                read += got
                n, final = _START + got, got < length
                base = read - n
                state[scanning.AT] = begin
                count = scan(
                    plain(data), n, base, final, *arguments, state, self._sources, index.starts, index.slots,
                    index.times, *more,
                )  # fmt: skip
                at = int(state[scanning.AT])
                self.position = base + at
                yield Block(data, base, index.starts, index.slots, index.times, count, base + at, 8 * is_tlog)
                if final:
                    break
                begin = _START - (n - at)
                data[begin:_START] = data[at:n]
        self._finish()

    def _finish(self) -> None:
        counts = self._state[scanning.COUNTS : scanning.COUNTS + len(tables.CAUSES)].tolist()
        firsts = self._state[scanning.FIRST : scanning.FIRST + len(tables.CAUSES)].tolist()
        for first, cause, count in sorted(zip(firsts, tables.CAUSES, counts, strict=True)):
            if count:  # in the order in which they were met
                self.rejects.counts[str(cause)] = count
                self.rejects.first_offset[str(cause)] = first
        seen = self._sources.reshape(-1, scanning.SOURCE_LENGTH)
        for key in np.flatnonzero(seen[:, scanning.MESSAGES]):
            messages, gaps, lost, last = map(int, seen[key])
            self.sources[int(key) >> 8, int(key) & 0xFF] = SourceCount(messages, gaps, lost, last - 1)

    def _from_records(self, capture: Capture) -> Iterator[Block]:
        """Blocks of what the readers of records give: formats without a scan of their own, and standard input."""
        self.rejects = capture.rejects
        slot_by_id = {layout.spec.msgid: slot for slot, layout in enumerate(tables.layouts()) if layout.spec}
        batch: list[Record] = []
        with capture:
            for record in capture:
                source = self.sources.setdefault((record.frame.sysid, record.frame.compid), SourceCount())
                source.see(record.frame.seq)
                batch.append(record)
                if len(batch) == RECORDS_PER_BLOCK:
                    self.position = capture.position
                    yield _block_of(batch, slot_by_id, self.position)
                    batch = []
        self.position = capture.position
        if batch:
            yield _block_of(batch, slot_by_id, self.position)


class _Index:
    """Room for the index of one block."""

    def __init__(self, capacity: int) -> None:
        self.starts = np.empty(capacity, np.int32)
        self.slots = np.empty(capacity, np.int16)
        self.times = np.empty(capacity, np.uint64)


def _block_of(batch: Iterable[Record], slot_by_id: dict[int, int], end: int) -> Block:
    records = list(batch)
    index = _Index(len(records))
    start = loading.MARGIN
    for entry, (time_us, frame, _) in enumerate(records):
        index.starts[entry] = start
        index.slots[entry] = slot_by_id.get(frame.msgid, 0)
        index.times[entry] = 2**64 - 1 if time_us is None else time_us
        start += len(frame.raw)
    margin = bytes(loading.MARGIN)
    data = np.frombuffer(bytearray(b"".join((margin, *(record.frame.raw for record in records), margin))), np.uint8)
    offsets = np.array([record.offset for record in records], np.uint64)
    return Block(data, 0, index.starts, index.slots, index.times, len(records), end, 0, offsets)


def _read_into(stream: Any, view: memoryview, name: str) -> int:
    """Fill a view, as far as the file goes; bytes read."""
    got = 0
    try:
        while got < len(view) and (more := stream.readinto(view[got:])):
            got += more
    except OSError as error:
        error.filename = error.filename or name
        raise
    return got


def plain(array: np.ndarray) -> Any:
    """What a kernel is given: the array, or without a compiler what gives plain integers."""
    if not config.DISABLE_JIT:
        return array
    return array.data if array.dtype == np.uint8 else array.tolist()


def announce(kernel: Any, what: str = "the decoder") -> None:
    """Say that the compiler runs, before it is waited for."""
    if not is_compiled(kernel):
        sys.stderr.write(f"ridlink: compiling {what} (once, a few seconds) ...\n")
        sys.stderr.flush()
