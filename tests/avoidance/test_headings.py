"""The two solvers that choose among headings: held against the published formulae, and properties of every answer."""

import math
import os
import subprocess
import sys
from dataclasses import fields, replace

import numba
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ridlink.avoidance import (
    GradedSettings,
    HalfplaneSettings,
    Obstacles,
    OwnShip,
    RotationSettings,
    SolverKind,
    Status,
    Traffic,
    graded,
    rotation,
    rows,
    walls,
)
from ridlink.avoidance.obstacles import NO_OBSTACLES
from ridlink.avoidance.solver import GradedSolver, HalfplaneSolver, RotationSolver, new_solver, warm_up
from ridlink.campaign.deciding import new_decider
from tests.avoidance.encounters import SQUARE, coordinate, crowd, drawn_crowd, own_ship, solve, speed, traffic, turned
from tests.avoidance.lockstep import signed_distance
from tests.avoidance.reference_rotation import straightforward

PAPER = RotationSolver(RotationSettings.paper())
G2 = GradedSolver(GradedSettings.g2())
ROTATION, GRADED = RotationSolver(), GradedSolver()
BOTH = pytest.mark.parametrize("solver", [ROTATION, GRADED], ids=["rotation", "graded"])
IDEAL = pytest.mark.parametrize("solver", [PAPER, G2], ids=["rotation", "graded"])

seeds = st.integers(0, 2**32 - 1)
"""Worlds are drawn from these, so that knife edges (two headings equally good) have no part in them."""


# --- against the published formulae -----------------------------------------------------------------------------------


def rotation_by_the_paper(velocity, goal, rows, radius, pace):
    """PAPER: candidates clockwise by 10 k degrees at min(V, g / dt); approach-gated test; worst f in the fallback."""
    away = math.hypot(*goal)
    flown = min(pace, away / 0.1)
    straight = np.array(goal) / away
    options = []
    for k in range(36):
        unit = turned(straight, math.radians(10.0 * k))
        left = math.radians(10.0 * (36 - k)) if k > 18 else 0.0
        cost = np.linalg.norm(unit - straight) + 2.0 * left
        worst = 1e3
        for north, east, u_north, u_east in rows:
            r, w = np.array([north, east]), 2.0 * flown * unit - velocity - (u_north, u_east)
            if r @ w > 0.0:
                worst = min(worst, abs(r[0] * w[1] - r[1] * w[0]) / np.linalg.norm(w) - radius)
        options.append((worst >= 0.0, cost, worst, flown * unit))
    clear = [option for option in options if option[0]]
    return min(clear, key=lambda o: o[1])[3] if clear else max(options, key=lambda o: o[2] - 0.001 * o[1])[3]


@settings(max_examples=150, deadline=None)
@given(seeds, st.floats(5.0, 90.0), st.floats(0.2, 400.0))
def test_rotation_is_what_the_paper_describes(seed, radius, away):
    rows = drawn_crowd(seed)
    goal = turned([away, 0.0], 0.1 + seed % 7)
    own = own_ship(velocity=(6.0, -7.0), limit=9.5)
    wanted = rotation_by_the_paper(own.velocity_ne_mps, goal, rows, radius, 9.5)
    decision = solve(own, traffic(*rows, radius=radius), PAPER, goal_ne_m=goal)
    assert decision.velocity_ne_mps == pytest.approx(wanted, abs=1e-9)
    assert decision.command_ne_mps == pytest.approx(wanted, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    seeds, st.integers(1, 30), st.floats(2.0, 160.0), st.floats(20.0, 400.0), st.booleans(), st.booleans(),
    st.sampled_from([RotationSettings.paper(), RotationSettings(), RotationSettings(step_deg=5.0)]),
)  # fmt: skip
def test_rotation_decides_as_if_it_tried_every_heading_on_everybody(
    seed, count, radius_m, range_m, crowded, walled, chosen
):
    """To the last bit, feasible or not, for all vehicles of a world at once."""
    random = np.random.default_rng(seed)
    shape, extent = (1, count), 80.0 if crowded else 300.0
    own = np.zeros((*shape, rows.OWN_COLUMNS))
    own[..., 0:2] = random.uniform(-extent, extent, (*shape, 2))
    own[..., 2:4] = random.uniform(-12.0, 12.0, (*shape, 2))
    own[..., 4:6] = own[..., 2:4] + random.uniform(-1.0, 1.0, (*shape, 2))
    own[..., 6:8] = random.uniform(-300.0, 300.0, (*shape, 2))
    own[..., rows.LIMIT], own[..., rows.CRUISE], own[..., rows.CLEARANCE] = 11.0, 10.0, 7.0
    heard = np.full((*shape, 8), np.nan)
    heard[..., 0:4], heard[..., 6] = own[..., 0:4], random.uniform(0.0, 1.0, shape)
    heard[..., 7] = random.random(shape) < 0.8
    present = random.random(shape) < 0.9
    radius = radius_m * random.uniform(0.5, 1.0, (*shape, count))
    walls = SQUARE if walled else NO_OBSTACLES
    result = new_decider(chosen, shape, walls).decide(own, present, heard, present, radius, radius, range_m)
    for i in np.flatnonzero(present[0]):
        others = [j for j in np.flatnonzero(present[0]) if j != i]
        velocity, feasible = straightforward(own[0, i], heard[0, others], radius[0, i, others], range_m, walls, chosen)
        assert np.array_equal(result[0, i, 0:2], velocity)
        assert (result[0, i, rows.R_STATUS] != rows.INFEASIBLE) == feasible


def g2_costs(velocity, goal, rows, base, pace):
    """Headings of design G2 with their costs, computed in its own axes: x forward, y to the left, left positive."""

    def plane(pair):
        return complex(pair[0], -pair[1])

    def cross(a, b):
        return (a.conjugate() * b).imag

    def dot(a, b):
        return (a.conjugate() * b).real

    g, v_i = abs(plane(goal)), plane(velocity)
    u, s = plane(goal) / g, min(pace, g / 0.1)
    radius = base + 12.5 + 9.0 * math.log(max(len(rows), 7) / 7.0)
    others = [(plane(row[:2]), plane(row[2:])) for row in rows]
    beta = 0.0
    for r, v_j in others:
        w = s * u - v_j
        if 0.0 < dot(r, w) / abs(w) ** 2 < 6.5 and abs(cross(r, w)) / abs(w) < 2.0 * radius:
            beta = 0.44
    right = [*range(0, 75, 5), 85, 100, 120, 140, 160, 180]
    left = [5, 10, 15, 20, 25, 30, 40, 50, 60, 75, 90, 110, 135]
    found = []
    for degrees in [-turn for turn in right] + left:
        a = math.radians(degrees)
        v = s * u * complex(math.cos(a), math.sin(a))
        t, look = a + beta, min(1.5, 0.9 * g / pace)
        q = s * look
        cost = 1.0 + (math.sqrt(g * g - 2.0 * g * q * math.cos(t) + q * q) - g) / (pace * look)
        cost += 0.8 * max(0.0, t) + 0.1 * abs(v - v_i) / pace
        for r, v_j in others:
            w = 2.0 * v - v_i - v_j
            if dot(r, w) <= 0.0:
                continue
            entry = max(0.0, dot(r, w) / abs(w) ** 2 - radius / abs(w))
            h = abs(cross(r, w)) / abs(w) - radius
            rho = math.exp(-entry / 5.0) * (math.exp(-((h / 8.2) ** 2) / 2.0) if h > 0.0 else 1.0 - h / 8.2)
            cost += 1.05 * rho * (2.7 if cross(r, w) > 0.0 else 1.0)
        found.append((cost, np.array([v.real, -v.imag])))
    return found


@settings(max_examples=150, deadline=None)
@given(seeds, st.floats(5.0, 400.0))
@example(502, 97.0)
def test_graded_is_the_design_that_was_measured(seed, away):
    """A pair's error sum is 60 m there. Of each neighbour the kernel leaves out a risk of at most 0.001, and a straight
    way without any is flown whatever its smoothness."""
    rows = drawn_crowd(seed, most=20)
    goal = turned([away, 0.0], 0.1 + seed % 7)
    own = own_ship(velocity=(6.0, -7.0), limit=9.5)
    costs = g2_costs(own.velocity_ne_mps, goal, rows, 6.0, 9.5)
    decision = solve(own, traffic(*rows, radius=66.0, error=60.0), G2, goal_ne_m=goal, cruise_mps=9.5)
    chosen = [cost for cost, v in costs if np.allclose(v, decision.velocity_ne_mps, atol=1e-9)]
    assert len(chosen) == 1
    if decision.status is not Status.FREE:
        allowed = 0.001 * len(rows) + 1e-12
        if np.allclose(decision.velocity_ne_mps, costs[0][1], atol=1e-9):  # inside a disc, and leaving it straight on
            allowed += 0.1 * float(np.linalg.norm(decision.velocity_ne_mps - own.velocity_ne_mps)) / 9.5
        assert chosen[0] <= min(cost for cost, _ in costs) + allowed
    else:
        assert chosen[0] <= min(cost for cost, _ in costs) + 0.2
    assert decision.command_ne_mps == pytest.approx(decision.velocity_ne_mps)


# --- every answer -----------------------------------------------------------------------------------------------------


@BOTH
@settings(max_examples=120, deadline=None)
@given(
    rows=crowd, position=st.tuples(coordinate, coordinate), velocity=st.tuples(speed, speed),
    command=st.tuples(speed, speed), age=st.floats(0.0, 10.0), radius=st.floats(0.0, 120.0),
    reciprocal=st.booleans(), walled=st.booleans(), turn=st.floats(-2.0, 2.0), goal=st.tuples(coordinate, coordinate),
    wanted=st.booleans(),
)  # fmt: skip
def test_every_answer_is_finite_and_within_the_limit(
    solver, rows, position, velocity, command, age, radius, reciprocal, walled, turn, goal, wanted
):
    own = own_ship(position, velocity, command, limit=9.0)
    others = traffic(*rows, age=age, radius=radius, error=radius, reciprocal=reciprocal)
    aim = {"goal_ne_m": None, "preferred_ne_mps": goal} if wanted else {"goal_ne_m": goal}
    walls = {"obstacles": SQUARE if walled else None, "own_clearance_m": 12.0}
    decision = solve(own, others, solver, **aim, **walls, extra_right_turn_rad=turn)
    for vector in (decision.velocity_ne_mps, decision.command_ne_mps, decision.preferred_ne_mps):
        assert np.all(np.isfinite(vector))
        assert np.linalg.norm(vector) <= 9.0 + 1e-9
    assert all(0 <= j < len(rows) for j in decision.binding)
    assert len(set(decision.binding)) == len(decision.binding) <= 3
    assert (decision.nearest_index == -1) == (not rows)
    assert decision.passing_side.shape == (len(rows),)
    if decision.status is not Status.INFEASIBLE:
        assert decision.worst_slack_mps >= 0.0


@IDEAL
@settings(max_examples=120, deadline=None)
@given(seed=seeds, angle=st.floats(-math.pi, math.pi), walled=st.booleans())
def test_turning_the_world_turns_the_answer(solver, seed, angle, walled):
    rows = drawn_crowd(seed)
    block = np.array([[60.0, -31.0], [97.0, -22.0], [88.0, 35.0]])
    velocity, goal = np.array([7.0, 3.0]), np.array([300.0, 17.0])
    answers = []
    for turn in (0.0, angle):
        own = own_ship(velocity=turned(velocity, turn))
        others = traffic(*np.hstack([turned(rows[:, :2], turn), turned(rows[:, 2:], turn)]))
        walls = Obstacles.from_polygons([turned(block, turn)]) if walled else None
        answers.append(solve(own, others, solver, goal_ne_m=turned(goal, turn), obstacles=walls, own_clearance_m=5.0))
    straight, around = answers
    assert around.velocity_ne_mps == pytest.approx(turned(straight.velocity_ne_mps, angle), abs=1e-6)
    assert around.command_ne_mps == pytest.approx(turned(straight.command_ne_mps, angle), abs=1e-6)
    assert around.status is straight.status
    assert around.binding == straight.binding
    assert around.worst_slack_mps == pytest.approx(straight.worst_slack_mps, abs=1e-6)


@BOTH
@settings(max_examples=60, deadline=None)
@given(goal=st.tuples(coordinate, coordinate), velocity=st.tuples(speed, speed))
def test_alone_it_flies_straight_to_the_goal(solver, goal, velocity):
    away = math.hypot(*goal)
    decision = solve(own_ship(velocity=velocity), Traffic.empty(), solver, goal_ne_m=goal)
    if away < 1e-3:
        assert np.linalg.norm(decision.velocity_ne_mps) <= 0.4
        return
    flown = np.linalg.norm(decision.velocity_ne_mps)
    assert decision.status is Status.FREE
    assert decision.velocity_ne_mps / flown == pytest.approx(np.array(goal) / away, abs=1e-9)
    assert flown == pytest.approx(min(10.0, away / 0.1, math.sqrt(2.4 * away) + 0.3))


@IDEAL
def test_a_vehicle_that_stops_at_once_keeps_its_speed_to_the_last_step(solver):
    for away, flown in ((100.0, 10.0), (5.0, 10.0), (0.5, 5.0), (0.0, 0.0)):
        decision = solve(own_ship(), Traffic.empty(), solver, goal_ne_m=(0.0, away))
        assert decision.velocity_ne_mps == pytest.approx([0.0, flown])


# --- encounters -------------------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("heading", np.linspace(-math.pi, math.pi, 5))
def test_head_on_each_turns_right(solver, heading):
    velocity = turned([10.0, 0.0], heading)
    right = np.array([-velocity[1], velocity[0]]) / 10.0
    ahead = turned([90.0, 0.0], heading)
    mine = solve(own_ship(velocity=velocity), traffic((*ahead, *-velocity)), solver, goal_ne_m=4.0 * ahead)
    other = solve(own_ship(ahead, -velocity), traffic((0.0, 0.0, *velocity)), solver, goal_ne_m=-4.0 * ahead)
    assert mine.velocity_ne_mps @ right > 1.0
    assert other.velocity_ne_mps @ -right > 1.0
    assert np.linalg.norm(mine.velocity_ne_mps) == pytest.approx(10.0)
    assert mine.status is Status.CONSTRAINED
    assert mine.binding == (0,)


@BOTH
def test_east_is_to_the_right_of_north(solver):
    assert solve(own_ship(), traffic((90.0, 0.0, -10.0, 0.0)), solver).velocity_ne_mps[1] > 1.0


@BOTH
def test_a_free_path_keeps_the_straight_way(solver):
    decision = solve(own_ship(), traffic((-300.0, 0.0, -10.0, 0.0), (0.0, 350.0, 0.0, 10.0)), solver)
    assert decision.status is Status.FREE
    assert decision.velocity_ne_mps == pytest.approx([10.0, 0.0])
    assert decision.binding == ()
    assert math.isinf(decision.worst_slack_mps)


def turn_of(decision):
    return math.degrees(math.atan2(decision.velocity_ne_mps[1], decision.velocity_ne_mps[0]))


@BOTH
def test_a_neighbour_that_avoids_nobody_is_left_more_of_the_work(solver):
    shared = solve(own_ship(), traffic((90.0, 0.0, -10.0, 0.0)), solver)
    alone = solve(own_ship(), traffic((90.0, 0.0, -10.0, 0.0), reciprocal=False), solver)
    assert turn_of(alone) > turn_of(shared) + 4.0


@BOTH
def test_an_old_report_is_extrapolated(solver):
    fresh = solve(own_ship(), traffic((90.0, 0.0, -10.0, 0.0)), solver)
    old = solve(own_ship(), traffic((110.0, 0.0, -10.0, 0.0), age=2.0), solver)
    assert old.nearest_margin_m == pytest.approx(fresh.nearest_margin_m)
    assert turn_of(old) >= turn_of(fresh)
    older = solve(own_ship(), traffic((140.0, 0.0, -10.0, 0.0), age=5.0), solver)
    assert turn_of(older) > turn_of(fresh) + 9.0, "its disc has grown by as much as it may have manoeuvred"


@BOTH
def test_time_margin_and_neighbour_of_the_picture(solver):
    rows = [(300.0, 0.0, 0.0, 0.0), (124.0, 0.0, -10.0, 0.0)]
    decision = solve(own_ship(), traffic(*rows, radius=24.0), solver)
    assert decision.nearest_index == 1
    assert decision.nearest_margin_m == pytest.approx(100.0)
    assert decision.time_to_violation_s == pytest.approx(5.0)


def test_inside_a_disc_exactly_the_velocities_that_do_not_approach_are_allowed():
    """Own-ship at rest: `w = 2 v'`, so every velocity with a component towards the neighbour is out."""
    own = own_ship(velocity=(0.0, 0.0))
    beside = solve(own, traffic((0.5, 10.0, 0.0, 0.0)), PAPER)
    assert beside.status is Status.OVERLAPPED
    assert turn_of(beside) == pytest.approx(-10.0)
    away = solve(own, traffic((10.0, 0.1, 0.0, 0.0)), PAPER)
    assert away.velocity_ne_mps[0] < 0.0
    assert away.time_to_violation_s == 0.0


def test_surrounded_rotation_exceeds_the_worst_disc_least_and_says_so():
    angles = np.arange(12) * math.pi / 6 + 0.1
    ring = [(45.0 * math.cos(a), 45.0 * math.sin(a), -9.0 * math.cos(a), -9.0 * math.sin(a)) for a in angles]
    decision = solve(own_ship(velocity=(0.0, 0.0)), traffic(*ring, reciprocal=False), PAPER)
    assert decision.status is Status.INFEASIBLE
    assert decision.worst_slack_mps < 0.0
    assert len(decision.binding) == 3


def test_the_right_hand_preference_is_no_mirror_symmetry():
    left = solve(own_ship(), traffic((90.0, -4.0, -10.0, 0.0)), G2)
    right = solve(own_ship(), traffic((90.0, 4.0, -10.0, 0.0)), G2)
    assert turn_of(left) > 0.0
    assert turn_of(right) > 0.0


@pytest.mark.parametrize("approaching", [(60.0, 0.0, -10.0, 0.0), (0.0, -60.0, 0.0, 10.0)])
def test_who_stands_at_its_goal_dodges(approaching):
    """At its goal the straight way has no speed, and a neighbour that counts on half of the avoidance is not helped."""
    own = own_ship(velocity=(0.0, 0.0))
    decision = solve(own, traffic(approaching), GRADED, goal_ne_m=(0.0, 0.0))
    assert np.linalg.norm(decision.velocity_ne_mps) > 3.0
    at_rest = solve(own, traffic((200.0, 0.0, 0.0, 10.0)), GRADED, goal_ne_m=(0.0, 0.0))
    assert np.linalg.norm(at_rest.velocity_ne_mps) < 0.4


def test_the_radius_of_a_pair_is_not_smaller_than_that_of_a_crowd_of_seven():
    own, clear = own_ship(), (60.0, 300.0, 0.0, 0.0)
    pair = solve(own, traffic((70.0, 3.0, -10.0, 0.0), radius=66.0, error=60.0), G2)
    seven = solve(own, traffic((70.0, 3.0, -10.0, 0.0), *[clear] * 6, radius=66.0, error=60.0), G2)
    assert np.array_equal(pair.velocity_ne_mps, seven.velocity_ne_mps)


def test_a_slow_vehicle_looks_at_both_ends_of_its_response():
    """Closing fast, the neighbour will be abeam before own-ship obeys: only the later end shows how late it is."""
    own = own_ship(velocity=(10.0, 0.0))
    rows = (55.0, 8.0, -10.0, 0.0)
    late = GradedSolver(replace(GradedSettings.g2(), response_time_s=1.5))
    assert turn_of(solve(own, traffic(rows), late)) > turn_of(solve(own, traffic(rows), G2))


@BOTH
def test_a_neighbour_that_flies_along_at_the_same_velocity_is_no_risk(solver):
    decision = solve(own_ship(), traffic((40.0, 0.0, 10.0 - 1e-10, 0.0), reciprocal=False), solver)
    assert np.linalg.norm(decision.velocity_ne_mps) == pytest.approx(10.0)
    if solver is GRADED:
        assert decision.velocity_ne_mps == pytest.approx([10.0, 0.0])


@BOTH
def test_the_extra_turn_is_to_the_right(solver):
    decision = solve(own_ship(), Traffic.empty(), solver, extra_right_turn_rad=0.5)
    assert math.radians(turn_of(decision)) == pytest.approx(0.5)


def test_the_command_goes_half_of_the_way_for_a_vehicle_that_is_slow_to_obey():
    own = own_ship(velocity=(0.0, 10.0), command=(0.0, 10.0))
    for solver in (ROTATION, GRADED):
        decision = solve(own, Traffic.empty(), solver)
        assert decision.velocity_ne_mps == pytest.approx([10.0, 0.0])
        assert decision.command_ne_mps == pytest.approx([5.0, 5.0])


# --- a preferred velocity instead of a goal ---------------------------------------------------------------------------


@BOTH
def test_a_preferred_velocity_is_flown_as_towards_a_goal_far_away(solver):
    others = traffic((90.0, 3.0, -10.0, 0.0))
    wanted = solve(own_ship(), others, solver, goal_ne_m=None, preferred_ne_mps=(8.0, 0.0))
    goal = solve(own_ship(), others, solver, goal_ne_m=(5e5, 0.0), cruise_mps=8.0)
    assert wanted.velocity_ne_mps == pytest.approx(goal.velocity_ne_mps)
    fast = solve(own_ship(), Traffic.empty(), solver, goal_ne_m=None, preferred_ne_mps=(30.0, 40.0))
    assert fast.velocity_ne_mps == pytest.approx([6.0, 8.0])
    still = solve(own_ship(), others, solver, goal_ne_m=None, preferred_ne_mps=(0.0, 0.0))
    assert still.velocity_ne_mps == pytest.approx([0.0, 0.0])


# --- obstacles --------------------------------------------------------------------------------------------------------


@settings(max_examples=100, deadline=None)
@given(seeds, st.floats(0.0, 30.0))
def test_a_ray_enters_a_grown_polygon_where_its_distance_says(seed, clearance):
    random = np.random.default_rng(seed)
    corner = np.sort(random.uniform(-math.pi, math.pi, 6))  # of a circle: any of them make a convex polygon
    ring = random.uniform(20.0, 40.0) * np.stack([np.cos(corner), np.sin(corner)], axis=1)
    obstacles = Obstacles.from_polygons([ring])
    angle = random.uniform(0.0, 2.0 * math.pi)
    start = 120.0 * np.array([math.cos(angle), math.sin(angle)])
    aim = random.uniform(-60.0, 60.0, 2) - start
    unit = aim / np.linalg.norm(aim)
    vertex, first, last = obstacles.piece_vertex_ne_m, *obstacles.piece_start.tolist()
    hit = walls.ray_to_piece(vertex, first, last, clearance, *start, *unit)
    along = np.linspace(0.0, 300.0, 3001)
    gap = signed_distance(obstacles, start + along[:, None] * unit) - clearance
    if math.isinf(hit):
        assert gap.min() > -0.1
    else:
        assert gap[along < hit - 1e-6].min(initial=1.0) > -1e-6
        assert signed_distance(obstacles, start + (hit + 1e-6) * unit) <= clearance + 1e-5


@BOTH
@settings(max_examples=120, deadline=None)
@given(seed=seeds)
def test_no_velocity_reaches_an_obstacle_within_two_seconds(solver, seed):
    random = np.random.default_rng(seed)
    angle = random.uniform(0.0, 2.0 * math.pi)
    position = random.uniform(72.0, 130.0) * np.array([math.cos(angle), math.sin(angle)])
    own = own_ship(position, velocity=random.uniform(-7.0, 7.0, 2))
    rows = drawn_crowd(seed)
    rows[:, :2] += position
    decision = solve(own, traffic(*rows), solver, goal_ne_m=-position, obstacles=SQUARE, own_clearance_m=12.0)
    for velocity in (decision.velocity_ne_mps, decision.command_ne_mps):
        path = position + np.linspace(0.0, 1.99, 50)[:, None] * velocity
        assert signed_distance(SQUARE, path).min() > 12.0 - 1e-6


@BOTH
def test_an_obstacle_before_the_goal_is_gone_round_and_one_behind_it_does_not_count(solver):
    own = own_ship(position=(-120.0, 0.0))
    walls = {"obstacles": SQUARE, "own_clearance_m": 10.0}
    round_it = solve(own, Traffic.empty(), solver, goal_ne_m=(120.0, 0.0), **walls)
    assert round_it.status is Status.CONSTRAINED
    assert round_it.obstacle_binding
    assert 20.0 < turn_of(round_it) < 60.0
    before = solve(own, Traffic.empty(), solver, goal_ne_m=(-60.0, 0.0), **walls)
    assert before.status is Status.FREE
    assert turn_of(before) == pytest.approx(0.0)


@BOTH
def test_inside_the_clearance_it_leaves_and_the_wall_stays_hard_against_traffic(solver):
    own = own_ship(position=(-45.0, 0.0), velocity=(0.0, 0.0))
    pressing = traffic((-56.0, -5.0, 8.0, 0.0), (-56.0, 5.0, 8.0, 0.0), reciprocal=False)
    for others in (Traffic.empty(), pressing):
        decision = solve(own, others, solver, goal_ne_m=(100.0, 0.0), obstacles=SQUARE, own_clearance_m=12.0)
        assert decision.velocity_ne_mps[0] < 1e-6
        assert decision.command_ne_mps[0] < 1e-6
        assert decision.obstacle_binding
    free = solve(own, Traffic.empty(), solver, goal_ne_m=(-300.0, 0.0), obstacles=SQUARE, own_clearance_m=12.0)
    assert free.status is Status.OVERLAPPED
    assert turn_of(free) == pytest.approx(180.0)


# --- settings and the interface ---------------------------------------------------------------------------------------


def test_the_kernels_read_the_settings_in_field_order():
    names = [item.name for item in fields(GradedSettings)]
    columns = [
        graded.BASE, graded.TAIL_SHARE, graded.CROWD, graded.CROWD_FROM, graded.LEAST_RADIUS, graded.RISK_WEIGHT,
        graded.FADE, graded.WRONG_SIDE, graded.LEAN, graded.LEAN_WITHIN, graded.LEAN_RADII, graded.LEFT_WEIGHT,
        graded.SMOOTHNESS, graded.LOOK_AHEAD, graded.RESPONSE, graded.AGE_ACCELERATION, graded.ARRIVAL,
        graded.SMOOTHING,
    ]  # fmt: skip
    assert columns == list(range(len(names)))
    assert GradedSettings().as_vector().tolist() == [getattr(GradedSettings(), name) for name in names]
    names = [item.name for item in fields(RotationSettings)]
    columns = [
        rotation.STEP, rotation.LEFT_WEIGHT, rotation.COST_WEIGHT, rotation.AGE_ACCELERATION, rotation.ARRIVAL,
        rotation.SMOOTHING,
    ]  # fmt: skip
    assert columns == list(range(len(names)))
    assert RotationSettings().as_vector().tolist() == [getattr(RotationSettings(), name) for name in names]


@pytest.mark.parametrize("kind", [GradedSettings, RotationSettings])
def test_every_setting_refuses_nan_and_a_value_out_of_range(kind):
    for name in (item.name for item in fields(kind)):
        for value in (math.nan, -math.inf, -1.0):
            with pytest.raises(ValueError, match=f"{name}.*{value:g}"):
                replace(kind(), **{name: value})
    for name, value in (("smoothing", 1.5), ("smoothing", 0.0), ("arrival_deceleration_mps2", 0.0)):
        with pytest.raises(ValueError, match=name):
            replace(kind(), **{name: value})


def test_candidates_divide_the_circle():
    for step in (7.0, 0.1, 720.0):
        with pytest.raises(ValueError, match=f"step_deg.*{step:g}"):
            RotationSettings(step_deg=step)
    fan = rotation.candidates(10.0, 2.0)
    assert sorted(np.degrees(fan[:, 2]).round(6)) == [10.0 * k for k in range(-17, 19)]
    assert np.degrees(fan[:3, 2]) == pytest.approx([0.0, 10.0, 20.0])
    with pytest.raises(ValueError, match="lean_rad"):
        GradedSettings(lean_rad=2.0)


def test_the_presets():
    g2, k, k2 = GradedSettings.g2(), GradedSettings.k(), GradedSettings.k2()
    assert 60.0 * np.array([g2.base_share, g2.tail_share, g2.crowd_share]) == pytest.approx([12.5, 8.2, 9.0])
    assert 60.0 * np.array([k.base_share, k.tail_share, k.crowd_share]) == pytest.approx([10.0, 14.0, 6.5])
    assert 60.0 * k2.crowd_share == pytest.approx(15.0)
    assert replace(k2, crowd_share=k.crowd_share, lean_rad=k.lean_rad) == k
    assert GradedSettings().for_an_ideal_vehicle() == g2
    assert {g2.smoothing, k.smoothing, RotationSettings.paper().smoothing} == {1.0}


def test_a_solver_of_every_kind():
    assert isinstance(new_solver(), HalfplaneSolver)
    assert isinstance(new_solver("graded"), GradedSolver)
    assert isinstance(new_solver(SolverKind.ROTATION, RotationSettings.paper()), RotationSolver)
    with pytest.raises(ValueError, match="graded solver has no use for HalfplaneSettings"):
        new_solver(SolverKind.GRADED, HalfplaneSettings())
    with pytest.raises(ValueError, match="oracle"):
        new_solver("oracle")


@BOTH
@pytest.mark.parametrize("name", ["cruise_mps", "own_clearance_m", "extra_right_turn_rad", "goal_ne_m"])
def test_a_value_that_is_not_finite_is_named(solver, name):
    with pytest.raises(ValueError, match=f"{name}.*nan"):
        solve(own_ship(), Traffic.empty(), solver, **{name: (0.0, math.nan) if name == "goal_ne_m" else math.nan})


def test_nothing_that_is_not_finite_gets_as_far_as_a_solver():
    with pytest.raises(ValueError, match=r"position_ne_m.*nan"):
        traffic((math.nan, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"velocity_ne_mps.*inf"):
        OwnShip(np.zeros(2), np.array([math.inf, 0.0]), np.zeros(2), 1.0, 10.0)


@BOTH
def test_equal_questions_get_equal_answers_and_crowds_may_grow(solver):
    rows = drawn_crowd(5, most=9)
    first = solve(own_ship(), traffic(*rows), solver)
    crowded = solve(own_ship(), traffic(*np.tile(rows, (60, 1)) + 0.5), solver, obstacles=SQUARE)
    again = solve(own_ship(), traffic(*rows), solver, obstacles=NO_OBSTACLES)
    assert crowded.passing_side.shape == (60 * len(rows),)
    assert np.array_equal(first.velocity_ne_mps, again.velocity_ne_mps)


def test_the_kernels_are_plain_python_where_compilation_is_off():
    code = (
        "from ridlink.avoidance import GradedSettings, RotationSettings, graded;"
        "from ridlink.avoidance.solver import GradedSolver, RotationSolver;"
        "from tests.avoidance.encounters import SQUARE, drawn_crowd, own_ship, solve, traffic;"
        "solvers = [RotationSolver(RotationSettings.paper()), GradedSolver(GradedSettings.g2())];"
        "assert not hasattr(graded.grade_one, 'py_func');"
        "found = [solve(own_ship((-90.0, 5.0)), traffic(*drawn_crowd(3)), each, obstacles=SQUARE, own_clearance_m=9.0)"
        ".velocity_ne_mps.tolist() for each in solvers];"
        "print(found)"
    )
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    plain = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True)
    own, others = own_ship((-90.0, 5.0)), traffic(*drawn_crowd(3))
    compiled = [
        solve(own, others, each, obstacles=SQUARE, own_clearance_m=9.0).velocity_ne_mps.tolist() for each in (PAPER, G2)
    ]
    assert np.array(eval(plain.stdout)) == pytest.approx(np.array(compiled), abs=1e-9)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_warming_up_one_solver_compiles_it_and_no_other():
    code = (
        "from ridlink.avoidance import graded, halfplane, rotation;"
        "from ridlink.avoidance.solver import warm_up;"
        "warm_up('graded');"
        "print([len(each.signatures) for each in (graded.grade_one, halfplane.avoid_one, rotation.rotate_one)])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[1, 0, 0]"
    warm_up("graded")
    solve(own_ship(), traffic((150.0, 5.0, -10.0, 0.0)), GRADED, obstacles=SQUARE, own_clearance_m=5.0)
    solve(own_ship(), Traffic.empty(), GRADED, goal_ne_m=None, preferred_ne_mps=(1.0, 0.0))
    assert len(graded.grade_one.signatures) == 1
