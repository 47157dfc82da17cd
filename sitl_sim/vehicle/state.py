"""The state of a vehicle, and how fast it comes down by itself."""

from __future__ import annotations

from enum import IntEnum

DESCENT_MPS = 1.5
"""Descent of a landing, PX4's MPC_Z_VEL_MAX_DN and ArduPilot's WPNAV_SPEED_DN."""

TOUCHDOWN_MPS = 0.7
"""Descent below ``FLARE_HEIGHT_M``, PX4's MPC_LAND_SPEED."""

FLARE_HEIGHT_M = 10.0
"""Height at which a landing slows down, PX4's MPC_LAND_ALT1."""


class VehicleState(IntEnum):
    """State of a vehicle."""

    GROUNDED = 0
    """On the ground, before the flight or after a landing."""
    AIRBORNE = 1
    """Flies the commanded velocity."""
    LANDING = 2
    """Comes down by itself; commands are ignored."""
    GONE = 3
    """Removed: it collided, or it arrived and arrival is "leave"."""
