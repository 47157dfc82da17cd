"""Broadcasts as records: each 25-byte message as itself, and as the frame that a receiver would make of it."""

from __future__ import annotations

from collections.abc import Iterator

from ridlink.captures.records import Origin, Rejects, TracedRecord
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.astm import decode_message
from ridlink.remote_id.astm_pack import BadMember, split_broadcast
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.quantities import ID_LENGTH

RECEIVER_COMPONENT = 236
"""MAV_COMP_ID_ODID_TXRX_1: who puts on a vehicle's bus what it hears."""


class Relay:
    """Turns broadcasts into records, with frames in sequence.

    Args:
        rejects: Counts members that were not taken.
    """

    def __init__(self, rejects: Rejects) -> None:
        self._encoder = Encoder(0, RECEIVER_COMPONENT)
        self._rejects = rejects

    def records(
        self,
        payload: bytes,
        time_us: int | None,
        offset: int,
        *,
        transport: str | None = None,
        mac: bytes = b"",
        counter: int | None = None,
        place: int | None = None,
    ) -> Iterator[TracedRecord]:
        """Records of one broadcast, which is a message pack or a message alone.

        Args:
            payload: The broadcast.
            time_us: When it was heard.
            offset: Byte of the file where it stands.
            transport: How it came.
            mac: Who sent it.
            counter: Its message counter.
            place: What rejects are said to stand at; ``offset`` where it is not given.
        """
        for item in split_broadcast(payload):
            if isinstance(item, BadMember):
                self._rejects.add_one(item.refusal, offset if place is None else place)
                continue
            origin = Origin(transport, mac, counter, item.index, item.data)
            yield TracedRecord(time_us, self._frame(item.data, id_of(mac)), offset, origin)

    def _frame(self, data: bytes, id_or_mac: bytes | None) -> Frame:
        name, fields = to_mavlink(decode_message(data, id_or_mac=id_or_mac))
        frame = parse_datagram(self._encoder.encode(name, **fields), CRC_EXTRAS, limit=1)[0]
        assert isinstance(frame, Frame)  # we have just made it
        return frame


def id_of(mac: bytes) -> bytes | None:
    """The ``id_or_mac`` of what a transmitter said, ``None`` where it is not known."""
    return mac.ljust(ID_LENGTH, b"\x00") if mac else None
