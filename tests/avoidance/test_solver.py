"""One decision of one own-ship: properties that hold for every input, and the rules of the road."""

import math
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ridlink.avoidance import HalfplaneSettings, Memory, Status, Traffic
from ridlink.avoidance.halfplane import avoid_one
from ridlink.avoidance.rows import LANES
from ridlink.avoidance.solver import HalfplaneSolver, warm_up
from ridlink.avoidance.turning import buffer_growth
from tests.avoidance.encounters import (
    GOAL,
    SOLVER,
    SQUARE,
    coordinate,
    crowd,
    neighbour,
    own_ship,
    solve,
    speed,
    traffic,
    turned,
)


@settings(max_examples=200, deadline=None)
@given(
    crowd, st.tuples(coordinate, coordinate), st.tuples(speed, speed), st.tuples(speed, speed), st.floats(0.0, 10.0),
    st.floats(0.0, 120.0), st.booleans(), st.booleans(), st.floats(-2.0, 2.0),
)  # fmt: skip
def test_every_answer_is_finite_and_within_the_limit(
    rows, position, velocity, command, age, radius, reciprocal, walled, turn
):
    own = own_ship(position, velocity, command, limit=9.0)
    others = traffic(*rows, age=age, radius=radius, error=radius, reciprocal=reciprocal, command=(1.0, -2.0))
    decision = solve(own, others, obstacles=SQUARE if walled else None, own_clearance_m=12.0, extra_right_turn_rad=turn)
    for vector in (decision.velocity_ne_mps, decision.command_ne_mps, decision.preferred_ne_mps):
        assert np.all(np.isfinite(vector))
        assert np.linalg.norm(vector) <= 9.0 + 1e-9
    assert len(decision.binding) <= 3
    assert all(0 <= j < len(rows) for j in decision.binding)
    assert (decision.nearest_index == -1) == (not rows)
    assert decision.passing_side.shape == (len(rows),)
    if decision.status is not Status.INFEASIBLE:
        assert decision.worst_slack_mps >= -1e-6


@settings(max_examples=100, deadline=None)
@given(crowd, st.floats(-math.pi, math.pi), st.tuples(speed, speed))
def test_turning_the_world_turns_the_answer(rows, angle, velocity):
    # A neighbour that is, or after the response time will be, all but exactly on top may lie on either side of that.
    for n, e, n_mps, e_mps in rows:
        assume(min(math.hypot(n, e), math.hypot(n + n_mps - velocity[0], e + e_mps - velocity[1])) > 1e-6)
    straight = solve(own_ship(velocity=velocity), traffic(*rows))
    table = np.array(rows, float).reshape(-1, 4)
    table = np.hstack([turned(table[:, :2], angle), turned(table[:, 2:], angle)])
    around = solve(own_ship(velocity=turned(velocity, angle)), traffic(*table), goal_ne_m=turned(GOAL, angle))
    # Knife edges (two boundaries equally near) may fall either way; their worst slack is the same.
    assert around.worst_slack_mps == pytest.approx(straight.worst_slack_mps, abs=1e-3) or math.isinf(
        straight.worst_slack_mps
    )
    if straight.status is not Status.INFEASIBLE and straight.status is around.status:
        assert around.velocity_ne_mps == pytest.approx(turned(straight.velocity_ne_mps, angle), abs=1e-3)


@settings(max_examples=200, deadline=None)
@given(
    st.tuples(coordinate, coordinate), st.tuples(speed, speed), st.tuples(speed, speed), st.floats(5.0, 60.0),
    st.booleans(),
)  # fmt: skip
def test_two_that_swap_places_swap_answers_and_turn_the_same_way(offset, velocity, goal, radius, reciprocal):
    """An encounter that is its own image under half a turn: what the one answers is the image of the other's answer."""
    offset, velocity, goal = np.array(offset), np.array(velocity), 100.0 * np.array(goal)
    assume(np.linalg.norm(offset) > 1e-6 and np.linalg.norm(goal) > 1e-6)
    # After the response time the pair may be all but exactly on top of each other, and lie on either side of that.
    assume(np.linalg.norm(offset - 2.0 * velocity) > 1e-6)
    answers = []
    for sign in (1.0, -1.0):
        others = traffic((*sign * offset, *-sign * velocity), radius=radius, reciprocal=reciprocal)
        answers.append(solve(own_ship(velocity=sign * velocity), others, goal_ne_m=sign * goal))
    one, other = answers
    assert other.status is one.status
    assert other.velocity_ne_mps == pytest.approx(-one.velocity_ne_mps, abs=1e-9)
    assert other.passing_side == pytest.approx(one.passing_side)


@settings(max_examples=100, deadline=None)
@given(st.permutations(range(6)), st.lists(neighbour, min_size=6, max_size=6))
def test_the_order_of_the_neighbours_does_not_matter(order, rows):
    first = solve(own_ship(), traffic(*rows))
    second = solve(own_ship(), traffic(*(rows[k] for k in order)))
    assert second.worst_slack_mps == pytest.approx(first.worst_slack_mps, abs=1e-3)
    if first.status is not Status.INFEASIBLE:
        assert second.velocity_ne_mps == pytest.approx(first.velocity_ne_mps, abs=1e-6)


def test_a_free_path_keeps_the_preferred_velocity():
    decision = solve(own_ship(), traffic((-300.0, 0.0, -10.0, 0.0), (0.0, 350.0, 0.0, 10.0)))
    assert decision.status is Status.FREE
    assert decision.velocity_ne_mps == pytest.approx([10.0, 0.0])
    assert decision.binding == ()
    assert math.isinf(decision.time_to_violation_s)


def test_a_course_that_leads_to_the_goal_within_three_metres_is_flown_on():
    """To turn after every drift of the own position is to weave. Near the goal a quarter of the way counts."""
    for offset, course in ((0.0, 0.0), (2.0, 0.0), (-2.0, 0.0), (5.0, 2.0), (-5.0, -2.0)):
        decision = solve(own_ship(), Traffic.empty(), goal_ne_m=(100.0, offset))
        assert bearing(decision.preferred_ne_mps) == pytest.approx(math.atan2(course, 100.0), abs=0.002), offset
    near = solve(own_ship(velocity=(1.0, 0.0)), Traffic.empty(), goal_ne_m=(4.8, 2.0))
    assert bearing(near.preferred_ne_mps) == pytest.approx(math.atan2(2.0, 4.8) - math.atan(0.25), abs=0.02)
    for away in ((0.0, 0.0), (-1.0, 0.0), (1e-9, 0.0)):
        decision = solve(own_ship(command=away), Traffic.empty(), goal_ne_m=(100.0, 2.0))
        assert bearing(decision.preferred_ne_mps) == pytest.approx(math.atan2(2.0, 100.0))
    at_once = HalfplaneSolver(HalfplaneSettings(arrival_deceleration_mps2=math.inf))
    exact = solve(own_ship(), Traffic.empty(), at_once, goal_ne_m=(100.0, 2.0))
    assert bearing(exact.preferred_ne_mps) == pytest.approx(math.atan2(2.0, 100.0)), "obeys at once"


def test_who_still_flies_past_the_goal_by_three_times_that_is_told_to_fly_to_the_goal_itself():
    """PX4 comes back from a detour a few degrees outwards of what it is told, for seconds."""
    for offset, course in ((3.0, 0.0), (6.0, 3.0), (7.5, 6.0), (9.0, 9.0), (20.0, 20.0), (-7.5, -6.0)):
        decision = solve(own_ship(), Traffic.empty(), goal_ne_m=(200.0, offset))
        assert bearing(decision.preferred_ne_mps) == pytest.approx(math.atan2(course, 200.0), abs=0.001), offset
    straight = solve(own_ship(command=(10.0, 0.3)), Traffic.empty(), goal_ne_m=(200.0, 7.5))
    assert bearing(straight.preferred_ne_mps) == pytest.approx(math.atan2(6.0, 200.0), abs=0.001)


def test_alone_the_preferred_velocity_may_be_given_instead_of_a_goal():
    decision = SOLVER.solve(own_ship(), Traffic.empty(), preferred_ne_mps=(3.0, 4.0), cruise_mps=10.0)
    assert decision.velocity_ne_mps == pytest.approx([3.0, 4.0])
    assert decision.command_ne_mps == pytest.approx([6.5, 2.0])
    fast = SOLVER.solve(own_ship(), Traffic.empty(), preferred_ne_mps=(30.0, 40.0), cruise_mps=10.0)
    assert fast.velocity_ne_mps == pytest.approx([6.0, 8.0])


@settings(max_examples=100, deadline=None)
@given(
    crowd, st.tuples(speed, speed), st.tuples(speed, speed), st.floats(0.5, 20.0), st.booleans(), st.floats(0.1, 1.0),
)  # fmt: skip
def test_with_an_acceleration_limit_every_answer_can_be_reached(rows, velocity, command, most, walled, smoothing):
    """The velocity and the command, in overlaps and at obstacles too; within the speed limit where that can be."""
    constants = replace(HalfplaneSettings(), acceleration_mps2=most, smoothing=smoothing)
    own = own_ship((0.0, 60.0), velocity, command)
    decision = solve(
        own, traffic(*rows), HalfplaneSolver(constants), obstacles=SQUARE if walled else None, own_clearance_m=12.0
    )  # fmt: skip
    for vector in (decision.velocity_ne_mps, decision.command_ne_mps):
        assert np.linalg.norm(vector - command) <= 0.1 * most + 1e-9
        assert np.linalg.norm(vector) <= max(10.0, np.linalg.norm(command)) + 1e-9


def test_of_the_velocities_that_can_be_reached_it_takes_the_best_one():
    """No point of a fine grid is nearer to the preferred one, but for half a per cent of the change."""
    constants = replace(HalfplaneSettings(), acceleration_mps2=20.0)
    limited, free = HalfplaneSolver(constants), HalfplaneSolver()
    random, change = np.random.default_rng(5), 2.0
    axis = np.linspace(-change, change, 161)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) <= 0.99 * change]
    compared = 0
    for _ in range(60):
        command = random.uniform(-5.0, 5.0, 2)
        own = own_ship(velocity=command, command=command)
        others = traffic(*np.hstack([random.uniform(-90.0, 90.0, (3, 2)), random.uniform(-5.0, 5.0, (3, 2))]))
        decision = solve(own, others, limited)
        if decision.status is Status.INFEASIBLE:
            continue
        solve(own, others, free)
        lines = free._scratch[2][:, LANES : 3 * LANES]
        met = ((command + grid) @ lines[:2] >= lines[2] - 1e-9).all(axis=1)
        preferred = decision.preferred_ne_mps
        best = np.linalg.norm(command + grid[met] - preferred, axis=1).min(initial=np.inf)
        assert np.linalg.norm(decision.velocity_ne_mps - preferred) <= best + 1e-9
        compared += 1
    assert compared > 20


def test_it_slows_down_towards_the_goal_and_stops_there():
    speeds = [
        np.linalg.norm(solve(own_ship(), Traffic.empty(), goal_ne_m=(far, 0.0)).velocity_ne_mps)
        for far in (100.0, 20.0, 5.0, 1.0, 0.01, 0.0)
    ]
    assert speeds[0] == pytest.approx(10.0)
    assert speeds[1] == pytest.approx(math.sqrt(2.4 * 20.0) + 0.3)
    assert all(a > b for a, b in pairwise(speeds))
    assert speeds[-1] == 0.0


@pytest.mark.parametrize("heading", np.linspace(-math.pi, math.pi, 7))
def test_head_on_each_turns_right_so_they_pass_port_to_port(heading):
    """Flying north with the other coming south, right is east: (-e, n) of the own heading in (n, e) axes."""
    velocity = turned([10.0, 0.0], heading)
    right = np.array([-velocity[1], velocity[0]]) / 10.0
    ahead = turned([150.0, 0.0], heading)
    mine = solve(own_ship(velocity=velocity), traffic((*ahead, *-velocity)), goal_ne_m=4.0 * ahead)
    other = solve(own_ship(ahead, -velocity), traffic((0.0, 0.0, *velocity)), goal_ne_m=-4.0 * ahead)
    assert mine.velocity_ne_mps @ right > 1.0
    assert other.velocity_ne_mps @ -right > 1.0
    assert mine.velocity_ne_mps == pytest.approx(-other.velocity_ne_mps, abs=1e-6)
    assert mine.passing_side.tolist() == other.passing_side.tolist() == [1]


def test_east_is_to_the_right_of_north():
    decision = solve(own_ship(), traffic((150.0, 0.0, -10.0, 0.0)))
    assert decision.velocity_ne_mps[1] > 1.0


def test_well_clear_on_the_left_both_pass_starboard_to_starboard():
    decision = solve(own_ship(), traffic((120.0, 25.0, -10.0, 0.0)))
    assert decision.passing_side.tolist() == [-1]
    assert decision.velocity_ne_mps[1] < 0.0


def test_the_side_is_held_against_noise_but_right_wins_a_disagreement():
    others = traffic((120.0, 12.0, -10.0, 0.0))
    held = replace(others, memory=np.array([Memory.PASSING_LEFT], np.int8))
    assert solve(own_ship(), others).passing_side.tolist() == [1]
    assert solve(own_ship(), held).passing_side.tolist() == [-1]
    dodging = replace(held, command_ne_mps=np.array([[-9.0, -4.0]]))
    assert solve(own_ship(), dodging).passing_side.tolist() == [1]


@pytest.mark.parametrize("east", [-90.0, 90.0])
def test_crossing_traffic_that_avoids_nobody_is_passed_astern(east):
    """It comes from one side and flies to the other; astern is where it came from."""
    others = traffic((90.0, east, 0.0, -math.copysign(10.0, east)), reciprocal=False)
    decision = solve(own_ship(), others)
    assert decision.velocity_ne_mps[1] * east > 0.0
    assert decision.passing_side[0] == math.copysign(1, east)


def test_a_neighbour_that_avoids_nobody_is_left_all_of_the_work():
    shared = solve(own_ship(), traffic((120.0, 0.0, -10.0, 0.0)))
    alone = solve(own_ship(), traffic((120.0, 0.0, -10.0, 0.0), reciprocal=False))
    assert alone.velocity_ne_mps[1] > shared.velocity_ne_mps[1]


def test_a_neighbour_that_begins_inside_the_buffer_is_not_pushed_out_of_it():
    """Disc 24 m, buffer 7 m: beside each other at 28 m a fleet may start; what has been further away is sent back."""
    beside = traffic((0.0, 28.0, 0.0, 0.0))
    starting = solve(own_ship(velocity=(0.0, 0.0)), beside, goal_ne_m=(0.0, 0.0))
    assert starting.velocity_ne_mps.tolist() == [0.0, 0.0] and starting.memory.tolist() == [0]
    met = replace(beside, memory=np.array([Memory.APART], np.int8))
    assert solve(own_ship(velocity=(0.0, 0.0)), met, goal_ne_m=(0.0, 0.0)).velocity_ne_mps[1] < -0.5
    away = solve(own_ship(), traffic((0.0, 60.0, 0.0, 0.0)))
    assert away.memory.tolist() == [Memory.APART]


def test_inside_the_buffer_it_began_in_a_neighbour_is_approached_no_faster_than_the_gap_allows():
    decision = solve(own_ship(velocity=(0.0, 0.0)), traffic((0.0, 28.0, 0.0, 0.0)), goal_ne_m=(0.0, 500.0))
    assert 0.0 < decision.velocity_ne_mps[1] <= 28.0 - 24.0


def test_an_overlap_separates():
    decision = solve(own_ship(velocity=(0.0, 0.0)), traffic((10.0, 0.0, 0.0, 0.0)), goal_ne_m=(10.0, 0.0))
    assert decision.status is Status.OVERLAPPED
    assert decision.velocity_ne_mps[0] < -1.0
    assert decision.nearest_margin_m == pytest.approx(-14.0)
    assert decision.time_to_violation_s == 0.0
    assert decision.binding == (0,)


def test_exactly_on_top_of_each_other_it_still_leaves():
    decision = solve(own_ship(velocity=(0.0, 0.0)), traffic((0.0, 0.0, 0.0, 0.0)))
    assert np.linalg.norm(decision.velocity_ne_mps) > 1.0


def test_a_slow_vehicle_leaves_a_buffer_as_fast_as_that_asks_for_once_it_was_apart():
    """4.56 m into the buffer of 7.56 m, half each: 2.28 m/s away. Half of 5 m/s for the pair would be 1.25 m/s."""
    slow = own_ship(velocity=(0.0, 0.0), limit=5.0)
    beside = traffic((27.0, 0.0, 0.0, 0.0))
    met = replace(beside, memory=np.array([Memory.APART], np.int8))
    away = solve(slow, met, goal_ne_m=(0.0, 0.0), cruise_mps=5.0)
    assert away.velocity_ne_mps == pytest.approx([-2.28, 0.0], abs=1e-6)
    ideal = HalfplaneSolver(HalfplaneSettings(response_time_s=0.0))
    assert solve(slow, met, ideal, goal_ne_m=(0.0, 0.0), cruise_mps=5.0).velocity_ne_mps[0] == pytest.approx(-1.25)


@pytest.mark.parametrize(("cruise_mps", "growth"), [(2.0, 1.08), (5.0, 1.08), (6.5, 1.04), (8.0, 1.0), (20.0, 1.0)])
def test_who_is_slow_keeps_a_larger_buffer(cruise_mps, growth):
    """A metre into it, where a metre asks for half a metre a second of each."""
    standing = own_ship(velocity=(0.0, 0.0), limit=20.0)
    beside = replace(traffic((23.0 + 7.0 * growth, 0.0, 0.0, 0.0)), memory=np.array([Memory.APART], np.int8))
    away = solve(standing, beside, goal_ne_m=(0.0, 0.0), cruise_mps=cruise_mps)
    assert away.velocity_ne_mps == pytest.approx([-0.5, 0.0], abs=1e-6)
    assert buffer_growth(cruise_mps, 0.0) == 1.0


def test_a_barrier_never_asks_for_more_than_the_vehicle_can_fly():
    decision = solve(own_ship(velocity=(0.0, 0.0)), traffic((10.0, 0.0, 0.0, 0.0), radius=170.0), goal_ne_m=(10.0, 0.0))
    assert decision.status is Status.OVERLAPPED
    assert np.linalg.norm(decision.velocity_ne_mps) <= 10.0


def test_surrounded_it_takes_the_least_bad_velocity_and_says_so():
    angles = np.arange(8) * math.pi / 4
    ring = [(30.0 * math.cos(a), 30.0 * math.sin(a), -9.0 * math.cos(a), -9.0 * math.sin(a)) for a in angles]
    decision = solve(own_ship(velocity=(0.0, 0.0)), traffic(*ring, reciprocal=False))
    assert decision.status is Status.INFEASIBLE
    assert decision.worst_slack_mps < 0.0
    assert 1 <= len(decision.binding) <= 3


def bearing(vector):
    return math.atan2(vector[1], vector[0])


def test_the_slower_it_is_the_further_it_turns_to_the_right():
    """Further than at cruise only while it is slow, and in proportion."""
    crossing = traffic((100.0, 100.0, 0.0, -10.0))
    turns = [bearing(solve(own_ship(velocity=(v, 0.0)), crossing).preferred_ne_mps) for v in (10.0, 5.0, 0.0)]
    assert turns == pytest.approx([0.3, 0.6, 0.9])


def test_a_slow_vehicle_turns_sooner_for_few_and_further_for_several():
    """One that is met after 24 s is three horizons away; the others stand far off the way, and none of them is met."""
    met, at_once = (240.0, 240.0, 0.0, -10.0), HalfplaneSolver(HalfplaneSettings(response_time_s=0.0))
    for others, sooner in ((0, 0.75), (2, 0.75), (3, 0.4375), (4, 0.125), (5, 0.0), (6, 0.0), (9, 0.0)):
        aside = [(-60.0 - 40.0 * k, -300.0, 0.0, 0.0) for k in range(others)]
        decision = solve(own_ship(), traffic(met, *aside))
        few = min(max(6 - others, 0) / 4.0, 1.0)
        wider = 1.0 + 0.4 * few * min(others, 2) / 2.0
        assert bearing(decision.preferred_ne_mps) == pytest.approx(0.3 * wider * sooner, abs=1e-6), others
        assert bearing(solve(own_ship(), traffic(met, *aside), at_once).preferred_ne_mps) == pytest.approx(0.0)


def test_nobody_goes_round_with_a_vehicle_that_avoids_nobody_or_stands_at_its_disc():
    hover = own_ship(velocity=(0.0, 0.0))
    others = {"radius": 60.0, "error": 0.0}
    assert bearing(solve(hover, traffic((150.0, 0.0, -5.0, 0.0), **others)).preferred_ne_mps) > 0.8
    for near in (
        traffic((150.0, 0.0, -5.0, 0.0), reciprocal=False, **others),
        traffic((89.0, 0.0, -5.0, 0.0), **others),
    ):
        assert bearing(solve(hover, near).preferred_ne_mps) == pytest.approx(0.3)


def test_the_turns_of_starting_and_of_a_stall_are_not_added():
    hover, crossing = own_ship(velocity=(0.0, 0.0)), traffic((100.0, 100.0, 0.0, -10.0))
    for extra, turn in ((0.0, 0.9), (0.4, 0.9), (1.0, 1.3), (-0.2, 0.7)):
        decision = solve(hover, crossing, extra_right_turn_rad=extra)
        assert bearing(decision.preferred_ne_mps) == pytest.approx(turn)


def test_all_turns_together_stay_below_a_quarter_turn():
    """Beyond it a vehicle leaves its goal behind: it waited 26 m from one that hovered there, to keep 19 m."""
    wide = HalfplaneSolver(HalfplaneSettings(right_turn_rad=0.6))
    crossing = traffic((100.0, 100.0, 0.0, -10.0))
    for extra, turn in ((0.7, 1.3), (0.9, 1.5), (1.2, 1.5)):
        decision = solve(own_ship(velocity=(10.0, 0.0)), crossing, solver=wide, extra_right_turn_rad=extra)
        assert bearing(decision.preferred_ne_mps) == pytest.approx(turn)


def test_whose_way_is_free_does_not_turn_however_long_it_was_stalled():
    """Otherwise the turn outlives its cause, and leads a vehicle that is alone again round its goal for ever."""
    others = (Traffic.empty(), traffic((-100.0, 0.0, 0.0, 0.0)), traffic((0.0, 150.0, 5.0, 0.0)))
    for free in others:
        decision = solve(own_ship(), free, extra_right_turn_rad=1.2)
        assert decision.preferred_ne_mps == pytest.approx([10.0, 0.0])
        assert decision.status is Status.FREE


def test_time_margin_and_neighbour_of_the_picture():
    decision = solve(own_ship(), traffic((300.0, 0.0, 0.0, 0.0), (124.0, 0.0, -10.0, 0.0), radius=24.0))
    assert decision.nearest_index == 1
    assert decision.nearest_margin_m == pytest.approx(100.0)
    assert decision.time_to_violation_s == pytest.approx(5.0)


def test_an_old_report_is_extrapolated_and_its_disc_grows():
    fresh = solve(own_ship(), traffic((150.0, 0.0, -10.0, 0.0)))
    old = solve(own_ship(), traffic((180.0, 0.0, -10.0, 0.0), age=3.0))
    assert old.nearest_margin_m == pytest.approx(fresh.nearest_margin_m)
    assert old.velocity_ne_mps[1] > fresh.velocity_ne_mps[1]


def test_obstacles_stay_hard_when_traffic_leaves_no_way():
    """Pressed against a wall: the wall is kept, the disc is exceeded."""
    own = own_ship(position=(-55.0, 0.0), velocity=(0.0, 0.0))
    pressing = traffic((-60.0, -5.0, 8.0, 0.0), (-60.0, 5.0, 8.0, 0.0), reciprocal=False)
    decision = solve(own, pressing, obstacles=SQUARE, own_clearance_m=12.0, goal_ne_m=(-300.0, 0.0))
    assert decision.status is Status.INFEASIBLE
    assert decision.velocity_ne_mps[0] <= 0.5
    assert decision.command_ne_mps[0] <= 0.5
    free = solve(own, pressing, goal_ne_m=(-300.0, 0.0))
    assert free.velocity_ne_mps[0] > decision.velocity_ne_mps[0]


def test_inside_the_clearance_of_an_obstacle_it_leaves():
    decision = solve(own_ship(position=(0.0, 45.0)), Traffic.empty(), obstacles=SQUARE, own_clearance_m=12.0)
    assert decision.status is Status.OVERLAPPED
    assert decision.obstacle_binding
    assert decision.velocity_ne_mps[1] > 1.0


@pytest.mark.parametrize("name", ["cruise_mps", "own_clearance_m", "extra_right_turn_rad", "goal_ne_m"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_named(name, value):
    with pytest.raises(ValueError, match=name):
        solve(own_ship(), Traffic.empty(), **{name: (0.0, value) if name == "goal_ne_m" else value})


def test_exactly_one_of_goal_and_preferred_velocity_is_wanted():
    with pytest.raises(ValueError, match="either"):
        solve(own_ship(), Traffic.empty(), preferred_ne_mps=(1.0, 0.0))
    with pytest.raises(ValueError, match="preferred_ne_mps"):
        SOLVER.solve(own_ship(), Traffic.empty(), preferred_ne_mps=(math.nan, 0.0), cruise_mps=1.0)


def test_more_neighbours_than_ever_before_are_no_problem():
    random = np.random.default_rng(3)
    rows = np.hstack([random.uniform(-400, 400, (300, 2)), random.uniform(-10, 10, (300, 2))])
    decision = solve(own_ship(), traffic(*rows))
    assert decision.passing_side.shape == (300,)
    assert np.linalg.norm(decision.velocity_ne_mps) <= 10.0 + 1e-9


def test_equal_questions_get_equal_answers():
    rows = [(150.0, 5.0, -10.0, 0.0), (80.0, -90.0, 0.0, 10.0)]
    first = solve(own_ship(), traffic(*rows))
    solve(own_ship(velocity=(0.0, 0.0)), traffic((5.0, 0.0, 0.0, 0.0)))
    again = solve(own_ship(), traffic(*rows), solver=HalfplaneSolver(HalfplaneSettings()))
    assert np.array_equal(first.velocity_ne_mps, again.velocity_ne_mps)
    assert np.array_equal(first.command_ne_mps, again.command_ne_mps)


def test_the_kernels_are_plain_python_where_compilation_is_off():
    code = (
        "import numpy as np;"
        "from tests.avoidance.encounters import own_ship, solve, traffic;"
        "from ridlink.avoidance.halfplane import avoid_one;"
        "assert not hasattr(avoid_one, 'py_func');"
        "d = solve(own_ship(), traffic((150.0, 5.0, -10.0, 0.0), (80.0, -90.0, 0.0, 10.0)));"
        "print(repr(d.velocity_ne_mps.tolist()))"
    )
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    plain = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True)
    compiled = solve(own_ship(), traffic((150.0, 5.0, -10.0, 0.0), (80.0, -90.0, 0.0, 10.0)))
    assert eval(plain.stdout) == pytest.approx(compiled.velocity_ne_mps.tolist(), abs=1e-9)


@pytest.mark.skipif(not hasattr(avoid_one, "signatures"), reason="nothing is compiled")
def test_warm_up_leaves_nothing_to_compile():
    warm_up()
    compiled = len(avoid_one.signatures)
    solve(own_ship(), traffic((150.0, 5.0, -10.0, 0.0)), obstacles=SQUARE, own_clearance_m=5.0)
    SOLVER.solve(own_ship(), Traffic.empty(), preferred_ne_mps=(1.0, 0.0), cruise_mps=1.0)
    assert len(avoid_one.signatures) == compiled
