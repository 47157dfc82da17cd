"""Messages of a capture, typed: MAVLink as the XML has it, Remote ID in SI."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ridlink.captures.reader import open_capture
from ridlink.captures.records import Record
from ridlink.mavlink.codec import MESSAGES, Message, decode_payload
from ridlink.mavlink.frames import Frame
from ridlink.remote_id.convert import Rejects as FieldRejects
from ridlink.remote_id.convert import from_mavlink
from ridlink.remote_id.messages import RemoteIdMessage

UNKNOWN = "UNKNOWN"
"""Name of messages that the dialect does not have."""


class MessageRecord(NamedTuple):
    """One message of a capture.

    ``message`` is ``None`` where the dialect does not know the id, ``remote_id`` where the message is not about Remote
    ID. ``time_us`` is microseconds since 1970 (UTC) or ``None``.
    """

    time_us: int | None
    frame: Frame
    message: Message | None
    remote_id: RemoteIdMessage | None
    offset: int

    @property
    def name(self) -> str:
        """Name of the message in the XML, or ``UNKNOWN``."""
        return self.message.name if self.message is not None else UNKNOWN

    @property
    def source(self) -> tuple[int, int]:
        """System id and component id."""
        return self.frame.sysid, self.frame.compid


def decode_records(records: Iterable[Record], field_rejects: FieldRejects | None = None) -> Iterator[MessageRecord]:
    """Messages of records.

    Args:
        records: Records, as of `open_capture`.
        field_rejects: Counts Remote ID fields that are out of range.
    """
    for time_us, frame, offset in records:
        spec = MESSAGES.get(frame.msgid)
        if spec is None:
            yield MessageRecord(time_us, frame, None, None, offset)
        else:
            message = Message(spec.name, spec.msgid, decode_payload(spec, frame.payload))
            yield MessageRecord(time_us, frame, message, from_mavlink(message, field_rejects), offset)


def read_messages(path: str | os.PathLike[str], kind: str = "auto") -> Iterator[MessageRecord]:
    """Messages of a capture, in constant memory.

    Args:
        path: File, or ``-`` for standard input.
        kind: ``tlog``, ``mavlink`` or ``auto``.

    Raises:
        CaptureError: If it is no capture that is read.
        OSError: If it cannot be read.
    """
    with open_capture(path, kind) as capture:
        yield from decode_records(capture)
