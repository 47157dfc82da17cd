"""F14 to F18, F23, F27 and two daemons on one vehicle: what the vehicle link does to a daemon that flies."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ridlink.daemon.config import DaemonConfig
from ridlink.daemon.service import AvoidDaemon
from ridlink.engine import EngineConfig, Goal
from ridlink.failsafe import OTHER_WRITER, UNHEARD, FailsafeSettings, State
from ridlink.links import SigningOptions, parse_link_url
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, message_spec
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.signing import Signing
from tests.daemon.emulated import (
    GUIDED,
    IN_AIR,
    LOITER,
    OFFBOARD,
    ON_GROUND,
    PATIENCE_S,
    POSITION_MODE,
    TAKING_OFF,
    Emulated,
    LoopbackVehicle,
    at,
)
from tests.daemon.harness import holds, running, state
from tests.daemon.hostile import Hostile, flown
from tests.daemon.invariants import GUARDING
from tests.daemon.process import START_S, daemon
from tests.loopback import free_port, run

AUTOPILOTS = pytest.mark.parametrize(
    ("autopilot", "mode", "other_mode"), [(12, OFFBOARD, POSITION_MODE), (3, GUIDED, LOITER)], ids=["px4", "ardupilot"]
)


@AUTOPILOTS
def test_i3_a_pilots_takeover_silences_the_stream_within_two_periods(
    autopilot: int, mode: int, other_mode: int
) -> None:
    async def test() -> None:
        async with running(emulated=Emulated(autopilot=autopilot)) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 5)
            vehicle.vehicle.mode = other_mode
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: state(flight) is State.STANDBY)
            status = [message.name for message in vehicle.vehicle.heard].count("RIDLINK_STATUS")
            # Two more of its reports are a second or more in which the observer would have seen a third setpoint.
            await vehicle.until(lambda: [m.name for m in vehicle.vehicle.heard].count("RIDLINK_STATUS") >= status + 2)
            assert len(vehicle.setpoints()) <= count + 2
            vehicle.vehicle.mode = mode

    run(test)


@pytest.mark.parametrize(
    ("autopilot", "mode", "mav_type"),
    [(3, GUIDED, 1), (3, GUIDED, 10), (12, OFFBOARD, 1)],
    ids=["a-plane-in-acro", "a-rover-in-hold", "a-px4-with-wings"],
)
def test_i3_what_cannot_hover_is_not_steered_and_that_is_said(autopilot: int, mode: int, mav_type: int) -> None:
    async def test() -> None:
        emulated = Emulated(autopilot=autopilot)
        emulated.mav_type = mav_type
        async with running(emulated=emulated) as flight:
            text = "the vehicle is no multirotor: nothing is flown"
            await flight.vehicle.until(lambda: text in [event.get("text") for event in flight.events])
            await flight.vehicle.speaks(25)
            assert emulated.mode == mode and not flight.vehicle.setpoints()
            assert flight.daemon.engine.rung.reason == "waiting for GUIDED or OFFBOARD"

    run(test)


def test_a_vehicle_that_calls_itself_generic_is_steered() -> None:
    async def test() -> None:
        emulated = Emulated()
        emulated.mav_type = 0
        async with running(emulated=emulated) as flight:
            await flight.vehicle.until(lambda: any(setpoint.vx > 0.5 for setpoint in flight.vehicle.setpoints()))

    run(test)


@pytest.mark.parametrize(("mav_type", "asked"), [(1, set()), (2, {(176, GUIDED)})], ids=["plane", "copter"])
def test_i3_a_guard_leaves_a_pilots_mode_alone_that_a_copter_would_fly_by_itself(
    mav_type: int, asked: set[tuple[int, int]]
) -> None:
    """Mode 6 is RTL to an ArduPilot Copter. To a Plane it is FBWB, flown by a pilot, and 4 is ACRO."""

    async def test() -> None:
        emulated = Emulated(autopilot=3)
        emulated.mav_type, emulated.mode = mav_type, 6
        emulated.observer.may |= GUARDING
        async with running(emulated=emulated, engine=EngineConfig(guard=True)) as flight:
            async with asyncio.timeout(PATIENCE_S):
                await flight.air.changed.wait()
            began_s, link = time.monotonic(), flight.air.link
            assert link is not None

            def sees_the_conflict() -> bool:
                link.send(Emulated(9, ned_m=(5.0, 0.0, -50.0)).remote_id(time.monotonic() - began_s))
                return any(event.get("conflicts") for event in flight.events)

            await flight.vehicle.until(sees_the_conflict)
            await flight.vehicle.speaks(40)
            commands = [message for message in emulated.heard if message.name == "COMMAND_LONG"]
            assert {(each.command, int(each.param2)) for each in commands if each.command in GUARDING} == asked

    run(test)


def test_an_ardupilot_whose_positions_others_asked_for_is_asked_whether_it_takes_off() -> None:
    """A setpoint in an automatic take-off ends the climb for good, and no stream of a ground station tells of one."""

    async def test() -> None:
        emulated = Emulated(autopilot=3)
        emulated.armed, emulated.landed_state = False, None
        async with running(emulated=emulated) as flight:

            def asked() -> set[int]:
                return {int(message.param1) for message in emulated.heard if message.name == "COMMAND_LONG"}

            await flight.vehicle.until(lambda: asked() == {85, 193, 245})
            emulated.landed_state = TAKING_OFF
            await flight.vehicle.speaks(5)
            emulated.armed = True
            await flight.vehicle.until(lambda: "take-off" in flight.daemon.engine.rung.reason)
            await flight.vehicle.speaks(25)
            assert not flight.vehicle.setpoints()
            emulated.landed_state = IN_AIR
            await flight.vehicle.until(lambda: state(flight) is State.ENGAGED)

    run(test)


@AUTOPILOTS
def test_offboard_lost_by_the_autopilot_itself_is_regained_by_an_operators_request_only(
    autopilot: int, mode: int, other_mode: int
) -> None:
    async def test() -> None:
        async with running(emulated=Emulated(autopilot=autopilot)) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 3)
            vehicle.vehicle.mode = other_mode
            await vehicle.until(lambda: state(flight) is State.STANDBY)
            vehicle.vehicle.mode = mode
            vehicle.vehicle.obeyed = False
            status = len(vehicle.vehicle.heard)
            await vehicle.until(lambda: len(vehicle.vehicle.heard) >= status + 2)
            assert state(flight) is State.STANDBY
            goal = at(200.0)
            vehicle.send(vehicle.vehicle.encoder.encode(
                "COMMAND_INT", command=192, target_system=1, target_component=196, frame=0,
                x=round(goal[0] * 1e7), y=round(goal[1] * 1e7), z=goal[2],
            ))  # fmt: skip
            await vehicle.until(lambda: state(flight) is State.ENGAGED)
            await vehicle.until(lambda: vehicle.setpoints()[-1].vx > 0.5)

    run(test)


def test_f14_gnss_lost_in_mid_conflict_holds_and_comes_back() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle, intruder = flight.vehicle, Emulated(9)
            async with asyncio.timeout(PATIENCE_S):
                await flight.air.changed.wait()
            assert flight.air.link is not None
            began_s = time.monotonic()
            intruder.velocity[:] = (-10.0, 0.0, 0.0)

            def report() -> None:
                assert flight.air.link is not None
                # Ahead of where own-ship is now: one that is passed is no conflict any more.
                intruder.position = vehicle.vehicle.position + np.array((90.0, 5.0, 0.0))
                flight.air.link.send(intruder.remote_id(time.monotonic() - began_s))

            def in_conflict() -> bool:
                if not len(flight.daemon.engine.picture):  # not heard yet, or not any more: a busy machine
                    report()
                return any(event.get("conflicts") == 1 for event in flight.events)

            await vehicle.until(in_conflict)
            vehicle.vehicle.fix_type = 1  # positions keep coming
            await vehicle.until(lambda: holds(flight, "stale"))
            await vehicle.until(lambda: [m.vx for m in vehicle.setpoints()[-2:]] == [0.0, 0.0])
            assert len(flight.daemon.engine.picture) == 1, "the traffic is still there"
            vehicle.vehicle.fix_type = 3
            report()
            await vehicle.until(lambda: state(flight) is State.ENGAGED)

    run(test)


def test_f14_an_own_state_that_stays_away_ends_the_stream_on_purpose_after_a_hold() -> None:
    async def test() -> None:
        impatient = FailsafeSettings(hold_after_s=0.4, stop_after_s=2.5)  # a busy machine may pause it for a second
        async with running(engine=EngineConfig(goal=Goal(*at(300.0)), failsafe=impatient)) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: bool(vehicle.setpoints()) and vehicle.setpoints()[-1].vx > 0.5)
            vehicle.frozen = True
            await vehicle.until(lambda: holds(flight, "stale"))
            await vehicle.until(lambda: state(flight) is State.STOPPED)
            count = len(vehicle.setpoints())
            assert [message.vx for message in vehicle.setpoints()[-3:]] == [0.0, 0.0, 0.0], "zero goes first"
            vehicle.frozen = False  # it comes back, and nobody asked
            await vehicle.speaks(25)
            assert len(vehicle.setpoints()) <= count + 1 and state(flight) is State.STOPPED

    run(test)


def test_f14_a_px4_that_never_has_a_position_in_offboard_is_left_to_its_own_failsafe() -> None:
    async def test() -> None:
        emulated = Emulated()
        emulated.fix_type = 1
        impatient = EngineConfig(goal=Goal(*at(300.0)), failsafe=FailsafeSettings(hold_after_s=0.4, stop_after_s=1.0))
        async with running(emulated=emulated, engine=impatient) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: state(flight) is State.STOPPED)
            count = len(vehicle.setpoints())
            assert {(m.vx, m.vy, m.vz) for m in vehicle.setpoints()} == {(0.0, 0.0, 0.0)}
            emulated.fix_type = 3  # it comes back, and nobody asked
            await vehicle.speaks(25)
            assert len(vehicle.setpoints()) <= count + 1 and state(flight) is State.STOPPED

    run(test)


def test_f14_a_receiver_that_lost_its_fix_and_fell_silent_is_not_believed_again() -> None:
    async def test() -> None:
        emulated = Emulated()
        emulated.fix_type = 1
        patient = EngineConfig(goal=Goal(*at(300.0)), failsafe=FailsafeSettings(stop_after_s=60.0))
        async with running(emulated=emulated, engine=patient) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: flight.daemon.engine.counters["own_position_untrusted"] > 0)
            emulated.receiver_silent = True  # positions keep coming
            await vehicle.until(lambda: any(message.name == "COMMAND_LONG" for message in emulated.heard))
            await vehicle.speaks(25)
            assert flight.daemon.engine.rung.reason == "waiting: own state is stale: no position to trust for 1 s"
            emulated.fix_type, emulated.receiver_silent = 3, False
            await vehicle.until(lambda: state(flight) is State.ENGAGED)

    run(test)


def test_i3_a_vehicle_that_stands_on_the_ground_is_not_made_to_take_off() -> None:
    """It came down in its mode, at a goal that is too low or by an accident; somebody may walk up to it."""

    async def test() -> None:
        async with running(engine=EngineConfig(goal=Goal(*at(300.0, 0.0, 80.0)))) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: bool(vehicle.setpoints()) and vehicle.setpoints()[-1].vz < -0.5)
            vehicle.vehicle.landed_state = ON_GROUND
            await vehicle.until(lambda: holds(flight, "on the ground"))
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 10)
            assert {(m.vx, m.vy, m.vz) for m in vehicle.setpoints()[count:]} == {(0.0, 0.0, 0.0)}
            vehicle.vehicle.landed_state = IN_AIR
            await vehicle.until(lambda: state(flight) is State.ENGAGED)

    run(test)


def test_f16_a_jump_of_the_own_position_holds_for_a_second() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 4)
            vehicle.vehicle.position[1] += 60.0
            await vehicle.until(lambda: holds(flight, "own position jumped"))
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: state(flight) is State.ENGAGED)
            held = [message.vx for message in vehicle.setpoints()[count:-1]]
            assert len(held) >= 7 and set(held) == {0.0}
            assert flight.daemon.engine.counters["own_position_jump"] == 1

    run(test)


def test_f15_an_autopilot_that_restarts_is_not_steered_again_unasked() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 4)
            vehicle.began_s += 3600.0
            vehicle.send(vehicle.vehicle.encoder.encode("GLOBAL_POSITION_INT", time_boot_ms=90_000_000))
            await vehicle.until(lambda: state(flight) is State.STANDBY)
            assert "restarted" in flight.daemon.engine.rung.reason

    run(test)


def test_f15_an_autopilot_that_falls_silent_is_not_steered_again_unasked() -> None:
    async def test() -> None:
        impatient = FailsafeSettings(heartbeat_lost_s=0.5)
        async with running(engine=EngineConfig(goal=Goal(*at(300.0)), failsafe=impatient)) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 4)
            vehicle.silent = True
            await vehicle.until(lambda: state(flight) is State.STANDBY)
            assert flight.daemon.engine.rung.reason == "no heartbeat of the autopilot for 0.5 s, it was armed"
            count = len(vehicle.setpoints())
            vehicle.silent = False
            await vehicle.speaks(25)
            assert len(vehicle.setpoints()) <= count + 1 and state(flight) is State.STANDBY

    run(test)


def test_f17_a_process_that_was_stopped_comes_back_with_one_hold_and_no_burst() -> None:
    async def test() -> None:
        goal = ",".join(f"{value:.7f}" for value in at(300.0))
        async with daemon("--goal", goal) as (process, port), LoopbackVehicle(Emulated(), port) as vehicle:
            async with asyncio.timeout(START_S):
                while not (vehicle.setpoints() and vehicle.setpoints()[-1].vx > 0.5):
                    await vehicle.changed()
            process.send_signal(signal.SIGSTOP)
            await vehicle.speaks(5)  # what was under way arrives
            count = len(vehicle.setpoints())
            await vehicle.speaks(25)
            assert len(vehicle.setpoints()) == count
            process.send_signal(signal.SIGCONT)
            await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 6)
            after = vehicle.setpoints()[count:]
            assert (after[0].vx, after[0].vy, after[0].vz) == (0.0, 0.0, 0.0)
            # A busy machine may make one late, and the next one is due on the grid; a third is a whole period away.
            spans = [c.time_boot_ms - a.time_boot_ms for a, c in zip(after, after[2:], strict=False)]
            assert min(spans) > 95, f"a burst: {spans}"
            await vehicle.until(lambda: vehicle.setpoints()[-1].vx > 0.5)

    run(test)


def test_f18_a_neighbour_across_the_antimeridian_is_near_and_one_track() -> None:
    east_m = 12_942_985.0  # from home to the antimeridian

    async def test(hostile: Hostile) -> None:
        assert abs(hostile.last.own.position.longitude_deg) > 179.99  # type: ignore[union-attr]
        other = Emulated(9, ned_m=(0.0, east_m - 2.0, -50.0))
        other.velocity[:] = (0.0, 5.0, 0.0)
        for k in range(9):  # from one side to the other
            await hostile.send(other.remote_id(0.1 * k))
            count = len(hostile.vehicle.setpoints())
            await hostile.vehicle.until(lambda count=count: len(hostile.vehicle.setpoints()) > count)  # type: ignore[misc]
            other.advance(0.1)
        (track,) = hostile.picture.tracks.values()
        assert track.longitude_deg < 0.0 < hostile.last.own.position.longitude_deg  # type: ignore[union-attr]
        assert track.filter.resets == 0
        assert np.hypot(*hostile.snapshot().position_ned_m[0, :2]) < 200.0

    goal = EngineConfig(goal=Goal(at(0.0)[0], -179.999))
    flown(test, goal, emulated=Emulated(ned_m=(0.0, east_m - 60.0, -50.0)))


def test_f18_beyond_85_degrees_nothing_is_flown() -> None:
    async def test() -> None:
        polar, near = Emulated(ned_m=(4_290_000.0, 0.0, -50.0)), Goal(84.9, at(0.0)[1])
        async with running(emulated=polar, engine=EngineConfig(goal=near)) as flight:
            await flight.vehicle.until(lambda: "latitude" in flight.daemon.engine.rung.reason)
            assert flight.daemon.engine.rung.reason == "waiting: latitude beyond 85 degrees"
            await flight.vehicle.speaks(25)
            assert {(message.vx, message.vy) for message in flight.vehicle.setpoints()} <= {(0.0, 0.0)}

    run(test)


def test_i3_two_daemons_on_one_vehicle_the_second_notices_and_stands_by() -> None:
    async def test() -> None:
        async with running() as first:
            vehicle, stop = first.vehicle, asyncio.Event()
            vehicle.passes_on = False  # all that is left to notice is what it flies after
            await vehicle.until(lambda: len(vehicle.setpoints()) > 40)
            config = replace(first.daemon.config, engine=EngineConfig(goal=Goal(*at(0.0, 300.0))))
            second = AvoidDaemon(config)
            task = asyncio.create_task(second.run(stop))
            await second.ready.wait()
            assert second.vehicle_address is not None
            await vehicle.join(second.vehicle_address[1])
            await vehicle.until(lambda: second.engine.rung.reason == OTHER_WRITER)
            count, foreign = len(vehicle.setpoints()), len(vehicle.second.setpoints)
            assert 1 <= foreign <= 35
            await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 12)
            assert len(vehicle.second.setpoints) <= foreign + 1
            assert state(first) is State.ENGAGED and second.engine.rung.state is State.STANDBY
            stop.set()
            await task

    run(test)


def test_an_ardupilot_that_hears_no_setpoints_any_more_has_no_other_writer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ridlink.own_ship.other_writer.GIVE_UP_S", 1.0)

    async def test() -> None:
        async with running(emulated=Emulated(autopilot=3)) as flight:
            vehicle, engine = flight.vehicle, flight.daemon.engine
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 35)
            vehicle.deaf = True
            vehicle.vehicle.velocity = np.zeros(3)  # GUID_TIMEOUT is over
            await vehicle.until(lambda: state(flight) is not State.ENGAGED)
            assert engine.rung.reason == UNHEARD and engine.counters["other_writer"] == 0
            await vehicle.until(lambda: any(event["event"] == "warning" for event in flight.events))
            assert {event["text"] for event in flight.events if event["event"] == "warning"} == {UNHEARD}

    run(test)


@AUTOPILOTS
def test_f27_started_beside_a_vehicle_that_waits_in_its_mode_the_first_setpoint_is_zero(
    autopilot: int, mode: int, other_mode: int
) -> None:
    async def test() -> None:
        async with running(emulated=Emulated(autopilot=autopilot)) as flight:
            vehicle = flight.vehicle
            assert vehicle.vehicle.mode == mode != other_mode
            await vehicle.until(lambda: bool(vehicle.setpoints()) and vehicle.setpoints()[-1].vx > 0.0)
            assert (vehicle.setpoints()[0].vx, vehicle.setpoints()[0].vy) == (0.0, 0.0)

    run(test)


def test_f27_a_px4_in_offboard_gets_zero_velocity_while_the_kernels_are_still_loaded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    release = threading.Event()
    monkeypatch.setattr("ridlink.daemon.warming.warm_up", lambda _: release.wait())

    async def test() -> None:
        stop, port, air = asyncio.Event(), free_port(), free_port()
        vehicle_url, air_url = (parse_link_url(f"{way}:127.0.0.1:{p}") for way, p in (("udpin", port), ("udpout", air)))
        config = DaemonConfig(vehicle_url, air_url, EngineConfig(goal=Goal(*at(300.0))))
        task = asyncio.create_task(AvoidDaemon(config).run(stop))
        try:
            async with LoopbackVehicle(Emulated(), port) as vehicle:
                await vehicle.until(lambda: len(vehicle.setpoints()) >= 3)
                assert {(message.vx, message.vy) for message in vehicle.setpoints()} == {(0.0, 0.0)}
        finally:
            stop.set()
            release.set()
            await task

    run(test)


@pytest.mark.parametrize(("autopilot", "words"), [(12, 0), (3, 0), (12, 50)], ids=["px4", "ardupilot", "px4-1s"])
def test_of_two_daemons_started_together_exactly_one_flies(autopilot: int, words: int) -> None:
    async def test() -> None:
        async with running(emulated=Emulated(autopilot=autopilot)) as one:
            vehicle, stop = one.vehicle, asyncio.Event()
            other = AvoidDaemon(replace(one.daemon.config, engine=EngineConfig(goal=Goal(*at(0.0, 300.0)))))
            task = asyncio.create_task(other.run(stop))
            await other.ready.wait()
            assert other.vehicle_address is not None
            await vehicle.speaks(words)
            await vehicle.join(other.vehicle_address[1])
            engines = one.daemon.engine, other.engine
            await vehicle.until(lambda: OTHER_WRITER in [engine.rung.reason for engine in engines])
            flies = next(engine for engine in engines if engine.rung.reason != OTHER_WRITER)
            begun = flies.setpoints.sent
            await vehicle.until(lambda: flies.setpoints.sent >= begun + 40)
            assert [engine.rung.state for engine in engines].count(State.ENGAGED) == 1
            assert flies.rung.state is State.ENGAGED
            assert not words or flies is one.daemon.engine, "the first one"
            stop.set()
            await task

    run(test)


def test_f27_killed_in_mid_flight_and_started_again_it_begins_with_zero_velocity() -> None:
    async def test() -> None:
        port, air = free_port(), free_port()
        goal = ",".join(f"{value:.7f}" for value in at(300.0))

        async def start() -> asyncio.subprocess.Process:
            return await asyncio.create_subprocess_exec(
                sys.executable, "-m", "ridlink", "avoid", "--vehicle", f"udpin:127.0.0.1:{port}",
                "--rid", f"udpout:127.0.0.1:{air}", "--goal", goal,
                stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
            )  # fmt: skip

        process = await start()
        try:
            async with LoopbackVehicle(Emulated(), port) as vehicle:
                async with asyncio.timeout(60.0):
                    while not (vehicle.setpoints() and vehicle.setpoints()[-1].vx > 0.5):
                        await vehicle.changed()
                os.kill(process.pid, signal.SIGKILL)
                await process.wait()
                vehicle.vehicle.observer = type(vehicle.vehicle.observer)()
                process = await start()
                async with asyncio.timeout(60.0):
                    while len(vehicle.setpoints()) < 3:
                        await vehicle.changed()
                assert (vehicle.setpoints()[0].vx, vehicle.setpoints()[0].vy) == (0.0, 0.0)
                process.send_signal(signal.SIGTERM)
                async with asyncio.timeout(PATIENCE_S):
                    assert await process.wait() == 0
                await vehicle.until(lambda: [m.vx for m in vehicle.setpoints()[-3:]] == [0.0] * 3)
        finally:
            if process.returncode is None:
                process.kill()
            await process.wait()

    run(test)


class SignedEncoder(Encoder):
    """Signs what it encodes."""

    __slots__ = ("signing",)

    def __init__(self, sysid: int, key: bytes) -> None:
        super().__init__(sysid, 1)
        self.signing = Signing(key)

    def encode(self, name: str, /, **fields: Any) -> bytes:
        frame = super().encode(name, **fields)
        return self.signing.sign(frame, message_spec(name).crc_extra, time.time())


def test_f23_an_unsigned_or_wrongly_signed_autopilot_is_nobody_and_a_signed_one_is_flown(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)

    async def test() -> None:
        async with running(signing=SigningOptions(key, required=True, link_id=1)) as flight:
            vehicle, emulated = flight.vehicle, flight.vehicle.vehicle
            link = flight.daemon._vehicle
            assert link is not None
            await vehicle.until(lambda: link.counters["unsigned"] > 10)
            emulated.encoder = SignedEncoder(1, bytes(32))
            await vehicle.until(lambda: link.counters["signature_wrong"] > 10)
            assert flight.daemon.engine.vehicle_source is None and not vehicle.setpoints()
            emulated.encoder = SignedEncoder(1, bytes(range(32)))
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 5)
            judge = Signing(bytes(range(32)))
            frames = parse_datagram(vehicle.last, CRC_EXTRAS)
            assert all(isinstance(frame, Frame) and judge.refusal(frame, time.time()) is None for frame in frames)
            told = [event["text"] for event in flight.events if event["event"] == "warning"]
            assert "frames on the vehicle link are refused: unsigned" in told

    run(test)
