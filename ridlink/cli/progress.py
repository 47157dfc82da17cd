"""How far a command is."""

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
        """Bytes in all, None where that is not known."""


class Progress:
    """A line on standard error, if that is a terminal and the work takes more than a second."""

    CHECK_EVERY = 4096

    def __init__(self, screen_is_free: bool) -> None:
        self._active = screen_is_free and sys.stderr.isatty()
        self._next_s = time.monotonic() + PROGRESS_AFTER_S
        self._shown = False
        self._records = 0

    def tick(self, capture: HasPosition, records: int = 1) -> None:
        """So many records more."""
        self._records += records
        if not self._active or (records == 1 and self._records % self.CHECK_EVERY) or time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + PROGRESS_EVERY_S
        self._shown = True
        share = f"{capture.position / capture.size:4.0%}  " if capture.size else ""
        sys.stderr.write(f"\r{share}{counted(self._records, 'message')}\x1b[K")
        sys.stderr.flush()

    def clear(self) -> None:
        """Take the line away."""
        if self._shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
