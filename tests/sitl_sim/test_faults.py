"""What goes wrong: who is hit by it, when it ends, and what the vehicle says meanwhile."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ridlink.mavlink.codec import Encoder
from ridlink.scenario import EVENTS, Event, Scenario, VehicleSpec, Wind, event_of
from sitl_sim.autopilot import Start
from sitl_sim.vehicle import TICK_S, VehicleState
from sitl_sim.vehicle.airframe import FOLDER
from sitl_sim.world import World
from tests.sitl_sim.flight import Flight, one_vehicle

LAND_MODE = 9
"""Of ArduPilot."""


def event(what: str, vehicle: int = 1, at_s: float = 0.0, **figures: float) -> Event:
    return event_of({"what": what, "vehicle": vehicle, **figures}, "test", at_s=at_s)


def world_of(*events: Event, vehicles: int = 3, **details: Any) -> World:
    """Vehicles that hover 100 m apart, with exact receivers."""
    specs = [
        VehicleSpec((100.0 * k, 0.0, -50.0), (100.0 * k, 500.0, -50.0), **({"sigma_m": 0.0} | details))
        for k in range(vehicles)
    ]
    return World(Scenario("faulty", 600.0, tuple(specs), events=events), gnss="bias")


def error_m(world: World, index: int = 0) -> Any:
    return (world.reported_position_ned_m - world.position_ned_m)[index]


def test_an_event_happens_when_it_is_due_to_whom_it_names_and_ends() -> None:
    world = world_of(event("gnss-outage", 2, at_s=1.0, duration_s=2.0))
    world.step(0.98)
    assert world.receivers.fix_type.tolist() == [3, 3, 3]
    world.step(0.06)
    assert world.receivers.fix_type.tolist() == [3, 0, 3]
    world.step(1.9)
    assert world.receivers.fix_type.tolist() == [3, 0, 3]
    world.step(0.2)
    assert world.receivers.fix_type.tolist() == [3, 3, 3]


def test_vehicle_0_is_everybody() -> None:
    world = world_of()
    world.inject(event("gnss-outage", 0))
    assert world.receivers.fix_type.tolist() == [0, 0, 0]
    world.inject(event("gnss-restore", 0))
    assert world.receivers.fix_type.tolist() == [3, 3, 3]


def test_events_wait_for_the_mission() -> None:
    world = World(replace(world_of(event("gnss-outage", at_s=1.0)).scenario), airborne=False)
    world.step(5.0)
    assert world.receivers.fix_type[0] == 3
    world.begin_mission()
    world.step(1.1)
    assert world.receivers.fix_type[0] == 0


def test_what_is_injected_ends_in_time_though_the_mission_has_not_begun() -> None:
    flight = Flight("px4", Start.GROUND)
    flight.advance(2.0)
    assert flight.command(420, 105, 1) == 0
    flight.advance(9.0)
    assert not flight.world.link_on[0]
    flight.advance(1.5)
    assert flight.world.link_on[0] and flight.world.mission_time_s == 0.0


def test_a_jump_shows_in_the_reports_and_in_no_figure_of_the_receiver() -> None:
    world = world_of(sigma_m=2.0)
    before, claimed = error_m(world), world.receivers.h_acc_m[0]
    world.inject(event("gnss-jump", north_m=30.0, east_m=-10.0, duration_s=3.0))
    assert world.receivers.innovation_ratio[0] > 1.0  # only the estimator is surprised
    world.step(0.1)
    assert error_m(world) - before == pytest.approx([30.0, -10.0, 0.0])
    assert (world.receivers.h_acc_m[0], world.receivers.fix_type[0], world.bound_3sigma_m[0]) == (claimed, 3, 6.0)
    world.step(3.1)
    assert error_m(world) == pytest.approx(before)


def test_the_estimator_is_as_surprised_by_the_end_of_a_jump_whatever_ends_it() -> None:
    for end in (event("gnss-restore"), event("gnss-jump")):
        world = world_of(event("gnss-jump", north_m=30.0))
        world.step(30.0)
        assert world.receivers.innovation_ratio[0] < 0.1
        world.inject(end)
        assert world.receivers.innovation_ratio[0] > 1.0


def test_a_spoofer_pulls_position_and_velocity_off_together() -> None:
    world = world_of()
    world.inject(event("gnss-spoof", north_mps=2.0, duration_s=10.0))
    world.step(5.0)
    assert error_m(world)[0] == pytest.approx(10.0, abs=0.25)
    assert world.reported_velocity_ned_mps[0, 0] - world.velocity_ned_mps[0, 0] == pytest.approx(2.0)
    assert world.receivers.h_acc_m[0] == pytest.approx(0.001)
    world.step(6.0)
    assert error_m(world) == pytest.approx([0.0, 0.0, 0.0])


def test_a_receiver_can_err_more_than_it_claims() -> None:
    world = world_of(sigma_m=1.0)
    world.inject(event("gnss-sigma", sigma_m=20.0, claimed_m=1.0))
    assert world.receivers.h_acc_m[0] == 1.0
    world.step(0.1)
    assert np.linalg.norm(error_m(world)) > 5.0
    world.inject(event("gnss-sigma", sigma_m=20.0))
    assert world.receivers.h_acc_m[0] == 20.0
    world.inject(event("gnss-restore"))
    assert world.receivers.h_acc_m[0] == 1.0


def test_the_last_event_of_a_kind_counts() -> None:
    world = world_of()
    world.step(0.1)
    world.inject(event("gnss-outage", duration_s=1.0))
    world.step(0.5)
    world.inject(event("gnss-outage"))
    world.step(5.0)
    assert world.receivers.fix_type[0] == 0
    world.inject(event("radio-off", duration_s=1.0))
    world.inject(event("radio-on"))
    assert world.radio_on[0]


@pytest.mark.parametrize("what, flags", [("radio", "radio_on"), ("link", "link_on")])
def test_radio_and_link_go_off_and_on(what: str, flags: str) -> None:
    world = world_of()
    world.inject(event(f"{what}-off", 2, duration_s=1.0))
    assert getattr(world, flags).tolist() == [True, False, True]
    world.step(1.1)
    assert getattr(world, flags).all()
    world.inject(event(f"{what}-off", 2))
    world.inject(event(f"{what}-on", 2))
    assert getattr(world, flags).all()


def test_whose_radio_is_off_is_not_on_the_air() -> None:
    world = world_of()
    world.inject(event("radio-off", 3))
    assert world.on_air.tolist() == [True, True, False]


def test_who_has_an_empty_battery_comes_down() -> None:
    world = world_of(event("battery", 1, at_s=1.0, remaining=0.0))
    world.step(2.0)
    assert [VehicleState(state).name for state in world.state] == ["LANDING", "AIRBORNE", "AIRBORNE"]
    world.step(120.0)
    assert world.position_ned_m[0, 2] == 0.0 and world.state[0] == VehicleState.GROUNDED


def test_a_forced_landing_is_a_landing() -> None:
    world = world_of()
    world.inject(event("forced-landing", 2))
    assert world.state[1] == VehicleState.LANDING


def test_a_wind_that_rises_blows_everybody() -> None:
    world = world_of()
    for index in range(3):
        world.command_velocity(index, np.zeros(3))
    world.step(2.0)
    still = world.position_ned_m.copy()
    world.inject(event("wind", north_mps=4.0))
    world.step(1.0)
    assert np.all((world.position_ned_m - still)[:, 0] > 0.5)


def test_who_does_not_exist_cannot_fail() -> None:
    with pytest.raises(ValueError, match="no vehicle 9"):
        world_of().inject(event("gnss-outage", 9))


@pytest.mark.parametrize("what", list(EVENTS))
def test_every_event_can_be_injected_and_the_world_flies_on(what: str) -> None:
    needed = {name: 0.5 for name, figure in EVENTS[what].items() if figure.default is None}
    world = world_of(sigma_m=3.0)
    world.inject(event(what, **needed))
    world.step(50 * TICK_S)
    assert np.all(np.isfinite(world.reported_position_ned_m))


# --- ghosts, routes, wind in a world ----------------------------------------------------------------------------------


def test_a_ghost_flies_its_route_hits_nobody_and_is_not_counted() -> None:
    hovering = VehicleSpec((0.0, 50.0, -50.0), (900.0, 0.0, -50.0))
    ghost = VehicleSpec(
        (0.0, 0.0, -50.0),
        (50.0, 50.0, -50.0),
        route_ned_m=((0.0, 50.0, -50.0),),
        ghost=True,
        cooperative=False,
    )
    world = World(Scenario("haunted", 600.0, (hovering, ghost)))
    world.step(4.0)
    assert world.position_ned_m[1] == pytest.approx([0.0, 40.0, -50.0], abs=0.5)
    world.step(3.0)
    assert world.position_ned_m[1, 0] > 10.0 and world.position_ned_m[1, 1] == pytest.approx(50.0, abs=4.0)
    world.step(5.0)
    assert world.state[1] == VehicleState.GONE
    verdict = world.verdict()
    assert (verdict.vehicles, verdict.macs) == (1, 0)
    assert world.on_air.tolist() == [True, False]


@pytest.mark.parametrize("what, figures", [("forced-landing", {}), ("battery", {"remaining": 0.0})])
def test_what_befalls_everybody_brings_no_ghost_down(what: str, figures: dict[str, float]) -> None:
    world = world_of(event(what, 0, **figures), vehicles=2, ghost=True, cooperative=False)
    world.step(20.0)
    assert world.position_ned_m[:, 2].tolist() == [-50.0, -50.0]
    assert world.position_ned_m[:, 1] == pytest.approx([200.0, 200.0], abs=1.0)


def test_a_link_that_comes_back_to_everybody_is_none_of_a_ghost() -> None:
    flight = Flight("px4", Start.AIRBORNE, scenario=one_vehicle(ghost=True, cooperative=False))
    for what in ("link-off", "link-on"):
        flight.world.inject(event(what, 0))
        flight.advance(2.0)
    assert flight.messages("HEARTBEAT") == []


@pytest.mark.parametrize("wind", [Wind(), Wind((-4.0, 2.0), 1.5)])
@pytest.mark.parametrize("autopilot", ["ideal", "px4", "ardupilot"])
def test_who_avoids_nobody_flies_through_the_points_of_its_route(autopilot: str, wind: Wind) -> None:
    route = ((100.0, 0.0, -50.0), (100.0, 100.0, -50.0))
    spec = VehicleSpec((0.0, 0.0, -50.0), (0.0, 100.0, -50.0), cooperative=False, route_ned_m=route, sigma_m=0.0)
    world = World(Scenario("around", 600.0, (spec,), wind=wind), autopilot=autopilot)
    world.fly_straight(0)
    nearest = [1e9, 1e9]
    while not world.finished:
        world.step(TICK_S)
        for k, point in enumerate(route):
            nearest[k] = min(nearest[k], float(np.linalg.norm(world.position_ned_m[0] - point)))
    assert max(nearest) < 4.0 and world.arrived[0]
    assert 28.5 < world.mission_time_s < (31.5 if autopilot == "ideal" else 45.0)


def test_a_point_that_was_passed_is_behind_and_a_goal_that_was_passed_is_flown_to_again() -> None:
    hairpin = ((100.0, 0.0, -50.0), (85.0, 5.0, -50.0), (85.0, 5.0, -50.0), (95.0, 10.0, -50.0))
    spec = VehicleSpec((0.0, 0.0, -50.0), (80.0, 0.0, -50.0), cooperative=False, route_ned_m=hairpin, sigma_m=0.0)
    world = World(Scenario("hairpin", 90.0, (spec,)), autopilot="ardupilot")
    world.fly_straight(0)
    while not world.finished:
        world.step(TICK_S)
    assert world.arrived[0]


def test_who_is_commanded_otherwise_leaves_its_route() -> None:
    world = world_of(cooperative=False, route_ned_m=((0.0, 50.0, -50.0),), vehicles=1)
    world.fly_straight(0)
    world.step(1.0)
    world.command_velocity(0, [0.0, 0.0, 0.0])
    world.step(8.0)
    assert not np.any(np.abs(world.velocity_ned_mps) > 0.2)


def test_the_same_seed_is_the_same_truth_however_time_is_cut() -> None:
    scenario = Scenario(
        "gusty",
        600.0,
        tuple(VehicleSpec((20.0 * k, 0.0, -50.0), (20.0 * k, 500.0, -50.0), cooperative=False) for k in range(5)),
        events=(event("gnss-jump", 2, at_s=1.0, north_m=5.0),),
        wind=Wind((3.0, 0.0), 1.0),
    )

    def flown(cuts: int, seed: int = 7) -> Any:
        world = World(scenario, seed=seed, gnss_common_share=0.5)
        for index in range(5):
            world.fly_straight(index)
        for _ in range(cuts):
            world.step(4.0 / cuts)
        return np.concatenate([world.position_ned_m, world.reported_position_ned_m])

    assert np.array_equal(flown(200), flown(4))
    assert not np.array_equal(flown(200), flown(200, seed=8))


# --- what clients see and can do --------------------------------------------------------------------------------------


def flown(flavour: str = "px4", seconds: float = 5.0) -> Flight:
    flight = Flight(flavour, Start.AIRBORNE)
    flight.advance(seconds)
    return flight


@pytest.mark.parametrize(
    "unit, kind, seen",
    [
        (4, 1, lambda world: world.receivers.fix_type[0] == 0),
        (4, 4, lambda world: world.reported_position_ned_m[0, 0] - world.position_ned_m[0, 0] > 45.0),
        (100, 1, lambda world: world.battery.remaining[0] == 0.0),
        (101, 1, lambda world: world.state[0] == VehicleState.LANDING),
        (105, 1, lambda world: not world.link_on[0]),
    ],
)
def test_a_client_can_let_things_fail(unit: int, kind: int, seen: Any) -> None:
    flight = flown(seconds=0.5)
    assert flight.command(420, unit, kind) == 0
    flight.advance(0.2)
    assert seen(flight.world)


def test_a_failure_that_does_not_exist_is_unsupported() -> None:
    flight = flown(seconds=0.5)
    assert flight.command(420, 3, 2) == 3


def test_the_battery_drains_in_what_the_vehicle_says() -> None:
    flight = flown(seconds=40.0)
    status = flight.last("BATTERY_STATUS")
    assert 90 <= status.battery_remaining < 100 and status.charge_state == 1
    assert 12_000 < status.voltages[0] < 16_800 and flight.last("SYS_STATUS").current_battery > 100
    flight.world.inject(event("battery", remaining=0.04))
    flight.advance(1.5)
    assert flight.last("BATTERY_STATUS").charge_state == 4
    assert flight.last("SYS_STATUS").battery_remaining == 4


def test_a_battery_of_more_volts_than_the_field_holds_is_told_as_the_most(tmp_path: Path) -> None:
    file = tmp_path / "lifter.toml"
    text = (FOLDER / "px4-sih-quad.toml").read_text()
    file.write_text(text.replace("cells = 4\n", "cells = 24\n"))
    flight = Flight("px4", Start.AIRBORNE, scenario=one_vehicle(airframe=str(file)))
    flight.advance(2.0)
    assert flight.last("SYS_STATUS").voltage_battery == flight.last("BATTERY_STATUS").voltages[0] == 65534


def test_who_has_no_link_is_silent_and_deaf() -> None:
    flight = flown(seconds=1.0)
    flight.world.inject(event("link-off", duration_s=5.0))
    flight.advance(0.1)
    count = len(flight.messages("HEARTBEAT"))
    flight.advance(3.0)
    assert len(flight.messages("HEARTBEAT")) == count
    flight.advance(3.0)
    assert len(flight.messages("HEARTBEAT")) > count


def test_what_is_said_while_there_is_no_link_is_not_heard_afterwards() -> None:
    flight = flown("ardupilot", seconds=1.0)
    flight.world.inject(event("link-off", duration_s=12.0))
    flight.world.inject(event("gnss-outage"))
    flight.advance(10.0)
    flight.autopilot.relay(Encoder(1, 236).encode("HEARTBEAT", type=34))
    flight.advance(4.0)
    assert flight.mode == LAND_MODE and flight.texts == [] and flight.passed_on == []


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_who_avoids_nobody_stays_on_the_ground_where_it_was_forced_to_land(flavour: str) -> None:
    low = one_vehicle(cooperative=False, start_ned_m=(-200.0, 0.0, -3.0), goal_ned_m=(200.0, 0.0, -3.0))
    flight = Flight(flavour, Start.AIRBORNE, scenario=low)
    flight.autopilot.begin_mission()
    flight.advance(1.0)
    flight.world.inject(event("forced-landing"))
    flight.advance(10.0)
    assert flight.world.state[0] == VehicleState.GROUNDED and not flight.armed
    flight.advance(5.0)
    assert flight.world.state[0] == VehicleState.GROUNDED


def test_estimator_of_px4_claims_less_and_is_surprised_by_a_jump() -> None:
    flight = Flight("px4", Start.AIRBORNE, scenario=one_vehicle(sigma_m=0.9))
    flight.advance(2.0)
    status = flight.last("ESTIMATOR_STATUS")
    assert status.pos_horiz_accuracy == pytest.approx(0.29, abs=0.01)
    assert flight.last("GPS_RAW_INT").h_acc == 900
    flight.world.inject(event("gnss-jump", north_m=40.0))
    flight.advance(1.1)
    assert flight.last("ESTIMATOR_STATUS").pos_horiz_ratio > 1.0
    assert flight.last("GPS_RAW_INT").h_acc == 900
