"""Broadcasts as records: each 25-byte message, and the MAVLink frame that a receiver would make of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ridlink.captures.records import Origin, Rejects, TracedRecord
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.astm import decode_message
from ridlink.remote_id.astm_pack import BadMember, split_broadcast
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.quantities import ID_LENGTH
from ridlink.remote_id.radio import Heard, Unheard

RECEIVER_COMPONENT = 236
"""MAV_COMP_ID_ODID_TXRX_1: the component that relays what it hears to the vehicle's bus."""


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
        """Records of one broadcast, which is a message pack or a single message.

        Args:
            payload: The broadcast.
            time_us: Time of reception.
            offset: Its byte offset in the file.
            transport: Radio technology that carried it.
            mac: Address of the transmitter.
            counter: Its message counter.
            place: Position to report for rejects; ``offset`` if not given.
        """
        for item in split_broadcast(payload):
            if isinstance(item, BadMember):
                self._rejects.add_one(item.refusal, offset if place is None else place)
                continue
            origin = Origin(transport, mac, counter, item.index, item.data)
            yield TracedRecord(time_us, self._frame(item.data, id_of(mac)), offset, origin)

    def heard(
        self, found: Iterable[Heard | Unheard], time_us: int | None, offset: int, *, place: int | None = None
    ) -> Iterator[TracedRecord]:
        """Records of what was found in one radio frame; arguments as in `records`."""
        for item in found:
            if isinstance(item, Heard):
                yield from self.records(
                    item.payload, time_us, offset,
                    transport=item.transport, mac=item.mac, counter=item.counter, place=place,
                )  # fmt: skip
            else:
                self._rejects.add_one(item, offset if place is None else place)

    def _frame(self, data: bytes, id_or_mac: bytes | None) -> Frame:
        name, fields = to_mavlink(decode_message(data, id_or_mac=id_or_mac))
        frame = parse_datagram(self._encoder.encode(name, **fields), CRC_EXTRAS, limit=1)[0]
        assert isinstance(frame, Frame)  # it was encoded just above
        return frame


def id_of(mac: bytes) -> bytes | None:
    """The ``id_or_mac`` for messages of a transmitter, ``None`` if the transmitter is unknown."""
    return mac.ljust(ID_LENGTH, b"\x00") if mac else None
