"""What an autopilot does by itself, tick by tick: failsafes, the mission, the ends of manoeuvres, disarming.

Time-outs are those of the real autopilots with their default parameters:

- PX4 leaves OFFBOARD after COM_OF_LOSS_T of silence, and takes it up again by itself when the stream returns.
- ArduPilot keeps the last velocity for GUID_TIMEOUT, then brakes and stays in GUIDED. In modes for a pilot it sinks
  unless the throttle stick is held in the middle.
"""

from __future__ import annotations

from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.guidance import Accelerate, Climb, Descend, GoTo, Velocity
from sitl_sim.autopilot.mission_flight import End
from sitl_sim.autopilot.modes import Mode
from sitl_sim.autopilot.navigation import Navigation
from sitl_sim.autopilot.pilot import FROM_THE_AIR, Pilot
from sitl_sim.autopilot.results import Severity
from sitl_sim.autopilot.standing import Standing
from sitl_sim.vehicle import VehicleState
from sitl_sim.world import World

HOME_REACHED_M = 1.0

LIFT_OFF_MPS = 0.1
"""A vehicle that stands armed in OFFBOARD or HOLD leaves the ground if it is commanded to climb faster than this."""

_STICK_MODES = (Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.HOLD)
"""ArduPilot's modes that read the throttle stick; HOLD is LOITER there."""


class Routine:
    """The routine of one vehicle.

    Args:
        board: The flight controller; time-outs are read from its parameters.
        world: The world, which lands vehicles that have arrived, and flies those that avoid nobody.
        pilot: The pilot that executes what follows.
    """

    def __init__(self, board: Board, world: World, pilot: Pilot) -> None:
        self._board, self._world, self._pilot = board, world, pilot
        self._standing = Standing(board)
        self._sets_out = False
        self._was_in_air = pilot.navigation.in_air

    def begin_mission(self) -> None:
        """For a vehicle that avoids nobody: fly to the goal now, or as soon as it has climbed."""
        self._sets_out = True

    def update(self, navigation: Navigation, now_s: float) -> None:
        """Advance time: failsafes, the present manoeuvre, the velocity to command."""
        pilot, cooperative = self._pilot, self._board.spec.cooperative
        dt_s = pilot.look(navigation, now_s)
        self._follow_world()
        self._watch_standing(now_s)
        failsafe = pilot.failsafes.watch(navigation, pilot.mode, now_s)
        if not cooperative:
            self._fly_own_mission()
        elif failsafe is not None and navigation.state is VehicleState.AIRBORNE:
            pilot.fail(failsafe)
        elif pilot.mode is Mode.OFFBOARD:
            self._watch_stream(now_s)
        elif pilot.mode is Mode.MISSION and not pilot.paused:
            self._fly_mission(now_s)
        elif not self._board.is_px4 and pilot.mode in _STICK_MODES and navigation.in_air:
            pilot.guidance = pilot.steering.by_stick(now_s)
        pilot.mission.is_flown, pilot.mission.is_paused = pilot.mode is Mode.MISSION and cooperative, pilot.paused
        self._advance_manoeuvre()
        pilot.fly()
        if self._leaves_the_ground():
            pilot.lift_off()
            pilot.fly()
        if navigation.in_air:
            pilot.nose.follow(pilot.command_ned_mps)
        pilot.nose.update(dt_s)

    def _fly_own_mission(self) -> None:
        pilot, index = self._pilot, self._board.system_id - 1
        state = pilot.navigation.state
        if state is VehicleState.GROUNDED and not self._world.arrived[index] and pilot.armed:
            pilot.lift_off()
            pilot.guidance = Climb(-self._board.spec.start_ned_m[2], pilot.speeds.climb_mps)
        elif state is VehicleState.AIRBORNE and self._sets_out and isinstance(pilot.guidance, Velocity):
            self._world.fly_straight(index)
            pilot.guidance = None

    def _follow_world(self) -> None:
        """Follow changes by the world: the vehicle touched the ground, or lands because it has arrived."""
        pilot = self._pilot
        state, in_air = pilot.navigation.state, pilot.navigation.in_air
        if state is VehicleState.LANDING and pilot.mode is not Mode.LAND:
            pilot.enter(Mode.LAND, None)
        if self._was_in_air and not in_air:
            pilot.guidance = Velocity()
            comes_down = pilot.mode in (*FROM_THE_AIR, Mode.MISSION)
            alone = not self._board.spec.cooperative  # armed, it would set out again
            if alone or (comes_down and not self._board.is_px4):
                pilot.arm(False)
            if comes_down:
                pilot.mission.landed()
        self._was_in_air = in_air

    def _watch_standing(self, now_s: float) -> None:
        """Disarm a vehicle that has stood armed for long. An unfinished mission prevents it on PX4, a throttle stick
        held in the middle on ArduPilot."""
        pilot, px4 = self._pilot, self._board.is_px4
        in_mission = pilot.mode is Mode.MISSION and not pilot.mission.is_complete
        is_over = self._standing.is_over(
            armed=pilot.armed,
            in_air=pilot.navigation.in_air,
            is_kept=in_mission if px4 else pilot.steering.is_throttle_held(now_s),
            time_s=pilot.navigation.time_s,
        )
        if is_over and self._board.spec.cooperative:
            if px4:
                self._board.say(Severity.INFO, self._standing.px4_words)
            pilot.arm(False)

    def _fly_mission(self, now_s: float) -> None:
        pilot = self._pilot
        grounded = pilot.navigation.state is VehicleState.GROUNDED
        if grounded and not (pilot.armed and (self._board.is_px4 or pilot.mission_started)):
            return
        match pilot.mission.step(pilot.estimate, now_s, grounded=grounded):
            case End.RETURN:
                pilot.fly_home()
            case End.FINISHED if self._board.is_px4:
                self._board.say(Severity.INFO, f"Mission finished, {'landed' if grounded else 'loitering'}")
                pilot.enter(Mode.HOLD, Velocity())
            case End.FINISHED:
                pilot.guidance = Velocity()
            case guidance:
                if grounded and isinstance(guidance, Climb):
                    pilot.lift_off()
                pilot.guidance = guidance

    def _watch_stream(self, now_s: float) -> None:
        pilot = self._pilot
        if not pilot.steering.is_flown:
            return
        if self._board.is_px4:
            if not pilot.steering.has_stream(now_s):
                pilot.fail(pilot.failsafes.setpoints_lost())
            return
        flies_on = isinstance(pilot.guidance, Velocity | Accelerate)
        if flies_on and not pilot.steering.has_stream(now_s, self._board.parameters["GUID_TIMEOUT"]):
            pilot.guidance = Velocity()
            pilot.steering.is_flown = False
            pilot.nose.let_go()

    def _advance_manoeuvre(self) -> None:
        pilot, guidance = self._pilot, self._pilot.guidance
        if isinstance(guidance, Climb) and guidance.is_done(pilot.estimate):
            if pilot.mode is Mode.RETURN:
                pilot.guidance = pilot.way_home()
            elif not pilot.mission.is_flown:
                pilot.guidance = Velocity()
            if pilot.mode is Mode.TAKEOFF:
                pilot.mode = Mode.HOLD
        elif (
            pilot.mode is Mode.RETURN
            and isinstance(guidance, GoTo)
            and guidance.distance_m(pilot.estimate) < HOME_REACHED_M
        ):
            pilot.guidance = Descend(guidance.target_ned_m[:2])

    def _leaves_the_ground(self) -> bool:
        """Whether it is on the ground and is commanded upwards, which is enough for PX4 in OFFBOARD and HOLD."""
        pilot = self._pilot
        stands = pilot.armed and pilot.navigation.state is VehicleState.GROUNDED
        climbs = -pilot.command_ned_mps[2] > LIFT_OFF_MPS
        return stands and self._board.is_px4 and pilot.mode in (Mode.OFFBOARD, Mode.HOLD) and climbs
