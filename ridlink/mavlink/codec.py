"""Frames to messages of the generated dialect, and back.

The tables below are derived from the metadata that mavgen writes into ``dialect``; no field is described twice. Values
are those of the XML: wire integers, floats (NaN and infinity are legal), ``bytes`` of full length for arrays of
``uint8_t`` and ``char``, tuples for other arrays. Units are those of the XML; ``ridlink.remote_id`` converts to SI.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from ridlink.errors import PayloadError, UnknownMessageError
from ridlink.mavlink import dialect
from ridlink.mavlink.frames import Frame, encode_frame

_BYTES_TYPES = ("uint8_t", "char")


@dataclass(frozen=True, slots=True)
class MessageSpec:
    """Wire layout of one message. ``fields`` are in wire order; ``array_lengths`` is 0 for a scalar."""

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
    """Whether no field is an array of numbers: then the unpacked tuple has one value per field."""
    zeros: dict[str, Any] = field(repr=False)
    """All fields with the value zero, in wire order."""
    arrays: tuple[tuple[str, bool, int], ...] = field(repr=False)
    """Array fields: name, whether its values are bytes, length."""

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
    zeros: dict[str, Any] = {}
    arrays: list[tuple[str, bool, int]] = []
    for name, code, kind, length in zip(wire, codes, types, lengths, strict=True):
        is_bytes = kind in _BYTES_TYPES
        if length == 0:
            layout += "c" if kind == "char" else code
            zeros[name] = b"\x00" if kind == "char" else 0
        else:
            layout += f"{length}s" if is_bytes else f"{length}{code}"
            zeros[name] = bytes(length) if is_bytes else (0,) * length
            arrays.append((name, is_bytes, length))
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
        all(is_bytes for _, is_bytes, _ in arrays),
        zeros,
        tuple(arrays),
    )


MESSAGES: dict[int, MessageSpec] = {msgid: _derive(cls) for msgid, cls in dialect.mavlink_map.items()}
"""Every message of the dialect by id."""

MESSAGES_BY_NAME: dict[str, MessageSpec] = {spec.name: spec for spec in MESSAGES.values()}

CRC_EXTRAS: dict[int, int] = {msgid: spec.crc_extra for msgid, spec in MESSAGES.items()}


class Message:
    """A decoded message: its fields as attributes, and ``name`` and ``msgid``.

    A field that is itself called ``name`` (as in NAMED_VALUE_FLOAT) is read as ``message.fields["name"]``.
    """

    __slots__ = ("fields", "msgid", "name")

    def __init__(self, name: str, msgid: int, fields: dict[str, Any]) -> None:
        self.name = name
        self.msgid = msgid
        self.fields = fields

    def __getattr__(self, field: str) -> Any:
        if field in Message.__slots__:  # not set yet, for example while unpickling
            raise AttributeError(field)
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
    """Fields of a payload in wire order; bytes that MAVLink 2 cut off are zero, extra bytes at the end are ignored."""
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

    Args:
        spec: The message.
        fields: Values by name. Arrays of bytes take ``bytes`` (or integers, or text) up to their length and are filled
            up with zeros; other arrays take exactly their number of values.

    Raises:
        PayloadError: If a field is unknown, of the wrong type or out of range, or an array has the wrong length.
    """
    merged = {**spec.zeros, **fields}
    if len(merged) != len(spec.zeros):
        unknown = next(name for name in fields if name not in spec.zeros)
        raise PayloadError(f"{spec.name} has no field {unknown!r}", message=spec.name, field=unknown)
    for name, is_bytes, length in spec.arrays:
        if name not in fields:
            continue
        value = merged[name] = _array(spec, name, is_bytes, fields[name])
        if len(value) > length or (len(value) < length and not is_bytes):
            unit = "bytes" if is_bytes else "values"
            text = f"{spec.name}.{name} takes {length} {unit}, not {len(value)}"
            raise PayloadError(text, message=spec.name, field=name)
    try:
        if spec.plain:
            return spec.layout.pack(*merged.values())
        return spec.layout.pack(*_flat(spec, merged))
    except (struct.error, OverflowError) as error:
        name = _culprit(spec, merged)
        raise PayloadError(f"{spec.name}.{name}: {error}", message=spec.name, field=name) from error


def _array(spec: MessageSpec, name: str, is_bytes: bool, value: Any) -> bytes | tuple[Any, ...]:
    """Value of an array field as ``bytes`` or tuple."""
    try:
        if not is_bytes:
            return tuple(value)
        if isinstance(value, bytes):
            return value
        return value.encode() if isinstance(value, str) else bytes(iter(value))
    except (TypeError, ValueError) as error:
        raise PayloadError(f"{spec.name}.{name}: {error}", message=spec.name, field=name) from error


def _flat(spec: MessageSpec, fields: dict[str, Any]) -> Iterable[Any]:
    """Values in wire order, with the arrays of numbers spread out."""
    numbers = {name for name, is_bytes, _ in spec.arrays if not is_bytes}
    for name, value in fields.items():
        if name in numbers:
            yield from value
        else:
            yield value


def _culprit(spec: MessageSpec, fields: dict[str, Any]) -> str:
    """The first field that does not fit its type, for the error text."""
    for name, value in fields.items():
        try:
            spec.layout.pack(*_flat(spec, {**spec.zeros, name: value}))
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
        raise UnknownMessageError(name, MESSAGES_BY_NAME) from None


class Encoder:
    """Encodes the messages of one component as MAVLink 2 frames, with its running sequence number.

    Raises:
        ValueError: If an id is not in 0..255.
    """

    __slots__ = ("compid", "seq", "sysid")

    def __init__(self, sysid: int, compid: int) -> None:
        if not (0 <= sysid <= 255 and 0 <= compid <= 255):
            raise ValueError(f"system and component id are 0 to 255, not {sysid} and {compid}")
        self.sysid = sysid
        self.compid = compid
        self.seq = 0

    def encode(self, name: str, /, **fields: Any) -> bytes:
        """One frame.

        Args:
            name: Name of the message in the XML.
            fields: Fields by their names and in the units of the XML; those left out are 0.

        Raises:
            UnknownMessageError: If the dialect has no such message.
            PayloadError: If there is no such field, or a value does not fit.
        """
        spec = message_spec(name)
        payload = encode_payload(spec, fields)
        frame = encode_frame(spec.msgid, payload, spec.crc_extra, seq=self.seq, sysid=self.sysid, compid=self.compid)
        self.seq = (self.seq + 1) & 0xFF
        return frame
