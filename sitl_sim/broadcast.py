"""A vehicle's own Remote ID transmission: contents, times, and their source.

LOCATION and RIDLINK_SEPARATION go out together in one datagram each interval, with one timestamp; BASIC_ID and SYSTEM
every 3 s. A stock sender omits RIDLINK_SEPARATION. A vehicle that has landed reports this for 2 s, then stops sending;
a crashed vehicle is silent at once.

Positions and accuracies are those of the navigation solution. Frames come from component 1 of the vehicle;
``id_or_mac`` is zero, since a transmitter sends its own data.
"""

from __future__ import annotations

from collections.abc import Callable

from ridlink.geodesy import Geodetic
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.accuracy import code_of_three_sigma
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import (
    BasicId,
    Location,
    RemoteIdMessage,
    Separation,
    SeparationFlags,
    System,
)
from ridlink.remote_id.quantities import EPOCH_2019_S, SECONDS_PER_HOUR
from ridlink.scenario import VehicleSpec
from sitl_sim.autopilot.navigation import Navigation, Vector
from sitl_sim.autopilot.own_remote_id import motion_of
from sitl_sim.vehicle import VehicleState

STATIC_INTERVAL_S = 3.0
"""Time between two BASIC_ID or SYSTEM messages: ASTM F3411 requires static messages at least every 3 s."""

LANDED_S = 2.0
"""Time for which a landed vehicle reports that it is on the ground."""

_COMPONENT = 1
_SERIAL_NUMBER, _MULTIROTOR = 1, 2
_TAKEOFF_LOCATION = 0
_FIX_3D = 3
_ABOVE_TAKEOFF = 0
_TIMESTAMP_ACCURACY_S = 0.1


def uas_id_of(system_id: int) -> bytes:
    """Serial number of a vehicle in its BASIC_ID."""
    return f"RDLK4{system_id:04d}".encode()


class Broadcaster:
    """The transmitter of one vehicle.

    Args:
        system_id: Its system id.
        spec: Size, and whether it sends the extension.
        home: Its take-off position, sent as the operator's location.
        interval_s: Time between two LOCATIONs.
        utc_clock: Seconds since 1970.
        phase: When in the interval it sends, in [0, 1), so that a fleet does not send all at once.

    Attributes:
        home: May be set again, as autopilots do when they are armed.
    """

    def __init__(
        self,
        system_id: int,
        spec: VehicleSpec,
        home: Geodetic,
        *,
        interval_s: float,
        utc_clock: Callable[[], float],
        phase: float = 0.0,
    ) -> None:
        self._spec, self.home, self._utc_clock = spec, home, utc_clock
        self._interval_s, self._phase = interval_s, phase
        self._encoder = Encoder(system_id, _COMPONENT)
        self._basic_id = BasicId(_SERIAL_NUMBER, _MULTIROTOR, uas_id_of(system_id))
        self._due_s: float | None = None
        self._static_due_s = 0.0
        self._has_flown = False
        self._landed_s: float | None = None

    def tick(self, navigation: Navigation, command_ned_mps: Vector | None, now_s: float) -> list[bytes]:
        """Datagrams to broadcast now.

        Args:
            navigation: Navigation solution of the vehicle.
            command_ned_mps: The velocity that its avoidance daemon commands; None if it has no daemon.
            now_s: The caller's time.
        """
        if self._due_s is None:
            self._due_s = now_s + self._phase * self._interval_s
            self._static_due_s = now_s + self._phase * STATIC_INTERVAL_S
        if not self._is_on_air(navigation, now_s):
            return []
        datagrams = []
        if now_s >= self._due_s:
            behind = now_s - self._due_s >= self._interval_s
            self._due_s = (now_s if behind else self._due_s) + self._interval_s
            datagrams.append(self._dynamic(navigation, command_ned_mps))
        if now_s >= self._static_due_s:
            self._static_due_s = now_s + STATIC_INTERVAL_S
            datagrams.append(self._encode(self._basic_id) + self._encode(self._system()))
        return datagrams

    def _is_on_air(self, navigation: Navigation, now_s: float) -> bool:
        if navigation.state is VehicleState.GONE:
            return False
        if navigation.in_air:
            self._has_flown, self._landed_s = True, None
            return True
        if not self._has_flown:
            return True
        if self._landed_s is None:
            self._landed_s = now_s
        return now_s - self._landed_s <= LANDED_S

    def _encode(self, message: RemoteIdMessage) -> bytes:
        name, fields = to_mavlink(message)
        return self._encoder.encode(name, **fields)

    def _dynamic(self, navigation: Navigation, command_ned_mps: Vector | None) -> bytes:
        timestamp_s = self._utc_clock() % SECONDS_PER_HOUR
        datagram = self._encode(self._location(navigation, timestamp_s))
        if self._spec.extended:
            datagram += self._encode(self._separation(navigation, command_ned_mps, timestamp_s))
        return datagram

    def _location(self, navigation: Navigation, timestamp_s: float) -> Location:
        return Location(
            **motion_of(navigation, self.home),
            height_reference=_ABOVE_TAKEOFF,
            horizontal_accuracy=code_of_three_sigma(navigation.bound_3sigma_m),
            vertical_accuracy_m=2.0 * navigation.v_acc_m,  # 95 % of a normal figure
            speed_accuracy_mps=2.0 * navigation.vel_acc_mps,
            timestamp_s=timestamp_s,
            timestamp_accuracy_s=_TIMESTAMP_ACCURACY_S,
        )

    def _separation(self, navigation: Navigation, command_ned_mps: Vector | None, timestamp_s: float) -> Separation:
        flags = SeparationFlags.SIMULATED
        if navigation.fix_type >= _FIX_3D:
            flags |= SeparationFlags.ERROR_MEASURED
        if command_ned_mps is not None:
            flags |= SeparationFlags.AVOIDING
        vx, vy, vz = command_ned_mps or (None, None, None)
        return Separation(
            timestamp_s=timestamp_s,
            horizontal_error_m=navigation.bound_3sigma_m,
            vertical_error_m=3.0 * navigation.v_acc_m,
            velocity_error_mps=3.0 * navigation.vel_acc_mps,
            airframe_size_m=self._spec.airframe_m,
            airframe_height_m=self._spec.airframe_height_m,
            update_interval_s=self._interval_s,
            commanded_vx_mps=vx,
            commanded_vy_mps=vy,
            commanded_vz_mps=vz,
            flags=int(flags),
        )

    def _system(self) -> System:
        return System(
            operator_location_type=_TAKEOFF_LOCATION,
            operator_latitude_deg=self.home.latitude_deg,
            operator_longitude_deg=self.home.longitude_deg,
            operator_altitude_geo_m=self.home.altitude_m,
            timestamp_s=self._utc_clock() - EPOCH_2019_S,
        )
