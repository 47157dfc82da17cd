"""The world: states of its vehicles, missions to their end, the same flight from the same seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ridlink.scenario import Scenario, VehicleSpec, Wind, built_in
from sitl_sim.gnss import ErrorModel
from sitl_sim.pair_radius import eq8_pair_radius
from sitl_sim.vehicle import TICK_S, VehicleState
from sitl_sim.verdict import Outcome
from sitl_sim.world import World


def alone(*, down_m: float = -50.0, goal_north_m: float = 60.0, **spec: object) -> Scenario:
    """One vehicle that flies north."""
    vehicle = VehicleSpec((0.0, 0.0, down_m), (goal_north_m, 0.0, down_m), **spec)  # type: ignore[arg-type]
    return Scenario("alone", 60.0, (vehicle,))


def test_everybody_arrives_where_nobody_is_in_the_way_and_lands() -> None:
    world = World(alone(), autopilot="px4")
    world.fly_straight(0)
    while not world.finished:
        world.step(0.1)
    verdict = world.verdict()
    assert verdict.passed
    assert verdict.mission_time_max_s == pytest.approx(7.0, abs=1.5)
    assert world.state[0] == VehicleState.LANDING
    assert not world.active[0]
    assert world.in_air[0]
    world.command_velocity(0, [10.0, 0.0, 0.0])  # nobody listens on the way down
    world.step(60.0)
    assert world.state[0] == VehicleState.GROUNDED
    assert world.position_ned_m[0, 2] == 0.0
    assert not np.any(world.velocity_ned_mps)
    assert abs(world.position_ned_m[0, 0] - 60.0) < 25.0


def test_arrival_may_mean_leaving_at_once() -> None:
    world = World(alone(), autopilot="ideal", arrival="leave")
    world.fly_straight(0)
    world.step(7.0)
    assert world.state[0] == VehicleState.GONE
    assert not world.in_air[0]
    assert not world.on_air[0]


def test_takeoff_from_the_ground_flight_and_landing_on_command() -> None:
    world = World(alone(), autopilot="ardupilot", airborne=False)
    assert world.position_ned_m[0].tolist() == [0.0, 0.0, 0.0]
    world.command_velocity(0, [0.0, 0.0, -2.0])
    world.step(1.0)
    assert world.state[0] == VehicleState.GROUNDED  # not without lift_off
    assert world.mission_time_s == 0.0
    world.lift_off(0)
    world.step(1.0)
    assert world.state[0] == VehicleState.AIRBORNE  # motors up, nothing commanded since
    assert world.position_ned_m[0, 2] == 0.0
    world.command_velocity(0, [0.0, 0.0, -2.0])
    world.step(10.0)
    assert world.position_ned_m[0, 2] < -15.0
    assert not world.finished
    world.begin_mission()
    assert world.mission_time_s == 0.0
    world.step(1.0)
    assert world.mission_time_s == pytest.approx(1.0)
    world.land(0)
    world.step(40.0)
    assert world.state[0] == VehicleState.GROUNDED


def test_descending_into_the_ground_is_a_landing_too() -> None:
    world = World(alone(down_m=-3.0), autopilot="px4")
    world.command_velocity(0, [0.0, 0.0, 1.0])
    world.step(10.0)
    assert world.state[0] == VehicleState.GROUNDED
    assert world.position_ned_m[0, 2] == 0.0


def test_head_on_without_avoidance_collides_and_both_are_gone() -> None:
    world = World(built_in("head-on"), autopilot="ideal", gnss="bias")
    for index in (0, 1):
        world.fly_straight(index)
    while not world.finished:
        world.step(0.1)
    verdict = world.verdict()
    assert (verdict.macs, verdict.arrived) == (1, 0)
    assert world.state.tolist() == [VehicleState.GONE] * 2
    assert world.referee.collisions[0].time_s == pytest.approx((400.0 - 0.6) / 20.0, abs=1e-6)
    assert {detail.outcome for detail in verdict.details} == {Outcome.COLLIDED}
    where = world.position_ned_m.copy()
    world.step(1.0)
    assert np.array_equal(world.position_ned_m, where)


def test_what_was_flown_before_the_mission_is_no_way_of_its_first_step() -> None:
    first = VehicleSpec((0.0, 0.0, -20.0), (200.0, 0.0, -20.0))
    second = VehicleSpec((20.0, -10.0, -20.0), (20.0, 200.0, -20.0))
    world = World(Scenario("in turn", 60.0, (first, second)), autopilot="ideal", begins=False)
    world.command_velocity(0, [10.0, 0.0, 0.0])
    world.step(4.0)
    world.command_velocity(0, [0.0, 0.0, 0.0])
    world.command_velocity(1, [0.0, 10.0, 0.0])  # crosses the way of the first, 20 m behind it
    world.step(2.0)
    world.begin_mission()
    world.step(TICK_S)
    verdict = world.verdict()
    assert verdict.macs == 0
    assert verdict.min_separation_m is not None and verdict.min_separation_m > 20.0


def test_an_obstacle_removes_who_flies_into_it() -> None:
    square = built_in("square24", 4)
    world = World(replace(square, vehicles=square.vehicles[:1]), autopilot="ideal")
    world.fly_straight(0)
    world.step(40.0)
    verdict = world.verdict()
    assert verdict.obstacle_hits == 1
    assert verdict.details[0].outcome is Outcome.HIT_OBSTACLE
    assert world.finished


def test_time_runs_out() -> None:
    world = World(replace(alone(), duration_s=2.0))
    world.step(1.9)
    assert not world.finished
    world.step(0.1)
    assert world.finished
    assert world.verdict().details[0].outcome is Outcome.FLYING


@pytest.mark.parametrize("steps", [[0.1] * 20, [0.02] * 100, [0.033] * 60 + [0.02], [2.0]])
def test_the_same_seed_gives_the_same_flight_however_time_is_cut(steps: list[float]) -> None:
    def fly(cut: list[float]) -> World:
        world = World(built_in("circle8"), seed=5, autopilot=["px4", "ardupilot"] * 4)
        for index in range(8):
            world.fly_straight(index)
        for dt_s in cut:
            world.step(dt_s)
        return world

    one, other = fly(steps), fly([0.5] * 4)
    assert one.time_s == pytest.approx(2.0)
    assert np.array_equal(one.position_ned_m, other.position_ned_m)
    assert np.array_equal(one.reported_position_ned_m, other.reported_position_ned_m)
    elsewhere = World(built_in("circle8"), seed=6, autopilot=["px4", "ardupilot"] * 4)
    assert not np.array_equal(
        elsewhere.reported_position_ned_m, World(built_in("circle8"), seed=5).reported_position_ned_m
    )


def test_what_a_vehicle_knows_is_the_truth_and_its_error() -> None:
    scenario = Scenario(
        "two",
        60.0,
        (
            VehicleSpec((0.0, 0.0, -50.0), (60.0, 0.0, -50.0), sigma_m=0.0),
            VehicleSpec((0.0, 90.0, -50.0), (60.0, 90.0, -50.0)),
        ),
    )
    world = World(scenario, sigma_m=4.0)
    assert np.array_equal(world.reported_position_ned_m[0], world.position_ned_m[0])
    assert not np.array_equal(world.reported_position_ned_m[1], world.position_ned_m[1])
    assert world.bound_3sigma_m == pytest.approx([0.0, 12.0])
    grounded = World(scenario, airborne=False)
    assert not np.any(grounded.reported_velocity_ned_mps)


def test_pair_radius_is_equation_8() -> None:
    scenario = Scenario(
        "two",
        60.0,
        (
            VehicleSpec((0.0, 0.0, -50.0), (60.0, 0.0, -50.0), speed_mps=10.0, airframe_m=2.0, sigma_m=3.5),
            VehicleSpec((0.0, 90.0, -50.0), (60.0, 90.0, -50.0), speed_mps=5.0, airframe_m=1.0, sigma_m=1.0),
        ),
    )
    world = World(scenario, autopilot="ideal")
    for index in (0, 1):
        world.fly_straight(index)
    world.step(TICK_S)
    assert eq8_pair_radius(world)[0, 1] == pytest.approx(1.5 + 10.5 + 3.0 + 0.1 * 15.0)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_who_begins_in_the_air_hovers_in_the_wind_that_blows(autopilot: str) -> None:
    scenario = Scenario("windy", 60.0, (VehicleSpec((0.0, 0.0, -50.0), (500.0, 0.0, -50.0)),), wind=Wind((6.0, -6.0)))
    world = World(scenario, autopilot=autopilot)
    world.step(10.0)
    assert world.position_ned_m[0] == pytest.approx([0.0, 0.0, -50.0], abs=1e-6)
    world.set_wind(Wind((0.0, 0.0)))
    world.step(2.0)
    assert world.position_ned_m[0, 0] < -0.3, "what it leans against has gone"


def test_another_pair_radius_can_be_judged_by() -> None:
    def violations(radius_m: float) -> int:
        world = World(
            built_in("crossing"),
            autopilot="ideal",
            gnss="bias",
            sigma_m=0.0,
            pair_radius=lambda _: np.full((2, 2), radius_m),
        )
        world.fly_straight(0)
        world.step(25.0)
        return world.verdict().unmac_violations

    assert violations(199.0) == 0  # the other one hovers 200 m from the crossing
    assert violations(201.0) == 1


def test_an_empty_world_turns() -> None:
    world = World(built_in("circle8", 0))
    world.step(1.0)
    assert world.finished
    assert world.verdict().vehicles == 0


@pytest.mark.parametrize("velocity", [[1.0, 2.0], [float("nan"), 0.0, 0.0], [float("inf"), 0.0, 0.0]])
def test_a_command_that_is_no_velocity_is_refused(velocity: list[float]) -> None:
    world = World(alone())
    with pytest.raises(ValueError):
        world.command_velocity(0, velocity)


def test_time_does_not_run_backwards() -> None:
    with pytest.raises(ValueError):
        World(alone()).step(-0.1)


def test_one_autopilot_for_each_vehicle() -> None:
    with pytest.raises(ValueError, match="2 autopilots for 1 vehicle"):
        World(alone(), autopilot=["px4", "px4"])


@pytest.mark.parametrize("gnss", ["white", "gauss-markov"])
def test_the_errors_of_a_receiver_are_the_same_whatever_the_interval_of_remote_id(gnss: ErrorModel) -> None:
    often, seldom = (World(replace(alone(), interval_s=interval_s), gnss=gnss) for interval_s in (0.05, 2.0))
    for _ in range(50):
        often.step(0.1)
        seldom.step(0.1)
        assert np.array_equal(often.receivers.position_error_ned_m, seldom.receivers.position_error_ned_m)


def test_a_jump_does_not_wait_for_remote_id() -> None:
    world = World(replace(alone(), interval_s=10.0), gnss="bias")
    before_m = world.reported_position_ned_m[0, 1]
    world.receivers.set_jump(0, [0.0, 30.0, 0.0])
    world.step(0.1)
    assert world.reported_position_ned_m[0, 1] - before_m == pytest.approx(30.0)
