"""Writes the datagrams of a link to a tlog in a thread of its own, so that a slow disk cannot delay the receiver.

Frames are written, other bytes are counted. If the disk is too slow and the queue is full, datagrams are dropped and
counted. A disk error ends the recording, not the flight.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable

from ridlink.captures.messages import UNKNOWN
from ridlink.captures.records import Rejects
from ridlink.captures.tlog import TlogWriter
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES
from ridlink.mavlink.frames import Frame, parse_datagram

QUEUE_LENGTH = 4096
"""Datagrams: about a second of the heaviest traffic that a daemon is designed for, half a megabyte."""

IDLE_S = 0.5
"""After this time without a datagram, collected records are written to the disk."""


def steady_clock() -> Callable[[], int]:
    """A clock of microseconds since 1970 that is set once and then never steps, even if the system clock does."""
    started_us = (time.time_ns() - time.monotonic_ns()) // 1000
    return lambda: started_us + time.monotonic_ns() // 1000


class Recorder:
    """Takes datagrams and writes their frames.

    `receive` never raises, since the link would only count the error: the error that ended the recording is kept
    instead.

    Args:
        path: The log.
        overwrite: Replace a log that exists; otherwise it is an error.
        clock: Returns the present time in microseconds since 1970; by default a steady clock.

    Attributes:
        types: Messages written, by name.
        sources: Messages written, by ``system/component``.
        rejects: What was not a frame; offsets count the bytes received.
        dropped: Datagrams that the disk was too slow for.
        error: The error that ended the recording, such as a full disk; None while it continues.

    Raises:
        OSError: If the file cannot be made, or exists.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, overwrite: bool = False, clock: Callable[[], int] | None = None
    ) -> None:
        self.types: Counter[str] = Counter()
        self.sources: Counter[str] = Counter()
        self.rejects = Rejects()
        self.dropped = 0
        self.error: OSError | None = None
        self._clock = clock or steady_clock()
        self._received_bytes = 0
        self._writer = TlogWriter(path, overwrite=overwrite)
        self._queue: queue.Queue[tuple[int, bytes] | None] = queue.Queue(QUEUE_LENGTH)
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def messages(self) -> int:
        """Messages written."""
        return self._writer.records

    @property
    def bytes_written(self) -> int:
        """Length of the log."""
        return self._writer.bytes_written

    def receive(self, data: bytes, _: object = None) -> None:
        """Queue one datagram; the second argument is only there to match the callback of a link."""
        if self.error is not None:
            return
        try:
            self._queue.put_nowait((self._clock(), data))
        except queue.Full:
            self.dropped += 1

    def close(self, longest_s: float | None = None) -> None:
        """Write what is queued, and end; do not wait longer for the disk than allowed.

        Args:
            longest_s: Longest wait; by default as long as it takes.
        """
        try:
            self._queue.put(None, timeout=longest_s)
        except queue.Full:
            return
        self._thread.join(longest_s)

    def _run(self) -> None:
        try:
            while True:
                try:
                    item = self._queue.get(timeout=IDLE_S)
                except queue.Empty:
                    self._writer.flush()
                    continue
                if item is None:
                    break
                self._write(*item)
            self._writer.close()
        except OSError as error:  # the writer has closed its file after the last complete record
            self.error = error
            while self._queue.get() is not None:  # make room for a thread that waits to put the end mark
                continue

    def _write(self, time_us: int, data: bytes) -> None:
        for item in parse_datagram(data, CRC_EXTRAS, limit=None):
            if not isinstance(item, Frame):
                self.rejects.add(item.cause, self._received_bytes + item.offset, item.length)
                continue
            self._writer.write(time_us, item.raw)
            spec = MESSAGES.get(item.msgid)
            self.types[spec.name if spec is not None else UNKNOWN] += 1
            self.sources[f"{item.sysid}/{item.compid}"] += 1
        self._received_bytes += len(data)
