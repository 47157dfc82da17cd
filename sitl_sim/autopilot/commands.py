"""COMMAND_LONG and COMMAND_INT to actions of the pilot, and the MAV_RESULT that is returned.

Clients fill unused parameters with NaN (for PX4) or 0 (for ArduPilot), so both mean "default" nearly everywhere. Every
command may come twice, because an acknowledgement was lost; the second time has no further effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from ridlink.geodesy import ned_from_geodetic
from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.failures import failure_event
from sitl_sim.autopilot.guidance import GoTo
from sitl_sim.autopilot.mission_items import UNUSED_INT, Item, read_item
from sitl_sim.autopilot.modes import Mode, px4_custom_mode
from sitl_sim.autopilot.orders import Orders
from sitl_sim.autopilot.pilot import Pilot
from sitl_sim.autopilot.results import MissionResult, Result, Severity
from sitl_sim.autopilot.setpoints import ALTITUDE_FRAMES, HEIGHT_FRAMES


class MavCommand(IntEnum):
    """MAV_CMD."""

    NAV_LOITER_UNLIMITED = 17
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_CHANGE_SPEED = 178
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    DO_SET_MISSION_CURRENT = 224
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    INJECT_FAILURE = 420
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_PROTOCOL_VERSION = 519
    REQUEST_AUTOPILOT_CAPABILITIES = 520


REPOSITION_CHANGES_MODE = 1

NO_MODE = 255
"""Stands for any number that no mode has."""

SPEED_KINDS, SPEED_MODES = range(4), (Mode.MISSION, Mode.OFFBOARD, Mode.RETURN)
"""Kinds of speed that ArduPilot knows, and its modes in which it changes them."""

TAKEOFF_FRAME = 3
"""MAV_FRAME_GLOBAL_RELATIVE_ALT: the frame in which ArduPilot takes off."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command in either form. A COMMAND_LONG has no frame; positions are in degrees.

    Attributes:
        given: Parameters 1 to 7; None if not given, that is NaN, or the greatest integer for a position.
    """

    number: int
    given: tuple[float | None, ...]
    frame: int | None

    def __getitem__(self, number: int) -> float | None:
        """Parameter 1 to 7; None if it is NaN or 0, which mean "default"."""
        return self.given[number - 1] or None


def read_command(message: Message) -> Command:
    """The command in a COMMAND_LONG or COMMAND_INT."""
    first = [message.fields[f"param{number}"] for number in range(1, 5)]
    if message.name == "COMMAND_INT":
        is_open = message.x == message.y == UNUSED_INT
        place = (math.nan, math.nan) if is_open else (message.x / 1e7, message.y / 1e7)
        parameters, frame = (*first, *place, message.z), message.frame
    else:
        parameters, frame = (*first, *(message.fields[f"param{number}"] for number in range(5, 8))), None
    return Command(message.command, tuple(each if math.isfinite(each) else None for each in parameters), frame)


class Commands:
    """Commands of one vehicle. `Streams` processes commands about messages and their rates.

    Args:
        board: The flight controller, with the numbers of its modes.
        pilot: The pilot that executes them.
        orders: Its orders.
    """

    def __init__(self, board: Board, pilot: Pilot, orders: Orders) -> None:
        self._board, self._pilot, self._orders = board, pilot, orders
        self._actions: dict[int, Callable[[Command, float], Result | None]] = {
            MavCommand.NAV_RETURN_TO_LAUNCH: lambda _, now_s: orders.set_mode(Mode.RETURN, now_s),
            MavCommand.NAV_LAND: lambda _, __: orders.land(),
            MavCommand.NAV_TAKEOFF: self._take_off,
            MavCommand.DO_SET_MODE: self._set_mode,
            MavCommand.DO_CHANGE_SPEED: self._change_speed,
            MavCommand.DO_REPOSITION: self._reposition,
            MavCommand.DO_SET_MISSION_CURRENT: self._set_mission_current,
            MavCommand.MISSION_START: self._start_mission,
            MavCommand.INJECT_FAILURE: self._inject_failure,
            MavCommand.COMPONENT_ARM_DISARM: self._arm,
        }
        if not board.is_px4:
            self._actions |= {
                MavCommand.NAV_LOITER_UNLIMITED: lambda _, now_s: orders.set_mode(Mode.HOLD, now_s),
                MavCommand.CONDITION_YAW: self._turn,
                MavCommand.DO_PAUSE_CONTINUE: self._pause_or_continue,
            }

    def execute(self, command: Command, now_s: float) -> Result | None:
        """Execute a command, or say why not. None: it gets no answer."""
        action = self._actions.get(command.number)
        return Result.UNSUPPORTED if action is None else action(command, now_s)

    def _set_mode(self, command: Command, now_s: float) -> Result:
        number, sub = (int(each) if 0.0 <= each < 256.0 else NO_MODE for each in (command[2] or 0.0, command[3] or 0.0))
        custom = px4_custom_mode(number, sub) if self._board.is_px4 else number
        return self._orders.choose_mode(int(command[1] or 0), custom, now_s)

    def _arm(self, command: Command, now_s: float) -> Result | None:
        """Arm with 1, disarm with 0. PX4 rounds, and gives no answer to any other number."""
        value = command.given[0]
        if self._board.is_px4:
            value = math.floor((value or 0.0) + 0.5)
            if value not in (0, 1):
                self._board.say(Severity.CRITICAL, f"Unsupported ARM_DISARM param: {command.given[0]:.3f}")
                return None
        return self._orders.arm(value == 1.0, now_s) if value in (0.0, 1.0) else Result.UNSUPPORTED

    def _inject_failure(self, command: Command, now_s: float) -> Result:
        unit, kind = int(command[1] or 0), int(command[2] or 0)
        event = failure_event(unit, kind, self._board.system_id)
        if event is None:
            return self._orders.refuse(f"failure refused: none like {unit}/{kind}", Result.UNSUPPORTED)
        self._board.inject(event)
        return Result.ACCEPTED

    def _take_off(self, command: Command, now_s: float) -> Result:
        altitude_m = command[7]
        if self._board.is_px4:  # above mean sea level
            return self._orders.take_off(None if altitude_m is None else altitude_m - self._board.own_home.altitude_m)
        if command.frame not in (None, TAKEOFF_FRAME):
            return self._orders.refuse(f"take-off refused: frame {command.frame}", Result.DENIED)
        if altitude_m is None or altitude_m <= 0.0:
            return self._orders.refuse("take-off refused: no height")
        return self._orders.take_off(altitude_m)

    def _change_speed(self, command: Command, now_s: float) -> Result:
        kind, speed_mps = command[1] or 0.0, command[2] or 0.0
        if not self._board.is_px4:
            if speed_mps <= 0.0:
                return self._orders.refuse("speed refused: not above zero", Result.DENIED)
            if kind not in SPEED_KINDS or self._pilot.mode not in SPEED_MODES:
                return self._orders.refuse("speed refused: unknown kind, or another mode")
        self._pilot.change_speed(kind, speed_mps)
        return Result.ACCEPTED

    def _reposition(self, command: Command, now_s: float) -> Result:
        """ArduPilot needs the frame and a position. PX4 ignores the frame: every altitude is above mean sea level, and
        values that are not given stay unchanged. Zero is a value like any other. Its commander takes the change of the
        mode and nothing else, but in HOLD its navigator flies there, whatever the answer.

        Source: Commander::handle_command and Navigator::run of PX4; mav_frame_for_command_long and Location::sanitize
        of ArduPilot.
        """
        is_px4 = self._board.is_px4
        if not is_px4 and command.frame is None:
            return self._orders.refuse("reposition refused: wants COMMAND_INT", Result.UNSUPPORTED)
        flags, suited = int(command[2] or 0), Mode.HOLD if is_px4 else Mode.OFFBOARD
        is_supported = not is_px4 or flags == REPOSITION_CHANGES_MODE
        changes_mode = is_supported and flags & REPOSITION_CHANGES_MODE
        if not changes_mode and self._pilot.mode is not suited:
            why = Result.DENIED if is_supported else Result.UNSUPPORTED
            return self._orders.refuse("reposition refused: another mode", why)
        if not is_px4 and command.frame not in (*ALTITUDE_FRAMES, *HEIGHT_FRAMES):
            return self._orders.refuse(f"reposition refused: frame {command.frame}", Result.DENIED)
        *_, yaw_rad, latitude, longitude, altitude = command.given
        is_height = not is_px4 and command.frame in HEIGHT_FRAMES
        if not is_px4 and (not (latitude or longitude) or (is_height and altitude == 0.0)):
            return self._orders.refuse("reposition refused: no place", Result.DENIED)
        estimate, going = self._pilot.estimate, self._pilot.guidance
        target = [estimate.north_m, estimate.east_m, estimate.down_m]
        if latitude is not None and longitude is not None:
            if abs(latitude) > 90.0 or abs(longitude) > 180.0:
                return self._orders.refuse("reposition refused: no place on Earth", Result.DENIED)
            home = self._board.scenario_home
            target[:2] = ned_from_geodetic(latitude, longitude, home.altitude_m, home)[:2].tolist()
        elif isinstance(going, GoTo) and self._pilot.mode is not Mode.OFFBOARD and (altitude, yaw_rad) != (None, None):
            target[:2] = going.target_ned_m[:2]
        if altitude is not None:
            target[2] = (0.0 if is_height else self._board.own_home.altitude_m) - altitude
        speed = command[1]
        result = self._orders.go_to((target[0], target[1], target[2]), speed if speed and speed > 0.0 else None)
        if result is Result.ACCEPTED and is_px4 and yaw_rad is not None:
            self._pilot.nose.turn_to(yaw_rad)
        return result if is_supported else Result.UNSUPPORTED

    def go_to_item(self, message: Message) -> MissionResult:
        """ArduPilot in GUIDED: fly to the waypoint in a MISSION_ITEM or MISSION_ITEM_INT that is no part of a mission.

        Source: GCS_MAVLINK::handle_mission_item and ModeAuto::do_guided of ArduPilot.
        """
        item = read_item(message, 0)
        if isinstance(item, MissionResult):
            return item
        pilot, is_place = self._pilot, item.command == Item.WAYPOINT and item.latitude_longitude_deg is not None
        if pilot.mode is not Mode.OFFBOARD or not is_place:
            self._orders.refuse("item refused: another mode, or no place")
            return MissionResult.ERROR
        result = self._orders.go_to(pilot.mission.place_ned_m(item, pilot.estimate), None)
        return MissionResult.ACCEPTED if result is Result.ACCEPTED else MissionResult.ERROR

    def _pause_or_continue(self, command: Command, now_s: float) -> Result:
        """Pause with 0, go on with 1."""
        kind = int(command[1] or 0)
        return self._orders.pause(kind == 0) if kind in (0, 1) else Result.DENIED

    def _set_mission_current(self, command: Command, now_s: float) -> Result:
        seq = command[1] or 0.0
        if not (0 <= seq < 65536 and self._pilot.mission.set_current(int(seq))):
            return self._orders.refuse("mission: there is no such item", Result.DENIED)
        return Result.ACCEPTED

    def _start_mission(self, command: Command, now_s: float) -> Result:
        """PX4 starts with an item, or for -1 with the present one; ArduPilot takes neither a first nor a last item."""
        if not self._board.is_px4 and (command[1] is not None or command[2] is not None):
            return self._orders.refuse("mission: starts where it is, and ends at its end", Result.DENIED)
        mission, first = self._pilot.mission, command.given[0]
        if self._board.is_px4 and mission.exists:
            if first is None or not -1.0 <= first < len(mission.plan):
                return self._orders.refuse("mission: there is no such item", Result.DENIED)
            if first >= 0.0:
                mission.set_current(int(first))
        return self._orders.start_mission(now_s)

    def _turn(self, command: Command, now_s: float) -> Result:
        """CONDITION_YAW: to a heading, or by an angle in the direction of parameter 3."""
        yaw_deg, _, _, relative, *_ = command.given
        if yaw_deg is None or not 0.0 <= yaw_deg <= 360.0 or relative not in (0.0, 1.0):
            return self._orders.refuse("heading refused: not 0 to 360")
        self._pilot.nose.turn_degrees(yaw_deg, relative=relative == 1.0, direction=command[3] or 1.0)
        return Result.ACCEPTED
