"""Fields that several of the 25-byte messages share: the first byte, bits and texts that must fit, and altitudes.

Source: ASTM F3411-22a.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum

from ridlink.errors import PayloadError
from ridlink.remote_id.messages import MAVLINK_NAMES, RemoteIdMessage
from ridlink.remote_id.quantities import MAX_UINT16

NEWEST_VERSION = 2
ALTITUDE_STEP_M = 0.5
LOWEST_ALTITUDE_M = -1000.0


class MessageType(IntEnum):
    """High half of the first byte."""

    BASIC_ID = 0x0
    LOCATION = 0x1
    AUTHENTICATION = 0x2
    SELF_ID = 0x3
    SYSTEM = 0x4
    OPERATOR_ID = 0x5
    PACK = 0xF


def header(kind: MessageType) -> int:
    """The first byte of what we send."""
    return kind << 4 | NEWEST_VERSION


def fitting_bits(message: RemoteIdMessage, field: str, limit: int) -> int:
    """An integer field that must fit its bits.

    Raises:
        PayloadError: If it is not 0 to ``limit``.
    """
    value: int = getattr(message, field)
    if not 0 <= value <= limit:
        name = MAVLINK_NAMES[type(message)]
        raise PayloadError(f"{name}.{field} is 0 to {limit}, not {value}", message=name, field=field)
    return value


def fitting_text(message: RemoteIdMessage, field: str, length: int) -> bytes:
    """A byte string that must fit its length, filled up with zeros.

    Raises:
        PayloadError: If it is longer, or text.
    """
    value = filled_up(message, field, length)
    if len(value) > length:
        name = MAVLINK_NAMES[type(message)]
        raise PayloadError(f"{name}.{field} takes {length} bytes, not {len(value)}", message=name, field=field)
    return value


def filled_up(message: RemoteIdMessage, field: str, length: int) -> bytes:
    """A byte string filled up with zeros; one that is too long is returned unchanged, and the frame encoder refuses it.

    Raises:
        PayloadError: If it is text.
    """
    value: bytes | str = getattr(message, field)
    if isinstance(value, str):
        name = MAVLINK_NAMES[type(message)]
        raise PayloadError(f"{name}.{field} takes bytes, not str", message=name, field=field)
    return value.ljust(length, b"\x00")


def nearest(value: float) -> int:
    """The nearest integer; a half goes up."""
    return math.floor(value + 0.5)


def read_altitude(units: int) -> float | None:
    """Altitude or height [m]; 0 is unknown."""
    return units * ALTITUDE_STEP_M + LOWEST_ALTITUDE_M if units else None


def write_altitude(value_m: float | None, whole: Callable[[float], int] = nearest) -> int:
    """Altitude in half metres above -1000 m, rounded by `whole`; 0 if it is unknown or out of range."""
    if value_m is None or not LOWEST_ALTITUDE_M < value_m <= LOWEST_ALTITUDE_M + MAX_UINT16 * ALTITUDE_STEP_M:
        return 0
    return max(1, whole((value_m - LOWEST_ALTITUDE_M) / ALTITUDE_STEP_M))
