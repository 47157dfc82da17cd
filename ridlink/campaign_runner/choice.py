"""What a campaign flies: its options as plans, and as the configuration that its folder keeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any

from ridlink.avoidance.settings import GradedSettings, RotationSettings
from ridlink.avoidance.types import SolverKind
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.plan import IDEAL_HALFPLANES, PAIR_READING_SIGMAS, Plan, graded_plan
from ridlink.campaign.scene import Scene, circle, scene_of, square
from ridlink.campaign.table import DYNAMICS
from ridlink.errors import ConfigError
from ridlink.scenario import resolve_scenario
from ridlink.separation.definitions import Definition

PAPER_DEFINITIONS = (Definition.SNMAC, Definition.REMOTE_ID, Definition.CANDIDATE1, Definition.CANDIDATE2)
PAPER_SCENARIOS = ("circle8", "square24")


@dataclass(frozen=True, slots=True)
class Choice:
    """The cells of a campaign: every scenario under every definition, kind of error and solver.

    Args:
        scenarios: Names or paths of files.
        definitions: What sizes the discs.
        gnss: How sigma becomes a position error.
        solvers: Who decides.
        paper: Error bounds as the paper reads them: three sigma for a pair, not for each vehicle; not under `graded`.
        sigma_m: Standard deviation where the scenario says nothing.
        eta: Of the definition `chance`.
        seed: Seed of everything.
    """

    scenarios: tuple[str, ...]
    definitions: tuple[Definition, ...]
    gnss: tuple[ErrorModel, ...]
    solvers: tuple[SolverKind, ...]
    paper: bool
    sigma_m: float
    eta: float
    seed: int

    def plans(self) -> list[Plan]:
        """One plan a cell.

        Raises:
            ConfigError: If a scenario is unknown, wrong, or named like another.
            OSError: If a file cannot be read.
        """
        flown: dict[str, Plan] = {}
        for name in self.scenarios:
            template = self._template(name)
            if template.scene.name in flown:
                raise ConfigError(f"two scenarios have the name '{template.scene.name}'; give each its own")
            flown[template.scene.name] = template
        return [
            self._plan(template, definition, gnss, solver)
            for template in flown.values()
            for gnss in self.gnss
            for solver in self.solvers
            for definition in self.definitions
        ]

    def configuration(self, plans: Sequence[Plan], runs: int) -> dict[str, Any]:
        """Everything that the rows depend on."""
        return {
            "ridlink": version("ridlink"),
            "scenario": {plan.scene.name: _plain(plan) for plan in plans},
            "definition": [str(each) for each in self.definitions],
            "gnss": [str(each) for each in self.gnss],
            "solver": [str(each) for each in self.solvers],
            "dynamics": DYNAMICS,
            "preset": "paper" if self.paper else None,
            "sigma_m": self.sigma_m,
            "eta": self.eta,
            "seed": self.seed,
            "runs": runs,
        }

    def _template(self, name: str) -> Plan:
        """Scene and times. The paper's scenes draw their fleets; others say who flies."""
        base = Plan(circle(), sigma_m=self.sigma_m, eta=self.eta, seed=self.seed)
        if name == "circle8":
            return base
        if name == "square24":
            return replace(base, scene=square())
        scenario = resolve_scenario(name)
        scene: Scene = scene_of(scenario, self.sigma_m)
        return replace(base, scene=scene, duration_s=scenario.duration_s, interval_s=scenario.interval_s)

    def _plan(self, template: Plan, definition: Definition, gnss: ErrorModel, solver: SolverKind) -> Plan:
        plan = replace(
            template, definition=definition, errors=gnss, bound_sigmas=PAIR_READING_SIGMAS if self.paper else 3.0
        )
        if solver is SolverKind.ROTATION:
            return replace(plan, settings=RotationSettings.paper())
        if solver is SolverKind.HALFPLANE:
            return replace(plan, settings=IDEAL_HALFPLANES)
        sigma_m = self.sigma_m if plan.scene.sigma_m is None else float(plan.scene.sigma_m.max())
        graded = graded_plan(plan.scene, GradedSettings.g2(), sigma_m=sigma_m)
        # Its constants are shares of three sigma of both.
        return replace(
            plan, settings=graded.settings, filtered=graded.filtered, bound_sigmas=graded.bound_sigmas,
            obstacle_bound_m=graded.obstacle_bound_m,
        )  # fmt: skip


def _plain(plan: Plan) -> dict[str, Any]:
    """Geometry and times of a scenario, for JSON."""
    scene = {
        name: value.tolist() if hasattr(value, "tolist") else value
        for name in Scene.__slots__
        if (value := getattr(plan.scene, name)) is not None
    }
    return {**scene, "duration_s": plan.duration_s, "interval_s": plan.interval_s}
