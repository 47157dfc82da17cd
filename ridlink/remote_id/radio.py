"""Finds Open Drone ID in radio frames: 802.11 beacons, Wi-Fi NAN action frames, Bluetooth advertisements.

Each reader takes one captured frame of one link layer and returns the broadcasts in it. The list is empty for most
frames of a capture, which are not Open Drone ID. Otherwise it has `Heard` items, or an `Unheard` if a frame is or may
be Open Drone ID but was not taken. The payload of a `Heard` is a message pack or a single message, for
`ridlink.remote_id.astm_pack.split_broadcast`. The readers never raise, whatever the bytes. Vendor elements of other
makers (for example DJI's own drone id) are not Open Drone ID and are skipped.

Source: ASTM F3411-22a (broadcast over Bluetooth, NAN and beacons); Wi-Fi Aware (service descriptor attribute);
Bluetooth Core (link layer); radiotap.org; https://www.tcpdump.org/linktypes.html for the headers of sniffers.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import NamedTuple

MAC_LENGTH = 6


class Transport(StrEnum):
    """The radio technology that carried a broadcast."""

    WIFI_BEACON = "wifi-beacon"
    WIFI_NAN = "wifi-nan"
    BT4 = "bt4"
    BT5 = "bt5"


class Unheard(StrEnum):
    """Why a frame was not taken."""

    BAD_CHECKSUM = "bad_checksum"
    TRUNCATED = "truncated"
    WHITENED = "whitened"


class Heard(NamedTuple):
    """One broadcast: transport, the transmitter's MAC in the order it is written, message counter, content."""

    transport: Transport
    mac: bytes
    counter: int
    payload: bytes


# --- 802.11 ---

RADIOTAP_HEADER_LENGTH = 8
RADIOTAP_TSFT = 1 << 0
RADIOTAP_FLAGS = 1 << 1
RADIOTAP_MORE_FLAGS = 1 << 31
RADIOTAP_FLAG_FCS_AT_END = 0x10
RADIOTAP_FLAG_BAD_FCS = 0x40
TSFT_LENGTH = 8
FCS_LENGTH = 4

MANAGEMENT_HEADER_LENGTH = 24
HT_CONTROL_LENGTH = 4
TRANSMITTER = slice(10, 16)
SUBTYPE_BEACON = 0x80
SUBTYPE_ACTION = 0xD0
SUBTYPE_ACTION_NO_ACK = 0xE0
FLAG_PROTECTED = 0x40
FLAG_HT_CONTROL = 0x80

BEACON_FIXED_LENGTH = 12
VENDOR_ELEMENT = 0xDD
ODID_ELEMENT = b"\xfa\x0b\xbc\x0d"
"""OUI of ASTM, and its type for Remote ID."""

NAN_SERVICE_DISCOVERY = b"\x04\x09\x50\x6f\x9a\x13"
"""Public action frame, vendor specific, Wi-Fi Alliance, NAN service discovery."""
NAN_SERVICE_DESCRIPTOR = 0x03
ODID_SERVICE = bytes.fromhex("8869199d9209")
"""The first six bytes of the SHA-256 of ``org.opendroneid.remoteid``."""
SERVICE_HEADER_LENGTH = 9
HAS_MATCHING_FILTER, HAS_RESPONSE_FILTER, HAS_SERVICE_INFO, HAS_BINDING_BITMAP = 0x04, 0x08, 0x10, 0x40


def read_radiotap(data: bytes) -> list[Heard | Unheard]:
    """Broadcasts in a 802.11 frame behind a radiotap header, which says whether the checksum was right."""
    if len(data) < RADIOTAP_HEADER_LENGTH or data[0] != 0:
        return []
    length = int.from_bytes(data[2:4], "little")
    present = word = int.from_bytes(data[4:8], "little")
    fields_at = RADIOTAP_HEADER_LENGTH
    while word & RADIOTAP_MORE_FLAGS:
        word = int.from_bytes(data[fields_at : fields_at + 4], "little")  # 0, and so the last one, past the end
        fields_at += 4
    frame, flags = data[length:], 0
    if present & RADIOTAP_FLAGS:
        flags_at = fields_at
        if present & RADIOTAP_TSFT:
            flags_at = -(-flags_at // TSFT_LENGTH) * TSFT_LENGTH + TSFT_LENGTH
        flags = data[flags_at] if flags_at < min(length, len(data)) else 0
    if flags & RADIOTAP_FLAG_FCS_AT_END:
        frame = frame[:-FCS_LENGTH]
    if flags & RADIOTAP_FLAG_BAD_FCS:
        return [Unheard.BAD_CHECKSUM]
    return read_80211(frame)


def read_80211(frame: bytes) -> list[Heard | Unheard]:
    """Broadcasts in a 802.11 frame that begins with its frame control field; a checksum at its end is ignored."""
    if len(frame) < MANAGEMENT_HEADER_LENGTH:
        return []
    mac = frame[TRANSMITTER]
    body = frame[MANAGEMENT_HEADER_LENGTH + (HT_CONTROL_LENGTH if frame[1] & FLAG_HT_CONTROL else 0) :]
    if frame[0] == SUBTYPE_BEACON:
        return list(_in_beacon(body[BEACON_FIXED_LENGTH:], mac))
    is_action = frame[0] in (SUBTYPE_ACTION, SUBTYPE_ACTION_NO_ACK) and not frame[1] & FLAG_PROTECTED
    if is_action and body.startswith(NAN_SERVICE_DISCOVERY):
        return list(_in_nan(body[len(NAN_SERVICE_DISCOVERY) :], mac))
    return []


def _in_beacon(elements: bytes, mac: bytes) -> Iterator[Heard | Unheard]:
    at = 0
    while at + 2 <= len(elements):
        kind, length = elements[at], elements[at + 1]
        content = elements[at + 2 : at + 2 + length]
        if kind == VENDOR_ELEMENT and content.startswith(ODID_ELEMENT):
            yield _heard(Transport.WIFI_BEACON, mac, content[len(ODID_ELEMENT) :])
        at += 2 + length


def _in_nan(attributes: bytes, mac: bytes) -> Iterator[Heard | Unheard]:
    at = 0
    while at + 3 <= len(attributes):
        kind, length = attributes[at], int.from_bytes(attributes[at + 1 : at + 3], "little")
        content = attributes[at + 3 : at + 3 + length]
        if kind == NAN_SERVICE_DESCRIPTOR and content.startswith(ODID_SERVICE):
            info = _service_info(content)
            if info is not None:
                yield _heard(Transport.WIFI_NAN, mac, info)
        at += 3 + length


def _service_info(descriptor: bytes) -> bytes | None:
    """The service info of a service descriptor attribute; ``None`` if it has none, as in a subscription."""
    if len(descriptor) < SERVICE_HEADER_LENGTH:
        return b""
    control, at = descriptor[SERVICE_HEADER_LENGTH - 1], SERVICE_HEADER_LENGTH
    if not control & HAS_SERVICE_INFO:
        return None
    if control & HAS_BINDING_BITMAP:
        at += 2
    for optional in (HAS_MATCHING_FILTER, HAS_RESPONSE_FILTER):
        if control & optional:
            at += 1 + int.from_bytes(descriptor[at : at + 1], "little")
    length = int.from_bytes(descriptor[at : at + 1], "little")
    return descriptor[at + 1 : at + 1 + length]


# --- Bluetooth ---

ADVERTISING_ACCESS_ADDRESS = bytes.fromhex("d6be898e")
PHY_CODED = 2
PDU_HEADER_LENGTH = 2
ADV_IND, ADV_NONCONN_IND, SCAN_RSP, ADV_SCAN_IND, ADV_EXT_IND = 0, 2, 4, 6, 7
EXT_ADVERTISER = 0x01
"""Of the flags of an extended header: the address of the advertiser comes first."""
SERVICE_DATA = 0x16
ODID_SERVICE_DATA = b"\xfa\xff\x0d"
"""16-bit UUID of ASTM, and its application code for Remote ID."""

NORDIC_HEADER_LENGTH = 17
NORDIC_VERSIONS = (1, 2, 3)
NORDIC_CRC_OK = 0x01
PHDR_LENGTH = 10
PHDR_DEWHITENED = 0x0001
PHDR_CRC_CHECKED, PHDR_CRC_VALID = 0x0400, 0x0800


def read_nordic_ble(data: bytes) -> list[Heard | Unheard]:
    """Broadcasts in a packet of Nordic's Bluetooth sniffer, versions 1 to 3 of its header."""
    if len(data) < NORDIC_HEADER_LENGTH or data[3] not in NORDIC_VERSIONS:
        return []
    flags = data[8]
    if not data.startswith(ADVERTISING_ACCESS_ADDRESS, NORDIC_HEADER_LENGTH):
        return []
    if not flags & NORDIC_CRC_OK:
        return [Unheard.BAD_CHECKSUM]
    return read_ble(data[NORDIC_HEADER_LENGTH:], coded=flags >> 4 & 0x07 == PHY_CODED)


def read_ble_with_phdr(data: bytes) -> list[Heard | Unheard]:
    """Broadcasts in a Bluetooth link layer packet behind the pseudo header of a sniffer."""
    if not data.startswith(ADVERTISING_ACCESS_ADDRESS, PHDR_LENGTH):
        return []
    flags = int.from_bytes(data[8:10], "little")
    if not flags & PHDR_DEWHITENED:
        return [Unheard.WHITENED]
    if flags & PHDR_CRC_CHECKED and not flags & PHDR_CRC_VALID:
        return [Unheard.BAD_CHECKSUM]
    return read_ble(data[PHDR_LENGTH:], coded=flags >> 14 == PHY_CODED)


def read_ble(data: bytes, *, coded: bool = False) -> list[Heard | Unheard]:
    """Broadcasts in a Bluetooth link layer packet that begins with its access address.

    Args:
        data: The packet; its CRC at the end is not checked here.
        coded: Whether it was received on the coded PHY (long range), where one more byte precedes the PDU.
    """
    if not data.startswith(ADVERTISING_ACCESS_ADDRESS):
        return []
    pdu = data[len(ADVERTISING_ACCESS_ADDRESS) + coded :]
    if len(pdu) < PDU_HEADER_LENGTH:
        return []
    kind, length = pdu[0] & 0x0F, pdu[1]
    body = pdu[PDU_HEADER_LENGTH : PDU_HEADER_LENGTH + length]
    if kind in (ADV_IND, ADV_NONCONN_IND, SCAN_RSP, ADV_SCAN_IND):
        return list(_in_advertisement(body[MAC_LENGTH:], body[:MAC_LENGTH], Transport.BT4))
    if kind == ADV_EXT_IND and body:
        header = body[1 : 1 + (body[0] & 0x3F)]
        content = body[1 + len(header) :]
        return list(_in_advertisement(content, _extended_address(header), Transport.BT5))
    return []


def _extended_address(header: bytes) -> bytes:
    """Address of the advertiser; empty if the header omits it, as in the continuation of a chain."""
    if not header or not header[0] & EXT_ADVERTISER:
        return b""
    return header[1 : 1 + MAC_LENGTH]


def _in_advertisement(content: bytes, address: bytes, transport: Transport) -> Iterator[Heard | Unheard]:
    at = 0
    while at < len(content) and content[at]:
        length = content[at]
        structure = content[at + 1 : at + 1 + length]
        if structure[:1] == bytes((SERVICE_DATA,)) and structure.startswith(ODID_SERVICE_DATA, 1):
            yield _heard(transport, address[::-1], structure[1 + len(ODID_SERVICE_DATA) :])
        at += 1 + length


def _heard(transport: Transport, mac: bytes, content: bytes) -> Heard | Unheard:
    """A broadcast: a message counter, then the messages. A truncated broadcast keeps its complete messages."""
    return Heard(transport, mac, content[0], content[1:]) if content else Unheard.TRUNCATED
