"""``ridlink sim`` as its users run it."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from ridlink.technologies import TECHNOLOGIES
from sitl_sim.cli import sim
from sitl_sim.gnss import ERROR_MODELS
from sitl_sim.vehicle import AUTOPILOTS

ANY_PORT = ["--vehicle-port", "0", "--companion-port", "0", "--air-port", "0"]


def ridlink_sim(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The whole program in a process of its own, until it ends by itself."""
    command = [sys.executable, "-m", "ridlink", "sim", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """The whole program, once it has said that it is ready."""
    command = [sys.executable, "-m", "ridlink", "sim", *ANY_PORT, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("ridlink sim: ")
        yield process
    finally:
        process.kill()
        process.communicate()


def refused(*arguments: str) -> str:
    """The one line with which the program refuses to start, exit code 2."""
    done = ridlink_sim(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    return line


def test_a_second_of_flight_ends_with_one_line_and_exit_code_0() -> None:
    done = ridlink_sim(*ANY_PORT, "-n", "2", "--duration", "0.3")
    assert done.returncode == 0
    assert done.stdout == "circle8: 0.3 s, no mission was flown\n"
    assert done.stderr.startswith("ridlink sim: circle8, 2 vehicles (px4, ground) on UDP ")


def test_json_has_one_line_a_second_and_the_verdict_last() -> None:
    done = ridlink_sim(*ANY_PORT, "--scenario", "head-on", "--airborne", "--sigma", "0", "--duration", "1.5", "--json")
    state, verdict = (json.loads(line, parse_constant=pytest.fail) for line in done.stdout.splitlines())
    assert [vehicle["system_id"] for vehicle in state["vehicles"]] == [1, 2]
    assert state["vehicles"][0] == {
        "system_id": 1,
        "mode": "offboard",
        "armed": True,
        "state": "airborne",
        "avoiding": False,
        "position_ned_m": [-200.0, 0.0, -50.0],
        "velocity_ned_mps": [0.0, 0.0, 0.0],
    }
    assert (verdict["scenario"], verdict["vehicles"], verdict["arrived"], verdict["macs"]) == ("head-on", 2, 0, 0)
    assert verdict["mission_begun"] and verdict["internal_errors"] == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_cleanly_with_a_verdict(number: signal.Signals) -> None:
    with running("-n", "1", "--json") as process:
        process.send_signal(number)
        output, complaints = process.communicate(timeout=10)
        assert process.returncode == 0
        assert json.loads(output.splitlines()[-1])["scenario"] == "circle8"
        assert complaints == ""


def test_the_air_alone_needs_no_vehicles() -> None:
    done = ridlink_sim(*ANY_PORT, "-n", "0", "--duration", "0.2")
    assert done.returncode == 0
    assert done.stderr.startswith("ridlink sim: circle8, 0 vehicles, air ")


def test_a_port_in_use_is_an_error_of_its_own() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        done = ridlink_sim("-n", "1", "--vehicle-port", port, "--companion-port", "0", "--air-port", "0")
    assert done.returncode == 3
    (line,) = done.stderr.splitlines()
    assert port in line and "--vehicle-port" in line


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--scenario", "circle9"], "unknown scenario 'circle9'"),
        (["--scenario", "head-on", "-n", "3"], "2 vehicles, not 3"),
        (["-n", "41"], "overlap"),
        (["--sigma", "nan"], "'nan' is not a finite number"),
        (["--speed", "inf"], "inf"),
        (["--speed", "0"], "0"),
        (["--interval", "-1"], "-1"),
        (["--loss", "2"], "2"),
        (["--home", "somewhere"], "LAT,LON,ALT"),
        (["--home", "91,0,0"], "no place on Earth"),
        (["--duration", "nan"], "not a finite number"),
        (["--autopilot", "betaflight"], "'betaflight' is not one of"),
        (["--seed", "-3"], "-3"),
    ],
)
def test_wrong_options_are_refused_in_one_line(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from ridlink.cli import main

    monkeypatch.setattr(sys, "argv", ["ridlink", "sim", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    output, complaints = capsys.readouterr()
    (line,) = complaints.splitlines()
    assert complaint in line and output == ""


def test_a_scenario_file_that_is_wrong_or_missing_is_named(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("name = 3")
    assert "wrong.toml" in refused("--scenario", str(wrong))
    done = ridlink_sim("--scenario", str(tmp_path / "missing.toml"))
    assert done.returncode == 3 and "missing.toml" in done.stderr


def test_choices_are_those_of_the_simulator() -> None:
    """The command lists them itself, so that it need not import the simulator for ``--help``."""
    choices: dict[str, Any] = {option.name: getattr(option.type, "choices", None) for option in sim.params}
    assert set(choices["autopilot"]) == set(AUTOPILOTS)
    assert tuple(choices["gnss"]) == ERROR_MODELS
    assert set(choices["technology"]) == set(TECHNOLOGIES)


def test_help_is_light_and_names_every_documented_option() -> None:
    code = (
        "import sys, sitl_sim.cli; "
        "print([m for m in ('numpy', 'numba', 'pymavlink', 'asyncio', 'sitl_sim.world') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    assert done.stdout.strip() == "[]"
    text = CliRunner().invoke(sim, ["--help"]).output
    options = "--scenario -n --seed --autopilot --speed --airborne --gnss --sigma --interval --technology --loss"
    for option in (*options.split(), "--range", "--home", "--duration", "--no-rid", "--json"):
        assert option in text
