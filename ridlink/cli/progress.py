"""Progress of a command on a terminal."""

from __future__ import annotations

import sys
import time
from typing import Protocol

from ridlink.words import counted

PROGRESS_AFTER_S = 1.0
PROGRESS_EVERY_S = 0.2


class HasPosition(Protocol):
    """A file that is being read."""

    @property
    def position(self) -> int:
        """Bytes read."""

    @property
    def size(self) -> int | None:
        """Bytes in all, None if unknown."""


class StatusLine:
    """A line on standard error that the next one overwrites; nothing is shown if that is no terminal.

    Attributes:
        is_live: Whether it is a terminal.
    """

    def __init__(self) -> None:
        self.is_live = sys.stderr.isatty()
        self._is_shown = False

    def show(self, text: str) -> None:
        """Replace the line."""
        if self.is_live:
            sys.stderr.write(f"\r{text}\x1b[K")
            sys.stderr.flush()
            self._is_shown = True

    def clear(self) -> None:
        """Remove the line."""
        if self._is_shown:
            self.show("")
            self._is_shown = False


class Progress:
    """Shows the number of messages read in a status line, if the work takes more than a second."""

    CHECK_EVERY = 4096

    def __init__(self, screen_is_free: bool) -> None:
        self._line = StatusLine()
        self._active = screen_is_free and self._line.is_live
        self._next_s = time.monotonic() + PROGRESS_AFTER_S
        self._records = 0

    def tick(self, capture: HasPosition, records: int = 1) -> None:
        """Count further records."""
        self._records += records
        if not self._active or (records == 1 and self._records % self.CHECK_EVERY) or time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + PROGRESS_EVERY_S
        share = f"{capture.position / capture.size:4.0%}  " if capture.size else ""
        self._line.show(f"{share}{counted(self._records, 'message')}")

    def clear(self) -> None:
        """Remove the line."""
        self._line.clear()
