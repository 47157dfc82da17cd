"""Bytes taken eight at a time: how the loops of this package load them, and the checksum over them.

The checksum takes eight bytes at a time too (slicing by eight: one table for each distance from the end of the word),
and starts with a word that is filled up *in front* with zeros, so that no loop over single bytes is left.

Without a compiler (NUMBA_DISABLE_JIT=1) all of this runs as plain Python on memoryviews and lists.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ridlink.captures import statistics, tlog
from ridlink.compiled import kernel_decorator

_MODULES = ("loading", "scanning", "copying")
"""Modules whose kernels call each other."""

kernel = kernel_decorator(
    [
        *(Path(__file__).with_name(f"{name}.py") for name in _MODULES),
        Path(statistics.__file__),  # their constants are compiled in
        Path(tlog.__file__),
    ]
)

MARGIN = 512
"""Bytes that must exist in a buffer before and after those that are loaded; their values do not matter."""


@kernel(forceinline=True)
def load(data: Any, at: Any) -> Any:
    """Eight bytes as the number whose first byte is the lowest."""
    at = np.uint64(at)  # an unsigned index cannot count from the end: one load instead of eight
    return (
        np.uint64(data[at])
        | np.uint64(data[at + np.uint64(1)]) << np.uint64(8)
        | np.uint64(data[at + np.uint64(2)]) << np.uint64(16)
        | np.uint64(data[at + np.uint64(3)]) << np.uint64(24)
        | np.uint64(data[at + np.uint64(4)]) << np.uint64(32)
        | np.uint64(data[at + np.uint64(5)]) << np.uint64(40)
        | np.uint64(data[at + np.uint64(6)]) << np.uint64(48)
        | np.uint64(data[at + np.uint64(7)]) << np.uint64(56)
    )


@kernel(forceinline=True)
def byte_of(word: Any, place: Any) -> Any:
    """One byte of what `load` gave."""
    return np.int64(word >> np.uint64(8 * place) & np.uint64(0xFF))


@kernel(forceinline=True)
def checksum(data: Any, start: Any, end: Any, extra: Any, table: Any, initial: Any) -> Any:
    """CRC-16/MCRF4XX over ``data[start:end]`` and then over ``extra``; at least one byte."""
    missing = -(end - start) & 7
    value = initial[missing]
    at = start - missing
    word = load(data, at) & (np.uint64(2**64 - 1) << np.uint64(8 * missing))
    while True:
        # what does not hang on the checksum so far comes first: it can be done ahead
        # np.uint64 everywhere: a sum of it and a number of Python is a float in NumPy 1
        ahead = (
            (
                table[np.uint64(1280) + (word >> np.uint64(16) & np.uint64(255))]
                ^ table[np.uint64(1024) + (word >> np.uint64(24) & np.uint64(255))]
            )
            ^ (
                table[np.uint64(768) + (word >> np.uint64(32) & np.uint64(255))]
                ^ table[np.uint64(512) + (word >> np.uint64(40) & np.uint64(255))]
            )
            ^ (table[np.uint64(256) + (word >> np.uint64(48) & np.uint64(255))] ^ table[word >> np.uint64(56)])
        )
        word ^= np.uint64(value)
        value = ahead ^ (
            table[np.uint64(1792) + (word & np.uint64(255))]
            ^ table[np.uint64(1536) + (word >> np.uint64(8) & np.uint64(255))]
        )
        at += 8
        if at >= end:
            break
        word = load(data, at)
    return value >> 8 ^ table[(value ^ extra) & 255]
