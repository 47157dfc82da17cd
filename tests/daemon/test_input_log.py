"""A flight that was recorded is decided again, bit for bit."""

from __future__ import annotations

import asyncio
import json
import math
import socket
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from ridlink.cli import cli
from ridlink.daemon.config import DaemonConfig, as_toml
from ridlink.daemon.config_file import LONGEST
from ridlink.daemon.input_log import InputLog, read_records, replay
from ridlink.daemon.service import AvoidDaemon
from ridlink.engine import EngineConfig, Goal
from ridlink.engine.announcer import Announcer
from ridlink.errors import CaptureError
from ridlink.links import parse_link_url
from ridlink.own_ship import OwnShipTelemetry
from tests.daemon.emulated import POSITION_MODE, Emulated, at
from tests.daemon.harness import Air, running
from tests.loopback import free_port, run


def flown(path: Path, tlog: Path | None = None) -> str:
    """A flight with an intruder, junk and a pilot who takes over; the hash of what was decided."""
    digests: list[str | None] = []

    async def test() -> None:
        engine = EngineConfig(goal=Goal(*at(300.0)), broadcast=True)
        async with (
            Air() as module,
            running(
                engine=engine,
                broadcast_to=parse_link_url(f"udpout:127.0.0.1:{module.port}"),
                input_log=path,
                log=tlog,
            ) as flight,
        ):
            vehicle, intruder = flight.vehicle, Emulated(9, ned_m=(60.0, 3.0, -50.0))
            intruder.velocity[0] = -8.0
            for count in range(3, 20):
                await vehicle.until(lambda count=count: len(vehicle.setpoints()) >= count)  # type: ignore[misc]
                assert flight.air.link is not None
                flight.air.link.send(intruder.remote_id(0.1 * count))
                flight.air.link.send(b"\xfd" + bytes(count))
                intruder.advance(0.1)
            vehicle.vehicle.mode = POSITION_MODE
            await vehicle.until(lambda: flight.events[-1].get("state") == "standby")
            digests.append((await flight.end()).decision_log)

    run(test)
    (digest,) = digests
    assert digest is not None
    return digest


def records(data: bytes) -> Iterator[int]:
    """Where the records of an input log begin, behind their lengths: anything may stand in a datagram."""
    place = 0
    while place < len(data):
        yield place + 4
        place += 4 + int.from_bytes(data[place : place + 4], "little")


def test_the_replay_of_a_recorded_input_gives_the_identical_decision_log(tmp_path: Path) -> None:
    path = tmp_path / "flight.input"
    digest = flown(path)
    lines: list[bytes] = []
    decisions, recorded = replay(path, lines.append)
    assert decisions.digest == recorded == digest
    assert decisions.steps == len(lines) > 20
    steps = [json.loads(line) for line in lines]
    assert {step["state"] for step in steps} >= {"engaged", "standby"}
    assert any(step["conflicts"] and step["commanded_ned_mps"] for step in steps)
    result = CliRunner().invoke(cli, ["avoid", "--replay", str(path), "--json"])
    assert result.exit_code == 0
    last = json.loads(result.stdout.splitlines()[-1])
    assert last == {"event": "replayed", "steps": decisions.steps, "decision_log": digest, "flown": digest}
    assert "as flown" in CliRunner().invoke(cli, ["avoid", "--replay", str(path)]).stdout

    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    result = CliRunner().invoke(cli, ["avoid", "--replay", str(path)])
    assert result.exit_code == 0 and "does not reach the end" in result.stdout
    tag = next(place + 2 for place in records(data) if data[place + 1 : place + 3] == b"\xa1e")
    path.write_bytes(data[:tag] + b"x" + data[tag + 1 :])  # the end of the stream, made a record of no kind
    with pytest.raises(CaptureError, match="damaged one: Invalid value 'x'"):
        replay(path)


def test_steps_and_datagrams_that_failed_fail_again_and_the_flight_is_decided_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: Counter[tuple[str, int]] = Counter()

    def failing(cls: type, name: str, at: int) -> None:
        real = getattr(cls, name)

        def called(self: object, *args: object, **options: object) -> object:
            calls[name, id(self)] += 1
            if calls[name, id(self)] == at:
                raise ArithmeticError(name)
            return real(self, *args, **options)

        monkeypatch.setattr(cls, name, called)

    failing(Announcer, "announce", 12)
    failing(OwnShipTelemetry, "_position", 40)
    path = tmp_path / "failed.input"
    digest = flown(path)
    assert {name for (name, _), count in calls.items() if count > 40} == {"_position"}
    decisions, recorded = replay(path)
    assert decisions.digest == recorded == digest


@pytest.mark.parametrize(
    "data",
    [b"", b"x" * 100, b"\x01\x00\x00\x00\xc1", b"\x04\x00\x00\x00\x93\x01\x02\x03", b"\x03\x00\x00\x00\x91\xa1\xfd"],
)
def test_what_is_no_input_log_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.input"
    path.write_bytes(data)
    with pytest.raises(CaptureError, match="no input log"):
        replay(path)
    assert CliRunner().invoke(cli, ["avoid", "--replay", str(path)]).exit_code != 0


@pytest.mark.parametrize(
    "record",
    [
        ["s", None, False, True, None],
        ["s", math.nan, False, True, None],
        ["e", math.inf],
        ["t", "long"],
        ["v", 1.0, None, None, "text"],
        ["a", 1.0, None, {}, b""],
        ["ridlink-input", 2, 5],
        ["ridlink-input", 2, ""],
        [{}],
        {},
    ],
)
def test_a_record_that_the_daemon_cannot_have_written_is_refused(tmp_path: Path, record: object) -> None:
    path = tmp_path / "damaged.input"
    records = [msgspec.msgpack.encode(each) for each in (["ridlink-input", 2, as_toml(DaemonConfig())], record)]
    path.write_bytes(b"".join(len(each).to_bytes(4, "little") + each for each in records))
    with pytest.raises(CaptureError, match="damaged"):
        replay(path)


def test_whatever_fits_into_a_configuration_fits_into_the_log(tmp_path: Path) -> None:
    text, path = "#" * LONGEST, tmp_path / "long.input"
    InputLog(path, text).close(60.0)
    with path.open("rb") as file:
        head, _ = read_records(file, "long.input")
    assert head.config == text  # type: ignore[union-attr]


def test_a_vehicle_that_speaks_while_links_are_opened_is_decided_about_alike_again(tmp_path: Path) -> None:
    path, vehicle = tmp_path / "early.input", Emulated()
    telemetry, silent = vehicle.telemetry(0.0), threading.Event()
    port = free_port()

    def speak() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as voice:
            while not silent.is_set():
                voice.sendto(telemetry, ("127.0.0.1", port))

    async def test() -> None:
        daemon, stop = AvoidDaemon(DaemonConfig(vehicle=f"udpin:127.0.0.1:{port}", input_log=path)), asyncio.Event()  # type: ignore[arg-type]
        speaker = threading.Thread(target=speak)
        speaker.start()
        try:
            task = asyncio.create_task(daemon.run(stop))
            async with asyncio.timeout(60.0):
                await daemon.ready.wait()
        finally:
            silent.set()
            speaker.join()
        stop.set()
        await task

    run(test)
    decisions, flown_hash = replay(path)
    assert decisions.digest == flown_hash
