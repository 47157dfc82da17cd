"""JSON lines from columns: what `ridlink.captures.lines.json_line` writes, byte by byte, many times as fast.

Lines are put together by a kernel. Numbers that are decimal fractions of seven places it writes itself, which is all
that comes of integers on the wire; the few others are written by the encoder of `json_line`, and the kernel copies.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from ridlink.captures.export.chosen import NO_TIME, chosen_rows, pack_records
from ridlink.captures.export.framed import framed_line
from ridlink.captures.export.selection import Selection
from ridlink.captures.export.si import Column, columns_of
from ridlink.captures.fast import writing
from ridlink.captures.fast.blocks import Block, announce, plain
from ridlink.captures.lines import exact_seconds, json_line

NULL = 0
"""Place of ``null`` in every table of texts."""

SCALE = 10.0**writing.DECIMALS
FEWEST, MOST = 1e2, 1e15
"""Ten-millionths that the kernel writes: below, numbers get an exponent; above, digits do not tell them apart."""

GROWTH = 1.25

_encode = msgspec.json.Encoder().encode


class BlockLines:
    """Writes the messages of blocks as lines.

    Args:
        selection: Which messages to write.
        frames: Add the bytes of each frame, in hexadecimal, as ``frame``.
    """

    def __init__(self, selection: Selection, *, frames: bool = False) -> None:
        self._selection = selection
        self._frames = frames
        self._by_message = np.empty(0, np.uint8)
        self._in_order = np.empty(0, np.uint8)

    def of(self, block: Block) -> memoryview:
        """Lines of a block, in the order of the file; valid until the next block."""
        starts, ends = np.zeros(block.count, np.int64), np.zeros(block.count, np.int64)
        at = 0
        for layout, entries, rows in chosen_rows(block, self._selection):
            lines = _Lines(len(rows))
            lines.literal('{"t":')
            lines.times(block.times[entries])
            lines.literal(',"src":"')
            lines.numbers(rows["sysid"])
            lines.literal("/")
            lines.numbers(rows["compid"])
            lines.literal('","seq":')
            lines.numbers(rows["seq"])
            lines.literal(f',"type":"{layout.name}","id":')
            if layout.spec is None:
                lines.numbers(rows["msgid"])
                lines.literal(',"fields":{},"payload":')
                payloads = zip(rows["payload"], rows["length"].tolist(), strict=True)
                lines.texts([payload[:length].tobytes().hex() for payload, length in payloads])
            else:
                lines.literal(f'{layout.spec.msgid},"fields":')
                for index, (name, column) in enumerate(columns_of(layout, rows).items()):
                    lines.literal(f'{"," if index else "{"}"{name}":')
                    lines.column(column)
                lines.literal("}")
            if self._frames:
                lines.literal(',"frame":')
                lines.texts([block.frame(entry).hex() for entry in entries.tolist()])
            lines.finish("}\n")
            self._by_message = _with_room(self._by_message, at, lines.longest())
            at = lines.write(self._by_message, at, entries, starts, ends)
        for entry, records in pack_records(block, self._selection):
            made = b"".join(
                framed_line(json_line(record), record) if self._frames else json_line(record) for record in records
            )
            self._by_message = _with_room(self._by_message, at, len(made))
            self._by_message[at : at + len(made)] = np.frombuffer(made, np.uint8)
            starts[entry], ends[entry] = at, at + len(made)
            at += len(made)
        self._in_order = _with_room(self._in_order, 0, at)
        length = writing.put_in_order(plain(self._by_message), plain(starts), plain(ends), plain(self._in_order))
        return self._in_order.data[:length]


def _with_room(buffer: np.ndarray, used: int, more: int) -> np.ndarray:
    """The buffer, or a larger one with what is used of it."""
    if used + more <= len(buffer):
        return buffer
    larger = np.empty(int(GROWTH * (used + more)), np.uint8)
    larger[:used] = buffer[:used]
    return larger


class _Lines:
    """The lines of one message: literals with cells between them, as the kernel takes them."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._literal = ""
        self._literals: list[bytes] = []
        self._kinds: list[int] = []
        self._cells: list[np.ndarray] = []
        self._floats: list[tuple[int, Column]] = []
        self._table: list[bytes] = [b"null"]

    def literal(self, text: str) -> None:
        """What every line has here."""
        self._literal += text

    def times(self, times_us: np.ndarray) -> None:
        """Seconds, exactly."""
        if times_us.max() < writing.FIRST_TEXT:
            self._add(writing.TIME, times_us)
        else:
            self._add_written(["null" if t == NO_TIME else exact_seconds(t) for t in times_us.tolist()])

    def numbers(self, values: np.ndarray) -> None:
        """Integers."""
        if values.dtype == np.uint64 and values.max() >= writing.FIRST_TEXT:
            self._add_written(list(map(str, values.tolist())))
        else:
            self._add(writing.WHOLE, values)

    def texts(self, values: list[str | None]) -> None:
        """Texts, ``null`` for none; senders repeat themselves, so each is put down once."""
        places: dict[str | None, int] = {None: NULL}
        for value in set(values) - places.keys():
            places[value] = len(self._table)
            self._table.append(_encode(value))
        self._add(writing.TEXT, np.array([places[value] for value in values], np.int64))

    def column(self, column: Column) -> None:
        """Whatever a column has."""
        values = column.values
        if isinstance(values, list):
            self.texts(values)
        elif values.ndim > 1:
            for index in range(values.shape[1]):
                self.literal("," if index else "[")
                self.column(Column(values[:, index]))
            self.literal("]")
        elif values.dtype.kind == "f":
            self._floats.append((len(self._cells), column))
            self._add(writing.DECIMAL, values)
        else:
            self.numbers(values)

    def _add(self, kind: int, values: np.ndarray) -> None:
        self._literals.append(self._literal.encode())
        self._literal = ""
        self._kinds.append(kind)
        self._cells.append(values)

    def _add_written(self, texts: list[str]) -> None:
        """What is JSON already."""
        first = len(self._table)
        self._table += [text.encode() for text in texts]
        self._add(writing.TEXT, np.arange(first, len(self._table)))

    def _write_floats(self) -> None:
        """Floats to cells: all columns at once, for what numpy costs is mostly the call."""
        values = np.empty((len(self._floats), self._rows))
        for number, (_, column) in enumerate(self._floats):
            values[number] = column.values
            if column.known is not None:
                values[number, ~column.known] = np.nan
        scaled = np.rint(values * SCALE)
        size = np.abs(scaled)
        exact = (scaled / SCALE == values) & (size < MOST) & ((size >= FEWEST) | ((size == 0.0) & ~np.signbit(values)))
        scaled[~exact] = 0.0
        cells = scaled.astype(np.int64)
        cells[~np.isfinite(values)] = writing.FIRST_TEXT + NULL
        others = np.isfinite(values) & ~exact
        if others.any():
            written = _encode(values[others].tolist())[1:-1].split(b",")
            first = writing.FIRST_TEXT + len(self._table)
            cells[others] = np.arange(first, first + len(written))
            self._table += written
        for number, (place, _) in enumerate(self._floats):
            self._cells[place] = cells[number]

    def finish(self, text: str) -> None:
        """What every line ends with; then they can be written."""
        self._literals.append(f"{self._literal}{text}".encode())
        if self._floats:
            with np.errstate(invalid="ignore", over="ignore"):
                self._write_floats()

    def longest(self) -> int:
        """More bytes than all lines can have."""
        cell = max(writing.LONGEST_NUMBER, *map(len, self._table))
        return self._rows * (sum(map(len, self._literals)) + len(self._kinds) * cell)

    def write(self, out: np.ndarray, at: int, entries: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> int:
        """Write them to ``out[at:]``, and by their places in the file where each starts and ends; the byte after."""
        cells = np.empty((len(self._cells), self._rows), np.int64)
        for column, values in enumerate(self._cells):
            cells[column] = values
        announce(writing.write_lines, "the writer of lines")
        end = writing.write_lines(
            plain(cells.ravel()), plain(np.array(self._kinds)), self._rows, *_joined(self._literals),
            *_joined(self._table), plain(entries), plain(out), at, starts, ends,
        )  # fmt: skip
        return int(end)


def _joined(parts: list[bytes]) -> tuple[Any, Any]:
    """Bytes one after the other, and where each begins and the last ends."""
    bounds = np.zeros(len(parts) + 1, np.int64)
    np.cumsum(list(map(len, parts)), out=bounds[1:])
    return plain(np.frombuffer(bytearray(b"".join(parts)), np.uint8)), plain(bounds)
