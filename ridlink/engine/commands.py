"""Commands that the daemon accepts: MAV_CMD_DO_REPOSITION, and MAV_CMD_DO_PAUSE_CONTINUE with `--guard`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ridlink.engine.config import Goal, goal_problem
from ridlink.failsafe import FailsafeSettings
from ridlink.mavlink.codec import Encoder, Message
from ridlink.traffic.own_state import OwnState

DO_REPOSITION = 192
DO_PAUSE_CONTINUE = 193
CONTINUE = 1.0
"""MAV_CMD."""
ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
"""MAV_RESULT."""
RELATIVE_ALTITUDE_FRAMES = (3, 6)
ABSOLUTE_ALTITUDE_FRAMES = (0, 5)
"""MAV_FRAME_GLOBAL_RELATIVE_ALT(_INT) and MAV_FRAME_GLOBAL(_INT)."""
UNKNOWN_INT32 = 0x7FFFFFFF

MOST_REPLIES = 16
"""Commands answered in one step; an operator sends one."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to a command.

    Attributes:
        result: MAV_RESULT.
        goal: New goal, an operator's request; None if there is none.
        engages_guard: True if the guard is engaged again.
    """

    result: int = UNSUPPORTED
    goal: Goal | None = None
    engages_guard: bool = False


def answered(message: Message, own: OwnState | None, settings: FailsafeSettings, *, guarding: bool) -> Answer:
    """Answer to a COMMAND_INT or COMMAND_LONG to this component.

    Args:
        message: The command.
        own: Own state; None while it is not known.
        settings: Limits of goals.
        guarding: True for a guard, which flies the autopilot's own plan and takes no goals.
    """
    if message.command == DO_PAUSE_CONTINUE and guarding:
        continues = message.param1 == CONTINUE
        return Answer(ACCEPTED if continues else DENIED, engages_guard=continues)
    if message.command == DO_REPOSITION and not guarding:
        goal = repositioned(message, own, settings)
        return Answer(DENIED if goal is None else ACCEPTED, goal)
    return Answer()


def repositioned(message: Message, own: OwnState | None, settings: FailsafeSettings) -> Goal | None:
    """Goal of a DO_REPOSITION; None if it names none, or one that may not be flown to.

    Args:
        message: COMMAND_INT, or COMMAND_LONG with its altitude above mean sea level.
        own: Own state, for the distance and for relative altitudes; None while it is not known.
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
    if latitude == 0.0 and longitude == 0.0:  # not filled in, as everywhere else on the wire
        return None
    height: float | None = None if math.isnan(altitude) else altitude
    if frame in RELATIVE_ALTITUDE_FRAMES:
        if height is not None:
            if own is None:
                return None
            height += own.home_altitude_m
    elif frame not in ABSOLUTE_ALTITUDE_FRAMES:
        return None
    goal = Goal(latitude, longitude, height)
    if goal_problem(goal, settings) or (own is not None and goal.away_m(own.position) > settings.farthest_goal_m):
        return None
    return goal


def acknowledged(encoder: Encoder, message: Message, result: int, target_system: int, target_component: int) -> bytes:
    """COMMAND_ACK (77) for the sender of a command."""
    return encoder.encode(
        "COMMAND_ACK",
        command=message.command,
        result=result,
        target_system=target_system,
        target_component=target_component,
    )
