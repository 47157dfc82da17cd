"""The 25-byte messages that Open Drone ID broadcasts (ASTM F3411, ASD-STAN EN 4709-002) to SI and back.

The first byte is the message type (high half) and the protocol version (low half). Versions 0 to 2 have the layouts
below. Fields that an older version reserved are zero, which reads as unknown. An unknown newer version is read as the
newest known one and counted under ``MESSAGE.protocol_version``. Reserved bytes are ignored, reserved codes are kept as
numbers.

Reading and writing follow the rules of ``convert``. A sentinel becomes ``None``; so does a field out of its range,
which is also counted and affects no other field. Values are rounded to the nearest unit; accuracies, errors, sizes and
areas are rounded to the safe side. A value that does not fit saturates or is sent as unknown. A code or text that does
not fit its bits raises a `PayloadError`.

RIDLINK_SEPARATION has no message type of its own (see ``separation``). Message packs are in ``astm_pack``.

Source: ASTM F3411-22a; compared byte for byte with opendroneid-core-c.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from enum import StrEnum
from typing import Any

from ridlink.errors import PayloadError
from ridlink.remote_id import identities, location, messages, system
from ridlink.remote_id.astm_fields import NEWEST_VERSION, MessageType
from ridlink.remote_id.messages import MAVLINK_NAMES, RemoteIdMessage
from ridlink.remote_id.quantities import FieldRejects
from ridlink.remote_id.separation import authentication_of, separation_of

MESSAGE_LENGTH = 25


class Refusal(StrEnum):
    """Why bytes were not taken as a message or pack."""

    WRONG_LENGTH = "wrong_length"
    UNKNOWN_TYPE = "unknown_message_type"
    BAD_PAGE = "bad_authentication_page"
    NESTED_PACK = "nested_pack"
    BAD_MESSAGE_SIZE = "bad_message_size"
    BAD_MESSAGE_COUNT = "bad_message_count"
    TRUNCATED_PACK = "truncated_pack"


def refusal_of(data: bytes) -> Refusal | None:
    """Why these bytes are no message, ``None`` if they are one: then `decode_message` does not raise."""
    if len(data) != MESSAGE_LENGTH:
        return Refusal.WRONG_LENGTH
    kind = data[0] >> 4
    if kind == MessageType.PACK:
        return Refusal.NESTED_PACK
    if kind not in _READERS:
        return Refusal.UNKNOWN_TYPE
    if kind == MessageType.AUTHENTICATION and data[1] & 0x0F == 0 and data[2] > identities.LAST_PAGE:
        return Refusal.BAD_PAGE
    return None


def decode_message(
    data: bytes, rejects: FieldRejects | None = None, *, id_or_mac: bytes | None = None
) -> RemoteIdMessage:
    """The message in 25 bytes, in SI units.

    Args:
        data: 25 bytes.
        rejects: Counts fields that were not taken, and versions that are not known.
        id_or_mac: The transmitter that was heard, for the field of the message.

    Raises:
        PayloadError: If the length is not 25 bytes, the type is unknown, or the page number is impossible.
    """
    refusal = refusal_of(data)
    if refusal is not None:
        raise PayloadError(f"no Open Drone ID message: {refusal} ({data[:MESSAGE_LENGTH].hex()})")
    counted: FieldRejects = Counter() if rejects is None else rejects
    message = _READERS[data[0] >> 4](data, counted, id_or_mac)
    if data[0] & 0x0F > NEWEST_VERSION:
        counted[f"{MAVLINK_NAMES[type(message)]}.protocol_version"] += 1
    return message


def encode_message(message: RemoteIdMessage, *, hour_start_s: int | None = None) -> bytes:
    """The 25 bytes of a message, protocol version 2. ``id_or_mac`` is not part of them.

    An accuracy code of 0 whose bound is given is derived from the bound.

    Args:
        message: The message.
        hour_start_s: Start of the present full hour [s since 2019-01-01 UTC]. A `Separation` counts its time from the
            full hour, the 25 bytes count from 2019; without this argument the time is sent as unknown.

    Raises:
        PayloadError: If a code, count or text does not fit.
    """
    if isinstance(message, messages.Separation):
        message = authentication_of(message, hour_start_s)
    return _WRITERS[type(message)](message)


def _read_authentication(data: bytes, rejects: FieldRejects, id_or_mac: bytes | None) -> RemoteIdMessage:
    message = identities.authentication_from_bytes(data, rejects, id_or_mac)
    return separation_of(message) or message


_Reader = Callable[[bytes, FieldRejects, bytes | None], RemoteIdMessage]
_Writer = Callable[[Any], bytes]

_FORMS: dict[MessageType, tuple[type, _Reader, _Writer]] = {
    MessageType.BASIC_ID: (messages.BasicId, identities.basic_id_from_bytes, identities.basic_id_to_bytes),
    MessageType.LOCATION: (messages.Location, location.from_bytes, location.to_bytes),
    MessageType.AUTHENTICATION: (messages.Authentication, _read_authentication, identities.authentication_to_bytes),
    MessageType.SELF_ID: (messages.SelfId, identities.self_id_from_bytes, identities.self_id_to_bytes),
    MessageType.SYSTEM: (messages.System, system.from_bytes, system.to_bytes),
    MessageType.OPERATOR_ID: (messages.OperatorId, identities.operator_id_from_bytes, identities.operator_id_to_bytes),
}
_READERS: dict[int, _Reader] = {kind: read for kind, (_, read, _) in _FORMS.items()}
_WRITERS: dict[type, _Writer] = {message: write for message, _, write in _FORMS.values()}
