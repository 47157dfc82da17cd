r"""JSON lines back to frames: the inverse of `ridlink.captures.lines`.

A line with the bytes of its frame (``decode --frames``) gives exactly those. For any other line, the frame is encoded
from its fields: MAVLink 2, unsigned, trailing zeros cut off, sequence number and source as in the line. This is the
decoded frame, if it had that form and the line has all of its values. A line does not have: signatures and the version;
payloads of messages that are not in the dialect; ``target_system`` and ``target_component`` of Open Drone ID; values
out of their range, which read as unknown; NaN and infinity, which are ``null``; and the fact that a sender itself wrote
``\xNN`` as four characters.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import fields as struct_fields

from ridlink.captures.broadcasts import RECEIVER_COMPONENT
from ridlink.captures.messages import UNKNOWN
from ridlink.captures.tlog import MAX_TIME_US
from ridlink.errors import PayloadError, WireError
from ridlink.mavlink.codec import CRC_EXTRAS, MessageSpec, encode_payload, message_spec
from ridlink.mavlink.frames import Frame, encode_frame, parse_datagram
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import MAVLINK_NAMES, RemoteIdMessage

_ESCAPE = re.compile(rb"\\x([0-9a-f]{2})")
_TIME = re.compile(rb"(\d{1,14})(?:\.(\d{1,6}))?")
_SI_TYPES = {name: kind for kind, name in MAVLINK_NAMES.items()}


class TimedFrame(NamedTuple):
    """A frame and its time, ``None`` if the line has none; ``data`` are the 25 bytes of a broadcast."""

    time_us: int | None
    frame: bytes
    data: bytes | None


class _Line(msgspec.Struct):
    type: str
    t: msgspec.Raw = msgspec.Raw(b"null")
    src: str | None = None
    seq: int = 0
    fields: dict[str, Any] = {}
    frame: str | None = None
    hex: str | None = None


_decode = msgspec.json.Decoder(_Line).decode


def frame_of_line(line: bytes) -> TimedFrame | None:
    """The frame of one line; ``None`` for a member of a message pack, which is in the frame of the pack.

    Raises:
        WireError: If `decode` does not write such lines, or a value does not fit.
    """
    try:
        row = _decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise WireError(str(error)) from error
    time_us = _time_us(bytes(row.t))
    data = None if row.hex is None else _unhex(row.hex, "hex")
    if row.frame is not None:
        return TimedFrame(time_us, _whole_frame(_unhex(row.frame, "frame")), data)
    if data is not None and row.src is not None:
        return None
    if row.type == UNKNOWN:
        raise WireError("a message that the dialect does not have needs its frame: decode it with --frames")
    name, fields = _mavlink_fields(row)
    spec = message_spec(name)
    sysid, compid = (0, RECEIVER_COMPONENT) if row.src is None else _source(row.src)
    if not 0 <= row.seq <= 255:
        raise WireError(f"seq is 0 to 255, not {row.seq}")
    payload = encode_payload(spec, fields)
    frame = encode_frame(spec.msgid, payload, spec.crc_extra, seq=row.seq, sysid=sysid, compid=compid)
    return TimedFrame(time_us, frame, data)


def _time_us(text: bytes) -> int | None:
    """Microseconds of a JSON number of seconds, exactly."""
    if text == b"null":
        return None
    found = _TIME.fullmatch(text)
    if found is None:
        raise WireError(f"t is not a number of seconds: {text[:40].decode(errors='replace')}")
    time_us = int(found[1]) * 1_000_000 + int((found[2] or b"").ljust(6, b"0"))
    if time_us > MAX_TIME_US:
        raise WireError("t is beyond what a tlog can hold")
    return time_us


def _unhex(text: str, name: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise WireError(f"{name} is not hexadecimal") from error


def _whole_frame(raw: bytes) -> bytes:
    found = parse_datagram(raw, CRC_EXTRAS, limit=1)
    if not found or not isinstance(found[0], Frame) or len(found[0].raw) != len(raw):
        raise WireError("frame is not one whole MAVLink frame")
    return raw


def _source(text: str) -> tuple[int, int]:
    try:
        sysid, compid = (int(part) for part in text.split("/"))
    except ValueError as error:
        raise WireError(f"src is system/component, not {text[:40]!r}") from error
    if not (0 <= sysid <= 255 and 0 <= compid <= 255):
        raise WireError(f"src is two numbers of 0 to 255, not {text[:40]!r}")
    return sysid, compid


def _mavlink_fields(row: _Line) -> tuple[str, dict[str, Any]]:
    """Name and wire fields of a line."""
    kind = _SI_TYPES.get(row.type)
    if kind is None:
        spec = message_spec(row.type)
        return row.type, {name: _wire_value(spec, name, value) for name, value in row.fields.items()}
    converts, needed = _si_form(kind)
    given = {name: value for name, value in row.fields.items() if value is not None or name in needed}
    try:
        values: dict[str, Any] = {k: v if v is None else converts[k](v) for k, v in given.items()}
        message = kind(**values)
        return to_mavlink(message)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise PayloadError(f"{row.type}: {error}", message=row.type) from error


@cache
def _si_form(kind: type[RemoteIdMessage]) -> tuple[dict[str, Callable[[Any], Any]], set[str]]:
    """How the values of each field become what they were, and which fields must be given.

    A null is what the default stands for; what has none, as the time of an authentication, is given as unknown.
    """
    found: dict[str, Callable[[Any], Any]] = {name: lambda value: value for name in kind.__struct_fields__}
    found |= {name: from_text for name in ("uas_id", "description", "operator_id") if name in found}
    found |= {name: bytes.fromhex for name in ("authentication_data", "id_or_mac") if name in found}
    return found, {item.name for item in struct_fields(kind) if item.required}


def from_text(text: str) -> bytes:
    """Bytes of a displayed text; only escapes of the form ``\\xNN`` are decoded.

    Raises:
        WireError: If it is no displayed text.
    """

    def unescape(found: re.Match[bytes]) -> bytes:
        code = int(found[1], 16)
        return found[0] if 0x20 <= code <= 0x7E else bytes((code,))

    try:
        return _ESCAPE.sub(unescape, text.encode("latin-1"))
    except UnicodeEncodeError as error:
        raise WireError(f"{text[:40]!r} has characters that no byte stands for") from error


def _wire_value(spec: MessageSpec, name: str, value: Any) -> Any:
    if name not in spec.zeros:
        raise PayloadError(f"{spec.name} has no field {name!r}", message=spec.name, field=name)
    index = spec.fields.index(name)
    if spec.types[index] == "char":
        if not isinstance(value, str):
            raise PayloadError(f"{spec.name}.{name} is a text", message=spec.name, field=name)
        raw = from_text(value)
        return raw if spec.array_lengths[index] else raw.ljust(1, b"\x00")
    if spec.types[index] in ("float", "double"):
        if isinstance(value, list):
            return [float("nan") if item is None else item for item in value]
        return float("nan") if value is None else value
    return value
