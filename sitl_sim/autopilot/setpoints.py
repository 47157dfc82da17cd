"""Decodes SET_POSITION_TARGET_LOCAL_NED (84) and _GLOBAL_INT (86).

The mask is read bit by bit, because every client sets its own: MAVSDK 0x09C7, MAVProxy 0x0FC7, ArduPilot's examples
0x0DC7. A set bit means "ignore". ArduPilot takes a position or a velocity as a whole: a mask that ignores only some
axes of a velocity stops the vehicle. PX4 flies each axis by what it has, and stops if one has neither, or if north
comes without east. Neither takes values that are not finite (or unreasonably large), nor an acceleration that bit 0x200
makes a force.

Axes: north-east-down about the vehicle's own origin; frames 8 and 9 turn with its heading. The ground is flat:
altitudes over terrain are altitudes over home. PX4 takes fewer frames than ArduPilot, and no position in frame 8.

Source: handle_message_set_position_target_local_ned and _global_int in PX4's mavlink_receiver.cpp and in ArduCopter's
GCS_Mavlink.cpp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.mavlink.codec import Message
from ridlink.units import deg_from_dege7
from sitl_sim.autopilot.guidance import STILL, Accelerate, Guidance, Velocity
from sitl_sim.autopilot.navigation import Vector
from sitl_sim.autopilot.speeds import Speeds

LARGEST = 1e6
"""Largest accepted value in metres, m/s or m/s^2; values near the end of a float's range overflow in a rotation."""

ALTITUDE_FRAMES = (0, 5)
"""MAV_FRAME_GLOBAL and _INT: altitudes above mean sea level."""

HEIGHT_FRAMES = (3, 6, 10, 11)
"""MAV_FRAME_GLOBAL_RELATIVE_ALT, _TERRAIN_ALT and their _INT: heights above home."""


class TypeMask(IntFlag):
    """POSITION_TARGET_TYPEMASK, grouped; set bits are ignored."""

    POSITION = 0x007
    VELOCITY = 0x038
    ACCELERATION = 0x1C0
    FORCE = 0x200
    YAW = 0x400
    YAW_RATE = 0x800


class LocalFrame(IntEnum):
    """MAV_FRAME values that ArduPilot accepts."""

    LOCAL_NED = 1
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9


PX4_LOCAL_FRAMES = (LocalFrame.LOCAL_NED, LocalFrame.BODY_NED)
PX4_GLOBAL_FRAMES = (5, 6, 11)
"""Frames of a global position; both ignore the frame of a global velocity."""


@dataclass(frozen=True, slots=True)
class Here:
    """Reference of a setpoint.

    Args:
        position_ned_m: Estimated position about its own origin; for frames with an offset.
        yaw_rad: Its heading; for frames that turn with the vehicle.
        origin: Origin of its local frame; for global frames.
        px4: Whether PX4's rules apply. In frames that turn with the vehicle, PX4's heading counts from north,
            ArduPilot's from the nose.
    """

    position_ned_m: Vector
    yaw_rad: float
    origin: Geodetic
    px4: bool


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A usable setpoint; None: not given.

    Args:
        velocity_ned_mps: Velocity to fly; with a position, a velocity added on the way. NaN: no velocity in this axis.
        position_ned_m: Target position about the vehicle's origin. NaN: only the velocity counts in this axis.
        acceleration_ned_mps2: Acceleration, if it is alone. With none of the three, the vehicle stops.
        yaw_rad, yaw_rate_radps: Heading, or turn rate.
    """

    velocity_ned_mps: Vector | None = None
    position_ned_m: Vector | None = None
    acceleration_ned_mps2: Vector | None = None
    yaw_rad: float | None = None
    yaw_rate_radps: float | None = None


class RefusedSetpoint(Exception):
    """A setpoint that cannot be taken; the text is for STATUSTEXT."""


def decode_setpoint(message: Message, here: Here) -> Setpoint:
    """Decode a setpoint.

    Args:
        message: SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT.
        here: Its reference.

    Raises:
        RefusedSetpoint: If the frame is unknown, a used value is a force, not finite or no position on Earth, or, for
            PX4, if there is nothing to fly.
    """
    mask = message.type_mask
    velocity = acceleration = position = None
    yaw = None if mask & TypeMask.YAW or not math.isfinite(message.yaw) else message.yaw
    is_local = message.name == "SET_POSITION_TARGET_LOCAL_NED"
    turns = is_local and message.coordinate_frame in (LocalFrame.BODY_NED, LocalFrame.BODY_OFFSET_NED)
    _check_frame(message, is_local, px4=here.px4)
    if mask & TypeMask.FORCE and mask & TypeMask.ACCELERATION != TypeMask.ACCELERATION:
        raise RefusedSetpoint("setpoint: force not supported")
    if here.px4:
        _check_use(mask, turns)
    by_axis = here.px4 and not turns
    if by_axis or not mask & TypeMask.VELOCITY:
        velocity = _used(mask >> 3, message.vx, message.vy, message.vz)
    if not mask & TypeMask.ACCELERATION:
        acceleration = _finite(message.afx, message.afy, message.afz)
    if by_axis and is_local:
        position = _used(mask, message.x, message.y, message.z)
    elif not (mask & TypeMask.POSITION or (here.px4 and turns)):
        position = _finite(message.x, message.y, message.z) if is_local else _global_position(message, here)
    if turns:
        velocity = velocity and _turned(velocity, here.yaw_rad)
        acceleration = acceleration and _turned(acceleration, here.yaw_rad)
        position = position and _turned(position, here.yaw_rad)
        if yaw is not None and not here.px4:
            yaw = math.remainder(here.yaw_rad + yaw, math.tau)
    if position is not None and is_local and message.coordinate_frame != LocalFrame.LOCAL_NED:
        position = _sum(position, here.position_ned_m)
    if by_axis and not _is_flyable(position, velocity):
        position = velocity = acceleration = None
    elif velocity is None and mask & TypeMask.VELOCITY != TypeMask.VELOCITY:
        position = acceleration = None  # only some axes ignored: no valid velocity
    return Setpoint(
        velocity,
        position,
        acceleration,
        yaw,
        None if mask & TypeMask.YAW_RATE or not math.isfinite(message.yaw_rate) else message.yaw_rate,
    )


def guidance_of(setpoint: Setpoint, speeds: Speeds, origin_ned_m: Vector, flown_ned_mps: Vector, px4: bool) -> Guidance:
    """The manoeuvre for a setpoint. An acceleration counts only if it is alone.

    Args:
        setpoint: The setpoint.
        speeds: Speeds of the vehicle.
        origin_ned_m: Origin of its local frame, about the scenario's home.
        flown_ned_mps: Its present velocity, from which an acceleration starts.
        px4: Whether it is PX4. ArduPilot has no controller for a position with only an acceleration: it stops.
    """
    velocity, position, acceleration = (
        setpoint.velocity_ned_mps,
        setpoint.position_ned_m,
        setpoint.acceleration_ned_mps2,
    )
    if position is not None and (px4 or velocity is not None or acceleration is None):
        north, east, down = (0.0 if math.isnan(each) else each for each in velocity or STILL)
        return speeds.way_to(_sum(position, origin_ned_m), speeds.fastest_mps, (north, east, down))
    if position is None and velocity is None and acceleration is not None:
        return Accelerate(acceleration, flown_ned_mps, speeds.fastest_mps, speeds.climb_mps, speeds.descent_mps)
    return Velocity(velocity or STILL)


def _check_frame(message: Message, is_local: bool, *, px4: bool) -> None:
    known: tuple[int, ...]
    if is_local:
        known = PX4_LOCAL_FRAMES if px4 else tuple(LocalFrame)
    elif message.type_mask & TypeMask.POSITION:
        return
    else:
        known = PX4_GLOBAL_FRAMES if px4 else (*ALTITUDE_FRAMES, *HEIGHT_FRAMES)
    if message.coordinate_frame not in known:
        raise RefusedSetpoint(f"setpoint: unsupported frame {message.coordinate_frame}")


def _check_use(mask: int, turns: bool) -> None:
    """Refuse a setpoint with nothing to fly, which PX4 does not take. In a frame that turns with the vehicle, PX4
    ignores the position, and a velocity or an acceleration with an ignored axis."""
    moves = (TypeMask.VELOCITY, TypeMask.ACCELERATION)
    if turns:
        nothing = all(mask & group for group in moves)
    else:
        nothing = all(mask & group == group for group in (*moves, TypeMask.POSITION))
    if nothing:
        raise RefusedSetpoint("setpoint invalid: nothing in it to fly")


def _global_position(message: Message, here: Here) -> Vector:
    latitude_deg, longitude_deg = deg_from_dege7(message.lat_int), deg_from_dege7(message.lon_int)
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        raise RefusedSetpoint("setpoint ignored: no place on Earth")
    (altitude_m, _, _) = _finite(message.alt, 0.0, 0.0)
    above_m = here.origin.altitude_m if message.coordinate_frame in ALTITUDE_FRAMES else 0.0
    north, east, _ = ned_from_geodetic(latitude_deg, longitude_deg, here.origin.altitude_m, here.origin).tolist()
    return _finite(north, east, above_m - altitude_m)


def _finite(x: float, y: float, z: float) -> Vector:
    if not (abs(x) <= LARGEST and abs(y) <= LARGEST and abs(z) <= LARGEST):  # also catches NaN
        raise RefusedSetpoint("setpoint ignored: not finite")
    return x, y, z


def _used(ignored: int, x: float, y: float, z: float) -> Vector | None:
    """A vector with NaN in axes whose bits are set; None if all three are."""
    if ignored & 0b111 == 0b111:
        return None
    _finite(*(0.0 if ignored >> axis & 1 else each for axis, each in enumerate((x, y, z))))
    x, y, z = (math.nan if ignored >> axis & 1 else each for axis, each in enumerate((x, y, z)))
    return x, y, z


def _is_flyable(position: Vector | None, velocity: Vector | None) -> bool:
    """Whether PX4 flies it: north and east come together, and each axis has something, unless there is neither.

    Source: PositionControl::_inputValid.
    """
    given = [vector for vector in (position, velocity) if vector is not None]
    paired = all(math.isnan(north) == math.isnan(east) for north, east, _ in given)
    return paired and all(any(not math.isnan(each) for each in axis) for axis in zip(*given, strict=True))


def _turned(vector: Vector, yaw_rad: float) -> Vector:
    forward, right, down = vector
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * forward - sin * right, sin * forward + cos * right, down


def _sum(one: Vector, other: Vector) -> Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]
