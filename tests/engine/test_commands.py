"""Which commands the engine takes, and from whom."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ridlink.engine import Engine, EngineConfig
from ridlink.mavlink.codec import Encoder
from tests.daemon.emulated import Emulated, at
from tests.engine.flight import Flight, config, reposition


def test_standby_waits_for_a_goal() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step(10)
    assert flight.vehicle.observer.setpoints == []
    assert flight.command("COMMAND_INT", **reposition()) == 0
    flight.step(100)
    assert flight.vehicle.position == pytest.approx((30.0, 0.0, -50.0), abs=0.5)


def test_a_goal_given_with_standby_is_not_flown_to_unasked() -> None:
    flight = Flight(settings=config(standby=True))
    flight.step(10)
    assert flight.vehicle.observer.setpoints == []


@pytest.mark.parametrize(
    ("name", "fields", "result"),
    [
        ("COMMAND_INT", {"z": math.nan}, 0),
        ("COMMAND_INT", {"frame": 6, "z": 60.0}, 0),
        ("COMMAND_INT", {"frame": 3, "z": math.nan}, 0),
        ("COMMAND_INT", {"frame": 1}, 2),
        ("COMMAND_INT", {"x": 0, "y": 0}, 2),
        ("COMMAND_INT", {"x": 0x7FFFFFFF}, 2),
        ("COMMAND_INT", {"x": 860_000_000}, 2),
        ("COMMAND_INT", {"y": 1_900_000_000}, 2),
        ("COMMAND_INT", {"z": math.inf}, 2),
        ("COMMAND_INT", {"x": 85_456_000, "y": 473_977_000}, 2),  # longitude first: 5,660 km away
        ("COMMAND_INT", {"command": 176}, 3),
        ("COMMAND_INT", {"target_component": 1}, None),
        ("COMMAND_INT", {"target_component": 0}, None),
        ("COMMAND_INT", {"target_system": 2}, None),
        ("COMMAND_INT", {"source": "elsewhere"}, None),
    ],
)
def test_answers_to_commands(name: str, fields: dict[str, Any], result: int | None) -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    assert flight.command(name, **reposition(**fields)) == result
    assert flight.engine.rung.requested is (result == 0)
    if fields.get("frame") == 6:
        assert flight.engine.goal is not None
        assert flight.engine.goal.altitude_m == pytest.approx(560.0, abs=0.01)


def test_a_goal_too_far_away_that_was_taken_without_a_position_is_not_flown_to() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.telling = False
    flight.engine.receive_vehicle(flight.vehicle.heartbeat(), 0.0, source="autopilot")
    assert flight.command("COMMAND_INT", **reposition(x=85_456_000, y=473_977_000)) == 0
    flight.telling = True
    flight.step(20)
    assert flight.engine.rung.reason == "waiting for another goal: this one is more than 300 km away"
    assert flight.vehicle.position == pytest.approx((0.0, 0.0, -50.0))
    assert flight.command("COMMAND_INT", **reposition()) == 0
    flight.step(100)
    assert flight.vehicle.position == pytest.approx((30.0, 0.0, -50.0), abs=0.5)


def test_a_goal_too_far_away_changes_nothing_of_a_flight() -> None:
    flight = Flight(settings=config())
    flight.step(10)
    goal = flight.engine.goal
    assert flight.command("COMMAND_INT", **reposition(x=85_456_000, y=473_977_000)) == 2
    flight.step()
    assert flight.engine.goal == goal and flight.engine.rung.reason == "avoiding"


def test_command_long_names_a_goal_too() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    latitude, longitude, altitude = at(30.0)
    fields = {"command": 192, "param5": latitude, "param6": longitude, "param7": altitude}
    assert flight.command("COMMAND_LONG", **fields) == 0
    assert flight.engine.goal is not None
    assert flight.engine.goal.latitude_deg == pytest.approx(latitude, abs=1e-5)


def test_a_relative_altitude_needs_a_home() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.telling = False
    flight.engine.receive_vehicle(flight.vehicle.heartbeat(), 0.0, source="autopilot")
    assert flight.command("COMMAND_INT", **reposition(frame=6, z=60.0)) == 2


def test_commands_from_the_host_of_the_autopilot_are_taken_and_answered_where_they_came_from() -> None:
    engine = Engine(EngineConfig(standby=True))
    vehicle = Emulated()
    engine.receive_vehicle(vehicle.telemetry(0.0), 0.0, source=("127.0.0.1", 14580))
    frame = Encoder(255, 190).encode("COMMAND_INT", target_system=1, target_component=196, **reposition())
    engine.receive_vehicle(frame, 0.0, source=("127.0.0.1", 40000))
    engine.receive_vehicle(frame, 0.0, source=("192.0.2.1", 40000))
    assert [address for _, address in engine.step(0.0).replies] == [("127.0.0.1", 40000)]
    assert engine.counters["foreign_command"] == 1


def test_a_flood_of_commands_is_answered_in_part() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    frame = Encoder(255, 190).encode("COMMAND_INT", target_system=1, target_component=196, **reposition())
    for _ in range(10):
        flight.engine.receive_vehicle(frame * 10, flight.now_s, source="autopilot")
    assert len(flight.step().replies) == 16
    assert flight.engine.counters["command_refused"] == 84
    assert flight.command("COMMAND_INT", **reposition()) == 0
