"""Aligned rows from columns: what `ridlink.captures.lines.table_line` writes."""

from __future__ import annotations

import numpy as np

from ridlink.captures.export.rows import Rows
from ridlink.captures.export.si import Column
from ridlink.captures.fast import writing
from ridlink.captures.fast.scanning import NO_TIME
from ridlink.captures.fast.tables import Layout
from ridlink.captures.lines import DIGITS, NAME_WIDTH, NUMBER_WIDTH, SOURCE_WIDTH, TIME_WIDTH, cell, clock_time
from ridlink.captures.messages import UNKNOWN

CALENDAR_END_US = 253_402_300_800_000_000
"""Year 10000, in microseconds since 1970."""

TEN_SECONDS_US = 10_000_000
TO_TEN_SECONDS = len("2026-05-01T12:30:0")
"""Characters of a time that stay the same for ten seconds."""

_LEAST = -4
_DECADES = np.array([float(f"1e{exponent}") for exponent in range(_LEAST, DIGITS)])
_SCALES = 10.0 ** np.arange(DIGITS - _LEAST + 1)
_NEAR_A_TIE = 1e-5
"""Scaled numbers below 1e10 are wrong by 1e-6 at most."""


class AlignedRows(Rows):
    """One aligned row per message, for people."""

    NOTHING = "-"
    END = "\n"
    FLOAT = writing.SIGNIFICANT

    def head(self, layout: Layout, rows: np.ndarray, times_us: np.ndarray, transport: str | None) -> None:
        """Time, source, sequence number and message."""
        if times_us.max() < CALENDAR_END_US:
            tens = times_us // np.uint64(TEN_SECONDS_US)
            self.coded(tens, lambda ten: clock_time(ten * TEN_SECONDS_US)[:TO_TEN_SECONDS])
            self.cells(writing.TIME, times_us % np.uint64(TEN_SECONDS_US))
            self.literal("Z ")
        else:
            self.coded(times_us, lambda t: f"{clock_time(None if t == NO_TIME else t):<{TIME_WIDTH}} ")
        sources = rows["sysid"].astype(np.uint16) << 8 | rows["compid"]
        self.coded(sources, lambda source: f"{f'{source >> 8}/{source & 0xFF}':>{SOURCE_WIDTH}} ")
        self.coded(rows["seq"], lambda seq: f"{seq:>{NUMBER_WIDTH}}  ")
        if layout.spec is None:
            self.coded(rows["msgid"], lambda msgid: f"{f'{UNKNOWN} {msgid}':<{NAME_WIDTH}}")
        else:
            self.literal(f"{layout.name:<{NAME_WIDTH}}")

    def payloads(self, texts: list[str]) -> None:
        """Payloads in hexadecimal, of messages that the dialect does not have."""
        self.literal(" payload=")
        self.written(text.encode() for text in texts)

    def fields(self, columns: dict[str, Column]) -> None:
        """All fields."""
        for name, column in columns.items():
            self.literal(f" {name}=")
            self.column(column)

    @staticmethod
    def text(value: str) -> bytes:
        """A text in quotation marks."""
        return cell(value).encode()

    @staticmethod
    def float_cells(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ten significant digits with their number of decimals, and where they are certain.

        Digits are not certain where the value is near a rounding tie; numbers with an exponent are left out.
        """
        size = np.abs(values)
        decades = np.searchsorted(_DECADES, size, side="right")
        decimals = len(_DECADES) - decades
        scaled = size * _SCALES[decimals]
        certain = np.abs(scaled - np.floor(scaled) - 0.5) > _NEAR_A_TIE
        certain &= (decades > 0) & (scaled < _SCALES[DIGITS] - 1.0)
        digits = np.where(certain, np.rint(scaled), 0.0).astype(np.int64)
        cells = digits << writing.DECIMALS_BITS | decimals
        is_zero = (size == 0.0) & ~np.signbit(values)
        return np.where(is_zero, 0, np.where(values < 0.0, -cells, cells)), certain | is_zero

    @staticmethod
    def float_texts(values: list[float]) -> list[bytes]:
        """Any number."""
        return [cell(value).encode() for value in values]
