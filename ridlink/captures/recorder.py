"""Datagrams of a link into a tlog: what is a frame is written, the rest is counted."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

from ridlink.captures.messages import UNKNOWN
from ridlink.captures.records import Rejects
from ridlink.captures.tlog import TlogWriter
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES
from ridlink.mavlink.frames import Frame, parse_datagram


def steady_clock() -> Callable[[], int]:
    """A clock of microseconds since 1970 that is set once and then never steps, whatever happens to the system's."""
    started_us = (time.time_ns() - time.monotonic_ns()) // 1000
    return lambda: started_us + time.monotonic_ns() // 1000


class Recorder:
    """Takes datagrams and writes their frames.

    Nothing raises out of `receive`, for a link would count and forget it: the error that ended the recording is kept.

    Args:
        clock: Microseconds since 1970 of a datagram received now.

    Attributes:
        types: Messages written, by name.
        sources: Messages written, by ``system/component``.
        rejects: What was not a frame; offsets count the bytes received.
        error: What ended the recording, such as a full disk.
    """

    def __init__(self, clock: Callable[[], int]) -> None:
        self.types: Counter[str] = Counter()
        self.sources: Counter[str] = Counter()
        self.rejects = Rejects()
        self.error: OSError | None = None
        self._clock = clock
        self._received_bytes = 0
        self._writer: TlogWriter | None = None

    def start(self, writer: TlogWriter) -> None:
        """Write into this log from now on."""
        self._writer = writer

    def receive(self, data: bytes, _: object = None) -> None:
        """Take one datagram."""
        if self._writer is None or self.error is not None:
            return
        time_us = self._clock()
        for item in parse_datagram(data, CRC_EXTRAS):
            if not isinstance(item, Frame):
                self.rejects.add(item.cause, self._received_bytes + item.offset, item.length)
                continue
            try:
                self._writer.write(time_us, item.raw)
            except OSError as error:
                self.error = error
                return
            spec = MESSAGES.get(item.msgid)
            self.types[spec.name if spec is not None else UNKNOWN] += 1
            self.sources[f"{item.sysid}/{item.compid}"] += 1
        self._received_bytes += len(data)

    def flush(self) -> None:
        """Bring what was received onto the disk."""
        if self._writer is None or self.error is not None:
            return
        try:
            self._writer.flush()
        except OSError as error:
            self.error = error
