"""Two engines meet head-on: every byte is real MAVLink, no socket is opened, and time is virtual.

Each vehicle is a point that obeys at once. It tells its engine where it is, as an autopilot would, and tells the other
one by Remote ID: LOCATION, and RIDLINK_SEPARATION beside it with its error, its size and its intent.
"""

from __future__ import annotations

import math

import numpy as np

from ridlink.engine import Engine, EngineConfig, Goal
from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import Location, Separation, SeparationFlags

HOME = Geodetic(47.3977, 8.5456, 500.0)
STEP_S, ERROR_M, AIRFRAME_M = 0.1, 3.0, 0.6


class Vehicle:
    """A point with an autopilot's voice and an engine."""

    def __init__(self, sysid: int, north_m: float, goal_north_m: float) -> None:
        self.goal = np.array([goal_north_m, 0.0, 0.0])
        latitude, longitude, _ = geodetic_from_ned(self.goal, HOME)
        self.engine = Engine(EngineConfig(goal=Goal(float(latitude), float(longitude)), airframe_m=AIRFRAME_M))
        self.position, self.velocity = np.array([north_m, 0.0, 0.0]), np.zeros(3)
        self.encoder = Encoder(sysid, 1)

    def telemetry(self, now_s: float) -> bytes:
        latitude, longitude, altitude = (float(value) for value in geodetic_from_ned(self.position, HOME))
        place = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7), "alt": round(altitude * 1e3)}
        north, east, down = (round(100 * v) for v in self.velocity)
        encode = self.encoder.encode
        return b"".join((
            encode("HEARTBEAT", type=2, autopilot=12, base_mode=129, custom_mode=6 << 16),
            encode("GPS_RAW_INT", fix_type=3, h_acc=round(ERROR_M / 3 * 1e3), v_acc=1000, **place),
            encode("GLOBAL_POSITION_INT", time_boot_ms=round(1e3 * now_s), vx=north, vy=east, vz=down, **place),
        ))  # fmt: skip

    def remote_id(self, now_s: float) -> bytes:
        latitude, longitude, _ = (float(value) for value in geodetic_from_ned(self.position, HOME))
        direction = math.degrees(math.atan2(self.velocity[1], self.velocity[0])) % 360.0
        north, east, down = self.engine.setpoints.velocity
        flags = SeparationFlags.AVOIDING | SeparationFlags.COMMANDED_VELOCITY_GIVEN | SeparationFlags.SIMULATED
        location = Location(
            status=2, direction_deg=direction, speed_horizontal_mps=float(np.hypot(*self.velocity[:2])),
            latitude_deg=latitude, longitude_deg=longitude, timestamp_s=now_s,
        )  # fmt: skip
        separation = Separation(
            timestamp_s=now_s, horizontal_error_m=ERROR_M, airframe_size_m=AIRFRAME_M, flags=flags,
            commanded_vx_mps=north, commanded_vy_mps=east, commanded_vz_mps=down,
        )  # fmt: skip
        return b"".join(self.encoder.encode(name, **fields) for name, fields in map(to_mavlink, (location, separation)))

    def obey(self, frames: list[bytes]) -> None:
        for frame in parse_datagram(b"".join(frames), CRC_EXTRAS):
            if isinstance(frame, Frame) and (message := decode_message(frame)).name == "SET_POSITION_TARGET_LOCAL_NED":
                self.velocity = np.array([message.vx, message.vy, message.vz])
        self.position = self.position + self.velocity * STEP_S


def main() -> None:
    pair = (Vehicle(1, -200.0, 200.0), Vehicle(2, 200.0, -200.0))
    print("time s   vehicle 1 N, E m   vehicle 2 N, E m   distance m   nearest disc m   solver")
    closest, side = math.inf, ""
    for step in range(700):
        now_s = step * STEP_S
        for me, other in (pair, pair[::-1]):
            me.engine.receive_vehicle(me.telemetry(now_s), now_s)
            other.engine.receive_remote_id(me.remote_id(now_s), "air", now_s)
        outputs = [vehicle.engine.step(now_s) for vehicle in pair]
        distance = float(np.hypot(*(pair[0].position - pair[1].position)[:2]))
        if distance < closest:
            closest, side = distance, "right" if pair[0].position[1] > pair[1].position[1] else "left"
        if step % 30 == 0:
            decision = outputs[0].decision
            (n1, e1, _), (n2, e2, _) = pair[0].position, pair[1].position
            name = decision.status.name.lower() if decision.status is not None else "-"
            print(f"{now_s:6.1f}  {n1:8.1f} {e1:8.1f}  {n2:8.1f} {e2:8.1f}  {distance:11.1f}  "
                  f"{decision.nearest_margin_m:15.1f}   {name}")  # fmt: skip
        if all(np.hypot(*(vehicle.position - vehicle.goal)[:2]) < 2.0 for vehicle in pair):
            break
        for vehicle, output in zip(pair, outputs, strict=True):
            vehicle.obey(output.to_vehicle)
    needed_m = AIRFRAME_M + 2 * ERROR_M + STEP_S * 20.0
    print(f"arrived after {now_s:.1f} s; each passed on its {side}, {closest:.1f} m apart, {needed_m:.1f} m needed")


if __name__ == "__main__":
    main()
