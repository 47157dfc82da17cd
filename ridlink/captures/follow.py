"""Captures that still grow, read as ``tail -F`` does: the present content, then everything appended, until stopped.

If the file is truncated or replaced by another one, its capture ends and the next one starts.
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
    """Reading was stopped; an incomplete record at the end of the file is no damage."""


class Follower:
    """Follows one file; iterate over its captures: one, or more if the file is truncated or replaced.

    Args:
        path: The file.
        kind: ``tlog``, ``mavlink``, ``hex``, or ``auto`` to detect it by content and suffix.
        notice: Called with one line when the file is truncated or replaced.
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
        """Captures. Read each to its end before you request the next.

        Raises:
            CaptureError: If it is no capture, or a kind that cannot be followed.
            OSError: If it cannot be read.
            Stopped: If `stop` was called.
        """
        while True:
            stream = _GrowingFile(self._path, self._pause)
            try:
                kind = self._kind_of(stream)
                if kind is not None:
                    # it has the methods that are used of a stream
                    yield FollowedCapture(self.name, stream, kind, before_read=self._look_up)  # type: ignore[arg-type]
            finally:
                stream.close()
            self._notice(f"{self.name} {stream.ending}; reading from its beginning")

    def _kind_of(self, stream: _GrowingFile) -> CaptureKind | None:
        """The kind, once the file is long enough to detect it; ``None`` if another file has taken its place."""
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
    """A capture that may end without a record, if the file was truncated before there was one."""

    def __iter__(self) -> Iterator[Record]:
        """Records, as they come."""
        try:
            yield from super().__iter__()
        except CaptureError:
            return


class _GrowingFile:
    """A file that waits at its end for more. It ends only if the file was truncated or replaced; ``ending`` says so."""

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
        """The next bytes, waiting if necessary; ``b""`` at the end of a file that was truncated or replaced."""
        while True:
            chunk: bytes = self._file.read(length)
            if chunk or self.ending:
                return chunk
            if not self.has_ended():
                self._pause()

    def has_ended(self) -> bool:
        """Whether the file was truncated or replaced; bytes appended before may still be read."""
        ours = os.fstat(self._file.fileno())
        if ours.st_size < self._file.tell():
            self.ending = "was cut back"
            return True
        try:
            named = os.stat(self._path)
        except FileNotFoundError:  # between the renaming of a log and the creation of the next
            return False
        if (named.st_dev, named.st_ino) != (ours.st_dev, ours.st_ino):
            self.ending = "was replaced"
        return bool(self.ending)

    def close(self) -> None:
        self._file.close()
