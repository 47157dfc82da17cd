"""The flight recording: everything received and sent, written by a thread so that no disk can delay a setpoint.

What the disk cannot take within its queue is dropped and counted; a disk that refuses ends the recording, not the
flight.
"""

from __future__ import annotations

import queue
import threading
from collections import Counter
from pathlib import Path

from ridlink.captures.tlog import TlogWriter
from ridlink.errors import LinkError
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram

QUEUE_LENGTH = 4096
"""About a second of the heaviest traffic that a daemon is made for, half a megabyte."""

LONGEST_WAIT_S = 1.0


class Recorder:
    """Writes a .tlog.

    Args:
        path: The file; one that exists is replaced.

    Attributes:
        counters: `recording_dropped` datagrams, `recording_failed`.
        failure: Why the recording ended early; empty while it goes on.

    Raises:
        LinkError: If the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._writer = TlogWriter(path, overwrite=True)
        except OSError as error:
            raise LinkError(f"log {path}: {error.strerror or error}") from error
        self.counters: Counter[str] = Counter()
        self.failure = ""
        self._queue: queue.Queue[tuple[int, bytes] | None] = queue.Queue(QUEUE_LENGTH)
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def record(self, time_us: int, datagram: bytes) -> None:
        """Add a datagram, which may hold several frames.

        Args:
            time_us: Microseconds since 1970.
            datagram: Bytes.
        """
        if self.failure:
            return
        try:
            self._queue.put_nowait((time_us, datagram))
        except queue.Full:
            self.counters["recording_dropped"] += 1

    def _run(self) -> None:
        try:
            while (item := self._queue.get()) is not None:
                time_us, datagram = item
                for found in parse_datagram(datagram, CRC_EXTRAS):
                    if isinstance(found, Frame):
                        self._writer.write(time_us, found.raw)
            self._writer.close()
        except OSError as error:  # the writer has closed its file behind the last complete record
            self.failure = str(error)
            self.counters["recording_failed"] += 1

    def close(self) -> None:
        """Write what is queued, for a second at most."""
        try:
            self._queue.put(None, timeout=LONGEST_WAIT_S)
        except queue.Full:
            return
        self._thread.join(LONGEST_WAIT_S)
