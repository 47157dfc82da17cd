"""Counts of the contents of captures: messages by type and by sender, time span, sequence gaps, damage."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import msgspec

from ridlink.captures.lines import clock_time, exact_seconds
from ridlink.captures.messages import UNKNOWN, MessageRecord
from ridlink.captures.reader import Capture
from ridlink.words import counted, or_dash

SEQUENCE_NUMBERS = 256
LEAP = SEQUENCE_NUMBERS // 4
"""From this many missing numbers on, the sequence is taken to have jumped from one counter to another."""


@dataclass(slots=True)
class SourceCount:
    """Messages of one system id and component id, and the gaps in their sequence numbers."""

    messages: int = 0
    gaps: int = 0
    lost: int = 0
    last_seq: int | None = None
    leaps: int = 0

    @property
    def is_of_several_links(self) -> bool:
        """Whether several sequence counters are mixed, since each link of a vehicle has its own: gaps are then no loss.

        Mixed numbers jump back and forth, by a whole cycle in two jumps; no single link loses so many so often.
        """
        return self.lost > self.messages and 4 * self.leaps > self.gaps

    @property
    def missing(self) -> tuple[int, int] | tuple[None, None]:
        """Gaps and lost messages; None of several links."""
        return (None, None) if self.is_of_several_links else (self.gaps, self.lost)

    def see(self, seq: int) -> None:
        """Count the next sequence number; a repeated one is a duplicate, not 255 lost messages."""
        self.messages += 1
        if self.last_seq is not None and seq != self.last_seq:
            missing = (seq - self.last_seq - 1) % SEQUENCE_NUMBERS
            self.gaps += missing > 0
            self.lost += missing
            self.leaps += missing >= LEAP
        self.last_seq = seq

    def add(self, messages: int, gaps: int, lost: int, leaps: int, last_seq: int) -> None:
        """Count many messages at once, including the gap before the first of them."""
        self.messages += messages
        self.gaps += gaps
        self.lost += lost
        self.leaps += leaps
        self.last_seq = last_seq


@dataclass(slots=True)
class Statistics:
    """Counts over one or more captures.

    Attributes:
        are_all: Whether all messages of a source are counted: otherwise missing sequence numbers say nothing.
        types: Messages by name.
        ids: Message id of each name; ``UNKNOWN`` has none.
        unknown: Messages that the dialect does not know, by id.
        sources: Messages by system id and component id.
        transmitters: Broadcasts by transmitter and transport.
        first_us, last_us: Earliest and latest time.
        captures: Captures that were read, with their damage.
        unread: Files that are no captures.
        fields: Remote ID fields of these messages that were out of range.
    """

    are_all: bool = True
    types: Counter[str] = field(default_factory=Counter)
    ids: dict[str, int] = field(default_factory=dict)
    unknown: Counter[int] = field(default_factory=Counter)
    sources: dict[tuple[int, int], SourceCount] = field(default_factory=dict)
    transmitters: Counter[tuple[str, str]] = field(default_factory=Counter)
    first_us: int | None = None
    last_us: int | None = None
    captures: list[Capture] = field(default_factory=list)
    unread: int = 0
    fields: Counter[str] = field(default_factory=Counter)

    def begin(self, capture: Capture) -> None:
        """Take the messages of another capture from here on; sequence numbers do not go on from one to the next."""
        self.captures.append(capture)
        for source in self.sources.values():
            source.last_seq = None

    def count(self, record: MessageRecord) -> None:
        """Take one message."""
        name = record.name
        self.types[name] += 1
        if record.message is not None:
            self.ids[name] = record.message.msgid
        else:
            self.unknown[record.frame.msgid] += 1
        if record.is_broadcast and record.origin is not None:
            self.transmitters[record.origin.mac.hex(":") or "-", record.origin.transport or "-"] += 1
        elif not record.is_member:
            source = self.sources.get(record.source)
            if source is None:
                source = self.sources[record.source] = SourceCount()
            source.see(record.frame.seq)
        self.fields.update(record.refused)
        if record.time_us is not None:
            self.span(record.time_us, record.time_us)

    def span(self, first_us: int, last_us: int) -> None:
        """Take the earliest and the latest time of some messages."""
        if self.first_us is None or first_us < self.first_us:
            self.first_us = first_us
        if self.last_us is None or last_us > self.last_us:
            self.last_us = last_us

    @property
    def messages(self) -> int:
        """Total of messages."""
        return self.types.total()

    @property
    def duration_s(self) -> float | None:
        """Time between the earliest and the latest message."""
        if self.first_us is None or self.last_us is None:
            return None
        return (self.last_us - self.first_us) / 1e6

    @property
    def rejects(self) -> int:
        """Rejects of all captures."""
        return sum(len(capture.rejects) for capture in self.captures)

    def _missing(self, source: SourceCount) -> tuple[int, int] | tuple[None, None]:
        return source.missing if self.are_all else (None, None)

    def as_dict(self) -> dict[str, Any]:
        """The counts for `msgspec.json`; times are seconds, exact to the microsecond."""
        return {
            "messages": self.messages,
            "first_t": msgspec.Raw(exact_seconds(self.first_us).encode()),
            "last_t": msgspec.Raw(exact_seconds(self.last_us).encode()),
            "duration_s": self.duration_s,
            "types": dict(self.types.most_common()),
            "unknown_ids": {str(msgid): count for msgid, count in self.unknown.most_common()},
            "sources": {
                f"{sysid}/{compid}": dict(
                    zip(("messages", "gaps", "lost"), (source.messages, *self._missing(source)), strict=True)
                )
                for (sysid, compid), source in sorted(self.sources.items())
            },
            **self._transmitters_as_dict(),
            "rejects": [
                {"file": capture.name, "cause": cause, "count": count,
                 f"first_{'offset' if capture.rejects.unit == 'byte' else capture.rejects.unit}":
                     capture.rejects.first_offset[cause]}
                for capture in self.captures
                for cause, count in capture.rejects.by_count()
            ],
            "fields_out_of_range": dict(self.fields.most_common()),
        }  # fmt: skip

    def _transmitters_as_dict(self) -> dict[str, Any]:
        """Broadcasts by transmitter and transport; empty if there are none."""
        found: dict[str, dict[str, int]] = {}
        for (mac, transport), count in sorted(self.transmitters.items()):
            found.setdefault(mac, {})[transport] = count
        return {"transmitters": found} if found else {}

    def as_text(self) -> str:
        """The counts as aligned tables."""
        duration_s = self.duration_s
        span = "no times" if duration_s is None else (
            f"{clock_time(self.first_us)} to {clock_time(self.last_us)}, {duration_s:.3f} s"
        )  # fmt: skip
        types: list[tuple[str, int, int]] = [
            (name, self.ids[name], count) for name, count in self.types.items() if name in self.ids
        ]
        types += [(UNKNOWN, msgid, count) for msgid, count in self.unknown.items()]
        types.sort(key=lambda row: row[2], reverse=True)
        kinds = [f"{capture.name} ({capture.kind}, {capture.position:,} bytes)" for capture in self.captures]
        blocks = [
            "\n".join([*kinds, f"{counted(self.messages, 'message')}, {span}"]),
            _table(
                ("message", "id", "count", "per s"),
                [
                    (name, msgid, f"{count:,}", f"{count / duration_s:.2f}" if duration_s else "-")
                    for name, msgid, count in types
                ],
            ),
        ]
        if self.sources or not self.transmitters:
            blocks.append(
                _table(
                    ("source", "count", "gaps", "lost"),
                    [
                        (f"{sysid}/{compid}", *(or_dash(n, ",") for n in (source.messages, *self._missing(source))))
                        for (sysid, compid), source in sorted(self.sources.items())
                    ],
                )
            )
            if not self.are_all:
                blocks.append("-: sequence numbers count all messages, and here are only some of them")
            elif any(source.is_of_several_links for source in self.sources.values()):
                blocks.append("-: several links were recorded at once, and each numbers its own messages")
            if self.are_all and any(source.gaps and not source.is_of_several_links for source in self.sources.values()):
                blocks.append("gaps: lost on the way, or sent over another link of that source, which was not recorded")
        if self.transmitters:
            blocks.append(
                _table(
                    ("transmitter", "transport", "count"),
                    [(mac, transport, f"{count:,}") for (mac, transport), count in sorted(self.transmitters.items())],
                )
            )
        rejects = [
            (cause, f"{count:,}", f"{capture.rejects.first_offset[cause]:,}", *([capture.name] * (len(kinds) > 1)))
            for capture in self.captures
            for cause, count in capture.rejects.by_count()
        ]
        if rejects:
            units = {capture.rejects.unit for capture in self.captures if capture.rejects}
            place = f"first at {' or '.join(sorted(units))}"
            blocks.append(_table(("reject", "count", place, *(["file"] * (len(kinds) > 1))), rejects))
        else:
            blocks.append("no rejects")
        if self.fields:
            blocks.append(
                _table(("field out of range", "count"), [(name, f"{n:,}") for name, n in self.fields.most_common()])
            )
        return "\n\n".join(blocks) + "\n"


def _table(header: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    """Columns of minimum width, the first aligned left and the others right."""
    cells = [[str(cell) for cell in row] for row in (header, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(header))]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    )
