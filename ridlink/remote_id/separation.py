"""RIDLINK_SEPARATION in both wire forms, to SI and back: a MAVLink message, and an Authentication message of 25 bytes.

The broadcasts of ASTM F3411 have no message type for it. There it is sent as an Authentication message of the private
type 0xA. A stock receiver relays this message unread, and a receiver that knows the layout decodes it.

Source: ``message_spec/README.md`` has the layouts.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from ridlink.remote_id.astm_fields import fitting_bits
from ridlink.remote_id.mavlink_fields import read_timestamp, write_timestamp
from ridlink.remote_id.messages import Authentication, Separation, SeparationFlags
from ridlink.remote_id.quantities import (
    MAX_UINT8,
    SECONDS_PER_HOUR,
    FieldRejects,
    read_id_or_mac,
    write_error,
    write_up,
)
from ridlink.units import m_from_cm, mps_from_cmps

MAX_INT8 = 127
MAX_INT16 = 32767

_SEPARATION = struct.Struct("<2sBHBBBBBhhbB")

SEPARATION_AUTHENTICATION_TYPE = 0xA
SEPARATION_LETTERS = b"RL"
SEPARATION_LAYOUT = 1
SEPARATION_LENGTH = _SEPARATION.size
VERTICAL_ERROR_STEP_M = 0.5
VELOCITY_ERROR_STEP_MPS = 0.1
AIRFRAME_STEP_M = 0.1
INTERVAL_STEP_S = 0.02

_GIVEN = int(SeparationFlags.COMMANDED_VELOCITY_GIVEN)  # an enumeration's own "&" takes a microsecond


def _component(value_mps: float, units_per_mps: int, limit: int) -> int:
    return round(min(max(value_mps * units_per_mps, -limit), limit))


def _commanded(message: Separation, down_units_per_mps: int, down_limit: int) -> tuple[int, int, int, int]:
    """The commanded velocity, north, east and down, and the flags that say whether it is given."""
    flags = int(message.flags) & ~_GIVEN
    if (commanded := message.commanded_ned_mps) is None:
        return 0, 0, 0, flags
    north, east, down = commanded
    return (
        _component(north, 100, MAX_INT16),
        _component(east, 100, MAX_INT16),
        _component(down, down_units_per_mps, down_limit),
        flags | _GIVEN,
    )


# --- MAVLink ---


def from_fields(fields: dict[str, Any], rejects: FieldRejects) -> Separation:
    """The message in the fields of its MAVLink form."""
    flags: int = fields["flags"]
    given = flags & _GIVEN
    return Separation(
        timestamp_s=read_timestamp(fields["timestamp"], "RIDLINK_SEPARATION.timestamp", rejects),
        horizontal_error_m=_read_length(fields["horizontal_error"]),
        vertical_error_m=_read_length(fields["vertical_error"]),
        velocity_error_mps=_read_length(fields["velocity_error"]),
        airframe_size_m=_read_length(fields["airframe_size"]),
        airframe_height_m=_read_length(fields["airframe_height"]),
        update_interval_s=fields["update_interval"] / 1e3 if fields["update_interval"] else None,
        commanded_vx_mps=mps_from_cmps(fields["commanded_vx"]) if given else None,
        commanded_vy_mps=mps_from_cmps(fields["commanded_vy"]) if given else None,
        commanded_vz_mps=mps_from_cmps(fields["commanded_vz"]) if given else None,
        flags=flags,
        id_or_mac=read_id_or_mac(fields["id_or_mac"]),
    )


def _read_length(value_cm: int) -> float | None:
    return m_from_cm(value_cm) if value_cm else None


def to_fields(message: Separation) -> dict[str, Any]:
    """The fields of its MAVLink form, without target ids and ``id_or_mac``."""
    vx, vy, vz, flags = _commanded(message, 100, MAX_INT16)
    return {
        "timestamp": write_timestamp(message.timestamp_s),
        "horizontal_error": write_error(message.horizontal_error_m),
        "vertical_error": write_error(message.vertical_error_m),
        "velocity_error": write_error(message.velocity_error_mps),
        "airframe_size": write_up(message.airframe_size_m, 0.01),
        "airframe_height": write_up(message.airframe_height_m, 0.01),
        "update_interval": write_up(message.update_interval_s, 0.001),
        "commanded_vx": vx,
        "commanded_vy": vy,
        "commanded_vz": vz,
        "flags": flags,
    }


# --- 25 bytes ---


def separation_of(message: Authentication) -> Separation | None:
    """The RIDLINK_SEPARATION in an Authentication message, ``None`` if the message contains something else.

    Its time is that of the Authentication message, in whole seconds after the full hour.
    """
    ours = (SEPARATION_AUTHENTICATION_TYPE, 0, 0, SEPARATION_LENGTH)
    if (message.authentication_type, message.data_page, message.last_page_index, message.length) != ours:
        return None
    (letters, layout, horizontal, vertical, velocity, size, height, interval, vx, vy, vz, flags) = _SEPARATION.unpack(
        message.authentication_data.ljust(SEPARATION_LENGTH, b"\x00")[:SEPARATION_LENGTH]
    )
    if letters != SEPARATION_LETTERS or layout != SEPARATION_LAYOUT:
        return None
    given = flags & _GIVEN
    return Separation(
        timestamp_s=None if message.timestamp_s is None else message.timestamp_s % SECONDS_PER_HOUR,
        horizontal_error_m=horizontal / 100.0 if horizontal else None,
        vertical_error_m=vertical * VERTICAL_ERROR_STEP_M if vertical else None,
        velocity_error_mps=velocity / 10.0 if velocity else None,
        airframe_size_m=size / 10.0 if size else None,
        airframe_height_m=height / 10.0 if height else None,
        update_interval_s=interval * 20 / 1000.0 if interval else None,
        commanded_vx_mps=vx / 100.0 if given else None,
        commanded_vy_mps=vy / 100.0 if given else None,
        commanded_vz_mps=vz / 10.0 if given else None,
        flags=flags,
        id_or_mac=message.id_or_mac,
    )


def authentication_of(message: Separation, hour_start_s: int | None) -> Authentication:
    """The Authentication message that carries a RIDLINK_SEPARATION in the 25-byte form.

    Args:
        message: The RIDLINK_SEPARATION.
        hour_start_s: As for `ridlink.remote_id.astm.encode_message`.

    Raises:
        PayloadError: If the flags do not fit.
    """
    fitting_bits(message, "flags", MAX_UINT8)
    vx, vy, vz, flags = _commanded(message, 10, MAX_INT8)
    timestamp_s: float | None = None
    if hour_start_s is not None and message.timestamp_s is not None and math.isfinite(message.timestamp_s):
        timestamp_s = hour_start_s + math.floor(message.timestamp_s)
    content = _SEPARATION.pack(
        SEPARATION_LETTERS,
        SEPARATION_LAYOUT,
        write_error(message.horizontal_error_m),
        write_error(message.vertical_error_m, VERTICAL_ERROR_STEP_M, MAX_UINT8),
        write_error(message.velocity_error_mps, VELOCITY_ERROR_STEP_MPS, MAX_UINT8),
        write_up(message.airframe_size_m, AIRFRAME_STEP_M, MAX_UINT8),
        write_up(message.airframe_height_m, AIRFRAME_STEP_M, MAX_UINT8),
        write_up(message.update_interval_s, INTERVAL_STEP_S, MAX_UINT8),
        vx,
        vy,
        vz,
        flags,
    )
    return Authentication(SEPARATION_AUTHENTICATION_TYPE, 0, 0, SEPARATION_LENGTH, timestamp_s, content)
