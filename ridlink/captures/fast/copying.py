"""The loops that copy frames which were found into columns, and columns into frames.

Payloads of MAVLink lie on the wire as C structures lie in memory, so a record of a column array is a head of 24 bytes
and the payload as it came, filled up with zeros: decoding is copying, eight bytes at a time.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from typing import Any

import numpy as np

from ridlink.captures.fast.loading import byte_of, checksum, kernel, load
from ridlink.captures.tlog import TIME_LENGTH

HEAD_LENGTH = 24
"""Bytes of a record before its payload: time, offset, and eight bytes of sequence number, ids and length."""

_ALL = np.uint64(2**64 - 1)


@kernel
def group(slots: Any, count: Any, bounds: Any, order: Any) -> None:
    """Entries of the index by slot: those of slot ``s`` are ``order[bounds[s]:bounds[s + 1]]``, in file order."""
    for place in range(len(bounds)):
        bounds[place] = 0
    for entry in range(count):
        bounds[slots[entry] + 1] += 1
    total = 0
    for place in range(len(bounds)):
        here = bounds[place]
        bounds[place] = total  # where the slot before begins, moved on below while it is filled
        total += here
    for entry in range(count):
        place = slots[entry] + 1
        order[bounds[place]] = entry
        bounds[place] += 1


@kernel
def gather(
    data: Any, base: Any, order: Any, first: Any, stop: Any, starts: Any, times: Any, size: Any, words: Any, out: Any,
    row: Any,
) -> None:  # fmt: skip
    """Copy frames ``order[first:stop]`` of one slot into ``out[row:]``; the layout is that of ``tables``."""
    for place in range(first, stop):
        entry = order[place]
        start = np.int64(starts[entry])
        head = load(data, start)
        length = byte_of(head, 1)
        if byte_of(head, 0) == 0xFD:
            payload = start + 10
            source = head >> np.uint64(32) & np.uint64(0xFFFFFF)
            msgid = load(data, start + 7) & np.uint64(0xFFFFFF)
        else:
            payload = start + 6
            source = head >> np.uint64(16) & np.uint64(0xFFFFFF)
            msgid = head >> np.uint64(40) & np.uint64(0xFF)
        out[row, 0] = times[entry]
        out[row, 1] = base + start
        out[row, 2] = source | np.uint64(length) << np.uint64(24) | msgid << np.uint64(32)
        length = min(length, size)
        whole = length >> 3
        for word in range(whole):
            out[row, 3 + word] = load(data, payload + 8 * word)
        if whole < words:
            rest = np.uint64(8 * (length & 7))
            out[row, 3 + whole] = load(data, payload + 8 * whole) & ~(_ALL << rest)
            for word in range(whole + 1, words):
                out[row, 3 + word] = 0
        row += 1


@kernel
def pack(
    rows: Any, msgid: Any, size: Any, extra: Any, table: Any, initial: Any, timed: Any, out: Any, at: Any
) -> Any:  # fmt: skip
    """Write records as MAVLink 2 frames into ``out[at:]``, each after its time where ``timed``; the byte after them.

    ``rows`` are the bytes of the records. Trailing zeros of a payload are cut off, its first byte stays.
    """
    for row in range(len(rows)):
        if timed:
            for index in range(TIME_LENGTH):
                out[at + index] = rows[row, TIME_LENGTH - 1 - index]
            at += TIME_LENGTH
        length = size
        while length > 1 and rows[row, HEAD_LENGTH + length - 1] == 0:
            length -= 1
        out[at] = 0xFD
        out[at + 1] = length
        out[at + 2] = 0
        out[at + 3] = 0
        out[at + 4] = rows[row, 16]
        out[at + 5] = rows[row, 17]
        out[at + 6] = rows[row, 18]
        out[at + 7] = msgid & 0xFF
        out[at + 8] = msgid >> 8 & 0xFF
        out[at + 9] = msgid >> 16
        end = at + 10 + length
        for index in range(length):
            out[at + 10 + index] = rows[row, HEAD_LENGTH + index]
        value = np.int64(checksum(out, at + 1, end, extra, table, initial))
        out[end] = value & 0xFF
        out[end + 1] = value >> 8
        at = end + 2
    return at
