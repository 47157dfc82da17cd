"""OPEN_DRONE_ID_SYSTEM on both wires, MAVLink and 25 bytes, to SI and back.

The rules are those of `ridlink.remote_id.convert`.

Source: ASTM F3411-22a; MAVLink common.xml.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from ridlink.remote_id import astm_fields
from ridlink.remote_id.astm_fields import MessageType, fitting_bits, header
from ridlink.remote_id.mavlink_fields import read_altitude, write_altitude
from ridlink.remote_id.messages import System
from ridlink.remote_id.quantities import (
    MAX_UINT8,
    MAX_UINT16,
    FieldRejects,
    read_id_or_mac,
    read_position,
    read_seconds_since_2019,
    write_position,
    write_seconds_since_2019,
    write_up,
)

POSITION = ("OPEN_DRONE_ID_SYSTEM.operator_latitude", "OPEN_DRONE_ID_SYSTEM.operator_longitude")

_SYSTEM = struct.Struct("<BBiiHBHHBHIx")
AREA_RADIUS_STEP_M = 10.0

# --- MAVLink ---


def from_fields(fields: dict[str, Any], rejects: FieldRejects) -> System:
    """The message in the fields of its MAVLink form."""
    latitude, longitude = read_position(
        fields["operator_latitude"],
        fields["operator_longitude"],
        POSITION,
        rejects,
    )
    return System(
        operator_location_type=fields["operator_location_type"],
        classification_type=fields["classification_type"],
        operator_latitude_deg=latitude,
        operator_longitude_deg=longitude,
        area_count=fields["area_count"],
        area_radius_m=float(fields["area_radius"]),
        area_ceiling_m=read_altitude(fields["area_ceiling"], "OPEN_DRONE_ID_SYSTEM.area_ceiling", rejects),
        area_floor_m=read_altitude(fields["area_floor"], "OPEN_DRONE_ID_SYSTEM.area_floor", rejects),
        category_eu=fields["category_eu"],
        class_eu=fields["class_eu"],
        operator_altitude_geo_m=read_altitude(
            fields["operator_altitude_geo"], "OPEN_DRONE_ID_SYSTEM.operator_altitude_geo", rejects
        ),
        timestamp_s=read_seconds_since_2019(fields["timestamp"]),
        id_or_mac=read_id_or_mac(fields["id_or_mac"]),
    )


def to_fields(message: System) -> dict[str, Any]:
    """The fields of its MAVLink form, without target ids and ``id_or_mac``."""
    latitude, longitude = write_position(message.operator_latitude_deg, message.operator_longitude_deg)
    return {
        "operator_location_type": message.operator_location_type,
        "classification_type": message.classification_type,
        "operator_latitude": latitude,
        "operator_longitude": longitude,
        "area_count": message.area_count,
        "area_radius": write_up(message.area_radius_m, 1.0),
        "area_ceiling": write_altitude(message.area_ceiling_m),
        "area_floor": write_altitude(message.area_floor_m),
        "category_eu": message.category_eu,
        "class_eu": message.class_eu,
        "operator_altitude_geo": write_altitude(message.operator_altitude_geo_m),
        "timestamp": write_seconds_since_2019(message.timestamp_s),
    }


# --- 25 bytes ---


def from_bytes(data: bytes, rejects: FieldRejects, id_or_mac: bytes | None) -> System:
    """The message in 25 bytes."""
    _, kinds, latitude, longitude, count, radius, ceiling, floor, eu, altitude, timestamp = _SYSTEM.unpack(data)
    latitude_deg, longitude_deg = read_position(
        latitude,
        longitude,
        POSITION,
        rejects,
    )
    return System(
        operator_location_type=kinds & 0x03,
        classification_type=kinds >> 2 & 0x07,
        operator_latitude_deg=latitude_deg,
        operator_longitude_deg=longitude_deg,
        area_count=count,
        area_radius_m=radius * AREA_RADIUS_STEP_M,
        area_ceiling_m=astm_fields.read_altitude(ceiling),
        area_floor_m=astm_fields.read_altitude(floor),
        category_eu=eu >> 4,
        class_eu=eu & 0x0F,
        operator_altitude_geo_m=astm_fields.read_altitude(altitude),
        timestamp_s=read_seconds_since_2019(timestamp),
        id_or_mac=id_or_mac,
    )


def to_bytes(message: System) -> bytes:
    """The 25 bytes."""
    latitude, longitude = write_position(message.operator_latitude_deg, message.operator_longitude_deg)
    return _SYSTEM.pack(
        header(MessageType.SYSTEM),
        fitting_bits(message, "classification_type", 7) << 2 | fitting_bits(message, "operator_location_type", 3),
        latitude,
        longitude,
        fitting_bits(message, "area_count", MAX_UINT16),
        write_up(message.area_radius_m, AREA_RADIUS_STEP_M, MAX_UINT8),
        astm_fields.write_altitude(message.area_ceiling_m, math.ceil),  # an area of operation is never understated
        astm_fields.write_altitude(message.area_floor_m, math.floor),
        fitting_bits(message, "category_eu", 15) << 4 | fitting_bits(message, "class_eu", 15),
        astm_fields.write_altitude(message.operator_altitude_geo_m),
        write_seconds_since_2019(message.timestamp_s),
    )
