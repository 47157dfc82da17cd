"""A selection applied to the frames of a block."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ridlink.captures.export.selection import Selection
from ridlink.captures.fast.block import Block
from ridlink.captures.fast.scanning import NO_TIME
from ridlink.captures.fast.tables import Layout, layouts, slot_of
from ridlink.captures.messages import MessageRecord, decode_records
from ridlink.captures.records import Origin, TracedRecord
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.convert import MESSAGE_PACK


def chosen_rows(block: Block, selection: Selection) -> Iterator[tuple[Layout, np.ndarray, np.ndarray]]:
    """Records of a block that are selected, by message: layout, places among the frames of the block, records.

    Message packs are left to `pack_records`, for their members are messages too.
    """
    keep = chosen_frames(block, selection)
    for slot, _ in block.present():
        layout, entries = layouts()[slot], block.entries(slot)
        if layout.name == MESSAGE_PACK or (selection.names is not None and layout.name not in selection.names):
            continue
        if keep is None:
            yield layout, entries, block.columns(slot)
            continue
        kept = keep[entries]
        if kept.any():
            yield layout, entries[kept], block.columns(slot)[kept]


def chosen_frames(block: Block, selection: Selection) -> np.ndarray | None:
    """Mask of the frames whose sender and time are selected; ``None`` for all."""
    if selection.source_system is None and selection.since_us is None and selection.until_us is None:
        return None
    keep = np.ones(block.count, np.bool_)
    if selection.source_system is not None:
        keep &= block.sysids() == selection.source_system
    if selection.since_us is not None or selection.until_us is not None:
        keep &= block.times != NO_TIME
    if selection.since_us is not None:
        keep &= block.times >= _limit(selection.since_us)
    if selection.until_us is not None:
        keep &= block.times < _limit(selection.until_us)
    return keep


def _limit(time_us: int) -> np.uint64:
    """A limit as times are: no frame that has a time lies beyond either end of those."""
    return np.uint64(min(max(time_us, 0), int(NO_TIME)))


def pack_records(block: Block, selection: Selection) -> Iterator[tuple[int, list[MessageRecord]]]:
    """Message packs of a block, each with its place and those of it and its members that are selected."""
    for entry in block.entries(slot_of()[MESSAGE_PACK]).tolist():
        frame = parse_datagram(block.frame(entry), CRC_EXTRAS, limit=1)[0]
        assert isinstance(frame, Frame)
        time_us = None if block.times[entry] == NO_TIME else int(block.times[entry])
        record = TracedRecord(time_us, frame, block.offset(entry), Origin(block.transport))
        records = decode_records([record])
        if chosen := [record for record in records if selection.takes(record)]:
            yield entry, chosen
