"""``ridlink sim`` as its users run it."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from ridlink.daemon.config import daemon_config
from ridlink.daemon.config_file import read_config_file
from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.ground_station import ground_station, heartbeat
from ridlink.scenario import EVENTS
from ridlink.technologies import TECHNOLOGIES
from sitl_sim.cli import sim
from sitl_sim.gnss import ERROR_MODELS
from sitl_sim.vehicle import AIRFRAMES, AUTOPILOTS
from tests.cli.full_pipe import full_pipe
from tests.cli.program import ANY_PORT


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


def test_a_moment_of_flight_ends_with_one_line_and_exit_code_0() -> None:
    done = ridlink_sim(*ANY_PORT, "-n", "2", "--duration", "0.3")
    assert done.returncode == 0
    # A busy machine is late by tenths of a second.
    assert re.fullmatch(r"circle8: [01]\.\d s, no mission was flown\n", done.stdout)
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
    assert len(state["ports"]["vehicles"]) == 2 and 0 not in (*state["ports"]["vehicles"], state["ports"]["air"])
    assert (verdict["scenario"], verdict["vehicles"], verdict["arrived"], verdict["macs"]) == ("head-on", 2, 0, 0)
    assert verdict["mission_begun"] and verdict["internal_errors"] == 0
    assert verdict["stood_still_ms"] >= 0
    assert verdict["refused"] == {"bad_frame": 0, "refused_peer": 0, "not_passed_on": 0}
    assert verdict["air"].pop("broadcast") > 0
    assert verdict["air"] == {"delivered": 0, "malformed": 0, "no_position": 0, "refused": 0, "overflow": 0}


@pytest.mark.parametrize(
    ("start", "goal", "code", "outcome"),
    [
        ("[0, 30, -50]", "[40, 30, -50]", 0, "2 of 2 arrived, 0 collisions"),
        ("[40, 0, -50]", "[0, 0, -50]", 1, "0 of 2 arrived, 1 collision"),
        ("[0, 30, -50]", "[900, 30, -50]", 1, "1 of 2 arrived, 0 collisions"),
    ],
)
def test_until_arrived_ends_when_all_is_over_and_its_exit_code_is_the_verdict(
    start: str, goal: str, code: int, outcome: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\nduration_s = 20.0\n'
        "[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [40, 0, -50]\ncooperative = false\n"
        f"[[vehicle]]\nstart_ned_m = {start}\ngoal_ned_m = {goal}\ncooperative = false\n"
    )
    done = ridlink_sim(*ANY_PORT, "--scenario", str(path), "--airborne", "--until-arrived", "--speedup", "20")
    assert done.returncode == code, done.stderr
    assert outcome in done.stdout


def test_who_flies_into_an_obstacle_is_named_when_it_happens_and_counted_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "wall.toml"
    path.write_text(
        'name = "wall"\nduration_s = 20.0\n'
        "[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [40, 0, -50]\ncooperative = false\n"
        "[[obstacle]]\npolygon_ne_m = [[15, -9], [25, -9], [25, 9], [15, 9]]\n"
    )
    done = ridlink_sim(*ANY_PORT, "--scenario", str(path), "--airborne", "--until-arrived", "--speedup", "20")
    assert done.returncode == 1
    assert "0 of 1 arrived, 0 collisions, 1 flew into an obstacle" in done.stdout
    assert "ridlink sim: vehicle 1 flew into an obstacle\n" in done.stderr


def test_what_the_air_does_not_pass_on_is_said_once_and_counted() -> None:
    with running("-n", "0", "--json") as process, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        assert process.stdout is not None
        air = ("127.0.0.1", json.loads(process.stdout.readline())["ports"]["air"])
        for _ in range(30):
            sender.sendto(b"no MAVLink", air)
            sender.sendto(Encoder(77, 236).encode("OPEN_DRONE_ID_BASIC_ID", ua_type=2), air)
        for _ in range(3):  # a line a second
            process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        output, complaints = process.communicate(timeout=30)
    verdict = json.loads(output.splitlines()[-1])
    assert verdict["air"]["malformed"] == verdict["air"]["no_position"] == 30
    first, second = complaints.splitlines()
    assert "is no MAVLink" in first and "OPEN_DRONE_ID_LOCATION" in second


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signals_end_it_cleanly_with_a_verdict(number: signal.Signals) -> None:
    with running("-n", "1", "--json") as process:
        process.send_signal(number)
        output, complaints = process.communicate(timeout=10)
        assert process.returncode == 0
        assert json.loads(output.splitlines()[-1])["scenario"] == "circle8"
        assert complaints == ""


def test_a_reader_that_stops_reading_stops_no_vehicle() -> None:
    command = [sys.executable, "-m", "ridlink", "sim", *ANY_PORT, "-n", "1", "--airborne", "--json"]
    with full_pipe() as writing, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.settimeout(30.0)
        with subprocess.Popen(command, stdout=writing, stderr=subprocess.PIPE, text=True) as process:
            try:
                assert process.stderr is not None
                port = int(process.stderr.readline().split(" on UDP ")[1].split(",")[0])
                station.sendto(heartbeat(ground_station()), ("127.0.0.1", port))
                heard = 0
                while heard < 3:  # one a second, as the lines that nobody reads
                    frames = parse_datagram(station.recv(2000), CRC_EXTRAS)
                    heard += sum(isinstance(frame, Frame) and frame.msgid == 0 for frame in frames)
                process.send_signal(signal.SIGTERM)
                _, complaints = process.communicate(timeout=30)
            finally:
                process.kill()
    assert process.returncode == 0
    assert re.fullmatch(r"ridlink: left out \d+ lines that nobody read\n", complaints)


def test_ctrl_c_while_the_loop_is_made_ends_it_without_a_word() -> None:
    program = (
        "import asyncio.unix_events as events, os, signal, sys\n"
        "class Interrupted(events.SelectorEventLoop):\n"
        "    def _make_self_pipe(self):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "        super()._make_self_pipe()\n"
        "asyncio = sys.modules['asyncio']\n"
        "asyncio.DefaultEventLoopPolicy._loop_factory = Interrupted\n"
        "from ridlink.__main__ import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program, "sim", *ANY_PORT], capture_output=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")


def test_a_full_disk_is_told_and_lands_nobody() -> None:
    command = [sys.executable, "-m", "ridlink", "sim", *ANY_PORT, "-n", "1", "--duration", "1.5", "--json"]
    with open("/dev/full", "wb") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 0
    assert done.stderr.endswith("standard output: No space left on device; the lines from there on are lost\n")


def test_a_reader_that_has_read_enough_ends_it() -> None:
    with running("-n", "1", "--json") as process:
        assert process.stdout is not None and process.stdout.readline()
        process.stdout.close()
        process.wait(timeout=10)
        assert process.returncode == 0


@pytest.mark.parametrize(
    ("of_scenario", "of_vehicle", "told"),
    [
        ("interval = 0.1\n", "speed = 3\nghosts = true\n",
         [":7: vehicle 1: speed is not known", ":8: vehicle 1: ghosts is not known", ":3: interval is not known"]),
        ("", 'airframe = "zeppelin"\n', ["unknown airframe 'zeppelin'"]),
    ],
    ids=["names that are not known here", "an airframe that there is not"],
)  # fmt: skip
def test_mistakes_of_a_scenario_file_are_told_in_one_run_and_it_is_not_explained(
    of_scenario: str, of_vehicle: str, told: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        f'name = "mine"\nduration_s = 20.0\n{of_scenario}'
        f"[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [40, 0, -50]\n{of_vehicle}"
    )
    done = ridlink_sim("--scenario", str(path), "--explain")
    assert (done.returncode, done.stdout) == (2, "")
    for line, part in zip(done.stderr.splitlines(), told, strict=True):
        assert part in line


def test_any_ports_are_of_the_kernels_choice_and_told() -> None:
    done = ridlink_sim("-n", "1", "--any-ports", "--duration", "1.5", "--json")
    assert done.returncode == 0, done.stderr
    ports = json.loads(done.stdout.splitlines()[0])["ports"]
    assert 0 not in (*ports["vehicles"], ports["air"]) and (ports["vehicles"], ports["air"]) != ([14580], 14650)
    assert f"on UDP {ports['vehicles'][0]}, air {ports['air']}\n" in done.stderr


def test_the_air_alone_needs_no_vehicles() -> None:
    done = ridlink_sim(*ANY_PORT, "-n", "0", "--airborne", "--duration", "0.2")
    assert done.returncode == 0 and done.stdout.startswith("0 vehicles: ")
    assert done.stderr.startswith("ridlink sim: 0 vehicles, air "), "no scenario is flown, so none is named"


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
        (["--scenario", "circle9"], "circle8 and square24 take other numbers by -n"),
        (["--scenario", "head-on", "-n", "3"], "2 vehicles, not 3"),
        (["-n", "41"], "overlap"),
        (["--sigma", "nan"], "'nan' is not a finite number"),
        (["--sigma", "10m"], "'10m' is neither metres nor one of zero-age, all-ages, any-age, worst-case"),
        (["--speed", "10m/s"], "'10m/s' is not a number"),
        (["-n", "two"], "'two' is not a number"),
        (["--speed", "inf"], "inf"),
        (["--speed", "0"], "0"),
        (["--interval", "-1"], "-1"),
        (["--loss", "2"], "2"),
        (["--home", "somewhere"], "LAT,LON,ALT"),
        (["--home", "91,0,0"], "no place on Earth"),
        (["--duration", "nan"], "not a finite number"),
        (["--autopilot", "betaflight"], "'betaflight' is not one of"),
        (["--seed", "-3"], "-3"),
        (["--speedup", "nan"], "not a finite number"),
        (["--speedup", "0"], "not in the range 0.0<x<=100.0"),
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


@pytest.mark.parametrize("option", ["--duration=1", "--explain"])
def test_more_vehicles_than_system_ids_are_refused(tmp_path: Path, option: str) -> None:
    lines = [{"type": "LineString", "coordinates": [[0.0, k / 1000], [0.001, k / 1000]]} for k in range(251)]
    path = tmp_path / "crowd.geojson"
    features = [{"type": "Feature", "geometry": line} for line in lines]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    told = refused(*ANY_PORT, "--scenario", str(path), option)
    assert "crowd: 251 vehicles" in told and "-n 250" in told
    assert ridlink_sim(*ANY_PORT, "--scenario", str(path), "-n", "250", "--duration", "0.1").returncode == 0


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
    for option in (
        *options.split(),
        "--gcs",
        "--list",
        "--explain",
        "--stdin",
        "--speedup",
        "--rid-on-bus",
        "--airframe",
        "--range",
        "--home",
        "--duration",
        "--until-arrived",
        "--no-rid",
        "--json",
    ):
        assert option in text


def test_list_names_everything_there_is_to_choose() -> None:
    done = ridlink_sim("--list")
    assert done.returncode == 0 and done.stderr == ""
    for name in (*TECHNOLOGIES, *AIRFRAMES, *EVENTS, "circle8", "worst-case"):
        assert f"\n  {name}" in done.stdout


def test_list_as_json_has_all_of_it_with_figures() -> None:
    """It was the text."""
    done = ridlink_sim("--list", "--json")
    found = json.loads(done.stdout, parse_constant=pytest.fail)
    wanted = {"airframes": AIRFRAMES, "technologies": TECHNOLOGIES, "faults": EVENTS}
    assert {kind: [*found[kind]] for kind in wanted} == {kind: [*names] for kind, names in wanted.items()}
    assert found["technologies"]["bt4"]["range_m"] == 300.0 and "circle8" in found["scenarios"]
    assert found["faults"]["battery"] == {"remaining": {"default": None, "least": 0.0, "most": 1.0}}
    assert found["accuracy_classes_sigma_m"]["worst-case"] == 10.0


@pytest.mark.programs
def test_the_configuration_of_a_daemon_has_goal_and_obstacles_in_degrees(tmp_path: Path) -> None:
    path, config = tmp_path / "wall.toml", tmp_path / "one.toml"
    path.write_text(
        'name = "wall"\nduration_s = 20.0\n'
        "[[vehicle]]\nstart_ned_m = [0, 30, -50]\ngoal_ned_m = [40, 30, -50]\ncooperative = false\n"
        "[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [40, 0, -50]\nspeed_mps = 7.0\nairframe_m = 0.9\n"
        "[[obstacle]]\npolygon_ne_m = [[15, -9], [25, -9], [25, 9], [15, 9]]\n"
    )
    options = "--home 47,8,400 --companion-port 24540 --air-port 24650 --daemon-config 2"
    done = ridlink_sim("--scenario", str(path), *options.split())
    assert done.returncode == 0, done.stderr
    config.write_text(done.stdout)
    read = daemon_config(read_config_file(str(config)))
    assert (str(read.vehicle), str(read.remote_id)) == ("udpin:127.0.0.1:24541", "udpout:127.0.0.1:24650")
    assert (read.engine.cruise_mps, read.engine.airframe_m, read.engine.vehicle_sysid) == (7.0, 0.9, 2)
    home = Geodetic(47.0, 8.0, 400.0)
    (polygon,) = read.engine.obstacles
    corners = [ned_from_geodetic(latitude, longitude, 400.0, home)[:2] for latitude, longitude in polygon]
    assert np.array(corners) == pytest.approx(np.array([[15, -9], [25, -9], [25, 9], [15, 9]]), abs=1e-3)
    assert read.engine.goal is not None
    assert ned_from_geodetic(*astuple(read.engine.goal)[:3], home) == pytest.approx([40, 0, -50], abs=1e-2)
    for number, why in (("1", "avoids nobody"), ("3", "no vehicle 3")):
        assert why in refused("--scenario", str(path), "--daemon-config", number)
    assert "--companion-port 0" in refused(*ANY_PORT, "--daemon-config", "1")


def of_one_vehicle(speed_mps: float, airframe_m: float) -> str:
    """A scenario file."""
    return (
        'name = "one"\nduration_s = 20.0\n[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [400, 0, -50]\n'
        f"speed_mps = {speed_mps}\nairframe_m = {airframe_m}\n"
    )


@pytest.mark.programs
def test_what_is_written_for_a_daemon_is_taken_by_it_up_to_the_fastest_and_largest(tmp_path: Path) -> None:
    """Its speed limit, above its cruise speed, was out of range from 80 m/s on."""
    path, config = tmp_path / "one.toml", tmp_path / "daemon.toml"
    for speed_mps, airframe_m in ((100.0, 30.0), (0.01, 0.1)):
        path.write_text(of_one_vehicle(speed_mps, airframe_m))
        config.write_text(ridlink_sim("--scenario", str(path), "--daemon-config", "1").stdout)
        engine = daemon_config(read_config_file(str(config))).engine
        assert (engine.cruise_mps, engine.airframe_m) == (speed_mps, airframe_m)


@pytest.mark.parametrize("speed_mps, airframe_m, told", [(101.0, 1.0, "cruise"), (10.0, 31.0, "airframe")])
def test_a_vehicle_that_no_daemon_flies_is_named(
    speed_mps: float, airframe_m: float, told: str, tmp_path: Path
) -> None:
    """Scenarios have faster and larger vehicles, which have no daemons."""
    path = tmp_path / "one.toml"
    path.write_text(of_one_vehicle(speed_mps, airframe_m))
    said = refused("--scenario", str(path), "--daemon-config", "1")
    assert said.startswith(f"ridlink: one: vehicle 1 cannot have a daemon: {told} must lie between ")


def test_explain_prints_the_scenario_and_flies_nothing(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\nduration_s = 60.0\n[wind]\nvelocity_ne_mps = [3.0, 4.0]\n'
        "[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [100, 0, -50]\nsilent = true\n"
        "[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [0, 100, -50]\nghost = true\n"
        '[[event]]\nat_s = 5.0\nvehicle = 1\nwhat = "gnss-outage"\n'
    )
    done = ridlink_sim("--scenario", str(path), "--explain", "--airframe", "category1", "--sigma", "worst-case")
    assert done.returncode == 0, done.stderr
    text = done.stdout
    assert "mine: 2 vehicles" in text and "wind 5 m/s" in text
    assert (
        "vehicle 1: (0, 0, -50) to (100, 0, -50), 100 m at 10 m/s" in text and "sigma 10 m; category1; silent" in text
    )
    assert "a ghost" in text and "5 s: gnss-outage, vehicle 1: duration_s 0" in text


def test_explain_tells_no_update_that_comes_before_the_technologys_period(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    vehicle = "[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [100, 0, -50]\ninterval_s = 0.5\n"
    path.write_text(f'name = "mine"\nduration_s = 60.0\n{vehicle}')
    for technology, fleet, own in (("ideal", "0.1", "0.5"), ("flarm", "1", "1"), ("wifi-beacon", "0.1024", "0.5")):
        text = ridlink_sim("--scenario", str(path), "--explain", "--technology", technology).stdout
        assert f"Remote ID every {fleet} s" in text and f"; every {own} s" in text


@pytest.mark.parametrize(
    "arguments, told",
    [
        (["--airframe", "zeppelin"], "unknown airframe 'zeppelin'"),
        (["--airframe", "ardupilot-quad"], "has no [feedback]"),
        (["--gnss", "white-radial", "--gnss-common", "0.5"], "no common share"),
        (["--sigma", "best-ever"], "best-ever"),
        (["--gcs", "udp:127.0.0.1:14550"], "udpout:127.0.0.1:14550"),
        (["--gcs", "nohost"], "udpout:nohost:"),
    ],
)
def test_wrong_choices_are_refused_in_one_line(arguments: list[str], told: str) -> None:
    done = ridlink_sim("-n", "1", *ANY_PORT, "--duration", "1", *arguments)
    assert done.returncode == 2, done.stderr
    assert told in done.stderr and "Traceback" not in done.stderr


def test_what_is_wrong_with_the_ground_stations_link_is_not_put_down_to_the_fleets_ports() -> None:
    done = ridlink_sim("-n", "1", *ANY_PORT, "--duration", "1", "--gcs", f"udpout:{'x' * 64}:14550")  # asks no resolver
    assert (done.returncode, done.stdout) == (3, "")
    assert "no such host" in done.stderr and "--air-port" not in done.stderr


def test_a_port_of_the_fleet_that_is_in_use_is_told_with_the_options_that_choose_another() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        done = ridlink_sim("-n", "1", *ANY_PORT, "--air-port", port, "--duration", "1")
    assert (done.returncode, done.stdout) == (3, "")
    assert f"UDP port {port}" in done.stderr and "--air-port" in done.stderr and done.stderr.count("\n") == 1


def test_faults_come_from_stdin_and_wrong_lines_are_told() -> None:
    lines = [
        '{"vehicle":1,"what":"forced-landing"}',
        '{"vehicle":1,"what":"magic"}',
        "[]",
        "{",
        "[" * 60_000,
        '{"vehicle":9,"what":"radio-off"}',
    ]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "ridlink",
            "sim",
            "-n",
            "1",
            *ANY_PORT,
            "--airborne",
            "--duration",
            "2.5",
            "--stdin",
            "--json",
        ],
        input="\n".join(lines) + "\n",
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    seen = [json.loads(line) for line in done.stdout.splitlines()]
    assert seen[0]["vehicles"][0]["state"] == "landing"
    assert done.stderr.splitlines()[1:] == [
        f"ridlink sim: stdin: event: what must be one of {', '.join(EVENTS)}, not 'magic'",
        *(f'ridlink sim: stdin: "{begin}" is no JSON object, as in {{"vehicle":1,"what":"gnss-outage"}}'
          for begin in ("[]", "{", "[" * 40)),
        "ridlink sim: there is no vehicle 9",
    ]  # fmt: skip


@pytest.mark.parametrize("text", ["", '{"vehicle":9,"what":"radio-off"}\n{"vehicle":1,"what":"forced-landing"}'])
def test_faults_may_come_from_a_file_which_need_not_end_with_a_line_feed(tmp_path: Path, text: str) -> None:
    path = tmp_path / "faults.jsonl"
    path.write_text(text)
    command = [sys.executable, "-m", "ridlink", "sim", *ANY_PORT, "-n", "1", "--airborne", "--duration", "1.2"]
    with open(path if text else os.devnull, "rb") as stdin:
        done = subprocess.run([*command, "--stdin", "--json"], stdin=stdin, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert done.stderr.splitlines()[1:] == (["ridlink sim: there is no vehicle 9"] if text else [])
    state = json.loads(done.stdout.splitlines()[0])["vehicles"][0]["state"]
    assert state == ("landing" if text else "airborne")
