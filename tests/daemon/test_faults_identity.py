"""F15 to F17 once more: whose telemetry it is, and by which clock."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from ridlink.engine import EngineConfig, Goal
from ridlink.failsafe import State
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from tests.captures.drawn import version_1
from tests.daemon.emulated import PATIENCE_S, Emulated, LoopbackVehicle, at
from tests.daemon.harness import Running, holds, running, state
from tests.loopback import run

ASIDE_M = (80.0, 80.0, -50.0)


async def flying(flight: Running) -> LoopbackVehicle:
    """Its vehicle, for a minute already by its own clock."""
    vehicle = flight.vehicle
    await vehicle.until(lambda: len(vehicle.setpoints()) >= 2)
    vehicle.began_s -= 60.0
    await vehicle.until(lambda: len(vehicle.setpoints()) >= 4)
    return vehicle


@pytest.mark.parametrize("step_s", [0.5, 1.5, 3600.0])
def test_f17_a_vehicle_whose_clock_leaps_ahead_is_flown_on(step_s: float) -> None:
    """What was flown meanwhile by that clock was not flown."""

    async def test() -> None:
        async with running() as flight:
            vehicle = await flying(flight)
            vehicle.began_s -= step_s
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 8)
            assert all(after.vx > 0.0 for after in vehicle.setpoints()[count:])
            assert state(flight) is State.ENGAGED
            assert "own_position_jump" not in flight.daemon.engine.counters

    run(test)


def test_f17_a_clock_that_is_set_back_by_less_than_a_restart_costs_no_more_than_it_was_set_back() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle, engine = await flying(flight), flight.daemon.engine
            vehicle.began_s += 0.6
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: engine.counters["own_position_delayed"] > 0)
            await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 8)
            assert state(flight) is State.ENGAGED and engine.counters["own_position_late"] > 5

    run(test)


def test_f15_an_autopilot_whose_clock_begins_at_zero_again_has_restarted() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = await flying(flight)
            vehicle.began_s = asyncio.get_running_loop().time()
            async with asyncio.timeout(PATIENCE_S):
                while state(flight) is not State.STANDBY:
                    await vehicle.speaks(1)
            assert flight.daemon.engine.rung.reason == "the autopilot restarted"
            count = len(vehicle.setpoints())
            await vehicle.speaks(15)
            assert len(vehicle.setpoints()) <= count + 1

    run(test)


class Old(Emulated):
    """Says in MAVLink 1 that it is there."""

    def heartbeat(self) -> bytes:
        (beat,) = parse_datagram(super().heartbeat(), CRC_EXTRAS)
        assert isinstance(beat, Frame)
        return version_1(beat.msgid, beat.payload, CRC_EXTRAS[beat.msgid])


@pytest.mark.parametrize(
    ("vehicle", "pinned", "words"),
    [
        (Old(), None, "the vehicle speaks MAVLink 1, which is not taken: set it to MAVLink 2, or give --allow-v1"),
        (Emulated(), 7, "autopilots are heard, none of them with system id 7"),
    ],
    ids=["mavlink-1", "another-system-id"],
)
def test_why_an_autopilot_that_speaks_is_not_taken_is_told_once(
    vehicle: Emulated, pinned: int | None, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ridlink.engine.unheard.ENOUGH", 1)
    vehicle.observer.target = pinned or vehicle.sysid  # whom we speak for

    async def test() -> None:
        config = EngineConfig(goal=Goal(*at(300.0)), vehicle_sysid=pinned)
        async with running(emulated=vehicle, engine=config) as flight:

            def told(event: str) -> list[dict[str, Any]]:
                return [facts for facts in flight.events if facts["event"] == event]

            await flight.vehicle.until(lambda: bool(told("warning")))
            summaries = len(told("summary"))
            await flight.vehicle.until(lambda: len(told("summary")) >= summaries + 2)
            assert [facts["text"] for facts in told("warning")] == [words]
            assert flight.daemon.engine.rung.reason == "waiting for an autopilot"

    run(test)


def test_of_two_vehicles_with_one_system_id_the_first_one_heard_is_flown() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = await flying(flight)
            assert flight.daemon.vehicle_address is not None
            async with LoopbackVehicle(Emulated(1, ned_m=ASIDE_M), flight.daemon.vehicle_address[1]) as twin:
                await twin.speaks(25)
                count = len(vehicle.setpoints())
                await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 3)
                assert twin.setpoints() == []
            assert state(flight) is State.ENGAGED
            counters = flight.daemon.engine.counters
            assert counters["foreign_autopilot"] > 10 and "own_position_jump" not in counters

    run(test)


def test_f16_two_vehicles_with_one_system_id_behind_one_address_are_no_place_to_fly_from() -> None:
    """A router mixes them: the place leaps with every message, and what is sent stops whichever gets it."""

    async def test() -> None:
        async with running() as flight:
            vehicle = await flying(flight)
            twin = Emulated(1, ned_m=ASIDE_M)
            own = vehicle.vehicle.position_messages
            vehicle.vehicle.position_messages = lambda now_s: own(now_s) + twin.position_messages(now_s)  # type: ignore[method-assign]
            await vehicle.until(lambda: holds(flight, "own position jumped"))
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 15)  # more than the second of one jump
            assert {(sent.vx, sent.vy, sent.vz) for sent in vehicle.setpoints()[count + 1 :]} == {(0.0, 0.0, 0.0)}

    run(test)
