"""Quantities that have the same encoding in both wire forms of Remote ID, MAVLink and the 25-byte broadcasts.

Positions are in 1e-7 degrees with 0/0 for unknown, absolute times in whole seconds since 2019. Errors and extents are
rounded up, so that they are never understated. Fields that several messages share in one wire form only are in
``mavlink_fields`` and ``astm_fields``.
"""

from __future__ import annotations

import math
from collections import Counter

from ridlink.units import ceil_units, deg_from_dege7, dege7_from_deg

FieldRejects = Counter[str]
"""Fields that were not taken, by ``MESSAGE.field``."""

SECONDS_PER_HOUR = 3600.0
EPOCH_2019_S = 1546300800.0
"""2019-01-01 00:00 UTC, the zero of absolute times, in seconds since 1970."""

ID_LENGTH = 20
"""Bytes of an identity, and of ``id_or_mac``."""

TEXT_LENGTH = 23
AUTHENTICATION_PAGE_LENGTH = 23
AUTHENTICATION_FIRST_PAGE_LENGTH = 17
MAX_UINT8 = 255
MAX_UINT16 = 65535


_NO_ID = bytes(ID_LENGTH)


def read_id_or_mac(raw: bytes) -> bytes | None:
    """The transmitter whose data it is, None for the sender's own data."""
    return None if raw == _NO_ID else raw


def write_id_or_mac(id_or_mac: bytes | None) -> bytes:
    """``id_or_mac`` in its full length."""
    return _NO_ID if id_or_mac is None else id_or_mac.ljust(ID_LENGTH, b"\x00")


def read_position(
    latitude_dege7: int, longitude_dege7: int, names: tuple[str, str], rejects: FieldRejects
) -> tuple[float | None, float | None]:
    """Latitude and longitude [deg]; 0/0 is unknown, a value out of range is counted under its name."""
    if latitude_dege7 == 0 and longitude_dege7 == 0:
        return None, None
    latitude: float | None = deg_from_dege7(latitude_dege7)
    longitude: float | None = deg_from_dege7(longitude_dege7)
    if not -900000000 <= latitude_dege7 <= 900000000:
        rejects[names[0]] += 1
        latitude = None
    if not -1800000000 <= longitude_dege7 <= 1800000000:
        rejects[names[1]] += 1
        longitude = None
    return latitude, longitude


def write_position(latitude_deg: float | None, longitude_deg: float | None) -> tuple[int, int]:
    """Latitude and longitude [1e-7 deg]; 0/0 where one of them is unknown or out of range."""
    if latitude_deg is None or longitude_deg is None:
        return 0, 0
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        return 0, 0
    latitude, longitude = dege7_from_deg(latitude_deg), dege7_from_deg(longitude_deg)
    if latitude == 0 and longitude == 0:
        longitude = 1  # 0/0 would read as unknown; one unit is 11 mm
    return latitude, longitude


def read_seconds_since_2019(value: int) -> float | None:
    """Seconds since 2019-01-01 UTC; 0 is unknown."""
    return float(value) if value else None


def write_seconds_since_2019(value_s: float | None) -> int:
    """Whole seconds since 2019-01-01 UTC, saturated; 0 for unknown."""
    return min(max(round(value_s), 0), 0xFFFFFFFF) if value_s is not None and math.isfinite(value_s) else 0


def write_up(value: float | None, unit: float, limit: int = MAX_UINT16) -> int:
    """Whole units, rounded up and saturated; 0 for an unknown, negative or NaN value."""
    if value is None or not value > 0.0:
        return 0
    return limit if value >= limit * unit else max(1, ceil_units(value, unit))


def write_error(value: float | None, unit: float = 0.01, limit: int = MAX_UINT16) -> int:
    """An uncertainty, encoded by `write_up`, but an error of zero becomes one unit, since 0 means unknown."""
    return 1 if value == 0.0 else write_up(value, unit, limit)
