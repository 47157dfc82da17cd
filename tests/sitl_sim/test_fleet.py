"""A fleet in virtual time, without a socket: who broadcasts, and when its mission begins."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink import mavutil

from ridlink.scenario import Event, Scenario, VehicleSpec
from sitl_sim.autopilot import Mode, Start
from sitl_sim.autopilot.guidance import Velocity
from sitl_sim.autopilot.modes import ARDUPILOT
from sitl_sim.fleet import Fleet
from sitl_sim.fleet_config import FleetConfig
from sitl_sim.vehicle import TICK_S, VehicleState
from tests.sitl_sim.flight import UTC_S

NEAR = VehicleSpec((0.0, 0.0, -50.0), (2.0, 0.0, -50.0))
"""Starts where it has arrived already."""


def fleet_of(*vehicles: VehicleSpec, events: tuple[Event, ...] = (), **config: Any) -> Fleet:
    return Fleet(Scenario("some", 60.0, vehicles, events=events), FleetConfig(sigma_m=0.0, **config), lambda: UTC_S)


def live_on(fleet: Fleet, duration_s: float) -> None:
    """Let everybody live on as a fleet on the network does, tick by tick."""
    for _ in range(round(duration_s / TICK_S)):
        fleet.world.step(TICK_S)
        fleet.look()
        for index, autopilot in enumerate(fleet.autopilots):
            autopilot.tick(fleet.world.time_s)
            fleet.broadcast(index, fleet.world.time_s)


@pytest.mark.parametrize(("remote_id", "sent"), [(True, True), (False, False)])
def test_without_remote_id_the_air_is_left_to_the_daemons(remote_id: bool, sent: bool) -> None:
    fleet = fleet_of(NEAR, start=Start.HOLDING, remote_id=remote_id)
    live_on(fleet, 1.0)
    assert (fleet.air.counters["broadcast"] > 0) == sent


def test_before_a_holding_fleet_is_handed_over_nothing_is_judged_and_nothing_goes_wrong() -> None:
    """A daemon that is new to the machine compiles for so long that the faults of the flight came before it."""
    fleet = fleet_of(NEAR, events=(Event(1.0, 1, "gnss-outage", {"duration_s": 0.0}),), start=Start.HOLDING)
    world = fleet.world
    live_on(fleet, 5.0)
    assert not fleet.begins_by_itself and fleet.snapshot()["mission_time_s"] is None
    assert world.mission_time_s == 0.0 and world.receivers.fix_type[0] == 3
    assert not world.arrived.any() and world.state[0] == VehicleState.AIRBORNE
    fleet.begin_mission()
    live_on(fleet, 0.9)
    assert world.arrived.all() and world.receivers.fix_type[0] == 3
    live_on(fleet, 0.2)
    assert world.receivers.fix_type[0] != 3


@pytest.mark.parametrize("mode", ARDUPILOT.custom_modes)
def test_modes_of_ardupilot_are_called_what_its_ground_stations_call_them(mode: Mode) -> None:
    fleet = fleet_of(NEAR, autopilot="ardupilot", start=Start.HOLDING)
    fleet.autopilots[0].pilot.enter(mode, Velocity())
    [vehicle] = fleet.snapshot()["vehicles"]
    assert vehicle["mode"] == mavutil.mode_mapping_acm[ARDUPILOT.custom_modes[mode]]


def test_modes_of_px4_keep_the_names_that_it_gives_them() -> None:
    fleet = fleet_of(NEAR, start=Start.HOLDING)
    assert fleet.snapshot()["vehicles"][0]["mode"] == "hold"
    fleet.autopilots[0].pilot.enter(Mode.RETURN, Velocity())
    assert fleet.snapshot()["vehicles"][0]["mode"] == "return"
