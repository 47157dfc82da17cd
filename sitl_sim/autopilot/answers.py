"""The effects of received messages, and the answers to their senders: one method per message."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ridlink.mavlink.codec import Message, message_spec
from ridlink.mavlink.frames import Frame
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.commands import Command, Commands, MavCommand, read_command
from sitl_sim.autopilot.files import refuse_file_transfer
from sitl_sim.autopilot.link import Address, Link
from sitl_sim.autopilot.mission_protocol import MISSION, MissionProtocol
from sitl_sim.autopilot.modes import Mode
from sitl_sim.autopilot.orders import Orders
from sitl_sim.autopilot.parameter_protocol import ParameterProtocol
from sitl_sim.autopilot.peers import MAX_PASSED_ON
from sitl_sim.autopilot.pilot import Pilot
from sitl_sim.autopilot.results import Reply, Result, Severity
from sitl_sim.autopilot.status_texts import StatusTexts
from sitl_sim.autopilot.streams import Streams

AVOIDANCE_COMPONENT = 196
"""MAV_COMP_ID_OBSTACLE_AVOIDANCE: an avoidance daemon."""

MAV_TYPE_GCS = 6

THROTTLE_MIDDLE_US = (1400, 1600)
THROTTLE_MIDDLE = (400, 600)
"""Stick positions of RC_CHANNELS_OVERRIDE and MANUAL_CONTROL that keep the height."""

CHANNEL_IGNORED = 0xFFFF
"""Value of a channel that RC_CHANNELS_OVERRIDE leaves as it is."""

FOR_NOW = 2
"""Value of `current` in an item that ArduPilot flies to at once."""

_FOR_EVERYBODY = (MavCommand.REQUEST_PROTOCOL_VERSION, MavCommand.REQUEST_AUTOPILOT_CAPABILITIES)
"""Commands that PX4 takes if they are addressed to all vehicles; ArduPilot takes all commands."""

_MISSION_MESSAGES = (
    "COUNT", "ITEM_INT", "ITEM", "REQUEST_LIST", "REQUEST_INT", "REQUEST", "CLEAR_ALL", "SET_CURRENT",
    "WRITE_PARTIAL_LIST", "ACK",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Heard:
    """A message, its frame, the link of its sender, and its time of receipt [s, monotonic]."""

    message: Message
    frame: Frame
    link: Link
    now_s: float


class Answers:
    """The answers of one vehicle.

    Args:
        board: The flight controller.
        pilot: Its flight logic.
        missions: The protocol of its missions.
        streams: Message rates, which clients can set.
        texts: Its STATUSTEXT messages.

    Attributes:
        daemon_heard_s: Time when an avoidance daemon of this vehicle was last heard.
    """

    def __init__(
        self, board: Board, pilot: Pilot, missions: MissionProtocol, streams: Streams, texts: StatusTexts
    ) -> None:
        self._board, self._pilot = board, pilot
        self._missions, self._streams, self._texts = missions, streams, texts
        self._orders = Orders(board, pilot)
        self._commands = Commands(board, pilot, self._orders)
        self._parameters = parameters = ParameterProtocol(board)
        self.daemon_heard_s = -math.inf
        self._repeated: list[bytes] = []
        self._for_others: list[tuple[Address, Reply]] = []
        handlers: dict[str, Callable[[Heard], list[Reply]]] = {
            "HEARTBEAT": self._heartbeat,
            "PING": self._ping,
            "TIMESYNC": self._timesync,
            "SET_MODE": self._set_mode,
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "SET_POSITION_TARGET_LOCAL_NED": self._setpoint,
            "SET_POSITION_TARGET_GLOBAL_INT": self._setpoint,
            "SET_ATTITUDE_TARGET": self._attitude_setpoint,
            "RC_CHANNELS_OVERRIDE": self._rc_override,
            "MANUAL_CONTROL": self._manual_control,
            "ADSB_VEHICLE": self._adsb_vehicle,
            "PARAM_REQUEST_LIST": lambda heard: parameters.everything(heard.message),
            "PARAM_REQUEST_READ": lambda heard: parameters.read(heard.message),
            "PARAM_SET": self._param_set,
            "REQUEST_DATA_STREAM": self._request_data_stream,
            "FILE_TRANSFER_PROTOCOL": self._file_transfer,
            "LOG_REQUEST_LIST": lambda _: [("LOG_ENTRY", {})],  # all zeros: there are none
            **{f"MISSION_{name}": self._mission for name in _MISSION_MESSAGES},
        }
        self._handlers = {message_spec(name).msgid: handler for name, handler in handlers.items()}

    def __contains__(self, msgid: int) -> bool:
        """Whether a message with this id has an effect."""
        return msgid in self._handlers

    def to(self, heard: Heard) -> list[Reply]:
        """Process a message; returns the answers.

        Raises:
            KeyError: If the message has no effect.
        """
        return self._handlers[heard.frame.msgid](heard)

    def repeated(self) -> list[bytes]:
        """Payloads of ADSB_VEHICLE to send out again, once."""
        repeated, self._repeated = self._repeated, []
        return repeated

    def for_others(self) -> list[tuple[Address, Reply]]:
        """Messages to send, once, to all except the peer at the address, which has them already."""
        told, self._for_others = self._for_others, []
        return told

    # --- one a message ------------------------------------------------------------------------------------------------

    def _heartbeat(self, heard: Heard) -> list[Reply]:
        if (heard.frame.sysid, heard.frame.compid) == (self._board.system_id, AVOIDANCE_COMPONENT):
            self.daemon_heard_s = heard.now_s
        if heard.message.type == MAV_TYPE_GCS:
            self._pilot.failsafes.note_ground_station(heard.now_s)
        return []

    def _ping(self, heard: Heard) -> list[Reply]:
        message = heard.message
        if message.target_system or message.target_component:
            return []  # with a target it is a reply
        return [("PING", {"time_usec": message.time_usec, "seq": message.seq, **_to(heard.frame)})]

    def _file_transfer(self, heard: Heard) -> list[Reply]:
        return refuse_file_transfer(heard.message, heard.frame.sysid, heard.frame.compid)

    def _timesync(self, heard: Heard) -> list[Reply]:
        if heard.message.tc1:
            return []
        boot_ns = round(self._pilot.navigation.time_s * 1e9)
        return [("TIMESYNC", {"tc1": max(boot_ns, 1), "ts1": heard.message.ts1})]

    def _setpoint(self, heard: Heard) -> list[Reply]:
        self._pilot.take_setpoint(heard.message, heard.now_s)
        return []

    def _attitude_setpoint(self, heard: Heard) -> list[Reply]:
        """Not flown: PX4 then loses its stream, ArduPilot stays where it is, and neither would say why."""
        if self._pilot.mode is Mode.OFFBOARD:
            self._board.say(Severity.WARNING, "attitude setpoints are not flown here")
        return []

    def _rc_override(self, heard: Heard) -> list[Reply]:
        low, high = THROTTLE_MIDDLE_US
        if heard.message.chan3_raw != CHANNEL_IGNORED:  # 0 releases the stick
            self._pilot.steering.note_throttle(centred=low <= heard.message.chan3_raw <= high, now_s=heard.now_s)
        return []

    def _manual_control(self, heard: Heard) -> list[Reply]:
        low, high = THROTTLE_MIDDLE
        self._pilot.steering.note_throttle(centred=low <= heard.message.z <= high, now_s=heard.now_s)
        return []

    def _adsb_vehicle(self, heard: Heard) -> list[Reply]:
        """PX4 sends out traffic of others again as its own."""
        if self._board.is_px4 and len(self._repeated) < MAX_PASSED_ON:
            self._repeated.append(heard.frame.payload)
        return []

    def _set_mode(self, heard: Heard) -> list[Reply]:
        """The old message is acknowledged like a command: by PX4 as DO_SET_MODE, by ArduPilot under its own number."""
        result = self._orders.choose_mode(heard.message.base_mode, heard.message.custom_mode, heard.now_s)
        command = int(MavCommand.DO_SET_MODE) if self._board.is_px4 else heard.frame.msgid
        return [("COMMAND_ACK", {"command": command, "result": int(result), **_to(heard.frame)})]

    def _mission(self, heard: Heard) -> list[Reply]:
        message = heard.message
        is_item = message.name in ("MISSION_ITEM_INT", "MISSION_ITEM") and message.mission_type == MISSION
        if is_item and message.current == FOR_NOW and not self._board.is_px4:
            return [("MISSION_ACK", {"type": int(self._commands.go_to_item(message)), **_to(heard.frame)})]
        sender = heard.frame.sysid, heard.frame.compid
        return self._missions.receive(heard.message, sender, heard.link.address, heard.now_s)

    def _param_set(self, heard: Heard) -> list[Reply]:
        """PX4 and ArduPilot both send a changed value to all peers."""
        replies, has_changed = self._parameters.set(heard.message)
        if has_changed and len(self._for_others) < MAX_PASSED_ON:
            self._for_others += [(heard.link.address, reply) for reply in replies]
        return replies

    def _request_data_stream(self, heard: Heard) -> list[Reply]:
        self._streams.legacy(heard.message, heard.link, heard.now_s)
        return []

    def _command(self, heard: Heard) -> list[Reply]:
        command = read_command(heard.message)
        said = self._texts.said
        result, asked_for = self._carry_out(command, heard)
        if result is None:
            return []
        if result is not Result.ACCEPTED and self._texts.said == said:
            self._texts.say(Severity.WARNING, f"command {command.number}: {result.name.lower().replace('_', ' ')}")
        results = [result]
        acknowledged_twice = self._board.is_px4 and command.number == MavCommand.DO_SET_MODE
        if acknowledged_twice:
            results.insert(0, Result.ACCEPTED)  # PX4 acknowledges twice, the first time whatever the result
        acknowledgement = {"command": command.number, **_to(heard.frame)}
        return [*(("COMMAND_ACK", acknowledgement | {"result": int(each)}) for each in results), *asked_for]

    def _carry_out(self, command: Command, heard: Heard) -> tuple[Result | None, list[Reply]]:
        if self._board.is_px4 and heard.message.target_system == 0 and command.number not in _FOR_EVERYBODY:
            return None, []
        answered = self._streams.command(command, heard.link, heard.now_s)
        return answered or (self._commands.execute(command, heard.now_s), [])


def _to(frame: Frame) -> dict[str, object]:
    return {"target_system": frame.sysid, "target_component": frame.compid}
