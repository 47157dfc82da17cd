"""The .tlog format of ground stations: eight bytes of big-endian microseconds since 1970, then one frame, and so on.

Reading survives damage. While records follow each other without a gap, every frame with a right checksum is taken.
After damage, a record is searched at every byte. It must have a plausible time in front of a frame with a right
checksum, so that a frame inside the payload of another (a tunnel) is no record. A time is plausible within three days
of the last or of the next one, since one file may contain logs of different days.

Writing produces complete records only, in the order of time.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Self

from ridlink.captures.records import BAD_TIMESTAMP, Record, Rejects
from ridlink.files import open_at_once
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import (
    HEADER_LENGTH_V1,
    HEADER_LENGTH_V2,
    INCOMPAT_SIGNED,
    MAGIC_V1,
    MAGIC_V2,
    MAX_FRAME_LENGTH,
    SIGNATURE_LENGTH,
    Cause,
    Frame,
    parse_datagram,
)

TIME_LENGTH = 8
"""Bytes of the time before a frame."""
CHECKSUM_LENGTH = 2
MAX_TIME_US = 2**64 - 1
UNSET_TIME_US = MAX_TIME_US
"""Time written by a logger without a clock: all bits set."""

PLAUSIBLE_STEP_US = 3 * 24 * 3600 * 1_000_000
EARLIEST_TIME_US = 946_684_800_000_000  # 2000-01-01
LATEST_TIME_US = 4_102_444_800_000_000  # 2100-01-01

LOOKAHEAD = TIME_LENGTH + MAX_FRAME_LENGTH + TIME_LENGTH + 1
"""With this many bytes ahead, a record is judged as with the whole file ahead."""
_MAGIC = re.compile(b"[\xfd\xfe]")


def read_tlog(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Record]:
    """Records of a tlog in constant memory, for any chunk sizes and any bytes.

    Args:
        chunks: The file from its first byte.
        rejects: Counts damage; an incomplete tail is ``truncated``.
    """
    source = iter(chunks)
    data, base, at = b"", 0, 0
    ended, in_step = False, True
    reference_us: int | None = None
    while True:
        if not ended and len(data) - at < LOOKAHEAD and not _is_settled(data, at, reference_us):
            chunk = next(source, None)
            if chunk is None:
                ended = True
            else:
                data, base, at = data[at:] + chunk, base + at, 0
            continue
        if at >= len(data):
            return
        time_us = int.from_bytes(data[at : at + TIME_LENGTH], "big")
        near = _is_near(time_us, reference_us)
        found = _frame_after_time(data, at + TIME_LENGTH)
        plausible = False
        if isinstance(found, Frame):
            end = at + TIME_LENGTH + len(found.raw)
            plausible = near or _fits_what_follows(time_us, data[end : end + TIME_LENGTH], reference_us)
            if not found.checked and not _record_may_start(data, end, reference_us):
                found = Cause.UNKNOWN_UNCONFIRMED
            elif not plausible and not in_step:
                found = Cause.GARBAGE
        if isinstance(found, Frame):
            if plausible:
                reference_us = time_us
            else:  # position and checksum are right: only its time is damaged
                rejects.add(BAD_TIMESTAMP, base + at, TIME_LENGTH)
            yield Record(time_us if plausible and time_us != UNSET_TIME_US else None, found, base + at)
            at += TIME_LENGTH + len(found.raw)
            in_step = True
            continue
        if in_step or (near and found is not Cause.GARBAGE):
            rejects.add(found, base + at)
        in_step = False
        magic = _MAGIC.search(data, at + 1 + TIME_LENGTH)
        resume = magic.start() if magic else len(data)
        at = len(data) if ended and not magic else max(at + 1, resume - TIME_LENGTH)


def _is_settled(data: bytes, at: int, reference_us: int | None) -> bool:
    """Whether the record that starts here is taken whatever follows: the last record of a live log is not held back."""
    time_us = int.from_bytes(data[at : at + TIME_LENGTH], "big")
    if reference_us is None:
        plausible = EARLIEST_TIME_US <= time_us <= LATEST_TIME_US
    else:
        plausible = _is_near(time_us, reference_us)
    found = _frame_after_time(data, at + TIME_LENGTH) if plausible else None
    return isinstance(found, Frame) and found.checked


def _is_near(time_us: int, reference_us: int | None) -> bool:
    return reference_us is not None and abs(time_us - reference_us) <= PLAUSIBLE_STEP_US


def _frame_after_time(data: bytes, start: int) -> Frame | Cause:
    """The frame that starts at ``start``, or why there is none; a frame of unknown id is unchecked and unconfirmed."""
    if len(data) < start + HEADER_LENGTH_V1:
        return Cause.TRUNCATED
    if data[start] == MAGIC_V2:
        end = start + HEADER_LENGTH_V2 + data[start + 1] + CHECKSUM_LENGTH
        if data[start + 2] & INCOMPAT_SIGNED:
            end += SIGNATURE_LENGTH
    elif data[start] == MAGIC_V1:
        end = start + HEADER_LENGTH_V1 + data[start + 1] + CHECKSUM_LENGTH
    else:
        return Cause.GARBAGE
    if end > len(data):
        return Cause.TRUNCATED
    first = parse_datagram(data[start:end], CRC_EXTRAS, limit=1)[0]
    return first if isinstance(first, Frame) else first.cause


def _fits_what_follows(time_us: int, following: bytes, reference_us: int | None) -> bool:
    """Whether a time far from the last one is plausible: the next record agrees, or it is the first, of this
    century."""
    if len(following) == TIME_LENGTH and _is_near(time_us, int.from_bytes(following, "big")):
        return True
    if reference_us is not None:
        return False
    return EARLIEST_TIME_US <= time_us <= LATEST_TIME_US or not following


def _record_may_start(data: bytes, at: int, reference_us: int | None) -> bool:
    """Whether a plausible time and a magic byte follow here, or the end of the file."""
    if at == len(data):
        return True
    if at + TIME_LENGTH >= len(data) or data[at + TIME_LENGTH] not in (MAGIC_V1, MAGIC_V2):
        return False
    time_us = int.from_bytes(data[at : at + TIME_LENGTH], "big")
    return reference_us is None or _is_near(time_us, reference_us)


class TlogWriter:
    """Writes a tlog record by record.

    Records are collected and written together, after a second of log time or 32 KiB, whichever comes first. A process
    that dies loses no more than that; `flush` writes at once. If the file system refuses (disk full), the file is cut
    back to its last complete record before the error is raised.

    Args:
        path: The file.
        overwrite: Replace a file that exists; otherwise it is an error.

    Raises:
        OSError: If the file cannot be made, or exists.
    """

    FLUSH_INTERVAL_US = 1_000_000
    FLUSH_BYTES = 32 * 1024

    def __init__(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        self.path = Path(path)
        self.records = 0
        self.bytes_written = 0
        self._file = open_at_once(self.path, "wb" if overwrite else "xb", buffering=0)
        self._pending: list[bytes] = []
        self._pending_bytes = 0
        self._last_us = 0
        self._flushed_us = 0

    def write(self, time_us: int, frame: bytes) -> None:
        """Add one record.

        Args:
            time_us: Microseconds since 1970; a time before that of the last record is replaced by it, since readers
                expect order.
            frame: The frame as received.

        Raises:
            OSError: If the file system refuses; the writer is then closed.
            ValueError: If the writer is closed, or the time does not fit.
        """
        if self._file.closed:
            raise ValueError(f"{self.path} is closed")
        if not 0 <= time_us <= MAX_TIME_US:
            raise ValueError(f"time_us must be between 0 and 2**64 - 1, not {time_us}")
        self._last_us = max(time_us, self._last_us)
        self._pending.append(self._last_us.to_bytes(TIME_LENGTH, "big") + frame)
        self._pending_bytes += TIME_LENGTH + len(frame)
        self.records += 1
        if self._last_us - self._flushed_us >= self.FLUSH_INTERVAL_US or self._pending_bytes >= self.FLUSH_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the collected records.

        Raises:
            OSError: If the file system refuses; the writer is then closed.
        """
        if not self._pending:
            return
        data = b"".join(self._pending)
        written = 0
        try:
            while written < len(data):
                written += self._file.write(data[written:]) or 0
        except OSError as error:
            self._cut_back(written)
            error.filename = str(self.path)
            raise
        self.bytes_written += len(data)
        self._pending, self._pending_bytes, self._flushed_us = [], 0, self._last_us

    def _cut_back(self, written: int) -> None:
        """Close, keeping the complete records among the first ``written`` bytes of the collected ones."""
        complete = 0
        lost = len(self._pending)
        for record in self._pending:
            if complete + len(record) > written:
                break
            complete += len(record)
            lost -= 1
        self.records -= lost
        self.bytes_written += complete
        self._pending, self._pending_bytes = [], 0
        try:
            os.ftruncate(self._file.fileno(), self.bytes_written)
        except OSError:
            pass  # a device or pipe: nothing to cut
        finally:
            self._file.close()

    def close(self) -> None:
        """Write the collected records and close; may be called twice.

        Raises:
            OSError: If the file system refuses.
        """
        if not self._file.closed:
            self.flush()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
