"""``ridlink campaign``: the rows, and that nothing that was done is lost or done otherwise."""

from __future__ import annotations

import contextlib
import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from random import Random

import numpy as np
import pytest
from click.testing import CliRunner

from ridlink import decode
from ridlink.campaign.statistics import clopper_pearson
from ridlink.cli import cli
from tests.cli.campaign_process import await_shards, rows_of, shards, start
from tests.cli.conftest import Ridlink

pyarrow = pytest.importorskip("pyarrow", reason="shards need the extra 'export'")
parquet = pytest.importorskip("pyarrow.parquet")

pytestmark = pytest.mark.programs

KEYS = [
    "scenario", "definition", "gnss", "solver", "dynamics", "runs", "flights", "arrived", "unfinished", "macs",
    "mac_rate", "mac_rate_ci95", "median_s", "median_ci95", "max_time_s", "ratio_to_snmac", "min_separation_m",
    "min_margin_m", "infeasible_share", "sigma_m", "interval_s", "loss", "risk_ratio", "risk_ratio_ci95",
    "mac_rate_pairs_ci95",
]  # fmt: skip

CAMPAIGN = ["--preset", "paper", "--scenario", "circle8", "--runs", "200"]
SHARDS = 4 * 4

FILE = """\
name = "a meeting"
duration_s = 60.0
[[vehicle]]
start_ned_m = [-200.0, 0.0, -50.0]
goal_ned_m = [200.0, 0.0, -50.0]
sigma_m = 0.0
[[vehicle]]
start_ned_m = [200.0, 0.0, -50.0]
goal_ned_m = [-200.0, 0.0, {down}]
cooperative = false
extended = false
"""

THROUGH = FILE.replace("-200.0", "-201.0").replace("extended = false\n", "airframe_m = 0.4\n")


@pytest.fixture
def ridlink(ridlink: Ridlink) -> Ridlink:
    """``ridlink campaign run`` in this process."""
    return partial(ridlink, "campaign", "run")


def workers_of(process: subprocess.Popen[str]) -> Iterator[int]:
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    for child in map(int, children):
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
            yield child


def is_running(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def await_end(processes: list[int]) -> None:
    patience = subprocess.Popen(["sleep", "20"])
    while any(map(is_running, processes)):
        try:
            patience.wait(0.02)
        except subprocess.TimeoutExpired:
            continue
        raise AssertionError("processes outlive the command")
    patience.kill()
    patience.wait()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign, flown in one go by one process."""
    folder = tmp_path_factory.mktemp("campaign") / "whole"
    process = start(*CAMPAIGN, "--jobs", 1, "-o", folder, "--json")
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    (folder / "stdout").write_text(out)
    (folder / "stderr").write_text(err)
    return folder


def test_who_flies_through_another_between_two_instants_has_collided(tmp_path: Path, ridlink: Ridlink) -> None:
    file = tmp_path / "through.toml"
    file.write_text(THROUGH.format(down=-50.0))
    through = ["--scenario", file, "--definition", "none", "--sigma", "0", "--runs", "2", "--json", "-o"]
    code, out, _ = ridlink(*through, tmp_path / "swept")
    (row,) = json.loads(out)["rows"]
    assert (code, row["macs"]) == (0, 4)
    assert row["min_separation_m"] == pytest.approx(0.0, abs=1e-6)
    code, out, _ = ridlink("--preset", "paper", *through, tmp_path / "paper")
    (row,) = json.loads(out)["rows"]
    assert (code, row["macs"], row["min_separation_m"]) == (0, 0, pytest.approx(1.0)), "which the paper does not see"


def test_rows_have_the_keys_that_are_promised_and_the_orders_of_the_paper(whole: Path) -> None:
    document = json.loads((whole / "stdout").read_text().splitlines()[-1])
    assert list(document) == ["rows", "agent_steps", "wall_s", "agent_steps_per_s"]
    assert document["agent_steps_per_s"] == pytest.approx(document["agent_steps"] / document["wall_s"])
    rows = {row["definition"]: row for row in document["rows"]}
    assert list(rows) == ["snmac", "remote-id", "candidate1", "candidate2"]
    for row in rows.values():
        assert list(row) == KEYS
        assert (row["gnss"], row["solver"], row["dynamics"]) == ("white-radial", "rotation", "ideal")
        assert row["arrived"] + row["unfinished"] + row["macs"] == row["flights"] == 1600
        assert row["mac_rate"] == row["macs"] / 1600
        assert row["mac_rate_ci95"] == list(clopper_pearson(row["macs"], 1600))
        (low, high), (lower, higher) = row["mac_rate_ci95"], row["mac_rate_pairs_ci95"]
        assert lower <= low <= row["mac_rate"] <= high <= higher
        assert row["median_ci95"][0] <= row["median_s"] <= row["median_ci95"][1] < row["max_time_s"]
        assert (row["min_margin_m"] < 0.0) == (row["macs"] > 0)
    assert rows["snmac"]["ratio_to_snmac"] == 1.0
    assert 0.02 <= rows["snmac"]["mac_rate"] <= 0.08
    assert 1.7 <= rows["remote-id"]["ratio_to_snmac"] <= 2.3
    assert 1.15 <= rows["candidate1"]["ratio_to_snmac"] <= 1.27
    told = [line for line in (whole / "stderr").read_text().splitlines() if "compiling" not in line]
    assert told == ["campaign: 16 shards, 0 kept from before, 1 process", "campaign: 16 shards done"]


def test_a_killed_worker_and_a_killed_parent_lose_nothing_and_rows_stay_the_same(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    first = start(*CAMPAIGN, "--jobs", 2, "-o", folder)
    await_shards(first, folder, 0)
    os.kill(next(workers_of(first)), signal.SIGKILL)
    _, err = first.communicate(timeout=60)
    assert first.returncode == 70
    kept = len(shards(folder))
    assert err.splitlines()[-1] == (
        "ridlink: a process that flew was killed, or ran out of memory; "
        f"{kept} of {SHARDS} shards kept, --resume goes on from there"
    )

    second = start(*CAMPAIGN, "--jobs", 2, "-o", folder, "--resume")
    await_shards(second, folder, kept)
    workers = list(workers_of(second))
    second.kill()
    _, err = second.communicate(timeout=60)
    stamps = {file: file.stat().st_mtime_ns for file in shards(folder)}
    assert kept < len(stamps) < SHARDS
    assert len(workers) == 2
    await_end(workers)

    assert "resource_tracker" not in err
    third = start(*CAMPAIGN, "--jobs", 1, "-o", folder, "--resume")
    third.communicate(timeout=60)
    assert third.returncode == 0
    assert all(file.stat().st_mtime_ns == stamp for file, stamp in stamps.items())
    assert len(shards(folder)) == SHARDS
    assert rows_of(folder) == rows_of(whole)


def test_ctrl_c_while_workers_still_load_is_told_by_nobody(tmp_path: Path) -> None:
    process = start(*CAMPAIGN, "--jobs", 2, "-o", tmp_path / "folder", group=True)
    workers: list[int] = []
    while len([worker for worker in workers if "numpy" in Path(f"/proc/{worker}/maps").read_text()]) < 2:
        assert process.poll() is None
        workers = list(workers_of(process))
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert [line for line in err.splitlines() if not line.startswith("campaign: ")] == []
    assert err.endswith(f"campaign: 0 of {SHARDS} shards kept, --resume goes on from there\n")
    await_end(workers)


def test_ctrl_c_gives_the_cursor_back(tmp_path: Path) -> None:
    long = ["--preset", "paper", "--runs", "20000", "-o", str(tmp_path / "folder")]
    command = [sys.executable, "-m", "ridlink", "campaign", "run", *long]
    terminal, stderr = os.openpty()
    with open(terminal, "rb", buffering=0) as shown:
        flying = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stderr, env=os.environ | {"TERM": "xterm"})
        os.close(stderr)
        text = b""
        while b" 1/" not in text:
            text += shown.read(1024)
        flying.send_signal(signal.SIGINT)
        with contextlib.suppress(OSError):  # how a terminal ends
            while more := shown.read(1024):
                text += more
    assert flying.wait(30) == 130
    assert text.rindex(b"\x1b[?25h") > text.rindex(b"\x1b[?25l"), "a bar hides it"
    assert b"shards kept, --resume goes on from there" in text


def test_processes_change_the_time_only(whole: Path, tmp_path: Path, ridlink: Ridlink) -> None:
    code, out, _ = ridlink(*CAMPAIGN, "--jobs", 2, "-o", tmp_path / "two")
    assert code == 0
    assert rows_of(tmp_path / "two") == rows_of(whole)
    for file in shards(whole):
        assert parquet.read_table(file).equals(parquet.read_table(tmp_path / "two" / file.relative_to(whole)))
    (line,) = (line for line in out.splitlines() if line.startswith("circle8   remote-id"))
    assert line.split()[2:5] == ["0/1,600", "below", "0.46"]
    assert max(map(len, out.splitlines())) <= 120


def test_a_full_disk_is_said_in_one_line_and_gone_on_from(whole: Path, tmp_path: Path, ridlink: Ridlink) -> None:
    folder = tmp_path / "full"
    largest = max(file.stat().st_size for file in shards(whole))
    process = start(*CAMPAIGN, "--jobs", 1, "-o", folder, file_bytes=largest - 1)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 3
    kept = len(shards(folder))
    assert err.splitlines()[-1].endswith(
        f".parquet: File too large; {kept} of {SHARDS} shards kept, --resume goes on from there"
    )
    assert not list(folder.rglob("*.unfinished"))
    assert ridlink(*CAMPAIGN, "--jobs", 1, "-o", folder, "--resume")[0] == 0
    assert rows_of(folder) == rows_of(whole)


def test_a_damaged_shard_is_flown_again(tmp_path: Path, ridlink: Ridlink) -> None:
    folder = tmp_path / os.fsdecode(b"few\xff")  # and its folder's name need be no text
    few = ["--scenario", "crossing", "--definition", "snmac", "--runs", 3, "--jobs", 1, "-o", folder]
    assert ridlink(*few)[0] == 0
    before = rows_of(folder)
    (shard,) = shards(folder)
    shard.write_bytes(shard.read_bytes()[:-100])
    assert ridlink(*few, "--resume")[0] == 0
    assert rows_of(folder) == before


def test_a_campaign_that_ended_before_it_was_written_down_begins_anew(tmp_path: Path, ridlink: Ridlink) -> None:
    (tmp_path / "campaign.json.unfinished").write_bytes(b'{"ridlink"')
    few = ["--scenario", "crossing", "--definition", "snmac", "--runs", 3, "--jobs", 1, "-o", tmp_path, "--resume"]
    assert ridlink(*few)[0] == 0
    assert len(shards(tmp_path)) == 1 and not list(tmp_path.rglob("*.unfinished"))


def test_one_run_again_alone(whole: Path, ridlink: Ridlink) -> None:
    code, out, _ = ridlink(*CAMPAIGN[:-2], "--definition", "snmac", "--only-run", 130, "--json")
    assert code == 0
    document = json.loads(out.splitlines()[-1])
    (row,) = document["rows"]
    assert list(row) == KEYS
    table = parquet.read_table(whole / "shards" / "circle8_snmac_white-radial_rotation" / "runs-000128.parquet")
    flown = table.slice(2, 1).to_pylist()[0]
    assert (flown["run"], flown["seed"]) == (130, 1)
    assert [each["arrival_s"] for each in document["vehicles"]] == flown["arrival_s"]
    assert row["min_separation_m"] == flown["distance_m"]
    assert "vehicle 8: arrived after" in ridlink(*CAMPAIGN[:-2], "--only-run", 0)[1]
    code, out, err = ridlink(*CAMPAIGN, "--only-run", 200)
    assert (code, out) == (2, "") and "--only-run 200 is none of 200 runs, which are 0 to 199" in err
    code, out, err = ridlink(*CAMPAIGN[:-2], "--only-run", 0, "--resume")
    assert (code, out) == (2, "") and "--resume does not go with --only-run" in err


def test_the_log_of_a_flight_holds_what_was_true_and_what_was_told(tmp_path: Path, ridlink: Ridlink) -> None:
    one = ["--scenario", "head-on", "--definition", "candidate2", "--gnss", "white", "--only-run", 5, "--json"]
    code, out, _ = ridlink(*one, "--log", tmp_path / "f.tlog")
    assert code == 0
    log = decode(tmp_path / "f.tlog")
    steps = json.loads(out)["agent_steps"]
    assert steps == json.loads(ridlink(*one)[1])["agent_steps"], "a flight that is watched is flown as others are"
    true, told, parts = (
        log[name] for name in ("GLOBAL_POSITION_INT", "OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION")
    )  # fmt: skip
    assert len(true) == len(told) == len(parts) == steps
    assert set(log["HEARTBEAT"]["sysid"]) == {1, 2}
    north_m, east_m = ((told[name].astype(float) - true[short]) * 1e-7 * 111_200.0 for name, short in
                       (("latitude", "lat"), ("longitude", "lon")))  # fmt: skip
    assert north_m.std() == pytest.approx(10.0, rel=0.1)
    assert east_m.std() * 0.677 == pytest.approx(10.0, rel=0.1)
    assert set(parts["horizontal_error"]) == {3000}
    assert set(parts["airframe_size"]) == {60}
    commanded = parts[parts["sysid"] == 1]["commanded_vx"][:-1]
    assert abs(commanded - true[true["sysid"] == 1]["vx"][1:]).max() <= 1
    late = ["--interval", 0.5, "--loss", 0.2, "--dynamics", "ardupilot"]
    assert ridlink(*one, *late, "--log", tmp_path / "late.tlog")[0] == 0
    fewer = decode(tmp_path / "late.tlog")
    assert len(fewer["GLOBAL_POSITION_INT"]) == pytest.approx(5 * len(fewer["OPEN_DRONE_ID_LOCATION"]), abs=9)
    assert set(fewer["RIDLINK_SEPARATION"]["update_interval"]) == {500}
    assert "--only-run" in ridlink("--log", tmp_path / "f.tlog", "-o", tmp_path / "x")[2]
    assert "these are 2 cells" in ridlink(*one, "--solver", "graded,rotation", "--log", tmp_path / "f.tlog")[2]


@pytest.mark.parametrize(
    ("key", "arguments"),
    [
        ("seed", ["--seed", 2]),
        ("runs", ["--runs", 201]),
        ("sigma_m", ["--sigma", 5]),
        ("loss", ["--loss", 0.3]),
        ("stock_share", ["--stock", 0.5]),
        ("definition", ["--definition", "snmac"]),
    ],
)
def test_another_campaign_is_refused_and_the_difference_is_named(
    whole: Path, ridlink: Ridlink, key: str, arguments: list[object]
) -> None:
    code, _, err = ridlink(*CAMPAIGN, *arguments, "-o", whole, "--resume")
    assert (code, len(err.splitlines())) == (2, 1)
    assert f"holds another campaign: {key} is " in err


def test_of_another_campaign_the_scene_is_named_that_makes_it_another(whole: Path, ridlink: Ridlink) -> None:
    """Geometries begin with the same numbers; whoever is shown their beginnings sees no difference."""
    for scenes, difference in (
        ("square24", "scenario has square24 here only"),
        ("circle8,square24", "scenario has square24 here only"),
    ):
        code, _, err = ridlink(*CAMPAIGN, "--scenario", scenes, "-o", whole, "--resume")
        told = f"ridlink: {whole}: holds another campaign: {difference}; give its own options\n"
        assert (code, err) == (2, told)


def test_nobody_waits_for_the_compiler_without_a_word(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for more in (("-o", tmp_path / "folder", "--jobs", 1), ("--only-run", 0)):
        command = [sys.executable, "-m", "ridlink", "campaign", "run", *CAMPAIGN, *map(str, more)]
        flying = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
        assert flying.stderr is not None
        assert flying.stderr.readline() == "campaign: compiling rotation (once; up to half a minute) ...\n"
        flying.kill()
        flying.communicate(timeout=30)


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (
            ["--definition", "snmac,candidate9"],
            2,
            "'candidate9' is not known: did you mean 'candidate2'? known are snmac, remote-id",
        ),
        (["--gnss", "purple"], 2, "known are white, white-radial, gauss-markov, bias"),
        (["--solver", ""], 2, "known are halfplane, graded, rotation, g2"),
        (["--dynamics", "px5"], 2, "known are ideal, px4, ardupilot"),
        (["--loss", "1"], 2, "1.0 is not in the range"),
        (["--loss", "0.8", "--loss-burst", "2"], 2, "burst must be at least 4 reports at a loss of 0.8"),
        (["--loss-burst", "5"], 2, "nothing is lost, in bursts or singly; --loss-burst goes with a --loss above 0"),
        (["--loss", "0.3", "--loss-burst", "-3"], 2, "-3.0 is not in the range"),
        (["--range", "400,500"], 2, "'400,500' is not a number"),
        (["--seed", str(2**63)], 2, "9223372036854775808 is not in the range"),
        (["--latency", "0.3-0.1"], 2, "the second time is before the first"),
        (["--interval", "0"], 2, "0.0 is not in the range"),
        (["--stock", "1.5"], 2, "1.5 is not in the range"),
        (["--scenario", "head-on", "--speed", "12"], 2, "says itself who flies"),
        (["--scenario", "circle3", "--speed", "1", "--category", "3"], 2, "--speed and --category exclude each other"),
        (
            ["--scenario", "circles"],
            2,
            "unknown scenario 'circles': did you mean 'circle8'? known are",
        ),
        (["--scenario", "missing.toml"], 3, "missing.toml: No such file"),
        (["--sigma", "nan"], 2, "'nan' is not"),
        (["--runs", "0"], 2, "0 is not in the range"),
        ([], 2, "Missing option '-o'"),
    ],
)
def test_options_that_cannot_be_flown(ridlink: Ridlink, arguments: list[str], code: int, text: str) -> None:
    folder = ["-o", "/proc/never"] if arguments else []
    ended, out, err = ridlink(*arguments, *folder)
    assert (ended, out) == (code, "")
    assert text in err
    assert len(err.splitlines()) == 1


FIGURES = ("sigma", "interval", "loss", "loss-burst", "latency", "range", "stock", "unresponsive", "speed",
           "correlation", "common-mode", "bias")  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("figure", ["nan", "inf"])
def test_what_is_no_figure_is_an_option_that_cannot_be_flown(ridlink: Ridlink, name: str, figure: str) -> None:
    code, out, err = ridlink(f"--{name}", figure, "-o", "/proc/never")
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert f"Invalid value for '--{name}'" in err


def test_the_largest_seed_and_run_are_flown(tmp_path: Path, ridlink: Ridlink) -> None:
    few = ["--scenario", "crossing", "--definition", "snmac", "--seed", 2**63 - 1]
    assert ridlink(*few, "--runs", 1, "--jobs", 1, "-o", tmp_path / "seed")[0] == 0
    assert ridlink(*few, "--only-run", 2**63 - 1)[0] == 0
    assert ridlink(*few, "--only-run", 2**63)[0] == 2


def test_a_shard_of_another_seed_stops_the_campaign_and_stays_as_it_is(tmp_path: Path, ridlink: Ridlink) -> None:
    few = ["--scenario", "crossing", "--definition", "snmac", "--runs", 3, "--jobs", 1]
    assert ridlink(*few, "--seed", 1, "-o", tmp_path / "one")[0] == 0
    assert ridlink(*few, "--seed", 2, "-o", tmp_path / "two")[0] == 0
    (ours,), (theirs,) = shards(tmp_path / "one"), shards(tmp_path / "two")
    shutil.copy(theirs, ours)
    code, _, err = ridlink(*few, "--resume", "-o", tmp_path / "one")
    assert (code, len(err.splitlines())) == (2, 1)
    assert "is of another campaign: seed is 2 there and 1 here" in err
    assert ours.read_bytes() == theirs.read_bytes()
    pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")
    refused = CliRunner().invoke(cli, ["campaign", "report", str(tmp_path / "one")]).exception
    assert str(refused) == f"{ours}: is of another campaign: its seed is not 1"
    assert not (tmp_path / "one" / "report.json").exists()


def test_every_option_makes_its_cells(tmp_path: Path, ridlink: Ridlink) -> None:
    few = ["--scenario", "crossing", "--definition", "candidate2,none", "--dynamics", "ideal,px4", "--loss", "0,0.3"]
    code, out, _ = ridlink(
        *few, "--sigma", "3.5,10", "--interval", "0.1,1", "--solver", "k", "--latency", "0.1-0.3", "--runs", 2,
        "--loss-burst", 5, "--stock", 0.3, "--unresponsive", 0.1, "--bias", 1, "--common-mode", 0.5, "--jobs", 1,
        "-o", tmp_path / "all", "--json",
    )  # fmt: skip
    assert code == 0
    rows = json.loads(out)["rows"]
    names = ("definition", "dynamics", "loss", "sigma_m", "interval_s")
    assert len({tuple(row[name] for name in names) for row in rows}) == len(rows) == 2**5
    assert all(row["solver"] == "k" and row["arrived"] + row["unfinished"] + row["macs"] == 4 for row in rows)
    assert len(shards(tmp_path / "all")) == 2**5
    assert (tmp_path / "all/shards/crossing_candidate2_gauss-markov_k_px4_sigma3.5_interval1.0_loss0.3").is_dir()


def test_points_are_flown_and_nothing_between_them(tmp_path: Path, ridlink: Ridlink) -> None:
    few = ["--preset", "paper", "--scenario", "crossing", "--runs", 2, "--jobs", 1, "-o", tmp_path / "few", "--json"]
    code, out, err = ridlink("--point", "candidate1/rotation,candidate2/g3", *few)
    assert code == 0, err
    rows = json.loads(out)["rows"]
    assert [(row["definition"], row["solver"]) for row in rows] == [("candidate1", "rotation"), ("candidate2", "g3")]
    assert json.loads((tmp_path / "few/campaign.json").read_text())["point"] == ["candidate1/rotation", "candidate2/g3"]
    for wrong, text in (
        (["--point", "candidate2"], "'candidate2' is not DEFINITION/SOLVER, such as candidate2/rotation"),
        (["--point", "candidate9/g3"], "'candidate9' is not known: did you mean 'candidate2'? known"),
        (["--point", "candidate2/g9"], "'g9' is not known; known are halfplane"),
        (["--point", "candidate2/g3", "--solver", "k"], "--definition and --solver do not go with it"),
    ):
        code, _, err = ridlink(*wrong, "-o", tmp_path / "never")
        assert (code, len(err.splitlines())) == (2, 1)
        assert text in err


def test_without_avoidance_is_what_the_risk_is_measured_by(tmp_path: Path, ridlink: Ridlink) -> None:
    few = ["--preset", "paper", "--scenario", "circle8", "--definition", "none,snmac,remote-id", "--runs", 40]
    code, out, _ = ridlink(*few, "--jobs", 1, "-o", tmp_path / "risk", "--json")
    assert code == 0
    nobody, snmac, remote_id = json.loads(out)["rows"]
    assert nobody["risk_ratio"] is None
    assert 0.6 < nobody["mac_rate"] < 0.85
    assert snmac["risk_ratio"] == pytest.approx(snmac["mac_rate"] / nobody["mac_rate"])
    assert snmac["risk_ratio_ci95"][0] < snmac["risk_ratio"] < snmac["risk_ratio_ci95"][1] < 0.3
    assert remote_id["risk_ratio"] == 0.0 < remote_id["risk_ratio_ci95"][1] < 0.05


def test_folders_that_cannot_be_used(whole: Path, tmp_path: Path, ridlink: Ridlink) -> None:
    assert "--resume" in ridlink(*CAMPAIGN, "-o", whole)[2]
    (tmp_path / "file").write_text("in the way")
    for path in (tmp_path / "file", "/proc/campaign"):
        code, _, err = ridlink(*CAMPAIGN, "-o", path)
        assert (code, len(err.splitlines())) == (3, 1)
        assert f"{path}: No" in err, "Not a directory, or no such one"
    code, _, err = ridlink(*CAMPAIGN, "-o", tmp_path)
    assert code == 2
    assert "is not empty" in err
    for damaged in ("", "[]", "null", "[" * 100_000):
        (tmp_path / "campaign.json").write_text(damaged)
        code, _, err = ridlink(*CAMPAIGN, "--resume", "-o", tmp_path)
        assert (code, len(err.splitlines())) == (2, 1) and "campaign.json: is damaged" in err


@pytest.mark.parametrize(
    ("more", "what"),
    [
        ("[wind]\nvelocity_ne_mps = [3.0, 0.0]\n", "wind"),
        ('[[event]]\nat_s = 3.0\nvehicle = 1\nwhat = "gnss-outage"\n', "events"),
        ("silent = true\n", "silent"),
        ("route_ned_m = [[0.0, 50.0, -50.0]]\n", "route_ned_m"),
        ('autopilot = "ardupilot"\ninterval_s = 1.0\n', "interval_s, autopilot"),
    ],
    ids=lambda value: value.split()[0],
)  # fmt: skip
def test_what_only_the_emulator_flies_is_left_out_with_a_word(
    tmp_path: Path, ridlink: Ridlink, more: str, what: str
) -> None:
    """The emulator and campaigns take the same files."""
    path = tmp_path / "meeting.toml"
    path.write_text(FILE.format(down=-50.0) + more)
    code, out, err = ridlink("--scenario", path, "--definition", "snmac", "--only-run", 0)
    assert code == 0 and "vehicle 1: arrived" in out
    assert f"ridlink: a meeting: a campaign leaves out {what}; 'ridlink demo' flies with it\n" in err


def test_a_file_says_who_errs_who_avoids_and_who_tells(tmp_path: Path, ridlink: Ridlink) -> None:
    file = tmp_path / "meeting.toml"
    file.write_text(FILE.format(down=-50.0))
    few = ["--scenario", file, "--definition", "snmac,candidate2", "--gnss", "bias", "--runs", 2, "--jobs", 1]
    code, out, _ = ridlink(*few, "--sigma", 0, "-o", tmp_path / "out", "--json")
    assert code == 0
    snmac, candidate2 = json.loads(out)["rows"]
    assert snmac["scenario"] == "a meeting"
    assert snmac["macs"] == candidate2["macs"] == 0
    # nothing is known of the other's error and size, so that 40 m and 7.5 m stand for them
    assert 12.0 < snmac["min_separation_m"] < 30.0 < 40.0 < candidate2["min_separation_m"]
    file.write_text(FILE.format(down=-60.0))
    code, _, err = ridlink(*few, "-o", tmp_path / "heights")
    assert code == 2
    assert "a meeting: a campaign flies at one height" in err


def test_a_reader_that_closes_its_end_is_no_mistake(tmp_path: Path) -> None:
    few = ["--scenario", "crossing", "--definition", "snmac", "--runs", "1", "--jobs", "1", "-o", str(tmp_path / "c")]
    with subprocess.Popen(
        [sys.executable, "-m", "ridlink", "campaign", "run", *few], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
        _, err = process.communicate(timeout=60)
    assert process.returncode == 0, err


def test_a_report_beside_the_paper(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")
    folder = tmp_path / "copy"
    shutil.copytree(whole, folder)
    done = CliRunner().invoke(cli, ["campaign", "report", str(folder)])
    assert done.exit_code == 0, done.output
    pictures = {f"{name}.{kind}" for name in ("mission-times", "distributions", "collisions", "time-against-safety")
                for kind in ("png", "svg")}  # fmt: skip
    assert {Path(line).name for line in done.stdout.splitlines()} == pictures | {
        "report.json", "report.html", "report.md",
    }  # fmt: skip
    cells = {cell["row"]["definition"]: cell for cell in json.loads((folder / "report.json").read_text())["cells"]}
    assert cells["candidate2"]["ratio"]["verdict"] == "not reproducible"
    assert "3.7 m" in cells["candidate2"]["ratio"]["why"]
    assert cells["candidate1"]["ratio"]["verdict"] == "reproduced"
    beside = cells["candidate1"]["beside_snmac"]
    low, high = beside["median_ci95"]
    assert 0.5 < low <= beside["median_s"] <= high < 3.0
    assert beside["fewer_runs"] > 10 * beside["more_runs"]
    assert beside["p_value"] < 1e-6
    assert "| Candidate 1, rotation | " in (folder / "report.md").read_text()
    page = (folder / "report.html").read_text()
    assert "Against the paper's Candidates" in page
    assert page.count("<img") == page.count('src="data:image/svg+xml;base64,') == 4
    assert "http" not in page and "<script" not in page and "url(" not in page
    assert "0 of 1,600<small>below 0.46%</small>" in page


def test_a_report_draws_what_varies_and_tells_what_losses_cost(tmp_path: Path, ridlink: Ridlink) -> None:
    pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")
    folder = tmp_path / "varied"
    code, _, err = ridlink(
        "--scenario", "head-on,crossing", "--definition", "candidate2,none", "--sigma", "3.5,10", "--loss", "0,0.3",
        "--solver", "rotation", "--runs", 3, "--jobs", 1, "-o", folder,
    )  # fmt: skip
    assert code == 0, err
    assert CliRunner().invoke(cli, ["campaign", "report", str(folder)]).exit_code == 0
    drawn = {file.stem for file in folder.glob("*.svg")}
    assert "time-against-safety-sigma3.5-loss0.3" in drawn
    assert {f"sensitivity-to-{what}" for what in ("sigma-head-on-loss0", "loss-crossing-sigma10")} <= drawn
    document = json.loads((folder / "report.json").read_text())
    lossless = [pair for pair in document["against_lossless"] if pair["cell"]["definition"] == "candidate2"]
    assert {(pair["cell"]["loss"], pair["against"]["loss"]) for pair in lossless} == {(0.3, 0.0)}
    assert len(lossless) == 4
    assert all(set(pair) >= {"time_verdict", "mac_verdict", "macs", "macs_against"} for pair in lossless)
    page = (folder / "report.html").read_text()
    assert "What lost reports cost" in page
    assert "risk, none avoiding = 1" in page
    assert "Collided flights, head-on and crossing together" in page


def test_a_report_needs_a_complete_campaign(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")

    def refusal(folder: Path) -> str:
        return str(CliRunner().invoke(cli, ["campaign", "report", str(folder)]).exception)

    assert "holds no campaign" in refusal(tmp_path)
    folder = tmp_path / "copy"
    shutil.copytree(whole, folder)
    broken, *rest = shards(folder)
    broken.write_bytes(b"")
    assert refusal(folder) == f"{broken}: is damaged; go on with it by its own 'ridlink campaign run ...' and --resume"
    broken.unlink()
    assert refusal(folder).startswith(f"{broken.parent}: has 136 runs instead of 200; go on with it")
    for shard in rest:
        shard.unlink()
    assert ": has 0 runs instead of 200; go on with it" in refusal(folder)
    for name, without in (("rows.json", "it has no list of rows"), ("campaign.json", "seed is not a whole number")):
        for text, told in (
            ("{", "is damaged: Expecting"),
            ("null", "is damaged: no JSON object"),
            ("{}", f"is damaged: {without}"),
        ):
            kept = (folder / name).read_text()
            (folder / name).write_text(text)
            assert told in refusal(folder) and (name in refusal(folder))
            (folder / name).write_text(kept)
    (folder / "rows.json").unlink()
    assert "is not complete; go on with it by its own 'ridlink campaign run ...' and --resume" in refusal(folder)


@pytest.mark.parametrize(
    ("library", "arguments", "told"),
    [
        ("pyarrow", ["run", "-o"], "Parquet needs the extra 'export': pip install 'ridlink[export]'"),
        ("matplotlib", ["report"], "drawing figures needs the extra 'plot': pip install 'ridlink[plot]'"),
    ],
)
def test_without_its_library_one_line_says_how_to_get_it(
    library: str, arguments: list[str], told: str, tmp_path: Path
) -> None:
    code = f"import sys; sys.modules[{library!r}] = None; from ridlink.cli import main; main()"
    command = [sys.executable, "-c", code, "campaign", *arguments, str(tmp_path / "x")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr.splitlines()) == (2, [f"ridlink: {told}"])
    assert not (tmp_path / "x").exists()


def test_every_figure_stands_below_its_own_head_and_whole(tmp_path: Path, ridlink: Ridlink) -> None:
    """Whoever avoids nobody has no risk to be measured by it; its other figures stay where they are."""
    few = ["--preset", "paper", "--scenario", "crossing", "--runs", 12, "--jobs", 1]
    for order in ("none,snmac", "snmac,none"):
        code, out, _ = ridlink(*few, "--definition", order, "-o", tmp_path / order)
        assert code == 0
        lines = out.splitlines()
        heads = next(line for line in lines if line.startswith("scenario"))
        rows = {row["definition"]: row for row in rows_of(tmp_path / order)["rows"]}  # type: ignore[index]
        for definition, row in rows.items():
            line = next(line for line in lines if line.startswith(f"crossing  {definition}"))
            shown = {head: line[: heads.index(head) + len(head)].split()[-1] for head in ("risk", "nearest m")}
            risk = "-" if row["risk_ratio"] is None else f"{row['risk_ratio']:.2g}"
            assert shown == {"risk": risk, "nearest m": f"{row['min_separation_m']:.1f}"}


def test_no_figure_is_cut_off_where_the_table_is_too_wide() -> None:
    from ridlink.cli.campaign_show import _fitting, _needed

    columns = {"scenario": ["square24"], "MACs": ["1840/12,000"], "longest s": ["52.9"], "infeasible %": ["2.2"]}
    assert _fitting(columns, math.inf) == (columns, 2)
    assert list(_fitting(columns, 40)[0]) == ["scenario", "MACs", "longest s"]
    assert list(_fitting(columns, 10)[0]) == ["scenario", "MACs"] and _needed(*_fitting(columns, 10)) == 20


def test_the_name_of_a_scenario_is_shown_as_it_is(tmp_path: Path, ridlink: Ridlink) -> None:
    path = tmp_path / "meeting.toml"
    path.write_text(FILE.format(down=-50.0).replace("a meeting", "a [red] :bug: meeting"))
    _, out, _ = ridlink("--scenario", path, "--definition", "snmac", "--only-run", 0)
    assert sum(line.startswith("a [red] :bug: meeting  snmac ") for line in out.splitlines()) == 1


def altered(shard: Path, name: str, values: list[object]) -> None:
    """A column of a shard by another of that name."""
    table = parquet.read_table(shard)
    column = pyarrow.array(values)
    parquet.write_table(table.set_column(table.schema.get_field_index(name), name, column), shard)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("arrival_s", [[1.0, 2.0, 3.0]] * 3),
        ("arrival_s", [["a", "b"]] * 3),
        ("arrival_s", [[1.0, math.nan]] * 3),
        ("arrival_s", [[-1.0, 2.0]] * 3),
        ("collided", [[True, True]] * 3),
        ("infeasible", [10**6] * 3),
        ("collided", [True, False, True]),
        ("distance_m", [1.0, None, 3.0]),
        ("decisions", [1.5, 2.5, 3.5]),
        ("seed", [1, 1, 2]),
    ],
)
def test_a_shard_that_holds_what_no_shard_holds_is_damaged(
    tmp_path: Path, ridlink: Ridlink, name: str, values: list[object]
) -> None:
    few = ["--scenario", "crossing", "--definition", "snmac", "--runs", 3, "--jobs", 1, "-o", tmp_path / "few"]
    assert ridlink(*few)[0] == 0
    before, (shard,) = rows_of(tmp_path / "few"), shards(tmp_path / "few")
    altered(shard, name, values)
    pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")
    refused = CliRunner().invoke(cli, ["campaign", "report", str(tmp_path / "few")]).exception
    assert str(refused) == f"{shard}: is damaged; go on with it by its own 'ridlink campaign run ...' and --resume"
    assert ridlink(*few, "--resume")[0] == 0
    assert rows_of(tmp_path / "few") == before


def test_a_bit_that_a_disk_has_lost_makes_no_other_outcome(whole: Path, tmp_path: Path) -> None:
    from ridlink.campaign_runner.shards import read_shard
    from ridlink.errors import CaptureError

    written = shards(whole)[0]
    data, outcomes = written.read_bytes(), read_shard(written, 120.0).outcomes
    random, damaged = Random(1), 0
    for _ in range(200):
        bit = random.randrange(8 * len(data))
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        (tmp_path / "flipped").write_bytes(flipped)
        try:
            found = read_shard(tmp_path / "flipped", 120.0).outcomes
        except CaptureError:
            damaged += 1
            continue
        assert all(np.array_equal(getattr(found, name), getattr(outcomes, name)) for name in found.__slots__)
    assert damaged > 100


def test_rows_that_do_not_fit_the_shards_are_no_report(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")
    folder = tmp_path / "copy"
    shutil.copytree(whole, folder)
    rows = rows_of(whole)["rows"]  # type: ignore[index]
    for wrong, told in (
        ([], "lacks cells that were flown"),
        (rows[:-1], "lacks cells that were flown"),
        (
            [{**rows[0], "macs": rows[0]["macs"] - 2}, *rows[1:]],
            "does not fit the shards of circle8_snmac_white-radial_rotation: macs is ",
        ),
    ):
        (folder / "rows.json").write_text(json.dumps({"rows": wrong}))
        refused = str(CliRunner().invoke(cli, ["campaign", "report", str(folder)]).exception)
        assert told in refused and refused.endswith(
            "; go on with it by its own 'ridlink campaign run ...' and --resume"
        )


def test_one_process_at_a_time_flies_a_campaign(tmp_path: Path, ridlink: Ridlink) -> None:
    """Two took away from each other what was half written; whoever holds a folder and is killed lets go of it."""
    few = [*CAMPAIGN, "--jobs", 2, "-o", tmp_path / "folder", "--resume"]
    first = start(*few)
    await_shards(first, tmp_path / "folder", 0)
    os.kill(first.pid, signal.SIGSTOP)
    code, _, err = ridlink(*few)
    assert (code, len(err.splitlines())) == (2, 1) and "folder: another process flies this campaign; wait" in err
    workers = list(workers_of(first))
    first.kill()
    first.communicate(timeout=60)
    assert ridlink(*few)[0] == 0
    await_end(workers)


def test_a_report_on_a_full_disk_leaves_no_half_file(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")
    folder = tmp_path / "copy"
    shutil.copytree(whole, folder)
    command = [sys.executable, "-m", "ridlink", "campaign", "report", str(folder)]

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))

    ended = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit, timeout=60)
    assert ended.returncode == 3
    assert ended.stderr.splitlines()[-1] == f"ridlink: {folder}/time-against-safety.png: File too large"
    assert {file.name for file in folder.iterdir()} == {file.name for file in whole.iterdir()}
