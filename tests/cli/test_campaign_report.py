"""``ridlink campaign report``: whatever its files hold, a report that is true or one line that names what is wrong."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from ridlink.cli import main
from tests.cli.conftest import Ridlink

pytest.importorskip("pyarrow", reason="shards need the extra 'export'")
pytest.importorskip("matplotlib", reason="the report needs the extra 'plot'")

RUNS = 7
CELL = "crossing_candidate2_white_rotation"


@pytest.fixture
def ridlink(ridlink: Ridlink) -> Ridlink:
    """``ridlink campaign`` in this process."""
    return partial(ridlink, "campaign")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign") / "flown"
    few = ["--scenario", "crossing", "--gnss", "white", "--solver", "rotation", "--runs", str(RUNS), "--jobs", "1"]
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as end:
        patch.setattr(
            sys, "argv", ["ridlink", "campaign", "run", *few, "--definition", "none,candidate2", "-o", str(folder)]
        )
        main()
    assert not end.value.code
    return folder


@pytest.fixture
def folder(flown: Path, tmp_path: Path) -> Path:
    """A copy of its own."""
    return Path(shutil.copytree(flown, tmp_path / "copy"))


def changed(file: Path, change: Callable[[Any], object]) -> None:
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(document))


def row(change: Callable[[Any], object]) -> Callable[[Any], object]:
    """A change of the second row, that of `CELL`."""
    return lambda document: change(document["rows"][1])


TAMPERED_ROWS = {
    "no key": (row(lambda row: row.pop("median_ci95")), f"the shards of {CELL}: it lacks median_ci95"),
    "no key of its cell": (row(lambda row: row.pop("loss")), "row 2 lacks loss"),
    "a key too many": (row(lambda row: row.update(more=1)), f"{CELL}: it has more"),
    "text for a number": (row(lambda row: row.update(mac_rate="x")), 'mac_rate is "x" and by them 0.0'),
    "text for an interval": (row(lambda row: row.update(mac_rate_pairs_ci95=["a", "b"])), 'ci95 is ["a", "b"] and by'),
    "half an interval": (row(lambda row: row["mac_rate_pairs_ci95"].pop()), "mac_rate_pairs_ci95 is [0.0] and by them"),
    "null": (row(lambda row: row.update(flights=None)), f"flights is null and by them {2 * RUNS}"),
    "a number of another kind": (row(lambda row: row.update(macs=False)), "macs is false and by them 0"),
    "below zero": (row(lambda row: row.update(unfinished=-3)), "unfinished is -3 and by them 0"),
    "another figure": (row(lambda row: row.update(median_s=1.5)), "median_s is 1.5 and by them 4"),
    "another interval": (row(lambda row: row.update(risk_ratio_ci95=[0.0, 0.5])), "risk_ratio_ci95 is [0.0, 0.5] and"),
    "no number": (row(lambda row: row.update(max_time_s=float("nan"))), "is damaged: NaN is not a finite number"),
    "no cell": (row(lambda row: row.update(definition="candidate9")), 'row 2 has an unknown definition, "candidate9"'),
    "no name": (row(lambda row: row.update(scenario=["crossing"])), 'row 2 has an unknown scenario, ["crossing"]'),
    "another folder": (row(lambda row: row.update(solver="../..")), 'row 2 has an unknown solver, "../.."'),
    "text for sigma": (row(lambda row: row.update(sigma_m="10")), 'row 2 has an unknown sigma_m, "10"'),
    "another cell": (row(lambda row: row.update(loss=0.3)), f"{CELL}_loss0.3: has 0 runs instead of {RUNS}"),
    "no row": (lambda document: document["rows"].append(5), "row 3 is no object"),
    "a row twice": (lambda document: document["rows"].append(document["rows"][1]), "row 3 is there twice"),
    "no list": (lambda document: document.update(rows={}), "it has no list of rows"),
}


@pytest.mark.parametrize("name", TAMPERED_ROWS)
def test_rows_that_were_tampered_with_are_no_report(folder: Path, ridlink: Ridlink, name: str) -> None:
    change, told = TAMPERED_ROWS[name]
    changed(folder / "rows.json", change)
    code, out, err = ridlink("report", folder)
    assert (code, out, len(err.splitlines())) == (3, "", 1), err
    assert told in err
    assert str(folder / ("shards" if name == "another cell" else "rows.json")) in err
    assert err.endswith("go on with it by its own 'ridlink campaign run ...' and --resume\n") or name == "no number"
    assert not (folder / "report.json").exists()


TAMPERED_CONFIGURATION = {
    "no seed": (lambda found: found.pop("seed"), "seed is not a whole number"),
    "text for a seed": (lambda found: found.update(seed="1"), "seed is not a whole number from 0 up"),
    "true for a seed": (lambda found: found.update(seed=True), "seed is not a whole number from 0 up"),
    "runs below zero": (lambda found: found.update(runs=-1), "runs is not a whole number from 0 up"),
    "a figure for figures": (lambda found: found.update(sigma_m=10.0), "sigma_m is not a list of figures"),
    "no scenes": (lambda found: found.update(scenario=[]), "scenario is not an object"),
    "no scene": (lambda found: found["scenario"].update(crossing=3), "duration_s of crossing is not a time above 0"),
    "no end": (lambda found: found["scenario"]["crossing"].update(duration_s=0), "crossing is not a time above 0"),
    "not finite": (lambda found: found.update(range_m=float("inf")), "Infinity is not a finite number"),
}  # fmt: skip


@pytest.mark.parametrize("name", TAMPERED_CONFIGURATION)
def test_a_configuration_that_was_tampered_with_is_no_report(folder: Path, ridlink: Ridlink, name: str) -> None:
    change, told = TAMPERED_CONFIGURATION[name]
    changed(folder / "campaign.json", change)
    code, out, err = ridlink("report", folder)
    assert (code, out, len(err.splitlines())) == (3, "", 1), err
    assert f"{folder}/campaign.json: is damaged: " in err and told in err


def test_a_shard_that_is_no_part_of_it_is_named(folder: Path, ridlink: Ridlink) -> None:
    """A copy beside the original was counted, and going on did not help against it."""
    shard = folder / "shards" / CELL / "runs-000000.parquet"
    copy = shutil.copy(shard, shard.with_name("runs-000000 (copy).parquet"))
    code, _, err = ridlink("report", folder)
    assert (code, err) == (3, f"ridlink: {copy}: holds other runs than its name says; take it away\n")


MEETING = """\
name = {name}
duration_s = 60.0
[[vehicle]]
start_ned_m = [-100.0, 0.0, -50.0]
goal_ned_m = [100.0, 0.0, -50.0]
[[vehicle]]
start_ned_m = [0.0, 100.0, -50.0]
goal_ned_m = [0.0, -100.0, -50.0]
"""

NAMES = (r"half $\frac{a$ | b", "../../" + "\u98db" * 60)
"""What a formula would begin with, what ends a cell of a table, other folders, and longer than a file's name may be."""


@pytest.mark.programs
def test_a_scene_may_be_called_anything(tmp_path: Path, ridlink: Ridlink) -> None:
    files = [tmp_path / f"{k}.toml" for k in range(len(NAMES))]
    for file, name in zip(files, NAMES, strict=True):
        file.write_text(MEETING.format(name=json.dumps(name, ensure_ascii=False)))
    folder = tmp_path / "folder" / "within"
    code, _, err = ridlink(
        "run", "--scenario", ",".join(map(str, files)), "--definition", "candidate2", "--solver", "rotation",
        "--loss", "0,0.3", "--runs", 2, "--jobs", 1, "-o", folder,
    )  # fmt: skip
    assert code == 0, err
    code, out, err = ridlink("report", folder)
    assert code == 0, err
    drawn = {Path(line) for line in out.splitlines()}
    assert drawn == {file for file in folder.iterdir() if file.name not in ("campaign.json", "rows.json", "shards")}
    assert sum(file.name.startswith("sensitivity-to-loss-") for file in drawn) == 2 * len(NAMES)
    assert {file.name for file in tmp_path.iterdir()} == {"0.toml", "1.toml", "folder"}
    lines = (folder / "report.md").read_text().split("\n\n")[1].splitlines()
    assert len({line.replace("\\|", "").count("|") for line in lines}) == 1


@pytest.mark.programs
def test_two_reports_at_a_time_are_both_written(folder: Path) -> None:
    """They wrote under one name, and one of them took it away from the other."""
    command = [sys.executable, "-m", "ridlink", "campaign", "report", str(folder)]
    reports = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    ends = [report.communicate(timeout=120) for report in reports]
    assert [report.returncode for report in reports] == [0, 0], ends
    assert ends[0] == ends[1]
    assert not list(folder.rglob("*.unfinished"))


def test_a_shard_flown_under_other_conditions_is_no_part_of_it(tmp_path: Path, ridlink: Ridlink) -> None:
    """Names and seed are the same: it was taken for the campaign's own."""
    few = ["--scenario", "crossing", "--definition", "chance", "--solver", "rotation", "--runs", 2, "--jobs", 1]
    ours, theirs = (tmp_path / eta for eta in ("0.999", "0.9"))
    for folder in (ours, theirs):
        assert ridlink("run", *few, "--eta", folder.name, "-o", folder)[0] == 0
    (shard,) = ours.rglob("*.parquet")
    shutil.copy(theirs / shard.relative_to(ours), shard)
    told = f"ridlink: {shard}: is of another campaign, whose conditions differ"
    code, _, err = ridlink("report", ours)
    assert (code, err) == (3, f"{told}, or {ours}/campaign.json was changed\n")
    code, _, err = ridlink("run", *few, "--eta", "0.999", "--resume", "-o", ours)
    assert (code, err) == (2, f"{told}; take it away or name a new folder\n")


def test_a_configuration_with_other_conditions_is_no_report(folder: Path, ridlink: Ridlink) -> None:
    changed(folder / "campaign.json", lambda found: found.update(range_m=500.0))
    code, out, err = ridlink("report", folder)
    assert (code, out, len(err.splitlines())) == (3, "", 1)
    assert f"or {folder}/campaign.json was changed" in err
