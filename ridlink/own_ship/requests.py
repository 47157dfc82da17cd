"""What an autopilot is asked to send, by MAV_CMD_SET_MESSAGE_INTERVAL: an ArduPilot says nothing of itself unasked."""

from __future__ import annotations

from ridlink.mavlink.codec import Encoder
from ridlink.own_ship.telemetry import AUTOPILOT_COMPONENT

SET_MESSAGE_INTERVAL = 511
"""MAV_CMD."""
SET_POSITION_TARGET_LOCAL_NED, COMMAND_LONG = 84, 76
"""Message ids."""

TARGET_US = {85: 70_000}
"""POSITION_TARGET_LOCAL_NED in a rhythm that is not that of setpoints, so that it shows whoever else sends some."""

WANTED_MESSAGES_US = {33: 50_000, 24: 200_000, **TARGET_US, 193: 500_000, 245: 500_000}
"""GLOBAL_POSITION_INT, GPS_RAW_INT, POSITION_TARGET_LOCAL_NED, EKF_STATUS_REPORT and EXTENDED_SYS_STATE, which an
ArduPilot sends only when asked; ESTIMATOR_STATUS it does not have, and says so each time."""

UNTOLD_US = {msgid: WANTED_MESSAGES_US[msgid] for msgid in (85, 193, 245)}
"""Of these what an ArduPilot does not tell, or not all of it, because others asked for its positions: where a ground
station on the same link has them sent, nothing says whether it is in a take-off, or what it flies after."""
UNTOLD_PERIOD_S = 5.0
"""Between two such requests while it does not tell."""

HOME_POSITION_US = {242: 2_000_000}
"""HOME_POSITION, which an ArduPilot sends once unasked."""
HOME_PERIOD_S = 5.0
"""Between two such requests while it is not known."""


def command(encoder: Encoder, number: int, parameters: tuple[float, ...], sysid: int) -> bytes:
    """COMMAND_LONG (76) for the autopilot."""
    fields = {f"param{at}": value for at, value in enumerate(parameters, start=1)}
    return encoder.encode(
        "COMMAND_LONG", command=number, target_system=sysid, target_component=AUTOPILOT_COMPONENT, **fields
    )


def steers(frame: bytes) -> bool:
    """Whether a frame of ours moves a vehicle or changes its mode: all but words and requests for messages."""
    msgid = int.from_bytes(frame[7:10], "little")
    if msgid == SET_POSITION_TARGET_LOCAL_NED:
        return True
    return msgid == COMMAND_LONG and int.from_bytes(frame[38:40], "little") != SET_MESSAGE_INTERVAL


def message_requests(encoder: Encoder, sysid: int, wanted: dict[int, int] | None = None) -> list[bytes]:
    """What to ask of an autopilot that does not say where it is.

    Args:
        encoder: Who asks.
        sysid: System id of the autopilot.
        wanted: Intervals [us] by message id; without them what an own state is made of.
    """
    intervals_us = WANTED_MESSAGES_US if wanted is None else wanted
    return [
        command(encoder, SET_MESSAGE_INTERVAL, (msgid, interval_us), sysid)
        for msgid, interval_us in intervals_us.items()
    ]
