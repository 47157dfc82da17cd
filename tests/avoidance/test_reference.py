"""The decision in lanes against the plain form of it, over worlds of all kinds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import HalfplaneSettings, Obstacles, OwnShip, Status, Traffic, rows
from ridlink.avoidance.roadmap import new_roadmap
from ridlink.avoidance.solver import HalfplaneSolver
from ridlink.campaign.deciding import new_decider
from tests.avoidance import reference_halfplane as plain

SQUARE = Obstacles.from_polygons([[[40.0, -20.0], [80.0, -20.0], [80.0, 20.0], [40.0, 20.0]]])
CORNER = Obstacles.from_polygons(
    [
        [[25.0, -60.0], [40.0, -60.0], [40.0, 60.0], [25.0, 60.0]],
        [[-60.0, 20.0], [25.0, 30.0], [25.0, 45.0], [-60.0, 45.0]],
    ]
)
NOTHING = Obstacles.from_polygons(())
# The first one also knows contacts, see `contact_step_s`.
SETTINGS = {
    0.0: replace(HalfplaneSettings(), response_time_s=0.0, contact_step_s=0.5),
    1.0: HalfplaneSettings(),
}
SOLVERS = {response: HalfplaneSolver(constants) for response, constants in SETTINGS.items()}


def drawn_traffic(random: np.random.Generator, count: int, extent_m: float) -> Traffic:
    """Neighbours near and far, some exactly on top, with old and new reports, with and without command and memory."""
    position = random.uniform(-extent_m, extent_m, (count, 2))
    velocity = random.uniform(-12.0, 12.0, (count, 2)) * (random.random((count, 1)) < 0.9)
    age = random.uniform(0.0, 4.0, count) * (random.random(count) < 0.5)
    on_top = random.random(count) < 0.03
    position[on_top], velocity[on_top] = 0.0, 0.0
    command = velocity + random.normal(0.0, 2.0, (count, 2))
    command[random.random(count) < 0.4] = np.nan
    error = random.uniform(0.0, 60.0, count) * (random.random(count) < 0.7)
    side, some = random.choice([0, 0, 1, 2], count), random.choice([0.6, 1.0])
    return Traffic(
        position, velocity, command, age, error + random.uniform(0.0, 20.0, count), error, random.random(count) < some,
        (side + random.choice([0, 4], count)).astype(np.int8),
    )  # fmt: skip


def decide_plainly(own: OwnShip, traffic: Traffic, goal, cruise, obstacles, clearance, turn, constants):
    """Result row and memory of the reference."""
    count = len(traffic)
    vector = np.array(
        [*own.position_ne_m, *own.velocity_ne_mps, *own.command_ne_mps, *goal, 0.0, own.speed_limit_mps, cruise,
         clearance, turn]
    )  # fmt: skip
    table = np.column_stack(
        [traffic.position_ne_m, traffic.velocity_ne_mps, traffic.command_ne_mps, traffic.age_s, traffic.radius_m,
         traffic.error_sum_m, traffic.reciprocal]
    )  # fmt: skip
    memory, result = traffic.memory.copy(), rows.result_row()
    lines = 3 * count + 2 * obstacles.piece_count
    plain.avoid_one(
        vector, table, count, memory, obstacles.pieces,
        new_roadmap(obstacles), 0, constants.as_vector(),
        np.zeros((lines + 2, 3)), np.zeros((lines + 2, 3)),
        np.zeros(lines, np.int64), result,
    )  # fmt: skip
    return result, memory


@settings(max_examples=300, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), count=st.integers(0, 26), extent_m=st.sampled_from([30.0, 150.0, 400.0]),
    response=st.sampled_from([0.0, 1.0]), obstacles=st.sampled_from([NOTHING, SQUARE, CORNER]), standing=st.booleans(),
    turn=st.sampled_from([0.0, 0.5]),
)  # fmt: skip
def test_every_number_of_the_decision_is_that_of_the_plain_form(
    seed, count, extent_m, response, obstacles, standing, turn
):
    random = np.random.default_rng(seed)
    velocity = np.zeros(2) if standing else random.uniform(-8.0, 8.0, 2)
    own = OwnShip(np.zeros(2), velocity, velocity + random.normal(0.0, 1.0, 2), 1.0, 10.0)
    traffic = drawn_traffic(random, count, extent_m)
    goal = random.uniform(-300.0, 300.0, 2)
    wanted, memory = decide_plainly(own, traffic, goal, 9.0, obstacles, 5.0, turn, SETTINGS[response])
    found = SOLVERS[response].solve(
        own, traffic, goal_ne_m=goal, cruise_mps=9.0, obstacles=obstacles, own_clearance_m=5.0,
        extra_right_turn_rad=turn,
    )  # fmt: skip
    assert found.status == wanted[rows.R_STATUS]
    assert found.memory.tolist() == memory.tolist()
    assert found.nearest_index == wanted[rows.R_NEAREST]
    assert found.nearest_margin_m == pytest.approx(wanted[rows.R_MARGIN], abs=1e-9)
    assert found.time_to_violation_s == pytest.approx(wanted[rows.R_TIME], rel=1e-9, abs=1e-9)
    assert found.preferred_ne_mps == pytest.approx(wanted[rows.R_PREFERRED : rows.R_PREFERRED + 2], abs=1e-9)
    assert found.obstacle_binding == bool(wanted[rows.R_OBSTACLE]) or found.status is Status.INFEASIBLE
    if found.status is Status.INFEASIBLE:
        # The excess is unique; where several velocities have it, either is as good.
        assert found.worst_slack_mps == pytest.approx(wanted[rows.R_SLACK], abs=1e-6)
        return
    assert found.worst_slack_mps == pytest.approx(wanted[rows.R_SLACK], abs=1e-9)
    assert found.velocity_ne_mps == pytest.approx(wanted[rows.R_VELOCITY : rows.R_VELOCITY + 2], abs=1e-9)
    assert found.command_ne_mps == pytest.approx(wanted[rows.R_COMMAND : rows.R_COMMAND + 2], abs=1e-9)
    binding = [j for j in wanted[rows.R_BINDING : rows.R_BINDING + 3] if j >= 0.0]
    assert list(found.binding) == binding


@pytest.mark.parametrize("vehicles", [5, 24, 71])
def test_in_a_world_each_decides_as_it_would_alone(vehicles):
    """Over two steps, so that what is kept of the encounters counts too."""
    random, range_m = np.random.default_rng(vehicles), 180.0
    shape = (1, vehicles)
    position, velocity = random.uniform(-200.0, 200.0, (vehicles, 2)), random.uniform(-8.0, 8.0, (vehicles, 2))
    command, goal = velocity + random.normal(0.0, 1.0, (vehicles, 2)), random.uniform(-300.0, 300.0, (vehicles, 2))
    command[::3] = np.nan
    age, reciprocal = random.uniform(0.0, 2.0, vehicles), random.random(vehicles) < 0.7
    radius, present = random.uniform(10.0, 60.0, (vehicles, vehicles)), random.random(vehicles) < 0.9
    own, heard = np.zeros((*shape, rows.OWN_COLUMNS)), np.zeros((*shape, 8))
    own[0, :, 0:2], own[0, :, 2:4], own[0, :, 4:6], own[0, :, 6:8] = position, velocity, velocity, goal
    own[..., rows.LIMIT], own[..., rows.CRUISE], own[..., rows.CLEARANCE] = 10.0, 9.0, 5.0
    heard[0, :, 0:2], heard[0, :, 2:4], heard[0, :, 4:6] = position, velocity, command
    heard[0, :, 6], heard[0, :, 7] = age, reciprocal
    decider, memory = new_decider(SETTINGS[1.0], shape, SQUARE), np.zeros((vehicles, vehicles), np.int8)
    for _ in range(2):
        found = decider.decide(
            own, present[None], heard, present[None], radius[None], 0.8 * radius[None], range_m
        )[0]  # fmt: skip
        for i in np.nonzero(present)[0]:
            near = present & (np.linalg.norm(position - position[i], axis=1) <= range_m)
            near[i] = False
            traffic = Traffic(
                position[near], velocity[near], command[near], age[near], radius[i, near], 0.8 * radius[i, near],
                reciprocal[near], memory[i, near],
            )  # fmt: skip
            alone = SOLVERS[1.0].solve(
                OwnShip(position[i], velocity[i], velocity[i], 1.0, 10.0), traffic, goal_ne_m=goal[i], cruise_mps=9.0,
                obstacles=SQUARE, own_clearance_m=5.0,
            )  # fmt: skip
            memory[i] = 0
            memory[i, near] = alone.memory
            names = np.nonzero(near)[0]
            assert found[i, rows.R_STATUS] == alone.status
            assert found[i, rows.R_COMMAND : rows.R_COMMAND + 2] == pytest.approx(alone.command_ne_mps, abs=1e-9)
            assert [j for j in found[i, rows.R_BINDING : rows.R_BINDING + 3] if j >= 0] == [
                names[j] for j in alone.binding
            ]
            assert found[i, rows.R_NEAREST] == (names[alone.nearest_index] if alone.nearest_index >= 0 else -1)


def test_the_draws_hold_every_kind_of_encounter():
    random = np.random.default_rng(1)
    drawn = [drawn_traffic(random, 26, 150.0) for _ in range(20)]
    assert any((each.position_ne_m == 0.0).all(axis=1).any() for each in drawn)
    assert any(np.isnan(each.command_ne_mps).any() for each in drawn)
    assert any((each.age_s == 0.0).any() for each in drawn)
    assert any((np.hypot(*each.position_ne_m.T) < each.radius_m).any() for each in drawn)
    assert any((each.memory & 3).any() for each in drawn) and math.isfinite(max(each.age_s.max() for each in drawn))
