"""What may be planned, and the two presets."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from ridlink.avoidance import GradedSettings, RotationSettings, SolverKind
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.plan import Plan, graded_plan, paper_plan
from ridlink.campaign.scene import Scene, circle, drawn_scene, square
from ridlink.campaign_runner.choice import Choice, Conditions
from ridlink.cli.campaign_options import PAPER_DEFINITIONS
from ridlink.errors import ConfigError
from ridlink.scenario import built_in
from ridlink.separation import Definition


@pytest.mark.parametrize(("scene", "name"), [(circle(), "circle8"), (square(), "square24"), (circle(5), "circle8")])
def test_the_geometry_is_that_of_the_emulator(scene, name):
    scenario = built_in(name, len(scene))
    assert np.array_equal(scene.start_ne_m, [vehicle.start_ned_m[:2] for vehicle in scenario.vehicles])
    assert np.array_equal(scene.goal_ne_m, [vehicle.goal_ned_m[:2] for vehicle in scenario.vehicles])
    assert scene.polygons_ne_m == tuple(obstacle.polygon_ne_m for obstacle in scenario.obstacles)


def test_the_papers_preset():
    plan = paper_plan(circle(), Definition.CANDIDATE1)
    assert plan.solver is SolverKind.ROTATION
    assert plan.settings == RotationSettings.paper()
    assert plan.errors is ErrorModel.WHITE_RADIAL
    assert plan.error_bound_m == 15.0
    assert (plan.interval_s, plan.range_m, plan.duration_s, plan.arrived_m) == (0.1, 400.0, 120.0, 5.0)
    assert not plan.filtered and not plan.swept


def test_the_command_flies_the_papers_preset():
    """In the words of the options it is made a second time, from parts that other campaigns share."""
    choice = Choice(
        ("circle8", "square24"), tuple(map(Definition, PAPER_DEFINITIONS)), (ErrorModel.WHITE_RADIAL,), ("rotation",),
        conditions=Conditions(paper=True),
    )  # fmt: skip
    plans = choice.plans()
    assert len(plans) == 2 * len(PAPER_DEFINITIONS)
    for plan in plans:
        paper = paper_plan(plan.scene, plan.definition)
        differs = {item.name for item in fields(Plan) if getattr(plan, item.name) != getattr(paper, item.name)}
        assert differs == {"solver_name"}


def test_the_graded_preset_reports_three_sigma_and_filters():
    plan = graded_plan(circle(), GradedSettings.k2(), errors=ErrorModel.BIAS)
    assert plan.solver is SolverKind.GRADED
    assert (plan.error_bound_m, plan.obstacle_bound_m, plan.filtered) == (30.0, 25.0, True)
    assert Plan(circle()).solver is SolverKind.HALFPLANE


def test_the_accuracy_code_of_three_sigma_is_a_little_worse_than_it():
    """30 m of three sigma are a 95 % radius of 24.5 m, which is sent as "below 30 m"."""
    assert Plan(circle()).accuracy_bound_m == pytest.approx(30.0 * 1.2256, abs=0.01)
    assert math.isnan(Plan(circle(), sigma_m=1e5).accuracy_bound_m)


@pytest.mark.parametrize(
    ("name", "value"),
    [("duration_s", 0.0), ("interval_s", math.nan), ("range_m", -1.0), ("arrived_m", math.inf), ("sigma_m", -1.0),
     ("bound_sigmas", math.nan), ("obstacle_bound_m", -2.0), ("seed", -1)],
)  # fmt: skip
def test_a_plan_refuses_what_cannot_be_flown(name, value):
    with pytest.raises(ValueError, match=f"{name}.*{value}"):
        replace(Plan(circle()), **{name: value})
    with pytest.raises(ValueError, match="candidate9"):
        Plan(circle(), definition="candidate9")


def test_a_scene_refuses_what_does_not_fit():
    place = np.zeros((2, 2))
    with pytest.raises(ValueError, match=r"goal_ne_m.*\(3, 2\)"):
        Scene("x", place, np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"start_ne_m.*nan"):
        Scene("x", place + math.nan, place)
    with pytest.raises(ValueError, match=r"speed_mps.*-1"):
        Scene("x", place, place, speed_mps=np.array([1.0, -1.0]))
    with pytest.raises(ValueError, match="cooperative"):
        Scene("x", place, place, cooperative=np.array([True]))
    with pytest.raises(ValueError, match="each side: got 10"):
        square(10)


def test_a_name_draws_the_papers_scene_or_one_of_another_size():
    assert drawn_scene("circle8").name == "circle8" and len(drawn_scene("square24")) == 24
    wide = drawn_scene("circle16@200")
    assert (wide.name, len(wide)) == ("circle16@200", 16)
    assert np.allclose(np.hypot(*wide.start_ne_m.T), 200.0) and np.allclose(wide.goal_ne_m, -wide.start_ne_m)
    large = drawn_scene("square32@900")
    assert np.abs(large.start_ne_m).max() == 450.0 and np.abs(large.polygons_ne_m[0]).max() == 60.0
    assert drawn_scene("head-on") is None and drawn_scene("circle") is None and drawn_scene("circle8@-1") is None


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("circle1", "2 to 1000 vehicles, not 1"),
        ("circle999999999", "2 to 1000 vehicles, not 999999999"),
        ("square10", "give a multiple of 4"),
        ("circle100@10", "start 0.63 m apart, airframes of 7.5 m touch"),
        ("square24@40", "start 4.71 m apart, airframes of 7.5 m touch"),
        ("circle8@0", "radius must be positive"),
        ("circle8@999999999", "radius must be positive, and at most 1e"),
        ("square8@0.0", "side must be positive"),
    ],
)
def test_a_scene_that_cannot_be_drawn_is_refused_with_its_name(name, why):
    with pytest.raises(ConfigError, match=f"^{name}: .*{why}"):
        drawn_scene(name)
