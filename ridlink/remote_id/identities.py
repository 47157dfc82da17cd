"""BASIC_ID, SELF_ID, OPERATOR_ID and AUTHENTICATION of Open Drone ID on both wires, MAVLink and 25 bytes.

Byte strings of fixed length lose their padding when they are read and get it back when they are written.

Source: ASTM F3411-22a; MAVLink common.xml.
"""

from __future__ import annotations

import struct
from typing import Any

from ridlink.remote_id.astm_fields import MessageType, filled_up, fitting_bits, fitting_text, header
from ridlink.remote_id.messages import Authentication, BasicId, OperatorId, SelfId
from ridlink.remote_id.quantities import (
    AUTHENTICATION_FIRST_PAGE_LENGTH,
    AUTHENTICATION_PAGE_LENGTH,
    ID_LENGTH,
    MAX_UINT8,
    TEXT_LENGTH,
    FieldRejects,
    read_id_or_mac,
    read_seconds_since_2019,
    write_seconds_since_2019,
)

LAST_PAGE = 15
_FIRST_PAGE = struct.Struct("<BBBBI17s")

# --- MAVLink ---


def basic_id_from_fields(fields: dict[str, Any], _: FieldRejects) -> BasicId:
    """The message in the fields of its MAVLink form."""
    return BasicId(
        fields["id_type"], fields["ua_type"], fields["uas_id"].rstrip(b"\x00"), read_id_or_mac(fields["id_or_mac"])
    )


def basic_id_to_fields(message: BasicId) -> dict[str, Any]:
    """The fields of its MAVLink form, without target ids and ``id_or_mac``."""
    return {
        "id_type": message.id_type,
        "ua_type": message.ua_type,
        "uas_id": filled_up(message, "uas_id", ID_LENGTH),
    }


def self_id_from_fields(fields: dict[str, Any], _: FieldRejects) -> SelfId:
    """The message in the fields of its MAVLink form."""
    return SelfId(
        fields["description_type"], fields["description"].rstrip(b"\x00"), read_id_or_mac(fields["id_or_mac"])
    )


def self_id_to_fields(message: SelfId) -> dict[str, Any]:
    """The fields of its MAVLink form, without target ids and ``id_or_mac``."""
    return {
        "description_type": message.description_type,
        "description": filled_up(message, "description", TEXT_LENGTH),
    }


def operator_id_from_fields(fields: dict[str, Any], _: FieldRejects) -> OperatorId:
    """The message in the fields of its MAVLink form."""
    return OperatorId(
        fields["operator_id_type"], fields["operator_id"].rstrip(b"\x00"), read_id_or_mac(fields["id_or_mac"])
    )


def operator_id_to_fields(message: OperatorId) -> dict[str, Any]:
    """The fields of its MAVLink form, without target ids and ``id_or_mac``."""
    return {
        "operator_id_type": message.operator_id_type,
        "operator_id": filled_up(message, "operator_id", ID_LENGTH),
    }


def authentication_from_fields(fields: dict[str, Any], _: FieldRejects) -> Authentication:
    """The message in the fields of its MAVLink form."""
    data: bytes = fields["authentication_data"]
    if fields["data_page"] == 0 and not any(data[AUTHENTICATION_FIRST_PAGE_LENGTH:]):
        data = data[:AUTHENTICATION_FIRST_PAGE_LENGTH]  # page 0 has 17 bytes; keep more only where a sender filled them
    return Authentication(
        fields["authentication_type"],
        fields["data_page"],
        fields["last_page_index"],
        fields["length"],
        read_seconds_since_2019(fields["timestamp"]),
        data,
        read_id_or_mac(fields["id_or_mac"]),
    )


def authentication_to_fields(message: Authentication) -> dict[str, Any]:
    """The fields of its MAVLink form, without target ids and ``id_or_mac``."""
    return {
        "authentication_type": message.authentication_type,
        "data_page": message.data_page,
        "last_page_index": message.last_page_index,
        "length": message.length,
        "timestamp": write_seconds_since_2019(message.timestamp_s),
        "authentication_data": filled_up(message, "authentication_data", AUTHENTICATION_PAGE_LENGTH),
    }


# --- 25 bytes ---


def basic_id_from_bytes(data: bytes, _: FieldRejects, id_or_mac: bytes | None) -> BasicId:
    """The message in 25 bytes."""
    return BasicId(data[1] >> 4, data[1] & 0x0F, data[2 : 2 + ID_LENGTH].rstrip(b"\x00"), id_or_mac)


def basic_id_to_bytes(message: BasicId) -> bytes:
    """The 25 bytes."""
    kinds = fitting_bits(message, "id_type", 15) << 4 | fitting_bits(message, "ua_type", 15)
    return bytes((header(MessageType.BASIC_ID), kinds)) + fitting_text(message, "uas_id", ID_LENGTH) + bytes(3)


def self_id_from_bytes(data: bytes, _: FieldRejects, id_or_mac: bytes | None) -> SelfId:
    """The message in 25 bytes."""
    return SelfId(data[1], data[2:].rstrip(b"\x00"), id_or_mac)


def self_id_to_bytes(message: SelfId) -> bytes:
    """The 25 bytes."""
    head = bytes((header(MessageType.SELF_ID), fitting_bits(message, "description_type", MAX_UINT8)))
    return head + fitting_text(message, "description", TEXT_LENGTH)


def operator_id_from_bytes(data: bytes, _: FieldRejects, id_or_mac: bytes | None) -> OperatorId:
    """The message in 25 bytes."""
    return OperatorId(data[1], data[2 : 2 + ID_LENGTH].rstrip(b"\x00"), id_or_mac)


def operator_id_to_bytes(message: OperatorId) -> bytes:
    """The 25 bytes."""
    head = bytes((header(MessageType.OPERATOR_ID), fitting_bits(message, "operator_id_type", MAX_UINT8)))
    return head + fitting_text(message, "operator_id", ID_LENGTH) + bytes(3)


# --- AUTHENTICATION ---


def _page_capacity(last_page_index: int) -> int:
    return AUTHENTICATION_FIRST_PAGE_LENGTH + AUTHENTICATION_PAGE_LENGTH * last_page_index


def authentication_from_bytes(data: bytes, rejects: FieldRejects, id_or_mac: bytes | None) -> Authentication:
    """The message in 25 bytes."""
    authentication_type, page = data[1] >> 4, data[1] & 0x0F
    if page:
        return Authentication(authentication_type, page, 0, 0, None, data[2:], id_or_mac)
    _, _, last_page, length, timestamp, content = _FIRST_PAGE.unpack(data)
    if length > _page_capacity(last_page):
        rejects["OPEN_DRONE_ID_AUTHENTICATION.length"] += 1
    return Authentication(
        authentication_type, 0, last_page, length, read_seconds_since_2019(timestamp), content, id_or_mac
    )


def authentication_to_bytes(message: Authentication) -> bytes:
    """The 25 bytes."""
    page = fitting_bits(message, "data_page", LAST_PAGE)
    head = bytes((header(MessageType.AUTHENTICATION), fitting_bits(message, "authentication_type", 15) << 4 | page))
    if page:
        return head + fitting_text(message, "authentication_data", AUTHENTICATION_PAGE_LENGTH)
    last_page = fitting_bits(message, "last_page_index", LAST_PAGE)
    length = fitting_bits(message, "length", min(MAX_UINT8, _page_capacity(last_page)))
    return _FIRST_PAGE.pack(
        *head,
        last_page,
        length,
        write_seconds_since_2019(message.timestamp_s),
        fitting_text(message, "authentication_data", AUTHENTICATION_FIRST_PAGE_LENGTH),
    )
