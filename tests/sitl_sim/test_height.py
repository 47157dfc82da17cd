"""Heights: what an estimator believes wanders slowly, so that who holds its height does not chase its receiver."""

from __future__ import annotations

import numpy as np
import pytest

from ridlink.engine.deciding import VERTICAL_GAIN_PER_S
from ridlink.scenario import Scenario, VehicleSpec
from sitl_sim.autopilot import Start
from sitl_sim.gnss import VERTICAL_RATIO, ErrorModel
from sitl_sim.world import World
from tests.sitl_sim.flight import ACCEPTED, ARM, GUIDED, NAN, TAKEOFF, Flight, both, one_vehicle

LONE = Scenario("lone", 600.0, tuple(VehicleSpec((0.0, 60.0 * k, -50.0), (3000.0, 60.0 * k, -50.0)) for k in range(20)))


@pytest.mark.parametrize("model", ["white", "gauss-markov"])
def test_who_holds_its_height_by_what_it_believes_flies_level(model: ErrorModel) -> None:
    world = World(LONE, gnss=model, sigma_m=3.5)
    kept_m = world.reported_position_ned_m[:, 2].copy()
    commands, heights = [], []
    for _ in range(600):
        down = np.clip(VERTICAL_GAIN_PER_S * (kept_m - world.reported_position_ned_m[:, 2]), -2.0, 2.0)
        for index in range(20):
            world.command_velocity(index, (10.0, 0.0, float(down[index])))
        world.step(0.1)
        commands.append(down)
        heights.append(-world.position_ned_m[:, 2])
    assert np.sqrt(np.mean(np.square(commands))) < 0.1
    assert np.max(np.ptp(heights, axis=0)) < 12.0
    assert np.mean(np.std(heights, axis=0)) < 2.0


def test_the_receiver_alone_wanders_as_it_says() -> None:
    world = World(LONE, sigma_m=3.5)
    errors, believed = [], []
    for _ in range(400):
        world.step(1.0)
        errors.append(world.receiver_down_m - world.position_ned_m[:, 2])
        believed.append(world.reported_position_ned_m[:, 2] - world.position_ned_m[:, 2])
    assert np.std(errors[100:]) == pytest.approx(VERTICAL_RATIO * 3.5, rel=0.1)
    assert np.std(believed[100:]) == pytest.approx(1.6, rel=0.25)


def test_a_bias_of_the_whole_flight_stays_and_an_exact_receiver_is_exact() -> None:
    biased, exact = World(LONE, gnss="bias"), World(LONE, sigma_m=0.0)
    before = biased.reported_position_ned_m[:, 2] - biased.position_ned_m[:, 2]
    for world in (biased, exact):
        world.step(30.0)
    assert biased.reported_position_ned_m[:, 2] - biased.position_ned_m[:, 2] == pytest.approx(before)
    assert exact.reported_position_ned_m == pytest.approx(exact.position_ned_m)


def test_gps_raw_int_has_the_receivers_altitude_and_positions_the_estimators() -> None:
    flight = Flight(start=Start.AIRBORNE, scenario=LONE)
    flight.advance(20.0)
    now, telemetry = flight.navigation[0].place(), flight.autopilot.telemetry
    assert telemetry.fields("GPS_RAW_INT")["alt"] / 1e3 == pytest.approx(now.receiver_altitude_m, abs=0.01)
    assert telemetry.fields("GLOBAL_POSITION_INT")["alt"] / 1e3 == pytest.approx(now.altitude_m, abs=0.01)
    assert abs(now.receiver_altitude_m - now.altitude_m) > 0.1


@both
@pytest.mark.parametrize("seed", [2, 3])
def test_a_take_off_is_told_as_high_as_it_was_asked_for(flavour: str, seed: int) -> None:
    flight = Flight(flavour, scenario=one_vehicle(sigma_m=3.5), seed=seed)
    told = flight.autopilot.telemetry
    assert told.fields("GLOBAL_POSITION_INT")["relative_alt"] == pytest.approx(0.0, abs=1.0)
    flight.advance(60.0)
    assert abs(told.fields("GLOBAL_POSITION_INT")["relative_alt"]) > 50.0  # an estimator wanders, on the ground too
    if flavour == "ardupilot":
        assert flight.set_mode(GUIDED) == ACCEPTED
    assert flight.command(ARM, 1.0) == ACCEPTED
    assert told.fields("GLOBAL_POSITION_INT")["relative_alt"] == pytest.approx(0.0, abs=1.0)
    altitude_m = told.fields("HOME_POSITION")["altitude"] / 1e3 + 30.0 if flavour == "px4" else 30.0
    assert flight.command(TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, altitude_m) == ACCEPTED
    flight.advance(20.0)
    assert -flight.world.position_ned_m[0, 2] == pytest.approx(30.0, abs=0.5)
    assert told.fields("GLOBAL_POSITION_INT")["relative_alt"] / 1e3 == pytest.approx(30.0, abs=1.5)
    assert told.fields("LOCAL_POSITION_NED")["z"] == pytest.approx(-30.0, abs=1.5)
    assert told.fields("ALTITUDE")["altitude_relative"] == pytest.approx(30.0, abs=1.5)


def test_who_starts_in_the_air_counts_its_height_from_a_home_that_is_off_as_it_is() -> None:
    flight = Flight(start=Start.AIRBORNE, scenario=one_vehicle(sigma_m=3.5), seed=3)
    assert abs(flight.navigation[0].position_ned_m[2] + 50.0) > 2.0
    told = flight.autopilot.telemetry
    assert told.fields("GLOBAL_POSITION_INT")["relative_alt"] / 1e3 == pytest.approx(50.0, abs=0.1)
    assert told.fields("LOCAL_POSITION_NED")["z"] == pytest.approx(-50.0, abs=0.1)
