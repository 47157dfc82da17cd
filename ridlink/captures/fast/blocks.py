"""Captures in blocks: a file is read a block at a time, and each block becomes an index of its frames.

All blocks share one buffer, so copy what you need of a block before you request the next one.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ridlink.captures.fast import loading, scanning, tables
from ridlink.captures.fast.block import SHORTEST_FRAME, Block, Index, block_of_records
from ridlink.captures.fast.calling import announce, plain
from ridlink.captures.fast.datagrams import read_blocks
from ridlink.captures.fast.sources import count_sources
from ridlink.captures.reader import STDIN, Capture, CaptureKind, open_capture
from ridlink.captures.records import Record
from ridlink.captures.statistics import SourceCount
from ridlink.captures.tlog import LOOKAHEAD, TIME_LENGTH
from ridlink.errors import CaptureError

BLOCK_LENGTH = 512 * 1024
RECORDS_PER_BLOCK = 8192
SCANNED = (CaptureKind.TLOG, CaptureKind.MAVLINK)
"""Formats whose files are scanned directly."""
KINDS = (*SCANNED, CaptureKind.PCAP)
"""Formats that are faster to read in blocks."""

_CARRIED = LOOKAHEAD + loading.MARGIN
_START = loading.MARGIN + _CARRIED


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
        self.sources: dict[tuple[int, int], SourceCount] = {}
        capture = open_capture(path, kind)
        self.name, self.kind, self.size, self.rejects = capture.name, capture.kind, capture.size, capture.rejects
        self._state = scanning.initial_state()
        self._sources = scanning.no_sources()
        self._capture: Capture | None = None
        if os.fspath(path) != STDIN and Path(path).is_file() and self.kind in SCANNED:
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
        if self._capture is None:
            yield from self._from_file()
            return
        for block in self._with_records(self.parts()):
            count_sources(self.sources, *block.heads())
            yield block

    def parts(self) -> Iterator[Block | list[Record]]:
        """The same, with the records of what is not read in blocks, as of broadcasts, where they stand.

        ``sources`` are not counted.
        """
        if self._capture is None:
            yield from self._from_file()
            return
        with self._capture as capture:
            for part in capture.read_with(read_blocks) if self.kind is CaptureKind.PCAP else _batches(capture):
                self.position = capture.position
                yield part
            self.position = capture.position

    def _with_records(self, parts: Iterator[Block | list[Record]]) -> Iterator[Block]:
        """Blocks of records too."""
        batch: list[Record] = []
        for part in parts:
            if isinstance(part, list):
                batch += part
                if len(batch) < RECORDS_PER_BLOCK:
                    continue
            if batch:
                yield block_of_records(batch, self.position)
                batch = []
            if isinstance(part, Block):
                yield part
        if batch:
            yield block_of_records(batch, self.position)

    def _from_file(self) -> Iterator[Block]:
        length = self._block_length
        data = np.zeros(_START + length + loading.MARGIN, np.uint8)
        view = data.data
        index = Index((length + _CARRIED) // SHORTEST_FRAME + 1)
        reference = np.zeros(1, np.uint64)
        state, is_tlog = self._state, self.kind is CaptureKind.TLOG
        scan = scanning.scan_tlog if is_tlog else scanning.scan_raw
        more = (reference,) if is_tlog else ()
        announce(scan)
        begin, read, frames = _START, 0, 0
        with open(self._path, "rb", buffering=0) as stream:
            while True:
                got = _read_into(stream, view[_START : _START + length], self.name)
                read += got
                n, final = _START + got, got < length
                base = read - n
                state[scanning.AT] = begin
                count = scan(
                    plain(data), n, base, final, *tables.for_scanning(), state, self._sources, index.starts,
                    index.slots, index.times, *more,
                )  # fmt: skip
                at = int(state[scanning.AT])
                self.position = base + at
                frames += count
                yield Block(data, base, index.starts, index.slots, index.times, count, base + at, TIME_LENGTH * is_tlog)
                if final:
                    break
                begin = _START - (n - at)
                data[begin:_START] = data[at:n]
        self._finish()
        if not frames:
            what = "is empty" if self.position == 0 else f"has no MAVLink frame ({self.kind})"
            raise CaptureError(f"{self.name} {what}")

    def _finish(self) -> None:
        counts = self._state[scanning.COUNTS : scanning.COUNTS + len(tables.CAUSES)].tolist()
        firsts = self._state[scanning.FIRST : scanning.FIRST + len(tables.CAUSES)].tolist()
        for first, cause, count in zip(firsts, tables.CAUSES, counts, strict=True):
            if count:
                self.rejects.counts[str(cause)] = count
                self.rejects.first_offset[str(cause)] = first
        seen = self._sources.reshape(-1, scanning.SOURCE_LENGTH)
        for key in np.flatnonzero(seen[:, scanning.MESSAGES]):
            messages, gaps, lost, last, leaps = map(int, seen[key])
            self.sources[int(key) >> 8, int(key) & 0xFF] = SourceCount(messages, gaps, lost, last - 1, leaps)


def _batches(capture: Capture) -> Iterator[list[Record]]:
    records = iter(capture)
    while batch := list(itertools.islice(records, RECORDS_PER_BLOCK)):
        yield batch


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
