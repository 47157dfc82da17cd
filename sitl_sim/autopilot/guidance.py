"""Manoeuvres of an autopilot: climb, fly to a point, descend, turn.

Units and axes: metres, seconds, radians; north-east-down about the scenario's home. All manoeuvres use a
`SteeringEstimate`, never the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sitl_sim.autopilot.navigation import Navigation, Vector
from sitl_sim.vehicle.state import DESCENT_MPS, FLARE_HEIGHT_M, TOUCHDOWN_MPS

STILL: Vector = (0.0, 0.0, 0.0)

BLEND_TIME_S = 10.0
"""Time constant with which the steering estimate follows the receiver horizontally: slow, so that noise does not shake
the vehicle."""

APPROACH_PER_S = 0.6
"""Speed per remaining distance; slow enough for the response of either autopilot."""

APPROACH_MPS2 = 1.5
"""Deceleration towards a point that either autopilot can fly."""

LANDING_DRIFT_MPS = 1.0
"""Speed at which a landing vehicle moves sideways to its point."""

HEIGHT_REACHED_M = 0.3
YAW_RATE_RADPS = math.radians(60.0)

MIN_NOSE_SPEED_MPS = 1.0
"""Below this speed, a nose that follows the flight keeps its direction."""


class SteeringEstimate:
    """The position that a vehicle steers by: integrated velocity, corrected slowly towards the receiver's position.

    The height is not corrected. The integrated vertical velocity stands for a barometer, which holds the height within
    decimetres over a flight, whereas the receiver's altitude is metres off.
    """

    def __init__(self, position_ned_m: Vector) -> None:
        self.north_m, self.east_m, self.down_m = position_ned_m
        self.dt_s = 0.0

    def update(self, navigation: Navigation, dt_s: float) -> None:
        """Let time pass."""
        self.dt_s = dt_s
        if not navigation.in_air:
            self.down_m = 0.0
            return
        north, east, _ = navigation.position_ned_m
        velocity = navigation.velocity_ned_mps
        share = min(dt_s / BLEND_TIME_S, 1.0)
        self.north_m += velocity[0] * dt_s + share * (north - self.north_m)
        self.east_m += velocity[1] * dt_s + share * (east - self.east_m)
        self.down_m += velocity[2] * dt_s


@dataclass(frozen=True, slots=True)
class Velocity:
    """Fly a velocity; zero is a hover."""

    velocity_ned_mps: Vector = STILL

    def command(self, estimate: SteeringEstimate) -> Vector:
        """Velocity to fly now [m/s]."""
        return self.velocity_ned_mps


@dataclass(slots=True)
class Accelerate:
    """Fly an acceleration, up to these speeds; `velocity_ned_mps` is the initial and then the present velocity."""

    acceleration_ned_mps2: Vector
    velocity_ned_mps: Vector
    speed_mps: float
    climb_mps: float
    descent_mps: float

    def command(self, estimate: SteeringEstimate) -> Vector:
        """Velocity to fly now [m/s]."""
        north, east, down = (
            velocity + acceleration * estimate.dt_s
            for velocity, acceleration in zip(self.velocity_ned_mps, self.acceleration_ned_mps2, strict=True)
        )
        shortened = min(1.0, self.speed_mps / max(math.hypot(north, east), 1e-9))
        down = min(max(down, -self.climb_mps), self.descent_mps)
        self.velocity_ned_mps = north * shortened, east * shortened, down
        return self.velocity_ned_mps


@dataclass(frozen=True, slots=True)
class GoTo:
    """Fly to a point, at most this fast, and stay; `feed_forward_ned_mps` is added on the way, and flown in axes where
    the point is NaN."""

    target_ned_m: Vector
    speed_mps: float
    climb_mps: float
    descent_mps: float
    feed_forward_ned_mps: Vector = STILL

    def command(self, estimate: SteeringEstimate) -> Vector:
        """Velocity to fly now [m/s]."""
        north = east = down = 0.0
        if not math.isnan(self.target_ned_m[0]):
            north, east = _horizontally(self.target_ned_m[0], self.target_ned_m[1], self.speed_mps, estimate)
        if not math.isnan(self.target_ned_m[2]):
            down = APPROACH_PER_S * (self.target_ned_m[2] - estimate.down_m)
            down = min(max(down, -self.climb_mps), self.descent_mps)
        forward = self.feed_forward_ned_mps
        return north + forward[0], east + forward[1], down + forward[2]

    def distance_m(self, estimate: SteeringEstimate) -> float:
        """Remaining distance."""
        gaps = zip(self.target_ned_m, (estimate.north_m, estimate.east_m, estimate.down_m), strict=True)
        return math.sqrt(sum((target - here) ** 2 for target, here in gaps))


@dataclass(frozen=True, slots=True)
class Climb:
    """Climb straight up to a height above home."""

    height_m: float
    speed_mps: float

    def command(self, estimate: SteeringEstimate) -> Vector:
        """Velocity to fly now [m/s]."""
        left_m = self.height_m + estimate.down_m
        # a least speed, since the last decimetres would take too long
        return 0.0, 0.0, -min(self.speed_mps, max(APPROACH_PER_S * left_m, 0.3))

    def is_done(self, estimate: SteeringEstimate) -> bool:
        """Whether the height is reached."""
        return self.height_m + estimate.down_m <= HEIGHT_REACHED_M


@dataclass(frozen=True, slots=True)
class Descend:
    """Descend to the ground, slower near it; straight down, or onto a point (north, east)."""

    onto_ne_m: tuple[float, float] | None = None

    def command(self, estimate: SteeringEstimate) -> Vector:
        """Velocity to fly now [m/s]."""
        north = east = 0.0
        if self.onto_ne_m is not None:
            north, east = _horizontally(*self.onto_ne_m, LANDING_DRIFT_MPS, estimate)
        return north, east, TOUCHDOWN_MPS if -estimate.down_m < FLARE_HEIGHT_M else DESCENT_MPS


def _horizontally(north_m: float, east_m: float, speed_mps: float, estimate: SteeringEstimate) -> tuple[float, float]:
    """Velocity towards a point [m/s], slower the nearer it is."""
    north_m, east_m = north_m - estimate.north_m, east_m - estimate.east_m
    left_m = math.hypot(north_m, east_m)
    speed_mps = min(speed_mps, APPROACH_PER_S * left_m, math.sqrt(2.0 * APPROACH_MPS2 * left_m))
    pace = speed_mps / max(left_m, 1e-9)
    return north_m * pace, east_m * pace


Guidance = Velocity | Accelerate | GoTo | Climb | Descend


class Nose:
    """Heading of a multirotor: turned towards a requested heading at 60 degrees a second, or kept.

    Args:
        follows: Whether it turns into the direction of flight without a request, as in ArduPilot.
    """

    def __init__(self, *, follows: bool) -> None:
        self.yaw_rad = 0.0
        self.rate_radps = 0.0
        self._usually_follows = self._follows = follows
        self._wanted_rad: float | None = None
        self._wanted_rate_radps: float | None = None

    def turn_to(self, yaw_rad: float) -> None:
        """Turn to a heading and keep it."""
        self._wanted_rad, self._wanted_rate_radps, self._follows = yaw_rad, None, False

    def turn_degrees(self, yaw_deg: float, *, relative: bool = False, direction: float = 1.0) -> None:
        """Turn to a heading in degrees, from north or relative to the nose, to the left if the direction is negative;
        values that are not finite are ignored."""
        if math.isfinite(yaw_deg):
            yaw_rad = math.radians(yaw_deg)
            if relative:
                yaw_rad = self.yaw_rad + (-yaw_rad if direction < 0.0 else yaw_rad)
            self.turn_to(math.remainder(yaw_rad, math.tau))

    def turn_at(self, rate_radps: float) -> None:
        """Keep turning at a rate, limited to that of the vehicle."""
        self._wanted_rad, self._follows = None, False
        self._wanted_rate_radps = min(max(rate_radps, -YAW_RATE_RADPS), YAW_RATE_RADPS)

    def let_go(self) -> None:
        """End a turn at a rate, and follow the flight again, if it does so without a request; a heading that was
        requested is still reached."""
        self._follows, self._wanted_rate_radps = self._usually_follows, None

    def follow(self, velocity_ned_mps: Vector) -> None:
        """Turn into the direction of flight, if it follows it; below 1 m/s keep the last direction."""
        if self._follows and math.hypot(velocity_ned_mps[0], velocity_ned_mps[1]) >= MIN_NOSE_SPEED_MPS:
            self._wanted_rad = math.atan2(velocity_ned_mps[1], velocity_ned_mps[0])

    def update(self, dt_s: float) -> None:
        """Let time pass."""
        turn = 0.0
        if self._wanted_rate_radps is not None:
            turn = self._wanted_rate_radps * dt_s
        elif self._wanted_rad is not None:
            gap = math.remainder(self._wanted_rad - self.yaw_rad, math.tau)
            turn = min(max(gap, -YAW_RATE_RADPS * dt_s), YAW_RATE_RADPS * dt_s)
        self.rate_radps = turn / dt_s if dt_s > 0.0 else 0.0
        self.yaw_rad = math.remainder(self.yaw_rad + turn, math.tau)
