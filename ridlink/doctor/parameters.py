"""Parameters of both autopilots that decide how they treat a stream of velocity setpoints.

Source: the behaviour of ArduPilot Copter 4.6 and PX4 1.17 in their own simulators; names and defaults are theirs.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from ridlink.own_ship import ARDUPILOT, PX4

_INTEGER_CODES = {1: "<B3x", 2: "<b3x", 3: "<H2x", 4: "<h2x", 5: "<I", 6: "<i"}
"""MAV_PARAM_TYPE to the layout of an integer's bytes in the float field, as PX4 sends them."""


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected value of a parameter.

    Args:
        name: Name of the parameter.
        is_right: Whether a value, which is finite, is right.
        meaning: Unit of the value and what it does, or what it does in brackets; shown behind it, right or wrong.
        remedy: What to set if it is not right.
    """

    name: str
    is_right: Callable[[float], bool]
    meaning: str
    remedy: str


EXPECTED: dict[int, tuple[Expected, ...]] = {
    PX4: (
        Expected(
            "COM_OF_LOSS_T",
            lambda value: value >= 0.5,
            "s without a setpoint until OFFBOARD fails over",
            "0.5 or more: a setpoint that comes late must not end the flight",
        ),
        Expected(
            "COM_OBL_RC_ACT",
            lambda value: value not in (0.0, 4.0),
            "(what OFFBOARD fails over to: 0 position, 3 return, 4 land, 5 hold)",
            "5 (hold): with 0 and no RC the vehicle returns home through the traffic",
        ),
        Expected(
            "MPC_XY_VEL_MAX", lambda value: value >= 10.0, "m/s at most in level flight", "at least what --cruise asks"
        ),
        Expected("MPC_Z_VEL_MAX_DN", lambda value: value >= 1.0, "m/s of descent at most", "at least 1 for --vertical"),
    ),
    ARDUPILOT: (
        Expected(
            "GUID_TIMEOUT",
            lambda value: 0.5 <= value <= 5.0,
            "s without a setpoint until the vehicle brakes; it keeps its last velocity until then",
            "between 0.5 and 5",
        ),
        Expected("GUID_OPTIONS", lambda value: value == 0.0, "(options of GUIDED)", "0, the default"),
        Expected(
            "WPNAV_SPEED", lambda value: value >= 1000.0, "cm/s at most in level flight", "at least 100 times --cruise"
        ),
        Expected(
            "AVOID_ENABLE",
            lambda value: int(value) in (0, 1, 3),
            "(own avoidance, which bends setpoints near a fence)",
            "0 while ridlink avoids, or expect bent setpoints near fences",
        ),
    ),
}


def parameter_value(raw: float, param_type: int, autopilot: int) -> float:
    """The parameter value in a PARAM_VALUE message.

    Args:
        raw: ``param_value`` of the message.
        param_type: MAV_PARAM_TYPE of the message.
        autopilot: MAV_AUTOPILOT: PX4 puts the bytes of an integer into the float, ArduPilot converts it.
    """
    layout = _INTEGER_CODES.get(param_type)
    if autopilot != PX4 or layout is None:
        return raw
    return float(struct.unpack(layout, struct.pack("<f", raw))[0])
