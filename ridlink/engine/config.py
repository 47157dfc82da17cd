"""Configuration of an engine, checked once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar

from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.avoidance.types import SolverKind
from ridlink.engine.static_obstacles import Polygon, StaticObstacles
from ridlink.errors import ConfigError
from ridlink.failsafe import FailsafeSettings
from ridlink.geodesy import Geodetic, great_circle_m
from ridlink.own_ship.broadcast import BroadcastSettings, Form
from ridlink.ranges import Range
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.remote_id.quantities import ID_LENGTH
from ridlink.separation.chance import DEFAULT_ETA, ETA_RANGE, ChanceBound
from ridlink.separation.definitions import Definition
from ridlink.separation.reference import (
    AIRFRAME_CAP_M,
    AIRFRAME_HEIGHT_RANGE,
    AIRFRAME_RANGE,
    ERROR_CAP_M,
    UNKNOWN_ERROR_BOUND_M,
    UNKNOWN_SPEED_MPS,
)
from ridlink.setpoint import SPEED_RANGE, VelocityLimits
from ridlink.traffic.snapshot import PictureSettings


@dataclass(frozen=True, slots=True)
class Goal:
    """Goal: latitude and longitude in degrees, altitude above mean sea level, None to keep the present one, and the
    speed wanted on the way, None for cruise speed, which is also the most."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None = None
    speed_mps: float | None = None

    def is_below(self, altitude_m: float) -> bool:
        """Whether it is known to lie lower than an altitude above mean sea level."""
        return self.altitude_m is not None and self.altitude_m < altitude_m

    def away_m(self, place: Geodetic) -> float:
        """How far it is from a place, along a great circle."""
        return great_circle_m((place.latitude_deg, place.longitude_deg), (self.latitude_deg, self.longitude_deg))


@dataclass(frozen=True, slots=True)
class EngineConfig:
    """Configuration of an engine.

    Args:
        goal: Where to fly to.
        standby: Do not start alone, but wait for MAV_CMD_DO_REPOSITION, so that a restart never moves a vehicle.
        definition: Definition that sizes the discs.
        eta: Under `Definition.CHANCE`, the probability that no neighbour comes too close, at any one instant.
        chance_bound: Under `Definition.CHANCE`, how that probability becomes a distance.
        accuracy_convention: Under `Definition.ODID_ACCURACY`, what the accuracy codes of others are taken to mean, and
            the own one.
        cruise_mps: Speed wanted, and the highest that avoidance asks for: a vehicle that cannot fly faster would answer
            a faster command with less than half-planes assume.
        airframe_m: Largest horizontal extent of the own airframe, rotors turning.
        airframe_height_m: Largest vertical extent; None: as large as the horizontal one, since hardly anything that
            flies is taller than wide.
        limits: Limits of the setpoints.
        solver: Which solver decides.
        halfplane: Constants of the half-plane solver.
        graded: Constants of the graded solver.
        rotation: Constants of the rotation solver.
        failsafe: Limits of the failsafe ladder.
        obstacles: Static obstacles, polygons of (latitude, longitude) in degrees.
        vertical_avoidance: Climb or descend, too, where the horizontal decision is bad; see `avoidance.vertical`.
        vertical_cost: Share of the cruise speed; a horizontal decision further from the straight way is bad.
        vertical_band_m: Vertical avoidance stays this near to the altitude of the goal, ...
        min_height_m: ... above this height over home, ...
        max_height_m: ... and below this one. 120 m is the ceiling of open flights in Europe and of small ones in the
            United States. A goal outside widens the band to itself.
        vehicle_sysid: Only this autopilot; without it, the first one heard.
        uas_id: Own identity in Remote ID; without it, that of BASIC_ID on the vehicle link.
        filter_positions: Smooth reported positions, own and others'.
        guard: Fly nothing while all is clear; take over from the autopilot's own plan for a conflict, and hand it back.
        takeoff_aware: Never interrupt a climb-out, unless a mid-air collision is predicted.
        takeoff_height_m: A climb below this height over home is a climb-out.
        allow_v1: Take MAVLink 1 frames as well, on both links.
        broadcast: Transmit the own Remote ID as well.
        broadcast_apart: The transmitter has a link of its own, which is told as well whose daemon speaks there.
        broadcast_form: Receivers that the broadcast is meant for.
        operator_id: Identity of the operator in the broadcast; empty for none.
        dry_run: Decisions are not sent: nobody is told that we avoid, and another writer is no reason to yield.

    Raises:
        ConfigError: If a value is invalid, or two contradict each other; it is named.
    """

    goal: Goal | None = None
    standby: bool = False
    definition: Definition = Definition.CANDIDATE2
    eta: float = DEFAULT_ETA
    chance_bound: ChanceBound = ChanceBound.HALFPLANE
    accuracy_convention: AccuracyConvention = DEFAULT_CONVENTION
    cruise_mps: float = 10.0
    airframe_m: float = 0.6
    airframe_height_m: float | None = None
    limits: VelocityLimits = field(default_factory=VelocityLimits)
    solver: SolverKind = SolverKind.HALFPLANE
    halfplane: HalfplaneSettings = field(default_factory=HalfplaneSettings)
    graded: GradedSettings = field(default_factory=GradedSettings)
    rotation: RotationSettings = field(default_factory=RotationSettings)
    failsafe: FailsafeSettings = field(default_factory=FailsafeSettings)
    obstacles: tuple[Polygon, ...] = ()
    vertical_avoidance: bool = False
    vertical_cost: float = 0.25
    vertical_band_m: float = 40.0
    min_height_m: float = 20.0
    max_height_m: float = 120.0
    vehicle_sysid: int | None = None
    uas_id: str | None = None
    filter_positions: bool = True
    guard: bool = False
    takeoff_aware: bool = False
    takeoff_height_m: float = 20.0
    allow_v1: bool = False
    broadcast: bool = False
    broadcast_apart: bool = False
    broadcast_form: Form = Form.AIR
    operator_id: str = ""
    dry_run: bool = False

    @property
    def solver_settings(self) -> HalfplaneSettings | GradedSettings | RotationSettings:
        """Constants of the solver that decides."""
        settings: HalfplaneSettings | GradedSettings | RotationSettings = getattr(self, self.solver.value)
        return settings

    @property
    def height_m(self) -> float:
        """Vertical extent of the own airframe."""
        return self.airframe_m if self.airframe_height_m is None else self.airframe_height_m

    @property
    def picture_settings(self) -> PictureSettings:
        """Settings of the traffic picture."""
        return PictureSettings(
            unknown_error_m=UNKNOWN_ERROR_BOUND_M,
            unusable_error_m=ERROR_CAP_M,
            absurd_airframe_m=AIRFRAME_CAP_M,
            unknown_speed_mps=UNKNOWN_SPEED_MPS,
            filtered=self.filter_positions,
            own_height_m=self.height_m,
            vertical_horizon_s=self.halfplane.horizon_s,
            all_heights=self.vertical_avoidance,
        )

    @property
    def broadcast_settings(self) -> BroadcastSettings:
        """Contents of the own Remote ID that the autopilot does not report."""
        return BroadcastSettings(
            airframe_m=self.airframe_m,
            airframe_height_m=self.height_m,
            uas_id=None if self.uas_id is None else self.uas_id.encode(),
            operator_id=self.operator_id.encode(),
            form=self.broadcast_form,
        )

    RANGES: ClassVar[Mapping[str, Range]] = {
        "eta": ETA_RANGE,
        "cruise_mps": SPEED_RANGE,
        "airframe_m": AIRFRAME_RANGE,
        "airframe_height_m": AIRFRAME_HEIGHT_RANGE,
        "vertical_cost": Range(0.0, 2.0),  # the largest deviation: back, at cruise speed
        "vertical_band_m": Range(1.0, 20_000.0, "m"),  # from what a barometer holds, to all heights of a goal
        "min_height_m": Range(0.0, 20_000.0, "m"),
        "max_height_m": Range(0.0, 20_000.0, "m"),
        "takeoff_height_m": Range(0.0, 1000.0, "m"),
        "vehicle_sysid": Range(1, 255),
    }

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            object.__setattr__(self, name, _chosen(name, getattr(self, name), choices))
        for name, allowed in self.RANGES.items():
            value = getattr(self, name)
            if value is not None:
                allowed.check(name.removesuffix("_mps").removesuffix("_m").replace("_", "-"), value)
        if self.cruise_mps > self.limits.horizontal_mps:
            raise ConfigError(
                f"cruise of {self.cruise_mps:g} m/s is above v-max of {self.limits.horizontal_mps:g} m/s: lower the "
                "one or raise the other"
            )
        if self.min_height_m >= self.max_height_m:
            raise ConfigError(
                f"min-height must lie below max-height, got {self.min_height_m:g} and {self.max_height_m:g} m"
            )
        if self.guard and (self.goal is not None or self.standby):
            raise ConfigError("guard flies the autopilot's own plan: leave out goal and standby")
        if self.uas_id is not None and not 1 <= len(self.uas_id.encode()) <= ID_LENGTH:
            raise ConfigError(f"uas-id must have 1 to {ID_LENGTH} bytes, got {len(self.uas_id.encode())}")
        _ = self.broadcast_settings  # checks itself
        StaticObstacles(self.obstacles)
        if self.goal is not None and (problem := goal_problem(self.goal, self.failsafe)):
            raise ConfigError(f"goal: {problem}")


_CHOICES: dict[str, type[StrEnum]] = {
    "definition": Definition,
    "chance_bound": ChanceBound,
    "accuracy_convention": AccuracyConvention,
    "solver": SolverKind,
    "broadcast_form": Form,
}


def _chosen(name: str, value: object, choices: type[StrEnum]) -> StrEnum:
    """Member of an enumeration, which may be given by its name."""
    try:
        return choices(str(value))
    except ValueError:
        option, names = name.replace("_", "-"), ", ".join(choices)
        raise ConfigError(f"{option} must be one of {names}, got {value!r}") from None


def goal_problem(goal: Goal, settings: FailsafeSettings) -> str:
    """What is wrong with a goal; empty if nothing is."""
    values = (goal.latitude_deg, goal.longitude_deg, 0.0 if goal.altitude_m is None else goal.altitude_m)
    if not all(math.isfinite(value) for value in values):
        return "coordinates must be finite"
    if abs(goal.latitude_deg) > settings.max_latitude_deg:
        return f"latitude {goal.latitude_deg:g} is beyond {settings.max_latitude_deg:g} degrees"
    if abs(goal.longitude_deg) > 180.0:
        return f"longitude {goal.longitude_deg:g} is not within 180 degrees"
    if not -1000.0 < values[2] < 20000.0:
        return f"altitude {values[2]:g} m is out of range"
    return ""
