"""Messages of a capture as plain fields, in the order of the file and under the names of JSON lines.

What is built of several messages (one row for each update of an aircraft, tracks on a map) takes them from here,
whatever the capture is: files of MAVLink come through the fast path, everything else through the readers of records.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ridlink.captures.export.chosen import chosen_frames
from ridlink.captures.export.selection import Selection
from ridlink.captures.export.si import columns_of
from ridlink.captures.fast.blocks import Block
from ridlink.captures.fast.tables import layouts

_TIMES_END_US = 2**63


class Fields(NamedTuple):
    """One message.

    Attributes:
        time_us: Microseconds since 1970, ``None`` where it has no time.
        transport: What carried it: ``mavlink``, or the radio technology of a broadcast.
        source: Who sent it: ``system/component``, or the address of a radio.
        name: Message name.
        fields: Its fields, in SI where it is about Remote ID, ``None`` for unknown.
    """

    time_us: int | None
    transport: str
    source: str
    name: str
    fields: dict[str, Any]


def fields_of_block(block: Block, selection: Selection) -> Iterator[Fields]:
    """Messages of a block that the dialect knows, in the order of the file."""
    chosen = chosen_frames(selection, block)
    found = np.empty(block.count, object)
    for slot, _ in block.present():
        layout, entries = layouts()[slot], block.entries(slot)
        if layout.spec is None or (chosen is not None and not chosen[entries].any()):
            continue
        rows = block.columns(slot)
        if chosen is not None:
            keep = chosen[entries]
            entries, rows = entries[keep], rows[keep]
        columns = columns_of(layout, rows)
        values = zip(*(column.to_list() for column in columns.values()), strict=True)
        heads = zip(block.times[entries].tolist(), rows["sysid"].tolist(), rows["compid"].tolist(), values, strict=True)
        for entry, (time_us, sysid, compid, row) in zip(entries.tolist(), heads, strict=True):
            fields = dict(zip(columns, row, strict=True))
            found[entry] = Fields(
                time_us if time_us < _TIMES_END_US else None, "mavlink", f"{sysid}/{compid}", layout.name, fields
            )
    return (message for message in found.tolist() if message is not None)
