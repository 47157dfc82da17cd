"""Items of a mission: which are accepted, which are refused, and why.

They are stored unchanged, in the integers of MISSION_ITEM_INT, so that a client reads back exactly what it wrote.

Source: https://mavlink.io/en/services/mission.html
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.results import MissionResult
from sitl_sim.autopilot.setpoints import ALTITUDE_FRAMES, HEIGHT_FRAMES, LARGEST

MAX_ITEMS = 500
FRAME_MISSION = 2
UNUSED_INT = 0x7FFFFFFF


class Item(IntEnum):
    """MAV_CMD of items that are flown."""

    WAYPOINT = 16
    LOITER_UNLIMITED = 17
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    LAND = 21
    TAKEOFF = 22
    SPLINE_WAYPOINT = 82
    DELAY = 93
    CONDITION_YAW = 115
    JUMP = 177
    CHANGE_SPEED = 178


PLACES = (
    Item.WAYPOINT, Item.LOITER_UNLIMITED, Item.LOITER_TIME, Item.LAND, Item.TAKEOFF, Item.SPLINE_WAYPOINT,
)  # fmt: skip
"""Items with a position."""

NAVIGATION = (*PLACES, Item.RETURN_TO_LAUNCH, Item.DELAY)
"""Items that take time; all others are done at once."""

PAYLOAD = (195, 196, 197, 201, 203, 205, 206, 530, 1000, 1001, 2000, 2001, 2500, 2501)
"""Regions of interest, gimbals and cameras: accepted and skipped, as by an autopilot without these devices."""


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item as on the wire; `x` and `y` are degE7 in items with a position."""

    command: int
    frame: int
    parameters: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1

    @property
    def latitude_longitude_deg(self) -> tuple[float, float] | None:
        """Position; None: the present position of the vehicle."""
        if (self.x, self.y) == (0, 0) or UNUSED_INT in (self.x, self.y):
            return None
        return self.x / 1e7, self.y / 1e7

    @property
    def is_above_sea(self) -> bool:
        """Whether `z` counts from mean sea level, not from home."""
        return self.frame in ALTITUDE_FRAMES

    def parameter(self, number: int) -> float | None:
        """Parameter 1 to 4; None if it means "default"."""
        value = self.parameters[number - 1]
        return value if math.isfinite(value) and value != 0.0 else None

    def fields(self) -> dict[str, Any]:
        """Fields of MISSION_ITEM_INT without sequence number and addresses."""
        named = {f"param{number}": value for number, value in enumerate(self.parameters, start=1)}
        return {
            **named,
            "command": self.command,
            "frame": self.frame,
            "x": self.x,
            "y": self.y,
            "z": self.z,
            "autocontinue": self.autocontinue,
        }


def read_item(message: Message, count: int) -> MissionItem | MissionResult:
    """The item in a MISSION_ITEM_INT or MISSION_ITEM, or why it is refused.

    Args:
        message: The item.
        count: Items of the whole mission, for jumps.
    """
    command, frame = message.command, message.frame
    if command not in (*Item, *PAYLOAD):
        return MissionResult.UNSUPPORTED
    known = (*ALTITUDE_FRAMES, *HEIGHT_FRAMES)
    if frame not in known and (command in PLACES or frame != FRAME_MISSION):
        return MissionResult.UNSUPPORTED_FRAME
    parameters = (message.param1, message.param2, message.param3, message.param4)
    for number, value in enumerate(parameters):
        if math.isinf(value) or abs(value) > LARGEST:
            return MissionResult(MissionResult.INVALID_PARAM1 + number)
    if command == Item.JUMP and not 0 <= message.param1 < count:
        return MissionResult.INVALID_PARAM1
    x, y = message.x, message.y
    if message.name == "MISSION_ITEM":
        if not (math.isfinite(x) and abs(x) <= 180.0):
            return MissionResult.INVALID_PARAM5_X
        if not (math.isfinite(y) and abs(y) <= 180.0):
            return MissionResult.INVALID_PARAM6_Y
        x, y = round(x * 1e7), round(y * 1e7)
    if command in PLACES:
        if abs(x) > 900_000_000 and x != UNUSED_INT:
            return MissionResult.INVALID_PARAM5_X
        if abs(y) > 1_800_000_000 and y != UNUSED_INT:
            return MissionResult.INVALID_PARAM6_Y
        if not abs(message.z) <= LARGEST:  # also catches NaN
            return MissionResult.INVALID_PARAM7
    z = message.z if math.isfinite(message.z) else 0.0
    return MissionItem(command, frame, parameters, x, y, z, message.autocontinue)
