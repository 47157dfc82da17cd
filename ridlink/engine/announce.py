"""Messages of the daemon about itself: HEARTBEAT, RIDLINK_STATUS, COLLISION, STATUSTEXT. They steer nothing."""

from __future__ import annotations

import math
import zlib

from ridlink.avoidance.types import Status
from ridlink.engine.decision import Conflict, DecisionRecord
from ridlink.failsafe import State
from ridlink.mavlink.codec import Encoder
from ridlink.setpoint import STOP, Velocity
from ridlink.units import cmps_from_mps

AVOIDANCE_COMPONENT = 196
"""MAV_COMP_ID_OBSTACLE_AVOIDANCE."""

TYPE_ONBOARD_CONTROLLER = 18
AUTOPILOT_INVALID = 8
STATUS_STANDBY, STATUS_ACTIVE = 3, 4
"""MAV_STATE."""

UNKNOWN_MARGIN_CM = 0x7FFFFFFF
NO_VIOLATION_MS = 0xFFFFFFFF

COLLISION_BY_SYSTEM_ID = 1
COLLISION_REPORT, COLLISION_MOVE_HORIZONTALLY = 1, 3
COLLISION_LOW, COLLISION_HIGH = 1, 2
HIGH_THREAT_S = 3.0

SEVERITY_WARNING = 4
"""MAV_SEVERITY."""
LONGEST_TEXT = 50


def heartbeat(encoder: Encoder, engaged: bool, claim: int = 0) -> bytes:
    """HEARTBEAT (0) of an onboard controller that is no autopilot; the claim is for `own_ship.rival`."""
    return encoder.encode(
        "HEARTBEAT",
        type=TYPE_ONBOARD_CONTROLLER,
        autopilot=AUTOPILOT_INVALID,
        custom_mode=claim,
        system_status=STATUS_ACTIVE if engaged else STATUS_STANDBY,
        mavlink_version=3,
    )


def _within(value: float, most: int) -> int:
    return round(min(max(value, -most), most))


def _cmps(velocity: Velocity | None) -> tuple[int, int, int]:
    north, east, down = (_within(cmps_from_mps(value), 32767) for value in velocity or STOP)
    return north, east, down


def status(encoder: Encoder, record: DecisionRecord, time_boot_ms: int, decision_time_s: float) -> bytes:
    """RIDLINK_STATUS (61401)."""
    preferred, commanded = _cmps(record.preferred_ned_mps), _cmps(record.commanded_ned_mps)
    margin_cm, violation_ms = record.nearest_margin_m * 100.0, record.time_to_violation_s * 1e3
    return encoder.encode(
        "RIDLINK_STATUS",
        time_boot_ms=time_boot_ms & 0xFFFFFFFF,
        state=record.state,
        solver_status=Status.FREE if record.status is None else record.status,
        tracks=min(record.tracks, 65535),
        conflicts=min(len(record.conflicts), 65535),
        nearest_margin=UNKNOWN_MARGIN_CM if math.isinf(margin_cm) else _within(margin_cm, UNKNOWN_MARGIN_CM - 1),
        time_to_violation=NO_VIOLATION_MS if math.isinf(violation_ms) else _within(violation_ms, NO_VIOLATION_MS - 1),
        decision_time=_within(decision_time_s * 1e6, 0xFFFFFFFF),
        preferred_vx=preferred[0],
        preferred_vy=preferred[1],
        preferred_vz=preferred[2],
        commanded_vx=commanded[0],
        commanded_vy=commanded[1],
        commanded_vz=commanded[2],
        binding_systems=bytes(track.key[1] for track in record.binding[:4]),
    )


def collision(encoder: Encoder, conflict: Conflict, state: State) -> bytes:
    """COLLISION (247): the neighbour by its system id, or by the checksum of the id that a receiver relayed."""
    _, sysid, _, id_or_mac, _ = conflict.track.key
    return encoder.encode(
        "COLLISION",
        src=COLLISION_BY_SYSTEM_ID,
        id=sysid if id_or_mac is None else zlib.crc32(id_or_mac),
        action=COLLISION_MOVE_HORIZONTALLY if state is State.ENGAGED else COLLISION_REPORT,
        threat_level=COLLISION_HIGH if conflict.entry_s < HIGH_THREAT_S else COLLISION_LOW,
        time_to_minimum_delta=conflict.closest_s,
        altitude_minimum_delta=conflict.height_m,
        horizontal_minimum_delta=conflict.miss_m,
    )


def warning(encoder: Encoder, text: str) -> bytes:
    """STATUSTEXT (253) of a warning, cut to the length of one message."""
    return encoder.encode("STATUSTEXT", severity=SEVERITY_WARNING, text=text[:LONGEST_TEXT])
