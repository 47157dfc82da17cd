"""Commands that the daemon takes, MAV_CMD_DO_REPOSITION, and gives, MAV_CMD_SET_MESSAGE_INTERVAL."""

from __future__ import annotations

import math

from ridlink.engine.config import Goal, goal_problem
from ridlink.failsafe import FailsafeSettings
from ridlink.mavlink.codec import Encoder, Message
from ridlink.own_ship import AUTOPILOT_COMPONENT

DO_REPOSITION = 192
DO_PAUSE_CONTINUE = 193
CONTINUE = 1.0
SET_MESSAGE_INTERVAL = 511
"""MAV_CMD."""
ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
"""MAV_RESULT."""
RELATIVE_ALTITUDE_FRAMES = (3, 6)
ABSOLUTE_ALTITUDE_FRAMES = (0, 5)
"""MAV_FRAME_GLOBAL_RELATIVE_ALT(_INT) and MAV_FRAME_GLOBAL(_INT)."""
UNKNOWN_INT32 = 0x7FFFFFFF

MOST_REPLIES = 16
"""Commands answered in one step; an operator sends one."""

WANTED_MESSAGES_US = {33: 50_000, 24: 200_000, 85: 100_000, 193: 500_000, 245: 500_000}
"""GLOBAL_POSITION_INT, GPS_RAW_INT, POSITION_TARGET_LOCAL_NED, EKF_STATUS_REPORT and EXTENDED_SYS_STATE, which an
ArduPilot sends only when asked; ESTIMATOR_STATUS it does not have, and says so each time."""


def repositioned(message: Message, home_altitude_m: float | None, settings: FailsafeSettings) -> Goal | None:
    """The goal that a DO_REPOSITION names; None where it is none, or none that may be flown to.

    Args:
        message: COMMAND_INT, or COMMAND_LONG with its altitude above mean sea level.
        home_altitude_m: Where relative altitudes begin, above mean sea level; None while that is not known.
        settings: Limits of goals.
    """
    frame = ABSOLUTE_ALTITUDE_FRAMES[0]
    if message.name == "COMMAND_INT":
        frame = message.frame
        if UNKNOWN_INT32 in (message.x, message.y):
            return None
        latitude, longitude, altitude = message.x / 1e7, message.y / 1e7, message.z
    else:
        latitude, longitude, altitude = message.param5, message.param6, message.param7
    height: float | None = None if math.isnan(altitude) else altitude
    if frame in RELATIVE_ALTITUDE_FRAMES:
        if height is not None:
            if home_altitude_m is None:
                return None
            height += home_altitude_m
    elif frame not in ABSOLUTE_ALTITUDE_FRAMES:
        return None
    goal = Goal(latitude, longitude, height)
    return None if goal_problem(goal, settings) else goal


def acknowledged(encoder: Encoder, message: Message, result: int, target_system: int, target_component: int) -> bytes:
    """COMMAND_ACK (77) for whoever sent a command."""
    return encoder.encode(
        "COMMAND_ACK",
        command=message.command,
        result=result,
        target_system=target_system,
        target_component=target_component,
    )


def command(encoder: Encoder, number: int, parameters: tuple[float, ...], sysid: int) -> bytes:
    """COMMAND_LONG (76) for the autopilot."""
    fields = {f"param{at}": value for at, value in enumerate(parameters, start=1)}
    return encoder.encode(
        "COMMAND_LONG", command=number, target_system=sysid, target_component=AUTOPILOT_COMPONENT, **fields
    )


def message_requests(encoder: Encoder, sysid: int) -> list[bytes]:
    """What to ask of an autopilot that does not say where it is."""
    return [
        command(encoder, SET_MESSAGE_INTERVAL, (msgid, interval_us), sysid)
        for msgid, interval_us in WANTED_MESSAGES_US.items()
    ]
