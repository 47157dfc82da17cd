"""COMMAND_LONG and COMMAND_INT to what the pilot does, and the MAV_RESULT that goes back.

Clients fill what they do not use with NaN (for PX4) or 0 (for ArduPilot), so both mean "as usual". Every command may
come twice, because an acknowledgement was lost: none does more the second time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.modes import MODE_FLAG_CUSTOM, Flavour, Mode, px4_custom_mode
from sitl_sim.autopilot.parameters import Parameters
from sitl_sim.autopilot.pilot import Pilot, Result


class MavCommand(IntEnum):
    """MAV_CMD."""

    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    DO_SET_MODE = 176
    DO_CHANGE_SPEED = 178
    DO_REPOSITION = 192
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520


REPOSITION_CHANGES_MODE = 1
GLOBAL_FRAMES = (0, 5)
"""MAV_FRAME_GLOBAL and _INT: altitudes above mean sea level."""

RELATIVE_FRAMES = (3, 6)
"""MAV_FRAME_GLOBAL_RELATIVE_ALT and _INT: altitudes above home."""

_UNUSED_INT = 0x7FFFFFFF


@dataclass(frozen=True, slots=True)
class Command:
    """One command in either form; None where a parameter says "as usual"."""

    number: int
    parameters: tuple[float | None, ...]
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    frame: int

    def __getitem__(self, number: int) -> float | None:
        """Parameter 1 to 7."""
        return self.parameters[number - 1]


def read_command(message: Message) -> Command:
    """The command in a COMMAND_LONG or COMMAND_INT."""
    first = tuple(_given(message.fields[f"param{number}"]) for number in range(1, 5))
    if message.name == "COMMAND_INT":
        latitude, longitude = (None if value in (0, _UNUSED_INT) else value / 1e7 for value in (message.x, message.y))
        altitude = _given(message.z)
        parameters = (*first, latitude, longitude, altitude)
        frame = message.frame
    else:
        parameters = (*first, *(_given(message.fields[f"param{number}"]) for number in range(5, 8)))
        latitude, longitude, altitude = parameters[4:]
        frame = GLOBAL_FRAMES[0]
    return Command(message.command, parameters, latitude, longitude, altitude, frame)


def _given(value: float) -> float | None:
    return value if math.isfinite(value) and value != 0.0 else None


class Commands:
    """Commands of one vehicle. What concerns messages and their rates is the business of `Autopilot`.

    Args:
        pilot: Who carries them out.
        flavour: How modes are numbered.
        parameters: Its parameters.
        scenario_home: Origin of the scenario's coordinates.
        own_home: Where the vehicle took off.
    """

    def __init__(
        self, pilot: Pilot, flavour: Flavour, parameters: Parameters, scenario_home: Geodetic, own_home: Geodetic
    ) -> None:
        self._pilot, self._flavour, self._parameters = pilot, flavour, parameters
        self._scenario_home, self._own_home = scenario_home, own_home
        self._actions: dict[int, Callable[[Command, float], Result]] = {
            MavCommand.NAV_RETURN_TO_LAUNCH: lambda _, now_s: pilot.set_mode(Mode.RETURN, now_s),
            MavCommand.NAV_LAND: lambda _, __: pilot.land(),
            MavCommand.NAV_TAKEOFF: self._take_off,
            MavCommand.DO_SET_MODE: self._set_mode,
            MavCommand.DO_CHANGE_SPEED: self._change_speed,
            MavCommand.DO_REPOSITION: self._reposition,
            MavCommand.COMPONENT_ARM_DISARM: lambda command, _: pilot.arm(command[1] is not None),
        }

    def execute(self, command: Command, now_s: float) -> Result:
        """Do it, or say why not."""
        action = self._actions.get(command.number)
        return Result.UNSUPPORTED if action is None else action(command, now_s)

    def _set_mode(self, command: Command, now_s: float) -> Result:
        if not int(command[1] or 0) & MODE_FLAG_CUSTOM:
            return Result.DENIED
        number, sub = command[2] or 0.0, command[3] or 0.0
        if not (0 <= number < 256 and 0 <= sub < 256):
            return Result.DENIED
        custom = px4_custom_mode(int(number), int(sub)) if self._flavour.is_px4 else int(number)
        mode = self._flavour.mode_of(custom)
        return Result.DENIED if mode is None else self._pilot.set_mode(mode, now_s)

    def _take_off(self, command: Command, now_s: float) -> Result:
        altitude_m = command.altitude_m
        if self._flavour.is_px4:
            # above mean sea level; without one, or with one below, PX4 climbs to its own default
            usual_m = self._parameters["MIS_TAKEOFF_ALT"]
            height_m = usual_m if altitude_m is None else altitude_m - self._own_home.altitude_m
            return self._pilot.take_off(height_m if height_m > 0.0 else usual_m)
        if altitude_m is None or altitude_m <= 0.0:
            return Result.FAILED
        return self._pilot.take_off(altitude_m)

    def _change_speed(self, command: Command, now_s: float) -> Result:
        if command[2] is not None and command[2] > 0.0:
            self._pilot.commanded_cruise_mps = command[2]
        return Result.ACCEPTED

    def _reposition(self, command: Command, now_s: float) -> Result:
        changes_mode = int(command[2] or 0) & REPOSITION_CHANGES_MODE
        suited = Mode.HOLD if self._flavour.is_px4 else Mode.OFFBOARD
        if not changes_mode and self._pilot.mode is not suited:
            return Result.DENIED
        if command.frame not in (*GLOBAL_FRAMES, *RELATIVE_FRAMES):
            return Result.DENIED
        estimate = self._pilot.estimate
        target = [estimate.north_m, estimate.east_m, estimate.down_m]
        latitude, longitude = command.latitude_deg, command.longitude_deg
        if latitude is not None and longitude is not None:
            if abs(latitude) > 90.0 or abs(longitude) > 180.0:
                return Result.DENIED
            home = self._scenario_home
            target[:2] = ned_from_geodetic(latitude, longitude, home.altitude_m, home)[:2].tolist()
        if command.altitude_m is not None:
            above = 0.0 if command.frame in RELATIVE_FRAMES else self._own_home.altitude_m
            target[2] = above - command.altitude_m
        if command[4] is not None:
            self._pilot.nose.turn_to(command[4])
        speed = command[1]
        return self._pilot.go_to((target[0], target[1], target[2]), speed if speed and speed > 0.0 else None)
