"""Conversion between the two wire forms of Remote ID: 25-byte broadcasts and MAVLink.

A MAVLink message holds one Remote ID message, except OPEN_DRONE_ID_MESSAGE_PACK, which wraps a pack of 25-byte
messages. A stock receiver relays our RIDLINK_SEPARATION as OPEN_DRONE_ID_AUTHENTICATION, the form that it has on the
radio. `messages_of` reads all of these; feed the messages that it returns to the `ReportAssembler` one by one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from msgspec.structs import replace

from ridlink.mavlink.codec import MESSAGES_BY_NAME, Message
from ridlink.remote_id.astm import MESSAGE_LENGTH, decode_message
from ridlink.remote_id.astm_fields import MessageType, header
from ridlink.remote_id.astm_pack import HEADER_LENGTH, MAX_PACK_LENGTH, Member, encode_pack, split_broadcast
from ridlink.remote_id.convert import MESSAGE_PACK, from_mavlink
from ridlink.remote_id.location import TIMESTAMP_STEP_S
from ridlink.remote_id.messages import MAVLINK_NAMES, Authentication, Location, RemoteIdMessage, Separation
from ridlink.remote_id.quantities import SECONDS_PER_HOUR, FieldRejects, read_id_or_mac, write_id_or_mac
from ridlink.remote_id.separation import separation_of

REMOTE_ID_IDS = frozenset(MESSAGES_BY_NAME[name].msgid for name in (*MAVLINK_NAMES.values(), MESSAGE_PACK))
"""Messages that `messages_of` reads, by message id."""


def messages_of(message: Message, rejects: FieldRejects | None = None) -> list[RemoteIdMessage]:
    """The Remote ID messages in a MAVLink message, in SI units: none, one, or the members of a pack.

    Args:
        message: Decoded MAVLink message.
        rejects: Counts fields and members of packs that were not taken, under ``MESSAGE.field`` and
            ``OPEN_DRONE_ID_MESSAGE_PACK.cause``.
    """
    if message.name == MESSAGE_PACK:
        return read_members(pack_members(message, rejects), rejects, id_or_mac=sender_of(message))
    single = from_mavlink(message, rejects)
    if single is None:
        return []
    if isinstance(single, Authentication):
        return [separation_of(single) or single]
    return [single]


def sender_of(pack: Message) -> bytes | None:
    """``id_or_mac`` of an OPEN_DRONE_ID_MESSAGE_PACK, ``None`` if the pack is the sender's own."""
    return read_id_or_mac(pack.fields["id_or_mac"])


def pack_members(message: Message, rejects: FieldRejects | None = None) -> list[Member]:
    """The good members of an OPEN_DRONE_ID_MESSAGE_PACK; the others are counted."""
    fields = message.fields
    head = bytes((header(MessageType.PACK), fields["single_message_size"], fields["msg_pack_size"]))
    members: list[Member] = []
    for item in split_broadcast(head + fields["messages"]):
        if isinstance(item, Member):
            members.append(item)
        elif rejects is not None:
            rejects[f"{MESSAGE_PACK}.{item.refusal}"] += 1
    return members


def pack_to_mavlink(
    messages: Sequence[RemoteIdMessage], *, id_or_mac: bytes | None = None, hour_start_s: int | None = None
) -> tuple[str, dict[str, Any]]:
    """Name and fields of the OPEN_DRONE_ID_MESSAGE_PACK of these messages, addressed to everybody.

    Args:
        messages: One to nine messages.
        id_or_mac: Whose they are, ``None`` for the sender's own.
        hour_start_s: As for `ridlink.remote_id.astm.encode_message`.

    Raises:
        PayloadError: If their number is wrong, or one of them does not fit.
    """
    pack = encode_pack(messages, hour_start_s=hour_start_s)
    return MESSAGE_PACK, {
        "target_system": 0,
        "target_component": 0,
        "id_or_mac": write_id_or_mac(id_or_mac),
        "single_message_size": MESSAGE_LENGTH,
        "msg_pack_size": len(messages),
        "messages": pack[HEADER_LENGTH:].ljust(MAX_PACK_LENGTH - HEADER_LENGTH, b"\x00"),
    }


def read_members(
    members: Sequence[Member], rejects: FieldRejects | None = None, *, id_or_mac: bytes | None = None
) -> list[RemoteIdMessage]:
    """The messages of the members of one pack, in SI units.

    On the radio RIDLINK_SEPARATION has its time in whole seconds. If it is in one pack with its LOCATION, it takes the
    time of the LOCATION, provided that both can be the same instant or its own time is unknown. So the two are joined
    as they would be over MAVLink.
    """
    counted: FieldRejects = Counter() if rejects is None else rejects
    messages = [decode_message(member.data, counted, id_or_mac=id_or_mac) for member in members]
    timestamps = [message.timestamp_s for message in messages if isinstance(message, Location)]
    if len(timestamps) != 1 or timestamps[0] is None:
        return messages
    timestamp_s = timestamps[0]
    belonging = (None, *whole_seconds_of(timestamp_s))
    return [
        replace(message, timestamp_s=timestamp_s)
        if isinstance(message, Separation) and message.timestamp_s in belonging
        else message
        for message in messages
    ]


def whole_seconds_of(location_s: float) -> tuple[int, int]:
    """The two whole seconds after the full hour in which a 25-byte LOCATION may have been made; they may be equal.

    Its time is rounded to a tenth, up or down: 12.96 s, which is in second 12, becomes 13.0 s.
    """
    earliest_s, latest_s = location_s - TIMESTAMP_STEP_S / 2.0, location_s + TIMESTAMP_STEP_S / 2.0
    return math.floor(earliest_s % SECONDS_PER_HOUR), math.floor(latest_s % SECONDS_PER_HOUR)
