"""``ridlink whatif`` as its users run it."""

from __future__ import annotations

import csv
import io
import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ridlink.cli import main
from ridlink.cli.whatif import whatif
from ridlink.separation.definitions import Definition
from tests.review.recordings import NORTHBOUND, SOUTHBOUND, recorded


@pytest.fixture
def log(tmp_path: Path) -> Path:
    hostile = replace(NORTHBOUND, identity=b"=cmd|'\x1b[2J'!A1")
    return recorded(tmp_path / "f.tlog", [hostile, SOUTHBOUND], 26.0)


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(whatif, [str(argument) for argument in arguments], standalone_mode=False)


def test_a_table_with_a_line_for_each_definition(log: Path) -> None:
    done = run(log)
    heads, *lines, last = done.stdout.splitlines()
    assert heads.split()[:2] == ["definition", "alerts"] and [line.split()[0] for line in lines] == list(Definition)
    assert last == "2 aircraft, 25.9 s; entries alerted 8 s ahead"
    assert "\x1b" not in done.stdout and "=cmd|'\\x1b[2J'!A1 BRAVO" in done.stdout
    assert done.return_value == 0


def test_definitions_come_in_the_order_asked_for_and_each_once(log: Path) -> None:
    document = json.loads(run(log, "--definition", "snmac, chance,snmac", "--ahead", "0", "--json").stdout)
    assert [row["definition"] for row in document["rows"]] == ["snmac", "chance"]
    assert document["ahead_s"] == 0.0 and document["aircraft"] == 2


def test_csv_holds_no_formula(log: Path, tmp_path: Path) -> None:
    done = run(log, "--csv", "-o", tmp_path / "w.csv")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "w.csv").read_text())))
    assert done.stdout == "" and len(rows) == len(Definition)
    assert all(row["least_margin_uas"].startswith("'=cmd") for row in rows)
    assert not any(cell.startswith(("=", "+", "@")) for row in rows for cell in row.values())


@pytest.mark.parametrize(
    ("arguments", "code", "what"),
    [
        (
            ["--definition", "snmac,candidate3"],
            2,
            "unknown definition 'candidate3': did you mean 'candidate2'? known are snmac, remote-id, odid-accuracy",
        ),
        (["--definition", ""], 2, "unknown definition '': known are"),
        (["--ahead", "-1"], 2, "0 or more"),
        (["--eta", "1"], 2, "eta must lie between 0.5 and 0.999999999, got 1"),
        (["--json", "--csv"], 2, "exclude each other"),
        (["-o", "nowhere/w.csv"], 3, "nowhere/w.csv"),
        (["-o", "."], 3, ".: Is a directory"),
    ],
)
def test_errors_are_one_line(
    log: Path,
    arguments: list[str],
    code: int,
    what: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """All of them before an hour of reading."""
    monkeypatch.setattr("ridlink.cli.whatif.walk_through", None)
    monkeypatch.setattr(sys, "argv", ["ridlink", "whatif", str(log), *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    out, err = capsys.readouterr()
    assert stop.value.code == code and what in err
    assert len(err.splitlines()) == 1 and out == ""
