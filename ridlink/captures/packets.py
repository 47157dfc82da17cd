"""Network and radio packets as records: MAVLink in UDP and TCP, Open Drone ID in radio frames.

Other packets are skipped. Packets that are or claim to be MAVLink or Open Drone ID, but cannot be taken, are counted.
IP fragments are counted and not reassembled, since MAVLink senders never send datagrams that large. Each datagram is
parsed on its own; TCP is parsed as a stream (`tcp`).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any, NamedTuple

from ridlink.captures.broadcasts import Relay
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
IP_FRAGMENT = "ip_fragment"
IPV6_FRAGMENT_HEADER = 44
UDP_PROTOCOL = 17
UDP_HEADER_LENGTH = 8
IPV4 = 0x0800
IPV4_HEADER_LENGTH = 20
IPV4_WITHOUT_OPTIONS = 0x45
IPV4_PART = 0x3FFF
"""Bits of the field with flags and offset that are 0 if a packet is no fragment."""

_PLAIN: dict[int, tuple[struct.Struct, int]] = {
    link_type: (struct.Struct(f"{link}BxH2xHxB14xH2x"), struct.calcsize(link))
    for link_type, link in ((1, ">12xH"), (113, ">14xH"), (276, ">H18x"))
}
"""By link type: the layout of link, IP and UDP headers for `_plain_payload`, and where the IP header starts."""

NETWORKS: dict[int, str] = {
    0: "loopback", 1: "ethernet", 12: "ip", 14: "ip", 101: "ip", 108: "loopback", 113: "sll", 228: "ip", 229: "ip",
    276: "sll2",
}  # fmt: skip
"""Link types (https://www.tcpdump.org/linktypes.html) of networks, and their names in dpkt."""

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
            yield from _heard(packet, relay, rejects)
        elif packet.link_type in NETWORKS:
            understood = True
            carried = _carried(packet, rejects)
            if isinstance(carried, Segment):
                yield from streams.records(carried, packet.time_us, packet.offset)
            elif carried:
                yield Datagram(packet.time_us, packet.offset, carried)
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


def _heard(packet: Packet, relay: Relay, rejects: Rejects) -> Iterator[TracedRecord]:
    for item in RADIOS[packet.link_type](packet.data):
        if isinstance(item, radio.Heard):
            yield from relay.records(
                item.payload, packet.time_us, packet.offset,
                transport=item.transport, mac=item.mac, counter=item.counter,
            )  # fmt: skip
        else:
            rejects.add_one(item, packet.offset)


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


@cache
def _dpkt() -> Any:
    """The library, imported at the first network packet, since importing it takes a tenth of a second."""
    import dpkt

    return dpkt


def _layer_of(packet: Packet) -> Any:
    dpkt, data = _dpkt(), packet.data
    kind = NETWORKS[packet.link_type]
    if kind == "ip":
        return dpkt.ip6.IP6(data) if data[0] >> 4 == 6 else dpkt.ip.IP(data)
    decoders = {
        "ethernet": dpkt.ethernet.Ethernet, "loopback": dpkt.loopback.Loopback, "sll": dpkt.sll.SLL,
        "sll2": dpkt.sll2.SLL2,
    }  # fmt: skip
    return decoders[kind](data)


def _carried(packet: Packet, rejects: Rejects) -> bytes | Segment | None:
    """Complete UDP payload or TCP segment of a packet."""
    plain = _plain_payload(packet)
    if plain is not None:
        return plain
    dpkt = _dpkt()
    try:
        layer, ends = _layer_of(packet), (b"", b"")
        while isinstance(layer, dpkt.Packet):
            if isinstance(layer, dpkt.udp.UDP):
                end = max(layer.ulen - UDP_HEADER_LENGTH, 0) if layer.ulen else None  # 0 means a jumbogram
                return bytes(layer.data)[:end]
            if isinstance(layer, dpkt.tcp.TCP):
                direction = (*ends, layer.sport, layer.dport)
                return Segment(direction, layer.seq, bool(layer.flags & dpkt.tcp.TH_SYN), bytes(layer.data))
            if isinstance(layer, dpkt.ip.IP | dpkt.ip6.IP6):
                ends = layer.src, layer.dst
            if _is_fragment(layer):
                rejects.add_one(IP_FRAGMENT, packet.offset)
                return None
            layer = layer.data
    except Exception:  # dpkt's decoders of other protocols raise any Python exception for unexpected bytes
        return None
    return None


def _plain_payload(packet: Packet) -> bytes | None:
    """The UDP payload of the most frequent packets, without dpkt: IPv4 without options, directly on its link."""
    data = packet.data
    plain = _PLAIN.get(packet.link_type)
    if plain is None or len(data) < plain[0].size:
        return None
    fields, start = plain
    kind, first, length, fragment, protocol, udp_length = fields.unpack_from(data)
    if kind != IPV4 or first != IPV4_WITHOUT_OPTIONS or protocol != UDP_PROTOCOL or fragment & IPV4_PART:
        return None
    start += IPV4_HEADER_LENGTH
    end = start + min(length - IPV4_HEADER_LENGTH, udp_length)
    start += UDP_HEADER_LENGTH
    return data[start:end] if start <= end else None


def _is_fragment(layer: Any) -> bool:
    """Whether it is a fragment of a UDP datagram."""
    dpkt = _dpkt()
    if isinstance(layer, dpkt.ip.IP):
        return bool(layer.p == UDP_PROTOCOL and (layer.mf or layer.offset))
    if isinstance(layer, dpkt.ip6.IP6):
        header = layer.extension_hdrs.get(IPV6_FRAGMENT_HEADER)
        return header is not None and header.nxt == UDP_PROTOCOL and bool(header.m_flag or header.frag_off)
    return False
