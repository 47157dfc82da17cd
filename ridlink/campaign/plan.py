"""The plan of one cell of a campaign: one scene, one definition, one solver, one error model, many runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.settings import IDEAL_AGE_ACCELERATION_MPS2, GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.avoidance.types import SolverKind
from ridlink.campaign.cell import BASELINE, Cell
from ridlink.campaign.chance import CORRELATION_TIME_S, ErrorModel
from ridlink.campaign.channel import PERFECT, Channel
from ridlink.campaign.response import Dynamics
from ridlink.campaign.scene import Scene
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention, coded_bound_m
from ridlink.separation.chance import DEFAULT_ETA, ChanceBound
from ridlink.separation.definitions import Definition
from ridlink.separation.reference import CATEGORIES, REPORT_INTERVAL_S

Settings = HalfplaneSettings | GradedSettings | RotationSettings

PAIR_READING_SIGMAS = 1.5
"""Table IV's "3 sigma" of a pair, read as eps_i + eps_j = 3 sigma: only this reading reproduces the paper's times
without collisions."""

IDEAL_HALFPLANES = HalfplaneSettings(
    response_time_s=0.0,
    arrival_deceleration_mps2=math.inf,
    obstacle_deceleration_mps2=math.inf,
    smoothing=1.0,
    age_acceleration_mps2=2.0 * IDEAL_AGE_ACCELERATION_MPS2,
    contact_step_s=REPORT_INTERVAL_S,
)
"""For vehicles that obey at once. For unheard neighbours they assume a larger acceleration than the solvers that choose
among headings: with 10 m/s^2, two of 32,000 flights with losses in bursts collide."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One cell of a campaign's table.

    Args:
        scene: Geometry.
        definition: What sizes the discs.
        settings: Constants of the solver; their type selects it.
        errors: How sigma becomes a position error.
        sigma_m: Standard deviation of the errors, if the scene has none.
        bound_sigmas: Reported error bound of each vehicle in standard deviations; 1.5 is the paper's reading.
        obstacle_bound_m: Part of the distance to obstacles for the own error; None: the value that the definition uses.
        filtered: Whether all vehicles smooth reported positions.
        eta: For the definition `chance`: probability per instant.
        chance_bound: For the definition `chance`: form of the constraint.
        accuracy_convention: For the definition `odid-accuracy`: how all read each other's accuracy codes.
        seed: Seed of the campaign.
        duration_s: Cut-off.
        interval_s: Time between two reports, and between two decisions unless `step_s` is given.
        range_m: Vehicles further than this are not heard.
        arrived_m: A vehicle this close to its goal has arrived, and leaves the picture.
        swept: Judge collisions between the instants, too, not only at them.
        dynamics: How vehicles respond to commands.
        channel: Losses and latencies of reports.
        step_s: Time between two decisions; None: `interval_s`.
        displaced_s: Time of flight that the discs allow for; None: `interval_s`, as in the paper's Eq. 7. The daemon
            allows for 0.1 s and for the age of each report.
        category: Category of Table III, for drawn fleets; None: the paper's simulation.
        stock_share: Share of vehicles, in addition to those of the scene, that send standard Remote ID only.
        unresponsive_share: Share of vehicles, in addition to those of the scene, that avoid nobody.
        nobody_avoids: The baseline: all vehicles fly straight on.
        correlation_s: Time constant of the Gauss-Markov errors.
        common_share: Part of the variance of the errors that all vehicles share.
        bias_m: Standard deviation per axis of an offset for the whole flight that no reported bound covers.
        solver_name: Name in tables, instead of that of the solver.

    Raises:
        ValueError: If a value is not finite or out of range; the text names it.
    """

    scene: Scene
    definition: Definition = Definition.CANDIDATE2
    settings: Settings = IDEAL_HALFPLANES
    errors: ErrorModel = ErrorModel.GAUSS_MARKOV
    sigma_m: float = 10.0
    bound_sigmas: float = 3.0
    obstacle_bound_m: float | None = None
    filtered: bool = False
    eta: float = DEFAULT_ETA
    chance_bound: ChanceBound = ChanceBound.HALFPLANE
    accuracy_convention: AccuracyConvention | str = DEFAULT_CONVENTION
    seed: int = 1
    duration_s: float = 120.0
    interval_s: float = 0.1
    range_m: float = 400.0
    arrived_m: float = 5.0
    swept: bool = False
    dynamics: Dynamics = Dynamics.IDEAL
    channel: Channel = PERFECT
    step_s: float | None = None
    displaced_s: float | None = None
    category: int | None = None
    stock_share: float = 0.0
    unresponsive_share: float = 0.0
    nobody_avoids: bool = False
    correlation_s: float = CORRELATION_TIME_S
    common_share: float = 0.0
    bias_m: float = 0.0
    solver_name: str | None = None

    def __post_init__(self) -> None:
        for name in ("duration_s", "interval_s", "range_m", "arrived_m", "step_s", "correlation_s"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, got {value}")
        for name in ("sigma_m", "bound_sigmas", "obstacle_bound_m", "displaced_s", "bias_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} must be finite and not negative, got {value}")
        for name in ("stock_share", "unresponsive_share", "common_share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must lie within 0 and 1, got {getattr(self, name)}")
        if self.category not in (None, *CATEGORIES):
            raise ValueError(f"category must be one of {', '.join(map(str, CATEGORIES))}, got {self.category}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        object.__setattr__(self, "definition", Definition(self.definition))
        object.__setattr__(self, "errors", ErrorModel(self.errors))
        object.__setattr__(self, "accuracy_convention", AccuracyConvention(self.accuracy_convention))
        object.__setattr__(self, "dynamics", Dynamics(self.dynamics))

    @property
    def cell(self) -> Cell:
        """The values that distinguish this plan from the others of its campaign."""
        return Cell(
            self.scene.name, BASELINE if self.nobody_avoids else str(self.definition), str(self.errors),
            self.solver_name or str(self.solver), str(self.dynamics), self.sigma_m, self.interval_s, self.channel.loss,
        )  # fmt: skip

    @property
    def is_heard_at_once(self) -> bool:
        """Whether all receive every report at once and fly as decided, so that all share one picture. Such plans fly
        faster."""
        mixed = self.stock_share > 0.0 or self.unresponsive_share > 0.0
        same_step = self.step_s in (None, self.interval_s) and self.displaced_s in (None, self.interval_s)
        return self.dynamics is Dynamics.IDEAL and self.channel.is_perfect and same_step and not mixed

    @property
    def solver(self) -> SolverKind:
        """The solver whose constants these are."""
        if isinstance(self.settings, GradedSettings):
            return SolverKind.GRADED
        return SolverKind.ROTATION if isinstance(self.settings, RotationSettings) else SolverKind.HALFPLANE

    @property
    def vehicle_sigma_m(self) -> NDArray[np.float64]:
        """Standard deviation of the errors of each vehicle, shape (N,)."""
        told = self.scene.sigma_m
        return np.full(len(self.scene), self.sigma_m) if told is None else told

    @property
    def error_bound_m(self) -> float:
        """Error bound reported by vehicles that have none in the scene."""
        return self.bound_sigmas * self.sigma_m

    @property
    def accuracy_bound_m(self) -> float:
        """The same bound as read from the accuracy code of standard Remote ID; NaN if the code is "unknown"."""
        return coded_bound_m(self.error_bound_m, self.accuracy_convention)


def baseline(plan: Plan) -> Plan:
    """The same flights without avoidance: all vehicles fly straight on."""
    nobody = np.zeros(len(plan.scene), np.bool_)
    step_s = min(plan.step_s or plan.interval_s, REPORT_INTERVAL_S)
    return replace(plan, scene=replace(plan.scene, cooperative=nobody), nobody_avoids=True, step_s=step_s)


def paper_plan(scene: Scene, definition: Definition) -> Plan:
    """The paper's simulation, section VI-B: its solver, its reading of the error bound, white radial errors of 10 m."""
    return Plan(
        scene, definition, RotationSettings.paper(), ErrorModel.WHITE_RADIAL, 10.0, bound_sigmas=PAIR_READING_SIGMAS
    )


def graded_plan(
    scene: Scene,
    settings: GradedSettings | None = None,
    *,
    errors: ErrorModel = ErrorModel.WHITE,
    sigma_m: float = 10.0,
) -> Plan:
    """The same worlds under the graded solver, which needs filtered positions and reported bounds of three sigma.

    It keeps 2.5 sigma from obstacles, as in the measurement of its constants.
    """
    return Plan(
        scene, Definition.CANDIDATE2, settings or GradedSettings.g2(), errors, sigma_m,
        obstacle_bound_m=2.5 * sigma_m, filtered=True,
    )  # fmt: skip
