"""OPEN_DRONE_ID_LOCATION on both wires, MAVLink and 25 bytes, to SI and back.

The rules are those of `ridlink.remote_id.convert`. The two wire forms encode values differently: the 25 bytes have a
flag for directions from 180 degrees on, and a flag for speeds in coarse steps.

Source: ASTM F3411-22a; MAVLink common.xml.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from ridlink.remote_id import accuracy, astm_fields
from ridlink.remote_id.astm_fields import MessageType, fitting_bits, header, nearest
from ridlink.remote_id.mavlink_fields import read_altitude, read_timestamp, write_altitude, write_timestamp
from ridlink.remote_id.messages import Location
from ridlink.remote_id.quantities import (
    SECONDS_PER_HOUR,
    FieldRejects,
    read_id_or_mac,
    read_position,
    write_position,
)
from ridlink.units import cmps_from_mps, mps_from_cmps

POSITION = ("OPEN_DRONE_ID_LOCATION.latitude", "OPEN_DRONE_ID_LOCATION.longitude")

UNKNOWN_DIRECTION_CDEG = 36100
UNKNOWN_SPEED_HORIZONTAL_CMPS = 25500
MAX_SPEED_HORIZONTAL_CMPS = 25425
UNKNOWN_SPEED_VERTICAL_CMPS = 6300
MAX_SPEED_VERTICAL_CMPS = 6200

_LOCATION = struct.Struct("<BBBBbiiHHHBBHBx")
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

MAX_CLIMB_MPS = 62.0
"""Limit of both wire forms, upwards and downwards."""


def _climb_that_fits(value_mps: float | None) -> float | None:
    """A vertical speed within the range of both wire forms; None for unknown."""
    if value_mps is None or math.isnan(value_mps):
        return None
    return min(max(value_mps, -MAX_CLIMB_MPS), MAX_CLIMB_MPS)


def _codes(message: Location) -> tuple[int, int, int, int]:
    """Accuracy codes of position, altitude, pressure altitude and speed; a code of 0 is derived from its bound."""
    return (
        message.horizontal_accuracy or accuracy.horizontal_code(message.horizontal_accuracy_m),
        message.vertical_accuracy or accuracy.vertical_code(message.vertical_accuracy_m),
        message.barometer_accuracy or accuracy.vertical_code(message.barometer_accuracy_m),
        message.speed_accuracy or accuracy.speed_code(message.speed_accuracy_mps),
    )


# --- MAVLink ---


def from_fields(fields: dict[str, Any], rejects: FieldRejects) -> Location:
    """The message in the fields of its MAVLink form."""
    latitude, longitude = read_position(fields["latitude"], fields["longitude"], POSITION, rejects)
    direction: float | None = None
    cdeg = fields["direction"]
    if cdeg <= 36000:
        direction = cdeg / 100.0 if cdeg < 36000 else 0.0
    elif cdeg != UNKNOWN_DIRECTION_CDEG:
        rejects["OPEN_DRONE_ID_LOCATION.direction"] += 1
    speed_horizontal: float | None = None
    cmps = fields["speed_horizontal"]
    if cmps <= MAX_SPEED_HORIZONTAL_CMPS:
        speed_horizontal = mps_from_cmps(cmps)
    elif cmps != UNKNOWN_SPEED_HORIZONTAL_CMPS:
        rejects["OPEN_DRONE_ID_LOCATION.speed_horizontal"] += 1
    speed_vertical: float | None = None
    cmps = fields["speed_vertical"]
    if -MAX_SPEED_VERTICAL_CMPS <= cmps <= MAX_SPEED_VERTICAL_CMPS:
        speed_vertical = mps_from_cmps(cmps)
    elif cmps != UNKNOWN_SPEED_VERTICAL_CMPS:
        rejects["OPEN_DRONE_ID_LOCATION.speed_vertical"] += 1
    return Location(
        status=fields["status"],
        direction_deg=direction,
        speed_horizontal_mps=speed_horizontal,
        speed_vertical_mps=speed_vertical,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_barometric_m=read_altitude(
            fields["altitude_barometric"], "OPEN_DRONE_ID_LOCATION.altitude_barometric", rejects
        ),
        altitude_geodetic_m=read_altitude(
            fields["altitude_geodetic"], "OPEN_DRONE_ID_LOCATION.altitude_geodetic", rejects
        ),
        height_m=read_altitude(fields["height"], "OPEN_DRONE_ID_LOCATION.height", rejects),
        height_reference=fields["height_reference"],
        horizontal_accuracy=fields["horizontal_accuracy"],
        vertical_accuracy=fields["vertical_accuracy"],
        barometer_accuracy=fields["barometer_accuracy"],
        speed_accuracy=fields["speed_accuracy"],
        horizontal_accuracy_m=accuracy.horizontal_bound_m(fields["horizontal_accuracy"]),
        vertical_accuracy_m=accuracy.vertical_bound_m(fields["vertical_accuracy"]),
        barometer_accuracy_m=accuracy.vertical_bound_m(fields["barometer_accuracy"]),
        speed_accuracy_mps=accuracy.speed_bound_mps(fields["speed_accuracy"]),
        timestamp_s=read_timestamp(fields["timestamp"], "OPEN_DRONE_ID_LOCATION.timestamp", rejects),
        timestamp_accuracy_s=accuracy.time_bound_s(fields["timestamp_accuracy"]),
        id_or_mac=read_id_or_mac(fields["id_or_mac"]),
    )


def _direction_field(value_deg: float | None) -> int:
    if value_deg is None or not math.isfinite(value_deg):
        return UNKNOWN_DIRECTION_CDEG
    return round(value_deg % 360.0 * 100.0) % 36000


def _speed_horizontal_field(value_mps: float | None) -> int:
    if value_mps is None or not value_mps >= 0.0:
        return UNKNOWN_SPEED_HORIZONTAL_CMPS
    return cmps_from_mps(min(value_mps, MAX_SPEED_HORIZONTAL_CMPS / 100.0))


def _speed_vertical_field(value_mps: float | None) -> int:
    climb_mps = _climb_that_fits(value_mps)
    return UNKNOWN_SPEED_VERTICAL_CMPS if climb_mps is None else cmps_from_mps(climb_mps)


def to_fields(message: Location) -> dict[str, Any]:
    """The fields of its MAVLink form, without target ids and ``id_or_mac``."""
    latitude, longitude = write_position(message.latitude_deg, message.longitude_deg)
    horizontal, vertical, barometer, speed = _codes(message)
    return {
        "status": message.status,
        "direction": _direction_field(message.direction_deg),
        "speed_horizontal": _speed_horizontal_field(message.speed_horizontal_mps),
        "speed_vertical": _speed_vertical_field(message.speed_vertical_mps),
        "latitude": latitude,
        "longitude": longitude,
        "altitude_barometric": write_altitude(message.altitude_barometric_m),
        "altitude_geodetic": write_altitude(message.altitude_geodetic_m),
        "height": write_altitude(message.height_m),
        "height_reference": message.height_reference,
        "horizontal_accuracy": horizontal,
        "vertical_accuracy": vertical,
        "barometer_accuracy": barometer,
        "speed_accuracy": speed,
        "timestamp": write_timestamp(message.timestamp_s),
        "timestamp_accuracy": accuracy.time_code(message.timestamp_accuracy_s),
    }


# --- 25 bytes ---


def from_bytes(data: bytes, rejects: FieldRejects, id_or_mac: bytes | None) -> Location:
    """The message in 25 bytes."""
    (_, status, direction_units, speed_units, climb_units, latitude, longitude, barometric, geodetic, height,
     position_accuracy, other_accuracy, tenths, time_accuracy) = _LOCATION.unpack(data)  # fmt: skip
    latitude_deg, longitude_deg = read_position(latitude, longitude, POSITION, rejects)
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
    return Location(
        status=status >> 4,
        direction_deg=direction_deg,
        speed_horizontal_mps=speed_mps,
        speed_vertical_mps=climb_mps,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_barometric_m=astm_fields.read_altitude(barometric),
        altitude_geodetic_m=astm_fields.read_altitude(geodetic),
        height_m=astm_fields.read_altitude(height),
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


def _direction_bits(value_deg: float | None) -> tuple[int, int]:
    """The flag that adds 180 degrees, and the remaining degrees."""
    direction = UNKNOWN_DIRECTION_DEG
    if value_deg is not None and math.isfinite(value_deg):
        direction = nearest(value_deg % 360.0) % 360
    return (1, direction - 180) if direction >= 180 else (0, direction)


def _speed_bits(value_mps: float | None) -> tuple[int, int]:
    """The flag for coarse steps, and the number of steps."""
    if value_mps is None or not value_mps >= 0.0:
        return 1, UNKNOWN_SPEED
    if value_mps <= FAST_SPEED_FROM_MPS:
        return 0, nearest(value_mps / SLOW_STEP_MPS)
    fast = (value_mps - FAST_SPEED_FROM_MPS) / FAST_STEP_MPS
    return 1, nearest(fast) if fast < MAX_FAST_SPEED else MAX_FAST_SPEED


def _speed_vertical_bits(value_mps: float | None) -> int:
    climb_mps = _climb_that_fits(value_mps)
    return UNKNOWN_SPEED_VERTICAL if climb_mps is None else nearest(climb_mps / SPEED_VERTICAL_STEP_MPS)


def _timestamp_bits(value_s: float | None) -> int:
    if value_s is None or not 0.0 <= value_s <= SECONDS_PER_HOUR:
        return UNKNOWN_TIMESTAMP
    return nearest(value_s * 10.0)


def to_bytes(message: Location) -> bytes:
    """The 25 bytes."""
    west, direction = _direction_bits(message.direction_deg)
    fast, speed = _speed_bits(message.speed_horizontal_mps)
    latitude, longitude = write_position(message.latitude_deg, message.longitude_deg)
    for field in ("horizontal_accuracy", "vertical_accuracy", "barometer_accuracy", "speed_accuracy"):
        fitting_bits(message, field, 15)
    horizontal, vertical, barometer, speed_accuracy = _codes(message)
    return _LOCATION.pack(
        header(MessageType.LOCATION),
        fitting_bits(message, "status", 15) << 4 | fitting_bits(message, "height_reference", 1) << 2 | west << 1 | fast,
        direction,
        speed,
        _speed_vertical_bits(message.speed_vertical_mps),
        latitude,
        longitude,
        astm_fields.write_altitude(message.altitude_barometric_m),
        astm_fields.write_altitude(message.altitude_geodetic_m),
        astm_fields.write_altitude(message.height_m),
        vertical << 4 | horizontal,
        barometer << 4 | speed_accuracy,
        _timestamp_bits(message.timestamp_s),
        accuracy.time_code(message.timestamp_accuracy_s),
    )
