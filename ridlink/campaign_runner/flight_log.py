"""Writes one run as a MAVLink log, with the messages that every vehicle would have sent.

The log has truth and reports: GLOBAL_POSITION_INT is the true position of a vehicle, Open Drone ID LOCATION and
RIDLINK_SEPARATION are what it sent to others.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ridlink.campaign.flight import fly
from ridlink.campaign.plan import Plan
from ridlink.campaign.worlds import Instant, Outcomes, Roles, draw_roles
from ridlink.captures.tlog import TlogWriter
from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.accuracy import code_of_three_sigma
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import STATUS_AIRBORNE, Location, Separation, SeparationFlags
from ridlink.remote_id.quantities import write_position

BEGIN_S = 1_700_000_000
"""Time of the first record, seconds since 1970. It is fixed, so that the same flight gives the same bytes."""

ORIGIN = Geodetic(47.397742, 8.545594, 488.0)
"""Geodetic position for the origin of a scene, since scenes have none."""

HEIGHT_M = 50.0
HEARTBEAT_S = 1.0
MULTIROTOR, AUTOPILOT_GENERIC, ACTIVE, ARMED = 2, 0, 4, 0x80
LAST_SYSTEM_ID = 250


def log_run(plan: Plan, run: int, path: Path, begin: Callable[[], None] = lambda: None) -> Outcomes:
    """Fly one run of a plan and write it as a tlog; an existing file is replaced.

    Args:
        plan: The plan.
        run: Number of the run.
        path: The log.
        begin: Called when the log is open, before what takes long.

    Raises:
        ConfigError: If there are more vehicles than system ids.
        OSError: If the file cannot be written.
    """
    count = len(plan.scene)
    if count > LAST_SYSTEM_ID:
        raise ConfigError(f"a log has system ids for {LAST_SYSTEM_ID} vehicles, and {plan.scene.name} has {count}")
    encoders = [Encoder(system_id, 1) for system_id in range(1, count + 1)]
    roles = draw_roles(plan, run)
    bound_m = plan.bound_sigmas * plan.vehicle_sigma_m
    step_s = plan.step_s or plan.interval_s
    heartbeat_every = max(round(HEARTBEAT_S / step_s), 1)
    log = TlogWriter(path, overwrite=True)

    def watch(instant: Instant) -> None:
        step = round(instant.now_s / step_s)
        time_us = round((BEGIN_S + instant.now_s) * 1e6)
        for k in np.flatnonzero(instant.present[0]).tolist():
            if step % heartbeat_every == 0:
                beat = encoders[k].encode(
                    "HEARTBEAT", type=MULTIROTOR, autopilot=AUTOPILOT_GENERIC, base_mode=ARMED, system_status=ACTIVE,
                    mavlink_version=3,
                )  # fmt: skip
                log.write(time_us, beat)
            log.write(time_us, _position(encoders[k], instant, k))
            if instant.sending is not None and not instant.sending[0, k]:
                continue
            for message in _reports(instant, k, float(bound_m[k]), plan, roles):
                name, fields = to_mavlink(message)
                log.write(time_us, encoders[k].encode(name, **fields))

    try:
        begin()
        return fly(plan, range(run, run + 1), watch=watch)
    finally:
        log.close()


def _position(encoder: Encoder, instant: Instant, k: int) -> bytes:
    latitude_deg, longitude_deg, altitude_m = _geodetic(instant.position_ne_m[0, k])
    latitude, longitude = write_position(latitude_deg, longitude_deg)
    north, east = instant.velocity_ne_mps[0, k].tolist()
    return encoder.encode(
        "GLOBAL_POSITION_INT", time_boot_ms=round(instant.now_s * 1000.0), lat=latitude, lon=longitude,
        alt=round(altitude_m * 1000.0), relative_alt=round(HEIGHT_M * 1000.0), vx=round(north * 100.0),
        vy=round(east * 100.0), vz=0, hdg=round(_course_deg(north, east) * 100.0) % 36000,
    )  # fmt: skip


def _reports(instant: Instant, k: int, bound_m: float, plan: Plan, roles: Roles) -> list[Location | Separation]:
    latitude_deg, longitude_deg, altitude_m = _geodetic(instant.reported_ne_m[0, k])
    north, east = instant.velocity_ne_mps[0, k].tolist()
    timestamp_s = (BEGIN_S + instant.now_s) % 3600.0
    location = Location(
        status=STATUS_AIRBORNE, direction_deg=_course_deg(north, east), speed_horizontal_mps=math.hypot(north, east),
        speed_vertical_mps=0.0, latitude_deg=latitude_deg, longitude_deg=longitude_deg,
        altitude_geodetic_m=altitude_m, height_m=HEIGHT_M, horizontal_accuracy=code_of_three_sigma(bound_m),
        timestamp_s=timestamp_s, timestamp_accuracy_s=0.1,
    )  # fmt: skip
    if not roles.extended[k]:
        return [location]
    flags = SeparationFlags.SIMULATED | SeparationFlags.COMMANDED_VELOCITY_GIVEN
    if roles.avoiding[k]:
        flags |= SeparationFlags.AVOIDING
    north, east = instant.command_ne_mps[0, k].tolist()
    separation = Separation(
        timestamp_s=timestamp_s, horizontal_error_m=bound_m, velocity_error_mps=0.0,
        airframe_size_m=float(instant.airframe_m[0, k]), update_interval_s=plan.interval_s, commanded_vx_mps=north,
        commanded_vy_mps=east, commanded_vz_mps=0.0, flags=flags,
    )  # fmt: skip
    return [location, separation]


def _geodetic(position_ne_m: np.ndarray) -> tuple[float, float, float]:
    ned = np.array([position_ne_m[0], position_ne_m[1], -HEIGHT_M])
    latitude_deg, longitude_deg, altitude_m = geodetic_from_ned(ned, ORIGIN)
    return float(latitude_deg), float(longitude_deg), float(altitude_m)


def _course_deg(north: float, east: float) -> float:
    return math.degrees(math.atan2(east, north)) % 360.0
