"""Requests for messages by MAV_CMD_SET_MESSAGE_INTERVAL: unasked, an ArduPilot says nothing of itself."""

from __future__ import annotations

from ridlink.failsafe import HEARTBEAT_LOST_S
from ridlink.mavlink.codec import Encoder
from ridlink.own_ship.telemetry import AUTOPILOT_COMPONENT, OwnShipTelemetry
from ridlink.periodic import Periodic

SET_MESSAGE_INTERVAL = 511
"""MAV_CMD."""
SET_POSITION_TARGET_LOCAL_NED, COMMAND_LONG = 84, 76
"""Message ids."""

POSITION_US = {33: 50_000}
"""Interval of GLOBAL_POSITION_INT."""

TARGET_US = {85: 70_000}
"""Interval of POSITION_TARGET_LOCAL_NED: not the rhythm of setpoints, so that it shows any other writer, too."""

WANTED_MESSAGES_US = {**POSITION_US, 24: 200_000, **TARGET_US, 193: 500_000, 245: 500_000}
"""GLOBAL_POSITION_INT, GPS_RAW_INT, POSITION_TARGET_LOCAL_NED, EKF_STATUS_REPORT and EXTENDED_SYS_STATE, which an
ArduPilot sends only when asked. ESTIMATOR_STATUS is left out: ArduPilot does not have it, and says so each time."""

UNTOLD_US = {msgid: WANTED_MESSAGES_US[msgid] for msgid in (85, 193, 245)}
"""Those of them that an ArduPilot does not send, or not all of them, if others asked for its positions: where a ground
station on the same link has them sent, nothing says whether it is in a take-off, or what it flies after."""

HOME_POSITION_US = {242: 2_000_000}
"""HOME_POSITION, which an ArduPilot sends once unasked."""

SILENT_S, RECEIVER_SILENT_S = 1.0, 5.0
"""Without a position, or word of the receiver, for so long an autopilot is asked for all, once a second."""

AGAIN_S = 5.0
"""Time between two requests for what is told too seldom, or not at all, while that is so."""


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


def message_requests(encoder: Encoder, sysid: int, intervals_us: dict[int, int]) -> list[bytes]:
    """Requests to an autopilot.

    Args:
        encoder: Encoder of our messages.
        sysid: System id of the autopilot.
        intervals_us: Wanted intervals [us] by message id.
    """
    return [
        command(encoder, SET_MESSAGE_INTERVAL, (msgid, interval_us), sysid)
        for msgid, interval_us in intervals_us.items()
    ]


class Requests:
    """Says what to request, and when, of an autopilot that does not tell all that is needed, or too seldom.

    A ground station on the same link may have asked for less than an own state needs: two positions a second are usual,
    and an autopilot obeys the last who asked.

    Args:
        steers: Whether we steer: only then does it matter whether the vehicle stands, and what it flies after.
        broadcasts: Whether we tell others of the vehicle: only then does it matter where home is.
    """

    def __init__(self, *, steers: bool, broadcasts: bool) -> None:
        self._steers, self._broadcasts = steers, broadcasts
        self._all_due = Periodic(SILENT_S)
        self._position_due, self._untold_due, self._target_due, self._home_due = (Periodic(AGAIN_S) for _ in range(4))

    def due(self, encoder: Encoder, telemetry: OwnShipTelemetry, now_s: float) -> list[bytes]:
        """Requests that are due now; none while no autopilot is heard.

        Args:
            encoder: Encoder of our messages.
            telemetry: What the autopilot tells.
            now_s: Monotonic time.
        """
        lock = telemetry.lock
        if lock is None or telemetry.heard_s(now_s) > HEARTBEAT_LOST_S:
            return []
        wanted = self._wanted(telemetry, now_s)
        if self._broadcasts and telemetry.home is None and self._home_due.due(now_s):
            wanted = wanted | HOME_POSITION_US
        return message_requests(encoder, lock.sysid, wanted)

    def _wanted(self, telemetry: OwnShipTelemetry, now_s: float) -> dict[int, int]:
        trust = telemetry.trust
        silent = telemetry.position_silent_s(now_s) > SILENT_S or trust.receiver_silent_s(now_s) > RECEIVER_SILENT_S
        if silent or trust.estimator_silent(now_s):
            return WANTED_MESSAGES_US if self._all_due.due(now_s) else {}
        if telemetry.position_seldom_told and self._position_due.due(now_s):
            return POSITION_US
        if self._steers and not telemetry.landed_state_known(now_s) and self._untold_due.due(now_s):
            return UNTOLD_US
        if self._steers and telemetry.other_writer.seldom_told and self._target_due.due(now_s):
            return TARGET_US
        return {}
