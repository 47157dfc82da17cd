"""Datagrams to messages and reports: what an engine reads, and what it leaves unread.

Nothing here trusts a sender. A frame is judged by its header first, so that a message that does not concern us costs no
decoding.
"""

from __future__ import annotations

import struct
from collections import Counter

from ridlink.mavlink.codec import CRC_EXTRAS, Message, decode_message
from ridlink.mavlink.frames import BadFrame, Frame, parse_datagram
from ridlink.remote_id.bridge import REMOTE_ID_IDS, messages_of
from ridlink.remote_id.messages import MAVLINK_NAMES, Location, RemoteIdMessage

EKF_STATUS_REPORT = 193
_EKF_FLAGS = struct.Struct("<H")
_EKF_FLAGS_AT = 20
"""From ArduPilot's own dialect, of which only this message is needed: five floats, then the flags."""

CHECKED = {**CRC_EXTRAS, EKF_STATUS_REPORT: 71}

STATUSTEXT = 253
VEHICLE_IDS = REMOTE_ID_IDS | {0, 24, 32, 33, 42, 75, 76, 85, EKF_STATUS_REPORT, 230, 242, 245, STATUSTEXT}
"""Messages that an engine reads from the vehicle link, REMOTE_ID_IDS also from the air; no others are decoded."""
LOCATION = MAVLINK_NAMES[Location]


class Intake:
    """Takes messages out of datagrams.

    Args:
        allow_v1: Take MAVLink 1 frames as well.

    Attributes:
        counters: Frames that were not taken, by cause.
    """

    def __init__(self, *, allow_v1: bool = False) -> None:
        self.counters: Counter[str] = Counter()
        self._allow_v1 = allow_v1

    def messages(self, datagram: bytes, wanted: frozenset[int]) -> list[tuple[Frame, Message]]:
        """Messages of a datagram that concern us; all others are counted by cause."""
        taken: list[tuple[Frame, Message]] = []
        for found in parse_datagram(datagram, CHECKED):
            if isinstance(found, BadFrame):
                self.counters[found.cause] += 1
            elif not found.checked:
                self.counters["unknown_message"] += 1
            elif found.version != 2 and not self._allow_v1:
                self.counters["mavlink_1_frame"] += 1
            elif found.msgid == EKF_STATUS_REPORT:
                if found.msgid in wanted:
                    taken.append((found, _ekf_status(found)))
            elif found.msgid in wanted:
                taken.append((found, decode_message(found)))
        return taken

    def remote_id(self, message: Message) -> list[RemoteIdMessage]:
        """Remote ID messages in a message, LOCATION last, of a pack as well: with its RIDLINK_SEPARATION before it,
        LOCATION makes one report instead of two."""
        parts = messages_of(message, self.counters)
        if len(parts) > 1:
            parts.sort(key=lambda each: isinstance(each, Location))
        return parts


def _ekf_status(frame: Frame) -> Message:
    (flags,) = _EKF_FLAGS.unpack_from(frame.payload.ljust(_EKF_FLAGS_AT + 2, b"\x00"), _EKF_FLAGS_AT)
    return Message("EKF_STATUS_REPORT", EKF_STATUS_REPORT, {"flags": flags})
