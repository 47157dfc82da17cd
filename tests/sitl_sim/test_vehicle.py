"""The response models against the step responses that were measured on real autopilots.

Tolerances: t63 within 15 %, displacement within 20 % or 0.5 m, stopping distance within 20 %, for every measured row of
``measured.py``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.errors import ConfigError
from ridlink.scenario import Wind
from ridlink.scenario.model import MOST_SPEED_MPS
from sitl_sim.vehicle import (
    AIRFRAMES,
    AUTOPILOTS,
    TICK_S,
    BatteryType,
    FleetBattery,
    FleetDynamics,
    FleetWind,
    VelocityFeedback,
    load_airframe,
    model_for_speed,
)
from sitl_sim.vehicle.airframe import FOLDER
from tests.sitl_sim.measured import (
    DISPLACEMENTS,
    DOWN,
    NORTH,
    PX4_T05_S,
    STEPS,
    STOPS,
    Velocity,
    respond,
    respond_as_measured,
)

STEPS_OF_EACH = [
    pytest.param(autopilot, row[0], row[3], row[4], measured_s, id=f"{autopilot} {row[0]}")
    for row in STEPS
    for autopilot, measured_s in (("ardupilot", row[5]), ("px4", row[6]))
    if measured_s is not None
]


@pytest.mark.parametrize("autopilot, name, axis, to_mps, measured_s", STEPS_OF_EACH)
def test_time_to_63_percent_is_as_measured(
    autopilot: str, name: str, axis: int, to_mps: float, measured_s: float
) -> None:
    modelled_s = respond_as_measured(autopilot, name).t63_s(axis, to_mps)
    assert modelled_s == pytest.approx(measured_s, rel=0.15)


@pytest.mark.parametrize("name", PX4_T05_S)
def test_px4_starts_as_late_as_measured_when_it_still_creeps(name: str) -> None:
    """The rows began in motion: a step against the flight before it starts twice as late as one along it."""
    axis, to_mps = next((row[3], row[4]) for row in STEPS if row[0] == name)
    assert respond_as_measured("px4", name).share_s(0.05, axis, to_mps) == pytest.approx(PX4_T05_S[name], abs=0.06)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("name, ardupilot_m, px4_m", DISPLACEMENTS, ids=[row[0] for row in DISPLACEMENTS])
def test_displacement_against_the_old_path_is_as_measured(
    autopilot: str, name: str, ardupilot_m: tuple[float, ...], px4_m: tuple[float, ...]
) -> None:
    modelled_m = respond_as_measured(autopilot, name).aside_m(np.arange(1.0, 6.0))
    measured_m = np.array(ardupilot_m if autopilot == "ardupilot" else px4_m)
    assert np.all(np.abs(modelled_m - measured_m) <= np.maximum(0.20 * measured_m, 0.5)), modelled_m


@pytest.mark.parametrize(
    "autopilot, from_mps, measured_m", [(autopilot, *row) for autopilot, rows in STOPS.items() for row in rows]
)
def test_stopping_distance_is_as_measured(autopilot: str, from_mps: float, measured_m: float) -> None:
    stop = respond(autopilot, (from_mps, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert stop.moved[-1, NORTH] == pytest.approx(measured_m, rel=0.20)


def test_px4_is_short_of_its_setpoint_for_seconds_and_ardupilot_is_not() -> None:
    px4, ardupilot = (respond(name, (0, 0, 0), (5, 0, 0)).velocity[-1, NORTH] / 5.0 for name in ("px4", "ardupilot"))
    assert px4 == pytest.approx(0.88, abs=0.05)  # measured 0.88 as the mean of the last 2 s
    assert ardupilot == pytest.approx(1.0, abs=0.005)


def test_first_second_of_ardupilot_does_not_depend_on_the_step() -> None:
    moved = [respond("ardupilot", (0, 0, 0), (speed, 0, 0), 1.0).moved[-1, NORTH] for speed in (3.0, 5.0, 10.0)]
    assert moved == pytest.approx([0.55] * 3, abs=0.08)  # measured 0.55 m whatever the step: jerk-limited


@pytest.mark.parametrize(
    "autopilot, command, axis, limit_mps",
    [
        ("px4", (0.0, 0.0, 3.0), DOWN, 1.5),  # MPC_Z_VEL_MAX_DN
        ("px4", (0.0, 0.0, -9.0), DOWN, -3.0),
        ("px4", (15.0, 0.0, 0.0), NORTH, 9.9),  # measured 10.0: tilt against drag before the clip at 12
        ("ardupilot", (15.0, 0.0, 0.0), NORTH, 10.2),  # measured: lean angle at its limit
        ("ideal", (100.0, 0.0, 0.0), NORTH, 60.0),
    ],
)
def test_limits_of_speed_hold(autopilot: str, command: Velocity, axis: int, limit_mps: float) -> None:
    reached = respond(autopilot, (0.0, 0.0, 0.0), command, 30.0).velocity[-1, axis]
    assert reached == pytest.approx(limit_mps, rel=0.03)


def test_ideal_vehicle_flies_the_command_at_once() -> None:
    response = respond("ideal", (0.0, 0.0, 0.0), (3.0, -4.0, 1.0), 0.1)
    assert response.velocity[1] == pytest.approx([3.0, -4.0, 1.0])


def test_a_fleet_of_different_autopilots_flies_like_each_alone() -> None:
    names = ["px4", "ideal", "ardupilot", "px4"]
    commands = np.array([[5.0, 0, 0], [0, 5.0, 0], [-3.0, 1, -1], [0, 0, 1.0]])
    together = FleetDynamics(names, np.zeros((4, 3)))
    together.step(commands, 3.0, [True] * 4)
    for index, name in enumerate(names):
        alone = FleetDynamics([name], np.zeros((1, 3)))
        alone.step(commands[index : index + 1], 3.0, [True])
        assert together.position_ned_m[index] == pytest.approx(alone.position_ned_m[0], abs=1e-12)


def test_who_is_not_airborne_stands_still_and_starts_afresh() -> None:
    fleet = FleetDynamics(["px4", "ardupilot"], np.zeros((2, 3)))
    fleet.step([[5.0, 0, 0]] * 2, 4.0, [True, True])
    stood_at = fleet.position_ned_m.copy()
    fleet.step([[5.0, 0, 0]] * 2, 1.0, [False, False])
    assert np.array_equal(fleet.position_ned_m, stood_at)
    assert not np.any(fleet.velocity_ned_mps)
    fleet.step([[0.0, 0, 0]] * 2, 1.0, [True, True])
    assert fleet.position_ned_m == pytest.approx(stood_at, abs=1e-9)


@pytest.mark.parametrize("autopilot", list(AUTOPILOTS))
def test_reset_to_a_steady_flight_goes_on_steadily(autopilot: str) -> None:
    fleet = FleetDynamics([autopilot, autopilot], np.zeros((2, 3)))
    fleet.reset(1, [10.0, 20.0, -30.0], [4.0, 3.0, 0.0])
    fleet.step([[0.0, 0, 0], [4.0, 3.0, 0.0]], 2.0, [True, True])
    assert fleet.position_ned_m[1] == pytest.approx([18.0, 26.0, -30.0], abs=1e-6)
    assert not np.any(fleet.position_ned_m[0])


def test_a_faster_cruise_than_measured_is_reachable() -> None:
    model = model_for_speed("px4", 30.0)
    assert isinstance(model, VelocityFeedback)
    fleet = FleetDynamics([model], np.zeros((1, 3)))
    fleet.step([[30.0, 0.0, 0.0]], 30.0, [True])
    assert fleet.velocity_ned_mps[0, NORTH] > 27.0


@pytest.mark.parametrize(
    "bad", [{"dt_s": 0.03}, {"dt_s": -0.02}, {"command_velocity_ned_mps": [[float("nan"), 0.0, 0.0]]}]
)
def test_impossible_steps_are_refused(bad: dict[str, object]) -> None:
    fleet = FleetDynamics(["px4"], np.zeros((1, 3)))
    good: dict[str, object] = {"command_velocity_ned_mps": [[1.0, 0, 0]], "dt_s": 0.02, "airborne": [True]}
    with pytest.raises(ValueError):
        fleet.step(**(good | bad))  # type: ignore[arg-type]


def test_unknown_autopilot_names_the_known_ones() -> None:
    with pytest.raises(ValueError, match="ideal, px4, ardupilot"):
        FleetDynamics(["betaflight"], np.zeros((1, 3)))


@settings(max_examples=25, deadline=None)
@given(
    autopilot=st.sampled_from(sorted(AUTOPILOTS)),
    commands=st.lists(st.tuples(*[st.floats(-200.0, 200.0)] * 3), min_size=1, max_size=6),
)
def test_whatever_is_commanded_the_motion_stays_bounded_and_continuous(
    autopilot: str, commands: list[Velocity]
) -> None:
    fleet = FleetDynamics([autopilot], np.zeros((1, 3)))
    for command in commands:
        for _ in range(10):
            before = fleet.position_ned_m.copy()
            fleet.step([command], TICK_S, [True])
            assert np.all(np.isfinite(fleet.position_ned_m))
            assert (
                np.linalg.norm(fleet.velocity_ned_mps) <= model_for_speed(autopilot, 0.0).speed_limit_mps * 1.2 + 10.0
            )
            assert np.linalg.norm(fleet.position_ned_m - before) <= 80.0 * TICK_S


# --- airframes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", AIRFRAMES)
def test_every_airframe_of_the_package_can_be_read(name: str) -> None:
    airframe = load_airframe(name)
    assert airframe.title and airframe.battery


@pytest.mark.parametrize("category, max_mps", [(1, 20.6), (2, 15.4), (3, 30.7), (4, 51.5)])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_categories_reach_the_speed_of_table_3_and_stop_again(autopilot: str, category: int, max_mps: float) -> None:
    model = model_for_speed(autopilot, 10.0, f"category{category}")
    assert model.speed_limit_mps == max_mps
    fleet = FleetDynamics([model], np.zeros((1, 3)))
    fleet.step([[max_mps, 0.0, 0.0]], 60.0, [True])
    assert fleet.velocity_ned_mps[0, NORTH] == pytest.approx(max_mps, rel=0.03)
    fleet.step([[0.0, 0.0, 0.0]], 60.0, [True])
    assert abs(fleet.velocity_ned_mps[0, NORTH]) < 0.1


def test_an_airframe_of_ones_own_flies(tmp_path: Path) -> None:
    text = (FOLDER / "category1.toml").read_text().replace("speed_limit_mps = 20.6", "speed_limit_mps = 7.5")
    own = tmp_path / "own.toml"
    own.write_text(text)
    assert model_for_speed("px4", 1.0, str(own)).speed_limit_mps == 7.5


@pytest.mark.parametrize(
    "old, new, told",
    [
        ("jerk_mps3 = 30.0", 'jerk_mps3 = "much"', "own.toml:29: shaped: jerk_mps3 must be a finite number"),
        ("d = 0.2", "e = 0.2", "feedback: d is missing"),
        ("d = 0.2", "d = 0.2\ne = 1.0", "own.toml:13: feedback: e is not known here"),
        ("cells = 4", "cells = 0", "cells must be greater than 0"),
        ("[battery]", "[batery]", "batery is not known here"),
    ],
)
def test_a_wrong_airframe_file_is_refused_by_file_line_and_key(tmp_path: Path, old: str, new: str, told: str) -> None:
    own = tmp_path / "own.toml"
    own.write_text((FOLDER / "category1.toml").read_text().replace(old, new, 1))
    with pytest.raises(ConfigError) as refused:
        load_airframe(str(own))
    assert told in str(refused.value)


def test_all_mistakes_of_an_airframe_file_are_told_at_once(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    text = (FOLDER / "category1.toml").read_text()
    for old, new in (("d = 0.2", "d = -0.2"), ("jerk_mps3 = 30.0", 'jerk_mps3 = "much"'), ("title", "titel"),
                     ("[battery]", "[batery]")):  # fmt: skip
        assert old in text
        text = text.replace(old, new, 1)
    own.write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_airframe(str(own))
    lines = [line.split(": ", 1)[1] for line in (str(refused.value), *refused.value.others)]
    assert [line.split(" must ")[0].split(" is ")[0] for line in lines] == [
        "feedback: d", "shaped: jerk_mps3", "title",
    ]  # fmt: skip


def test_what_nobody_has_measured_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"ardupilot-quad.*px4.*feedback"):
        model_for_speed("px4", 10.0, "ardupilot-quad")
    with pytest.raises(ConfigError, match="known are ardupilot-quad"):
        load_airframe("zeppelin")


# --- wind -------------------------------------------------------------------------------------------------------------


def test_gusts_have_their_deviation_and_memory_and_are_each_vehicles_own() -> None:
    wind = FleetWind(Wind((3.0, -1.0), 2.0, 4.0), 400, seed=3, tick_s=TICK_S)
    first = wind.velocity_ne_mps.copy()
    assert first.mean(axis=0) == pytest.approx([3.0, -1.0], abs=0.3)
    assert first.std(axis=0) == pytest.approx([2.0, 2.0], rel=0.1)
    for _ in range(round(4.0 / TICK_S)):
        wind.step()
    assert np.corrcoef(first[:, 0], wind.velocity_ne_mps[:, 0])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.12)
    alone = FleetWind(Wind((3.0, -1.0), 2.0, 4.0), 2, seed=3, tick_s=TICK_S)
    assert np.array_equal(alone.velocity_ne_mps, first[:2])


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_both_autopilots_hold_their_speed_in_a_gusting_wind(autopilot: str) -> None:
    """Measured on ArduPilot in 8 m/s of gusting wind: 0 -> 5 m/s in t63 1.77 s, final 1.01."""
    wind = FleetWind(Wind((-8.0, 0.0), 1.5), 60, seed=1, tick_s=TICK_S)
    model = model_for_speed(autopilot, 10.0)
    if isinstance(model, VelocityFeedback):
        model = replace(model, drag_per_s=0.2)  # its simulator's drag leaves nothing at 13 m/s of airspeed
    fleet = FleetDynamics([model] * 60, np.zeros((60, 3)))
    speeds = []
    for tick in range(round(20.0 / TICK_S)):
        wind.step()
        fleet.step(np.tile([5.0, 0.0, 0.0], (60, 1)), TICK_S, [True] * 60, wind.velocity_ne_mps)
        if tick * TICK_S > 12.0:
            speeds.append(fleet.velocity_ned_mps[:, NORTH].copy())
    assert np.mean(speeds) == pytest.approx(5.0, abs=0.25)
    assert 0.05 < np.std(speeds) < 0.8


def test_an_ideal_vehicle_does_not_feel_the_wind() -> None:
    fleet = FleetDynamics(["ideal"], np.zeros((1, 3)))
    fleet.step([[5.0, 0.0, 0.0]], 2.0, [True], np.array([[0.0, 9.0]]))
    assert fleet.position_ned_m[0] == pytest.approx([10.0, 0.0, 0.0])


# --- battery ----------------------------------------------------------------------------------------------------------


def test_a_battery_lasts_as_long_as_its_energy_by_its_power() -> None:
    battery = FleetBattery([BatteryType(4, 50.0, 150.0)])
    hovering, seconds = np.zeros((1, 3)), 0
    while battery.remaining[0] > 0.0:
        battery.step(hovering, np.array([True]), 1.0)
        seconds += 1
    assert seconds == pytest.approx(50.0 / 150.0 * 3600.0, rel=0.01)
    assert battery.voltage_v[0] < 4 * 3.1


def test_climbing_and_speed_cost_power_and_voltage_falls_with_charge() -> None:
    def after(velocity: Velocity, in_air: bool) -> tuple[float, float]:
        battery = FleetBattery([BatteryType(4, 50.0, 150.0)])
        for _ in range(60):
            battery.step(np.array([velocity]), np.array([in_air]), 1.0)
        return float(battery.remaining[0]), float(battery.voltage_v[0])

    ground, hover, climb, fast = (
        after(v, air) for v, air in (((0, 0, 0), False), ((0, 0, 0), True), ((0, 0, -3), True), ((12, 0, 0), True))
    )
    assert ground > hover > climb and hover > fast


def test_a_battery_has_a_voltage_at_every_speed_that_a_scenario_allows() -> None:
    battery = FleetBattery([BatteryType(4, 50.0, 150.0)])
    battery.step(np.array([[MOST_SPEED_MPS, 0.0, 0.0]]), np.array([True]), TICK_S)
    assert 4 * 2.0 < battery.voltage_v[0] < 4 * 4.2
    assert battery.current_a[0] > 0.0


def test_a_battery_can_be_set() -> None:
    battery = FleetBattery([BatteryType(4, 50.0, 150.0)] * 2)
    battery.set_remaining(1, 0.25)
    assert battery.remaining.tolist() == [1.0, 0.25]
    assert battery.current_a[1] > battery.current_a[0]
    with pytest.raises(ValueError):
        battery.set_remaining(0, 1.5)
