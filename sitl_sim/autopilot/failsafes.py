"""Failsafes: what an autopilot does by itself when setpoints, the position or the ground station are lost.

Times and actions were measured on both autopilots in their own simulators:

- Setpoints: PX4 leaves OFFBOARD after COM_OF_LOSS_T for the mode of COM_OBL_RC_ACT. The default needs a pilot; without
  one it returns home. (ArduPilot stays in GUIDED and brakes; that is no failsafe, see `routine`.)
- Position: ArduPilot lands 8.1 s after the last fix and takes no other action by itself. PX4 drops to altitude mode
  after 5.2 s, where without a pilot it sinks at 0.7 m/s, and returns home when the fix comes back.
- Ground station: both do nothing unless NAV_DLL_ACT or FS_GCS_ENABLE is set.
"""

from __future__ import annotations

from dataclasses import dataclass

from sitl_sim.autopilot.modes import Flavour, Mode
from sitl_sim.autopilot.navigation import Navigation
from sitl_sim.autopilot.parameters import Parameters

FIX_3D = 3

PX4_POSITION_LOST_S = 5.2
ARDUPILOT_POSITION_LOST_S = 7.2
"""Time after the last fix from which the position counts as lost."""

ARDUPILOT_LANDS_S = 8.1
ARDUPILOT_SILENT_S = 15.0
"""Time after the last fix from which LOCAL_POSITION_NED is no longer sent."""

_WITHOUT_POSITION = (Mode.MANUAL, Mode.ALTITUDE, Mode.LAND)
_SETPOINTS_LOST = {3: Mode.RETURN, 4: Mode.LAND, 5: Mode.HOLD}
"""Modes by COM_OBL_RC_ACT; 0 to 2 are modes for a pilot."""

_PX4_GROUND_STATION_LOST = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND}
"""NAV_DLL_ACT."""


@dataclass(frozen=True, slots=True)
class Failsafe:
    """A change of mode by the autopilot itself; `resumes`: whether the stream of setpoints reverts it."""

    mode: Mode
    text: str
    resumes: bool = False


class Failsafes:
    """The failsafes of one vehicle."""

    def __init__(self, flavour: Flavour, parameters: Parameters, now_s: float) -> None:
        self._px4, self._parameters = flavour.is_px4, parameters
        self._fix_at_s = self._time_s = now_s
        self._position_failed = False
        self._ground_station_s: float | None = None

    @property
    def _without_fix_s(self) -> float:
        return self._time_s - self._fix_at_s

    @property
    def has_position(self) -> bool:
        """Whether it has a position."""
        return self._without_fix_s <= (PX4_POSITION_LOST_S if self._px4 else ARDUPILOT_POSITION_LOST_S)

    @property
    def tells_position(self) -> bool:
        """Whether LOCAL_POSITION_NED is still sent; PX4 always sends it, even if it is wrong."""
        return self._px4 or self._without_fix_s <= ARDUPILOT_SILENT_S

    def note_ground_station(self, now_s: float) -> None:
        """Note a heartbeat of a ground station."""
        self._ground_station_s = now_s

    def watch(self, navigation: Navigation, mode: Mode, now_s: float) -> Failsafe | None:
        """The failsafe that acts now, for a vehicle in the air."""
        self._time_s = navigation.time_s
        recovered = False
        if navigation.fix_type >= FIX_3D:
            self._fix_at_s = navigation.time_s
            recovered, self._position_failed = self._position_failed, False
        if not navigation.in_air:
            self._position_failed = False
            return None
        return self._position(mode, recovered) or self._ground_station(mode, now_s)

    def setpoints_lost(self) -> Failsafe:
        """PX4's failsafe when setpoints stop in OFFBOARD."""
        mode = _SETPOINTS_LOST.get(int(self._parameters["COM_OBL_RC_ACT"]), Mode.RETURN)
        return Failsafe(mode, f"Failsafe activated: no offboard signal, {mode}", resumes=True)

    def _position(self, mode: Mode, recovered: bool) -> Failsafe | None:
        if self._px4 and recovered and mode is Mode.ALTITUDE:
            return Failsafe(Mode.RETURN, "Failsafe activated: position regained, return")
        lost_s = PX4_POSITION_LOST_S if self._px4 else ARDUPILOT_LANDS_S
        if self._position_failed or self._without_fix_s <= lost_s or mode in _WITHOUT_POSITION:
            return None
        self._position_failed = True
        if self._px4:
            return Failsafe(Mode.ALTITUDE, "Failsafe activated: position lost, altitude")
        return Failsafe(Mode.LAND, "EKF Failsafe: changed to LAND Mode")

    def _ground_station(self, mode: Mode, now_s: float) -> Failsafe | None:
        if self._px4:
            action = _PX4_GROUND_STATION_LOST.get(int(self._parameters["NAV_DLL_ACT"]))
            patience_s = self._parameters["COM_DL_LOSS_T"]
        else:
            enabled = int(self._parameters["FS_GCS_ENABLE"])
            action = None if enabled == 0 else Mode.LAND if enabled == 5 else Mode.RETURN
            patience_s = self._parameters["FS_GCS_TIMEOUT"]
        heard_s = self._ground_station_s
        if action is None or heard_s is None or now_s - heard_s <= patience_s:
            return None
        self._ground_station_s = None  # acts once; the next heartbeat enables it again
        if mode in (action, Mode.LAND, Mode.RETURN):
            return None
        return Failsafe(action, f"Failsafe activated: no ground station, {action}")
