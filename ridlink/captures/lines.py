"""Messages as lines: one JSON object each for programs, or one aligned row each for people.

Remote ID and RIDLINK_SEPARATION have SI names, ``null`` for unknown and codes as integers. Every other message keeps
the names and units of the XML. Strings are printable ASCII, with other bytes as ``\\xNN``, so that nothing that a
sender put into them acts on a terminal. Values that are not finite are ``null``, since JSON has no NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec

from ridlink.captures.messages import UNKNOWN, MessageRecord
from ridlink.mavlink.codec import MESSAGES_BY_NAME, Message, MessageSpec
from ridlink.remote_id.messages import MAVLINK_NAMES, RemoteIdMessage
from ridlink.remote_id.text import display_text

TIME_WIDTH, SOURCE_WIDTH, NUMBER_WIDTH, NAME_WIDTH = 27, 7, 3, 27
"""Minimum widths of the first cells of a row, in characters."""

DIGITS = 10
"""Significant digits of a number in a row."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_encode = msgspec.json.Encoder().encode


def _hex_or_none(value: bytes | None) -> str | None:
    return None if value is None else value.hex()


_Convert = Callable[[Any], Any]

_SI_BYTES: dict[str, _Convert] = {
    "uas_id": display_text,
    "description": display_text,
    "operator_id": display_text,
    "authentication_data": _hex_or_none,
    "id_or_mac": _hex_or_none,
}
_SI_FIELDS: dict[type, list[tuple[str, _Convert | None]]] = {
    kind: [(name, _SI_BYTES.get(name)) for name in kind.__struct_fields__] for kind in MAVLINK_NAMES
}


def _xml_convert(spec: MessageSpec, name: str) -> _Convert | None:
    index = spec.fields.index(name)
    if spec.types[index] == "char":
        return display_text
    return list if spec.types[index] == "uint8_t" and spec.array_lengths[index] else None


_XML_FIELDS: dict[str, list[tuple[str, _Convert | None]]] = {
    spec.name: [(name, _xml_convert(spec, name)) for name in spec.xml_fields] for spec in MESSAGES_BY_NAME.values()
}


def si_fields(message: RemoteIdMessage) -> dict[str, Any]:
    """Fields of a Remote ID message under their SI names, fit for JSON."""
    fields: dict[str, Any] = {}
    for name, convert in _SI_FIELDS[type(message)]:
        value = getattr(message, name)
        fields[name] = value if convert is None else convert(value)
    return fields


def xml_fields(message: Message) -> dict[str, Any]:
    """Fields of any message under the names and in the order of the XML, fit for JSON."""
    raw = message.fields
    return {name: raw[name] if convert is None else convert(raw[name]) for name, convert in _XML_FIELDS[message.name]}


def fields_of(record: MessageRecord) -> dict[str, Any]:
    """Fields of a record, in SI if it is Remote ID; none if the message is not in the dialect."""
    if record.remote_id is not None:
        return si_fields(record.remote_id)
    return xml_fields(record.message) if record.message is not None else {}


def exact_seconds(time_us: int | None) -> str:
    """Seconds with all six decimals, or ``null``: an exact JSON number that never was a float."""
    return "null" if time_us is None else f"{time_us // 1_000_000}.{time_us % 1_000_000:06d}"


def json_line(record: MessageRecord) -> bytes:
    """One line of JSON, with its line feed.

    A 25-byte message has its transport and, in ``hex``, its bytes; a message from a MAVLink frame has its source.
    """
    head = f'{{"t":{exact_seconds(record.time_us)},{_came(record)}"type":"{record.name}",'
    if record.is_broadcast:
        return b'%b%b"fields":%b}\n' % (head.encode(), _hex(record), _encode(fields_of(record)))
    if record.message is None:
        payload = record.frame.payload.hex()
        return f'{head}"id":{record.frame.msgid},"fields":{{}},"payload":"{payload}"}}\n'.encode()
    head += f'"id":{record.message.msgid},'
    return b'%b%b"fields":%b}\n' % (head.encode(), _hex(record), _encode(fields_of(record)))


def _came(record: MessageRecord) -> str:
    """How a message was received, as JSON keys: source, transport and transmitter, if there are any."""
    frame, origin = record.frame, record.origin
    source = "" if record.is_broadcast else f'"src":"{frame.sysid}/{frame.compid}","seq":{frame.seq},'
    if origin is None:
        return source
    transport = f'"transport":"{origin.transport}",' if origin.transport else ""
    mac = f'"mac":"{origin.mac.hex(":")}",' if origin.mac else ""
    counter = f'"counter":{origin.counter},' if origin.counter is not None else ""
    index = f'"index":{origin.index},' if origin.data is not None else ""
    return transport + source + mac + counter + index


def _hex(record: MessageRecord) -> bytes:
    origin = record.origin
    return b"" if origin is None or origin.data is None else b'"hex":"%b",' % origin.data.hex().encode()


def clock_time(time_us: int | None) -> str:
    """UTC to the microsecond as ISO 8601; ``-`` for none; plain seconds beyond the end of the calendar."""
    if time_us is None:
        return "-"
    try:
        moment = _EPOCH + timedelta(microseconds=time_us)
    except OverflowError:
        return exact_seconds(time_us)
    return moment.isoformat(timespec="microseconds").replace("+00:00", "Z")


def table_line(record: MessageRecord) -> bytes:
    """One aligned row: time, source, sequence number, message, fields.

    For a broadcast, the source is the transmitter and the number is its message counter.
    """
    frame, origin = record.frame, record.origin
    name = record.name
    if record.message is None:
        name = f"{UNKNOWN} {frame.msgid}"
        text = f"payload={frame.payload.hex()}"
    else:
        text = " ".join(f"{field}={cell(value)}" for field, value in fields_of(record).items())
    source, number = f"{frame.sysid}/{frame.compid}", str(frame.seq)
    if record.is_broadcast and origin is not None:
        source = origin.mac.hex(":") or "-"
        number = "-" if origin.counter is None else str(origin.counter)
    came = f"{clock_time(record.time_us):<{TIME_WIDTH}} {source:>{SOURCE_WIDTH}} {number:>{NUMBER_WIDTH}}"
    return f"{came}  {name:<{NAME_WIDTH}} {text}\n".encode()


def cell(value: Any) -> str:
    """A value as text for a row; ``-`` for unknown."""
    if value is None or value != value:
        return "-"
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{','.join(cell(single) for single in value)}]"
    return str(value)
