"""Options of a campaign, converted to plans, and to the configuration that its folder keeps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from itertools import product
from typing import Any

import numpy as np

from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.campaign.cell import BASELINE
from ridlink.campaign.chance import CORRELATION_TIME_S, PAPER_MEAN_SPEED_MPS, ErrorModel
from ridlink.campaign.channel import Channel
from ridlink.campaign.plan import IDEAL_HALFPLANES, PAIR_READING_SIGMAS, Plan, baseline, graded_plan
from ridlink.campaign.response import Dynamics
from ridlink.campaign.scene import Scene, circle, drawn_scene, not_flown, scene_of
from ridlink.errors import ConfigError
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION
from ridlink.scenario import resolve_scenario
from ridlink.separation.definitions import Definition
from ridlink.separation.reference import CATEGORIES, REPORT_INTERVAL_S
from ridlink.technologies import TECHNOLOGIES

GRADED: dict[str, Callable[[], GradedSettings]] = {
    "graded": GradedSettings.g2, "g2": GradedSettings.g2, "g3": GradedSettings.g3,
    "k": GradedSettings.k, "k2": GradedSettings.k2,
}  # fmt: skip
"""Names of the graded solver, with the constants of each."""

SOLVERS = ("halfplane", *GRADED, "rotation")

REAL_SPEED_MPS = 10.0
"""Cruise speed of drawn fleets that respond as autopilots: the fastest at which responses were measured."""

SLOWEST_PACE = 0.25
"""A flight is cut off after the time that its way takes at this share of its speed."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """What all cells of a campaign have in common.

    Args:
        paper: The paper's simulation: error bounds of three sigma for a pair, not for each vehicle (except under
            `graded`); decisions on every report, and discs that allow for the time between two; collisions judged only
            at the instants of decisions.
        eta: For the definition `chance`.
        accuracy_convention: For the definition `odid-accuracy`, by name.
        seed: Seed of all draws.
        technology: One of `TECHNOLOGIES`, for values that are not given.
        range_m: Radio range.
        latency_s: Time from sending to receipt, between the two values.
        burst: Mean number of reports lost in a row; None: independent losses.
        stock_share: Share of vehicles that send standard Remote ID only.
        unresponsive_share: Share of vehicles that avoid nobody.
        category: Category of Table III, for drawn fleets.
        speed_mps: Cruise speed of all vehicles, for drawn fleets.
        correlation_s: Time constant of Gauss-Markov errors.
        common_share: Part of the variance of the errors that all vehicles share.
        bias_m: Offset for the whole flight that no reported bound covers, one standard deviation per axis.
        filtered: Smooth reported positions; None: under `graded` only.
    """

    paper: bool = False
    eta: float = 0.999
    accuracy_convention: str = DEFAULT_CONVENTION
    seed: int = 1
    technology: str = "ideal"
    range_m: float | None = None
    latency_s: tuple[float, float] | None = None
    burst: float | None = None
    stock_share: float = 0.0
    unresponsive_share: float = 0.0
    category: int | None = None
    speed_mps: float | None = None
    correlation_s: float = CORRELATION_TIME_S
    common_share: float = 0.0
    bias_m: float = 0.0
    filtered: bool | None = None


@dataclass(frozen=True, slots=True)
class Choice:
    """The cells of a campaign: all combinations of the options.

    Args:
        scenarios: Names or paths of files.
        definitions: Names of separation definitions; `none` is the baseline without avoidance.
        gnss: Error models: how sigma becomes a position error.
        solvers: Solvers, by the names in `SOLVERS`.
        dynamics: How vehicles respond to commands.
        sigmas_m: Standard deviations, if the scenario has none.
        intervals_s: Times between two reports; empty: that of the scenario, or of the technology if that is longer.
        losses: Shares of reports that are lost; empty: that of the technology.
        points: Pairs of definition and solver; empty: every definition under every solver.
        conditions: Conditions of all cells.
    """

    scenarios: tuple[str, ...]
    definitions: tuple[str, ...]
    gnss: tuple[ErrorModel, ...]
    solvers: tuple[str, ...]
    dynamics: tuple[Dynamics, ...] = (Dynamics.IDEAL,)
    sigmas_m: tuple[float, ...] = (10.0,)
    intervals_s: tuple[float, ...] = ()
    losses: tuple[float, ...] = ()
    points: tuple[tuple[str, str], ...] = ()
    conditions: Conditions = field(default_factory=Conditions)

    def plans(self) -> list[Plan]:
        """One plan per cell.

        Raises:
            ConfigError: If a scenario is unknown, wrong, or has the name of another, or options contradict each other.
            OSError: If a file cannot be read.
        """
        technology = TECHNOLOGIES[self.conditions.technology]
        losses = self.losses or (technology.loss,)
        if self.conditions.burst is not None and not any(losses):
            raise ConfigError("nothing is lost, in bursts or singly; --loss-burst goes with a --loss above 0")
        plans: dict[Any, Plan] = {}
        named: dict[str, str] = {}
        points = self.points or tuple((each, solver) for solver in self.solvers for each in self.definitions)
        for name, sigma_m in product(dict.fromkeys(self.scenarios), self.sigmas_m):
            template = self._template(name, sigma_m)
            if named.setdefault(template.scene.name, name) != name:
                raise ConfigError(f"two scenarios have the name '{template.scene.name}'; give each its own")
            for gnss, dynamics, interval_s, loss, (definition, solver) in product(
                self.gnss, self.dynamics, self.intervals_s or (max(template.interval_s, technology.period_s),),
                losses, points,
            ):  # fmt: skip
                plan = self._plan(replace(template, errors=gnss, dynamics=dynamics), interval_s, loss)
                plan = self._solved(plan, solver)
                plan = baseline(plan) if definition == BASELINE else replace(plan, definition=Definition(definition))
                plans[plan.cell] = plan
        return list(plans.values())

    def configuration(self, plans: Sequence[Plan], runs: int) -> dict[str, Any]:
        """The configuration: everything that the rows depend on."""
        conditions = asdict(self.conditions)
        if self.conditions.accuracy_convention == DEFAULT_CONVENTION:  # as in older folders, without this choice
            del conditions["accuracy_convention"]
        return {
            "ridlink": version("ridlink"),
            "scenario": {
                plan.scene.name: _plain(plan) for plan in sorted(plans, key=lambda plan: not plan.nobody_avoids)
            },
            "definition": list(self.definitions),
            "gnss": [str(each) for each in self.gnss],
            "solver": list(self.solvers),
            **({"point": ["/".join(point) for point in self.points]} if self.points else {}),
            "dynamics": [str(each) for each in self.dynamics],
            **({} if conditions["paper"] else {"swept": True}),  # as in older folders of the preset
            "preset": "paper" if conditions.pop("paper") else None,
            "sigma_m": list(self.sigmas_m),
            "interval_s": list(dict.fromkeys(plan.interval_s for plan in plans)),
            "loss": list(dict.fromkeys(plan.channel.loss for plan in plans)),
            **conditions,
            "runs": runs,
        }

    def left_out(self) -> list[str]:
        """One line for each content of scenario files that a campaign ignores.

        Raises:
            ConfigError: If a file is not a scenario.
        """
        files = [resolve_scenario(name) for name in self.scenarios if drawn_scene(name) is None]
        found = [(scenario.name, ", ".join(not_flown(scenario))) for scenario in files]
        return [f"{name}: a campaign leaves out {what}; 'ridlink demo' flies with it" for name, what in found if what]

    def _template(self, name: str, sigma_m: float) -> Plan:
        """Scene and times. The paper's scenes draw their fleets; scenario files contain theirs."""
        conditions = self.conditions
        base = Plan(
            circle(), sigma_m=sigma_m, eta=conditions.eta, accuracy_convention=conditions.accuracy_convention,
            seed=conditions.seed, category=conditions.category,
            stock_share=conditions.stock_share, unresponsive_share=conditions.unresponsive_share,
            correlation_s=conditions.correlation_s, common_share=conditions.common_share, bias_m=conditions.bias_m,
            range_m=conditions.range_m or TECHNOLOGIES[conditions.technology].range_m, swept=not conditions.paper,
        )  # fmt: skip
        scene = drawn_scene(name)
        if scene is not None:
            speed_mps = conditions.speed_mps
            if speed_mps is not None and conditions.category is not None:
                raise ConfigError("--speed and --category exclude each other: a category says how fast its fleets fly")
            if speed_mps is None and conditions.category is None and set(self.dynamics) != {Dynamics.IDEAL}:
                speed_mps = REAL_SPEED_MPS
            if speed_mps is not None:
                scene = replace(scene, speed_mps=np.full(len(scene), speed_mps))
            if conditions.category:
                speed_mps = CATEGORIES[conditions.category].cruise_speed_mps
            way_m = float(np.hypot(*(scene.goal_ne_m - scene.start_ne_m).T).max())
            slowest_s = round(way_m / (SLOWEST_PACE * (speed_mps or PAPER_MEAN_SPEED_MPS)))
            return replace(base, scene=scene, duration_s=max(base.duration_s, slowest_s))
        if conditions.speed_mps is not None or conditions.category is not None:
            raise ConfigError(f"{name}: says itself who flies; --speed and --category go with circleN and squareN")
        scenario = resolve_scenario(name)
        return replace(
            base, scene=scene_of(scenario, sigma_m), duration_s=scenario.duration_s, interval_s=scenario.interval_s
        )

    def _plan(self, template: Plan, interval_s: float, loss: float) -> Plan:
        """Times and losses of reports."""
        conditions = self.conditions
        technology = TECHNOLOGIES[conditions.technology]
        try:
            channel = Channel(
                loss, conditions.burst if loss > 0.0 else None, conditions.latency_s or technology.latency_s,
                technology.edge_loss, technology.crowding,
            )  # fmt: skip
        except ValueError as error:
            raise ConfigError(str(error)) from error
        plan = replace(template, interval_s=interval_s, channel=channel)
        is_real = plan.dynamics is not Dynamics.IDEAL
        if conditions.paper and not is_real:
            return plan
        step_s = REPORT_INTERVAL_S if is_real else min(interval_s, REPORT_INTERVAL_S)
        return replace(plan, step_s=step_s, displaced_s=None if conditions.paper else REPORT_INTERVAL_S)

    def _solved(self, plan: Plan, solver: str) -> Plan:
        """The plan under one solver, with the constants for the response of its vehicles."""
        conditions, is_ideal = self.conditions, plan.dynamics is Dynamics.IDEAL
        plan = replace(
            plan, bound_sigmas=PAIR_READING_SIGMAS if conditions.paper else 3.0, filtered=bool(conditions.filtered),
            solver_name=solver,
        )  # fmt: skip
        if solver == "rotation":
            return replace(plan, settings=RotationSettings.paper() if is_ideal else RotationSettings())
        if solver == "halfplane":
            return replace(plan, settings=IDEAL_HALFPLANES if is_ideal else HalfplaneSettings())
        settings, real = GRADED[solver](), GradedSettings()
        if not is_ideal:
            settings = replace(
                settings, response_time_s=real.response_time_s, smoothing=real.smoothing,
                age_acceleration_mps2=real.age_acceleration_mps2,
                arrival_deceleration_mps2=real.arrival_deceleration_mps2,
            )  # fmt: skip
        graded = graded_plan(plan.scene, settings, sigma_m=float(plan.vehicle_sigma_m.max()))
        # Its constants are shares of the three-sigma bounds of both vehicles.
        return replace(
            plan, settings=graded.settings, bound_sigmas=graded.bound_sigmas, obstacle_bound_m=graded.obstacle_bound_m,
            filtered=graded.filtered if conditions.filtered is None else conditions.filtered,
        )  # fmt: skip


def _plain(plan: Plan) -> dict[str, Any]:
    """Geometry and times of a scenario, for JSON."""
    scene = {
        name: value.tolist() if hasattr(value, "tolist") else value
        for name in Scene.__slots__
        if (value := getattr(plan.scene, name)) is not None
    }
    return {**scene, "duration_s": plan.duration_s}
