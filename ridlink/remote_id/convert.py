"""Remote ID messages of MAVLink to SI and back; wire sentinels stop here.

Reading: a sentinel becomes ``None``. A field that is out of its range or not finite becomes ``None`` as well, alone,
and is counted under ``MESSAGE.field``: one bad field costs neither the message nor the other fields. Values at the end
of a saturating range ("that or more") are taken as they stand.

Writing: nearest value, but errors, accuracies, sizes and intervals round up, so that an uncertainty is never
understated. What does not fit saturates, an infinite speed or error as well; a place, direction, altitude, time or
commanded velocity that cannot be goes out as unknown, and so does NaN. Since 0 means unknown, an exactly known position
goes out as 1 cm.

Trailing zeros vanish in MAVLink 2, hence a field that is absent reads as 0, and 0 as unknown wherever the table of the
message says so.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

from ridlink.mavlink.codec import Message
from ridlink.remote_id import accuracy
from ridlink.remote_id.messages import (
    MAVLINK_NAMES,
    Authentication,
    BasicId,
    Location,
    OperatorId,
    RemoteIdMessage,
    SelfId,
    Separation,
    SeparationFlags,
    System,
)
from ridlink.remote_id.quantities import (
    AUTHENTICATION_FIRST_PAGE_LENGTH,
    AUTHENTICATION_PAGE_LENGTH,
    ID_LENGTH,
    SECONDS_PER_HOUR,
    TEXT_LENGTH,
    FieldRejects,
    read_id_or_mac,
    read_position,
    read_seconds_since_2019,
    write_error,
    write_id_or_mac,
    write_position,
    write_seconds_since_2019,
    write_up,
)
from ridlink.units import cmps_from_mps, m_from_cm, mps_from_cmps

UNKNOWN_DIRECTION_CDEG = 36100
UNKNOWN_SPEED_HORIZONTAL_CMPS = 25500
MAX_SPEED_HORIZONTAL_CMPS = 25425
UNKNOWN_SPEED_VERTICAL_CMPS = 6300
MAX_SPEED_VERTICAL_CMPS = 6200
UNKNOWN_ALTITUDE_M = -1000.0
MAX_ALTITUDE_M = 31767.5
UNKNOWN_TIMESTAMP_S = 65535.0
MAX_INT16 = 32767
MESSAGE_PACK = "OPEN_DRONE_ID_MESSAGE_PACK"

_COMMANDED_VELOCITY_GIVEN = int(
    SeparationFlags.COMMANDED_VELOCITY_GIVEN
)  # an enumeration's own "&" takes a microsecond


def from_mavlink(message: Message, rejects: FieldRejects | None = None) -> RemoteIdMessage | None:
    """The Remote ID message in SI units, ``None`` where the message is none of the seven.

    Args:
        message: Decoded MAVLink message.
        rejects: Counts fields that were not taken. A message pack, which may hold several messages, is none of the
            seven and counts as a whole: `ridlink.remote_id.bridge.messages_of` reads it.
    """
    reader = _READERS.get(message.name)
    if reader is None:
        if rejects is not None and message.name == MESSAGE_PACK:
            rejects[MESSAGE_PACK] += 1
        return None
    return reader(message.fields, Counter() if rejects is None else rejects)


def to_mavlink(message: RemoteIdMessage) -> tuple[str, dict[str, Any]]:
    """Name and fields of the MAVLink message, for `ridlink.mavlink.codec.Encoder.encode`; addressed to everybody.

    An accuracy code of 0 whose bound is given is derived from the bound.
    """
    fields = _WRITERS[type(message)](message)
    fields["target_system"] = fields["target_component"] = 0
    fields["id_or_mac"] = write_id_or_mac(message.id_or_mac)
    return MAVLINK_NAMES[type(message)], fields


def _id_or_mac(fields: dict[str, Any]) -> bytes | None:
    return read_id_or_mac(fields["id_or_mac"])


# --- altitudes, times ---


def _read_altitude(value: float, name: str, rejects: FieldRejects) -> float | None:
    if value == UNKNOWN_ALTITUDE_M:
        return None
    if not UNKNOWN_ALTITUDE_M < value <= MAX_ALTITUDE_M:  # also catches NaN
        rejects[name] += 1
        return None
    return value


def _write_altitude(value_m: float | None) -> float:
    if value_m is None or not UNKNOWN_ALTITUDE_M < value_m <= MAX_ALTITUDE_M:
        return UNKNOWN_ALTITUDE_M
    return value_m


def _read_timestamp(value: float, name: str, rejects: FieldRejects) -> float | None:
    if 0.0 <= value <= SECONDS_PER_HOUR:
        return value
    if value != UNKNOWN_TIMESTAMP_S and not math.isnan(value):
        rejects[name] += 1
    return None


def _write_timestamp(value_s: float | None) -> float:
    if value_s is None or not 0.0 <= value_s <= SECONDS_PER_HOUR:
        return UNKNOWN_TIMESTAMP_S
    return value_s


# --- LOCATION ---


def _read_location(fields: dict[str, Any], rejects: FieldRejects) -> Location:
    latitude, longitude = read_position(
        fields["latitude"],
        fields["longitude"],
        ("OPEN_DRONE_ID_LOCATION.latitude", "OPEN_DRONE_ID_LOCATION.longitude"),
        rejects,
    )
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
        altitude_barometric_m=_read_altitude(
            fields["altitude_barometric"], "OPEN_DRONE_ID_LOCATION.altitude_barometric", rejects
        ),
        altitude_geodetic_m=_read_altitude(
            fields["altitude_geodetic"], "OPEN_DRONE_ID_LOCATION.altitude_geodetic", rejects
        ),
        height_m=_read_altitude(fields["height"], "OPEN_DRONE_ID_LOCATION.height", rejects),
        height_reference=fields["height_reference"],
        horizontal_accuracy=fields["horizontal_accuracy"],
        vertical_accuracy=fields["vertical_accuracy"],
        barometer_accuracy=fields["barometer_accuracy"],
        speed_accuracy=fields["speed_accuracy"],
        horizontal_accuracy_m=accuracy.horizontal_bound_m(fields["horizontal_accuracy"]),
        vertical_accuracy_m=accuracy.vertical_bound_m(fields["vertical_accuracy"]),
        barometer_accuracy_m=accuracy.vertical_bound_m(fields["barometer_accuracy"]),
        speed_accuracy_mps=accuracy.speed_bound_mps(fields["speed_accuracy"]),
        timestamp_s=_read_timestamp(fields["timestamp"], "OPEN_DRONE_ID_LOCATION.timestamp", rejects),
        timestamp_accuracy_s=accuracy.time_bound_s(fields["timestamp_accuracy"]),
        id_or_mac=_id_or_mac(fields),
    )


def _write_direction(value_deg: float | None) -> int:
    if value_deg is None or not math.isfinite(value_deg):
        return UNKNOWN_DIRECTION_CDEG
    return round(value_deg % 360.0 * 100.0) % 36000


def _write_speed_horizontal(value_mps: float | None) -> int:
    if value_mps is None or not value_mps >= 0.0:
        return UNKNOWN_SPEED_HORIZONTAL_CMPS
    return cmps_from_mps(min(value_mps, MAX_SPEED_HORIZONTAL_CMPS / 100.0))


def _write_speed_vertical(value_mps: float | None) -> int:
    if value_mps is None or math.isnan(value_mps):
        return UNKNOWN_SPEED_VERTICAL_CMPS
    limit = MAX_SPEED_VERTICAL_CMPS / 100.0
    return cmps_from_mps(min(max(value_mps, -limit), limit))


def _write_location(message: Location) -> dict[str, Any]:
    latitude, longitude = write_position(message.latitude_deg, message.longitude_deg)
    return {
        "status": message.status,
        "direction": _write_direction(message.direction_deg),
        "speed_horizontal": _write_speed_horizontal(message.speed_horizontal_mps),
        "speed_vertical": _write_speed_vertical(message.speed_vertical_mps),
        "latitude": latitude,
        "longitude": longitude,
        "altitude_barometric": _write_altitude(message.altitude_barometric_m),
        "altitude_geodetic": _write_altitude(message.altitude_geodetic_m),
        "height": _write_altitude(message.height_m),
        "height_reference": message.height_reference,
        "horizontal_accuracy": message.horizontal_accuracy or accuracy.horizontal_code(message.horizontal_accuracy_m),
        "vertical_accuracy": message.vertical_accuracy or accuracy.vertical_code(message.vertical_accuracy_m),
        "barometer_accuracy": message.barometer_accuracy or accuracy.vertical_code(message.barometer_accuracy_m),
        "speed_accuracy": message.speed_accuracy or accuracy.speed_code(message.speed_accuracy_mps),
        "timestamp": _write_timestamp(message.timestamp_s),
        "timestamp_accuracy": accuracy.time_code(message.timestamp_accuracy_s),
    }


# --- RIDLINK_SEPARATION ---


def _read_separation(fields: dict[str, Any], rejects: FieldRejects) -> Separation:
    flags: int = fields["flags"]
    given = flags & _COMMANDED_VELOCITY_GIVEN
    return Separation(
        timestamp_s=_read_timestamp(fields["timestamp"], "RIDLINK_SEPARATION.timestamp", rejects),
        horizontal_error_m=_read_length(fields["horizontal_error"]),
        vertical_error_m=_read_length(fields["vertical_error"]),
        velocity_error_mps=_read_length(fields["velocity_error"]),
        airframe_size_m=_read_length(fields["airframe_size"]),
        airframe_height_m=_read_length(fields["airframe_height"]),
        update_interval_s=fields["update_interval"] / 1e3 if fields["update_interval"] else None,
        commanded_vx_mps=mps_from_cmps(fields["commanded_vx"]) if given else None,
        commanded_vy_mps=mps_from_cmps(fields["commanded_vy"]) if given else None,
        commanded_vz_mps=mps_from_cmps(fields["commanded_vz"]) if given else None,
        flags=flags,
        id_or_mac=_id_or_mac(fields),
    )


def _read_length(value_cm: int) -> float | None:
    return m_from_cm(value_cm) if value_cm else None


def _write_component(value_mps: float) -> int:
    return min(max(cmps_from_mps(value_mps), -MAX_INT16), MAX_INT16)


def _write_separation(message: Separation) -> dict[str, Any]:
    flags = int(message.flags) & ~_COMMANDED_VELOCITY_GIVEN
    vx = vy = vz = 0
    if (commanded := message.commanded_ned_mps) is not None:
        vx, vy, vz = map(_write_component, commanded)
        flags |= _COMMANDED_VELOCITY_GIVEN
    return {
        "timestamp": _write_timestamp(message.timestamp_s),
        "horizontal_error": write_error(message.horizontal_error_m),
        "vertical_error": write_error(message.vertical_error_m),
        "velocity_error": write_error(message.velocity_error_mps),
        "airframe_size": write_up(message.airframe_size_m, 0.01),
        "airframe_height": write_up(message.airframe_height_m, 0.01),
        "update_interval": write_up(message.update_interval_s, 0.001),
        "commanded_vx": vx,
        "commanded_vy": vy,
        "commanded_vz": vz,
        "flags": flags,
    }


# --- SYSTEM ---


def _read_system(fields: dict[str, Any], rejects: FieldRejects) -> System:
    latitude, longitude = read_position(
        fields["operator_latitude"],
        fields["operator_longitude"],
        ("OPEN_DRONE_ID_SYSTEM.operator_latitude", "OPEN_DRONE_ID_SYSTEM.operator_longitude"),
        rejects,
    )
    return System(
        operator_location_type=fields["operator_location_type"],
        classification_type=fields["classification_type"],
        operator_latitude_deg=latitude,
        operator_longitude_deg=longitude,
        area_count=fields["area_count"],
        area_radius_m=float(fields["area_radius"]),
        area_ceiling_m=_read_altitude(fields["area_ceiling"], "OPEN_DRONE_ID_SYSTEM.area_ceiling", rejects),
        area_floor_m=_read_altitude(fields["area_floor"], "OPEN_DRONE_ID_SYSTEM.area_floor", rejects),
        category_eu=fields["category_eu"],
        class_eu=fields["class_eu"],
        operator_altitude_geo_m=_read_altitude(
            fields["operator_altitude_geo"], "OPEN_DRONE_ID_SYSTEM.operator_altitude_geo", rejects
        ),
        timestamp_s=read_seconds_since_2019(fields["timestamp"]),
        id_or_mac=_id_or_mac(fields),
    )


def _write_system(message: System) -> dict[str, Any]:
    latitude, longitude = write_position(message.operator_latitude_deg, message.operator_longitude_deg)
    return {
        "operator_location_type": message.operator_location_type,
        "classification_type": message.classification_type,
        "operator_latitude": latitude,
        "operator_longitude": longitude,
        "area_count": message.area_count,
        "area_radius": write_up(message.area_radius_m, 1.0),
        "area_ceiling": _write_altitude(message.area_ceiling_m),
        "area_floor": _write_altitude(message.area_floor_m),
        "category_eu": message.category_eu,
        "class_eu": message.class_eu,
        "operator_altitude_geo": _write_altitude(message.operator_altitude_geo_m),
        "timestamp": write_seconds_since_2019(message.timestamp_s),
    }


# --- identities, texts, authentication ---
# Fixed-length byte strings lose their padding on the way in and get it back on the way out.


def _read_basic_id(fields: dict[str, Any], _: FieldRejects) -> BasicId:
    return BasicId(fields["id_type"], fields["ua_type"], fields["uas_id"].rstrip(b"\x00"), _id_or_mac(fields))


def _write_basic_id(message: BasicId) -> dict[str, Any]:
    return {
        "id_type": message.id_type,
        "ua_type": message.ua_type,
        "uas_id": message.uas_id.ljust(ID_LENGTH, b"\x00"),
    }


def _read_self_id(fields: dict[str, Any], _: FieldRejects) -> SelfId:
    return SelfId(fields["description_type"], fields["description"].rstrip(b"\x00"), _id_or_mac(fields))


def _write_self_id(message: SelfId) -> dict[str, Any]:
    return {
        "description_type": message.description_type,
        "description": message.description.ljust(TEXT_LENGTH, b"\x00"),
    }


def _read_operator_id(fields: dict[str, Any], _: FieldRejects) -> OperatorId:
    return OperatorId(fields["operator_id_type"], fields["operator_id"].rstrip(b"\x00"), _id_or_mac(fields))


def _write_operator_id(message: OperatorId) -> dict[str, Any]:
    return {
        "operator_id_type": message.operator_id_type,
        "operator_id": message.operator_id.ljust(ID_LENGTH, b"\x00"),
    }


def _read_authentication(fields: dict[str, Any], _: FieldRejects) -> Authentication:
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
        _id_or_mac(fields),
    )


def _write_authentication(message: Authentication) -> dict[str, Any]:
    return {
        "authentication_type": message.authentication_type,
        "data_page": message.data_page,
        "last_page_index": message.last_page_index,
        "length": message.length,
        "timestamp": write_seconds_since_2019(message.timestamp_s),
        "authentication_data": message.authentication_data.ljust(AUTHENTICATION_PAGE_LENGTH, b"\x00"),
    }


_Reader = Callable[[dict[str, Any], FieldRejects], RemoteIdMessage]
_Writer = Callable[[Any], dict[str, Any]]

_FORMS: dict[type, tuple[_Reader, _Writer]] = {
    Location: (_read_location, _write_location),
    Separation: (_read_separation, _write_separation),
    BasicId: (_read_basic_id, _write_basic_id),
    System: (_read_system, _write_system),
    SelfId: (_read_self_id, _write_self_id),
    OperatorId: (_read_operator_id, _write_operator_id),
    Authentication: (_read_authentication, _write_authentication),
}
_READERS: dict[str, _Reader] = {MAVLINK_NAMES[kind]: read for kind, (read, _) in _FORMS.items()}
_WRITERS: dict[type, _Writer] = {kind: write for kind, (_, write) in _FORMS.items()}
