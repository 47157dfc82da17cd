"""Requests for messages by MAV_CMD_SET_MESSAGE_INTERVAL: unasked, an ArduPilot says nothing of itself."""

from __future__ import annotations

from ridlink.mavlink.codec import Encoder
from ridlink.own_ship.telemetry import AUTOPILOT_COMPONENT

SET_MESSAGE_INTERVAL = 511
"""MAV_CMD."""
SET_POSITION_TARGET_LOCAL_NED, COMMAND_LONG = 84, 76
"""Message ids."""

TARGET_US = {85: 70_000}
"""Interval of POSITION_TARGET_LOCAL_NED: not the rhythm of setpoints, so that it shows any other writer, too."""

WANTED_MESSAGES_US = {33: 50_000, 24: 200_000, **TARGET_US, 193: 500_000, 245: 500_000}
"""GLOBAL_POSITION_INT, GPS_RAW_INT, POSITION_TARGET_LOCAL_NED, EKF_STATUS_REPORT and EXTENDED_SYS_STATE, which an
ArduPilot sends only when asked. ESTIMATOR_STATUS is left out: ArduPilot does not have it, and says so each time."""

UNTOLD_US = {msgid: WANTED_MESSAGES_US[msgid] for msgid in (85, 193, 245)}
"""Those of them that an ArduPilot does not send, or not all of them, if others asked for its positions: where a ground
station on the same link has them sent, nothing says whether it is in a take-off, or what it flies after."""
UNTOLD_PERIOD_S = 5.0
"""Time between two such requests while they are not sent."""

HOME_POSITION_US = {242: 2_000_000}
"""HOME_POSITION, which an ArduPilot sends once unasked."""
HOME_PERIOD_S = 5.0
"""Time between two such requests while home is not known."""


def command(encoder: Encoder, number: int, parameters: tuple[float, ...], sysid: int) -> bytes:
    """COMMAND_LONG (76) for the autopilot."""
    fields = {f"param{at}": value for at, value in enumerate(parameters, start=1)}
    return encoder.encode(
        "COMMAND_LONG", command=number, target_system=sysid, target_component=AUTOPILOT_COMPONENT, **fields
    )


def steers(frame: bytes) -> bool:
    """Whether a frame of ours moves a vehicle or changes its mode: all but status messages and requests for
    messages."""
    msgid = int.from_bytes(frame[7:10], "little")
    if msgid == SET_POSITION_TARGET_LOCAL_NED:
        return True
    return msgid == COMMAND_LONG and int.from_bytes(frame[38:40], "little") != SET_MESSAGE_INTERVAL


def message_requests(encoder: Encoder, sysid: int, wanted: dict[int, int] | None = None) -> list[bytes]:
    """Requests to an autopilot that does not say where it is.

    Args:
        encoder: Encoder of our messages.
        sysid: System id of the autopilot.
        wanted: Intervals [us] by message id; without them, those of the messages that an own state is made of.
    """
    intervals_us = WANTED_MESSAGES_US if wanted is None else wanted
    return [
        command(encoder, SET_MESSAGE_INTERVAL, (msgid, interval_us), sysid)
        for msgid, interval_us in intervals_us.items()
    ]
