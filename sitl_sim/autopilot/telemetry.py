"""The messages of an emulated autopilot: one function per message.

All values come from `Navigation`, with the receiver's error. Peculiarities of real autopilots are kept, since readers
must cope with them: PX4 sends GPS_RAW_INT with a time of 0, and ArduPilot keeps sending its last h_acc after it has
lost its fix, and finally stops sending LOCAL_POSITION_NED.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.units import cmps_from_mps, dege7_from_deg, mm_from_m
from sitl_sim.autopilot.attitude import attitude_rad, quaternion
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.ekf_status import ekf_status_fields
from sitl_sim.autopilot.failsafes import FIX_3D
from sitl_sim.autopilot.modes import MODE_FLAG_ARMED
from sitl_sim.autopilot.own_remote_id import basic_id_fields, location_fields, system_fields
from sitl_sim.autopilot.pilot import Pilot
from sitl_sim.autopilot.rates import default_intervals, on_request
from sitl_sim.vehicle import VehicleState

Fields = dict[str, Any]

_MAV_TYPE_QUADROTOR = 2
_STANDBY, _ACTIVE, _CRITICAL = 3, 4, 5
_ON_GROUND, _IN_AIR, _TAKING_OFF, _LANDING = 1, 2, 3, 4
_SENSORS = 0x1 | 0x2 | 0x4 | 0x8 | 0x20 | 0x200000 | 0x2000000 | 0x10000000
"""Gyro, accelerometer, magnetometer, barometer, GPS, AHRS, battery, pre-arm check."""

_GPS_SENSOR, _PREARM_CHECK = 0x20, 0x10000000
_GEOFENCE = 0x100000
"""ArduPilot reports a missing fence as healthy, and ground stations check this."""
_RTK_FIXED, _NO_FIX_ARDUPILOT = 6, 1
_LOST_H_ACC_MM = 100_000

_ESTIMATOR_GROUND, _ESTIMATOR_AIR, _ESTIMATOR_LOST = 1023, 895, 869

_VELOCITY_TARGET_MASK, _POSITION_TARGET_MASK = 0x0DC7, 0x0DF8
_UINT16_UNKNOWN = 0xFFFF
_INT16_MAX = 0x7FFF


class Telemetry:
    """Fields of every message that one vehicle can send.

    Args:
        board: The flight controller.
        pilot: The vehicle.
        utc_clock: Seconds since 1970.
    """

    def __init__(self, board: Board, pilot: Pilot, utc_clock: Callable[[], float]) -> None:
        self._board, self._pilot, self._utc_clock = board, pilot, utc_clock
        self._last_h_acc_mm = 0
        names = (*default_intervals(board.flavour), *on_request(board.flavour))
        self._builders: dict[str, Callable[[], Fields]] = {name: getattr(self, f"_{name.lower()}") for name in names}

    def __contains__(self, name: str) -> bool:
        return name in self._builders

    @property
    def home(self) -> Geodetic:
        """Estimated take-off position."""
        return self._board.own_home

    def tells(self, name: str) -> bool:
        """Whether a message is sent now, if it is due."""
        return name != "LOCAL_POSITION_NED" or self._pilot.failsafes.tells_position

    def fields(self, name: str) -> Fields:
        """Fields of one message now."""
        return self._builders[name]()

    @property
    def _boot_ms(self) -> int:
        return round(self._pilot.navigation.time_s * 1e3) & 0xFFFFFFFF

    @property
    def _boot_us(self) -> int:
        return round(self._pilot.navigation.time_s * 1e6)

    def _heartbeat(self) -> Fields:
        pilot, flavour = self._pilot, self._board.flavour
        is_active = pilot.armed if flavour.is_px4 else pilot.navigation.in_air
        armed = MODE_FLAG_ARMED if pilot.armed else 0
        return {
            "type": _MAV_TYPE_QUADROTOR,
            "autopilot": flavour.autopilot,
            "base_mode": flavour.base_mode | flavour.mode_flags.get(pilot.mode, 0) | armed,
            "custom_mode": flavour.custom_modes[pilot.mode],
            "system_status": _CRITICAL if pilot.failsafe else _ACTIVE if is_active else _STANDBY,
            "mavlink_version": 3,
        }

    def _sys_status(self) -> Fields:
        navigation = self._pilot.navigation
        healthy = _SENSORS if navigation.fix_type >= FIX_3D else _SENSORS & ~(_GPS_SENSOR | _PREARM_CHECK)
        return {
            "onboard_control_sensors_present": _SENSORS,
            "onboard_control_sensors_enabled": _SENSORS,
            "onboard_control_sensors_health": healthy | (0 if self._board.is_px4 else _GEOFENCE),
            "load": 150,
            "voltage_battery": _millivolts(navigation.battery_v),
            "current_battery": _centiamperes(navigation.battery_a),
            "battery_remaining": round(navigation.battery_remaining * 100.0),
        }

    def _battery_status(self) -> Fields:
        navigation = self._pilot.navigation
        return {
            "type": 1,
            "temperature": _INT16_MAX,
            # the first entry is the whole battery if cells are not measured singly
            "voltages": (_millivolts(navigation.battery_v), *(_UINT16_UNKNOWN,) * 9),
            "current_battery": _centiamperes(navigation.battery_a),
            "current_consumed": -1,
            "energy_consumed": -1,
            "battery_remaining": round(navigation.battery_remaining * 100.0),
            "charge_state": _charge_state(navigation.battery_remaining),
        }

    def _system_time(self) -> Fields:
        return {"time_unix_usec": round(self._utc_clock() * 1e6), "time_boot_ms": self._boot_ms}

    def _gps_raw_int(self) -> Fields:
        navigation = self._pilot.navigation
        north, east, _ = navigation.velocity_ned_mps
        has_fix = navigation.fix_type >= FIX_3D
        h_acc_mm = _up_mm(navigation.h_acc_m)
        if has_fix:
            self._last_h_acc_mm = h_acc_mm
        if self._board.is_px4:
            fix_type, time_us, eph = navigation.fix_type, 0, 70
            h_acc_mm = h_acc_mm if has_fix else _LOST_H_ACC_MM
        else:
            fix_type, time_us, eph = (_RTK_FIXED if has_fix else _NO_FIX_ARDUPILOT), self._boot_us, 121
            h_acc_mm = self._last_h_acc_mm
        return {
            "time_usec": time_us,
            "fix_type": fix_type,
            **_position(navigation.place().latitude_deg, navigation.place().longitude_deg, "lat", "lon"),
            "alt": mm_from_m(navigation.place().receiver_altitude_m),
            "alt_ellipsoid": mm_from_m(navigation.place().receiver_altitude_m),
            "eph": eph if has_fix else 9999,
            "epv": eph if has_fix else 9999,
            "vel": min(cmps_from_mps(math.hypot(north, east)), _UINT16_UNKNOWN - 1),
            "cog": _cdeg(math.atan2(east, north)),
            "satellites_visible": 14 if has_fix else 0,
            "h_acc": h_acc_mm,
            "v_acc": _up_mm(navigation.v_acc_m),
            "vel_acc": _up_mm(navigation.vel_acc_mps),
        }

    def _global_position_int(self) -> Fields:
        navigation = self._pilot.navigation
        return {
            "time_boot_ms": self._boot_ms,
            **_position(navigation.place().latitude_deg, navigation.place().longitude_deg, "lat", "lon"),
            "alt": mm_from_m(navigation.place().altitude_m),
            "relative_alt": mm_from_m(navigation.place().altitude_m - self.home.altitude_m),
            **{name: _int16_cmps(v) for name, v in zip(("vx", "vy", "vz"), navigation.velocity_ned_mps, strict=True)},
            "hdg": _cdeg(self._pilot.yaw_rad),
        }

    def _local_position_ned(self) -> Fields:
        return {
            "time_boot_ms": self._boot_ms,
            **dict(zip(("x", "y", "z"), self._pilot.local_position_ned_m, strict=True)),
            **dict(zip(("vx", "vy", "vz"), self._pilot.navigation.velocity_ned_mps, strict=True)),
        }

    def _attitude_rad(self) -> tuple[float, float, float]:
        return attitude_rad(self._pilot.navigation.acceleration_ned_mps2, self._pilot.yaw_rad)

    def _attitude(self) -> Fields:
        roll, pitch, yaw = self._attitude_rad()
        rate = self._pilot.nose.rate_radps
        return {"time_boot_ms": self._boot_ms, "roll": roll, "pitch": pitch, "yaw": yaw, "yawspeed": rate}

    def _attitude_quaternion(self) -> Fields:
        turned = dict(zip(("q1", "q2", "q3", "q4"), quaternion(*self._attitude_rad()), strict=True))
        return {"time_boot_ms": self._boot_ms, **turned, "yawspeed": self._pilot.nose.rate_radps}

    def _vfr_hud(self) -> Fields:
        navigation = self._pilot.navigation
        north, east, down = navigation.velocity_ned_mps
        return {
            # without a sensor: unknown on PX4; ArduPilot assumes calm air
            "airspeed": math.nan if self._board.is_px4 else math.hypot(north, east, down),
            "groundspeed": math.hypot(north, east),
            "heading": _cdeg(self._pilot.yaw_rad) // 100,
            "throttle": 50 if navigation.in_air else 0,
            "alt": navigation.place().altitude_m,
            "climb": -down,
        }

    def _position_target_local_ned(self) -> Fields:
        pilot = self._pilot
        target = pilot.position_target_ned_m
        fields: Fields = {
            "time_boot_ms": self._boot_ms,
            "coordinate_frame": 1,
            "type_mask": _VELOCITY_TARGET_MASK if target is None else _POSITION_TARGET_MASK,
            **dict(zip(("vx", "vy", "vz"), pilot.command_ned_mps, strict=True)),
        }
        return fields if target is None else fields | dict(zip(("x", "y", "z"), target, strict=True))

    def _position_target_global_int(self) -> Fields:
        pilot = self._pilot
        fields = {name: value for name, value in self._position_target_local_ned().items() if name not in "xyz"}
        target = pilot.position_target_ned_m or pilot.local_position_ned_m
        latitude, longitude, _ = geodetic_from_ned((target[0], target[1], 0.0), self._board.own_origin)
        place = _position(float(latitude), float(longitude), "lat_int", "lon_int")
        return {**fields, **place, "coordinate_frame": 5, "alt": self.home.altitude_m - target[2]}

    def _estimator_status(self) -> Fields:
        navigation = self._pilot.navigation
        if not self._pilot.failsafes.has_position:
            flags = _ESTIMATOR_LOST
        else:
            flags = _ESTIMATOR_AIR if navigation.in_air else _ESTIMATOR_GROUND
        return {
            "time_usec": self._boot_us,
            "flags": flags,
            "vel_ratio": 0.05,
            "pos_horiz_ratio": navigation.innovation_ratio,
            "pos_vert_ratio": 0.05,
            "mag_ratio": 0.05,
            "hagl_ratio": math.nan,
            "tas_ratio": math.nan,
            "pos_horiz_accuracy": navigation.ekf_h_acc_m,
            "pos_vert_accuracy": navigation.v_acc_m,
        }

    def _ekf_status_report(self) -> Fields:
        return ekf_status_fields(has_position=self._pilot.failsafes.has_position)

    def _extended_sys_state(self) -> Fields:
        pilot = self._pilot
        if pilot.navigation.state is VehicleState.GROUNDED:
            landed_state = _ON_GROUND
        elif pilot.is_climbing_out:
            landed_state = _TAKING_OFF
        else:
            landed_state = _LANDING if pilot.is_landing else _IN_AIR
        return {"vtol_state": 0, "landed_state": landed_state}

    def _home_position(self) -> Fields:
        return {
            **_position(self.home.latitude_deg, self.home.longitude_deg, "latitude", "longitude"),
            "altitude": mm_from_m(self.home.altitude_m),
            **dict(zip(("x", "y", "z"), self._pilot.home.about_origin(self._pilot.home.place_ned_m), strict=True)),
            "q": (1.0, 0.0, 0.0, 0.0),
            "approach_x": math.nan,
            "approach_y": math.nan,
            "approach_z": math.nan,
            "time_usec": self._boot_us,
        }

    def _altitude(self) -> Fields:
        altitude_m = self._pilot.navigation.place().altitude_m
        relative_m = altitude_m - self.home.altitude_m
        return {
            "time_usec": self._boot_us,
            "altitude_monotonic": relative_m,
            "altitude_amsl": altitude_m,
            "altitude_local": relative_m,
            "altitude_relative": relative_m,
            "altitude_terrain": math.nan,
            "bottom_clearance": math.nan,
        }

    def _gps_global_origin(self) -> Fields:
        origin = self._board.own_origin
        return {
            **_position(origin.latitude_deg, origin.longitude_deg, "latitude", "longitude"),
            "altitude": mm_from_m(origin.altitude_m),
            "time_usec": self._boot_us,
        }

    def _odometry(self) -> Fields:
        navigation = self._pilot.navigation
        pose = [math.nan] * 21
        pose[0] = pose[6] = navigation.h_acc_m**2
        pose[11] = navigation.v_acc_m**2
        speed = [math.nan] * 21
        speed[0] = speed[6] = speed[11] = navigation.vel_acc_mps**2
        return {
            "time_usec": self._boot_us,
            "frame_id": 1,
            "child_frame_id": 1,
            **dict(zip(("x", "y", "z"), self._pilot.local_position_ned_m, strict=True)),
            "q": quaternion(*self._attitude_rad()),
            **dict(zip(("vx", "vy", "vz"), navigation.velocity_ned_mps, strict=True)),
            "yawspeed": self._pilot.nose.rate_radps,
            "pose_covariance": pose,
            "velocity_covariance": speed,
            "estimator_type": 4,
            "quality": 100,
        }

    def _mission_current(self) -> Fields:
        return self._pilot.mission.current_fields()

    def _timesync(self) -> Fields:
        return {"tc1": 0, "ts1": max(round(self._pilot.navigation.time_s * 1e9), 1)}

    def _open_drone_id_location(self) -> Fields:
        return location_fields(self._pilot.navigation, self.home)

    def _open_drone_id_system(self) -> Fields:
        return system_fields(self.home)

    def _open_drone_id_basic_id(self) -> Fields:
        return basic_id_fields(self._board.system_id)

    def _autopilot_version(self) -> Fields:
        flavour = self._board.flavour
        below = flavour.version if flavour.is_px4 else 0  # ArduPilot does not report it
        return {
            "capabilities": flavour.capabilities,
            "flight_sw_version": flavour.version,
            "middleware_sw_version": below,
            "os_sw_version": below,
            "uid": self._board.system_id,
        }


def _position(latitude_deg: float, longitude_deg: float, latitude_name: str, longitude_name: str) -> Fields:
    return {latitude_name: dege7_from_deg(latitude_deg), longitude_name: dege7_from_deg(longitude_deg)}


def _millivolts(voltage_v: float) -> int:
    return min(round(voltage_v * 1e3), _UINT16_UNKNOWN - 1)


def _centiamperes(current_a: float) -> int:
    return min(round(current_a * 100.0), _INT16_MAX)


def _charge_state(remaining: float) -> int:
    """MAV_BATTERY_CHARGE_STATE at PX4's thresholds (BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR)."""
    return next((state for share, state in ((0.05, 4), (0.07, 3), (0.15, 2)) if remaining < share), 1)


def _cdeg(angle_rad: float) -> int:
    """Whole hundredths of a degree in [0, 36000)."""
    return round(math.degrees(angle_rad) * 100.0) % 36000


def _int16_cmps(speed_mps: float) -> int:
    return min(max(cmps_from_mps(speed_mps), -_INT16_MAX), _INT16_MAX)


def _up_mm(accuracy: float) -> int:
    """Whole millimetres (or mm/s), rounded up: an accuracy is never understated, and 0 would read as unknown."""
    return max(1, math.ceil(accuracy * 1e3 - 1e-6))
