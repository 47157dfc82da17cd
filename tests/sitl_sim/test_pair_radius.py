"""The referee's discs are those of everybody else who heard the same broadcasts."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.observer import Sky
from ridlink.remote_id.accuracy import AccuracyConvention
from ridlink.scenario import Scenario, VehicleSpec
from ridlink.separation.definitions import Definition
from sitl_sim.autopilot import FleetNavigation
from sitl_sim.broadcast import Broadcaster
from sitl_sim.fleet import Fleet
from sitl_sim.fleet_config import DEFAULT_HOME, FleetConfig
from sitl_sim.pair_radius import pair_radius_under
from sitl_sim.world import World
from tests.observer.flights import all_discs

VEHICLES = (
    VehicleSpec((0.0, 0.0, -50.0), (600.0, 0.0, -50.0), speed_mps=10.0, airframe_m=2.0, sigma_m=3.5),
    VehicleSpec((0.0, 90.0, -50.0), (600.0, 90.0, -50.0), speed_mps=5.0, airframe_m=1.0, sigma_m=10.0),
    VehicleSpec((0.0, 180.0, -50.0), (600.0, 180.0, -50.0), speed_mps=10.0, airframe_m=0.6, sigma_m=1.0),
)


HEARD_S = 8.0


def flown(vehicles: tuple[VehicleSpec, ...]) -> World:
    """Three that fly north."""
    world = World(Scenario("three", 60.0, vehicles), autopilot="ideal")
    for index in range(len(vehicles)):
        world.fly_straight(index)
    world.step(1.0)
    return world


def heard(world: World, convention: AccuracyConvention) -> Sky:
    """Whoever has heard them all for HEARD_S: standard Remote ID does not tell how often it is sent."""
    navigation, sky = FleetNavigation(world, DEFAULT_HOME), Sky(convention=convention)
    navigation.refresh()
    for index, spec in enumerate(world.scenario.vehicles):
        clock = count(1_800_000_123.4, 0.1)
        interval_s = float(world.interval_s[index])
        sender = Broadcaster(index + 1, spec, DEFAULT_HOME, interval_s=interval_s, utc_clock=clock.__next__)
        for now_s in np.arange(0.0, HEARD_S, 0.1).tolist():
            for datagram in sender.tick(navigation[index], None, now_s):
                for frame in parse_datagram(datagram, CRC_EXTRAS):
                    assert isinstance(frame, Frame)
                    sky.receive(frame, now_s)
    return sky


@pytest.mark.parametrize("interval_s", [0.1, 1.0])
@pytest.mark.parametrize("convention", AccuracyConvention)
@pytest.mark.parametrize("definition", Definition)
def test_discs_are_those_of_who_hears_the_broadcasts(
    definition: Definition, convention: AccuracyConvention, interval_s: float
) -> None:
    """One of the vehicles sends standard Remote ID: of it others know neither size nor error, but for its code."""
    first, second, third = VEHICLES
    world = flown((replace(first, interval_s=interval_s), second, replace(third, extended=False)))
    judged = pair_radius_under(definition, convention=convention)(world)
    scene = heard(world, convention).at(HEARD_S)
    others = ~np.eye(3, dtype=np.bool_)
    assert judged[others] == pytest.approx(all_discs(scene, definition)[others], abs=0.1)


def test_who_broadcasts_nothing_is_taken_as_it_is() -> None:
    first, second = replace(VEHICLES[0], silent=True, extended=False), VEHICLES[1]
    told, silent = (pair_radius_under(Definition.CANDIDATE2)(flown((one, second))) for one in (VEHICLES[0], first))
    assert silent[0, 1] == pytest.approx(told[0, 1], abs=0.1)


def test_no_interval_is_shorter_than_that_of_the_technology() -> None:
    scenario = Scenario("two", 60.0, (VEHICLES[0], replace(VEHICLES[1], interval_s=2.0)))
    fleet = Fleet(scenario, FleetConfig(technology="bt4"), lambda: 1_800_000_000.0)
    assert fleet.world.interval_s.tolist() == [1.0, 2.0]
