"""Flights in virtual time: reproducible row by row, and with the outcome that the paper's simulation has.

Short versions of `python -m tests.avoidance.study_paper`; the seed is the plan's, 1.
"""

from dataclasses import replace

import numpy as np
import pytest

from ridlink.avoidance import GradedSettings, Obstacles, OwnShip, RotationSettings, Traffic, rows
from ridlink.avoidance.solver import new_solver
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.deciding import new_decider
from ridlink.campaign.flight import fly
from ridlink.campaign.plan import IDEAL_HALFPLANES, Plan, graded_plan, paper_plan
from ridlink.campaign.scene import Scene, circle, square
from ridlink.campaign.worlds import Outcomes
from ridlink.separation import Definition
from tests.campaign.outcomes import assert_same_rows

SETTINGS = {"halfplane": IDEAL_HALFPLANES, "graded": GradedSettings.g2(), "rotation": RotationSettings.paper()}
EACH = pytest.mark.parametrize("name", list(SETTINGS))
PAPER_ORDER = (Definition.SNMAC, Definition.CANDIDATE2, Definition.CANDIDATE1, Definition.REMOTE_ID)


@EACH
def test_a_run_is_the_same_alone_and_in_any_batch(name):
    plan = Plan(square(), settings=SETTINGS[name], filtered=name == "graded", duration_s=40.0)
    together = fly(plan, range(3, 8))
    assert_same_rows(together, fly(plan, range(3, 8), batch=2))
    alone = fly(plan, range(6, 7))
    assert np.array_equal(alone.arrival_s[0], together.arrival_s[3])
    assert alone.distance_m[0] == together.distance_m[3]
    assert alone.decisions[0] == together.decisions[3]


@EACH
def test_worlds_may_be_divided_among_threads(name):
    """Each of them looks up ways on a map of its own."""
    random = np.random.default_rng(8)
    shape = (50, 9)
    walls = Obstacles.from_polygons([[(-20, -20), (20, -20), (20, 20), (-20, 20)]])
    own = np.zeros((*shape, rows.OWN_COLUMNS))
    own[..., 0:2], own[..., 2:4] = random.uniform(-90.0, 90.0, (*shape, 2)), random.uniform(-7.0, 7.0, (*shape, 2))
    own[..., 6:8] = random.uniform(-90.0, 90.0, (*shape, 2))
    own[..., rows.LIMIT], own[..., rows.CRUISE], own[..., rows.CLEARANCE] = 10.0, 10.0, 5.0
    heard = np.full((*shape, 8), np.nan)
    heard[..., 0:4], heard[..., 6:8] = own[..., 0:4], (0.3, 1.0)
    radius, everybody = np.full((*shape, shape[1]), 24.0), np.ones(shape, np.bool_)
    found = []
    for threads in (1, 2):
        decider = new_decider(SETTINGS[name], shape, walls, threads=threads)
        decider.decide(own, everybody, heard, everybody, radius, radius - 3.0, 180.0)
        decider.keep(np.arange(shape[0]) != 1)
        left = np.arange(shape[0]) != 1
        found.append(
            decider.decide(
                own[left], everybody[left], heard[left], everybody[left], radius[left], radius[left] - 3.0, 180.0
            )
        )
    assert np.array_equal(*found)


@EACH
def test_a_batch_decides_as_the_solver_of_one_own_ship_does(name):
    random = np.random.default_rng(8)
    shape = (3, 9)
    walls = Obstacles.from_polygons([[(-20, -20), (20, -20), (20, 20), (-20, 20)]])
    own = np.zeros((*shape, rows.OWN_COLUMNS))
    own[..., 0:2] = random.uniform(-150.0, 150.0, (*shape, 2))
    own[..., 2:4] = own[..., 4:6] = random.uniform(-7.0, 7.0, (*shape, 2))
    own[..., 6:8] = random.uniform(-150.0, 150.0, (*shape, 2))
    own[..., rows.LIMIT], own[..., rows.CRUISE], own[..., rows.CLEARANCE] = 12.0, 10.0, 8.0
    heard = np.full((*shape, 8), np.nan)
    heard[..., 0:4], heard[..., 6], heard[..., 7] = own[..., 0:4], 0.3, True
    present = random.uniform(size=shape) < 0.9
    radius = np.full((*shape, shape[1]), 24.0)
    result = new_decider(SETTINGS[name], shape, walls).decide(own, present, heard, present, radius, radius - 3.0, 180.0)
    solver = new_solver(name, SETTINGS[name])
    for world in range(shape[0]):
        for i in np.flatnonzero(present[world]):
            row = own[world, i]
            near = np.hypot(*(own[world, :, 0:2] - row[0:2]).T) <= 180.0
            others = [j for j in np.flatnonzero(present[world] & near) if j != i]
            count = len(others)
            crowd = Traffic(
                heard[world, others, 0:2], heard[world, others, 2:4], np.full((count, 2), np.nan),
                np.full(count, 0.3), np.full(count, 24.0), np.full(count, 21.0), np.ones(count, bool),
                np.zeros(count, np.int8),
            )  # fmt: skip
            decision = solver.solve(
                OwnShip(row[0:2], row[2:4], row[4:6], 1.0, 12.0), crowd, goal_ne_m=row[6:8], cruise_mps=10.0,
                obstacles=walls, own_clearance_m=8.0,
            )  # fmt: skip
            answer = result[world, i]
            assert np.array_equal(answer[0:2], decision.velocity_ne_mps)
            assert np.array_equal(answer[2:4], decision.command_ne_mps)
            assert answer[rows.R_STATUS] == decision.status
            if name != "rotation":  # which says no more than that to a campaign
                assert [int(j) for j in answer[11:14] if j >= 0] == [others[j] for j in decision.binding]


# --- the paper's simulation -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def paper():
    cells = {}
    for scene, runs in ((circle(), range(100)), (square(), range(30))):
        for definition in PAPER_ORDER:
            cells[scene.name, definition] = fly(paper_plan(scene, definition), runs)
    return cells


@pytest.mark.parametrize("scene", ["circle8", "square24"])
def test_smaller_discs_make_faster_flights(paper, scene):
    medians = [np.median(paper[scene, definition].mission_s) for definition in PAPER_ORDER]
    assert medians == sorted(medians)
    assert len(set(medians)) == 4


@pytest.mark.parametrize(
    ("scene", "definition", "low", "high"),
    [
        ("circle8", Definition.REMOTE_ID, 1.7, 2.3),
        ("circle8", Definition.CANDIDATE1, 1.15, 1.27),
        ("square24", Definition.REMOTE_ID, 2.2, 2.7),
        ("square24", Definition.CANDIDATE1, 1.22, 1.34),
    ],
)
def test_mission_times_by_those_of_snmac(paper, scene, definition, low, high):
    ratio = np.median(paper[scene, definition].mission_s) / np.median(paper[scene, Definition.SNMAC].mission_s)
    assert low <= ratio <= high


@pytest.mark.parametrize("scene", ["circle8", "square24"])
def test_only_snmac_collides(paper, scene):
    rates = {each: paper[scene, each].macs / paper[scene, each].flights for each in PAPER_ORDER}
    assert 0.02 <= rates[Definition.SNMAC] <= 0.08
    assert rates[Definition.REMOTE_ID] == 0.0
    assert max(rates[Definition.CANDIDATE1], rates[Definition.CANDIDATE2]) <= 0.003


def test_everybody_ends_somewhere(paper):
    for out in paper.values():
        assert out.arrived + out.macs + out.unfinished == out.flights
        assert out.unfinished <= 0.002 * out.flights
        assert np.all((out.margin_m < 0.0) == out.collided.any(axis=1))


# --- the graded solver against it -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("errors", "gain_s"), [(ErrorModel.WHITE, 2.0), (ErrorModel.GAUSS_MARKOV, 0.9), (ErrorModel.BIAS, 0.7)]
)
def test_graded_is_faster_in_the_square_than_candidate_2_and_collides_no_more(errors, gain_s):
    runs = range(25)
    fast = fly(graded_plan(square(), errors=errors), runs)
    slow = fly(replace(paper_plan(square(), Definition.CANDIDATE2), errors=errors), runs)
    assert np.median(fast.mission_s) < np.median(slow.mission_s) - gain_s
    assert fast.macs <= slow.macs
    assert fast.arrived == fast.flights - fast.macs


@pytest.mark.parametrize("settings", [GradedSettings.g2(), GradedSettings.k(), GradedSettings.k2()])
def test_graded_lets_eight_through_one_point(settings):
    out = fly(graded_plan(circle(), settings, errors=ErrorModel.GAUSS_MARKOV), range(60))
    assert out.macs == 0
    assert out.arrived == out.flights
    assert np.median(out.mission_s) < 9.0


def test_without_the_clamp_of_the_crowd_a_small_circle_passes_nearer():
    nearest = []
    for crowd_from in (7.0, 1.0):
        settings = replace(GradedSettings.g2(), crowd_from=crowd_from)
        out = fly(graded_plan(circle(5, 80.0), settings, errors=ErrorModel.BIAS), range(100))
        nearest.append(np.mean(out.distance_m))
    assert nearest[0] > nearest[1] + 1.0


# --- what else may be flown -------------------------------------------------------------------------------------------


def test_half_planes_fly_the_same_worlds():
    out = fly(Plan(square(), errors=ErrorModel.WHITE, filtered=True), range(4))
    assert out.macs == 0
    assert out.arrived == out.flights


@pytest.mark.parametrize("definition", list(Definition))
def test_every_definition_can_be_flown(definition):
    out = fly(paper_plan(circle(4), definition), range(4))
    assert out.arrived + out.macs == out.flights


def test_a_scene_may_say_who_flies_and_who_avoids_nobody():
    start, goal = np.array([[-150.0, 0.0], [150.0, 0.0]]), np.array([[150.0, 0.0], [-150.0, 0.0]])
    size, pace = np.array([1.0, 2.0]), np.array([10.0, 15.0])
    scene = Scene("head-on", start, goal, speed_mps=pace, airframe_m=size, cooperative=np.array([True, False]))
    out = fly(Plan(scene, settings=RotationSettings.paper(), sigma_m=0.0, duration_s=60.0), range(1))
    assert out.arrival_s[0, 1] == pytest.approx(19.7, abs=0.11)
    assert out.distance_m[0] > 1.5
    blind = replace(scene, cooperative=np.array([False, False]))
    crash = fly(Plan(blind, settings=RotationSettings.paper(), sigma_m=0.0, swept=True), range(1))
    assert crash.macs == 2
    assert crash.mission_s.size == 0


def test_who_does_not_arrive_counts_with_the_cut_off():
    out = fly(replace(paper_plan(circle(), Definition.REMOTE_ID), duration_s=5.0), range(2))
    assert out.unfinished == 16
    assert out.mission_s.tolist() == [5.0] * 16


def test_runs_that_are_none_are_refused():
    plan = paper_plan(circle(), Definition.SNMAC)
    for runs, batch in ((range(0), 8), (range(-1, 3), 8), (range(3), 0)):
        with pytest.raises(ValueError, match="runs"):
            fly(plan, runs, batch=batch)
    with pytest.raises(ValueError, match="no runs"):
        Outcomes.joined([])
