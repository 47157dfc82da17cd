"""JSON lines from columns: what `ridlink.captures.lines.json_line` writes.

Numbers that are decimal fractions of seven places are written by the kernel, which is all that comes of integers on the
wire; the few others by the encoder of `json_line`.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ridlink.captures.export.rows import Rows
from ridlink.captures.export.si import Column
from ridlink.captures.fast import writing
from ridlink.captures.fast.scanning import NO_TIME
from ridlink.captures.fast.tables import Layout
from ridlink.captures.lines import exact_seconds

SCALE = 10.0**writing.DECIMALS
FEWEST, MOST = 1e2, 1e15
"""Ten-millionths that the kernel writes: below, numbers get an exponent; above, digits do not tell them apart."""

_encode = msgspec.json.Encoder().encode


class JsonRows(Rows):
    """One JSON object a message."""

    NOTHING = "null"
    END = "}\n"
    FLOAT = writing.DECIMAL

    def head(self, layout: Layout, rows: np.ndarray, times_us: np.ndarray, transport: str | None) -> None:
        """Time, transport, sender and message."""
        self.literal('{"t":')
        if times_us.max() < writing.FIRST_TEXT:
            self.cells(writing.TIME, times_us)
        else:
            self.coded(times_us, lambda t: self.NOTHING if t == NO_TIME else exact_seconds(t))
        if transport:
            self.literal(f',"transport":"{transport}"')
        self.literal(',"src":"')
        self.numbers(rows["sysid"])
        self.literal("/")
        self.numbers(rows["compid"])
        self.literal('","seq":')
        self.numbers(rows["seq"])
        self.literal(f',"type":"{layout.name}","id":')
        if layout.spec is None:
            self.numbers(rows["msgid"])
        else:
            self.literal(str(layout.spec.msgid))

    def payloads(self, texts: list[str]) -> None:
        """Payloads in hexadecimal, of messages that the dialect does not have."""
        self.literal(',"fields":{},"payload":')
        self.texts(texts)

    def fields(self, columns: dict[str, Column]) -> None:
        """All fields."""
        self.literal(',"fields":')
        for index, (name, column) in enumerate(columns.items()):
            self.literal(f'{"," if index else "{"}"{name}":')
            self.column(column)
        self.literal("}")

    @staticmethod
    def text(value: str) -> bytes:
        """A string."""
        return _encode(value)

    @staticmethod
    def float_cells(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ten-millionths, and where that is exact."""
        scaled = np.rint(values * SCALE)
        size = np.abs(scaled)
        exact = (scaled / SCALE == values) & (size < MOST) & ((size >= FEWEST) | ((size == 0.0) & ~np.signbit(values)))
        return np.where(exact, scaled, 0.0).astype(np.int64), exact

    @staticmethod
    def float_texts(values: list[float]) -> list[bytes]:
        """Any number; what is not finite is ``null``."""
        return _encode(values)[1:-1].split(b",")
