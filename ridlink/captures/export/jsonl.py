"""JSON lines from columns: what `ridlink.captures.lines.json_line` writes, byte by byte, many times as fast."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import msgspec
import numpy as np

from ridlink.captures.export.si import columns_of, converters
from ridlink.captures.fast.blocks import Block
from ridlink.captures.fast.tables import layouts
from ridlink.captures.lines import exact_seconds

_NO_TIME = 2**64 - 1
_NULL = msgspec.Raw(b"null")
_encode_lines = msgspec.json.Encoder().encode_lines


class _Row(msgspec.Struct, gc=False):
    t: Any
    src: str
    seq: int
    type: str
    id: int
    fields: Any


class _UnknownRow(msgspec.Struct, gc=False):
    t: Any
    src: str
    seq: int
    type: str
    id: int
    fields: dict[str, Any]
    payload: str


@cache
def _fields_type(slot: int) -> Any:
    """A structure with the fields of a message, which encodes several times as fast as a dictionary."""
    names = list(converters(layouts()[slot]))
    places = [f"f{index}" for index in range(len(names))]
    return msgspec.defstruct(f"Fields{slot}", places, rename=dict(zip(places, names, strict=True)), gc=False)


def _times(times: np.ndarray) -> list[msgspec.Raw]:
    """Exact seconds of each message; its digits are written for all messages at once where they are equally many."""
    if not len(times) or times.min() < 10**15 or times.max() >= 10**16:
        return [_NULL if t == _NO_TIME else msgspec.Raw(exact_seconds(t).encode()) for t in times.tolist()]
    digits = np.empty((len(times), 17), np.uint8)
    digits[:, 10] = ord(".")
    rest = times.copy()
    for place in (*range(16, 10, -1), *range(9, -1, -1)):
        rest, digit = np.divmod(rest, np.uint64(10))
        digits[:, place] = digit + np.uint64(ord("0"))
    return list(map(msgspec.Raw, digits.view("S17").ravel().tolist()))


@cache
def _source(key: int) -> str:
    return f"{key & 0xFF}/{key >> 8}"


def json_lines(block: Block, chosen: np.ndarray | None = None) -> bytes:
    """Lines of the frames of a block, in the order of the file.

    Args:
        block: The block.
        chosen: Which of its frames to write; all where ``None``.
    """
    lines = np.empty(block.count, object)
    made: Iterator[_Row | _UnknownRow]
    for slot, _ in block.present():
        entries = block.entries(slot)
        if chosen is not None and not chosen[entries].any():
            continue
        layout, rows = layouts()[slot], block.columns(slot)
        if chosen is not None:
            keep = chosen[entries]
            entries, rows = entries[keep], rows[keep]
        count = len(rows)
        times = _times(block.times[entries])
        sources = list(map(_source, (rows["sysid"] | rows["compid"].astype(np.uint16) << 8).tolist()))
        seqs = rows["seq"].tolist()
        if layout.spec is None:
            payloads = [
                payload[:length].tobytes().hex()
                for payload, length in zip(rows["payload"], rows["length"].tolist(), strict=True)
            ]
            made = map(
                _UnknownRow, times, sources, seqs, [layout.name] * count, rows["msgid"].tolist(), [{}] * count, payloads
            )
        else:
            values = [column.to_list() for column in columns_of(layout, rows).values()]
            fields = map(_fields_type(slot), *values)
            made = map(_Row, times, sources, seqs, [layout.name] * count, [layout.spec.msgid] * count, fields)
        lines[entries] = list(made)
    found = lines.tolist() if chosen is None else lines[chosen].tolist()
    return _encode_lines(found)
