"""All lines of one message type at once: literals with cells between them, joined by a compiled kernel.

Subclasses define the format of a line. The kernel writes a number if its text is certain to be the same as that of the
slow path; otherwise the slow path writes it, and the kernel copies it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from ridlink.captures.export.si import Column
from ridlink.captures.fast import writing
from ridlink.captures.fast.calling import announce, plain
from ridlink.captures.fast.tables import Layout

_NOTHING_AT = 0
"""Place of `Rows.NOTHING` in every table of texts."""


class Rows(ABC):
    """The lines of one message, begun with `head` and ended with `finish`; then they can be written.

    Args:
        rows: How many lines.
    """

    NOTHING: str
    """What stands for unknown."""

    END: str
    """What every line ends with."""

    FLOAT: int
    """The kind of cells that `float_cells` gives."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._literal = ""
        self._literals: list[bytes] = []
        self._kinds: list[int] = []
        self._cells: list[np.ndarray] = []
        self._longest: list[int] = []
        self._floats: list[tuple[int, Column]] = []
        self._table: list[bytes] = [self.NOTHING.encode()]

    @abstractmethod
    def head(self, layout: Layout, rows: np.ndarray, times_us: np.ndarray, transport: str | None) -> None:
        """What every line begins with."""

    @abstractmethod
    def payloads(self, texts: list[str]) -> None:
        """Payloads in hexadecimal, of messages that the dialect does not have."""

    @abstractmethod
    def fields(self, columns: dict[str, Column]) -> None:
        """All fields."""

    @staticmethod
    @abstractmethod
    def text(value: str) -> bytes:
        """How a text is shown."""

    @staticmethod
    @abstractmethod
    def float_cells(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers as cells, shape (columns, rows), and where these can be written; NaN cannot."""

    @staticmethod
    @abstractmethod
    def float_texts(values: list[float]) -> list[bytes]:
        """Numbers as they are shown, whatever they are."""

    def literal(self, text: str) -> None:
        """What every line has here."""
        self._literal += text

    def numbers(self, values: np.ndarray) -> None:
        """Integers."""
        if values.dtype == np.uint64 and values.max() >= writing.FIRST_TEXT:
            self.coded(values, str)
        else:
            self.cells(writing.WHOLE, values)

    def texts(self, values: Sequence[str | None]) -> None:
        """Texts, or none; senders repeat themselves, so each is put down once."""
        places: dict[str | None, int] = {None: _NOTHING_AT}
        first = len(self._table)
        for value in set(values):
            if value is not None:
                places[value] = len(self._table)
                self._table.append(self.text(value))
        self._text_cells(np.array([places[value] for value in values], np.int64), first)

    def coded(self, values: np.ndarray, text_of: Callable[[int], str]) -> None:
        """Integers, each of which is written once."""
        different, places = np.unique(values, return_inverse=True)
        first = len(self._table)
        self._table += [text_of(value).encode() for value in different.tolist()]
        self._text_cells(places + first, first)

    def written(self, texts: Iterable[bytes]) -> None:
        """What somebody else has written."""
        first = len(self._table)
        self._table += texts
        self._text_cells(np.arange(first, len(self._table)), first)

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
            self.cells(self.FLOAT, values)
        else:
            self.numbers(values)

    def _text_cells(self, values: np.ndarray, first: int) -> None:
        """Cells of texts, which are in the table from ``first`` on, or of nothing."""
        self.cells(writing.TEXT, values, max(map(len, [self._table[_NOTHING_AT], *self._table[first:]])))

    def cells(self, kind: int, values: np.ndarray, longest: int = writing.LONGEST_NUMBER) -> None:
        """Cells of a kind of `writing`, each of so many bytes at most."""
        self._longest.append(longest)
        self._literals.append(self._literal.encode())
        self._literal = ""
        self._kinds.append(kind)
        self._cells.append(values)

    def _write_floats(self) -> None:
        """Floats to cells: all columns at once, for what numpy costs is mostly the call."""
        values = np.empty((len(self._floats), self._rows))
        for number, (_, column) in enumerate(self._floats):
            values[number] = column.values
            if column.known is not None:
                values[number, ~column.known] = np.nan
        cells, are_cells = self.float_cells(values)
        unknown = np.isnan(values)
        cells[unknown] = writing.FIRST_TEXT + _NOTHING_AT
        others = ~(are_cells | unknown)
        if others.any():
            written = self.float_texts(values[others].tolist())
            first = writing.FIRST_TEXT + len(self._table)
            cells[others] = np.arange(first, first + len(written))
            self._table += written
        for number, (place, _) in enumerate(self._floats):
            self._cells[place] = cells[number]

    def finish(self) -> None:
        """All of a line has been said."""
        self._literals.append(f"{self._literal}{self.END}".encode())
        if self._floats:
            with np.errstate(invalid="ignore", over="ignore"):
                self._write_floats()

    def longest(self) -> int:
        """More bytes than all lines can have."""
        return self._rows * (sum(map(len, self._literals)) + sum(self._longest))

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
