"""Constants of the solvers that choose among headings. This module needs numpy only."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

IDEAL_AGE_ACCELERATION_MPS2 = 10.0
"""Manoeuvre that an unheard neighbour is granted which obeys at once. An autopilot gets 2.5 m/s^2 out of its vehicle;
four times that lets half a second unheard count for 1.25 m and a second for 5 m. With 2.5 m/s^2 rotation has more
collisions in the paper's square when reports are lost in bursts than when none is; with 40 m/s^2 jumps of the discs
cost a quarter of the time."""


def _vector(settings: Any) -> NDArray[np.float64]:
    return np.array([getattr(settings, item.name) for item in fields(settings)], dtype=np.float64)


def _check(settings: Any, positive: Iterable[str], may_be_infinite: Iterable[str]) -> None:
    """Every value is finite and not negative, those in `positive` are not zero either; `ValueError` names the first."""
    infinite = frozenset(may_be_infinite)
    for item in fields(settings):
        value = getattr(settings, item.name)
        if not (math.isfinite(value) or (item.name in infinite and value == math.inf)):
            raise ValueError(f"{item.name} must be finite, got {value}")
        if value < 0.0:
            raise ValueError(f"{item.name} must not be negative, got {value}")
    for name in positive:
        if getattr(settings, name) <= 0.0:
            raise ValueError(f"{name} must be positive, got {getattr(settings, name)}")


def _check_smoothing(settings: Any) -> None:
    if not 0.0 < settings.smoothing <= 1.0:
        raise ValueError(f"smoothing must lie in (0, 1], got {settings.smoothing}")


@dataclass(frozen=True, slots=True)
class RotationSettings:
    """Constants of the paper's solver. As they stand it can be flown by a real vehicle; `paper` is the paper's.

    Args:
        step_deg: Candidates are so far apart; a divisor of 360. The coarse grid is a hidden margin: with 5 degrees
            flights are a little faster and collide more often.
        left_weight: Cost of a radian to the left of the straight way, in speeds: it must be worth a wide turn to the
            right, or vehicles dance. With a thirtieth of it twice as many collide under sNMAC.
        cost_weight: Metres of a disc that are worth a deviation by the whole speed where every candidate leads into
            one.
        age_acceleration_mps2: Manoeuvre that an unheard neighbour is granted: its disc grows by a age^2 / 2.
        arrival_deceleration_mps2: The speed at distance g of the goal is min(V, sqrt(2 a g) + 0.3 m/s). Infinite for a
            vehicle that stops at once.
        smoothing: Part of the way from the last command to the new velocity taken per step.

    Raises:
        ValueError: If a figure is not finite or out of its range, or candidates do not divide the circle.
    """

    step_deg: float = 10.0
    left_weight: float = 2.0
    cost_weight: float = 0.001
    age_acceleration_mps2: float = 2.5
    arrival_deceleration_mps2: float = 1.2
    smoothing: float = 0.5

    def __post_init__(self) -> None:
        _check(self, ("step_deg", "arrival_deceleration_mps2"), ("arrival_deceleration_mps2",))
        _check_smoothing(self)
        turns = 360.0 / self.step_deg
        if not (1.0 <= turns <= 720.0 and abs(turns - round(turns)) < 1e-9):
            raise ValueError(f"step_deg must divide 360 degrees into at most 720, got {self.step_deg}")

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
        base_share: The radius that is kept is that of the airframes and the displacement, plus this share. The rest of
            the errors is left to the tail.
        tail_share: Scale in which the risk falls off outside of the radius and grows inside: the trade between time and
            collisions.
        crowd_share: Growth of the radius with the logarithm of the number of neighbours over 7.
        crowd_from: Fewer neighbours than this count as so many. Without that, a pair alone would come too near.
        least_radius_m: Least radius, or the whole disc where that is smaller.
        risk_weight: Cost of a pass at the radius now; 1 is a detour of the whole look-ahead.
        fade_s: Time until the entry in which a risk fades to 37 %.
        wrong_side_factor: A neighbour that would be passed on its right counts so many times.
        lean_rad: Turn to the right while the straight way is in conflict: the strongest lever on near misses. It must
            be gated; always on, it costs seconds in traffic.
        lean_within_s: A conflict is a closest approach within this time ...
        lean_radii: ... nearer than so many radii.
        left_weight: Cost of a radian to the left of the leaned way.
        smoothness: Cost of a change of velocity by the whole cruise speed.
        look_ahead_s: The time to the goal is compared after so long on a heading.
        response_time_s: The vehicle is taken to fly on for so long before it obeys; risks are seen from both ends. It
            earns a metre where one overtakes another, and little elsewhere.
        age_acceleration_mps2: Manoeuvre that an unheard neighbour is granted: its radius grows by a age^2 / 2.
        arrival_deceleration_mps2: The speed at distance g of the goal is min(V, sqrt(2 a g) + 0.3 m/s). Infinite for a
            vehicle that stops at once.
        smoothing: Part of the way from the last command to the new velocity taken per step.

    Raises:
        ValueError: If a figure is not finite or out of its range.
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

    def __post_init__(self) -> None:
        _check(
            self,
            ("crowd_from", "risk_weight", "fade_s", "look_ahead_s", "arrival_deceleration_mps2"),
            ("arrival_deceleration_mps2",),
        )
        _check_smoothing(self)
        if self.lean_rad > math.pi / 2:
            raise ValueError(f"lean_rad must lie within a quarter turn, got {self.lean_rad}")

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
