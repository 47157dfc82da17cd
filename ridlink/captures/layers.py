"""The layers of a network packet, down to what UDP or TCP carries.

IP fragments are counted and not reassembled, since MAVLink senders never send datagrams that large.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from ridlink.captures.packet_window import Packet
from ridlink.captures.records import Rejects
from ridlink.captures.tcp import Segment

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


def carried(packet: Packet, rejects: Rejects) -> bytes | Segment | None:
    """Complete UDP payload or TCP segment of a packet, ``None`` if it has neither.

    Args:
        packet: Packet whose link type is one of `NETWORKS`.
        rejects: Counts fragments.
    """
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
