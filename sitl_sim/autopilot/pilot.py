"""What an autopilot is doing, and how that is changed: mode, arming, present manoeuvre, velocity.

It steers by `Navigation` and commands the velocity in the world. It knows no addresses and sends nothing. `orders`
change it from outside, `routine` as time passes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from enum import StrEnum

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.failsafes import Failsafe, Failsafes
from sitl_sim.autopilot.guidance import STILL, Climb, Descend, GoTo, Guidance, Nose, SteeringEstimate, Velocity
from sitl_sim.autopilot.home import Home
from sitl_sim.autopilot.mission_flight import MissionFlight
from sitl_sim.autopilot.modes import Mode
from sitl_sim.autopilot.navigation import Navigation, Vector
from sitl_sim.autopilot.results import Severity
from sitl_sim.autopilot.setpoints import Here, RefusedSetpoint, Setpoint, decode_setpoint, guidance_of
from sitl_sim.autopilot.speeds import Speeds
from sitl_sim.autopilot.steering import OBEYING_S, Steering
from sitl_sim.vehicle import VehicleState
from sitl_sim.world import World

BLIND_MPS = 0.7
"""Descent of PX4 in altitude mode without a pilot (measured)."""

FROM_THE_AIR = (Mode.LAND, Mode.RETURN)
"""Modes that PX4 leaves for the previous one when it is disarmed."""


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
        board: The flight controller; speeds are read from its parameters.
        world: The world.
        navigation: Its navigation solution at the start.
        start: Initial state.

    Attributes:
        navigation, estimate: Its navigation solution, and the position that it steers by.
        mode, armed: As in HEARTBEAT.
        failsafe: Whether a failsafe chose the mode.
        command_ned_mps: The velocity that it flies now.
        yaw_rad: Its heading.
        home: Its home and its local frame.
        steering: Setpoints and stick from outside.
        guidance: The present manoeuvre; None: the world flies it. `paused`: whether it waits, standing still.
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
        self.mission = MissionFlight(board, self.home, self.speeds, self.nose)
        self.failsafes = Failsafes(flavour, parameters, navigation.time_s)
        self.navigation = navigation
        self.armed = start is not Start.GROUND
        self.failsafe = False
        self.command_ned_mps: Vector = STILL
        self.guidance: Guidance | None = Velocity()
        self.mission_started = self.paused = False
        self._now_s = -math.inf
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
        returns = self.mode is Mode.RETURN or (self.mode is Mode.MISSION and self.mission.returns)
        return isinstance(self.guidance, Climb) and not returns

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
        """Target position in its local frame, also during a climb; None while it flies a velocity in any axis."""
        if isinstance(self.guidance, Climb):
            north, east, _ = self.local_position_ned_m
            return north, east, -self.guidance.height_m
        if isinstance(self.guidance, GoTo) and not math.isnan(sum(self.guidance.target_ned_m)):
            return self.home.about_origin(self.guidance.target_ned_m)
        return None

    def is_steered(self, now_s: float) -> bool:
        """Whether it flies fresh setpoints."""
        return (
            self.steering.is_flown
            and self.mode is Mode.OFFBOARD
            and self.navigation.state is VehicleState.AIRBORNE
            and self.steering.has_stream(now_s, OBEYING_S)
        )

    # --- time ---------------------------------------------------------------------------------------------------------

    def look(self, navigation: Navigation, now_s: float) -> float:
        """Take the present navigation solution; returns the time since the last one."""
        dt_s = navigation.time_s - self.navigation.time_s
        self.navigation, self._now_s = navigation, now_s
        self.estimate.update(navigation, dt_s)
        return dt_s

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

    def change_speed(self, kind: float, speed_mps: float) -> None:
        """Execute DO_CHANGE_SPEED, on the present way, too."""
        self.speeds.change(kind, speed_mps)
        self.mission.change_pace()
        if isinstance(self.guidance, GoTo) and not (self._board.is_px4 and self.mode is Mode.OFFBOARD):
            self.guidance = self.speeds.way_to(self.guidance.target_ned_m, None, self.guidance.feed_forward_ned_mps)

    # --- manoeuvres ---------------------------------------------------------------------------------------------------

    def enter(self, mode: Mode, guidance: Guidance | None) -> None:
        """Change the mode unconditionally; without a manoeuvre, the world flies the vehicle.

        Another mode begins with the speeds of the parameters.

        Source: ModeAuto::init of ArduPilot; MissionBase::on_activation, RtlDirect::on_activation of PX4, and in its
        Navigator::run the first reposition in HOLD.
        """
        if mode is not self.mode:
            self.speeds.forget()
        self.mode, self.guidance = mode, guidance
        if mode not in FROM_THE_AIR:
            self._chosen = Mode.HOLD if mode is Mode.TAKEOFF else mode
        self.nose.let_go()
        if guidance is None:
            self.command_ned_mps = STILL
        self.failsafe = self.paused = False
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
        if self.armed and not wanted and self._board.is_px4 and self.mode in FROM_THE_AIR:
            self.enter(self._chosen, Velocity())
        self.armed = wanted

    def fail(self, failsafe: Failsafe) -> None:
        """Do what a failsafe says."""
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

    def set_home(self) -> None:
        """Set home here."""
        estimate = self.estimate
        self.home.set(self.navigation, (estimate.north_m, estimate.east_m, estimate.down_m))
        self.mission.home_moved()

    def lift_off(self) -> None:
        """Leave the ground; it climbs when commanded to."""
        self._world.lift_off(self._index)
        self.navigation = replace(self.navigation, state=VehicleState.AIRBORNE)  # for orders within this tick
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
            self.enter(Mode.RETURN, Climb(height_m, self.speeds.climb_mps) if low else self.way_home())

    def way_home(self) -> GoTo:
        """The way to above home, at this height."""
        return self.home.way(self.estimate, self.speeds)

    def fly(self) -> None:
        """Command the velocity of the present manoeuvre."""
        if self.guidance is None:
            return
        command = STILL if self.paused else self.guidance.command(self.estimate)
        if command != self.command_ned_mps:
            self._world.command_velocity(self._index, command)
            self.command_ned_mps = command
