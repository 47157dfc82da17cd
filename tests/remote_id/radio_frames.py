"""Radio frames as transmitters and sniffers make them, to read back."""

from __future__ import annotations

import struct

from ridlink.remote_id.astm_pack import encode_pack
from ridlink.remote_id.messages import BasicId, Location, Separation

MAC = bytes.fromhex("84cca8604324")
PACK = encode_pack(
    [
        BasicId(1, 2, b"1596F302A7K29QX0"),
        Location(2, 90.0, 12.25, latitude_deg=47.4, longitude_deg=8.5, timestamp_s=1234.5),
        Separation(horizontal_error_m=4.0),
    ]
)


def element(kind: int, content: bytes) -> bytes:
    return bytes((kind, len(content))) + content


def odid_element(payload: bytes = PACK, counter: int = 7) -> bytes:
    return element(0xDD, b"\xfa\x0b\xbc\x0d" + bytes((counter,)) + payload)


def beacon(elements: bytes, mac: bytes = MAC) -> bytes:
    """A 802.11 beacon."""
    return b"\x80\x00\x00\x00" + b"\xff" * 6 + mac + mac + bytes(2) + bytes(8) + b"\x64\x00\x20\x04" + elements


def odid_beacon(payload: bytes = PACK, counter: int = 7) -> bytes:
    return beacon(element(0, b"RID-1") + element(3, b"\x06") + odid_element(payload, counter))


def nan(payload: bytes = PACK, counter: int = 7, *, control: int = 0x10, optional: bytes = b"") -> bytes:
    """A NAN action frame that publishes the service of Open Drone ID."""
    info = bytes((counter,)) + payload
    descriptor = bytes.fromhex("8869199d92090100") + bytes((control,)) + optional + bytes((len(info),)) + info
    attributes = b"\x03" + struct.pack("<H", len(descriptor)) + descriptor + bytes.fromhex("0e04000100") + b"\x02\x07"
    head = b"\xd0\x00\x00\x00" + bytes.fromhex("516f9a010000") + MAC + bytes.fromhex("506f9a0100ff") + bytes(2)
    return head + bytes.fromhex("0409506f9a13") + attributes


def radiotap(frame: bytes, flags: int = 0, *, tsft: bool = False, more: int = 0) -> bytes:
    """A frame behind radiotap's header; flag 0x10 adds a checksum, as a sniffer would."""
    present = struct.pack("<I", 0x0E | tsft | (0x80000000 if more else 0))
    present += struct.pack("<I", 0x80000000) * (more - 1) + (struct.pack("<I", 0) if more else b"")
    fields = b""
    if tsft:
        fields = bytes(-(4 + len(present)) % 8) + b"\x55" * 8
    fields += bytes((flags, 2)) + struct.pack("<HH", 2437, 0xA0)
    return struct.pack("<BBH", 0, 0, 4 + len(present) + len(fields)) + present + fields + frame + (
        b"\xde\xad\xbe\xef" if flags & 0x10 else b""
    )  # fmt: skip


def advertising_data(payload: bytes, counter: int) -> bytes:
    return b"\x02\x01\x06" + element_of_advertisement(b"\x16\xfa\xff\x0d" + bytes((counter,)) + payload)


def element_of_advertisement(content: bytes) -> bytes:
    return bytes((len(content),)) + content


def legacy(payload: bytes = PACK[3:28], counter: int = 7, kind: int = 2, *, flags: bool = False) -> bytes:
    """A Bluetooth 4 advertisement as it lies on the link layer, with its access address and a CRC."""
    data = advertising_data(payload, counter) if flags else advertising_data(payload, counter)[3:]
    body = MAC[::-1] + data
    return bytes.fromhex("d6be898e") + bytes((kind, len(body))) + body + b"crc"


def extended(payload: bytes = PACK, counter: int = 7, *, coded: bool = False, header_flags: int = 0x09) -> bytes:
    """A Bluetooth 5 extended advertisement; on the coded PHY a byte stands before the PDU."""
    header = bytes((header_flags,))
    for bit, content in (
        (0x01, MAC[::-1]), (0x02, b"t" * 6), (0x04, b"c"), (0x08, b"\x75\x0e"), (0x10, b"aux"), (0x20, b"s" * 18),
        (0x40, b"p"),
    ):  # fmt: skip
        if header_flags & bit:
            header += content
    body = bytes((len(header),)) + header + advertising_data(payload, counter)[3:]
    return bytes.fromhex("d6be898e") + b"\x00" * coded + bytes((7, len(body))) + body + b"crc"


def nordic(packet: bytes, *, crc_ok: bool = True, coded: bool = False, version: int = 3) -> bytes:
    """A packet behind the header of Nordic's sniffer."""
    length = struct.pack("<H", len(packet) + 10) if version > 1 else bytes((6, len(packet) + 10))
    flags = (0x01 if crc_ok else 0) | (0x20 if coded else 0)
    return b"\x03" + length + bytes((version, 1, 2, 2)) + bytes((10, flags, 37, 53, 0, 0)) + bytes(4) + packet


def phdr(packet: bytes, flags: int = 0x0C01) -> bytes:
    """A packet behind the pseudo header of a sniffer."""
    return bytes((12, 0xC4, 0x80, 0)) + bytes.fromhex("d6be898e") + struct.pack("<H", flags) + packet
