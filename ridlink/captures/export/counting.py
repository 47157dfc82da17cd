"""Counts the contents of blocks: the same counts as `Statistics.count`, many times as fast.

Equal counts are sorted by first occurrence, so that the tables have the same order, too. Members of message packs are
decoded one by one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator
from functools import lru_cache
from operator import itemgetter
from typing import Any

import numpy as np

from ridlink.captures.export.chosen import chosen_frames
from ridlink.captures.export.selection import Selection
from ridlink.captures.export.si import HAVE_RANGES, out_of_range
from ridlink.captures.fast.block import Block
from ridlink.captures.fast.scanning import NO_TIME
from ridlink.captures.fast.sources import count_sources
from ridlink.captures.fast.tables import Layout, layouts, slot_of
from ridlink.captures.statistics import Statistics
from ridlink.mavlink.codec import MESSAGES_BY_NAME, Message
from ridlink.remote_id.astm import decode_message
from ridlink.remote_id.bridge import pack_members
from ridlink.remote_id.convert import MESSAGE_PACK
from ridlink.remote_id.messages import MAVLINK_NAMES

_Met = tuple[int, Counter[Any], Hashable, int]
"""From this place of the block on: counter, key, and how many more of it."""


def count_block(statistics: Statistics, block: Block, selection: Selection) -> None:
    """Take the messages of a block that are selected."""
    keep = chosen_frames(block, selection)
    counted = np.zeros(block.count, np.bool_)
    met: list[_Met] = []
    for slot, _ in block.present():
        layout, entries = layouts()[slot], block.entries(slot)
        if selection.names is not None and layout.name not in selection.names:
            continue
        kept = slice(None) if keep is None else keep[entries]
        entries = entries[kept]
        if len(entries):
            if layout.name in HAVE_RANGES:
                met += _fields_met(statistics, layout, entries, block.columns(slot)[kept])
            counted[entries] = True
            met.append((int(entries[0]), statistics.types, layout.name, len(entries)))
            if layout.spec is not None:
                statistics.ids[layout.name] = layout.spec.msgid
    met += _unknown_met(statistics, block, counted)
    met += _members_met(statistics, block, selection, keep)
    for _, counter, key, count in sorted(met, key=itemgetter(0)):
        counter[key] += count
    count_sources(statistics.sources, *(head[counted] for head in block.heads()))
    counted[[place for place, counter, _, _ in met if counter is statistics.types]] = True  # members have times as well
    times = block.times[counted & (block.times != NO_TIME)]
    if len(times):
        statistics.span(int(times.min()), int(times.max()))


def _fields_met(statistics: Statistics, layout: Layout, entries: np.ndarray, rows: np.ndarray) -> Iterator[_Met]:
    for name, refused in out_of_range(layout, rows):
        if refused.any():
            yield int(entries[refused.argmax()]), statistics.fields, name, int(refused.sum())


def _unknown_met(statistics: Statistics, block: Block, counted: np.ndarray) -> Iterator[_Met]:
    entries = block.entries(0)
    taken = counted[entries]
    if taken.any():
        entries = entries[taken]
        found = np.unique(block.columns(0)["msgid"][taken], return_index=True, return_counts=True)
        for msgid, first, count in zip(*(part.tolist() for part in found), strict=True):
            yield int(entries[first]), statistics.unknown, msgid, count


def _members_met(statistics: Statistics, block: Block, selection: Selection, keep: np.ndarray | None) -> Iterator[_Met]:
    """Members of message packs, and those that were not taken; the packs themselves are frames like others."""
    slot = slot_of()[MESSAGE_PACK]
    entries, rows = block.entries(slot), block.columns(slot)
    columns = (rows[name].tolist() for name in ("single_message_size", "msg_pack_size"))
    for entry, size, count, messages in zip(entries.tolist(), *columns, rows["messages"], strict=True):
        if keep is not None and not keep[entry]:
            continue
        untaken: Counter[str] = Counter()
        pack = {"single_message_size": size, "msg_pack_size": count, "messages": messages.tobytes()}
        members = pack_members(Message(MESSAGE_PACK, MESSAGES_BY_NAME[MESSAGE_PACK].msgid, pack), untaken)
        if selection.names is None or MESSAGE_PACK in selection.names:
            for refusal in untaken.elements():
                yield entry, statistics.fields, refusal, 1
        for member in members:
            name, refused = _member(member.data)
            if selection.names is None or name in selection.names:
                statistics.ids[name] = MESSAGES_BY_NAME[name].msgid
                yield entry, statistics.types, name, 1
                for field in refused:
                    yield entry, statistics.fields, field, 1


@lru_cache(maxsize=4096)
def _member(data: bytes) -> tuple[str, tuple[str, ...]]:
    """Name of a message of 25 bytes, and its fields that are out of range; senders repeat themselves."""
    fields: Counter[str] = Counter()
    return MAVLINK_NAMES[type(decode_message(data, fields))], tuple(fields.elements())
