"""What every reader of captures yields, and how it counts what it could not read."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from ridlink.mavlink.frames import Frame

BAD_TIMESTAMP = "bad_timestamp"
"""Cause: an intact frame whose time is days away from its neighbours'; it is read without a time."""


class Record(NamedTuple):
    """One frame of a capture.

    ``time_us`` is microseconds since 1970 (UTC), ``None`` where the capture has no times; ``offset`` is the byte of the
    file where the record starts (its timestamp, in a tlog).
    """

    time_us: int | None
    frame: Frame
    offset: int


class Rejects:
    """Damage by cause: how often, and where first.

    Attributes:
        counts: Rejects by cause; bytes refused for one cause without a break are one reject.
        first_offset: Byte of the file where a cause was met first.
    """

    __slots__ = ("_last_cause", "_last_end", "counts", "first_offset")

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.first_offset: dict[str, int] = {}
        self._last_cause = ""
        self._last_end = -1

    def add(self, cause: str, offset: int, length: int = 1) -> None:
        """Count bytes that were not taken."""
        if cause != self._last_cause or offset != self._last_end:
            self.counts[str(cause)] += 1
            self.first_offset.setdefault(str(cause), offset)
        self._last_cause, self._last_end = cause, offset + length

    def __len__(self) -> int:
        """Rejects in all."""
        return self.counts.total()

    def __str__(self) -> str:
        """One line: causes, counts, first offsets."""
        return ", ".join(
            f"{count} {cause} (first at byte {self.first_offset[cause]})" for cause, count in self.counts.most_common()
        )
