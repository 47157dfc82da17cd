"""The decisions of the autopilot: mode, arming, present manoeuvre.

It steers by `Navigation` and commands the velocity in the world. It knows no addresses and sends nothing. Time-outs are
those of the real autopilots with their default parameters:

- PX4 refuses OFFBOARD in the air without a fresh stream of setpoints, leaves it after COM_OF_LOSS_T of silence, and
  takes it up again by itself when the stream returns. On the ground it accepts OFFBOARD and then refuses to arm.
- ArduPilot keeps the last velocity for GUID_TIMEOUT, then brakes and stays in GUIDED. In modes for a pilot it sinks
  unless the throttle stick is held in the middle.
"""

from __future__ import annotations

import math
from enum import StrEnum

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.failsafes import Failsafe, Failsafes
from sitl_sim.autopilot.failures import failure_event
from sitl_sim.autopilot.guidance import (
    STILL,
    Accelerate,
    Climb,
    Descend,
    GoTo,
    Guidance,
    Nose,
    SteeringEstimate,
    Velocity,
)
from sitl_sim.autopilot.home import Home
from sitl_sim.autopilot.mission_flight import End, MissionFlight
from sitl_sim.autopilot.modes import Mode
from sitl_sim.autopilot.navigation import Navigation, Vector
from sitl_sim.autopilot.results import Severity
from sitl_sim.autopilot.setpoints import Here, RefusedSetpoint, Setpoint, decode_setpoint, guidance_of
from sitl_sim.autopilot.speeds import Speeds
from sitl_sim.autopilot.standing import Standing
from sitl_sim.autopilot.steering import OBEYING_S, Steering
from sitl_sim.vehicle import VehicleState
from sitl_sim.world import World

HOME_REACHED_M = 1.0

LIFT_OFF_MPS = 0.1
"""A vehicle that stands armed in OFFBOARD leaves the ground if it is commanded to climb faster than this."""

BLIND_MPS = 0.7
"""Descent of PX4 in altitude mode without a pilot (measured)."""

_NEVER_ARMED = (Mode.LAND, Mode.RETURN)
"""Modes that PX4 leaves for the previous one when it is disarmed."""

_STICK_MODES = (Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.HOLD)
"""ArduPilot's modes that read the throttle stick; HOLD is LOITER there."""


class Start(StrEnum):
    """Initial state of a fleet."""

    GROUND = "ground"
    """Unarmed, below the start."""
    AIRBORNE = "airborne"
    """Hovering at the start, armed, and already obeying setpoints."""
    HOLDING = "holding"
    """Hovering at the start, armed, until the mode is changed."""


class Pilot:
    """The flight logic of one vehicle.

    Args:
        board: The flight controller; time-outs and speeds are read from its parameters.
        world: The world.
        navigation: Its navigation solution at the start.
        start: Initial state.

    Attributes:
        mode, armed: As in HEARTBEAT.
        failsafe: Whether a failsafe chose the mode.
        command_ned_mps: The velocity that it flies now.
        yaw_rad: Its heading.
        home: Its home and its local frame.
        steering: Setpoints and stick from outside.
        guidance: The present manoeuvre; None: the world flies it.
        mission: Its mission; `mission_started`: whether MAV_CMD_MISSION_START has let ArduPilot leave the ground.
        speeds, nose: Its speeds and its heading.
        failsafes: Its failsafes.
    """

    def __init__(self, board: Board, world: World, navigation: Navigation, start: Start) -> None:
        spec, flavour, parameters = board.spec, board.flavour, board.parameters
        self._board, self._world, self._index = board, world, board.system_id - 1
        self.home = Home(board, navigation, 0.0 if start is Start.GROUND else spec.start_ned_m[2])
        self.steering = Steering(board)
        self.estimate = SteeringEstimate(self.home.origin_ned_m if start is Start.GROUND else spec.start_ned_m)
        self.nose = Nose(follows=not flavour.is_px4)
        self.speeds = Speeds(flavour, parameters)
        self.mission = MissionFlight(board, self.speeds, self.nose)
        self.failsafes = Failsafes(flavour, parameters, navigation.time_s)
        self._standing = Standing(board)
        self.navigation = navigation
        self.armed = start is not Start.GROUND
        self.failsafe = False
        self.command_ned_mps: Vector = STILL
        self.guidance: Guidance | None = Velocity()
        self._sets_out = self.mission_started = False
        self._time_s, self._now_s = navigation.time_s, -math.inf
        self._was_in_air = navigation.in_air
        if not spec.cooperative:
            self.mode = Mode.MISSION
            self.armed = True
        elif start is Start.AIRBORNE:
            self.mode = Mode.OFFBOARD
        elif start is Start.HOLDING:  # ArduPilot's LOITER needs a pilot
            self.mode = Mode.HOLD if flavour.is_px4 else Mode.BRAKE
        else:
            self.mode = flavour.ground_mode
        self._chosen = self.mode

    # --- questions ----------------------------------------------------------------------------------------------------

    @property
    def yaw_rad(self) -> float:
        """Heading, clockwise from north."""
        return self.nose.yaw_rad

    @property
    def is_climbing_out(self) -> bool:
        """Whether it climbs after a take-off."""
        return isinstance(self.guidance, Climb) and self.mode is not Mode.RETURN

    @property
    def is_landing(self) -> bool:
        """Whether it descends to land."""
        return self.navigation.state is VehicleState.LANDING or isinstance(self.guidance, Descend)

    @property
    def local_position_ned_m(self) -> Vector:
        """Estimated position in its local frame, as in LOCAL_POSITION_NED."""
        return self.home.local(self.navigation)

    @property
    def position_target_ned_m(self) -> Vector | None:
        """Target position in its local frame, also during a climb; None while it flies a velocity."""
        if isinstance(self.guidance, Climb):
            north, east, _ = self.local_position_ned_m
            return north, east, -self.guidance.height_m
        return self.home.about_origin(self.guidance.target_ned_m) if isinstance(self.guidance, GoTo) else None

    def is_steered(self, now_s: float) -> bool:
        """Whether it flies fresh setpoints."""
        return (
            self.steering.is_flown
            and self.mode is Mode.OFFBOARD
            and self.navigation.state is VehicleState.AIRBORNE
            and self.steering.has_stream(now_s, OBEYING_S)
        )

    # --- time ---------------------------------------------------------------------------------------------------------

    def update(self, navigation: Navigation, now_s: float) -> None:
        """Advance time: failsafes, the present manoeuvre, the velocity to command."""
        dt_s = navigation.time_s - self._time_s
        self._time_s, self._now_s, self.navigation = navigation.time_s, now_s, navigation
        self.estimate.update(navigation, dt_s)
        self._follow_world()
        self._watch_standing()
        failsafe = self.failsafes.watch(navigation, self.mode, now_s)
        if not self._board.spec.cooperative:
            self._fly_own_mission()
        elif failsafe is not None and navigation.state is VehicleState.AIRBORNE:
            self._fail(failsafe)
        elif self.mode is Mode.OFFBOARD:
            self._watch_stream(now_s)
        elif self.mode is Mode.MISSION:
            self._fly_mission(now_s)
        elif not self._board.is_px4 and self.mode in _STICK_MODES and navigation.in_air:
            self.guidance = self.steering.by_stick(now_s)
        self.mission.is_flown = self.mode is Mode.MISSION and self._board.spec.cooperative
        self._advance_manoeuvre()
        self._command()
        if self._leaves_the_ground():
            self.lift_off()
            self._command()
        if navigation.in_air:
            self.nose.follow(self.command_ned_mps)
        self.nose.update(dt_s)

    def begin_mission(self) -> None:
        """For a vehicle that avoids nobody: fly to the goal now, or as soon as it has climbed."""
        self._sets_out = True

    def _fly_own_mission(self) -> None:
        state = self.navigation.state
        if state is VehicleState.GROUNDED and not self._world.arrived[self._index] and self.armed:
            self.lift_off()
            self.guidance = Climb(-self._board.spec.start_ned_m[2], self.speeds.climb_mps)
        elif state is VehicleState.AIRBORNE and self._sets_out and isinstance(self.guidance, Velocity):
            self._world.fly_straight(self._index)
            self.guidance = None

    def fail(self, unit: int, kind: int) -> bool:
        """Inject a failure into this vehicle (FAILURE_UNIT, FAILURE_TYPE); returns whether that is possible."""
        event = failure_event(unit, kind, self._index + 1)
        if event is not None:
            self._world.inject(event)
        return event is not None

    def _follow_world(self) -> None:
        """Follow changes by the world: the vehicle touched the ground, or lands because it has arrived."""
        state, in_air = self.navigation.state, self.navigation.in_air
        if state is VehicleState.LANDING and self.mode is not Mode.LAND:
            self.enter(Mode.LAND, None)
        if self._was_in_air and not in_air:
            self.guidance = Velocity()
            if self.mode is Mode.MISSION or (self.mode in _NEVER_ARMED and not self._board.is_px4):
                self.arm(False)
            if self.mode in (*_NEVER_ARMED, Mode.MISSION):
                self.mission.landed()
        self._was_in_air = in_air

    def _watch_standing(self) -> None:
        """Disarm a vehicle that has stood armed for long. An unfinished mission prevents it on PX4, a throttle stick
        held in the middle on ArduPilot."""
        px4 = self._board.is_px4
        in_mission = self.mode is Mode.MISSION and not self.mission.is_complete
        is_over = self._standing.is_over(
            armed=self.armed,
            in_air=self.navigation.in_air,
            is_kept=in_mission if px4 else self.steering.is_throttle_held(self._now_s),
            time_s=self._time_s,
        )
        if is_over and self._board.spec.cooperative:
            if px4:
                self._board.say(Severity.INFO, self._standing.px4_words)
            self.arm(False)

    def _fly_mission(self, now_s: float) -> None:
        grounded = self.navigation.state is VehicleState.GROUNDED
        if grounded and not (self.armed and (self._board.is_px4 or self.mission_started)):
            if not self.armed and self._board.is_px4 and self.mission.is_complete:
                self.mode = self._board.flavour.ground_mode
            return
        match self.mission.step(self.estimate, now_s, grounded=grounded):
            case End.RETURN:
                self.fly_home()
            case End.FINISHED if self._board.is_px4:
                self._board.say(Severity.INFO, "Mission finished, loitering")
                self.enter(Mode.HOLD, Velocity())
            case End.FINISHED:
                self.guidance = Velocity()
            case guidance:
                if grounded and isinstance(guidance, Climb):
                    self.lift_off()
                self.guidance = guidance

    def _fail(self, failsafe: Failsafe) -> None:
        self._board.say(Severity.CRITICAL, failsafe.text)
        chosen = self._chosen
        match failsafe.mode:
            case Mode.RETURN:
                self.fly_home()
            case Mode.LAND:
                self.enter(Mode.LAND, Descend())
            case Mode.ALTITUDE:
                self.enter(Mode.ALTITUDE, Velocity((0.0, 0.0, BLIND_MPS)))
            case mode:
                self.enter(mode, Velocity())
        self.failsafe, self.steering.resumes, self._chosen = True, failsafe.resumes, chosen

    def _watch_stream(self, now_s: float) -> None:
        if not self.steering.is_flown:
            return
        if self._board.is_px4:
            if not self.steering.has_stream(now_s):
                self._fail(self.failsafes.setpoints_lost())
            return
        flies_on = isinstance(self.guidance, Velocity | Accelerate)
        if flies_on and not self.steering.has_stream(now_s, self._board.parameters["GUID_TIMEOUT"]):
            self.guidance = Velocity()
            self.steering.is_flown = False
            self.nose.let_go()

    def _advance_manoeuvre(self) -> None:
        guidance = self.guidance
        if isinstance(guidance, Climb) and guidance.is_done(self.estimate):
            if self.mode is Mode.RETURN:
                self.guidance = self._way_home()
            elif not self.mission.is_flown:
                self.guidance = Velocity()
            if self.mode is Mode.TAKEOFF:
                self.mode = Mode.HOLD
        elif (
            self.mode is Mode.RETURN
            and isinstance(guidance, GoTo)
            and guidance.distance_m(self.estimate) < HOME_REACHED_M
        ):
            self.guidance = Descend(guidance.target_ned_m[:2])

    def _leaves_the_ground(self) -> bool:
        """Whether it is on the ground and is commanded upwards, which is enough for PX4 in OFFBOARD."""
        stands = self.armed and self.navigation.state is VehicleState.GROUNDED
        return stands and self._board.is_px4 and self.mode is Mode.OFFBOARD and -self.command_ned_mps[2] > LIFT_OFF_MPS

    # --- setpoints ----------------------------------------------------------------------------------------------------

    def take_setpoint(self, message: Message, now_s: float) -> None:
        """Fly a SET_POSITION_TARGET; outside of OFFBOARD and GUIDED it is silently dropped.

        PX4 ignores a setpoint that it cannot take, and then misses its stream; ArduPilot stops.
        """
        try:
            here = Here(self.local_position_ned_m, self.yaw_rad, self._board.own_origin, self._board.is_px4)
            setpoint = decode_setpoint(message, here)
        except RefusedSetpoint as refusal:
            if self.mode is Mode.OFFBOARD:
                self._board.say(Severity.CRITICAL if self._board.is_px4 else Severity.WARNING, str(refusal))
                if not self._board.is_px4 and self.navigation.in_air:
                    self.guidance = Velocity()
            return
        self._now_s = max(self._now_s, now_s)
        self.steering.take(setpoint, now_s)
        if self.steering.resumes:
            self.enter(Mode.OFFBOARD, self.guidance)
        if self.mode is Mode.OFFBOARD:
            self._obey(setpoint)

    def _obey(self, setpoint: Setpoint) -> None:
        if not (self._board.is_px4 or self.navigation.in_air):
            return  # ArduPilot takes off by command only
        self.steering.is_flown = True
        origin = self.home.origin_ned_m
        self.guidance = guidance_of(setpoint, self.speeds, origin, self.command_ned_mps, self._board.is_px4)
        if setpoint.yaw_rad is not None:
            self.nose.turn_to(setpoint.yaw_rad)
        elif setpoint.yaw_rate_radps is not None:
            self.nose.turn_at(setpoint.yaw_rate_radps)
        else:
            self.nose.let_go()

    # --- manoeuvres ---------------------------------------------------------------------------------------------------

    def enter(self, mode: Mode, guidance: Guidance | None) -> None:
        """Change the mode unconditionally; without a manoeuvre, the world flies the vehicle."""
        self.mode, self.guidance = mode, guidance
        if mode not in _NEVER_ARMED:
            self._chosen = Mode.HOLD if mode is Mode.TAKEOFF else mode
        self.nose.let_go()
        if guidance is None:
            self.command_ned_mps = STILL
        self.failsafe = False
        self.steering.let_go()

    def enter_offboard(self) -> None:
        """Obey setpoints, at once if there is a fresh one."""
        self.enter(Mode.OFFBOARD, Velocity())
        setpoint = self.steering.setpoint
        if self._board.is_px4 and setpoint is not None and self.steering.has_stream(self._now_s):
            self._obey(setpoint)

    def arm(self, wanted: bool) -> None:
        """Switch the motors on or off, without checks. ArduPilot reports it; PX4, disarmed after a landing, returns to
        the mode that was chosen before."""
        if wanted != self.armed and not self._board.is_px4:
            self._board.say(Severity.INFO, "Arming motors" if wanted else "Disarming motors")
        if self.armed and not wanted and self._board.is_px4 and self.mode in _NEVER_ARMED:
            self.enter(self._chosen, Velocity())
        self.armed = wanted

    def set_home(self) -> None:
        """Set home here."""
        estimate = self.estimate
        self.home.set(self.navigation, (estimate.north_m, estimate.east_m, estimate.down_m))
        self.mission.home_moved()

    def lift_off(self) -> None:
        """Leave the ground; it climbs when commanded to."""
        self._world.lift_off(self._index)
        self.command_ned_mps = STILL  # the world drops earlier commands

    def come_down(self) -> None:
        """Land here; on the ground, disarm."""
        if not self.navigation.in_air:
            self._stand_down(Mode.LAND)
        elif self.mode is not Mode.LAND:
            self.enter(Mode.LAND, Descend())

    def _stand_down(self, mode: Mode) -> None:
        """Handle an order to land while it is on the ground."""
        self.enter(mode, Velocity())
        self.arm(False)

    def fly_home(self) -> None:
        """Climb to the return height, fly home, land; on the ground, disarm."""
        if not self.navigation.in_air:
            self._stand_down(Mode.RETURN)
        elif self.mode is not Mode.RETURN:
            height_m = self.speeds.return_height_m
            low = -self.estimate.down_m < height_m
            self.enter(Mode.RETURN, Climb(height_m, self.speeds.climb_mps) if low else self._way_home())

    def _way_home(self) -> GoTo:
        north, east, _ = self.home.place_ned_m
        return self.speeds.way_to((north, east, self.estimate.down_m))

    def _command(self) -> None:
        if self.guidance is None:
            return
        command = self.guidance.command(self.estimate)
        if command != self.command_ned_mps:
            self._world.command_velocity(self._index, command)
            self.command_ned_mps = command
