"""The Remote ID of recordings, and the telemetry of vehicles, in the order of time.

Everything else in a file is skipped, in large files by compiled loops. Several files, such as the logs of several
vehicles of one flight, are merged into one stream; frames that are in more than one of them are taken once.
"""

from __future__ import annotations

import heapq
from collections import OrderedDict
from collections.abc import Callable, Container, Iterator, Sequence

import numpy as np

from ridlink.captures import Capture, CaptureKind, Rejects, open_capture
from ridlink.captures.fast import tables
from ridlink.captures.fast.blocks import BlockReader
from ridlink.captures.fast.scanning import NO_TIME
from ridlink.captures.reader import is_large
from ridlink.errors import CaptureError
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.bridge import REMOTE_ID_IDS
from ridlink.review.own import TELEMETRY_IDS

WANTED_IDS = REMOTE_ID_IDS | TELEMETRY_IDS

TIMELESS = (CaptureKind.MAVLINK, CaptureKind.HEX)
REMEMBERED = 8192
SAME_FRAME_US = 5_000_000

Timed = tuple[int, Frame]


class Source:
    """One recording; iterate over it once.

    Args:
        path: File, or ``-`` for standard input.
        kind: Format, as `ridlink.captures.open_capture` takes it.

    Attributes:
        name: Name to show.
        size, position: Bytes in all, None if unknown, and bytes read.
        rejects: Damage by cause.
        error: The error that ended reading before the end of the file; or that none of its frames has a time.
        needless: Called for the system ids whose telemetry is not needed at that time.
        on_progress: Called with the source and the number of new frames; for a large file once a block.

    Raises:
        CaptureError: If the file is no readable capture, or one without times.
        OSError: If it cannot be read.
    """

    def __init__(self, path: str, kind: str = "auto") -> None:
        self.error: CaptureError | OSError | None = None
        self.needless: Callable[[], Container[int]] = tuple
        self._reader = _open(path, kind)
        self.name = self._reader.name
        self.size = self._reader.size
        self.on_progress: Callable[[Source, int], None] = lambda source, frames: None
        if self._reader.kind in TIMELESS:
            if isinstance(self._reader, Capture):
                self._reader.close()
            raise CaptureError(
                f"{self.name} has no times ({self._reader.kind}), and encounters need them: tlog, pcap and pcapng do"
            )

    @property
    def position(self) -> int:
        """Bytes read."""
        return self._reader.position

    @property
    def rejects(self) -> Rejects:
        """Damage by cause."""
        return self._reader.rejects

    def __iter__(self) -> Iterator[Timed]:
        """Needed frames with microseconds since 1970; a frame without a time gets that of the one before."""
        last_us, latest_us = 0, -1
        try:
            for time_us, frame in self._frames():
                last_us = last_us if time_us is None else time_us
                if last_us and frame is not None:
                    yield last_us, frame
                latest_us = max(latest_us, last_us)
            if latest_us == 0:
                raise CaptureError(f"{self.name}: none of its messages has a time, and encounters need them")
        except (CaptureError, OSError) as error:
            self.error = error

    def _frames(self) -> Iterator[tuple[int | None, Frame | None]]:
        if isinstance(self._reader, BlockReader):
            return _of_blocks(self._reader, self._progress, self.needless)
        return _of_records(self._reader, self._progress)

    def _progress(self, frames: int) -> None:
        self.on_progress(self, frames)


def together(sources: Sequence[Source]) -> Iterator[Timed]:
    """Frames of all sources in the order of time; the same bytes again within five seconds are skipped."""
    merged = iter(sources[0]) if len(sources) == 1 else heapq.merge(*sources, key=lambda timed: timed[0])
    heard: OrderedDict[bytes, int] = OrderedDict()
    for time_us, frame in merged:
        last_us = heard.get(frame.raw)
        if last_us is not None and abs(time_us - last_us) < SAME_FRAME_US:
            continue
        heard[frame.raw] = time_us
        heard.move_to_end(frame.raw)
        if len(heard) > REMEMBERED:
            heard.popitem(last=False)
        yield time_us, frame


def _open(path: str, kind: str) -> Capture | BlockReader:
    if is_large(path):
        return BlockReader(path, kind)
    return open_capture(path, kind)


def _of_records(capture: Capture, progress: Callable[[int], None]) -> Iterator[tuple[int | None, Frame | None]]:
    with capture:
        for time_us, frame, _ in capture:
            progress(1)
            yield time_us, frame if frame.msgid in WANTED_IDS else None


def _of_blocks(
    reader: BlockReader, progress: Callable[[int], None], needless: Callable[[], Container[int]]
) -> Iterator[tuple[int | None, Frame | None]]:
    wanted, telemetry = (
        np.array([layout.spec is not None and layout.spec.msgid in ids for layout in tables.layouts()], np.bool_)
        for ids in (WANTED_IDS, TELEMETRY_IDS)
    )
    for block in reader:
        progress(block.count)
        times, sysids, is_telemetry = block.times.tolist(), block.sysids().tolist(), telemetry[block.slots].tolist()
        for entry in np.flatnonzero(wanted[block.slots]).tolist():
            if is_telemetry[entry] and sysids[entry] in needless():
                continue
            [frame] = parse_datagram(block.frame(entry), CRC_EXTRAS, limit=1)
            if isinstance(frame, Frame):
                yield None if times[entry] == NO_TIME else times[entry], frame
