"""Captures that still grow, read as ``tail -F`` does: what is there, then what is appended, until told to stop.

A file that is cut back or replaced by another one ends its capture and starts the next.
"""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Callable, Iterator

from ridlink.captures.reader import Capture, CaptureKind, open_capture
from ridlink.captures.records import Record
from ridlink.errors import CaptureError
from ridlink.mavlink.frames import MAX_FRAME_LENGTH
from ridlink.remote_id.text import display_name

POLL_INTERVAL_S = 0.25
KINDS = (CaptureKind.TLOG, CaptureKind.MAVLINK, CaptureKind.HEX)
ENOUGH_TO_TELL = 2 * MAX_FRAME_LENGTH
"""A file with fewer bytes may be a capture whose first record is not complete yet."""


class Stopped(Exception):
    """Nobody wants more; what is incomplete at the end of the file is no damage."""


class Follower:
    """Follows one file; iterate over the captures that it becomes, one unless it is cut back or replaced.

    Args:
        path: The file.
        kind: ``tlog``, ``mavlink``, ``hex``, or ``auto`` to tell it by content and suffix.
        notice: Gets one line when the file is cut back or replaced.
        before_read: Called before each read.
    """

    def __init__(
        self,
        path: str,
        kind: str = "auto",
        *,
        notice: Callable[[str], None],
        before_read: Callable[[], None] | None = None,
    ) -> None:
        self.name = display_name(path)
        self._path = path
        self._kind = kind
        self._notice = notice
        self._before_read = before_read
        self._stopped = False

    def stop(self) -> None:
        """Raise `Stopped` out of the next read; may be called by a signal handler."""
        self._stopped = True

    def __iter__(self) -> Iterator[FollowedCapture]:
        """Captures, each to be read to its end before the next is asked for.

        Raises:
            CaptureError: If it is no capture, or of a kind that is not followed.
            OSError: If it cannot be read.
            Stopped: If told to stop.
        """
        while True:
            stream = _GrowingFile(self._path, self._pause)
            try:
                kind = self._kind_of(stream)
                if kind is not None:
                    # it has what is used of a stream
                    yield FollowedCapture(self.name, stream, kind, before_read=self._look_up)  # type: ignore[arg-type]
            finally:
                stream.close()
            self._notice(f"{self.name} {stream.ending}; reading from its beginning")

    def _kind_of(self, stream: _GrowingFile) -> CaptureKind | None:
        """The kind, when there is enough of the file to tell it; ``None`` where another file has taken its place."""
        if self._kind != "auto":
            return CaptureKind(self._kind)
        while not stream.has_ended():
            size = stream.size()
            try:
                kind = self._detected() if size else None
            except CaptureError:
                if size >= ENOUGH_TO_TELL:
                    raise
                kind = None
            if kind is not None and kind not in KINDS:
                raise CaptureError(f"{self.name} is {kind}; tlog, raw MAVLink and lines of hex can be followed")
            if kind is not None:
                return kind
            self._pause()
        return None

    def _detected(self) -> CaptureKind:
        with open_capture(self._path) as capture:
            return capture.kind

    def _look_up(self) -> None:
        if self._before_read is not None:
            self._before_read()
        if self._stopped:
            raise Stopped

    def _pause(self) -> None:
        if self._stopped:
            raise Stopped
        time.sleep(POLL_INTERVAL_S)


class FollowedCapture(Capture):
    """A capture that may end without a record: the file was emptied before there was one."""

    def __iter__(self) -> Iterator[Record]:
        """Records, as they come."""
        try:
            yield from super().__iter__()
        except CaptureError:
            return


class _GrowingFile:
    """A file whose end is waited at; it ends only where the file was cut back or replaced, and ``ending`` says so."""

    def __init__(self, path: str, pause: Callable[[], None]) -> None:
        self._path = path
        self._pause = pause
        self.ending = ""
        self._file = open(path, "rb", buffering=0)  # noqa: SIM115 - closed by whoever follows
        if not stat.S_ISREG(os.fstat(self._file.fileno()).st_mode):
            self._file.close()
            raise CaptureError(f"{display_name(path)} is no regular file: only such can be followed")

    def size(self) -> int:
        return os.fstat(self._file.fileno()).st_size

    def read1(self, length: int) -> bytes:
        """What there is, waited for; ``b""`` at the end of a file that was cut back or replaced."""
        while True:
            chunk: bytes = self._file.read(length)
            if chunk or self.ending:
                return chunk
            if not self.has_ended():
                self._pause()

    def has_ended(self) -> bool:
        """The file was cut back or replaced; what was appended before may still be read."""
        ours = os.fstat(self._file.fileno())
        if ours.st_size < self._file.tell():
            self.ending = "was cut back"
            return True
        try:
            named = os.stat(self._path)
        except FileNotFoundError:  # between the renaming of a log and the making of the next
            return False
        if (named.st_dev, named.st_ino) != (ours.st_dev, ours.st_ino):
            self.ending = "was replaced"
        return bool(self.ending)

    def close(self) -> None:
        self._file.close()
