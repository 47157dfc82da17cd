"""Message packs: up to nine of the 25-byte messages in one broadcast, behind three bytes of header.

    byte 0    type 0xF, protocol version
    byte 1    size of a single message: 25
    byte 2    how many: 1 to 9

Reading never raises, whatever was received. A damaged or unknown member affects no other member, and a pack that ends
early yields its complete members.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ridlink.errors import PayloadError
from ridlink.remote_id.astm import MESSAGE_LENGTH, Refusal, encode_message, refusal_of
from ridlink.remote_id.astm_fields import MessageType, header
from ridlink.remote_id.messages import RemoteIdMessage

HEADER_LENGTH = 3
MAX_MEMBERS = 9
MAX_PACK_LENGTH = HEADER_LENGTH + MAX_MEMBERS * MESSAGE_LENGTH


@dataclass(frozen=True, slots=True)
class Member:
    """25 bytes for `ridlink.remote_id.astm.decode_message`, and their index in the pack; 0 for a single message."""

    index: int
    data: bytes


@dataclass(frozen=True, slots=True)
class BadMember:
    """A member, or the rest of a pack from this member on, that was not taken, and the reason."""

    index: int
    refusal: Refusal


def is_pack(data: bytes) -> bool:
    """The first byte says message pack."""
    return data[:1] >= b"\xf0"


def split_broadcast(data: bytes) -> list[Member | BadMember]:
    """The messages of one broadcast (a message pack or a single message), in order; never raises.

    Bytes behind the last message do not belong to it and are ignored.
    """
    if not is_pack(data):
        return [_member(0, data[:MESSAGE_LENGTH])]
    if len(data) < HEADER_LENGTH:
        return [BadMember(0, Refusal.TRUNCATED_PACK)]
    size, count = data[1], data[2]
    if size != MESSAGE_LENGTH:
        return [BadMember(0, Refusal.BAD_MESSAGE_SIZE)]
    if not 1 <= count <= MAX_MEMBERS:
        return [BadMember(0, Refusal.BAD_MESSAGE_COUNT)]
    found: list[Member | BadMember] = []
    for index in range(count):
        start = HEADER_LENGTH + index * MESSAGE_LENGTH
        if len(data) < start + MESSAGE_LENGTH:
            found.append(BadMember(index, Refusal.TRUNCATED_PACK))
            break
        found.append(_member(index, data[start : start + MESSAGE_LENGTH]))
    return found


def _member(index: int, data: bytes) -> Member | BadMember:
    refusal = refusal_of(data)
    return Member(index, data) if refusal is None else BadMember(index, refusal)


def join_pack(members: Sequence[bytes]) -> bytes:
    """The pack of these 25-byte messages.

    Raises:
        PayloadError: If there are none or more than nine, or one of them is no message.
    """
    if not 1 <= len(members) <= MAX_MEMBERS:
        raise PayloadError(f"a message pack has 1 to {MAX_MEMBERS} messages, not {len(members)}")
    for member in members:
        refusal = refusal_of(member)
        if refusal is not None:
            raise PayloadError(f"no member of a message pack: {refusal} ({member.hex()})")
    return bytes((header(MessageType.PACK), MESSAGE_LENGTH, len(members))) + b"".join(members)


def encode_pack(messages: Sequence[RemoteIdMessage], *, hour_start_s: int | None = None) -> bytes:
    """The pack of these messages.

    Args:
        messages: One to nine messages.
        hour_start_s: As for `ridlink.remote_id.astm.encode_message`.

    Raises:
        PayloadError: If their number is wrong, or one of them does not fit.
    """
    return join_pack([encode_message(message, hour_start_s=hour_start_s) for message in messages])
