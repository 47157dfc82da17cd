"""``ridlink avoid`` as a process of its own: what it prints, how it ends, and what it refuses."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from asyncio.subprocess import PIPE
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from ridlink.cli import cli
from ridlink.cli.broadcast import _line
from ridlink.cli.flight_lines import HumanPrinter
from ridlink.cli.signals import ending_signals
from ridlink.daemon.config import daemon_config
from ridlink.daemon.config_file import read_config_file
from ridlink.daemon.events import summary_facts
from ridlink.engine import Engine, EngineConfig
from ridlink.engine.guard import Phase
from ridlink.errors import ConfigError
from tests.daemon.emulated import Emulated, LoopbackVehicle, at
from tests.daemon.process import START_S, daemon, line
from tests.links.cable import null_modem
from tests.loopback import free_port, run

GOAL = ",".join(f"{value:.7f}" for value in at(300.0))


def invoke(*arguments: str) -> Result:
    return CliRunner().invoke(cli, ["avoid", *arguments])


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_f28_flies_reports_and_ends_on_sigterm(number: signal.Signals) -> None:
    """SIGHUP is what a terminal sends that goes away: the kernel to its foreground, and then its shell once more."""

    async def test() -> None:
        async with daemon("--goal", GOAL, "--json") as (process, port):
            first = json.loads(await line(process.stdout))
            assert (first["event"], first["state"]) == ("state", "standby")
            async with LoopbackVehicle(Emulated(), port) as vehicle:
                # A PX4 is sent zero velocity before the kernels are there.
                await vehicle.until(lambda: len(vehicle.setpoints()) >= 12 and vehicle.setpoints()[-1].vx > 0.0)
                process.send_signal(number)
                if number == signal.SIGHUP:
                    process.send_signal(number)
                async with asyncio.timeout(2.0):
                    out, err = await process.communicate()
                assert process.returncode == 0, err.decode()
                assert [message.vx for message in vehicle.setpoints()[-3:]] == [0.0, 0.0, 0.0]
                events: list[dict[str, Any]] = [json.loads(text) for text in out.decode().splitlines()]
                of_a_busy_machine = {"stalled", "warning"}
                assert {event["event"] for event in events} - of_a_busy_machine == {"state", "summary", "final"}
                last = [event["reason"] for event in events if event["event"] == "state"][-1]
                assert last == "ended: the vehicle is told to stop, and leaves OFFBOARD by its own failsafe"
                final = events[-1]
                assert final["event"] == "final"
                assert final["setpoints"] == len(vehicle.setpoints())
                assert final.keys() >= {
                    "setpoints", "reports_received", "decision_ms", "setpoint_gap_ms", "rejects", "tracks", "state",
                    "infeasible_steps",
                }  # fmt: skip
                assert final["setpoint_gap_ms"].keys() == {"p50", "p99", "max"}

    run(test)


def test_flies_over_a_serial_device(tmp_path: Path) -> None:
    async def test() -> None:
        with null_modem(tmp_path) as (companion, telemetry):
            async with daemon("--goal", GOAL, "--vehicle", f"serial:{companion}:921600") as (process, _):
                assert "standby" in await line(process.stderr)
                async with LoopbackVehicle(Emulated(), url=f"serial:{telemetry}:921600") as vehicle:
                    await vehicle.until(lambda: any(setpoint.vx > 1.0 for setpoint in vehicle.setpoints()))
                    process.send_signal(signal.SIGTERM)
                    await vehicle.until(lambda: [setpoint.vx for setpoint in vehicle.setpoints()[-3:]] == 3 * [0.0])
                    assert await process.wait() == 0

    run(test)


def test_a_hangup_that_is_ignored_ends_nothing() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as under nohup
    try:
        assert signal.SIGHUP not in ending_signals()
    finally:
        signal.signal(signal.SIGHUP, before)
    assert signal.SIGHUP in ending_signals()


def test_tells_people_what_happens_and_ends_on_ctrl_c() -> None:
    async def test() -> None:
        async with daemon("--standby") as (process, _):
            assert "standby: waiting for an operator's request" in await line(process.stderr)
            process.send_signal(signal.SIGINT)
            out, err = await process.communicate()
            assert process.returncode == 0
            assert out == b""
            assert b"no setpoints, 0 reports" in err and b"gap" not in err

    run(test)


def test_who_waits_for_an_autopilot_says_where() -> None:
    async def test() -> None:
        async with daemon("--goal", GOAL) as (process, port):
            assert await line(process.stderr) == f"standby: waiting for an autopilot on udpin:127.0.0.1:{port}\n"
            process.send_signal(signal.SIGINT)
            await process.communicate()

    run(test)


def test_no_direction_of_a_dry_run_is_less_than_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    printer = HumanPrinter("udpin:127.0.0.1:14540")
    printer.event({"event": "dry_run", "velocity_ned_mps": [-0.04, 1.26, 0.0]})
    printer.close()
    assert capsys.readouterr().err == "would fly +0.0 north, +1.3 east, +0.0 up m/s\n"


def test_a_dry_run_ends_with_no_setpoints_and_no_gap_between_them() -> None:
    async def test() -> None:
        async with daemon("--goal", GOAL, "--dry-run") as (process, port), LoopbackVehicle(Emulated(), port):
            for _ in range(2):  # two of those that it would have sent
                while not (await line(process.stderr)).startswith("would fly"):
                    pass
            process.send_signal(signal.SIGINT)
            _, err = await process.communicate()
            assert b"no setpoints, " in err and b"gap" not in err

    run(test)


def test_i8_a_second_signal_forces_the_end() -> None:
    async def test() -> None:
        async with daemon("--goal", GOAL, "--json") as (process, port):
            await line(process.stdout)
            async with LoopbackVehicle(Emulated(), port) as vehicle:
                await vehicle.until(lambda: len(vehicle.setpoints()) >= 3)
                process.send_signal(signal.SIGTERM)
                process.send_signal(signal.SIGINT)  # at once: a clean stop takes a sixth of a second
                async with asyncio.timeout(2.0):
                    await process.wait()
                assert process.returncode in (128 + signal.SIGTERM, 128 + signal.SIGINT)

    run(test)


def test_a_reader_that_goes_away_does_not_end_the_flight() -> None:
    async def test() -> None:
        async with daemon("--goal", GOAL, "--json") as (process, port):
            await line(process.stdout)
            process._transport.get_pipe_transport(1).close()  # type: ignore[attr-defined]
            async with LoopbackVehicle(Emulated(), port) as vehicle:
                await vehicle.until(lambda: len(vehicle.setpoints()) >= 15)
                process.send_signal(signal.SIGTERM)
                async with asyncio.timeout(2.0):
                    await process.wait()
                assert process.returncode == 0

    run(test)


def test_with_stdout_closed_it_flies_all_the_same() -> None:
    async def test() -> None:
        port = free_port()
        process = await asyncio.create_subprocess_exec(
            "/bin/sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "ridlink", "avoid", "--json", "--goal", GOAL,
            "--vehicle", f"udpin:127.0.0.1:{port}", "--rid", f"udpout:127.0.0.1:{free_port()}", stderr=PIPE,
        )  # fmt: skip
        async with LoopbackVehicle(Emulated(), port) as vehicle:
            async with asyncio.timeout(START_S):
                while not vehicle.setpoints():
                    with contextlib.suppress(TimeoutError):
                        await vehicle.until(lambda: bool(vehicle.setpoints()))
            process.send_signal(signal.SIGTERM)
            _, err = await process.communicate()
        assert (process.returncode, err) == (0, b"")

    run(test)


def test_i8_a_port_in_use_is_exit_code_3() -> None:
    async def test() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.0.1", 0))
            port = taken.getsockname()[1]
            async with daemon("--standby", "--vehicle", f"udpin:127.0.0.1:{port}") as (process, _):
                async with asyncio.timeout(START_S):
                    _, err = await process.communicate()
                assert process.returncode == 3
                assert f"port {port} is in use".encode() in err
                assert err.count(b"\n") == 1

    run(test)


@pytest.mark.parametrize("option", ["--log", "--input-log"])
def test_i8_a_pipe_that_nobody_reads_is_exit_code_3(option: str, tmp_path: Path) -> None:
    """To open it would last until somebody does, and no signal would end that."""
    os.mkfifo(tmp_path / "pipe")
    command = [sys.executable, "-m", "ridlink", "avoid", "--standby", "--vehicle", "udpin:127.0.0.1:0"]
    done = subprocess.run([*command, option, tmp_path / "pipe"], capture_output=True, text=True, timeout=START_S)
    assert (done.returncode, done.stderr) == (3, f"ridlink: {tmp_path / 'pipe'}: No such device or address\n")


@pytest.mark.parametrize("option", ["--log", "--input-log"])
def test_f29_a_recording_that_another_daemon_writes_is_left_to_it(option: str, tmp_path: Path) -> None:
    """Each wrote over what the other had recorded, and both ended with 0."""
    path = tmp_path / "flight.log"
    theirs = b"recorded so far"
    code = (
        "import sys; from ridlink.files import open_at_once\n"
        "with open_at_once(sys.argv[1], 'wb', 0) as log: log.write(sys.argv[2].encode()); print(flush=True); input()"
    )
    command = [sys.executable, "-m", "ridlink", "avoid", "--standby", "--vehicle", "udpin:127.0.0.1:0", option, path]
    with subprocess.Popen(
        [sys.executable, "-c", code, path, theirs], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None and other.stdout.readline() == b"\n"
        done = subprocess.run(command, capture_output=True, text=True, timeout=START_S)
        assert (done.returncode, done.stderr) == (3, f"ridlink: {path}: another program is writing it\n")
        other.communicate(b"\n", timeout=START_S)
    assert other.returncode == 0 and path.read_bytes() == theirs


def test_without_a_goal_it_asks_for_one() -> None:
    result = invoke()
    assert result.exit_code == 2
    assert "--goal" in result.output and "--standby" in result.output


@pytest.mark.parametrize("goal", ["47.39", "47.39,8.54,1,2", "here", "47.39;8.54"])
def test_a_goal_that_is_none(goal: str) -> None:
    result = invoke("--goal", goal)
    assert result.exit_code == 2
    assert "LAT,LON" in result.output


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--goal", "86,8"], "latitude"),
        (["--goal", "nan,8"], "finite"),
        (["--goal", "47,8", "--cruise", "16"], "v-max"),
        (["--goal", "47,8", "--airframe", "60"], "airframe must lie between 0.1 and 30 m, got 60"),
        (["--goal", "47,8", "--vehicle", "udp:127.0.0.1:14540"], "udpin:127.0.0.1:14540"),
        (["--goal", "47,8", "--definition", "candidat1"], "candidate1"),
        (["--goal", "47,8", "--definition", "chance", "--eta", "1.5"], "got 1.5"),
        (["--goal", "47,8", "--definition", "chance", "--eta", "nan"], "got nan"),
    ],
)
def test_what_cannot_be_flown_is_refused_before_anything_is_opened(arguments: list[str], text: str) -> None:
    result = invoke(*arguments)
    assert isinstance(result.exception, ConfigError)
    assert text in str(result.exception)


def test_print_config_is_a_file_that_reads_back(tmp_path: Path) -> None:
    (tmp_path / "given.toml").write_text("cruise = 8.0\nairframe = 1.0\n")
    result = invoke("--config", str(tmp_path / "given.toml"), "--cruise", "9", "--goal", "47,8,100", "--print-config")
    assert result.exit_code == 0
    (tmp_path / "printed.toml").write_text(result.output)
    engine = daemon_config(read_config_file(tmp_path / "printed.toml")).engine
    assert (engine.cruise_mps, engine.airframe_m) == (9.0, 1.0)


def test_an_unknown_key_of_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "given.toml").write_text("cruize = 8.0\n")
    result = invoke("--config", str(tmp_path / "given.toml"), "--standby")
    assert isinstance(result.exception, ConfigError)
    assert "given.toml:1: unknown key 'cruize': did you mean 'cruise'?" in str(result.exception)


def test_on_a_terminal_there_is_a_status_line() -> None:
    async def test() -> None:
        ours, theirs = os.openpty()
        port = free_port()
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "ridlink", "avoid", "--standby", "--vehicle", f"udpin:127.0.0.1:{port}",
            "--rid", f"udpout:127.0.0.1:{free_port()}", stderr=theirs, stdout=PIPE,
        )  # fmt: skip
        os.close(theirs)
        shown = b""
        async with asyncio.timeout(START_S):
            while b"standby | 0 tracks" not in shown:
                shown += await asyncio.to_thread(os.read, ours, 4096)
        process.send_signal(signal.SIGTERM)
        await process.communicate()
        os.close(ours)
        assert process.returncode == 0

    run(test)


def test_a_guard_tells_people_that_it_takes_over_and_hands_back(capsys: pytest.CaptureFixture[str]) -> None:
    """What is told of a conflict on a mission, in its order; "engaged: avoiding" stood there twice."""
    printer = HumanPrinter("udpin:127.0.0.1:14540")
    for state, reason, guard in (
        ("standby", "guard: watching", Phase.WATCHING),
        ("standby", "waiting for GUIDED or OFFBOARD", Phase.TAKING_OVER),
        ("engaged", "avoiding", Phase.RESOLVING),
        ("hold", "own position jumped", Phase.RESOLVING),
        ("engaged", "avoiding", Phase.RESOLVING),
        ("engaged", "avoiding", Phase.HOLDING),
        ("engaged", "avoiding", Phase.HANDING_BACK),
        ("standby", "guard: watching", Phase.WATCHING),
        ("standby", "guard: ended", Phase.ENDED),
    ):
        printer.event({"event": "state", "state": state, "reason": reason, "guard": str(guard)})
    printer.close()
    assert capsys.readouterr().err.splitlines() == [
        "standby: guard: watching",
        "standby: waiting for GUIDED or OFFBOARD; the guard takes over for a conflict",
        "engaged: avoiding; the guard has taken over",
        "hold: own position jumped",
        "engaged: avoiding",
        "engaged: avoiding; the mission was found paused: the guard keeps the vehicle here until AUTO is chosen",
        "engaged: avoiding; the guard hands back what it found",
        "standby: guard: watching; it has handed back",
        "standby: guard: ended; MAV_CMD_DO_PAUSE_CONTINUE 1 to component 196 engages it again",
    ]


@pytest.mark.parametrize(
    ("heard_s", "armed", "on_ground", "said"),
    [
        (None, None, None, ""),
        (1.1, True, False, ""),
        (12.3, True, None, " | autopilot last heard 12 s ago, armed"),
        (12.3, False, True, " | autopilot last heard 12 s ago, disarmed, on the ground"),
    ],
)
def test_on_a_terminal_it_stands_when_a_silent_vehicle_was_heard_and_what_it_was(
    heard_s: float | None, armed: bool | None, on_ground: bool | None, said: str,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    engine = Engine(EngineConfig(standby=True))
    facts = summary_facts(engine, engine.step(0.0).decision, {})
    printer = HumanPrinter("udpin:127.0.0.1:14540")
    told = {"autopilot_heard_s": heard_s, "armed": armed, "on_ground": on_ground}
    printer.event({"event": "summary", **facts, **told})
    printer.close()
    assert facts.keys() >= told.keys()
    assert capsys.readouterr().err == f"\r\x1b[Kstandby | 0 tracks{said}"


@pytest.mark.parametrize(
    ("columns", "said"),
    [(80, "standby | 0 tracks"), (19, "standby | 0 tracks"), (18, "standby | 0 track"), (0, "standby | 0 tracks")],
)
def test_a_status_that_is_rewritten_keeps_to_its_line(
    columns: int, said: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What had gone on to a second line stayed, and a line more came every second."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(os, "get_terminal_size", lambda descriptor: os.terminal_size((columns, 24)))
    engine = Engine(EngineConfig(standby=True))
    printer = HumanPrinter("udpin:127.0.0.1:14540")
    printer.event({"event": "summary", **summary_facts(engine, engine.step(0.0).decision, {})})
    printer.close()
    assert capfd.readouterr().err == f"\r\x1b[K{said}"


def test_f26_a_stall_does_not_end_what_a_terminal_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was taken for the summary of a second, and whoever fails to print is told nothing more."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    printer = HumanPrinter("udpin:127.0.0.1:14540")
    printer.event({"event": "stalled", "stack": "somewhere"})
    printer.close()
    assert capsys.readouterr().err == "\r\x1b[Kwarning: the loop stood still\n"


@pytest.mark.parametrize(
    ("good_to_arm", "text", "said"),
    [
        (False, "missing LOC", "warning: the transmitter module is not ready: missing LOC"),
        (False, "", "warning: the transmitter module is not ready: it does not say why"),
        (True, "", "the transmitter module is good to arm"),
    ],
)
def test_what_a_transmitter_module_says_is_a_line_of_avoid_and_of_broadcast(
    good_to_arm: bool, text: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    facts = {"event": "module", "good_to_arm": good_to_arm, "text": text}
    printer = HumanPrinter("udpin:127.0.0.1:14540")
    printer.event(facts)
    printer.close()
    assert capsys.readouterr().err == f"{said}\n"
    assert _line(facts) == said


@pytest.mark.parametrize("option", ["--config", "--replay"])
def test_a_file_that_cannot_be_read_is_no_usage_error(tmp_path: Path, option: str) -> None:
    for path in (tmp_path / "absent", tmp_path):
        found = CliRunner().invoke(cli, ["avoid", option, str(path)])
        assert isinstance(found.exception, OSError), "main() turns it into one line and exit code 3"
        assert found.exception.filename == str(path)
