"""Flight modes and how PX4 and ArduPilot number them in HEARTBEAT.custom_mode and MAV_CMD_DO_SET_MODE."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum


class Mode(StrEnum):
    """Flight modes by the behaviour of the vehicle, with PX4's names."""

    MANUAL = "manual"
    ALTITUDE = "altitude"
    POSITION = "position"
    HOLD = "hold"
    BRAKE = "brake"
    TAKEOFF = "takeoff"
    MISSION = "mission"
    RETURN = "return"
    LAND = "land"
    OFFBOARD = "offboard"
    """OFFBOARD of PX4, GUIDED of ArduPilot: setpoints from outside are obeyed."""


@dataclass(frozen=True, slots=True)
class Flavour:
    """The MAVLink identity and numbers of one autopilot.

    Args:
        name: Name for ``--autopilot``.
        autopilot: MAV_AUTOPILOT in HEARTBEAT.
        base_mode: MAV_MODE_FLAG of a disarmed vehicle in any mode; `mode_flags`: flags added in some modes.
        custom_modes: Numbers of its modes.
        ground_mode: Mode of a disarmed vehicle without a pilot.
        capabilities: MAV_PROTOCOL_CAPABILITY in AUTOPILOT_VERSION.
        version: Version of the measured build, in AUTOPILOT_VERSION: bytes major, minor, patch, FIRMWARE_VERSION_TYPE.
        refused: MAV_RESULT of a command at the wrong moment: TEMPORARILY_REJECTED on PX4, FAILED on ArduPilot.
        mode_names: Names of ground stations for modes that have another name here.
    """

    name: str
    autopilot: int
    base_mode: int
    mode_flags: dict[Mode, int]
    custom_modes: dict[Mode, int]
    ground_mode: Mode
    capabilities: int
    version: int
    refused: int
    mode_names: dict[Mode, str] = field(default_factory=dict)

    @property
    def is_px4(self) -> bool:
        """Whether it behaves like PX4."""
        return self.autopilot == MAV_AUTOPILOT_PX4

    def name_of(self, mode: Mode) -> str:
        """Name of a mode for ground stations."""
        return self.mode_names.get(mode, str(mode))

    def mode_of(self, custom_mode: int) -> Mode | None:
        """The mode with this number, None if there is none. Of PX4's, only AUTO has sub-modes; 0 is MISSION."""
        if self.is_px4:
            main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
            custom_mode = px4_custom_mode(main, (sub or PX4_MISSION) if main == PX4_AUTO else 0)
        return next((mode for mode, number in self.custom_modes.items() if number == custom_mode), None)


MAV_AUTOPILOT_ARDUPILOTMEGA = 3
MAV_AUTOPILOT_PX4 = 12
MODE_FLAG_CUSTOM = 1
MODE_FLAG_ARMED = 128
_AUTO, _GUIDED, _STABILIZE, _MANUAL_INPUT = 4, 8, 16, 64

_MISSION_INT, _COMMAND_INT, _LOCAL_SETPOINTS, _GLOBAL_SETPOINTS, _MAVLINK2 = 4, 8, 128, 256, 8192
_COMMON = _MISSION_INT | _COMMAND_INT | _LOCAL_SETPOINTS | _GLOBAL_SETPOINTS | _MAVLINK2
_PARAM_ENCODE_BYTEWISE, _PARAM_ENCODE_C_CAST = 16, 131072


PX4_AUTO, PX4_MISSION = 4, 4
PX4_REJECTED = (PX4_AUTO, 5, 7)
"""Main modes of PX4 that are rejected: AUTO with an unknown sub-mode, and ACRO and STABILIZED, which want a pilot. PX4
accepts any other number that it does not know, and changes nothing."""


def px4_custom_mode(main: int, sub: int = 0) -> int:
    """PX4's custom_mode: main mode in the third byte, sub-mode in the fourth."""
    return main << 16 | sub << 24


PX4 = Flavour(
    name="px4",
    autopilot=MAV_AUTOPILOT_PX4,
    base_mode=MODE_FLAG_CUSTOM | _STABILIZE,
    mode_flags=dict.fromkeys((Mode.HOLD, Mode.TAKEOFF, Mode.MISSION, Mode.RETURN, Mode.LAND), _AUTO | _GUIDED)
    | dict.fromkeys((Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION), _MANUAL_INPUT),
    custom_modes={
        Mode.HOLD: px4_custom_mode(4, 3),
        Mode.OFFBOARD: px4_custom_mode(6),
        Mode.TAKEOFF: px4_custom_mode(4, 2),
        Mode.MISSION: px4_custom_mode(4, 4),
        Mode.RETURN: px4_custom_mode(4, 5),
        Mode.LAND: px4_custom_mode(4, 6),
        Mode.MANUAL: px4_custom_mode(1),
        Mode.ALTITUDE: px4_custom_mode(2),
        Mode.POSITION: px4_custom_mode(3),
    },
    ground_mode=Mode.HOLD,
    capabilities=_COMMON | _PARAM_ENCODE_BYTEWISE,
    version=0x01_11_00_40,  # 1.17.0, alpha
    refused=1,
)

ARDUPILOT = Flavour(
    name="ardupilot",
    autopilot=MAV_AUTOPILOT_ARDUPILOTMEGA,
    base_mode=MODE_FLAG_CUSTOM | _STABILIZE | _MANUAL_INPUT,
    mode_flags=dict.fromkeys((Mode.MISSION, Mode.OFFBOARD, Mode.HOLD, Mode.RETURN, Mode.POSITION, Mode.BRAKE), _GUIDED),
    custom_modes={
        Mode.MANUAL: 0,
        Mode.ALTITUDE: 2,
        Mode.MISSION: 3,
        Mode.OFFBOARD: 4,
        Mode.HOLD: 5,
        Mode.RETURN: 6,
        Mode.LAND: 9,
        Mode.POSITION: 16,
        Mode.BRAKE: 17,
    },
    ground_mode=Mode.MANUAL,
    capabilities=_COMMON | _PARAM_ENCODE_C_CAST,
    version=0x04_06_00_00,  # 4.6.0, development
    refused=4,
    mode_names={
        Mode.MANUAL: "STABILIZE",
        Mode.ALTITUDE: "ALT_HOLD",
        Mode.MISSION: "AUTO",
        Mode.OFFBOARD: "GUIDED",
        Mode.HOLD: "LOITER",
        Mode.RETURN: "RTL",
        Mode.LAND: "LAND",
        Mode.POSITION: "POSHOLD",
        Mode.BRAKE: "BRAKE",
    },
)

FLAVOURS: dict[str, Flavour] = {"px4": PX4, "ardupilot": ARDUPILOT, "ideal": PX4}
"""Autopilots by their names for ``--autopilot``. The ideal vehicle uses PX4's MAVLink; only its response in the world
differs."""
