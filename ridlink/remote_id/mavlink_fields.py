"""Fields that several of the MAVLink messages share: altitudes, and times after the full hour."""

from __future__ import annotations

import math

from ridlink.remote_id.quantities import SECONDS_PER_HOUR, FieldRejects

UNKNOWN_ALTITUDE_M = -1000.0
MAX_ALTITUDE_M = 31767.5
UNKNOWN_TIMESTAMP_S = 65535.0


def read_altitude(value: float, name: str, rejects: FieldRejects) -> float | None:
    """Altitude or height [m]; a value that is out of range or not finite is counted under its name."""
    if value == UNKNOWN_ALTITUDE_M:
        return None
    if not UNKNOWN_ALTITUDE_M < value <= MAX_ALTITUDE_M:  # also catches NaN
        rejects[name] += 1
        return None
    return value


def write_altitude(value_m: float | None) -> float:
    """An altitude or height on the wire; an impossible value is sent as unknown."""
    if value_m is None or not UNKNOWN_ALTITUDE_M < value_m <= MAX_ALTITUDE_M:
        return UNKNOWN_ALTITUDE_M
    return value_m


def read_timestamp(value: float, name: str, rejects: FieldRejects) -> float | None:
    """Seconds after the full hour; a value out of range is counted under its name."""
    if 0.0 <= value <= SECONDS_PER_HOUR:
        return value
    if value != UNKNOWN_TIMESTAMP_S and not math.isnan(value):
        rejects[name] += 1
    return None


def write_timestamp(value_s: float | None) -> float:
    """A time on the wire; an impossible value is sent as unknown."""
    if value_s is None or not 0.0 <= value_s <= SECONDS_PER_HOUR:
        return UNKNOWN_TIMESTAMP_S
    return value_s
