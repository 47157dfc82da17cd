"""Orders to a vehicle, and their refusals: modes, arming, take-off, landing, flying to a point.

Every refusal comes with a STATUSTEXT that gives the reason. Every order may be repeated.
"""

from __future__ import annotations

from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.failsafes import FIX_3D
from sitl_sim.autopilot.guidance import Climb, Velocity
from sitl_sim.autopilot.modes import MODE_FLAG_CUSTOM, PX4_REJECTED, Mode
from sitl_sim.autopilot.navigation import Vector
from sitl_sim.autopilot.pilot import Pilot
from sitl_sim.autopilot.results import Result, Severity
from sitl_sim.vehicle import VehicleState

_NEEDS_POSITION = (Mode.POSITION, Mode.HOLD, Mode.TAKEOFF, Mode.MISSION, Mode.RETURN, Mode.OFFBOARD, Mode.BRAKE)

_NOT_ARMABLE = (Mode.LAND, Mode.RETURN)
"""Modes in which neither arms: another one must be chosen first. ArduPilot does not arm in AUTO either."""


class Orders:
    """Orders to one vehicle.

    Args:
        board: The flight controller. A vehicle that is not cooperative flies its own mission and takes no orders.
        pilot: The pilot that executes them.
    """

    def __init__(self, board: Board, pilot: Pilot) -> None:
        self._board, self._pilot = board, pilot

    def refuse(self, why: str, result: Result | None = None) -> Result:
        """Report the reason; by default returns the result of this autopilot for a wrong moment."""
        self._board.say(Severity.WARNING, why)
        return Result(self._board.flavour.refused) if result is None else result

    def _unavailable(self) -> Result | None:
        """The refusal if no order at all can be taken now."""
        if not self._board.spec.cooperative:
            return self.refuse("refused: flies its own mission")
        if self._pilot.navigation.state is VehicleState.LANDING:
            return self.refuse("refused: has arrived and lands")
        return None

    # --- modes --------------------------------------------------------------------------------------------------------

    def choose_mode(self, base_mode: int, custom_mode: int, now_s: float) -> Result:
        """Change the mode by its number. What PX4 does not understand it accepts, and changes nothing.

        Source: Commander::handle_command of PX4, GCS_MAVLINK::_set_mode_common of ArduPilot.
        """
        is_px4, mode = self._board.is_px4, self._board.flavour.mode_of(custom_mode)
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
        if not base_mode & MODE_FLAG_CUSTOM:
            return Result.ACCEPTED if is_px4 else self.refuse("mode refused: no custom mode flag", Result.DENIED)
        if mode is not None:
            return self.set_mode(mode, now_s)
        if is_px4 and main not in PX4_REJECTED:
            return Result.ACCEPTED
        return self.refuse(f"mode refused: there is no {f'{main}/{sub}' if is_px4 else custom_mode}")

    def set_mode(self, mode: Mode, now_s: float) -> Result:
        """Change the mode."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        pilot = self._pilot
        if mode in _NEEDS_POSITION and pilot.navigation.in_air and not pilot.failsafes.has_position:
            return self.refuse(f"{mode} refused: no position")
        match mode:
            case Mode.OFFBOARD:
                return self._enter_offboard(now_s)
            case Mode.TAKEOFF:
                return self.take_off()
            case Mode.LAND:
                return self.land()
            case Mode.RETURN:
                pilot.fly_home()
            case Mode.MISSION:
                return self._enter_mission()
            case _:
                # if it already holds, it continues to its last target
                pilot.enter(mode, pilot.guidance if pilot.mode is mode and mode is Mode.HOLD else Velocity())
        return Result.ACCEPTED

    def _enter_offboard(self, now_s: float) -> Result:
        pilot = self._pilot
        if pilot.mode is Mode.OFFBOARD:
            return Result.ACCEPTED
        standing = not (pilot.navigation.in_air or pilot.armed)
        if self._board.is_px4 and not standing and not pilot.steering.has_stream(now_s):
            return self.refuse("offboard refused: no setpoints")
        pilot.enter_offboard()
        return Result.ACCEPTED

    def _enter_mission(self) -> Result:
        pilot = self._pilot
        if not pilot.mission.exists:
            return self.refuse("mission refused: there is none")
        if pilot.mode is Mode.MISSION:
            return Result.ACCEPTED
        grounded = pilot.navigation.state is VehicleState.GROUNDED
        if not self._board.is_px4 and grounded and not pilot.mission.begins_with_takeoff:
            return self.refuse("mission refused: Missing Takeoff Cmd")
        pilot.enter(Mode.MISSION, Velocity())
        pilot.mission_started = False
        pilot.mission.begin()
        return Result.ACCEPTED

    def start_mission(self, now_s: float) -> Result:
        """MAV_CMD_MISSION_START: PX4 arms itself; ArduPilot must be armed, and leaves the ground only by it."""
        if not (self._board.is_px4 or self._pilot.armed):
            return self.refuse("mission refused: not armed")
        if self._board.is_px4 and not self._pilot.mission.exists:
            return self.refuse("mission refused: there is none", Result.DENIED)
        result = self.set_mode(Mode.MISSION, now_s)
        if result is Result.ACCEPTED and not self._pilot.armed:
            result = self.arm(True, now_s)
        self._pilot.mission_started = result is Result.ACCEPTED
        return result

    def pause(self, wanted: bool) -> Result:
        """ArduPilot: stop in AUTO or GUIDED, or go on."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        if self._pilot.mode not in (Mode.MISSION, Mode.OFFBOARD):
            return self.refuse("Failed to pause" if wanted else "Failed to resume")
        self._pilot.paused = wanted
        return Result.ACCEPTED

    # --- arming, take-off, landing ------------------------------------------------------------------------------------

    def arm(self, wanted: bool, now_s: float) -> Result:
        """Arm, or disarm on the ground; in the air the motors are never switched off."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        pilot = self._pilot
        if wanted == pilot.armed:
            return Result.ACCEPTED
        if pilot.navigation.in_air:
            return self.refuse("disarming refused: in the air")
        if wanted and pilot.navigation.fix_type < FIX_3D:
            return self.refuse("arming refused: no position")
        if wanted and self._board.is_px4 and pilot.mode is Mode.OFFBOARD and not pilot.steering.has_stream(now_s):
            return self.refuse("arming refused: no offboard signal")
        if wanted and self._board.is_px4 and pilot.mode in _NOT_ARMABLE:
            return self.refuse("arming refused: mode not suitable for takeoff")
        if wanted and not self._board.is_px4 and pilot.mode in (*_NOT_ARMABLE, Mode.MISSION):
            return self.refuse(f"arming refused: {self._board.flavour.name_of(pilot.mode)} mode not armable")
        pilot.arm(wanted)
        if wanted:
            pilot.set_home()
        if wanted and pilot.mode is Mode.TAKEOFF and isinstance(pilot.guidance, Climb):
            pilot.lift_off()
        return Result.ACCEPTED

    def take_off(self, height_m: float | None = None) -> Result:
        """Climb to a height above home; None: by MIS_TAKEOFF_ALT, which only PX4 has.

        PX4 always accepts: unarmed it waits until it is armed; if it is already higher, it reports this and stays.
        ArduPilot takes off from the ground, armed and in GUIDED.
        """
        if (refusal := self._unavailable()) is not None:
            return refusal
        pilot = self._pilot
        under_way = pilot.guidance if pilot.mode in (Mode.TAKEOFF, Mode.OFFBOARD) else None
        if isinstance(under_way, Climb) and height_m in (None, under_way.height_m):
            return Result.ACCEPTED
        return self._take_off_px4(height_m) if self._board.is_px4 else self._take_off_ardupilot(height_m or 0.0)

    def _take_off_px4(self, height_m: float | None) -> Result:
        pilot, stands = self._pilot, not self._pilot.navigation.in_air
        here_m = -pilot.estimate.down_m
        wanted_m = here_m + self._board.parameters["MIS_TAKEOFF_ALT"] if height_m is None else height_m
        climb = Climb(max(wanted_m, here_m), pilot.speeds.takeoff_mps)
        if wanted_m < here_m:
            self._board.say(Severity.CRITICAL, "Already higher than takeoff altitude")
        if wanted_m < here_m and stands:
            pilot.enter(Mode.TAKEOFF, Velocity())
            return Result.ACCEPTED
        if stands and pilot.armed:
            pilot.lift_off()
        pilot.enter(Mode.TAKEOFF, climb)
        return Result.ACCEPTED

    def _take_off_ardupilot(self, height_m: float) -> Result:
        pilot = self._pilot
        if not pilot.armed:
            return self.refuse("take-off refused: not armed")
        if pilot.mode is not Mode.OFFBOARD:
            return self.refuse("take-off refused: not in GUIDED")
        if pilot.navigation.in_air:
            return self.refuse("take-off refused: in the air")
        pilot.lift_off()
        pilot.enter(Mode.OFFBOARD, Climb(height_m, pilot.speeds.takeoff_mps))
        return Result.ACCEPTED

    def land(self) -> Result:
        """Land here."""
        if self._board.spec.cooperative and self._pilot.navigation.state is VehicleState.LANDING:
            return Result.ACCEPTED
        if (refusal := self._unavailable()) is not None:
            return refusal
        self._pilot.come_down()
        return Result.ACCEPTED

    def go_to(self, target_ned_m: Vector, speed_mps: float | None) -> Result:
        """Fly to a point, about the scenario's home, and stay there; on the ground, only the mode changes, but an armed
        PX4 takes off for a point above it.

        Source: Loiter::reposition and FlightTask::_checkTakeoff of PX4, which ask for nothing else.
        """
        if (refusal := self._unavailable()) is not None:
            return refusal
        pilot = self._pilot
        if not pilot.failsafes.has_position:
            return self.refuse("reposition refused: no position")
        is_px4, flies = self._board.is_px4, pilot.navigation.in_air
        pilot.enter(Mode.HOLD if is_px4 else Mode.OFFBOARD, Velocity())
        if flies or (is_px4 and pilot.armed):
            pilot.guidance = pilot.speeds.way_to(target_ned_m, speed_mps)
        return Result.ACCEPTED
