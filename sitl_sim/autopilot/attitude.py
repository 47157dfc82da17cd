"""Attitude of a multirotor, from its acceleration and its heading."""

from __future__ import annotations

import math

from sitl_sim.autopilot.navigation import Vector
from sitl_sim.vehicle import GRAVITY_MPS2


def attitude_rad(acceleration_ned_mps2: Vector, yaw_rad: float) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a multirotor whose thrust gives its acceleration."""
    north, east, down = acceleration_ned_mps2
    forward = math.cos(yaw_rad) * north + math.sin(yaw_rad) * east
    right = -math.sin(yaw_rad) * north + math.cos(yaw_rad) * east
    lift = max(GRAVITY_MPS2 - down, 1.0)
    pitch = math.atan2(-forward, lift)
    return math.atan2(right * math.cos(pitch), lift), pitch, yaw_rad


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """The attitude as a quaternion w, x, y, z."""
    roll, pitch, yaw = roll_rad / 2.0, pitch_rad / 2.0, yaw_rad / 2.0
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
