"""Constants of the solvers, and the range of each. This module needs numpy only.

What lies outside of a range is not a matter of taste, but a mistake in a unit or in a digit; a range says nothing about
what flies well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ridlink.errors import ConfigError
from ridlink.ranges import Range, check_ranges

IDEAL_AGE_ACCELERATION_MPS2 = 10.0
"""Manoeuvre granted to an unheard neighbour that obeys at once. An autopilot gets 2.5 m/s^2 out of its vehicle. Four
times that lets half a second unheard count for 1.25 m and a second for 5 m. With 2.5 m/s^2, rotation has more
collisions in the paper's square when reports are lost in bursts than when none is lost; with 40 m/s^2, jumps of the
discs cost a quarter of the time."""


def _vector(settings: Any) -> NDArray[np.float64]:
    return np.array([getattr(settings, item.name) for item in fields(settings)], dtype=np.float64)


_TIME_AHEAD = Range(0.1, 60.0, "s")
"""From one decision to the next, up to a minute: nobody is heard so far ahead, and no course is kept so long."""
_RESPONSE = Range(0.0, 5.0, "s")
"""A vehicle that has not obeyed after 5 s has lost its daemon, which then stops streaming (`failsafe`)."""
_ACCELERATION = Range(0.0, 100.0, "m/s^2")
"""Up to ten times gravity, which no airframe stands."""
_BRAKING = Range(0.1, 100.0, "m/s^2", or_infinite=True)
"""As `_ACCELERATION`; below, a stop from 10 m/s takes more than half a kilometre."""
_SHARE = Range(0.0, 1.0)
_STEP_SHARE = Range(0.01, 1.0)
"""With less the command would need more than ten seconds to follow, and with 0 it never would."""
_WEIGHT = Range(0.0, 100.0)
"""A hundred times what it is weighed against decides alone."""
_QUARTER_TURN = Range(-1.57, 1.57, "rad")
"""Beyond a quarter turn the vehicle would fly away from its goal."""


@dataclass(frozen=True, slots=True)
class HalfplaneSettings:
    """Constants of the half-plane solver; one set serves both autopilots it was tried with.

    Args:
        horizon_s: Conflicts later than this do not constrain. With 5 s vehicles crawl in dense traffic, with 12 s they
            jam. It is stretched to 1.5 disc radii of own flight, since a large disc must be seen earlier.
        response_time_s: The vehicle is taken to fly on for this long and then to obey at once; a half-plane is placed
            at both ends of that time. 0.6 to 1.5 s behave alike; 2 s jumps past the closest approach.
        barrier_gain_per_s: Inside the disc, separating speed asked for per metre of overlap. With less, the overlap
            grows deeper by metres on a slow vehicle.
        barrier_share: Largest part of the speed limit that the barrier may ask of the pair. Discs of crossed bounds can
            overlap by more than any vehicle can fly in a second; asking for that would only make the programme
            infeasible.
        smoothing: Part of the way from the last command to the new velocity that is taken per step. 0.3 adds a lag to a
            lag, 1 doubles the activity of the command.
        right_turn_rad: Turn to the right of the preferred direction while a conflict lies ahead, tapered to zero. Pairs
            that both avoid pass each other by it alone. 0.4 gives them two to three metres more under PX4 at 10 m/s,
            and is a tenth faster in a circle of eight at 5 m/s. But under Candidate 2 the square takes 4 % longer, and
            of discs that overlap at the start up to twice as many flights are late.
        start_turn_rad: Additional turn of a vehicle that stands; it is less the faster the vehicle flies. At rest every
            velocity lies outside every cone. Without this turn a fleet that starts together creeps straight into a jam,
            while one that comes at cruise goes round. The default is twice the turn at cruise; three times makes discs
            that overlap at the start orbit each other.
        age_acceleration_mps2: Acceleration a that an unheard neighbour is assumed to fly: its disc grows by a age^2 /
            2.
        buffer_share: Share of the error sum added to the radius, and of the clearance added to it at obstacles. To
            graze a disc with moving errors is to violate it; a third of three sigma each is the smallest buffer that
            ends it. Below a cruise speed of 8 m/s the buffer to neighbours is larger, by 8 % at 5 m/s.
        arrival_deceleration_mps2: Deceleration a: the preferred speed at distance g of the goal is min(V, sqrt(2 a g) +
            0.3 m/s). Infinite for a vehicle that stops at once.
        head_on_cosine: Opposite courses are head-on when the cosine of the angle between them is below this.
        head_on_speed_mps: Both vehicles must be faster than this for the head-on rule; below it a course is mostly
            noise.
        obstacle_horizon_s: A gap to an obstacle is closed at most with this time constant.
        obstacle_deceleration_mps2: Braking that every autopilot reaches; the approach to an obstacle is never faster
            than this can stop.
        obstacle_response_s: Delay before braking begins.
        route_margin_m: A route round an obstacle passes its clearance by this much more, so that the half-plane of the
            obstacle does not slow the vehicle down on it.
        contact_step_s: Time from one decision to the next. Discs without a part for errors are then never entered, nor
            entered further, if all vehicles near by avoid too and obey at once. For that each keeps to its half of what
            separates the discs before anything else that neighbours ask of it; standing still always satisfies it. 0,
            the default, is off: a vehicle that answers late cannot promise it.
        acceleration_mps2: Commands change by no more than this in 0.1 s, whatever the half-planes ask; the velocity is
            the best one among those that can be reached. Infinite, the default, leaves the shaping to the autopilot: a
            limit below 5 m/s^2 is a lag on top of its own, and costs metres.

    Raises:
        ConfigError: If a figure is out of its range.
    """

    horizon_s: float = 8.0
    response_time_s: float = 1.0
    barrier_gain_per_s: float = 1.0
    barrier_share: float = 0.5
    smoothing: float = 0.5
    right_turn_rad: float = 0.3
    start_turn_rad: float = 0.6
    age_acceleration_mps2: float = 2.5
    buffer_share: float = 1.0 / 3.0
    arrival_deceleration_mps2: float = 1.2
    head_on_cosine: float = -0.85
    head_on_speed_mps: float = 2.0
    obstacle_horizon_s: float = 2.0
    obstacle_deceleration_mps2: float = 2.0
    obstacle_response_s: float = 0.6
    route_margin_m: float = 3.0
    contact_step_s: float = 0.0
    acceleration_mps2: float = math.inf

    RANGES: ClassVar[Mapping[str, Range]] = {
        "horizon_s": _TIME_AHEAD,
        "response_time_s": _RESPONSE,
        "barrier_gain_per_s": Range(0.0, 10.0, "1/s"),  # more would overshoot from one decision, 0.1 s, to the next
        "barrier_share": _STEP_SHARE,
        "smoothing": _STEP_SHARE,
        "right_turn_rad": _QUARTER_TURN,
        "start_turn_rad": _QUARTER_TURN,
        "age_acceleration_mps2": _ACCELERATION,
        "buffer_share": _SHARE,  # with 1 every error counts twice
        "arrival_deceleration_mps2": _BRAKING,
        "head_on_cosine": Range(-1.0, 0.0),
        "head_on_speed_mps": Range(0.0, 100.0, "m/s"),
        "obstacle_horizon_s": _TIME_AHEAD,
        "obstacle_deceleration_mps2": _BRAKING,
        "obstacle_response_s": _RESPONSE,
        "route_margin_m": Range(0.0, 100.0, "m"),
        "contact_step_s": Range(0.0, 1.0, "s"),  # nobody decides less often
        "acceleration_mps2": _BRAKING,
    }

    def __post_init__(self) -> None:
        check_ranges(self, self.RANGES)

    def as_vector(self) -> NDArray[np.float64]:
        """Values in field order, the form in which the kernels take them, shape (18,)."""
        return _vector(self)


@dataclass(frozen=True, slots=True)
class RotationSettings:
    """Constants of the paper's solver. As they stand it can be flown by a real vehicle; `paper` is the paper's.

    Args:
        step_deg: Candidates are this far apart; a divisor of 360. The coarse grid is a hidden margin: with 5 degrees
            flights are a little faster and collide more often.
        left_weight: Cost of a radian to the left of the straight way, in speeds. It must be worth a wide turn to the
            right, or vehicles swing from side to side. With a thirtieth of it twice as many collide under sNMAC.
        cost_weight: Where every candidate leads into a disc: metres of a disc that are worth a deviation by the whole
            speed.
        age_acceleration_mps2: Acceleration a that an unheard neighbour is assumed to fly: its disc grows by a age^2 /
            2.
        arrival_deceleration_mps2: Deceleration a: the speed at distance g of the goal is min(V, sqrt(2 a g) + 0.3 m/s).
            Infinite for a vehicle that stops at once.
        smoothing: Part of the way from the last command to the new velocity that is taken per step.

    Raises:
        ConfigError: If a figure is out of its range, or candidates do not divide the circle.
    """

    step_deg: float = 10.0
    left_weight: float = 2.0
    cost_weight: float = 0.001
    age_acceleration_mps2: float = 2.5
    arrival_deceleration_mps2: float = 1.2
    smoothing: float = 0.5

    RANGES: ClassVar[Mapping[str, Range]] = {
        "step_deg": Range(0.5, 360.0, "deg"),
        "left_weight": _WEIGHT,
        "cost_weight": _WEIGHT,
        "age_acceleration_mps2": _ACCELERATION,
        "arrival_deceleration_mps2": _BRAKING,
        "smoothing": _STEP_SHARE,
    }

    def __post_init__(self) -> None:
        check_ranges(self, self.RANGES)
        turns = 360.0 / self.step_deg
        if abs(turns - round(turns)) >= 1e-9:
            raise ConfigError(f"step_deg must divide 360 degrees, got {self.step_deg:g}")

    @classmethod
    def paper(cls) -> RotationSettings:
        """For vehicles that obey at once, as the paper's do."""
        return cls(age_acceleration_mps2=IDEAL_AGE_ACCELERATION_MPS2, arrival_deceleration_mps2=math.inf, smoothing=1.0)

    def as_vector(self) -> NDArray[np.float64]:
        """Values in field order, the form in which the kernels take them, shape (6,)."""
        return _vector(self)


@dataclass(frozen=True, slots=True)
class GradedSettings:
    """Constants of the graded solver, measured in the worlds of the paper and not derived.

    Lengths are shares of the pair's error sum (three sigma of both): the measurements were made with 60 m, so a share
    of 0.2 stands for 12 m there.

    Args:
        base_share: The radius that is kept is that of the airframes and the displacement, plus this share of the
            errors. The rest of the errors is left to the tail.
        tail_share: Scale in which the risk falls off outside the radius and grows inside: the trade between time and
            collisions.
        crowd_share: Growth of the radius with the logarithm of the number of neighbours over 7.
        crowd_from: Fewer neighbours than this count as this many. Without that, a pair alone would come too near.
        least_radius_m: Least radius, or the whole disc where that is smaller.
        risk_weight: Cost of a pass at the radius now; 1 is a detour of the whole look-ahead.
        fade_s: A risk fades to 37 % when its entry is this far ahead.
        wrong_side_factor: A neighbour that would be passed on its right counts this many times.
        lean_rad: Turn to the right while the straight way is in conflict: the strongest lever on near misses. It must
            not be always on, for that costs seconds in traffic.
        lean_within_s: A conflict is a closest approach within this time ...
        lean_radii: ... nearer than this many radii.
        left_weight: Cost of a radian to the left of the leaned way.
        smoothness: Cost of a change of velocity by the whole cruise speed.
        look_ahead_s: Headings are compared by the time to the goal after flying each for this long.
        response_time_s: The vehicle is taken to fly on for this long before it obeys; risks are seen from both ends. It
            earns a metre where one vehicle overtakes another, and little elsewhere.
        age_acceleration_mps2: Acceleration a that an unheard neighbour is assumed to fly: its radius grows by a age^2 /
            2.
        arrival_deceleration_mps2: Deceleration a: the speed at distance g of the goal is min(V, sqrt(2 a g) + 0.3 m/s).
            Infinite for a vehicle that stops at once.
        smoothing: Part of the way from the last command to the new velocity that is taken per step.

    Raises:
        ConfigError: If a figure is out of its range.
    """

    base_share: float = 12.5 / 60.0
    tail_share: float = 8.2 / 60.0
    crowd_share: float = 9.0 / 60.0
    crowd_from: float = 7.0
    least_radius_m: float = 8.0
    risk_weight: float = 1.05
    fade_s: float = 5.0
    wrong_side_factor: float = 2.7
    lean_rad: float = 0.44
    lean_within_s: float = 6.5
    lean_radii: float = 2.0
    left_weight: float = 0.8
    smoothness: float = 0.1
    look_ahead_s: float = 1.5
    response_time_s: float = 1.0
    age_acceleration_mps2: float = 2.5
    arrival_deceleration_mps2: float = 1.2
    smoothing: float = 0.5

    RANGES: ClassVar[Mapping[str, Range]] = {
        "base_share": _SHARE,
        "tail_share": _SHARE,
        "crowd_share": _SHARE,
        "crowd_from": Range(1.0, 1000.0),
        "least_radius_m": Range(0.0, 100.0, "m"),
        "risk_weight": Range(0.01, 100.0),
        "fade_s": _TIME_AHEAD,
        "wrong_side_factor": _WEIGHT,
        "lean_rad": Range(0.0, _QUARTER_TURN.most, "rad"),
        "lean_within_s": Range(0.0, _TIME_AHEAD.most, "s"),
        "lean_radii": _WEIGHT,
        "left_weight": _WEIGHT,
        "smoothness": _WEIGHT,
        "look_ahead_s": _TIME_AHEAD,
        "response_time_s": _RESPONSE,
        "age_acceleration_mps2": _ACCELERATION,
        "arrival_deceleration_mps2": _BRAKING,
        "smoothing": _STEP_SHARE,
    }

    def __post_init__(self) -> None:
        check_ranges(self, self.RANGES)

    @classmethod
    def g2(cls) -> GradedSettings:
        """The default for vehicles that obey at once: faster than Candidate 2 under rotation, with half its MACs."""
        return cls().for_an_ideal_vehicle()

    @classmethod
    def g3(cls) -> GradedSettings:
        """As `g2`, with a wider and lighter tail: no slower than the paper's Candidates, and fewer MACs."""
        wider = cls(
            tail_share=9.0 / 60.0, crowd_share=11.0 / 60.0, risk_weight=0.75, wrong_side_factor=3.5, left_weight=0.9
        )
        return wider.for_an_ideal_vehicle()

    @classmethod
    def k(cls) -> GradedSettings:
        """The conservative one, as `g2` for vehicles that obey at once: hardly any MAC even under a bias per flight."""
        conservative = cls(
            base_share=10.0 / 60.0, tail_share=14.0 / 60.0, crowd_share=6.5 / 60.0, risk_weight=2.5, lean_rad=0.45
        )
        return conservative.for_an_ideal_vehicle()

    @classmethod
    def k2(cls) -> GradedSettings:
        """As `k`, and wider still where many are about."""
        return replace(cls.k(), crowd_share=15.0 / 60.0, lean_rad=0.44)

    def for_an_ideal_vehicle(self) -> GradedSettings:
        """The same for a vehicle that obeys at once."""
        return replace(
            self, response_time_s=0.0, age_acceleration_mps2=IDEAL_AGE_ACCELERATION_MPS2,
            arrival_deceleration_mps2=math.inf, smoothing=1.0,
        )  # fmt: skip

    def as_vector(self) -> NDArray[np.float64]:
        """Values in field order, the form in which the kernels take them, shape (18,)."""
        return _vector(self)
