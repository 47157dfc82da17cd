"""The 25-byte messages that Open Drone ID broadcasts (ASTM F3411, ASD-STAN EN 4709-002) to SI and back.

The first byte is the message type (high half) and the protocol version (low half). Versions 0 to 2 have the layouts
below, in which what an older version reserved is zero, and zero reads as unknown; a version that is not known yet is
read as the newest one and counted under ``MESSAGE.protocol_version``. Reserved bytes are ignored, reserved codes kept
as numbers.

Reading and writing follow the rules of ``convert``: a sentinel becomes ``None``, and so does a field that is out of its
range, alone and counted. Values go to the nearest unit; accuracies, errors, sizes and areas go to the safe side. A
value that does not fit saturates or goes out as unknown; a code or text that does not fit its bits is a `PayloadError`.

RIDLINK_SEPARATION has no message type of its own (see ``astm_separation``). Message packs are in ``astm_pack``.

Source: ASTM F3411-22a; held byte for byte against opendroneid-core-c.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable
from enum import IntEnum, StrEnum
from typing import Any

from ridlink.errors import PayloadError
from ridlink.remote_id import accuracy, messages
from ridlink.remote_id.astm_fields import fitting_bits, fitting_text, nearest, read_altitude, write_altitude
from ridlink.remote_id.astm_separation import authentication_of, separation_of
from ridlink.remote_id.messages import MAVLINK_NAMES, RemoteIdMessage
from ridlink.remote_id.quantities import (
    AUTHENTICATION_FIRST_PAGE_LENGTH,
    AUTHENTICATION_PAGE_LENGTH,
    ID_LENGTH,
    MAX_UINT8,
    MAX_UINT16,
    SECONDS_PER_HOUR,
    TEXT_LENGTH,
    FieldRejects,
    read_position,
    read_seconds_since_2019,
    write_position,
    write_seconds_since_2019,
    write_up,
)

MESSAGE_LENGTH = 25
NEWEST_VERSION = 2
LAST_PAGE = 15


class MessageType(IntEnum):
    """High half of the first byte."""

    BASIC_ID = 0x0
    LOCATION = 0x1
    AUTHENTICATION = 0x2
    SELF_ID = 0x3
    SYSTEM = 0x4
    OPERATOR_ID = 0x5
    PACK = 0xF


class Refusal(StrEnum):
    """Why bytes were not taken as a message or pack."""

    WRONG_LENGTH = "wrong_length"
    UNKNOWN_TYPE = "unknown_message_type"
    BAD_PAGE = "bad_authentication_page"
    NESTED_PACK = "nested_pack"
    BAD_MESSAGE_SIZE = "bad_message_size"
    BAD_MESSAGE_COUNT = "bad_message_count"
    TRUNCATED_PACK = "truncated_pack"


_LOCATION = struct.Struct("<BBBBbiiHHHBBHBx")
_SYSTEM = struct.Struct("<BBiiHBHHBHIx")
_FIRST_PAGE = struct.Struct("<BBBBI17s")

UNKNOWN_DIRECTION_DEG = 361
UNKNOWN_SPEED = 255
FAST_SPEED_FROM_MPS = 63.75
SLOW_STEP_MPS, FAST_STEP_MPS = 0.25, 0.75
MAX_FAST_SPEED = 254
UNKNOWN_SPEED_VERTICAL = 126
MAX_SPEED_VERTICAL = 124
SPEED_VERTICAL_STEP_MPS = 0.5
UNKNOWN_TIMESTAMP = 0xFFFF
MAX_TIMESTAMP = 36000
TIMESTAMP_STEP_S = 0.1
AREA_RADIUS_STEP_M = 10.0


def refusal_of(data: bytes) -> Refusal | None:
    """Why these bytes are no message, ``None`` if they are one: then `decode_message` does not raise."""
    if len(data) != MESSAGE_LENGTH:
        return Refusal.WRONG_LENGTH
    kind = data[0] >> 4
    if kind == MessageType.PACK:
        return Refusal.NESTED_PACK
    if kind not in _READERS:
        return Refusal.UNKNOWN_TYPE
    if kind == MessageType.AUTHENTICATION and data[1] & 0x0F == 0 and data[2] > LAST_PAGE:
        return Refusal.BAD_PAGE
    return None


def decode_message(
    data: bytes, rejects: FieldRejects | None = None, *, id_or_mac: bytes | None = None
) -> RemoteIdMessage:
    """The message in 25 bytes, in SI units.

    Args:
        data: 25 bytes.
        rejects: Counts fields that were not taken, and versions that are not known.
        id_or_mac: Who was heard to say it, for the message.

    Raises:
        PayloadError: If there are not 25 bytes, or of no known type, or with a page that cannot be.
    """
    refusal = refusal_of(data)
    if refusal is not None:
        raise PayloadError(f"no Open Drone ID message: {refusal} ({data[:MESSAGE_LENGTH].hex()})")
    counted: FieldRejects = Counter() if rejects is None else rejects
    message = _READERS[data[0] >> 4](data, counted, id_or_mac)
    if data[0] & 0x0F > NEWEST_VERSION:
        counted[f"{MAVLINK_NAMES[type(message)]}.protocol_version"] += 1
    return message


def encode_message(message: RemoteIdMessage, *, hour_start_s: int | None = None) -> bytes:
    """The 25 bytes of a message, protocol version 2. ``id_or_mac`` is not part of them.

    An accuracy code of 0 whose bound is given is derived from the bound.

    Args:
        message: The message.
        hour_start_s: Start of the present full hour [s since 2019-01-01 UTC], without which the time of a `Separation`
            goes out as unknown: it counts from the full hour, the 25 bytes from 2019.

    Raises:
        PayloadError: If a code, count or text does not fit.
    """
    if isinstance(message, messages.Separation):
        message = authentication_of(message, hour_start_s)
    return _WRITERS[type(message)](message)


def _header(kind: MessageType) -> int:
    return kind << 4 | NEWEST_VERSION


# --- LOCATION ---


def _read_location(data: bytes, rejects: FieldRejects, id_or_mac: bytes | None) -> messages.Location:
    (_, status, direction_units, speed_units, climb_units, latitude, longitude, barometric, geodetic, height,
     position_accuracy, other_accuracy, tenths, time_accuracy) = _LOCATION.unpack(data)  # fmt: skip
    latitude_deg, longitude_deg = read_position(
        latitude, longitude, ("OPEN_DRONE_ID_LOCATION.latitude", "OPEN_DRONE_ID_LOCATION.longitude"), rejects
    )
    direction_deg: float | None = None
    direction = direction_units + 180 * (status >> 1 & 1)
    if direction <= 360:
        direction_deg = float(direction % 360)
    elif direction != UNKNOWN_DIRECTION_DEG:
        rejects["OPEN_DRONE_ID_LOCATION.direction"] += 1
    speed_mps: float | None = speed_units * SLOW_STEP_MPS
    if status & 1:
        fast_mps = speed_units * FAST_STEP_MPS + FAST_SPEED_FROM_MPS
        speed_mps = fast_mps if speed_units != UNKNOWN_SPEED else None
    climb_mps: float | None = None
    if abs(climb_units) <= MAX_SPEED_VERTICAL:
        climb_mps = climb_units * SPEED_VERTICAL_STEP_MPS
    elif climb_units != UNKNOWN_SPEED_VERTICAL:
        rejects["OPEN_DRONE_ID_LOCATION.speed_vertical"] += 1
    timestamp_s: float | None = None
    if tenths <= MAX_TIMESTAMP:
        timestamp_s = tenths / 10.0
    elif tenths != UNKNOWN_TIMESTAMP:
        rejects["OPEN_DRONE_ID_LOCATION.timestamp"] += 1
    horizontal_code, vertical_code = position_accuracy & 0x0F, position_accuracy >> 4
    speed_code, barometer_code = other_accuracy & 0x0F, other_accuracy >> 4
    return messages.Location(
        status=status >> 4,
        direction_deg=direction_deg,
        speed_horizontal_mps=speed_mps,
        speed_vertical_mps=climb_mps,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_barometric_m=read_altitude(barometric),
        altitude_geodetic_m=read_altitude(geodetic),
        height_m=read_altitude(height),
        height_reference=status >> 2 & 1,
        horizontal_accuracy=horizontal_code,
        vertical_accuracy=vertical_code,
        barometer_accuracy=barometer_code,
        speed_accuracy=speed_code,
        horizontal_accuracy_m=accuracy.horizontal_bound_m(horizontal_code),
        vertical_accuracy_m=accuracy.vertical_bound_m(vertical_code),
        barometer_accuracy_m=accuracy.vertical_bound_m(barometer_code),
        speed_accuracy_mps=accuracy.speed_bound_mps(speed_code),
        timestamp_s=timestamp_s,
        timestamp_accuracy_s=accuracy.time_bound_s(time_accuracy & 0x0F),
        id_or_mac=id_or_mac,
    )


def _write_direction(value_deg: float | None) -> tuple[int, int]:
    """The flag for 180 degrees more, and the rest."""
    direction = UNKNOWN_DIRECTION_DEG
    if value_deg is not None and math.isfinite(value_deg):
        direction = nearest(value_deg % 360.0) % 360
    return (1, direction - 180) if direction >= 180 else (0, direction)


def _write_speed(value_mps: float | None) -> tuple[int, int]:
    """The flag for coarse steps, and how many."""
    if value_mps is None or not value_mps >= 0.0:
        return 1, UNKNOWN_SPEED
    if value_mps <= FAST_SPEED_FROM_MPS:
        return 0, nearest(value_mps / SLOW_STEP_MPS)
    fast = (value_mps - FAST_SPEED_FROM_MPS) / FAST_STEP_MPS
    return 1, nearest(fast) if fast < MAX_FAST_SPEED else MAX_FAST_SPEED


def _write_speed_vertical(value_mps: float | None) -> int:
    if value_mps is None or math.isnan(value_mps):
        return UNKNOWN_SPEED_VERTICAL
    limit = MAX_SPEED_VERTICAL * SPEED_VERTICAL_STEP_MPS
    return nearest(min(max(value_mps, -limit), limit) / SPEED_VERTICAL_STEP_MPS)


def _write_timestamp(value_s: float | None) -> int:
    if value_s is None or not 0.0 <= value_s <= SECONDS_PER_HOUR:
        return UNKNOWN_TIMESTAMP
    return nearest(value_s * 10.0)


def _write_location(message: messages.Location) -> bytes:
    west, direction = _write_direction(message.direction_deg)
    fast, speed = _write_speed(message.speed_horizontal_mps)
    latitude, longitude = write_position(message.latitude_deg, message.longitude_deg)
    horizontal = fitting_bits(message, "horizontal_accuracy", 15) or accuracy.horizontal_code(
        message.horizontal_accuracy_m
    )
    vertical = fitting_bits(message, "vertical_accuracy", 15) or accuracy.vertical_code(message.vertical_accuracy_m)
    barometer = fitting_bits(message, "barometer_accuracy", 15) or accuracy.vertical_code(message.barometer_accuracy_m)
    speed_accuracy = fitting_bits(message, "speed_accuracy", 15) or accuracy.speed_code(message.speed_accuracy_mps)
    return _LOCATION.pack(
        _header(MessageType.LOCATION),
        fitting_bits(message, "status", 15) << 4 | fitting_bits(message, "height_reference", 1) << 2 | west << 1 | fast,
        direction,
        speed,
        _write_speed_vertical(message.speed_vertical_mps),
        latitude,
        longitude,
        write_altitude(message.altitude_barometric_m),
        write_altitude(message.altitude_geodetic_m),
        write_altitude(message.height_m),
        vertical << 4 | horizontal,
        barometer << 4 | speed_accuracy,
        _write_timestamp(message.timestamp_s),
        accuracy.time_code(message.timestamp_accuracy_s),
    )


# --- SYSTEM ---


def _read_system(data: bytes, rejects: FieldRejects, id_or_mac: bytes | None) -> messages.System:
    _, kinds, latitude, longitude, count, radius, ceiling, floor, eu, altitude, timestamp = _SYSTEM.unpack(data)
    latitude_deg, longitude_deg = read_position(
        latitude,
        longitude,
        ("OPEN_DRONE_ID_SYSTEM.operator_latitude", "OPEN_DRONE_ID_SYSTEM.operator_longitude"),
        rejects,
    )
    return messages.System(
        operator_location_type=kinds & 0x03,
        classification_type=kinds >> 2 & 0x07,
        operator_latitude_deg=latitude_deg,
        operator_longitude_deg=longitude_deg,
        area_count=count,
        area_radius_m=radius * AREA_RADIUS_STEP_M,
        area_ceiling_m=read_altitude(ceiling),
        area_floor_m=read_altitude(floor),
        category_eu=eu >> 4,
        class_eu=eu & 0x0F,
        operator_altitude_geo_m=read_altitude(altitude),
        timestamp_s=read_seconds_since_2019(timestamp),
        id_or_mac=id_or_mac,
    )


def _write_system(message: messages.System) -> bytes:
    latitude, longitude = write_position(message.operator_latitude_deg, message.operator_longitude_deg)
    return _SYSTEM.pack(
        _header(MessageType.SYSTEM),
        fitting_bits(message, "classification_type", 7) << 2 | fitting_bits(message, "operator_location_type", 3),
        latitude,
        longitude,
        fitting_bits(message, "area_count", MAX_UINT16),
        write_up(message.area_radius_m, AREA_RADIUS_STEP_M, MAX_UINT8),
        write_altitude(message.area_ceiling_m, math.ceil),  # an area of operation is never understated
        write_altitude(message.area_floor_m, math.floor),
        fitting_bits(message, "category_eu", 15) << 4 | fitting_bits(message, "class_eu", 15),
        write_altitude(message.operator_altitude_geo_m),
        write_seconds_since_2019(message.timestamp_s),
    )


# --- identities and texts ---
# Fixed-length byte strings lose their padding on the way in and get it back on the way out.


def _read_basic_id(data: bytes, _: FieldRejects, id_or_mac: bytes | None) -> messages.BasicId:
    return messages.BasicId(data[1] >> 4, data[1] & 0x0F, data[2 : 2 + ID_LENGTH].rstrip(b"\x00"), id_or_mac)


def _write_basic_id(message: messages.BasicId) -> bytes:
    kinds = fitting_bits(message, "id_type", 15) << 4 | fitting_bits(message, "ua_type", 15)
    return bytes((_header(MessageType.BASIC_ID), kinds)) + fitting_text(message, "uas_id", ID_LENGTH) + bytes(3)


def _read_self_id(data: bytes, _: FieldRejects, id_or_mac: bytes | None) -> messages.SelfId:
    return messages.SelfId(data[1], data[2:].rstrip(b"\x00"), id_or_mac)


def _write_self_id(message: messages.SelfId) -> bytes:
    head = bytes((_header(MessageType.SELF_ID), fitting_bits(message, "description_type", MAX_UINT8)))
    return head + fitting_text(message, "description", TEXT_LENGTH)


def _read_operator_id(data: bytes, _: FieldRejects, id_or_mac: bytes | None) -> messages.OperatorId:
    return messages.OperatorId(data[1], data[2 : 2 + ID_LENGTH].rstrip(b"\x00"), id_or_mac)


def _write_operator_id(message: messages.OperatorId) -> bytes:
    head = bytes((_header(MessageType.OPERATOR_ID), fitting_bits(message, "operator_id_type", MAX_UINT8)))
    return head + fitting_text(message, "operator_id", ID_LENGTH) + bytes(3)


# --- AUTHENTICATION ---


def _page_capacity(last_page_index: int) -> int:
    return AUTHENTICATION_FIRST_PAGE_LENGTH + AUTHENTICATION_PAGE_LENGTH * last_page_index


def _read_authentication(
    data: bytes, rejects: FieldRejects, id_or_mac: bytes | None
) -> messages.Authentication | messages.Separation:
    authentication_type, page = data[1] >> 4, data[1] & 0x0F
    if page:
        return messages.Authentication(authentication_type, page, 0, 0, None, data[2:], id_or_mac)
    _, _, last_page, length, timestamp, content = _FIRST_PAGE.unpack(data)
    if length > _page_capacity(last_page):
        rejects["OPEN_DRONE_ID_AUTHENTICATION.length"] += 1
    message = messages.Authentication(
        authentication_type, 0, last_page, length, read_seconds_since_2019(timestamp), content, id_or_mac
    )
    return separation_of(message) or message


def _write_authentication(message: messages.Authentication) -> bytes:
    page = fitting_bits(message, "data_page", LAST_PAGE)
    head = bytes((_header(MessageType.AUTHENTICATION), fitting_bits(message, "authentication_type", 15) << 4 | page))
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


_Reader = Callable[[bytes, FieldRejects, bytes | None], RemoteIdMessage]
_Writer = Callable[[Any], bytes]

_FORMS: dict[MessageType, tuple[type, _Reader, _Writer]] = {
    MessageType.BASIC_ID: (messages.BasicId, _read_basic_id, _write_basic_id),
    MessageType.LOCATION: (messages.Location, _read_location, _write_location),
    MessageType.AUTHENTICATION: (messages.Authentication, _read_authentication, _write_authentication),
    MessageType.SELF_ID: (messages.SelfId, _read_self_id, _write_self_id),
    MessageType.SYSTEM: (messages.System, _read_system, _write_system),
    MessageType.OPERATOR_ID: (messages.OperatorId, _read_operator_id, _write_operator_id),
}
_READERS: dict[int, _Reader] = {kind: read for kind, (_, read, _) in _FORMS.items()}
_WRITERS: dict[type, _Writer] = {message: write for message, _, write in _FORMS.values()}
