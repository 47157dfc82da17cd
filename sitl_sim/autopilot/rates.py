"""The messages of an emulated autopilot, and their default rates."""

from __future__ import annotations

from sitl_sim.autopilot.modes import Flavour

DEFAULT_INTERVAL_S: dict[str, float] = {
    "HEARTBEAT": 1.0,
    "SYS_STATUS": 0.5,
    "BATTERY_STATUS": 0.5,
    "SYSTEM_TIME": 1.0,
    "GPS_RAW_INT": 0.2,
    "GLOBAL_POSITION_INT": 0.1,
    "LOCAL_POSITION_NED": 0.1,
    "ATTITUDE": 0.1,
    "ATTITUDE_QUATERNION": 0.1,
    "VFR_HUD": 0.2,
    "POSITION_TARGET_LOCAL_NED": 0.1,
    "EXTENDED_SYS_STATE": 0.5,
    "HOME_POSITION": 1.0,
    "ALTITUDE": 1.0,
    "ODOMETRY": 1.0,
    "MISSION_CURRENT": 1.0,
}
_PX4_INTERVAL_S = {"ESTIMATOR_STATUS": 1.0, "OPEN_DRONE_ID_LOCATION": 1.0, "OPEN_DRONE_ID_SYSTEM": 1.0}
_ARDUPILOT_INTERVAL_S = {"TIMESYNC": 10.0}

_ON_REQUEST = ("AUTOPILOT_VERSION", "GPS_GLOBAL_ORIGIN", "POSITION_TARGET_GLOBAL_INT")
_PX4_ON_REQUEST = ("OPEN_DRONE_ID_BASIC_ID",)
_ARDUPILOT_ON_REQUEST = ("EKF_STATUS_REPORT",)


def default_intervals(flavour: Flavour) -> dict[str, float]:
    """Interval of each message on a new link [s].

    A client that waits for a missing message waits forever. ArduPilot sends no position before a request, unless its SR
    parameters are set; the emulator behaves as if they were set.
    """
    return DEFAULT_INTERVAL_S | (_PX4_INTERVAL_S if flavour.is_px4 else _ARDUPILOT_INTERVAL_S)


def on_request(flavour: Flavour) -> tuple[str, ...]:
    """Messages that are sent only on request."""
    return (*_ON_REQUEST, *(_PX4_ON_REQUEST if flavour.is_px4 else _ARDUPILOT_ON_REQUEST))


LEGACY_STREAMS: dict[int, tuple[str, ...]] = {
    1: ("GPS_RAW_INT",),
    2: ("SYS_STATUS", "BATTERY_STATUS", "GPS_RAW_INT", "MISSION_CURRENT"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE", "ATTITUDE_QUATERNION"),
    11: ("VFR_HUD",),
    12: ("POSITION_TARGET_LOCAL_NED", "EXTENDED_SYS_STATE", "EKF_STATUS_REPORT"),
}
"""MAV_DATA_STREAM of the old REQUEST_DATA_STREAM; 0 is all of them."""
