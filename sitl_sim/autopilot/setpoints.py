"""SET_POSITION_TARGET_LOCAL_NED (84) to what the vehicle is asked to fly.

The mask is read bit by bit, because every client sets its own: MAVSDK 0x09C7, MAVProxy 0x0FC7, ArduPilot's examples
0x0DC7. A set bit means "ignore". What both real autopilots do is kept: a mask that ignores only some velocity axes is
no velocity at all and stops the vehicle, and what is not finite (or beyond all reason) is not taken.

Axes: north-east-down about the vehicle's own origin; frames 8 and 9 turn with its heading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.navigation import Vector

LARGEST = 1e6
"""Most metres or metres a second that are taken; figures near the end of a float do not survive a rotation."""


class TypeMask(IntFlag):
    """POSITION_TARGET_TYPEMASK, grouped; set bits are ignored."""

    POSITION = 0x007
    VELOCITY = 0x038
    ACCELERATION = 0x1C0
    FORCE = 0x200
    YAW = 0x400
    YAW_RATE = 0x800


class LocalFrame(IntEnum):
    """MAV_FRAME values that are accepted."""

    LOCAL_NED = 1
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A usable setpoint.

    Args:
        velocity_ned_mps: What to fly; beside a position, what to add to the way there. None: not given.
        position_ned_m: Where to fly, about the vehicle's origin. None: not given. With neither, the vehicle stops.
        yaw_rad, yaw_rate_radps: Heading, or how fast to turn; None: not given.
    """

    velocity_ned_mps: Vector | None = None
    position_ned_m: Vector | None = None
    yaw_rad: float | None = None
    yaw_rate_radps: float | None = None


class RefusedSetpoint(Exception):
    """A setpoint that cannot be taken; the text is for STATUSTEXT."""


def decode_setpoint(message: Message, position_ned_m: Vector, yaw_rad: float) -> Setpoint:
    """What a setpoint asks for.

    Args:
        message: SET_POSITION_TARGET_LOCAL_NED.
        position_ned_m: Where the vehicle believes to be, about its own origin, for frames that give an offset.
        yaw_rad: Its heading, for frames that turn with it.

    Raises:
        RefusedSetpoint: If the frame is unknown, or a figure that is used is not finite.
    """
    try:
        frame = LocalFrame(message.coordinate_frame)
    except ValueError:
        raise RefusedSetpoint(f"setpoint: unsupported frame {message.coordinate_frame}") from None
    mask = message.type_mask
    velocity = position = None
    if not mask & TypeMask.VELOCITY:
        velocity = _finite(message.vx, message.vy, message.vz)
    if not mask & TypeMask.POSITION:
        position = _finite(message.x, message.y, message.z)
    if frame in (LocalFrame.BODY_NED, LocalFrame.BODY_OFFSET_NED):
        velocity = velocity and _turned(velocity, yaw_rad)
        position = position and _turned(position, yaw_rad)
    if position is not None and frame is not LocalFrame.LOCAL_NED:
        position = _sum(position, position_ned_m)
    if velocity is None and mask & TypeMask.VELOCITY != TypeMask.VELOCITY:
        position = None  # only some axes ignored: no valid velocity, and no way to guess what was meant
    return Setpoint(
        velocity,
        position,
        None if mask & TypeMask.YAW or not math.isfinite(message.yaw) else message.yaw,
        None if mask & TypeMask.YAW_RATE or not math.isfinite(message.yaw_rate) else message.yaw_rate,
    )


def _finite(x: float, y: float, z: float) -> Vector:
    if not (abs(x) <= LARGEST and abs(y) <= LARGEST and abs(z) <= LARGEST):  # also catches NaN
        raise RefusedSetpoint("setpoint ignored: not finite")
    return x, y, z


def _turned(vector: Vector, yaw_rad: float) -> Vector:
    forward, right, down = vector
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * forward - sin * right, sin * forward + cos * right, down


def _sum(one: Vector, other: Vector) -> Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]
