"""MAVLink FTP, which is not supported: every request is refused at once, so that clients go on without it.

Ground stations first try to read the parameters by it. Without an answer they wait for seconds before they ask for
single parameters, and until then take it that there are none: MAVProxy then reports "Arming checks disabled" on arming.
"""

from __future__ import annotations

import struct

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.results import Reply

_HEADER = struct.Struct("<HBBBBBBI")
"""Sequence, session, opcode, size, requested opcode, burst complete, padding, offset."""

_TERMINATE_SESSION, _RESET_SESSIONS = 1, 2
_ACK, _NAK = 128, 129
_UNKNOWN_COMMAND = 7


def refuse_file_transfer(message: Message, system_id: int, component_id: int) -> list[Reply]:
    """The answer to FILE_TRANSFER_PROTOCOL (110): ends of sessions are acknowledged, all else is unknown."""
    sequence, session, opcode, _, _, _, _, offset = _HEADER.unpack_from(bytes(message.payload))
    if opcode in (_ACK, _NAK):
        return []  # a reply, not a request
    ends = opcode in (_TERMINATE_SESSION, _RESET_SESSIONS)
    result, data = (_ACK, b"") if ends else (_NAK, bytes([_UNKNOWN_COMMAND]))
    answer = _HEADER.pack((sequence + 1) & 0xFFFF, session, result, len(data), opcode, 0, 0, offset) + data
    reply = {"target_system": system_id, "target_component": component_id, "payload": answer.ljust(251, b"\x00")}
    return [("FILE_TRANSFER_PROTOCOL", reply)]
