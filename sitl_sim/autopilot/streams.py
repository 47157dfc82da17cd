"""Message rates of each link: SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, REQUEST_DATA_STREAM and similar ones."""

from __future__ import annotations

import math

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.commands import Command, MavCommand
from sitl_sim.autopilot.ekf_status import name_of
from sitl_sim.autopilot.link import Link
from sitl_sim.autopilot.rates import LEGACY_STREAMS, default_intervals
from sitl_sim.autopilot.results import Reply, Result, Severity
from sitl_sim.autopilot.telemetry import Telemetry

LONGEST_TOLD_US = 2**31 - 1
"""MESSAGE_INTERVAL has 32 bits with a sign for an interval."""

_PHASE_STEP = 0.6180339887
"""Golden ratio: spreads the streams of any number of vehicles evenly over a period."""

_MESSAGES_OF_COMMANDS: dict[int, str] = {
    MavCommand.GET_HOME_POSITION: "HOME_POSITION",
    MavCommand.REQUEST_AUTOPILOT_CAPABILITIES: "AUTOPILOT_VERSION",
    MavCommand.REQUEST_PROTOCOL_VERSION: "AUTOPILOT_VERSION",
}
"""Older commands that request one message. PROTOCOL_VERSION is not in the dialect: AUTOPILOT_VERSION says MAVLink 2."""

Answer = tuple[Result, list[Reply]]


class Streams:
    """The rates of one vehicle's links.

    Args:
        board: The flight controller. Streams of different vehicles have different phases. PX4 accepts a stream of any
            message and sends nothing if it does not have it; ArduPilot refuses it.
        telemetry: Messages that can be sent.
    """

    def __init__(self, board: Board, telemetry: Telemetry) -> None:
        self._board, self._telemetry = board, telemetry
        self._default_interval_s = default_intervals(board.flavour)

    def begin(self, link: Link, now_s: float) -> None:
        """Set the default rates of a new link."""
        for name, interval_s in self._default_interval_s.items():
            self._stream(link, name, interval_s, now_s)

    def command(self, command: Command, link: Link, now_s: float) -> Answer | None:
        """The answer to a command about messages; None for other commands."""
        if command.number == MavCommand.SET_MESSAGE_INTERVAL:
            return self._set_interval(command, link, now_s), []
        if command.number == MavCommand.GET_MESSAGE_INTERVAL:
            return self._tell_interval(int(command[1] or 0), link)
        if command.number == MavCommand.REQUEST_MESSAGE:
            return self._once(self._name(command[1]))
        if (name := _MESSAGES_OF_COMMANDS.get(command.number)) is not None:
            return self._once(name)
        return None

    def legacy(self, message: Message, link: Link, now_s: float) -> None:
        """REQUEST_DATA_STREAM: one rate for a group of messages, 0 for all."""
        everything = tuple(name for names in LEGACY_STREAMS.values() for name in names)
        names = LEGACY_STREAMS.get(message.req_stream_id, everything if message.req_stream_id == 0 else ())
        for name in filter(self._telemetry.__contains__, names):
            wanted = message.start_stop and message.req_message_rate
            self._stream(link, name, 1.0 / message.req_message_rate if wanted else math.inf, now_s)

    def _once(self, name: str | None) -> Answer:
        if name is None:
            return Result.DENIED if self._board.is_px4 else Result.FAILED, []
        return Result.ACCEPTED, [(name, self._telemetry.fields(name))]

    def _tell_interval(self, msgid: int, link: Link) -> Answer:
        """The interval in microseconds; -1: not sent, 0: no such message."""
        name = self._name(msgid)
        interval_s = None if name is None else link.interval_s(name)
        interval_us = 0 if name is None else -1
        if interval_s is not None:
            interval_us = min(round(interval_s * 1e6), LONGEST_TOLD_US)
        result = Result.FAILED if name is None and not self._board.is_px4 else Result.ACCEPTED
        return result, [("MESSAGE_INTERVAL", {"message_id": msgid & 0xFFFF, "interval_us": interval_us})]

    def _set_interval(self, command: Command, link: Link, now_s: float) -> Result:
        name, interval_us = self._name(command[1]), command[2]
        if name is None:
            if self._board.is_px4:
                return Result.ACCEPTED  # PX4's answer, although it will not send it
            self._board.say(Severity.WARNING, "message interval refused: unknown message")
            return Result.DENIED
        if interval_us is None:
            interval_s = self._default_interval_s.get(name, math.inf)
        else:
            interval_s = math.inf if interval_us < 0.0 else interval_us / 1e6
        self._stream(link, name, interval_s, now_s)
        return Result.ACCEPTED

    def _stream(self, link: Link, name: str, interval_s: float, now_s: float) -> None:
        phase = (self._board.system_id * _PHASE_STEP) % 1.0 * min(interval_s, 0.1) if math.isfinite(interval_s) else 0.0
        link.stream(name, interval_s, now_s + phase)

    def _name(self, msgid: float | None) -> str | None:
        name = name_of(int(msgid or 0))
        return name if name is not None and name in self._telemetry else None
