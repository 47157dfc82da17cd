"""Lines from columns: the same bytes as `ridlink.captures.lines` writes, many times as fast."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ridlink.captures.export.aligned import AlignedRows
from ridlink.captures.export.chosen import chosen_rows, pack_records
from ridlink.captures.export.framed import framed_line
from ridlink.captures.export.jsonl import JsonRows
from ridlink.captures.export.rows import Rows
from ridlink.captures.export.selection import Selection
from ridlink.captures.export.si import columns_of
from ridlink.captures.fast import writing
from ridlink.captures.fast.block import Block
from ridlink.captures.fast.calling import plain
from ridlink.captures.lines import json_line, table_line
from ridlink.captures.messages import MessageRecord

GROWTH = 1.25

_FORMS: dict[str, tuple[type[Rows], Callable[[MessageRecord], bytes]]] = {
    "jsonl": (JsonRows, json_line),
    "table": (AlignedRows, table_line),
}
"""By format: the class that writes many lines at once, and the function that writes one line."""


class BlockLines:
    """Writes the messages of blocks as lines.

    Args:
        selection: Which messages to write.
        output_format: ``jsonl`` or ``table``.
        frames: Add the bytes of each frame, in hexadecimal, as ``frame`` of JSON.
    """

    def __init__(self, selection: Selection, output_format: str = "jsonl", *, frames: bool = False) -> None:
        self._selection = selection
        self._rows, self._line_of = _FORMS[output_format]
        self._frames = frames
        self._by_message = np.empty(0, np.uint8)
        self._in_order = np.empty(0, np.uint8)

    def of(self, block: Block) -> memoryview:
        """Lines of a block, in the order of the file; valid until the next block."""
        starts, ends = np.zeros(block.count, np.int64), np.zeros(block.count, np.int64)
        at = 0
        for layout, entries, rows in chosen_rows(block, self._selection):
            lines = self._rows(len(rows))
            lines.head(layout, rows, block.times[entries], block.transport)
            if layout.spec is None:
                lines.payloads(columns_of(layout, rows)["payload"].to_list())
            else:
                lines.fields(columns_of(layout, rows))
            if self._frames:
                lines.literal(',"frame":')
                lines.texts([block.frame(entry).hex() for entry in entries.tolist()])
            lines.finish()
            self._by_message = _with_room(self._by_message, at, lines.longest())
            at = lines.write(self._by_message, at, entries, starts, ends)
        for entry, records in pack_records(block, self._selection):
            made = b"".join(map(self._single, records))
            self._by_message = _with_room(self._by_message, at, len(made))
            self._by_message[at : at + len(made)] = np.frombuffer(made, np.uint8)
            starts[entry], ends[entry] = at, at + len(made)
            at += len(made)
        self._in_order = _with_room(self._in_order, 0, at)
        length = writing.put_in_order(plain(self._by_message), plain(starts), plain(ends), plain(self._in_order))
        return self._in_order.data[:length]

    def _single(self, record: MessageRecord) -> bytes:
        line = self._line_of(record)
        return framed_line(line, record) if self._frames else line


def _with_room(buffer: np.ndarray, used: int, more: int) -> np.ndarray:
    """The buffer, or a larger one with what is used of it."""
    if used + more <= len(buffer):
        return buffer
    larger = np.empty(int(GROWTH * (used + more)), np.uint8)
    larger[:used] = buffer[:used]
    return larger
