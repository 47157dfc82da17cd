"""The loops over every character: rows of numbers and texts become lines, and the lines of a block get their order.

A line is a chain of literals with a cell after each but the last. A cell is one integer, whatever it stands for:

    WHOLE    the number
    TIME     microseconds, written as seconds with all six decimals
    DECIMAL  ten-millionths, written with as many decimals as it has, and at least one
    SIGNIFICANT
             digits, and in the lowest four bits how many of them are decimals; written without zeros at the end
    TEXT     the place of a text in the table of texts

A cell of any but WHOLE that is ``FIRST_TEXT`` or more stands for the text at ``cell - FIRST_TEXT``: so a column of
numbers can have ``null`` in it, and numbers that somebody else has written.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ridlink.compiled import kernel_decorator

kernel = kernel_decorator([Path(__file__)])

WHOLE, TIME, DECIMAL, SIGNIFICANT, TEXT = range(5)
FIRST_TEXT = 1 << 62
DECIMALS = 7
DECIMALS_BITS = 4
LONGEST_NUMBER = 24
"""Characters of a number at most, whoever has written it."""

_TEN = np.uint64(10)
_ZERO = np.uint64(ord("0"))


@kernel(forceinline=True)
def copy(source: Any, start: Any, end: Any, out: Any, at: Any) -> Any:
    """Append bytes; the byte after them."""
    first, place = np.uint64(start), np.uint64(at)  # an unsigned index cannot count from the end
    for index in range(end - start):
        out[place + np.uint64(index)] = source[first + np.uint64(index)]
    return at + (end - start)


@kernel(forceinline=True)
def write_digits(value: Any, out: Any, at: Any, count: Any) -> Any:
    """Append the last ``count`` decimal digits of an unsigned number; the byte after them."""
    place = at + count
    while place > at:
        place -= 1
        rest = value // _TEN
        out[place] = value - rest * _TEN + _ZERO
        value = rest
    return at + count


@kernel(forceinline=True)
def write_number(value: Any, out: Any, at: Any) -> Any:
    """Append all digits of an unsigned number; the byte after them."""
    count = 1
    rest = value // _TEN
    while rest:
        count += 1
        rest //= _TEN
    return write_digits(value, out, at, count)


@kernel
def write_lines(
    cells: Any, kinds: Any, rows: Any, literals: Any, literal_bounds: Any, texts: Any, text_bounds: Any, entries: Any,
    out: Any, at: Any, starts: Any, ends: Any,
) -> Any:  # fmt: skip
    """Append the lines of one message to ``out[at:]``; the byte after them.

    Args:
        cells: Cells, column by column.
        kinds: Kind of each column.
        rows: How many lines.
        literals, literal_bounds: What stands before each column and after the last, and where each of it begins.
        texts, text_bounds: The table of texts, and where each begins.
        entries: Place of each line in the file: there ``starts`` and ``ends`` get its first byte and that after it.
        out, at: Where the lines go, and the first byte that is free.
    """
    columns = len(kinds)
    for row in range(rows):
        starts[entries[row]] = at
        for column in range(columns):
            at = copy(literals, literal_bounds[column], literal_bounds[column + 1], out, at)
            cell = cells[column * rows + row]
            kind = kinds[column]
            if kind != WHOLE and (kind == TEXT or cell >= FIRST_TEXT):
                text = cell & (FIRST_TEXT - 1)
                at = copy(texts, text_bounds[text], text_bounds[text + 1], out, at)
                continue
            if cell < 0:
                out[at] = ord("-")
                at += 1
                cell = -cell
            value = np.uint64(cell)
            if kind == WHOLE:
                at = write_number(value, out, at)
                continue
            if kind == TIME:
                decimals = least = 6
            elif kind == DECIMAL:
                decimals, least = DECIMALS, 1
            else:
                decimals, least = cell & (1 << DECIMALS_BITS) - 1, 0
                value >>= np.uint64(DECIMALS_BITS)
            while decimals > least and value % _TEN == 0:
                value //= _TEN
                decimals -= 1
            scale = np.uint64(1)
            for _ in range(decimals):
                scale *= _TEN
            whole = value // scale
            at = write_number(whole, out, at)
            if decimals > 0:
                out[at] = ord(".")
                at = write_digits(value - whole * scale, out, at + 1, decimals)
        at = copy(literals, literal_bounds[columns], literal_bounds[columns + 1], out, at)
        ends[entries[row]] = at
    return at


@kernel
def put_in_order(lines: Any, starts: Any, ends: Any, out: Any) -> Any:
    """Lines by their places; how many bytes they have."""
    at = 0
    for entry in range(len(starts)):
        at = copy(lines, starts[entry], ends[entry], out, at)
    return at
