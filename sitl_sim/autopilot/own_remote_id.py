"""The OPEN_DRONE_ID messages that PX4 puts on every one of its links, from its own component.

They are for a transmitter module on the vehicle; `sitl_sim.broadcast` makes the messages on the air. PX4 sends no time
of day and maps the receiver's one-sigma accuracy directly to the code, which understates the error.
"""

from __future__ import annotations

import math
from typing import Any, TypedDict

from ridlink.geodesy import Geodetic
from ridlink.remote_id.accuracy import horizontal_code
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import BasicId, Location, System
from sitl_sim.autopilot.navigation import Navigation

Fields = dict[str, Any]

_GROUND, _AIRBORNE = 1, 2
_SERIAL_NUMBER, _MULTIROTOR, _TAKEOFF_LOCATION = 1, 2, 0


class Motion(TypedDict):
    """Arguments of `Location`: position and motion."""

    status: int
    direction_deg: float
    speed_horizontal_mps: float
    speed_vertical_mps: float
    latitude_deg: float
    longitude_deg: float
    altitude_geodetic_m: float
    height_m: float


def motion_of(navigation: Navigation, home: Geodetic) -> Motion:
    """Position and motion of a navigation solution, without accuracies and time."""
    north, east, down = navigation.velocity_ned_mps
    return Motion(
        status=_AIRBORNE if navigation.in_air else _GROUND,
        direction_deg=math.degrees(math.atan2(east, north)) % 360.0,
        speed_horizontal_mps=math.hypot(north, east),
        speed_vertical_mps=-down,
        latitude_deg=navigation.place().latitude_deg,
        longitude_deg=navigation.place().longitude_deg,
        altitude_geodetic_m=navigation.place().altitude_m,
        height_m=navigation.place().altitude_m - home.altitude_m,
    )


def location_fields(navigation: Navigation, home: Geodetic) -> Fields:
    """Fields of OPEN_DRONE_ID_LOCATION."""
    _, fields = to_mavlink(
        Location(
            **motion_of(navigation, home),
            horizontal_accuracy=horizontal_code(navigation.h_acc_m),
            vertical_accuracy_m=navigation.v_acc_m,
            speed_accuracy_mps=navigation.vel_acc_mps,
        )
    )
    return fields


def system_fields(home: Geodetic) -> Fields:
    """Fields of OPEN_DRONE_ID_SYSTEM."""
    _, fields = to_mavlink(
        System(
            operator_location_type=_TAKEOFF_LOCATION,
            operator_latitude_deg=home.latitude_deg,
            operator_longitude_deg=home.longitude_deg,
            operator_altitude_geo_m=home.altitude_m,
        )
    )
    return fields


def basic_id_fields(system_id: int) -> Fields:
    """Fields of OPEN_DRONE_ID_BASIC_ID."""
    _, fields = to_mavlink(BasicId(_SERIAL_NUMBER, _MULTIROTOR, f"RDLK4{system_id:04d}".encode()))
    return fields
