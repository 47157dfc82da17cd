"""The record type that every reader of captures yields, and the counters of damage."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple, Self

from ridlink.mavlink.frames import Frame

BAD_TIMESTAMP = "bad_timestamp"
"""Cause: an intact frame whose time is days away from that of its neighbours; it is read without a time."""


class Record(NamedTuple):
    """One frame of a capture.

    ``time_us`` is microseconds since 1970 (UTC), ``None`` if the capture has no times; ``offset`` is the byte offset of
    the record in the file (in a tlog, of its timestamp).
    """

    time_us: int | None
    frame: Frame
    offset: int


@dataclass(frozen=True, slots=True)
class Origin:
    """How a message was received, if it was more than a frame in a file.

    Attributes:
        transport: ``udp``, ``tcp``, or a `ridlink.remote_id.radio.Transport`; ``None`` if the capture does not say.
        mac: Transmitter of a broadcast; empty if the capture does not say.
        counter: Message counter of a broadcast.
        index: Index of the message in its message pack; 0 for a single message.
        data: The 25 bytes, if the message was received in this form.
    """

    transport: str | None = None
    mac: bytes = b""
    counter: int | None = None
    index: int = 0
    data: bytes | None = None


class TracedRecord(Record):
    """A record with its `Origin`.

    For a 25-byte message, ``frame`` is the frame that a Remote ID receiver would put on the bus of its vehicle:
    component 236, system 0, with the transmitter in ``id_or_mac``.
    """

    origin: Origin

    def __new__(cls, time_us: int | None, frame: Frame, offset: int, origin: Origin) -> Self:
        record = super().__new__(cls, time_us, frame, offset)
        record.origin = origin
        return record


class Rejects:
    """Damage by cause: number, and first position.

    Attributes:
        counts: Rejects by cause; bytes refused for one cause without a break are one reject.
        first_offset: Position of the first reject of each cause, in ``unit``.
        unit: Unit of positions in the file; bytes by default.
    """

    __slots__ = ("_last_cause", "_last_end", "counts", "first_offset", "unit")

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.first_offset: dict[str, int] = {}
        self.unit = "byte"
        self._last_cause = ""
        self._last_end = -1

    def __repr__(self) -> str:
        return f"Rejects({dict(self.counts)})"

    def add(self, cause: str, offset: int, length: int = 1) -> None:
        """Count bytes that were not taken."""
        if cause != self._last_cause or offset != self._last_end:
            self.counts[str(cause)] += 1
            self.first_offset[str(cause)] = min(offset, self.first_offset.get(str(cause), offset))
        self._last_cause, self._last_end = cause, offset + length

    def add_one(self, cause: str, offset: int) -> None:
        """Count one packet, line or message that was not taken, as a reject of its own."""
        self._last_end = -1
        self.add(cause, offset)
        self._last_end = -1

    def by_count(self) -> list[tuple[str, int]]:
        """Causes and their counts, the most frequent first, then those that come first in the file: the same order
        for every reader, however it goes through the file."""
        return sorted(self.counts.items(), key=lambda item: (-item[1], self.first_offset[item[0]], item[0]))

    def __len__(self) -> int:
        """Total of rejects."""
        return self.counts.total()

    def __str__(self) -> str:
        """One line: causes, counts, first offsets."""
        return ", ".join(
            f"{count} {cause} (first at {self.unit} {self.first_offset[cause]})" for cause, count in self.by_count()
        )
