"""Two engines meet head-on: every byte is real MAVLink, no socket is opened, and time is virtual.

Each vehicle is a point that obeys setpoints at once. It sends its position to its own engine, as an autopilot would. To
the other engine it sends Remote ID: LOCATION, and RIDLINK_SEPARATION with its error, its size and its intent.
"""

import math

import numpy as np

from ridlink.engine import Engine, EngineConfig, Goal
from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import Location, Separation, SeparationFlags

HOME = Geodetic(47.3977, 8.5456, 500.0)
STEP_S, CRUISE_MPS, ERROR_M, AIRFRAME_M = 0.1, 10.0, 3.0, 0.6


class Vehicle:
    """A point that speaks as an autopilot does, and its engine."""

    def __init__(self, sysid: int, north_m: float) -> None:
        self.position, self.velocity, self.goal = np.array([north_m, 0, 0]), np.zeros(3), np.array([-north_m, 0, 0])
        goal = Goal(*map(float, geodetic_from_ned(self.goal, HOME)))
        self.engine = Engine(EngineConfig(goal=goal, cruise_mps=CRUISE_MPS, airframe_m=AIRFRAME_M))
        self.encode = Encoder(sysid, 1).encode

    def telemetry(self, now_s: float) -> bytes:
        latitude, longitude, altitude = (float(value) for value in geodetic_from_ned(self.position, HOME))
        place = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7), "alt": round(altitude * 1e3)}
        vx, vy, vz = (round(100 * value) for value in self.velocity)
        return b"".join((
            self.encode("HEARTBEAT", type=2, autopilot=12, base_mode=129, custom_mode=6 << 16),  # armed, OFFBOARD
            self.encode("GPS_RAW_INT", fix_type=3, h_acc=round(ERROR_M / 3 * 1e3), **place),
            self.encode("GLOBAL_POSITION_INT", time_boot_ms=round(1e3 * now_s), vx=vx, vy=vy, vz=vz, **place),
        ))  # fmt: skip

    def remote_id(self, now_s: float) -> bytes:
        latitude, longitude, _ = (float(value) for value in geodetic_from_ned(self.position, HOME))
        (north, east, _), command = self.velocity, self.engine.setpoints.velocity
        location = Location(
            status=2,
            latitude_deg=latitude,
            longitude_deg=longitude,
            timestamp_s=now_s,
            speed_horizontal_mps=math.hypot(north, east),
            direction_deg=math.degrees(math.atan2(east, north)) % 360.0,
        )
        separation = Separation(
            timestamp_s=now_s, horizontal_error_m=ERROR_M, airframe_size_m=AIRFRAME_M,
            commanded_vx_mps=command[0], commanded_vy_mps=command[1], commanded_vz_mps=command[2],
            flags=SeparationFlags.AVOIDING | SeparationFlags.COMMANDED_VELOCITY_GIVEN | SeparationFlags.SIMULATED,
        )  # fmt: skip
        return b"".join(self.encode(name, **fields) for name, fields in (to_mavlink(location), to_mavlink(separation)))

    def obey(self, frames: list[bytes]) -> None:
        for found in parse_datagram(b"".join(frames), CRC_EXTRAS):
            message = decode_message(found) if isinstance(found, Frame) else None
            if message is not None and message.name == "SET_POSITION_TARGET_LOCAL_NED":
                self.velocity = np.array([message.vx, message.vy, message.vz])
        self.position = self.position + self.velocity * STEP_S


pair = Vehicle(1, -200.0), Vehicle(2, 200.0)
step, closest_m, on_right = 0, math.inf, False
print("time s   1: north  east m   2: north  east m   distance m   disc edge m  solver")
while step < 900 and any(math.dist(vehicle.position, vehicle.goal) > 2.0 for vehicle in pair):
    now_s = step * STEP_S
    for me, other in (pair, pair[::-1]):
        me.engine.receive_vehicle(me.telemetry(now_s), now_s)
        other.engine.receive_remote_id(me.remote_id(now_s), now_s, source="air")
    outputs = [vehicle.engine.step(now_s) for vehicle in pair]
    (n1, e1, _), (n2, e2, _) = (vehicle.position for vehicle in pair)
    distance_m = math.hypot(n1 - n2, e1 - e2)
    closest_m, on_right = min((closest_m, on_right), (distance_m, bool(e1 > e2)))
    if step % 30 == 0 and (decision := outputs[0].decision).status is not None:
        print(f"{now_s:6.1f} {n1:10.1f} {e1:6.1f} {n2:12.1f} {e2:6.1f} {distance_m:13.1f} "
              f"{decision.nearest_margin_m:12.1f}   {decision.status.name.lower()}")  # fmt: skip
    for vehicle, output in zip(pair, outputs, strict=True):
        vehicle.obey(output.to_vehicle)
    step += 1
side, needed_m = "right" if on_right else "left", AIRFRAME_M + 2 * ERROR_M + 2 * STEP_S * CRUISE_MPS
print(f"{step * STEP_S:.1f} s: each passed on its {side}, {closest_m:.1f} m apart, {needed_m:.1f} m needed")
