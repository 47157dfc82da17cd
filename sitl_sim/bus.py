"""A Remote ID receiver on board: delivers what the vehicle hears on the air to its own bus, as real receivers do.

Frames come from the vehicle's own system id and component 236 (MAV_COMP_ID_ODID_TXRX_1), with ``id_or_mac`` filled with
the address of the transmitter: here a locally administered MAC address made from its system id.
"""

from __future__ import annotations

from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.quantities import read_id_or_mac

RECEIVER_COMPONENT = 236


class BusReceiver:
    """The receiver of one vehicle.

    Args:
        system_id: System id of the vehicle.
    """

    def __init__(self, system_id: int) -> None:
        self._encoder = Encoder(system_id, RECEIVER_COMPONENT)

    def deliver(self, broadcast: bytes) -> list[bytes]:
        """Frames for the bus from a broadcast; messages that are not about a vehicle are left out."""
        frames = []
        for found in parse_datagram(broadcast, CRC_EXTRAS):
            if not isinstance(found, Frame) or not found.checked:
                continue
            message = decode_message(found)
            if "id_or_mac" not in message.fields:
                continue
            heard_from = read_id_or_mac(message.fields["id_or_mac"]) or mac_of(found.sysid)
            frames.append(self._encoder.encode(message.name, **(message.fields | {"id_or_mac": heard_from})))
        return frames


def mac_of(system_id: int) -> bytes:
    """Address of an emulated transmitter: locally administered, with the system id as its last byte."""
    return bytes((0x02, 0x52, 0x49, 0x44, 0x00, system_id))
