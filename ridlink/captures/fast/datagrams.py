"""Contents of packets as blocks: the frames of many datagrams at once.

All datagrams are scanned as one stream. If frames fill a datagram from its first byte to its last, these are its
frames, since a stream takes no frame that a datagram would not. `ridlink.captures.packets` parses every other datagram.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ridlink.captures.fast import loading, scanning, tables
from ridlink.captures.fast.block import SHORTEST_FRAME, Block, Index, frame_ends, with_margins
from ridlink.captures.fast.calling import announce, plain
from ridlink.captures.fast.scanning import NO_TIME
from ridlink.captures.packets import UDP_TRANSPORT, Datagram, read_contents, records_of
from ridlink.captures.records import Record, Rejects

MOST, MOST_BYTES = 8192, 512 * 1024
"""Datagrams of a block."""

FEWEST = 256
"""Fewer between other things are not worth one."""


def read_blocks(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Block | list[Record]]:
    """What `ridlink.captures.packets.read_pcap` reads, in blocks where many datagrams follow each other.

    Args:
        chunks: The file from its first byte.
        rejects: As for `read_pcap`; complete at the end.

    Raises:
        CaptureError: As `read_pcap`.
    """
    datagrams: list[Datagram] = []
    size = 0
    for item in read_contents(chunks, rejects):
        if isinstance(item, Datagram):
            datagrams.append(item)
            size += len(item.payload)
            if len(datagrams) < MOST and size < MOST_BYTES:
                continue
        yield from _taken(datagrams, rejects)
        datagrams, size = [], 0
        if not isinstance(item, Datagram):
            yield [item]
    yield from _taken(datagrams, rejects)


def _taken(datagrams: Sequence[Datagram], rejects: Rejects) -> Iterator[Block | list[Record]]:
    if len(datagrams) < FEWEST:
        records: list[Record] = [record for datagram in datagrams for record in records_of(datagram, rejects)]
        if records:
            yield records
    elif (block := block_of_datagrams(datagrams, rejects)).count:
        yield block


def block_of_datagrams(datagrams: Sequence[Datagram], rejects: Rejects) -> Block:
    """The frames of datagrams; what else is in them is counted.

    Args:
        datagrams: One at least, none of them empty.
        rejects: As for `read_blocks`.
    """
    data = with_margins(datagram.payload for datagram in datagrams)
    bounds = np.full(len(datagrams) + 1, loading.MARGIN)
    bounds[1:] += np.cumsum([len(datagram.payload) for datagram in datagrams])
    starts, slots = _as_stream(data, int(bounds[-1]))
    ends = frame_ends(data, starts)
    owners = np.searchsorted(bounds, starts, "right") - 1
    is_filled = np.bincount(owners, ends - starts, len(datagrams)) == np.diff(bounds)
    is_filled[owners[ends > bounds[owners + 1]]] = False
    if not is_filled.all():
        alone = [
            (bounds[owner] + record.frame.offset, tables.slot_by_id().get(record.frame.msgid, 0), owner)
            for owner in np.flatnonzero(~is_filled).tolist()
            for record in records_of(datagrams[owner], rejects)
        ]
        kept = is_filled[owners]
        found = np.stack([starts[kept], slots[kept], owners[kept]], 1)
        found = np.concatenate([found, np.array(alone, np.int64).reshape(-1, 3)])
        starts, slots, owners = found[np.argsort(found[:, 0])].T
    times = np.array([NO_TIME if one.time_us is None else one.time_us for one in datagrams], np.uint64)[owners]
    offsets = np.array([datagram.offset for datagram in datagrams], np.uint64)[owners]
    return Block(
        data, 0, starts.astype(np.int32), slots.astype(np.int16), times, len(starts), datagrams[-1].offset, 0, offsets,
        UDP_TRANSPORT,
    )  # fmt: skip


def _as_stream(data: np.ndarray, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts and slots of the frames of a stream."""
    index = Index(len(data) // SHORTEST_FRAME)
    state = scanning.initial_state()
    state[scanning.AT] = loading.MARGIN
    announce(scanning.scan_raw)
    count = scanning.scan_raw(
        plain(data), end, 0, True, *tables.for_scanning(), state, scanning.no_sources(), index.starts, index.slots,
        index.times,
    )  # fmt: skip
    return index.starts[:count].astype(np.int64), index.slots[:count].astype(np.int64)
