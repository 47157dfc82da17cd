"""The Open Drone ID messages and RIDLINK_SEPARATION in SI units, the same for their MAVLink and 25-byte forms.

``None`` means unknown. Angles are in degrees clockwise from true north, altitudes in metres, speeds in metres a second
(``speed_vertical_mps`` is positive upwards, as in ASTM F3411). Times are in seconds after the full UTC hour; in SYSTEM
and AUTHENTICATION they are in seconds since 2019-01-01 UTC. Accuracy codes stay integers (reserved ones included);
``*_accuracy_m`` and ``*_accuracy_mps`` are the bounds that the codes stand for. ``id_or_mac`` is ``None`` for the
sender's own data. The modules ``location``, ``system``, ``separation`` and ``identities`` define the wire forms;
``convert`` and ``astm`` call them.

The messages are structs, not dataclasses, since they are created thousands of times a second: a frozen dataclass of
twenty fields takes five microseconds, a struct one.
"""

from __future__ import annotations

import math
from enum import IntFlag

from msgspec import Struct

STATUS_UNDECLARED, STATUS_ON_GROUND, STATUS_AIRBORNE, STATUS_FAILURE = 0, 1, 2, 4
"""MAV_ODID_STATUS, as `Location.status` has it."""

ID_TYPE_NONE, ID_TYPE_SERIAL_NUMBER = 0, 1
"""MAV_ODID_ID_TYPE, as `BasicId.id_type` has it; the others are registrations and sessions."""


class BasicId(Struct, frozen=True, gc=False):
    """OPEN_DRONE_ID_BASIC_ID (12900)."""

    id_type: int
    ua_type: int
    uas_id: bytes
    id_or_mac: bytes | None = None


class Location(Struct, frozen=True, gc=False):
    """OPEN_DRONE_ID_LOCATION (12901)."""

    status: int = 0
    direction_deg: float | None = None
    speed_horizontal_mps: float | None = None
    speed_vertical_mps: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_barometric_m: float | None = None
    altitude_geodetic_m: float | None = None
    height_m: float | None = None
    height_reference: int = 0
    horizontal_accuracy: int = 0
    vertical_accuracy: int = 0
    barometer_accuracy: int = 0
    speed_accuracy: int = 0
    horizontal_accuracy_m: float | None = None
    vertical_accuracy_m: float | None = None
    barometer_accuracy_m: float | None = None
    speed_accuracy_mps: float | None = None
    timestamp_s: float | None = None
    timestamp_accuracy_s: float | None = None
    id_or_mac: bytes | None = None


class Authentication(Struct, frozen=True, gc=False):
    """OPEN_DRONE_ID_AUTHENTICATION (12902)."""

    authentication_type: int
    data_page: int
    last_page_index: int
    length: int
    timestamp_s: float | None
    authentication_data: bytes
    id_or_mac: bytes | None = None


class SelfId(Struct, frozen=True, gc=False):
    """OPEN_DRONE_ID_SELF_ID (12903)."""

    description_type: int
    description: bytes
    id_or_mac: bytes | None = None


class System(Struct, frozen=True, gc=False):
    """OPEN_DRONE_ID_SYSTEM (12904)."""

    operator_location_type: int = 0
    classification_type: int = 0
    operator_latitude_deg: float | None = None
    operator_longitude_deg: float | None = None
    area_count: int = 1
    area_radius_m: float = 0.0
    area_ceiling_m: float | None = None
    area_floor_m: float | None = None
    category_eu: int = 0
    class_eu: int = 0
    operator_altitude_geo_m: float | None = None
    timestamp_s: float | None = None
    id_or_mac: bytes | None = None


class OperatorId(Struct, frozen=True, gc=False):
    """OPEN_DRONE_ID_OPERATOR_ID (12905)."""

    operator_id_type: int
    operator_id: bytes
    id_or_mac: bytes | None = None


class SeparationFlags(IntFlag):
    """RIDLINK_SEPARATION_FLAGS."""

    AVOIDING = 1
    ERROR_MEASURED = 2
    SIMULATED = 4
    COMMANDED_VELOCITY_GIVEN = 8


_AVOIDING = int(SeparationFlags.AVOIDING)  # an enumeration's own "&" takes a microsecond


class Separation(Struct, frozen=True, gc=False):
    """RIDLINK_SEPARATION (61400). Errors are three standard deviations; the airframe size is a diameter."""

    timestamp_s: float | None = None
    horizontal_error_m: float | None = None
    vertical_error_m: float | None = None
    velocity_error_mps: float | None = None
    airframe_size_m: float | None = None
    airframe_height_m: float | None = None
    update_interval_s: float | None = None
    commanded_vx_mps: float | None = None
    commanded_vy_mps: float | None = None
    commanded_vz_mps: float | None = None
    flags: int = 0
    id_or_mac: bytes | None = None

    @property
    def avoiding(self) -> bool:
        """The sender does its reciprocal half of every avoidance manoeuvre."""
        return bool(self.flags & _AVOIDING)

    @property
    def commanded_ned_mps(self) -> tuple[float, float, float] | None:
        """The velocity that the sender is commanded to fly [m/s]; None unless all components are known and finite."""
        north, east, down = self.commanded_vx_mps, self.commanded_vy_mps, self.commanded_vz_mps
        if north is None or east is None or down is None:
            return None
        return (north, east, down) if all(map(math.isfinite, (north, east, down))) else None


RemoteIdMessage = BasicId | Location | Authentication | SelfId | System | OperatorId | Separation

MAVLINK_NAMES: dict[type[RemoteIdMessage], str] = {
    BasicId: "OPEN_DRONE_ID_BASIC_ID",
    Location: "OPEN_DRONE_ID_LOCATION",
    Authentication: "OPEN_DRONE_ID_AUTHENTICATION",
    SelfId: "OPEN_DRONE_ID_SELF_ID",
    System: "OPEN_DRONE_ID_SYSTEM",
    OperatorId: "OPEN_DRONE_ID_OPERATOR_ID",
    Separation: "RIDLINK_SEPARATION",
}
