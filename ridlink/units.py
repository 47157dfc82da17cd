"""Wire integers to SI units and back: one function each way, both units in each name.

Only ``ridlink.remote_id``, ``ridlink.setpoint`` and the readers of telemetry call these: everything else is SI.
"""

from __future__ import annotations

import math


def deg_from_dege7(value: int) -> float:
    """Degrees from 1e-7 degrees."""
    return value / 1e7


def dege7_from_deg(value: float) -> int:
    """1e-7 degrees, nearest, from degrees."""
    return round(value * 1e7)


def m_from_mm(value: int) -> float:
    """Metres from millimetres."""
    return value / 1e3


def mm_from_m(value: float) -> int:
    """Millimetres, nearest, from metres."""
    return round(value * 1e3)


def mps_from_cmps(value: int) -> float:
    """Metres a second from centimetres a second."""
    return value / 1e2


def cmps_from_mps(value: float) -> int:
    """Centimetres a second, nearest, from metres a second."""
    return round(value * 1e2)


def m_from_cm(value: int) -> float:
    """Metres from centimetres."""
    return value / 1e2


def ceil_units(value: float, unit: float) -> int:
    """Whole units, rounded up, so that an uncertainty is never understated.

    A value that is a whole number of units up to float noise (1e-6 units) is taken as that number: 3 x 0.1 m is 30 cm.
    """
    return math.ceil(value / unit - 1e-6)


def wrap_deg(value: float) -> float:
    """The same angle in [-180, 180) degrees."""
    return (value + 180.0) % 360.0 - 180.0
