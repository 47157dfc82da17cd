"""Frames to messages of the generated dialect, and back.

The tables below are derived from the metadata that mavgen writes into ``dialect``; no field is described twice. Values
are what the XML says: integers of the wire, floats, ``bytes`` for arrays of ``uint8_t`` and ``char``, tuples for other
arrays. Units are the XML's; SI begins in ``ridlink.remote_id``.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from ridlink.errors import PayloadError, UnknownMessageError
from ridlink.mavlink import dialect
from ridlink.mavlink.frames import Frame, encode_frame

_BYTES_TYPES = ("uint8_t", "char")


@dataclass(frozen=True, slots=True)
class MessageSpec:
    """How one message lies on the wire. ``fields`` are in wire order; ``array_lengths`` is 0 for a scalar."""

    msgid: int
    name: str
    crc_extra: int
    fields: tuple[str, ...]
    types: tuple[str, ...]
    array_lengths: tuple[int, ...]
    xml_fields: tuple[str, ...]
    units: dict[str, str]
    layout: struct.Struct
    plain: bool
    """No field is an array of numbers: the unpacked tuple is the fields."""

    @property
    def size(self) -> int:
        """Length of the full payload in bytes."""
        return self.layout.size


def _derive(message: Any) -> MessageSpec:
    # mavgen gives fieldtypes in XML order, array_lengths and native_format in wire order
    type_of = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    wire = tuple(message.ordered_fieldnames)
    types = tuple(type_of[name] for name in wire)
    lengths = tuple(message.array_lengths)
    codes = message.native_format.decode()[1:]
    layout = "<"
    plain = True
    for code, kind, length in zip(codes, types, lengths, strict=True):
        if length == 0:
            layout += "c" if kind == "char" else code
        elif kind in _BYTES_TYPES:
            layout += f"{length}s"
        else:
            layout += f"{length}{code}"
            plain = False
    return MessageSpec(
        message.id,
        message.msgname,
        message.crc_extra,
        wire,
        types,
        lengths,
        tuple(message.fieldnames),
        dict(message.fieldunits_by_name),
        struct.Struct(layout),
        plain,
    )


MESSAGES: dict[int, MessageSpec] = {msgid: _derive(cls) for msgid, cls in dialect.mavlink_map.items()}
"""Every message of the dialect by id."""

MESSAGES_BY_NAME: dict[str, MessageSpec] = {spec.name: spec for spec in MESSAGES.values()}

CRC_EXTRAS: dict[int, int] = {msgid: spec.crc_extra for msgid, spec in MESSAGES.items()}


class Message:
    """A decoded message: its fields as attributes, ``name`` and ``msgid`` beside them."""

    __slots__ = ("fields", "msgid", "name")

    def __init__(self, name: str, msgid: int, fields: dict[str, Any]) -> None:
        self.name = name
        self.msgid = msgid
        self.fields = fields

    def __getattr__(self, field: str) -> Any:
        try:
            return self.fields[field]
        except KeyError:
            raise AttributeError(f"{self.name} has no field {field!r}") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Message) and self.name == other.name and self.fields == other.fields

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"{self.name}({', '.join(f'{name}={value!r}' for name, value in self.fields.items())})"


def decode_payload(spec: MessageSpec, payload: bytes) -> dict[str, Any]:
    """Fields of a payload in wire order; bytes that MAVLink 2 cut off are zero, bytes beyond the dialect's are ignored."""
    size = spec.layout.size
    if len(payload) < size:
        payload = payload.ljust(size, b"\x00")
    elif len(payload) > size:
        payload = payload[:size]
    values = spec.layout.unpack(payload)
    if spec.plain:
        return dict(zip(spec.fields, values, strict=True))
    fields: dict[str, Any] = {}
    at = 0
    for name, kind, length in zip(spec.fields, spec.types, spec.array_lengths, strict=True):
        if length == 0 or kind in _BYTES_TYPES:
            fields[name] = values[at]
            at += 1
        else:
            fields[name] = values[at : at + length]
            at += length
    return fields


def decode_message(frame: Frame) -> Message:
    """The message in a frame.

    Raises:
        UnknownMessageError: If the dialect has no such message.
    """
    spec = MESSAGES.get(frame.msgid)
    if spec is None:
        raise UnknownMessageError(frame.msgid)
    return Message(spec.name, spec.msgid, decode_payload(spec, frame.payload))


def encode_payload(spec: MessageSpec, fields: dict[str, Any]) -> bytes:
    """Full payload of a message; fields not given are zero.

    Raises:
        PayloadError: If a field is unknown, out of range, or an array has the wrong length.
    """
    values: list[Any] = []
    given = 0
    for name, kind, length in zip(spec.fields, spec.types, spec.array_lengths, strict=True):
        value = fields.get(name)
        if value is None:
            if length == 0:
                values.append(b"\x00" if kind == "char" else 0)
            elif kind in _BYTES_TYPES:
                values.append(b"")
            else:
                values.extend((0,) * length)
            given += name in fields
            continue
        given += 1
        if length == 0:
            values.append(value)
        elif kind in _BYTES_TYPES:
            value = value.encode() if isinstance(value, str) else bytes(value)
            if len(value) > length:
                raise PayloadError(
                    f"{spec.name}.{name} takes {length} bytes, not {len(value)}", message=spec.name, field=name
                )
            values.append(value)
        else:
            if len(value) != length:
                raise PayloadError(
                    f"{spec.name}.{name} takes {length} values, not {len(value)}", message=spec.name, field=name
                )
            values.extend(value)
    if given != len(fields):
        unknown = sorted(set(fields) - set(spec.fields))
        raise PayloadError(f"{spec.name} has no field {unknown[0]!r}", message=spec.name, field=unknown[0])
    try:
        return spec.layout.pack(*values)
    except (struct.error, OverflowError) as error:
        raise PayloadError(f"{spec.name}: {error}", message=spec.name, field=_culprit(spec, fields)) from error


def _culprit(spec: MessageSpec, fields: dict[str, Any]) -> str:
    """The first field that does not fit its type, for the error text."""
    for name, value in fields.items():
        index = spec.fields.index(name)
        code = dialect.mavlink_map[spec.msgid].native_format.decode()[1 + index]
        for single in value if spec.array_lengths[index] and spec.types[index] not in _BYTES_TYPES else (value,):
            if spec.types[index] in _BYTES_TYPES and spec.array_lengths[index]:
                continue
            try:
                struct.pack("<" + code, single)
            except (struct.error, OverflowError):
                return name
    return ""


def message_spec(name: str) -> MessageSpec:
    """Specification of a message by name.

    Raises:
        UnknownMessageError: If the dialect has no such message.
    """
    try:
        return MESSAGES_BY_NAME[name]
    except KeyError:
        raise UnknownMessageError(name) from None


class Encoder:
    """Messages of one component to MAVLink 2 frames, with its running sequence number."""

    __slots__ = ("compid", "seq", "sysid")

    def __init__(self, sysid: int, compid: int) -> None:
        self.sysid = sysid
        self.compid = compid
        self.seq = 0

    def encode(self, name: str, /, **fields: Any) -> bytes:
        """One frame.

        Raises:
            UnknownMessageError: If the dialect has no such message.
            PayloadError: If a field does not fit.
        """
        spec = message_spec(name)
        payload = encode_payload(spec, fields)
        frame = encode_frame(
            spec.msgid, payload, spec.crc_extra, seq=self.seq, sysid=self.sysid, compid=self.compid
        )
        self.seq = (self.seq + 1) & 0xFF
        return frame
