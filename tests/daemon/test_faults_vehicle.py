"""F14 to F17, F23, F27 and two daemons on one vehicle: what the vehicle link does to a daemon that flies."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ridlink.daemon.service import AvoidDaemon
from ridlink.engine import EngineConfig, Goal
from ridlink.failsafe import State
from ridlink.links import SigningOptions
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, message_spec
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.signing import Signing
from tests.cli.test_avoid import free_port
from tests.daemon.emulated import GUIDED, LOITER, OFFBOARD, PATIENCE_S, POSITION_MODE, Emulated, LoopbackVehicle, at
from tests.daemon.harness import Running, run, running

AUTOPILOTS = pytest.mark.parametrize(
    ("autopilot", "mode", "other_mode"), [(12, OFFBOARD, POSITION_MODE), (3, GUIDED, LOITER)], ids=["px4", "ardupilot"]
)


def state(flight: Running) -> State:
    return flight.daemon.engine.rung.state


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
            vehicle, intruder = flight.vehicle, Emulated(9, ned_m=(90.0, 5.0, -50.0))
            async with asyncio.timeout(PATIENCE_S):
                await flight.air.changed.wait()
            assert flight.air.link is not None
            began_s = time.monotonic()

            def report() -> None:
                assert flight.air.link is not None
                flight.air.link.send(intruder.remote_id(time.monotonic() - began_s))

            report()
            await vehicle.until(lambda: flight.events[-1].get("conflicts") == 1)
            vehicle.vehicle.fix_type = 1  # positions keep coming
            await vehicle.until(lambda: state(flight) is State.HOLD)
            await vehicle.until(lambda: [m.vx for m in vehicle.setpoints()[-2:]] == [0.0, 0.0])
            assert len(flight.daemon.engine.picture) == 1, "the traffic is still there"
            vehicle.vehicle.fix_type = 3
            report()
            await vehicle.until(lambda: state(flight) is State.ENGAGED)

    run(test)


def test_f16_a_jump_of_the_own_position_holds_for_a_second() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 4)
            vehicle.vehicle.position[1] += 60.0
            await vehicle.until(lambda: state(flight) is State.HOLD)
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


def test_two_daemons_on_one_vehicle_the_second_notices_and_stands_by() -> None:
    async def test() -> None:
        async with running() as first:
            vehicle, stop = first.vehicle, asyncio.Event()
            await vehicle.until(lambda: len(vehicle.setpoints()) > 40)
            config = replace(first.daemon.config, engine=EngineConfig(goal=Goal(*at(0.0, 300.0))))
            second = AvoidDaemon(config)
            task = asyncio.create_task(second.run(stop))
            await second.ready.wait()
            assert second.vehicle_address is not None
            await vehicle.join(second.vehicle_address[1])
            await vehicle.until(lambda: second.engine.rung.reason == "another writer steers this vehicle")
            count, foreign = len(vehicle.setpoints()), len(vehicle.second.setpoints)
            assert 1 <= foreign <= 35
            await vehicle.until(lambda: len(vehicle.setpoints()) >= count + 12)
            assert len(vehicle.second.setpoints) <= foreign + 1
            assert state(first) is State.ENGAGED and second.engine.rung.state is State.STANDBY
            assert first.daemon.engine.counters["other_writer"] > 0
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
