"""The daemon on real loopback sockets, against a vehicle that speaks MAVLink."""

from __future__ import annotations

import asyncio
import socket
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from ridlink.captures.records import Rejects
from ridlink.captures.tlog import read_tlog
from ridlink.daemon.config import DaemonConfig
from ridlink.daemon.module_words import ARM_STATUS, SILENT
from ridlink.daemon.service import AvoidDaemon, DecisionError
from ridlink.engine import EngineConfig, Goal
from ridlink.errors import LinkError
from ridlink.failsafe import State
from ridlink.links import parse_link_url
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.own_ship.broadcast import Form
from tests.daemon.emulated import PATIENCE_S, POSITION_MODE, Emulated, LoopbackVehicle, at
from tests.daemon.harness import Air, holds, running
from tests.daemon.invariants import messages
from tests.loopback import run


@pytest.mark.parametrize(("up_m", "told"), [(-400.0, True), (0.1, False)])
def test_a_goal_below_home_is_said_before_it_is_flown_to(up_m: float, told: bool) -> None:
    """An altitude above mean sea level that was meant above ground leads into it."""

    async def test() -> None:
        emulated = Emulated()
        emulated.armed = False
        async with running(emulated=emulated, engine=EngineConfig(goal=Goal(*at(300.0, 0.0, up_m)))) as flight:
            said = {"event": "warning", "text": "the goal lies below home, perhaps underground"}
            if told:
                await flight.vehicle.until(lambda: any(said.items() <= event.items() for event in flight.events))
            else:
                await flight.vehicle.until(lambda: sum(event["event"] == "summary" for event in flight.events) >= 3)
                assert not any(said.items() <= event.items() for event in flight.events)
            assert not flight.vehicle.setpoints()

    run(test)


@pytest.mark.parametrize(
    ("goal", "obstacle", "told"),
    [
        (at(300.0), [at(100.0), at(120.0), at(120.0, 20.0)], []),
        (at(99e3), [at(900e3), at(900e3, 10.0), at(900e3 + 10.0)], []),
        (at(200e3), [], ["the goal is 200 km away"]),
        (at(301e3), [], ["the goal is 301 km away and is not flown to"]),
        ((8.5456, 47.4004, 550.0), [],
         ["the goal is 5,660 km away and is not flown to: is 47.4004,8.5456 meant? Latitude comes first"]),
        (at(300.0), [(8.545, 47.399), (8.546, 47.399), (8.546, 47.4)],
         ["obstacle 1 is 5,660 km away: latitude comes first"]),
    ],
    ids=["near", "as far as may be", "far", "too far", "goal", "obstacle"],
)  # fmt: skip
def test_where_longitude_was_written_first_it_is_said_before_it_is_flown(
    goal: tuple[float, float, float], obstacle: list[tuple[float, ...]], told: list[str]
) -> None:
    """Both were taken: the vehicle set off for another continent, or flew through what stood where it was meant."""

    async def test() -> None:
        emulated = Emulated()
        emulated.armed = False
        polygons = (tuple(corner[:2] for corner in obstacle),) if obstacle else ()
        async with running(emulated=emulated, engine=EngineConfig(goal=Goal(*goal), obstacles=polygons)) as flight:
            await flight.vehicle.until(lambda: sum(event["event"] == "summary" for event in flight.events) >= 3)
            assert [event["text"] for event in flight.events if event["event"] == "warning"] == told
            assert not flight.vehicle.setpoints()

    run(test)


def test_a_crash_that_the_vehicle_tells_in_words_alone_stands_in_the_log_of_the_daemon() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 5)
            vehicle.send(vehicle.vehicle.encoder.encode("STATUSTEXT", severity=0, text="Crash: Disarming"))
            said = {"event": "warning", "text": "vehicle: Crash: Disarming"}
            await vehicle.until(lambda: any(said.items() <= event.items() for event in flight.events))

    run(test)


def test_flies_and_says_so() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 15)
            assert vehicle.setpoints()[0].vx == 0.0
            assert vehicle.setpoints()[-1].vx > 1.0
            for data in (Emulated(9, ned_m=(250.0, 0.0, -50.0)).remote_id(0.0), b"junk"):
                assert flight.air.link is not None
                flight.air.link.send(data)
            await vehicle.until(lambda: len(flight.daemon.engine.picture) == 1)
            await vehicle.until(lambda: {event["event"] for event in flight.events} >= {"state", "summary"})
            names = {message.name for message in vehicle.vehicle.heard}
            assert names == {"HEARTBEAT", "RIDLINK_STATUS", "SET_POSITION_TARGET_LOCAL_NED"}
            assert messages(flight.air.heard[0])[0].name == "HEARTBEAT"
            summary = await flight.end()
            assert summary.state == "standby"
            assert summary.reports_received == 1
            assert summary.rejects["garbage"] == 1
            assert summary.tracks == 1
            assert summary.infeasible_steps == 0
            assert 0.0 < summary.decision_ms["p50"] <= summary.decision_ms["p99"] <= summary.decision_ms["max"]
            assert 90.0 < summary.setpoint_gap_ms["p50"] < 110.0
            assert summary.as_dict().keys() >= {"setpoints", "reports_received", "decision_ms", "setpoint_gap_ms"}
            await vehicle.until(lambda: len(vehicle.setpoints()) == summary.setpoints)
            assert [message.vx for message in vehicle.setpoints()[-3:]] == [0.0, 0.0, 0.0]

    run(test)


def test_a_transmitter_module_hears_whose_remote_id_it_sends_and_the_air_hears_it_from_the_module() -> None:
    async def test() -> None:
        engine = EngineConfig(goal=Goal(*at(300.0)), broadcast=True, broadcast_form=Form.MODULE)
        async with (
            Air() as module,
            running(engine=engine, broadcast_to=parse_link_url(f"udpout:127.0.0.1:{module.port}")) as flight,
        ):
            wanted = {"HEARTBEAT", *(f"OPEN_DRONE_ID_{name}" for name in ("LOCATION", "AUTHENTICATION", "SYSTEM"))}
            await flight.vehicle.until(lambda: wanted <= {said.name for said in messages(b"".join(module.heard))})
            await flight.vehicle.until(lambda: len(flight.air.heard) >= 3)
            assert {said.name for said in messages(b"".join(flight.air.heard))} == {"HEARTBEAT"}
            for heard in (module.heard, flight.air.heard):
                frames = parse_datagram(b"".join(heard), CRC_EXTRAS, limit=None)
                numbers = [frame.seq for frame in frames if isinstance(frame, Frame)]
                assert numbers == [k % 256 for k in range(len(numbers))], "each link counts its own"

    run(test)


def test_a_transmitter_module_that_is_not_ready_is_told_of_once_and_when_it_is_ready(tmp_path: Path) -> None:
    """Its answers were dropped, and the module has nobody else to tell."""
    path = tmp_path / "flight.tlog"

    async def test() -> None:
        engine = EngineConfig(goal=Goal(*at(300.0)), broadcast=True, broadcast_form=Form.MODULE)
        module, of_module = Air(), Encoder(1, 236)

        def told() -> list[tuple[bool, str]]:
            said = [(e["good_to_arm"], e["text"]) for e in flight.events if e["event"] == "module"]
            return [each for each in said if each != SILENT]  # a machine may be busy for seconds

        async with (
            module,
            running(engine=engine, log=path, broadcast_to=parse_link_url(f"udpout:127.0.0.1:{module.port}")) as flight,
        ):
            await flight.vehicle.until(lambda: bool(module.heard))
            assert module.link is not None
            for _ in range(2):
                module.link.send(of_module.encode("HEARTBEAT", type=34))
                module.link.send(of_module.encode("OPEN_DRONE_ID_ARM_STATUS", status=1, error=b"missing \x1bLOC"))
            await flight.vehicle.until(lambda: flight.daemon.rejects().get("module_not_ready") == 2)
            await flight.vehicle.until(lambda: len(told()) == 1)
            module.link.send(of_module.encode("OPEN_DRONE_ID_ARM_STATUS"))
            await flight.vehicle.until(lambda: len(told()) == 2)
            assert told() == [(False, "missing \\x1bLOC"), (True, "")]
            assert (await flight.end()).rejects["module_not_ready"] == 2

    run(test)
    recorded = [record.frame for record in read_tlog([path.read_bytes()], Rejects())]
    assert sum(frame.msgid == ARM_STATUS for frame in recorded) == 3


def test_the_stream_ends_with_the_pilots_mode_change_and_does_not_come_back() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 5)
            vehicle.vehicle.mode = POSITION_MODE
            await vehicle.until(lambda: flight.daemon.engine.rung.state is State.STANDBY)
            count = len(vehicle.setpoints())
            beats = len(vehicle.vehicle.heard)
            vehicle.vehicle.mode = Emulated().mode
            # Two more heartbeats of the daemon are a second or two in which nothing else came.
            await vehicle.until(lambda: len(vehicle.vehicle.heard) >= beats + 3)
            assert len(vehicle.setpoints()) <= count + 1
            assert [event["state"] for event in flight.events if event["event"] == "state"][-1] == "standby"

    run(test)


def test_f14_a_stale_own_state_holds() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 8)
            vehicle.frozen = True
            await vehicle.until(lambda: holds(flight, "stale"))
            await vehicle.until(lambda: [m.vx for m in vehicle.setpoints()[-2:]] == [0.0, 0.0])
            vehicle.frozen = False
            await vehicle.until(lambda: vehicle.setpoints()[-1].vx > 0.0)

    run(test)


def test_telemetry_of_strangers_does_not_redirect_the_stream() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 2)
            async with LoopbackVehicle(Emulated(42), vehicle.port) as stranger:
                await vehicle.until(lambda: flight.daemon.engine.counters["foreign_autopilot"] > 5)
                count = len(vehicle.setpoints())
                await vehicle.until(lambda: len(vehicle.setpoints()) > count)
                assert stranger.vehicle.heard == []

    run(test)


def test_everything_received_and_sent_is_recorded(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"

    async def test() -> None:
        async with running(log=path) as flight:
            await flight.vehicle.until(lambda: len(flight.vehicle.setpoints()) >= 3)
            assert flight.air.link is not None
            await asyncio.wait_for(flight.air.changed.wait(), PATIENCE_S)
            flight.air.link.send(Emulated(9).remote_id(0.0))
            await flight.vehicle.until(lambda: flight.daemon.engine.summary().reports_received == 1)

    run(test)
    rejects = Rejects()
    frames = [record.frame for record in read_tlog([path.read_bytes()], rejects)]
    senders = {(frame.sysid, frame.compid, frame.msgid) for frame in frames}
    assert senders >= {(1, 1, 0), (1, 1, 33), (1, 196, 84), (1, 196, 0), (9, 1, 12901), (9, 1, 61400)}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_f29_a_full_disk_is_said_once_and_the_flight_goes_on() -> None:
    async def test() -> None:
        async with running(log=Path("/dev/full")) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: any(event["event"] == "recording_ended" for event in flight.events))
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: len(vehicle.setpoints()) > count + 12)
            summary = await flight.end()
            assert summary.rejects["recording_failed"] == 1
            (said,) = [event for event in flight.events if event["event"] == "recording_ended"]
            assert said["reason"] == "/dev/full: No space left on device"

    run(test)


def test_a_port_in_use_and_a_log_that_cannot_be_written_are_errors_at_the_start(tmp_path: Path) -> None:
    async def test() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.0.1", 0))
            port = taken.getsockname()[1]
            config = DaemonConfig(vehicle=f"udpin:127.0.0.1:{port}", remote_id="udpout:127.0.0.1:9")  # type: ignore[arg-type]
            log = tmp_path / "x.tlog"
            with pytest.raises(LinkError, match=f"port {port} is in use"):
                await AvoidDaemon(replace(config, log=log)).run(asyncio.Event())
            assert not log.exists(), "a daemon that does not fly leaves no log, and spoils none"
        with pytest.raises(FileNotFoundError):
            await AvoidDaemon(replace(config, log=tmp_path / "none" / "x.tlog")).run(asyncio.Event())

    run(test)


def test_f25_decisions_that_keep_failing_end_the_daemon_after_a_stop() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 5)
            flight.daemon.engine.steering.decider.solver.solve = lambda *_, **__: 1 / 0  # type: ignore[method-assign,assignment]
            assert flight.task is not None
            with pytest.raises(DecisionError, match="ZeroDivisionError"):
                await asyncio.wait_for(flight.task, PATIENCE_S)
            await vehicle.until(lambda: [m.vx for m in vehicle.setpoints()[-3:]] == [0.0, 0.0, 0.0])

    run(test)


def test_steps_that_keep_failing_end_the_daemon_after_a_stop() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 5)
            flight.daemon.engine._announcer.announce = lambda *_, **__: 1 / 0  # type: ignore[method-assign,assignment]
            assert flight.task is not None
            with pytest.raises(DecisionError, match="steps failed"):
                await asyncio.wait_for(flight.task, PATIENCE_S)
            await vehicle.until(lambda: [m.vx for m in vehicle.setpoints()[-3:]] == [0.0, 0.0, 0.0])
            assert flight.daemon.summary().rejects["step_failed"] == 3

    run(test)


def test_a_watcher_that_fails_does_not_end_the_flight() -> None:
    async def test() -> None:
        async with running() as flight:
            flight.daemon._events.sink = lambda _: 1 / 0
            vehicle = flight.vehicle
            await vehicle.until(lambda: flight.daemon.summary().rejects.get("event_sink_failed") == 1)
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: len(vehicle.setpoints()) > count + 3)

    run(test)


def test_f26_a_stall_is_followed_by_one_tick_and_a_hold() -> None:
    async def test() -> None:
        async with running() as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: len(vehicle.setpoints()) >= 5)
            threading.Event().wait(0.75)  # blocks the loop, as a stalled machine does
            count = len(vehicle.setpoints())
            await vehicle.until(lambda: len(vehicle.setpoints()) > count)
            stalled = vehicle.setpoints()[count:]
            assert len(stalled) == 1 and stalled[0].vx == 0.0
            assert flight.daemon.summary().rejects["missed_tick"] >= 6
            await vehicle.until(lambda: vehicle.setpoints()[-1].vx > 0.0)

    run(test)


def test_f26_a_stall_while_the_counters_are_read_ends_no_flight() -> None:
    daemon = AvoidDaemon(DaemonConfig())
    daemon._tick()
    counted = iter(daemon._counters)  # by a loop that stands still in the middle of it
    daemon._stalled("here")  # from the watchdog's thread
    list(counted)
    daemon._tick()
    assert daemon.rejects()["loop_stalled"] == 1


def test_several_daemons_share_a_process() -> None:
    async def test() -> None:
        async with running() as first, running(emulated=Emulated(2)) as second:
            for flight in (first, second):
                await flight.vehicle.until(lambda f=flight: len(f.vehicle.setpoints()) >= 5)  # type: ignore[misc]

    run(test)


def test_stopping_during_the_warm_up_is_prompt(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test() -> None:
        loop = asyncio.get_running_loop()
        begun, release = asyncio.Event(), threading.Event()

        def endless(_: object) -> float:
            loop.call_soon_threadsafe(begun.set)
            release.wait()
            return 0.0

        monkeypatch.setattr("ridlink.daemon.warming.warm_up", endless)
        async with Air() as air:
            stop = asyncio.Event()
            config = DaemonConfig(vehicle="udpin:127.0.0.1:0", remote_id=f"udpout:127.0.0.1:{air.port}")  # type: ignore[arg-type]
            task = asyncio.create_task(AvoidDaemon(config).run(stop))
            await asyncio.wait_for(begun.wait(), PATIENCE_S)
            stop.set()
            summary = await asyncio.wait_for(task, PATIENCE_S)
            assert summary.setpoints == 0
            release.set()

    run(test)


def test_who_is_stopped_during_the_warm_up_does_not_engage_for_the_last_step(monkeypatch: pytest.MonkeyPatch) -> None:
    async def endless(stop: asyncio.Event, _: object) -> None:
        await stop.wait()

    monkeypatch.setattr("ridlink.daemon.service.warm_up_unless", endless)

    async def test() -> None:
        reasons: asyncio.Queue[str] = asyncio.Queue()
        engine = EngineConfig(goal=Goal(*at(300.0)))
        config = DaemonConfig(vehicle="udpin:127.0.0.1:0", remote_id="udpin:127.0.0.1:0", engine=engine)  # type: ignore[arg-type]
        daemon = AvoidDaemon(config, on_event=lambda event: reasons.put_nowait(event.get("reason", "")))
        stop = asyncio.Event()
        task = asyncio.create_task(daemon.run(stop))
        async with asyncio.timeout(PATIENCE_S):
            await reasons.get()
            assert daemon.vehicle_address is not None
            async with LoopbackVehicle(Emulated(autopilot=3), daemon.vehicle_address[1]):
                while "kernels" not in await reasons.get():
                    continue
                stop.set()
                assert (await task).setpoints == 0, "whoever flies it in GUIDED would be stopped"

    run(test)


def test_a_warm_up_that_fails_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test() -> None:
        monkeypatch.setattr("ridlink.daemon.warming.warm_up", lambda _: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            config = DaemonConfig(vehicle="udpin:127.0.0.1:0", remote_id="udpin:127.0.0.1:0")  # type: ignore[arg-type]
            await AvoidDaemon(config).run(asyncio.Event())

    run(test)
