"""RIDLINK_SEPARATION where messages have 25 bytes: an Authentication message of the private type 0xA.

The broadcasts of ASTM F3411 have no message type for it. A stock receiver relays it unread, and whoever knows the
layout takes it out again.

Source: ``message_spec/README.md`` has the layout.
"""

from __future__ import annotations

import math
import struct

from ridlink.remote_id.astm_fields import fitting_bits
from ridlink.remote_id.messages import Authentication, Separation, SeparationFlags
from ridlink.remote_id.quantities import MAX_UINT8, SECONDS_PER_HOUR, write_error, write_up

_SEPARATION = struct.Struct("<2sBHBBBBBhhbB")

SEPARATION_AUTHENTICATION_TYPE = 0xA
SEPARATION_LETTERS = b"RL"
SEPARATION_LAYOUT = 1
SEPARATION_LENGTH = _SEPARATION.size
VERTICAL_ERROR_STEP_M = 0.5
VELOCITY_ERROR_STEP_MPS = 0.1
AIRFRAME_STEP_M = 0.1
INTERVAL_STEP_S = 0.02


def separation_of(message: Authentication) -> Separation | None:
    """The RIDLINK_SEPARATION that an Authentication message carries, ``None`` where it carries something else.

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
    given = bool(flags & SeparationFlags.COMMANDED_VELOCITY_GIVEN)
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


def _component(value_mps: float, units_per_mps: int, limit: int) -> int:
    return min(max(round(value_mps * units_per_mps), -limit), limit)


def authentication_of(message: Separation, hour_start_s: int | None) -> Authentication:
    """The Authentication message that a RIDLINK_SEPARATION is where messages have 25 bytes.

    Args:
        message: The RIDLINK_SEPARATION.
        hour_start_s: As for `ridlink.remote_id.astm.encode_message`.

    Raises:
        PayloadError: If the flags do not fit.
    """
    flags = fitting_bits(message, "flags", MAX_UINT8) & ~int(SeparationFlags.COMMANDED_VELOCITY_GIVEN)
    vx = vy = vz = 0
    if (commanded := message.commanded_ned_mps) is not None:
        north, east, down = commanded
        vx, vy, vz = _component(north, 100, 0x7FFF), _component(east, 100, 0x7FFF), _component(down, 10, 0x7F)
        flags |= int(SeparationFlags.COMMANDED_VELOCITY_GIVEN)
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
