"""Typed messages of a capture: MAVLink as in the XML, Remote ID in SI.

An OPEN_DRONE_ID_MESSAGE_PACK is one message; each of its members follows it as a message of its own.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ridlink.captures.broadcasts import id_of
from ridlink.captures.reader import open_capture
from ridlink.captures.records import Origin, Record, TracedRecord
from ridlink.mavlink.codec import MESSAGES, MESSAGES_BY_NAME, Message, decode_payload
from ridlink.mavlink.frames import Frame
from ridlink.remote_id.astm import decode_message
from ridlink.remote_id.astm_pack import Member
from ridlink.remote_id.bridge import pack_members, sender_of
from ridlink.remote_id.convert import MESSAGE_PACK, from_mavlink, to_mavlink
from ridlink.remote_id.messages import RemoteIdMessage
from ridlink.remote_id.quantities import FieldRejects

UNKNOWN = "UNKNOWN"
"""Name of messages that are not in the dialect."""


class MessageRecord(NamedTuple):
    """One message of a capture.

    ``message`` is ``None`` if the id is not in the dialect, ``remote_id`` if the message is not about Remote ID.
    ``time_us`` is microseconds since 1970 (UTC) or ``None``. ``origin`` is set if the message was more than a frame in
    a file, for example a broadcast. For a member of a message pack, ``frame`` is the frame of the pack. ``refused``
    lists fields that were out of range, as ``MESSAGE.field``, and, for a message pack, members that were not taken.
    """

    time_us: int | None
    frame: Frame
    message: Message | None
    remote_id: RemoteIdMessage | None
    offset: int
    origin: Origin | None = None
    refused: tuple[str, ...] = ()

    @property
    def is_broadcast(self) -> bool:
        """Whether it came as 25 bytes, not in a MAVLink frame; ``frame`` is then what a receiver would make of it."""
        return self.origin is not None and self.origin.data is not None and not self.is_member

    @property
    def is_member(self) -> bool:
        """Whether it came in an OPEN_DRONE_ID_MESSAGE_PACK, whose own record precedes it."""
        return self.message is not None and self.message.msgid != self.frame.msgid

    @property
    def name(self) -> str:
        """Name of the message in the XML, or ``UNKNOWN``."""
        return self.message.name if self.message is not None else UNKNOWN

    @property
    def source(self) -> tuple[int, int]:
        """System id and component id."""
        return self.frame.sysid, self.frame.compid


def decode_records(records: Iterable[Record]) -> Iterator[MessageRecord]:
    """Messages of records, as of `open_capture`."""
    refused: FieldRejects = Counter()
    for record in records:
        time_us, frame, offset = record
        origin = record.origin if isinstance(record, TracedRecord) else None
        spec = MESSAGES.get(frame.msgid)
        if spec is None:
            yield MessageRecord(time_us, frame, None, None, offset, origin)
            continue
        message = Message(spec.name, spec.msgid, decode_payload(spec, frame.payload))
        if origin is not None and origin.data is not None:
            said = decode_message(origin.data, refused, id_or_mac=id_of(origin.mac))
            yield MessageRecord(time_us, frame, message, said, offset, origin, _taken(refused))
        elif spec.name == MESSAGE_PACK:
            members = pack_members(message, refused)
            yield MessageRecord(time_us, frame, message, None, offset, origin, _taken(refused))
            yield from _members(record, message, members, origin)
        else:
            remote_id = from_mavlink(message, refused)
            yield MessageRecord(time_us, frame, message, remote_id, offset, origin, _taken(refused))


def _members(pack: Record, message: Message, members: list[Member], origin: Origin | None) -> Iterator[MessageRecord]:
    """The members of an OPEN_DRONE_ID_MESSAGE_PACK, each as if it had been received alone."""
    transport = origin.transport if origin is not None else None
    refused: FieldRejects = Counter()
    for member in members:
        remote_id = decode_message(member.data, refused, id_or_mac=sender_of(message))
        name, fields = to_mavlink(remote_id)
        single = Message(name, MESSAGES_BY_NAME[name].msgid, fields)
        yield MessageRecord(
            pack.time_us, pack.frame, single, remote_id, pack.offset,
            Origin(transport, index=member.index, data=member.data), _taken(refused),
        )  # fmt: skip


def _taken(refused: FieldRejects) -> tuple[str, ...]:
    """The refused fields of one message; clears the counter."""
    if not refused:
        return ()
    names = tuple(refused.elements())
    refused.clear()
    return names


def read_messages(path: str | os.PathLike[str], kind: str = "auto") -> Iterator[MessageRecord]:
    """Messages of a capture, in constant memory.

    Args:
        path: File, or ``-`` for standard input.
        kind: ``tlog``, ``mavlink``, ``pcap``, ``hex`` or ``auto``.

    Raises:
        CaptureError: If it is not a supported capture.
        OSError: If it cannot be read.
    """
    with open_capture(path, kind) as capture:
        yield from decode_records(capture)
