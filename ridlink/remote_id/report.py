"""`RemoteIdReport`: everything that one update of one vehicle says, in SI units, ``None`` for unknown.

A report is a LOCATION, joined with the RIDLINK_SEPARATION of the same instant if the sender sends one, and with the
last BASIC_ID of the same sender. Positions are WGS-84, velocities north-east-down, errors three standard deviations,
sizes diameters. Source: paper section II-A.
"""

from __future__ import annotations

import math

from msgspec import Struct

from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention, horizontal_bound_m, three_sigma_bound_m
from ridlink.remote_id.messages import STATUS_ON_GROUND, Location, Separation

SourceKey = tuple[int, int, bytes | None]
"""Identity of a sender: system id, component id and, for relayed data, ``id_or_mac``."""

_NO_EXTENSION = Separation()


class RemoteIdReport(Struct, frozen=True, gc=False):
    """One update of one vehicle.

    Attributes:
        source: System id and component id of the frame.
        id_or_mac: Transmitter of relayed data; ``None`` for the sender's own data.
        uas_id: Identity from the last BASIC_ID of this sender.
        ua_type: MAV_ODID_UA_TYPE, 0 unknown.
        status: MAV_ODID_STATUS: 0 undeclared, 1 ground, 2 airborne, 3 emergency, 4 remote ID failure.
        latitude_deg, longitude_deg: Both known or both ``None``.
        altitude_geodetic_m: Above the WGS-84 ellipsoid.
        altitude_barometric_m: Pressure altitude, against 1013.25 hPa.
        height_m: Above take-off (``height_reference`` 0) or ground (1).
        velocity_ned_mps: ``None`` if the speed is unknown, or if the vehicle moves and its direction is unknown. A
            hovering vehicle has no direction and velocity zero. The down component is 0 if the vertical speed is
            unknown.
        climb_mps: Vertical speed, positive upwards; ``None`` if unknown.
        speed_horizontal_mps: Known even if only the direction is missing.
        horizontal_error_m: Three standard deviations of either horizontal axis, as the sender states it.
        horizontal_accuracy_m: Bound of the standard's accuracy code, unchanged.
        accuracy_bound_m: The same code read as three standard deviations, by a convention.
        vertical_error_m, velocity_error_mps: Three standard deviations, as the sender states them.
        airframe_size_m: Largest horizontal extent, a diameter.
        airframe_height_m: Largest vertical extent.
        update_interval_s: Time to the next update, as the sender states it.
        commanded_ned_mps: Velocity that the sender now commands to its autopilot.
        avoiding: Whether the sender does its half of every avoidance manoeuvre.
        extended: Whether a RIDLINK_SEPARATION is part of this report.
        timestamp_s: The sender's UTC, seconds after the full hour.
        received_at_s: Time of receipt of the LOCATION, on the receiver's clock.
    """

    source: tuple[int, int]
    id_or_mac: bytes | None = None
    uas_id: bytes | None = None
    ua_type: int = 0
    status: int = 0
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_geodetic_m: float | None = None
    altitude_barometric_m: float | None = None
    height_m: float | None = None
    height_reference: int = 0
    velocity_ned_mps: tuple[float, float, float] | None = None
    climb_mps: float | None = None
    speed_horizontal_mps: float | None = None
    horizontal_error_m: float | None = None
    horizontal_accuracy_m: float | None = None
    accuracy_bound_m: float | None = None
    vertical_error_m: float | None = None
    velocity_error_mps: float | None = None
    airframe_size_m: float | None = None
    airframe_height_m: float | None = None
    update_interval_s: float | None = None
    commanded_ned_mps: tuple[float, float, float] | None = None
    avoiding: bool = False
    extended: bool = False
    timestamp_s: float | None = None
    received_at_s: float = 0.0

    @property
    def key(self) -> SourceKey:
        """Identity of the sender."""
        return (*self.source, self.id_or_mac)

    @property
    def on_ground(self) -> bool:
        """The vehicle says that it is on the ground, so it is no traffic."""
        return self.status == STATUS_ON_GROUND


def velocity_of(location: Location) -> tuple[float, float, float] | None:
    """Velocity [m/s], north, east, down, of a LOCATION; ``None`` if it is not known."""
    speed = location.speed_horizontal_mps
    if speed is None:
        return None
    down = -(location.speed_vertical_mps or 0.0) or 0.0  # never -0.0
    if speed == 0.0:
        return 0.0, 0.0, down
    if location.direction_deg is None:
        return None
    direction_rad = math.radians(location.direction_deg)
    return speed * math.cos(direction_rad), speed * math.sin(direction_rad), down


def report_of(
    source: tuple[int, int],
    location: Location,
    separation: Separation | None,
    received_at_s: float,
    *,
    uas_id: bytes | None = None,
    ua_type: int = 0,
    convention: AccuracyConvention = DEFAULT_CONVENTION,
) -> RemoteIdReport:
    """The report that a LOCATION and, if there is one, its RIDLINK_SEPARATION make.

    Args:
        source: System id and component id of the frame.
        location: The LOCATION.
        separation: Errors, size and intent of the same sender.
        received_at_s: Time of receipt of the LOCATION.
        uas_id: Identity from BASIC_ID.
        ua_type: Type from BASIC_ID.
        convention: How to read the horizontal accuracy code.
    """
    latitude, longitude = location.latitude_deg, location.longitude_deg
    if latitude is None or longitude is None:
        latitude = longitude = None
    extension = separation if separation is not None else _NO_EXTENSION
    return RemoteIdReport(
        source=source,
        id_or_mac=location.id_or_mac,
        uas_id=uas_id,
        ua_type=ua_type,
        status=location.status,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_geodetic_m=location.altitude_geodetic_m,
        altitude_barometric_m=location.altitude_barometric_m,
        height_m=location.height_m,
        height_reference=location.height_reference,
        velocity_ned_mps=velocity_of(location),
        climb_mps=location.speed_vertical_mps,
        speed_horizontal_mps=location.speed_horizontal_mps,
        horizontal_error_m=extension.horizontal_error_m,
        horizontal_accuracy_m=horizontal_bound_m(location.horizontal_accuracy),
        accuracy_bound_m=three_sigma_bound_m(location.horizontal_accuracy, convention),
        vertical_error_m=extension.vertical_error_m,
        velocity_error_mps=extension.velocity_error_mps,
        airframe_size_m=extension.airframe_size_m,
        airframe_height_m=extension.airframe_height_m,
        update_interval_s=extension.update_interval_s,
        commanded_ned_mps=extension.commanded_ned_mps,
        avoiding=extension.avoiding,
        extended=separation is not None,
        timestamp_s=location.timestamp_s,
        received_at_s=received_at_s,
    )
