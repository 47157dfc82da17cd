"""Messages of captures as plain fields, in the order of the file and under the names of JSON lines.

Exports that combine several messages (one row for each update of an aircraft, tracks on a map) read them here, for
every format of capture: MAVLink files use the fast path, all others the readers of records.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ridlink.captures.export.chosen import chosen_rows, pack_records
from ridlink.captures.export.selection import Selection
from ridlink.captures.export.si import columns_of
from ridlink.captures.fast.block import Block
from ridlink.captures.lines import fields_of
from ridlink.captures.messages import MessageRecord

TIMES_END_US = 2**63


class Fields(NamedTuple):
    """One message.

    Attributes:
        time_us: Microseconds since 1970, ``None`` if it has no time.
        transport: Its transport, ``None`` if the capture does not say.
        source: Its sender: ``system/component``, or the address of a radio.
        seq: Its sequence number; for a broadcast, its message counter.
        offset: Byte, packet or line of the file.
        name: Message name.
        fields: Its fields, in SI if it is Remote ID, ``None`` for unknown.
        is_25_bytes: Whether it came as 25 bytes, alone or in a pack: times are then tenths, or whole seconds in
            SEPARATION.
    """

    time_us: int | None
    transport: str | None
    source: str
    seq: int | None
    offset: int
    name: str
    fields: dict[str, Any]
    is_25_bytes: bool = False


def fields_of_block(block: Block, selection: Selection) -> Iterator[Fields]:
    """Messages of a block, in the order of the file."""
    found = np.empty(block.count, object)
    for layout, entries, rows in chosen_rows(block, selection):
        columns = columns_of(layout, rows)
        values = zip(*(column.to_list() for column in columns.values()), strict=True)
        heads = [rows[name].tolist() for name in ("sysid", "compid", "seq", "offset")]
        for entry, time_us, sysid, compid, seq, offset, row in zip(
            entries.tolist(), block.times[entries].tolist(), *heads, values, strict=True
        ):
            found[entry] = Fields(
                time_us if time_us < TIMES_END_US else None, block.transport, f"{sysid}/{compid}", seq, offset,
                layout.name, dict(zip(columns, row, strict=True)),
            )  # fmt: skip
    for entry, records in pack_records(block, selection):
        found[entry] = list(fields_of_records(records))
    for message in found.tolist():
        if isinstance(message, list):
            yield from message
        elif message is not None:
            yield message


def fields_of_records(records: Iterable[MessageRecord]) -> Iterator[Fields]:
    """Messages of records; those that are not in the dialect have their id and their payload in hexadecimal."""
    for record in records:
        origin = record.origin
        seq: int | None = record.frame.seq
        source = f"{record.source[0]}/{record.source[1]}"
        if record.is_broadcast and origin is not None:
            source, seq = origin.mac.hex(":") or "unknown", origin.counter
        time_us = record.time_us if record.time_us is None or record.time_us < TIMES_END_US else None
        transport = None if origin is None else origin.transport
        is_25_bytes = origin is not None and origin.data is not None
        fields = fields_of(record)
        if record.message is None:
            fields = {"msgid": record.frame.msgid, "payload": record.frame.payload.hex()}
        yield Fields(time_us, transport, source, seq, record.offset, record.name, fields, is_25_bytes)
