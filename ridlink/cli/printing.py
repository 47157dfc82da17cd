"""Output of commands that fly, emulate or transmit: a reader that stops reading stops nothing else."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import queue
import select
import sys
import threading
from typing import TextIO, cast

from ridlink.words import counted

QUEUED_LINES, QUEUED_CHARACTERS = 1000, 4_000_000
"""Most queued lines and characters; a line of a fleet of hundreds has tens of kilobytes."""

PATIENCE_S = 1.0
"""At the end, a reader that takes nothing for this long counts as gone, ..."""

PAGING_S = 60.0
"""... and after this long if nobody asked for the end: a pager takes nothing while a person reads."""

GONE = (errno.EPIPE, errno.EIO)
"""Errors of a pipe or terminal whose other end is closed; any other error is that of a disk."""


class Printer:
    """Prints from two threads, one for standard output and one for standard error, so that a slow reader of one does
    not delay the other. Lines are dropped if a reader is too slow, and all lines once it has gone or its disk is full.

    Attributes:
        patience_s: How long `close` waits for a reader of standard output that takes nothing.
    """

    def __init__(self) -> None:
        self.patience_s = PATIENCE_S
        self._lanes = (_Lane(sys.stdout), _Lane(sys.stderr))  # the streams of now: a live table replaces them later

    @property
    def reader_has_gone(self) -> bool:
        """Whether the reader of standard output has closed it."""
        return self._lanes[False].reader_has_gone

    def put(self, text: str, *, error: bool = False) -> None:
        """Print a text, its line end included, on standard output or standard error."""
        self._lanes[error].put(text)

    def stream(self, *, error: bool) -> TextIO:
        """Standard output or standard error as a file, for logs and tables."""
        return cast(TextIO, _Stream(self._lanes[error]))

    def close(self) -> None:
        """Print what is queued, as long as its reader goes on reading, and report on standard error how much was
        dropped."""
        output, errors = self._lanes
        unread = output.close(self.patience_s) + errors.close(PATIENCE_S)
        said = ""
        if output.problem:
            said = f"ridlink: standard output: {output.problem}; the lines from there on are lost\n"
        if unread:
            said += f"ridlink: left out {counted(unread, 'line', 'd')} that nobody read\n"
        stream = errors.stream
        if said and stream is not None and select.select([], [stream], [], 0.0)[1]:  # else nobody reads this, either
            with contextlib.suppress(OSError):
                stream.write(said)
                stream.flush()


class _Lane:
    def __init__(self, stream: TextIO | None) -> None:
        self.stream = stream  # None if our caller has closed it
        self.reader_has_gone = False
        self.problem = ""
        self._left_out = self._queued = self._printed = 0
        self._taken = self._given = 0  # characters, each counted by one thread only
        self._queue: queue.Queue[str | None] = queue.Queue(QUEUED_LINES)
        self._thread = threading.Thread(target=self._run, name="printer", daemon=True)
        self._thread.start()

    def put(self, text: str) -> None:
        try:
            waiting = self._taken - self._given
            if waiting and waiting + len(text) > QUEUED_CHARACTERS:
                raise queue.Full
            self._queue.put_nowait(text)
            self._queued += 1
            self._taken += len(text)
        except queue.Full:
            self._left_out += 1

    def _run(self) -> None:
        while (text := self._queue.get()) is not None:
            if self.stream is not None:
                try:
                    write_past_buffer(self.stream, text)
                except OSError as error:  # the flight goes on
                    os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())
                    self.reader_has_gone = error.errno in GONE
                    self.problem = "" if self.reader_has_gone else error.strerror or str(error)
            self._printed += 1
            self._given += len(text)

    def close(self, patience_s: float) -> int:
        """Print what is queued, as long as its reader goes on reading. Returns the number of texts not printed."""
        printed, ends = -1, 0
        while not ends and printed != self._printed:
            printed = self._printed
            with contextlib.suppress(queue.Full):
                self._queue.put(None, timeout=patience_s)
                ends = 1
        printed = -1
        while ends and self._thread.is_alive() and printed != self._printed:
            printed = self._printed
            self._thread.join(patience_s)
        return self._left_out + self._queued - self._printed


def write_past_buffer(stream: TextIO, text: str) -> None:
    """Write all of a text past the buffer of its stream.

    Whoever waits for a reader in there keeps it locked, and Python cannot end without it; and a signal that comes
    meanwhile must not enter it again.
    """
    try:
        data = text.encode(stream.encoding, stream.errors or "strict")
    except UnicodeEncodeError:  # a name that this terminal cannot show
        data = text.encode(stream.encoding, "backslashreplace")
    try:
        descriptor = stream.fileno()
    except io.UnsupportedOperation:  # it is none of the system's
        stream.write(data.decode(stream.encoding))
        stream.flush()
        return
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


class _Stream(io.TextIOBase):
    def __init__(self, lane: _Lane) -> None:
        self._lane = lane

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return getattr(self._lane.stream, "encoding", None) or "utf-8"

    def isatty(self) -> bool:
        return self._lane.stream is not None and self._lane.stream.isatty()

    def write(self, text: str, /) -> int:
        self._lane.put(text)
        return len(text)
