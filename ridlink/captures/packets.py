"""Network and radio packets as records: MAVLink in UDP and TCP, Open Drone ID in radio frames.

Other packets are skipped. Packets that are or claim to be MAVLink or Open Drone ID, but cannot be taken, are counted.
Each datagram is parsed on its own; TCP is parsed as a stream (`tcp`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from ridlink.captures.broadcasts import Relay
from ridlink.captures.layers import NETWORKS, carried
from ridlink.captures.packet_window import Packet, Window
from ridlink.captures.pcap import FILE_HEADER_LENGTH, PCAP_MAGICS, PcapReader
from ridlink.captures.pcapng import PCAPNG_MAGIC, PcapngReader
from ridlink.captures.raw import parse_alone
from ridlink.captures.records import Origin, Record, Rejects, TracedRecord
from ridlink.captures.tcp import Segment, TcpStreams
from ridlink.errors import CaptureError
from ridlink.mavlink.frames import MAGIC_V1, MAGIC_V2, Cause, Frame
from ridlink.remote_id import radio

MAGICS = (*PCAP_MAGICS, PCAPNG_MAGIC)
"""First bytes of a pcap or pcapng file."""

UDP_TRANSPORT = "udp"

RADIOS: dict[int, Callable[[bytes], list[radio.Heard | radio.Unheard]]] = {
    105: radio.read_80211,
    127: radio.read_radiotap,
    251: radio.read_ble,
    256: radio.read_ble_with_phdr,
    272: radio.read_nordic_ble,
}
"""Link types of radio: 802.11, 802.11 with radiotap, Bluetooth LE, the same with a pseudo header, Nordic's sniffer."""


class Datagram(NamedTuple):
    """UDP payload of a packet: microseconds since 1970 or ``None``, byte offset of its record in the file."""

    time_us: int | None
    offset: int
    payload: bytes


def read_pcap(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Record]:
    """Records of a pcap or pcapng file in constant memory, whatever the bytes are.

    Args:
        chunks: The file from its first byte.
        rejects: Counts damage, and MAVLink or Open Drone ID packets that cannot be taken.

    Raises:
        CaptureError: If there are packets, but none of a supported link type.
    """
    for item in read_contents(chunks, rejects):
        if isinstance(item, Datagram):
            yield from records_of(item, rejects)
        else:
            yield item


def read_contents(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Datagram | TracedRecord]:
    """Contents of a pcap or pcapng file: records, and unparsed datagrams, which `records_of` parses.

    Args:
        chunks, rejects: As for `read_pcap`.

    Raises:
        CaptureError: As `read_pcap`.
    """
    relay, streams = Relay(rejects), TcpStreams(rejects)
    foreign: set[int] = set()
    understood = False
    for packet in read_packets(chunks, rejects):
        if packet.link_type in RADIOS:
            understood = True
            yield from relay.heard(RADIOS[packet.link_type](packet.data), packet.time_us, packet.offset)
        elif packet.link_type in NETWORKS:
            understood = True
            content = carried(packet, rejects)
            if isinstance(content, Segment):
                yield from streams.records(content, packet.time_us, packet.offset)
            elif content:
                yield Datagram(packet.time_us, packet.offset, content)
            if streams.waiting_bytes:
                yield from streams.overdue(packet.time_us)
        else:
            foreign.add(packet.link_type)
            rejects.add_one(f"link_type_{packet.link_type}", packet.offset)
            if len(foreign) > len(NETWORKS) + len(RADIOS):  # a hostile file may name many
                foreign.pop()
    yield from streams.finish()
    if foreign and not understood:
        known = ", ".join(map(str, sorted((*NETWORKS, *RADIOS))))
        raise CaptureError(f"link type {', '.join(map(str, sorted(foreign)))} is not read; these are: {known}")


def read_packets(chunks: Iterable[bytes], rejects: Rejects) -> Iterator[Packet]:
    """Packets of a pcap or pcapng file, for any chunk sizes and any bytes.

    Args:
        chunks: The file from its first byte.
        rejects: Counts damage.
    """
    window = Window(chunks, rejects)
    window.reach(FILE_HEADER_LENGTH)
    magic = window.peek(0, 4)
    if magic in PCAP_MAGICS and window.left >= FILE_HEADER_LENGTH:
        yield from PcapReader(window).packets()
    elif magic == PCAPNG_MAGIC:
        yield from PcapngReader(window, rejects).packets()
    elif window.left:
        rejects.add(Cause.TRUNCATED if magic in PCAP_MAGICS else Cause.GARBAGE, 0, window.left)


def records_of(datagram: Datagram, rejects: Rejects) -> Iterator[TracedRecord]:
    """Frames of a datagram; other bytes in it are counted, unless the datagram is some other protocol."""
    time_us, offset, payload = datagram
    found = list(parse_alone(payload))
    if payload[0] not in (MAGIC_V1, MAGIC_V2) and not any(isinstance(item, Frame) and item.checked for item in found):
        return
    for item in found:
        if isinstance(item, Frame):
            yield TracedRecord(time_us, item, offset, Origin(UDP_TRANSPORT))
        else:
            rejects.add_one(item.cause, offset)
