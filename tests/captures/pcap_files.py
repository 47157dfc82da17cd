"""pcap and pcapng files, and the network layers round a datagram, byte by byte."""

from __future__ import annotations

import struct

START_US = 1_700_000_000_123_456
STEP_US = 33_333
Timed = list[tuple[int, bytes]]


def timed(packets: list[bytes]) -> Timed:
    """The packets at 30 Hz."""
    return [(START_US + index * STEP_US, packet) for index, packet in enumerate(packets)]


def pcap_record(order: str, time_us: int, packet: bytes, *, per_us: int = 1, original: int | None = None) -> bytes:
    seconds, fraction = divmod(time_us, 1_000_000)
    return struct.pack(order + "IIII", seconds, fraction * per_us, len(packet), original or len(packet)) + packet


def pcap(packets: Timed, link_type: int = 1, *, order: str = "<", nanoseconds: bool = False) -> bytes:
    """A classic pcap file."""
    magic = 0xA1B23C4D if nanoseconds else 0xA1B2C3D4
    head = struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 65535, link_type)
    per_us = 1000 if nanoseconds else 1
    return head + b"".join(pcap_record(order, time_us, packet, per_us=per_us) for time_us, packet in packets)


def block(order: str, kind: int, body: bytes) -> bytes:
    body += bytes(-len(body) % 4)
    length = struct.pack(order + "I", len(body) + 12)
    return struct.pack(order + "I", kind) + length + body + length


def section(order: str = "<") -> bytes:
    return block(order, 0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1))


def interface(order: str, link_type: int, *options: tuple[int, bytes]) -> bytes:
    body = struct.pack(order + "HHI", link_type, 0, 0)
    for code, value in options:
        body += struct.pack(order + "HH", code, len(value)) + value + bytes(-len(value) % 4)
    return block(order, 1, body + bytes(4))


def enhanced(order: str, units: int, packet: bytes, number: int = 0) -> bytes:
    head = struct.pack(order + "IIIII", number, units >> 32, units & 0xFFFFFFFF, len(packet), len(packet))
    return block(order, 6, head + packet)


def pcapng(packets: Timed, link_type: int = 1, *, order: str = "<") -> bytes:
    """A pcapng file of one section with one interface."""
    head = section(order) + interface(order, link_type, (2, b"wlan0"))
    return head + b"".join(enhanced(order, time_us, packet) for time_us, packet in packets)


def udp(payload: bytes, port: int = 14550) -> bytes:
    return struct.pack(">HHHH", 14540, port, 8 + len(payload), 0) + payload


def tcp(payload: bytes, sequence: int, *, port: int = 5760, syn: bool = False) -> bytes:
    head = struct.pack(">HHIIBBHHH", 14540, port, sequence % 2**32, 0, 0x50, 0x02 if syn else 0x18, 65535, 0, 0)
    return head + payload


def ipv4(content: bytes, *, flags: int = 0, options: bytes = b"", protocol: int = 17) -> bytes:
    length = 20 + len(options) + len(content)
    head = struct.pack(">BBHHHBBH", 0x40 | 5 + len(options) // 4, 0, length, 1, flags, 64, protocol, 0)
    return head + bytes((127, 0, 0, 1)) * 2 + options + content


def ipv6(content: bytes, *, header: int = 17) -> bytes:
    return (
        struct.pack(">IHBB", 0x60000000, len(content), header, 64) + bytes(15) + b"\x01" + bytes(15) + b"\x01" + content
    )


def ethernet(content: bytes, kind: int = 0x0800) -> bytes:
    """A frame, padded to its shortest length as on the wire."""
    return (b"\x02" * 6 + b"\x04" * 6 + struct.pack(">H", kind) + content).ljust(60, b"\xfd")
