"""What the autopilot decides: mode, arming, what it flies now, and what it does when nobody speaks to it any more.

It steers by `Navigation` and commands the world's velocity; it knows no addresses and sends nothing. Time-outs are
those of the real autopilots with their default parameters:

- PX4 refuses OFFBOARD without a fresh stream of setpoints, leaves it after COM_OF_LOSS_T of silence, and takes it up
  again by itself when the stream returns. What it falls into is a matter of its set-up; without a pilot a stock PX4
  returns home, here it holds.
- ArduPilot keeps the last velocity for GUID_TIMEOUT, then brakes and stays in GUIDED.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum, StrEnum

from ridlink.mavlink.codec import Message
from ridlink.scenario import VehicleSpec
from sitl_sim.autopilot.guidance import (
    STILL,
    Climb,
    Descend,
    GoTo,
    Guidance,
    Nose,
    SteeringEstimate,
    Velocity,
)
from sitl_sim.autopilot.modes import Flavour, Mode
from sitl_sim.autopilot.navigation import Navigation, Vector
from sitl_sim.autopilot.parameters import Parameters
from sitl_sim.autopilot.setpoints import RefusedSetpoint, Setpoint, decode_setpoint
from sitl_sim.world import VehicleState, World

HOME_REACHED_M = 1.0

OBEYING_S = 1.0
"""A setpoint as old as this no longer counts as being steered from outside."""

LIFT_OFF_MPS = 0.1
"""A vehicle that stands armed in OFFBOARD leaves the ground when asked to climb faster than this."""


class Start(StrEnum):
    """How a fleet begins."""

    GROUND = "ground"
    """Unarmed, below the start."""
    AIRBORNE = "airborne"
    """Hovering at the start, armed, and already obeying setpoints."""
    HOLDING = "holding"
    """Hovering at the start, armed, until somebody changes the mode."""


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Severity(IntEnum):
    """MAV_SEVERITY."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


Say = Callable[[Severity, str], None]


class Pilot:
    """The flight logic of one vehicle.

    Args:
        world: Where it flies.
        index: Its row there.
        spec: Its part of the scenario.
        flavour: Whose habits it has.
        parameters: Its parameters; time-outs and speeds are read from them.
        navigation: Its navigation solution at the start.
        start: How it begins.
        say: Called with what STATUSTEXT is to carry.

    Attributes:
        mode, armed: As HEARTBEAT tells them.
        failsafe: Whether a failsafe chose the mode.
        command_ned_mps: The velocity that it flies now.
        yaw_rad: Its heading.
        origin_ned_m: Its home and the origin of its local frame: the ground below its start.
    """

    def __init__(
        self,
        world: World,
        index: int,
        spec: VehicleSpec,
        flavour: Flavour,
        parameters: Parameters,
        navigation: Navigation,
        start: Start,
        say: Say,
    ) -> None:
        self._world, self._index, self._spec = world, index, spec
        self._flavour, self._parameters, self._say = flavour, parameters, say
        self.origin_ned_m: Vector = (spec.start_ned_m[0], spec.start_ned_m[1], 0.0)
        self.estimate = SteeringEstimate(self.origin_ned_m if start is Start.GROUND else spec.start_ned_m)
        self.nose = Nose()
        self.navigation = navigation
        self.armed = start is not Start.GROUND
        self.failsafe = False
        self.command_ned_mps: Vector = STILL
        self.commanded_cruise_mps: float | None = None
        self._guidance: Guidance | None = Velocity()
        self._setpoint: Setpoint | None = None
        self._setpoint_at_s: float | None = None
        self._steered = False
        self._resume = False
        self._mission_begun = False
        self._nose_follows = not flavour.is_px4
        self._time_s = navigation.time_s
        self._was_in_air = navigation.in_air
        if not spec.cooperative:
            self.mode = Mode.MISSION
            self.armed = True
        elif start is Start.AIRBORNE:
            self.mode = Mode.OFFBOARD
        elif start is Start.HOLDING:
            self.mode = Mode.HOLD
        else:
            self.mode = flavour.ground_mode

    # --- questions ----------------------------------------------------------------------------------------------------

    @property
    def yaw_rad(self) -> float:
        """Heading, clockwise from north."""
        return self.nose.yaw_rad

    @property
    def is_climbing_out(self) -> bool:
        """Whether it is on its way up from the ground."""
        return isinstance(self._guidance, Climb)

    @property
    def is_landing(self) -> bool:
        """Whether it is on its way down to the ground."""
        return self.navigation.state is VehicleState.LANDING or isinstance(self._guidance, Descend)

    @property
    def local_position_ned_m(self) -> Vector:
        """Where it believes to be about its own home, as LOCAL_POSITION_NED tells it."""
        position, origin = self.navigation.position_ned_m, self.origin_ned_m
        return position[0] - origin[0], position[1] - origin[1], position[2] - origin[2]

    @property
    def position_target_ned_m(self) -> Vector | None:
        """Where it is going, about its own home; None while it flies a velocity."""
        if not isinstance(self._guidance, GoTo):
            return None
        target, origin = self._guidance.target_ned_m, self.origin_ned_m
        return target[0] - origin[0], target[1] - origin[1], target[2] - origin[2]

    def is_steered(self, now_s: float) -> bool:
        """Whether it flies what fresh setpoints ask for."""
        return (
            self._steered
            and self.mode is Mode.OFFBOARD
            and self.navigation.state is VehicleState.AIRBORNE
            and self._has_stream(now_s, OBEYING_S)
        )

    def _has_stream(self, now_s: float, within_s: float) -> bool:
        return self._setpoint_at_s is not None and now_s - self._setpoint_at_s <= within_s

    # --- time ---------------------------------------------------------------------------------------------------------

    def update(self, navigation: Navigation, now_s: float) -> None:
        """Let time pass: failsafes, the current manoeuvre, the velocity to command."""
        dt_s = navigation.time_s - self._time_s
        self._time_s, self.navigation = navigation.time_s, navigation
        self.estimate.update(navigation, dt_s)
        self._follow_world()
        if not self._spec.cooperative:
            self._fly_own_mission()
        elif self.mode is Mode.OFFBOARD:
            self._watch_stream(now_s)
        self._advance_manoeuvre()
        self._command()
        if self._nose_follows and navigation.in_air:
            self.nose.follow(self.command_ned_mps)
        self.nose.update(dt_s)

    def begin_mission(self) -> None:
        """For a vehicle that avoids nobody: fly to the goal now, or as soon as it is up there."""
        self._mission_begun = True

    def _fly_own_mission(self) -> None:
        state = self.navigation.state
        if state is VehicleState.GROUNDED and not self._world.arrived[self._index] and self.armed:
            self._lift_off()
            self._guidance = Climb(-self._spec.start_ned_m[2], self._climb_mps)
        elif state is VehicleState.AIRBORNE and self._mission_begun and isinstance(self._guidance, Velocity):
            self._world.fly_straight(self._index)
            self._guidance = None

    def _follow_world(self) -> None:
        """Notice what happened to the vehicle: touched the ground, or told to land because it has arrived."""
        state, in_air = self.navigation.state, self.navigation.in_air
        if state is VehicleState.LANDING and self.mode is not Mode.LAND:
            self._enter(Mode.LAND, None)
        if self._was_in_air and not in_air:
            self._guidance = Velocity()
            if self.mode in (Mode.LAND, Mode.RETURN, Mode.MISSION):
                self.armed = False
        self._was_in_air = in_air

    def _watch_stream(self, now_s: float) -> None:
        if not self._steered:
            return
        if self._flavour.is_px4:
            if not self._has_stream(now_s, self._parameters["COM_OF_LOSS_T"]):
                self._enter(Mode.HOLD, Velocity())
                self.failsafe = self._resume = True
                self._say(Severity.CRITICAL, "Offboard signal lost, holding")
        elif isinstance(self._guidance, Velocity) and not self._has_stream(now_s, self._parameters["GUID_TIMEOUT"]):
            self._guidance = Velocity()
            self._steered = False

    def _advance_manoeuvre(self) -> None:
        guidance = self._guidance
        if isinstance(guidance, Climb) and guidance.is_done(self.estimate):
            self._guidance = Velocity()
            if self.mode is Mode.TAKEOFF:
                self.mode = Mode.HOLD
        elif self.mode is Mode.RETURN and isinstance(guidance, GoTo):
            if guidance.distance_m(self.estimate) < HOME_REACHED_M:
                self._guidance = Descend(guidance.target_ned_m[:2])
        elif isinstance(guidance, Velocity) and self.navigation.state is VehicleState.GROUNDED:
            asks_to_climb = -guidance.velocity_ned_mps[2] > LIFT_OFF_MPS
            if self._flavour.is_px4 and self.armed and self.mode is Mode.OFFBOARD and asks_to_climb:
                self._lift_off()

    def _command(self) -> None:
        if self._guidance is None:
            return
        command = self._guidance.command(self.estimate)
        if command != self.command_ned_mps:
            self._world.command_velocity(self._index, command)
            self.command_ned_mps = command

    # --- setpoints ----------------------------------------------------------------------------------------------------

    def take_setpoint(self, message: Message, now_s: float) -> None:
        """Fly a SET_POSITION_TARGET_LOCAL_NED; outside of OFFBOARD and GUIDED it is dropped without a word."""
        try:
            setpoint = decode_setpoint(message, self.local_position_ned_m, self.yaw_rad)
        except RefusedSetpoint as refusal:
            if self.mode is Mode.OFFBOARD:
                self._say(Severity.CRITICAL if self._flavour.is_px4 else Severity.WARNING, str(refusal))
            return
        self._setpoint, self._setpoint_at_s = setpoint, now_s
        if self._resume:
            self._enter(Mode.OFFBOARD, self._guidance)
        if self.mode is Mode.OFFBOARD:
            self._obey(setpoint)

    def _obey(self, setpoint: Setpoint) -> None:
        if not (self._flavour.is_px4 or self.navigation.in_air):
            return  # ArduPilot takes off by command only
        self._steered = True
        velocity, position = setpoint.velocity_ned_mps, setpoint.position_ned_m
        if position is not None:
            origin = self.origin_ned_m
            target = (position[0] + origin[0], position[1] + origin[1], position[2] + origin[2])
            self._guidance = GoTo(target, self._fast_mps, self._climb_mps, self._descent_mps, velocity or STILL)
        else:
            self._guidance = Velocity(velocity or STILL)
        self._nose_follows = False
        if setpoint.yaw_rad is not None:
            self.nose.turn_to(setpoint.yaw_rad)
        elif setpoint.yaw_rate_radps is not None:
            self.nose.turn_at(setpoint.yaw_rate_radps)
        else:
            self._nose_follows = not self._flavour.is_px4

    # --- what commands ask for ----------------------------------------------------------------------------------------

    def set_mode(self, mode: Mode, now_s: float) -> Result:
        """Change the mode."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        match mode:
            case Mode.OFFBOARD:
                return self._enter_offboard(now_s)
            case Mode.TAKEOFF:
                return self.take_off(self._parameters["MIS_TAKEOFF_ALT"])
            case Mode.LAND:
                return self.land()
            case Mode.RETURN:
                return self._return_home()
            case Mode.MISSION:
                self._say(Severity.WARNING, "no mission")
                return Result.DENIED
        # asked to hold again, it goes on to where it was sent
        self._enter(mode, self._guidance if self.mode is mode and mode is Mode.HOLD else Velocity())
        return Result.ACCEPTED

    def _enter_offboard(self, now_s: float) -> Result:
        if self.mode is Mode.OFFBOARD:
            return Result.ACCEPTED
        if self._flavour.is_px4:
            if self._setpoint is None or not self._has_stream(now_s, self._parameters["COM_OF_LOSS_T"]):
                self._say(Severity.WARNING, "offboard refused: no setpoints")
                return Result(self._flavour.refused)
            self._enter(Mode.OFFBOARD, Velocity())
            self._obey(self._setpoint)
        else:
            self._enter(Mode.OFFBOARD, Velocity())
        return Result.ACCEPTED

    def arm(self, wanted: bool) -> Result:
        """Arm, or disarm on the ground; in the air the motors are not switched off, whoever asks."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        if wanted == self.armed:
            return Result.ACCEPTED
        if self.navigation.in_air:
            return self._refuse("disarming refused: in the air")
        self.armed = wanted
        if wanted and self.mode in (Mode.LAND, Mode.RETURN):
            self.mode = self._flavour.ground_mode
        return Result.ACCEPTED

    def take_off(self, height_m: float) -> Result:
        """Climb to a height above home."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        if not self.armed:
            return self._refuse("take-off refused: not armed")
        if not self._flavour.is_px4 and self.mode is not Mode.OFFBOARD:
            return self._refuse("take-off refused: not in GUIDED")
        if self.navigation.state is VehicleState.GROUNDED:
            self._lift_off()
        if not (isinstance(self._guidance, Climb) and self._guidance.height_m == height_m):
            climb = Climb(height_m, self._takeoff_mps)
            self._enter(Mode.TAKEOFF if self._flavour.is_px4 else Mode.OFFBOARD, climb)
        return Result.ACCEPTED

    def land(self) -> Result:
        """Come down here."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        if not self.navigation.in_air:
            self._enter(Mode.LAND, Velocity())
            self.armed = False
        elif self.mode is not Mode.LAND:
            self._enter(Mode.LAND, Descend())
        return Result.ACCEPTED

    def go_to(self, target_ned_m: Vector, speed_mps: float | None) -> Result:
        """Fly to a point, about the scenario's home, and stay there."""
        if (refusal := self._unavailable()) is not None:
            return refusal
        if not self.navigation.in_air:
            return self._refuse("reposition refused: not in the air")
        pace = speed_mps or self._cruise_mps
        self._enter(
            Mode.HOLD if self._flavour.is_px4 else Mode.OFFBOARD,
            GoTo(target_ned_m, pace, self._climb_mps, self._descent_mps),
        )
        return Result.ACCEPTED

    def _return_home(self) -> Result:
        if not self.navigation.in_air:
            return self.land()
        if self.mode is not Mode.RETURN:
            north, east, _ = self.origin_ned_m
            target = (north, east, -max(self._return_height_m, -self.estimate.down_m))
            self._enter(Mode.RETURN, GoTo(target, self._cruise_mps, self._climb_mps, self._descent_mps))
        return Result.ACCEPTED

    # --- helpers ------------------------------------------------------------------------------------------------------

    def _lift_off(self) -> None:
        self._world.lift_off(self._index)
        self.command_ned_mps = STILL  # the world forgets what was commanded before

    def _enter(self, mode: Mode, guidance: Guidance | None) -> None:
        self.mode, self._guidance = mode, guidance
        if guidance is None:  # the world flies it
            self.command_ned_mps = STILL
        self.failsafe = self._resume = self._steered = False

    def _unavailable(self) -> Result | None:
        """Why nothing can be commanded now, whatever it is."""
        if not self._spec.cooperative:
            return self._refuse("refused: flies its own mission")
        if self.navigation.state is VehicleState.LANDING:
            return self._refuse("refused: has arrived and lands")
        return None

    def _refuse(self, why: str) -> Result:
        self._say(Severity.WARNING, why)
        return Result(self._flavour.refused)

    @property
    def _fast_mps(self) -> float:
        return self._parameters["MPC_XY_VEL_MAX"] if self._flavour.is_px4 else self._parameters["WPNAV_SPEED"] / 100.0

    @property
    def _cruise_mps(self) -> float:
        if self.commanded_cruise_mps is not None:
            return self.commanded_cruise_mps
        return self._parameters["MPC_XY_CRUISE"] if self._flavour.is_px4 else self._parameters["WPNAV_SPEED"] / 100.0

    @property
    def _climb_mps(self) -> float:
        if self._flavour.is_px4:
            return self._parameters["MPC_Z_VEL_MAX_UP"]
        return self._parameters["WPNAV_SPEED_UP"] / 100.0

    @property
    def _descent_mps(self) -> float:
        if self._flavour.is_px4:
            return self._parameters["MPC_Z_VEL_MAX_DN"]
        return self._parameters["WPNAV_SPEED_DN"] / 100.0

    @property
    def _return_height_m(self) -> float:
        return self._parameters["RTL_RETURN_ALT"] if self._flavour.is_px4 else self._parameters["RTL_ALT"] / 100.0

    @property
    def _takeoff_mps(self) -> float:
        return self._parameters["MPC_TKO_SPEED"] if self._flavour.is_px4 else self._climb_mps
