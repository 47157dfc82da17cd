"""A vehicle's own Remote ID, made from its autopilot's reports: an honest transmitter for any MAVLink autopilot.

LOCATION and RIDLINK_SEPARATION leave together every 100 ms, with one timestamp; what hardly changes leaves every 3 s.
An error that is sent is never smaller than what receiver and estimator say, three standard deviations where they give
one. If they are silent, or known to lie (ArduPilot keeps its accuracy figure after it has lost its fix, both autopilots
go on sending positions), it is at least what an unknown error counts for, and grows with every second. Without a
position, LOCATION has none, and its status says that the Remote ID system has failed.

Source: ASTM F3411 (periods); https://mavlink.io/en/services/opendroneid.html and the firmware of ArduRemoteID for what
a transmitter module needs: SYSTEM as often as it checks for it, and every message that it would miss otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ridlink.errors import ConfigError
from ridlink.failsafe import HEARTBEAT_LOST_S
from ridlink.mavlink.codec import Encoder
from ridlink.own_ship.telemetry import INFLATE_AFTER_S, MULTIROTORS, OwnShipTelemetry
from ridlink.periodic import Periodic
from ridlink.remote_id.accuracy import code_of_three_sigma
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import (
    ID_TYPE_NONE,
    ID_TYPE_SERIAL_NUMBER,
    STATUS_AIRBORNE,
    STATUS_FAILURE,
    STATUS_ON_GROUND,
    STATUS_UNDECLARED,
    BasicId,
    Location,
    OperatorId,
    RemoteIdMessage,
    SelfId,
    Separation,
    SeparationFlags,
    System,
)
from ridlink.remote_id.quantities import EPOCH_2019_S, ID_LENGTH, SECONDS_PER_HOUR, write_id_or_mac
from ridlink.remote_id.separation import authentication_of
from ridlink.separation.reference import AIRFRAME_HEIGHT_RANGE, AIRFRAME_RANGE, ERROR_CAP_M, UNKNOWN_ERROR_BOUND_M
from ridlink.setpoint import Velocity
from ridlink.traffic.own_state import OwnState
from ridlink.words import Named

INTERVAL_S = 0.1
STATIC_INTERVAL_S = 3.0
"""Time between two of BASIC_ID and SYSTEM: ASTM F3411 asks for static messages at least every 3 s."""
MODULE_INTERVAL_S = 1.0
"""The same for a module: if it misses SYSTEM for 3 s it says that the aircraft must not arm."""

WORST_ACCELERATION_MPS2 = 5.0
"""How fast a vehicle may have changed its velocity since its last position."""

TAKEOFF_LOCATION = 0
ABOVE_TAKEOFF = 0

_AEROPLANE, _MULTIROTOR, _HYBRID_LIFT, _BALLOON, _AIRSHIP = 1, 2, 4, 8, 10
UA_TYPES = {
    1: _AEROPLANE,
    **dict.fromkeys(MULTIROTORS - {0}, _MULTIROTOR),
    **dict.fromkeys(range(19, 26), _HYBRID_LIFT),
    7: _AIRSHIP,
    8: _BALLOON,
}
"""MAV_ODID_UA_TYPE by MAV_TYPE; any other type, as that of a generic vehicle, is not declared."""


class Form(Named):
    """Receivers that a broadcast is meant for.

    AIR: receivers that speak MAVLink, with RIDLINK_SEPARATION as it is.
    MODULE: a transmitter module, which puts it into 25-byte messages: RIDLINK_SEPARATION as the AUTHENTICATION that it
        is there, and all the messages that a module waits for.
    """

    AIR = "air"
    MODULE = "module"


@dataclass(frozen=True, slots=True)
class BroadcastSettings:
    """Facts about a vehicle that its autopilot cannot tell.

    Args:
        airframe_m: Largest horizontal extent, rotors turning.
        airframe_height_m: Largest vertical extent.
        uas_id: Identity; without it that of BASIC_ID on the vehicle link, else none is declared.
        operator_id: Identity of the operator; empty for none.
        form: Receivers that the broadcast is meant for.
        relayed_as: `id_or_mac` of a transmitter on whose behalf another one sends; None: the vehicle speaks for itself.

    Raises:
        ConfigError: If a size or an identity is invalid.
    """

    airframe_m: float
    airframe_height_m: float
    uas_id: bytes | None = None
    operator_id: bytes = b""
    form: Form = Form.AIR
    relayed_as: bytes | None = None

    def __post_init__(self) -> None:
        AIRFRAME_RANGE.check("airframe", self.airframe_m)
        AIRFRAME_HEIGHT_RANGE.check("airframe-height", self.airframe_height_m)
        for name, value in (("uas-id", self.uas_id), ("operator-id", self.operator_id), ("relay-as", self.relayed_as)):
            if value is not None and len(value) > ID_LENGTH:
                raise ConfigError(f"{name} must have at most {ID_LENGTH} bytes, got {len(value)}")
        if self.uas_id == b"":
            raise ConfigError("uas-id must have at least one byte; leave it out to declare none")
        if self.relayed_as is not None and not any(self.relayed_as):
            raise ConfigError("relay-as must not be empty or all zero: that says the vehicle speaks for itself")


class Broadcast:
    """Transmitter of one vehicle: called every step, it returns what to send.

    Args:
        settings: Facts that the autopilot cannot tell.
    """

    def __init__(self, settings: BroadcastSettings) -> None:
        self.settings = settings
        self._dynamic_due = Periodic(INTERVAL_S, early_s=INTERVAL_S / 2.0)  # steps may be woken late
        module = settings.form is Form.MODULE
        self._static_due = Periodic(MODULE_INTERVAL_S if module else STATIC_INTERVAL_S)

    def datagrams(
        self,
        encoder: Encoder,
        telemetry: OwnShipTelemetry,
        *,
        now_s: float,
        utc_s: float | None,
        uas_id: bytes | None = None,
        id_type: int = ID_TYPE_SERIAL_NUMBER,
        commanded: Velocity | None = None,
        avoiding: bool = False,
    ) -> list[bytes]:
        """Datagrams to send now; none before the vehicle is known.

        Args:
            encoder: Encoder whose system id is the vehicle's.
            telemetry: Telemetry of the autopilot.
            now_s: Monotonic time.
            utc_s: Seconds since 1970; None while not known.
            uas_id: Identity that the vehicle gives itself, used if the settings have none.
            id_type: Type of that identity, MAV_ODID_ID_TYPE.
            commanded: Velocity commanded to its autopilot now, north, east, down [m/s].
            avoiding: It takes its half of every avoidance.
        """
        if telemetry.lock is None:
            return []
        found = []
        if self._dynamic_due.due(now_s):
            own = telemetry.state(now_s)
            error_m = None if own is None else honest_error_m(telemetry, own)
            timestamp_s = None if utc_s is None else utc_s % SECONDS_PER_HOUR
            location = _location(telemetry, own, error_m, timestamp_s, now_s)
            separation = self._separation(telemetry, own, error_m, timestamp_s, commanded, avoiding, now_s)
            found.append(self._encode(encoder, location) + self._encode(encoder, self._as_sent(separation, utc_s)))
        if self._static_due.due(now_s):
            if self.settings.uas_id is not None:
                uas_id, id_type = self.settings.uas_id, ID_TYPE_SERIAL_NUMBER
            static = self._static(telemetry, uas_id, id_type, utc_s)
            found.append(b"".join(self._encode(encoder, message) for message in static))
        return found

    def _encode(self, encoder: Encoder, message: RemoteIdMessage) -> bytes:
        name, fields = to_mavlink(message)
        if self.settings.relayed_as is not None:
            fields["id_or_mac"] = write_id_or_mac(self.settings.relayed_as)
        return encoder.encode(name, **fields)

    def _as_sent(self, separation: Separation, utc_s: float | None) -> RemoteIdMessage:
        if self.settings.form is Form.AIR:
            return separation
        hour_start_s = None if utc_s is None else round(utc_s - utc_s % SECONDS_PER_HOUR - EPOCH_2019_S)
        return authentication_of(separation, hour_start_s)

    def _separation(
        self,
        telemetry: OwnShipTelemetry,
        own: OwnState | None,
        error_m: float | None,
        timestamp_s: float | None,
        commanded: Velocity | None,
        avoiding: bool,
        now_s: float,
    ) -> Separation:
        flags = SeparationFlags.AVOIDING if avoiding else SeparationFlags(0)
        if own is not None and own.age_s <= INFLATE_AFTER_S and telemetry.trust.measured(now_s):
            flags |= SeparationFlags.ERROR_MEASURED
        north, east, down = commanded or (None, None, None)
        return Separation(
            timestamp_s=timestamp_s,
            horizontal_error_m=error_m,
            vertical_error_m=_vertical_m(telemetry, own),
            velocity_error_mps=_velocity_mps(telemetry, now_s),
            airframe_size_m=self.settings.airframe_m,
            airframe_height_m=self.settings.airframe_height_m,
            update_interval_s=INTERVAL_S,
            commanded_vx_mps=north,
            commanded_vy_mps=east,
            commanded_vz_mps=down,
            flags=int(flags),
        )

    def _static(
        self, telemetry: OwnShipTelemetry, uas_id: bytes | None, id_type: int, utc_s: float | None
    ) -> list[RemoteIdMessage]:
        ua_type = UA_TYPES.get(telemetry.vehicle_type, 0)
        home, undulation_m = telemetry.home, telemetry.trust.undulation_m
        messages: list[RemoteIdMessage] = [
            BasicId(ID_TYPE_NONE, ua_type, b"") if uas_id is None else BasicId(id_type, ua_type, uas_id),
            System(
                operator_location_type=TAKEOFF_LOCATION,
                operator_latitude_deg=None if home is None else home.latitude_deg,
                operator_longitude_deg=None if home is None else home.longitude_deg,
                operator_altitude_geo_m=None
                if home is None or undulation_m is None
                else home.altitude_m + undulation_m,
                timestamp_s=None if utc_s is None else utc_s - EPOCH_2019_S,
            ),
        ]
        if self.settings.operator_id or self.settings.form is Form.MODULE:
            messages.append(OperatorId(0, self.settings.operator_id))
        if self.settings.form is Form.MODULE:
            messages.append(SelfId(0, b""))
        return messages


def honest_error_m(telemetry: OwnShipTelemetry, own: OwnState) -> float:
    """Horizontal error to tell others, three standard deviations [m]; infinite for "that or more".

    Args:
        telemetry: Telemetry of the autopilot.
        own: Own state that it gives now.
    """
    error_m = own.error_bound_m
    if own.age_s > INFLATE_AFTER_S:
        error_m += 0.5 * WORST_ACCELERATION_MPS2 * own.age_s**2
    if not telemetry.trust.trusted:
        error_m = max(error_m, UNKNOWN_ERROR_BOUND_M)
    return error_m if error_m < ERROR_CAP_M else math.inf


def _vertical_m(telemetry: OwnShipTelemetry, own: OwnState | None) -> float | None:
    return own.vertical_error_bound_m if own is not None and telemetry.trust.trusted else None


def _velocity_mps(telemetry: OwnShipTelemetry, now_s: float) -> float | None:
    return telemetry.trust.velocity_error_mps(now_s) if telemetry.trust.trusted else None


def _location(
    telemetry: OwnShipTelemetry, own: OwnState | None, error_m: float | None, timestamp_s: float | None, now_s: float
) -> Location:
    if own is None:
        return Location(status=STATUS_FAILURE, timestamp_s=timestamp_s)
    north, east, down = own.velocity_ned_mps
    vertical_m, velocity_mps = _vertical_m(telemetry, own), _velocity_mps(telemetry, now_s)
    return Location(
        status=_status(telemetry, now_s),
        direction_deg=math.degrees(math.atan2(east, north)) % 360.0,
        speed_horizontal_mps=own.speed_mps,
        speed_vertical_mps=-down,
        latitude_deg=own.position.latitude_deg,
        longitude_deg=own.position.longitude_deg,
        altitude_geodetic_m=own.altitude_ellipsoid_m,
        height_m=own.position.altitude_m - own.home_altitude_m,
        height_reference=ABOVE_TAKEOFF,
        horizontal_accuracy=code_of_three_sigma(error_m),
        # 95 % of a normal error are within two standard deviations.
        vertical_accuracy_m=None if vertical_m is None else vertical_m * 2.0 / 3.0,
        speed_accuracy_mps=None if velocity_mps is None else velocity_mps * 2.0 / 3.0,
        timestamp_s=timestamp_s,
    )


def _status(telemetry: OwnShipTelemetry, now_s: float) -> int:
    """On the ground only if the autopilot says so, or is disarmed: a vehicle that stands is no traffic to others."""
    if telemetry.heard_s(now_s) > HEARTBEAT_LOST_S:
        return STATUS_UNDECLARED
    if telemetry.landed_state_known(now_s):
        return STATUS_ON_GROUND if telemetry.on_ground else STATUS_AIRBORNE
    return STATUS_AIRBORNE if telemetry.armed else STATUS_ON_GROUND
