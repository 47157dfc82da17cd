"""``ridlink demo`` as a user runs it: real daemons, real sockets, short flights on ports that the kernel chooses."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from ridlink.captures import read_messages
from ridlink.scenario import built_in
from sitl_sim.demo.screen import Screen, held_up_by, verdict_table
from sitl_sim.world import World
from tests.cli.full_pipe import full_pipe
from tests.cli.scenes import ALONE, scenario

pytestmark = pytest.mark.programs

HEAD_ON = """
name = "short head-on"
duration_s = 60.0
[[vehicle]]
start_ned_m = [-50.0, 0.0, -50.0]
goal_ned_m = [50.0, 0.0, -50.0]
speed_mps = 20.0
sigma_m = 1.0
[[vehicle]]
start_ned_m = [50.0, 0.0, -50.0]
goal_ned_m = [-50.0, 0.0, -50.0]
speed_mps = 20.0
sigma_m = 1.0
"""

INTO_A_HOVERER = """
name = "collision course"
duration_s = 20.0
[[vehicle]]
start_ned_m = [-30.0, 0.0, -50.0]
goal_ned_m = [60.0, 0.0, -50.0]
speed_mps = 20.0
cooperative = false
[[vehicle]]
start_ned_m = [30.0, 0.0, -50.0]
goal_ned_m = [-60.0, 0.0, -50.0]
speed_mps = 20.0
cooperative = false
"""

needs_mavsdk = pytest.mark.skipif(
    importlib.util.find_spec("mavsdk") is None, reason="the extra mavsdk is not installed"
)

KEYS = {
    "scenario", "definition", "seed", "vehicles", "arrived", "macs", "unmac_violations", "min_separation_m",
    "mission_time_s", "setpoints", "reports_received", "decision_ms", "setpoint_gap_ms", "log",
}  # fmt: skip


def demo(*arguments: str, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ridlink", "demo", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, stdin=subprocess.DEVNULL)


@pytest.mark.parametrize(
    "options",
    [[], ["--processes"], ["--solver", "graded"], ["--vertical"]],
    ids=["here", "processes", "graded", "vertical"],
)
def test_a_pair_passes_and_the_last_line_says_so(tmp_path: Path, options: list[str]) -> None:
    log = tmp_path / "flight.tlog"
    done = demo(
        "--scenario", scenario(tmp_path, HEAD_ON), "--autopilot", "ideal", "--headless", "--json", "--any-ports",
        "--log", str(log), *options,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr + done.stdout
    *_, said = done.stderr.splitlines()
    assert re.fullmatch(r"Flying short head-on, .*, seed 1 \(at most 60 s\) \.\.\.", said), "a minute without a word"
    result: dict[str, Any] = json.loads(done.stdout)
    assert set(result) >= KEYS
    assert (result["vehicles"], result["arrived"], result["macs"]) == (2, 2, 0)
    assert result["min_separation_m"] > 5.0, "two discs of 6 m of errors between the airframes"
    assert result["setpoints"] > 50 and result["reports_received"] > 50
    assert set(result["mission_time_s"]) == {"median", "max"}
    assert set(result["decision_ms"]) == {"p50", "p99", "max"}
    assert result["log"] == str(log)
    seen = {(message.source[0], message.name) for message in read_messages(log)}
    assert {(1, "RIDLINK_SEPARATION"), (2, "OPEN_DRONE_ID_LOCATION"), (2, "GLOBAL_POSITION_INT")} <= seen


def test_compare_flies_every_definition_with_the_same_seed(tmp_path: Path) -> None:
    done = demo(
        "--scenario", scenario(tmp_path, ALONE), "--autopilot", "ideal", "--compare", "--headless", "--any-ports",
        "--log", str(tmp_path / "flight.tlog"),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    definitions = ("snmac", "remote-id", "candidate1", "candidate2")
    *table, first, second, third, fourth = done.stdout.splitlines()
    assert [first, second, third, fourth] == [str(tmp_path / f"flight-{definition}.tlog") for definition in definitions]
    for definition in definitions:
        assert any(line.split()[:2] == [definition, "1/1"] for line in table)
        assert (tmp_path / f"flight-{definition}.tlog").stat().st_size > 0


def test_progress_that_nobody_reads_holds_up_no_flight(tmp_path: Path) -> None:
    command = [
        sys.executable, "-m", "ridlink", "demo", "--scenario", scenario(tmp_path, ALONE), "--autopilot", "ideal",
        "--any-ports", "--json", "--log", str(tmp_path / "flight.tlog"),
    ]  # fmt: skip
    with full_pipe() as writing:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=writing, timeout=120)
    assert (done.returncode, json.loads(done.stdout)["arrived"]) == (0, 1)


def test_a_disk_that_takes_no_more_of_the_log_is_told_and_ends_no_flight(tmp_path: Path) -> None:
    done = demo(
        "--scenario", scenario(tmp_path, ALONE), "--autopilot", "ideal", "--any-ports", "--headless", "--json",
        "--log", "/dev/full",
    )  # fmt: skip
    assert (done.returncode, json.loads(done.stdout)["arrived"]) == (0, 1)
    assert done.stderr.endswith("\nridlink: /dev/full: the recording ended early: No space left on device\n")


def test_a_collision_is_seen_and_ends_with_1(tmp_path: Path) -> None:
    done = demo(
        "--scenario", scenario(tmp_path, INTO_A_HOVERER), "--autopilot", "ideal", "--headless", "--any-ports",
        "--log", str(tmp_path / "flight.tlog"),
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "0 of 2 arrived, 1 mid-air collision" in done.stdout
    assert "decision p99 -, longest setpoint gap -" in done.stdout, "nobody decided, so there is no figure"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("table", [True, False])
def test_on_a_terminal_a_flight_is_a_table_or_one_line_that_goes_on(
    table: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    world, shown = World(built_in("circle8", 8)), Terminal()
    screen = Screen(shown, table=table)
    with screen.flight("circle8"):
        screen.update(world, "circle8", {})
    assert "arrived 0 of 8" in shown.getvalue()
    assert ("nearest m" in shown.getvalue()) is table
    assert (shown.getvalue().count("\n") > 8) is table


@pytest.mark.parametrize(
    ("gap_ms", "still_ms", "busy"),
    [(None, 0, ""), (131.0, 0, ""), (1000.0, 1000, ""), (4210.0, 0, "4.2 s without a setpoint"),
     (107.5, 8950, "the vehicles stood still for 8.9 s")],
)  # fmt: skip
def test_a_machine_that_was_too_busy_for_the_flight_is_named(gap_ms: float | None, still_ms: int, busy: str) -> None:
    result: dict[str, Any] = {
        "passed": False, "scenario": "circle8", "definition": "candidate2", "seed": 1, "vehicles": 8, "arrived": 7,
        "macs": 0, "obstacle_hits": 0, "unmac_violations": 0, "unmac_violations_true": 0, "min_separation_m": 21.4,
        "mission_time_s": {"median": 30.0, "max": 35.0}, "setpoints": 2446, "reports_received": 20748,
        "decision_ms": {"p50": 0.4, "p99": 1.9, "max": 4.0}, "setpoint_gap_ms": {"p99": 104.0, "max": gap_ms},
        "details": [], "stood_still_ms": still_ms,
    }  # fmt: skip
    console = Console(file=io.StringIO(), width=200)
    console.print(verdict_table(result))
    assert isinstance(console.file, io.StringIO)
    told = [line for line in console.file.getvalue().splitlines() if line.startswith("machine ")]
    assert told == ([f"machine           {held_up_by(result)}"] if busy else [])
    assert not told or f"too busy: {busy}" in told[0]


EMPTY = """
[[event]]
at_s = 0.5
what = "battery"
remaining = 0.0
"""


def test_where_nobody_flies_any_more_nobody_is_waited_for(tmp_path: Path) -> None:
    stuck = ALONE.replace("-50.0", "-2.0").replace("30.0", "300.0").replace("duration_s = 20.0", "duration_s = 3600.0")
    log = str(tmp_path / "flight.tlog")
    done = demo("--scenario", scenario(tmp_path, stuck + EMPTY), "--headless", "--any-ports", "--log", log)
    assert done.returncode == 1, done.stderr
    assert "0 of 1 arrived" in done.stdout and "\nvehicle 1: on the ground, not arrived\n" in done.stdout


def test_who_has_not_arrived_in_time_is_named(tmp_path: Path) -> None:
    late = ALONE.replace("duration_s = 20.0", "duration_s = 1.0") + "cooperative = false\n"
    log = str(tmp_path / "flight.tlog")
    done = demo("--scenario", scenario(tmp_path, late), "--headless", "--any-ports", "--log", log)
    assert done.returncode == 1, done.stderr
    assert "0 of 1 arrived" in done.stdout and "\nvehicle 1: not arrived\n" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "text", "code"),
    [
        (["--scenario", "circle9"], "known are circle8", 2),
        (["--speed", "nan"], "finite", 2),
        (["-n", "0"], "nobody to fly", 2),
        (["--definition", "candidate3"], "candidate3", 2),
        (["--definition", "chance", "--eta", "0"], "got 0", 2),
        (["--solver", "grade"], "grade", 2),
        (["--log", "/no/such/folder/flight.tlog"], "flight.tlog: there is no folder /no/such/folder", 3),
        (["--scenario", "missing.toml"], "missing.toml", 3),
        (["--compare", "--definition", "chance"], "--compare flies snmac, remote-id, candidate1, candidate2", 2),
    ],
)
def test_a_mistake_is_one_clear_line(arguments: list[str], text: str, code: int) -> None:
    done = demo(*arguments, "--headless", "--any-ports")
    assert done.returncode == code, done.stderr
    assert text in done.stderr
    assert len(done.stderr.splitlines()) == 1 and done.stdout == ""


@pytest.mark.parametrize(
    "text", ["vehicle = []\n", ALONE.split("20.0\n", 1)[1] + "ghost = true\n"], ids=["none", "ghost"]
)
def test_a_file_in_which_nobody_flies_passes_no_flight(tmp_path: Path, text: str) -> None:
    path = scenario(tmp_path, f'name = "void"\nduration_s = 1.0\n{text}')
    done = demo("--scenario", path, "--headless", "--any-ports")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("ridlink: void: there is nobody to fly") and done.stderr.count("\n") == 1


def test_from_the_ground_without_its_extra_ends_before_anything_begins(tmp_path: Path) -> None:
    log = tmp_path / "kept.tlog"
    log.write_bytes(b"an earlier flight")
    hidden = (
        "import importlib.util; importlib.util.find_spec = lambda *_: None; from ridlink.__main__ import main; main()"
    )
    command = [sys.executable, "-c", hidden, "demo", "--from-ground", "--view-port", "0", "--log", str(log)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "ridlink: --from-ground needs the extra 'mavsdk': pip install 'ridlink[mavsdk]'\n"
    assert log.read_bytes() == b"an earlier flight"


def test_all_logs_of_a_comparison_are_looked_at_before_the_first_flight(tmp_path: Path) -> None:
    (tmp_path / "f-candidate1.tlog").mkdir()
    done = demo("--compare", "--headless", "--any-ports", "--log", str(tmp_path / "f.tlog"))
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr == f"ridlink: {tmp_path}/f-candidate1.tlog: Is a directory\n"


def test_a_log_that_cannot_be_written_leaves_no_port_open(tmp_path: Path) -> None:
    log = tmp_path / "pipe.tlog"
    os.mkfifo(log)  # that nobody reads
    command = [sys.executable, "-W", "always::ResourceWarning", "-m", "ridlink", "demo", "--headless", "--any-ports"]
    done = subprocess.run([*command, "--log", str(log)], capture_output=True, text=True, timeout=60.0)
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr == f"ridlink: {log}: No such device or address\n"


def test_a_scenario_may_have_a_longer_name_than_a_file(tmp_path: Path) -> None:
    named = ALONE.replace("alone", 300 * "\N{AIRPLANE}") + "cooperative = false\n"
    done = demo("--scenario", scenario(tmp_path, named), "--autopilot", "ideal", "--headless", "--json", "--any-ports")
    assert done.returncode == 0, done.stderr
    Path(json.loads(done.stdout)["log"]).unlink()


def test_a_bad_number_in_a_scenario_names_file_and_key(tmp_path: Path) -> None:
    path = scenario(tmp_path, ALONE.replace("speed_mps = 20.0", "speed_mps = nan"))
    done = demo("--scenario", path, "--headless", "--any-ports")
    assert done.returncode == 2
    assert "speed_mps" in done.stderr and "scenario.toml" in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_scenario_that_is_none_is_one_line_and_no_page() -> None:
    command = [sys.executable, "-m", "ridlink", "demo", "--view-port", "0", "--scenario", "nosuch"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, "") and "unknown scenario 'nosuch'" in line


@pytest.mark.parametrize(
    ("module", "options"),
    [
        ("sitl_sim.demo.crew", []),
        pytest.param("sitl_sim.demo.from_ground", ["--from-ground"], marks=needs_mavsdk),
    ],
)
def test_words_of_its_processes_that_nobody_understands_end_it_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, options: list[str]
) -> None:
    (tmp_path / "sitecustomize.py").write_text(f"import sys\nif {module!r} in sys.orig_argv: print('hello')")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    chosen = ["--headless", "--any-ports", "--scenario", scenario(tmp_path, ALONE), "--log", str(tmp_path / "f.tlog")]
    done = demo(*chosen, *options, timeout_s=60.0)
    assert done.returncode == 70, done.stderr
    assert "internal error: JSONDecodeError" in done.stderr


def test_a_port_in_use_is_named(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        try:
            taken.bind(("127.0.0.1", 14650))
        except OSError:
            pytest.skip("the air's documented port is already in use on this machine")
        log = str(tmp_path / "flight.tlog")
        done = demo("--view-port", "0", "--scenario", scenario(tmp_path, ALONE), "--log", log)
    assert done.returncode == 3, done.stderr
    assert re.search(r"port 1\d{4}\b", done.stderr) and "--any-ports" in done.stderr
    assert len(done.stderr.splitlines()) == 1, "no page is told of that nobody will see"
    assert not (tmp_path / "flight.tlog").exists(), "nothing half written"


def flying(folder: Path, *options: str) -> tuple[subprocess.Popen[str], list[int]]:
    """A demo in the air, and the processes that it has started."""
    command = [sys.executable, "-m", "ridlink", "demo", "--any-ports", *options, "--log", str(folder / "f.tlog")]
    flight = subprocess.Popen(
        [*command, "--scenario", scenario(folder, HEAD_ON)],
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
    )
    assert flight.stderr is not None
    for line in flight.stderr:
        if line.startswith("Flying"):
            break
    children = subprocess.run(["pgrep", "-P", str(flight.pid)], capture_output=True, text=True).stdout.split()
    return flight, list(map(int, children))


@pytest.mark.parametrize(("options", "count"), [([], 1), (["--processes"], 2)], ids=["together", "apart"])
def test_daemons_do_not_outlive_a_demo_that_is_killed(tmp_path: Path, options: list[str], count: int) -> None:
    """They kept the ports of the next one."""
    flight, children = flying(tmp_path, "--no-view", *options)
    watched = [os.pidfd_open(child) for child in children]
    flight.kill()
    _, rest = flight.communicate(timeout=30.0)  # until the daemons have closed their ends, too
    assert "Traceback" not in rest
    assert len(children) == count
    for each in watched:
        assert select.select([each], [], [], 20.0)[0], "still flies"
        os.close(each)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_flight_ends_everything_it_started(tmp_path: Path, number: signal.Signals) -> None:
    flight, children = flying(tmp_path, "--processes")
    flight.send_signal(number)
    _, rest = flight.communicate(timeout=30.0)
    assert flight.returncode == 1
    assert "ended before the verdict" in rest
    assert len(children) == 2
    assert not [child for child in children if Path(f"/proc/{child}").exists()]


def test_a_signal_does_not_wait_for_the_compiler(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ridlink", "demo", "--any-ports", "--no-view", "--log", str(tmp_path / "f.tlog")]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    flight = subprocess.Popen(command, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, env=environment)
    assert flight.stderr is not None
    assert flight.stderr.readline().startswith("Compiling the solver")
    flight.send_signal(signal.SIGTERM)
    _, rest = flight.communicate(timeout=60.0)
    assert (flight.returncode, rest) == (1, "ridlink: ended before the verdict\n")
    assert not list(tmp_path.rglob("*avoid_one*.nbi")), "the kernel that takes longest has not been waited for"


@pytest.mark.parametrize(("options", "whose"), [([], "1, 2"), (["--processes"], "[12]")], ids=["together", "apart"])
def test_f27_a_daemon_that_is_killed_in_flight_ends_the_demo_and_is_named(
    tmp_path: Path, options: list[str], whose: str
) -> None:
    flight, children = flying(tmp_path, "--no-view", *options)
    os.kill(children[0], signal.SIGKILL)
    _, rest = flight.communicate(timeout=60.0)
    assert flight.returncode == 3
    assert re.search(rf"^ridlink: the daemon of vehicle {whose} ended in flight \(signal 9\)$", rest, re.M)
    assert not [child for child in children if Path(f"/proc/{child}").exists()]
