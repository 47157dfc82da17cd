"""The checksum of MAVLink: CRC-16/MCRF4XX over the frame without its magic byte, then over CRC_EXTRA."""

from __future__ import annotations

from fastcrc import crc16

_EXTRA = [bytes([value]) for value in range(256)]


def checksum(header_and_payload: bytes, crc_extra: int) -> int:
    """Checksum of a frame, 16 bits.

    Args:
        header_and_payload: The frame from its length byte to the end of its payload.
        crc_extra: The seed that mavgen derives from the message's fields.
    """
    value: int = crc16.mcrf4xx(header_and_payload + _EXTRA[crc_extra])
    return value
