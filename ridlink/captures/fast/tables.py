"""Tables for the kernels: checksum tables, and the layout of the messages of the dialect in columns.

All are computed on first use, from the polynomial and from the metadata of the generated dialect.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ridlink.captures.fast.calling import plain
from ridlink.captures.fast.copying import HEAD_LENGTH
from ridlink.captures.messages import UNKNOWN
from ridlink.captures.records import BAD_TIMESTAMP
from ridlink.mavlink.codec import MESSAGES, MessageSpec
from ridlink.mavlink.frames import Cause

POLYNOMIAL_REFLECTED = 0x8408
MAX_PAYLOAD_LENGTH = 255

CAUSES: tuple[str, ...] = (
    Cause.GARBAGE,
    Cause.BAD_CHECKSUM,
    Cause.INCOMPATIBLE_FLAGS,
    Cause.UNKNOWN_UNCONFIRMED,
    Cause.TRUNCATED,
    BAD_TIMESTAMP,
)
"""Causes of rejects, by the numbers that the kernels give them."""

_HEAD: dict[str, tuple[str, int]] = {
    "t_us": ("<i8", 0),
    "sysid": ("u1", 17),
    "compid": ("u1", 18),
    "seq": ("u1", 16),
    "offset": ("<i8", 8),
}
_NUMPY_TYPES = {"float": "<f4", "double": "<f8", "char": "S", "uint8_t": "u1", "int8_t": "i1", "uint16_t": "<u2",
                "int16_t": "<i2", "uint32_t": "<u4", "int32_t": "<i4", "uint64_t": "<u8", "int64_t": "<i8"}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where one message lies in a record.

    Attributes:
        name: Message, or ``UNKNOWN`` for all that the dialect does not have.
        spec: The message; ``None`` for ``UNKNOWN``.
        dtype: Of the records: ``t_us, sysid, compid, seq, offset``, then the fields in the order of the XML.
        size: Length of the full payload in bytes.
        words: The same in words of eight bytes, rounded up.
    """

    name: str
    spec: MessageSpec | None
    dtype: np.dtype[Any]
    size: int
    words: int


def column_of(field: str) -> str:
    """Name of the column of a field: its own, or with ``_field`` where the head has the name already (``seq``)."""
    return f"{field}_field" if field in _HEAD else field


def _layout(spec: MessageSpec) -> Layout:
    places: dict[str, tuple[Any, int]] = {}
    at = HEAD_LENGTH
    for name, kind, length in zip(spec.fields, spec.types, spec.array_lengths, strict=True):
        item = f"S{max(length, 1)}" if kind == "char" else _NUMPY_TYPES[kind]
        places[name] = ((item, (length,)) if length and kind != "char" else item, at)
        at += np.dtype(places[name][0]).itemsize
    columns = {**_HEAD, **{column_of(name): places[name] for name in spec.xml_fields}}
    return _packed(spec.name, spec, columns, spec.size)


def _packed(name: str, spec: MessageSpec | None, columns: dict[str, tuple[Any, int]], size: int) -> Layout:
    words = -(-size // 8)
    dtype = np.dtype(
        {
            "names": list(columns),
            "formats": [kind for kind, _ in columns.values()],
            "offsets": [at for _, at in columns.values()],
            "itemsize": HEAD_LENGTH + 8 * words,
        }
    )
    return Layout(name, spec, dtype, size, words)


@cache
def layouts() -> tuple[Layout, ...]:
    """Layouts by slot; slot 0 is ``UNKNOWN``."""
    unknown = {
        **_HEAD,
        "msgid": ("<u4", 20),
        "length": ("u1", 19),
        "payload": (("u1", (MAX_PAYLOAD_LENGTH,)), HEAD_LENGTH),
    }
    return (
        _packed(UNKNOWN, None, unknown, MAX_PAYLOAD_LENGTH),
        *(_layout(MESSAGES[msgid]) for msgid in sorted(MESSAGES)),
    )


@cache
def slot_of() -> dict[str, int]:
    """Slots by the names of their messages."""
    return {layout.name: slot for slot, layout in enumerate(layouts())}


@cache
def slot_by_id() -> dict[int, int]:
    """Slots by message id."""
    return {layout.spec.msgid: slot for slot, layout in enumerate(layouts()) if layout.spec is not None}


@cache
def id_table() -> np.ndarray:
    """By message id: slot and, in the lowest eight bits, CRC_EXTRA; 0 for what the dialect does not have."""
    table = np.zeros(max(MESSAGES) + 1, np.int32)
    for msgid, slot in slot_by_id().items():
        table[msgid] = slot << 8 | MESSAGES[msgid].crc_extra
    return table


@cache
def for_scanning() -> tuple[Any, Any, Any]:
    """What the kernels that scan look up: `id_table`, `checksum_table` and `initial_table`."""
    return plain(id_table()), plain(checksum_table()), plain(initial_table())


@cache
def checksum_table() -> np.ndarray:
    """Eight tables of 256: the checksum, begun with 0, of a byte with 0 to 7 zero bytes after it."""
    table = np.zeros((8, 256), np.uint16)
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ (POLYNOMIAL_REFLECTED if value & 1 else 0)
        table[0, byte] = value
    for distance in range(1, 8):
        before = table[distance - 1]
        table[distance] = before >> 8 ^ table[0][before & 0xFF]
    return table.ravel()


@cache
def initial_table() -> np.ndarray:
    """By n, the state from which n zero bytes lead to 0xFFFF, with which a checksum begins: the checksum run back."""
    table = checksum_table()
    byte_of = {int(table[byte]) >> 8: byte for byte in range(256)}
    states = [0xFFFF]
    for _ in range(7):
        byte = byte_of[states[-1] >> 8]
        states.append((states[-1] ^ int(table[byte])) << 8 & 0xFF00 | byte)
    return np.array(states, np.uint16)
