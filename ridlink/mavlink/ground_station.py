"""The HEARTBEAT of a ground station. A program that only listens sends it once a second, so that others send to it.

Source: https://mavlink.io/en/services/heartbeat.html
"""

from __future__ import annotations

from ridlink.mavlink.codec import Encoder

SYSTEM_ID, COMPONENT_ID = 255, 190
"""Customary ids of ground stations (MAV_COMP_ID_MISSIONPLANNER); on the emulated air they hear everything."""

HEARTBEAT_EVERY_S = 1.0
MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID, MAV_STATE_ACTIVE, MAVLINK_VERSION = 6, 8, 4, 3


def ground_station() -> Encoder:
    """An encoder with the identity of a ground station."""
    return Encoder(SYSTEM_ID, COMPONENT_ID)


def heartbeat(encoder: Encoder) -> bytes:
    """The HEARTBEAT of a ground station, one frame.

    Args:
        encoder: As from `ground_station`.
    """
    return encoder.encode(
        "HEARTBEAT",
        type=MAV_TYPE_GCS,
        autopilot=MAV_AUTOPILOT_INVALID,
        system_status=MAV_STATE_ACTIVE,
        mavlink_version=MAVLINK_VERSION,
    )
