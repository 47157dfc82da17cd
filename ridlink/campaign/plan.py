"""What a campaign flies: one scene, one definition, one solver, one kind of position error, many runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ridlink.avoidance.settings import GradedSettings, RotationSettings
from ridlink.avoidance.types import HalfplaneSettings, SolverKind
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.scene import Scene
from ridlink.remote_id.accuracy import AccuracyConvention, code_of_three_sigma, three_sigma_bound_m
from ridlink.separation.chance import DEFAULT_ETA, ChanceBound
from ridlink.separation.definitions import Definition

Settings = HalfplaneSettings | GradedSettings | RotationSettings

PAIR_READING_SIGMAS = 1.5
"""Table IV's "3 sigma" of a pair, read as eps_i + eps_j = 3 sigma: only so do the paper's times come out without
collisions."""

IDEAL_HALFPLANES = HalfplaneSettings(
    response_time_s=0.0, arrival_deceleration_mps2=math.inf, obstacle_deceleration_mps2=math.inf, smoothing=1.0
)
"""For vehicles that obey at once."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One cell of a campaign's table. Vehicles obey at once.

    Args:
        scene: Geometry.
        definition: What sizes the discs.
        settings: Constants of the solver, which they name.
        errors: How sigma becomes a position error.
        sigma_m: Standard deviation of the errors, where the scene says nothing.
        bound_sigmas: Reported error bound of each vehicle in standard deviations; 1.5 is the paper's reading.
        obstacle_bound_m: Part of the distance to obstacles that stands for the own error; None: what the definition
            takes for it.
        filtered: Reported positions are smoothed by all who use them.
        eta: Of the definition `chance`: probability per instant.
        chance_bound: Of the definition `chance`: form of the constraint.
        seed: Seed of the campaign.
        duration_s: Cut-off.
        interval_s: Time between two reports and two decisions.
        range_m: Vehicles further than this are not heard.
        arrived_m: A vehicle this close to its goal has arrived, and leaves the picture.
        swept: Judge collisions between the instants, too, and not at them alone.

    Raises:
        ValueError: If a value is not finite or out of range; it is named.
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
    seed: int = 1
    duration_s: float = 120.0
    interval_s: float = 0.1
    range_m: float = 400.0
    arrived_m: float = 5.0
    swept: bool = False

    def __post_init__(self) -> None:
        for name in ("duration_s", "interval_s", "range_m", "arrived_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, got {value}")
        for name in ("sigma_m", "bound_sigmas", "obstacle_bound_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} must be finite and not negative, got {value}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        object.__setattr__(self, "definition", Definition(self.definition))
        object.__setattr__(self, "errors", ErrorModel(self.errors))

    @property
    def solver(self) -> SolverKind:
        """The solver whose constants these are."""
        if isinstance(self.settings, GradedSettings):
            return SolverKind.GRADED
        return SolverKind.ROTATION if isinstance(self.settings, RotationSettings) else SolverKind.HALFPLANE

    @property
    def error_bound_m(self) -> float:
        """Error bound that every vehicle reports of which the scene says nothing."""
        return self.bound_sigmas * self.sigma_m

    @property
    def accuracy_bound_m(self) -> float:
        """What of that is left in the accuracy code of standard Remote ID; NaN where the code is "unknown"."""
        return coded_bound_m(self.error_bound_m)


def coded_bound_m(error_bound_m: float) -> float:
    """What of a reported error bound is left in the accuracy code of standard Remote ID [m]; NaN for "unknown"."""
    convention = AccuracyConvention.LETTER
    bound = three_sigma_bound_m(code_of_three_sigma(error_bound_m, convention), convention)
    return math.nan if bound is None else bound


def paper_plan(
    scene: Scene,
    definition: Definition,
    *,
    errors: ErrorModel = ErrorModel.WHITE_RADIAL,
    sigma_m: float = 10.0,
    seed: int = 1,
) -> Plan:
    """The paper's simulation, section VI-B: its solver, its reading of the error bound, white radial errors."""
    return Plan(
        scene, definition, RotationSettings.paper(), errors, sigma_m, bound_sigmas=PAIR_READING_SIGMAS, seed=seed
    )


def graded_plan(
    scene: Scene,
    settings: GradedSettings | None = None,
    *,
    errors: ErrorModel = ErrorModel.WHITE,
    sigma_m: float = 10.0,
    seed: int = 1,
) -> Plan:
    """The same worlds under the graded solver, which wants filtered positions and honest bounds of three sigma.

    From obstacles it keeps 2.5 sigma, as its constants were measured.
    """
    return Plan(
        scene, Definition.CANDIDATE2, settings or GradedSettings.g2(), errors, sigma_m,
        obstacle_bound_m=2.5 * sigma_m, filtered=True, seed=seed,
    )  # fmt: skip
