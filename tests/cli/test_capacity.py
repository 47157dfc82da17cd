"""``ridlink capacity``: its rows, and what is refused in one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from click.testing import CliRunner

from ridlink.cli import cli, main
from ridlink.separation import Definition


def test_rows_hold_formula_and_simulation_side_by_side() -> None:
    few = ["capacity", "--definition", "candidate2,chance", "--sigma", "3.5,10", "--worlds", "20"]
    done = CliRunner().invoke(cli, [*few, "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    rows = document["rows"]
    assert [(row["definition"], row["sigma_m"]) for row in rows] == [
        ("candidate2", 3.5), ("chance", 3.5), ("candidate2", 10.0), ("chance", 10.0),
    ]  # fmt: skip
    for row in rows:
        low, high = row["simulated_ci95"]
        assert low <= row["simulated_per_flight_hour"] <= high
        assert row["conflicts_per_km2_hour"] == pytest.approx(row["conflicts_per_flight_hour"] / 2.0)
        assert row["capacity_per_km2"] == pytest.approx(1.0 / row["conflicts_per_flight_hour"])
    assert rows[2]["radius_m"] == pytest.approx(3.8 + 60.0 + 0.2 * 15.6, abs=0.2)
    assert CliRunner().invoke(cli, [*few, "--json"]).stdout == done.stdout
    table = CliRunner().invoke(cli, few).stdout.splitlines()
    assert len(table) == 2 + len(rows)
    assert table[0].startswith("1 drone per km2 ") and table[0].endswith("capacity: 1 conflict/h each")
    assert "capacity/km2" in table[1]


def test_of_few_worlds_there_is_no_interval_and_the_output_says_why() -> None:
    few = ["capacity", "--definition", "candidate2", "--worlds", "2"]
    document = json.loads(CliRunner().invoke(cli, [*few, "--json"]).stdout)
    why = "of fewer than 6 worlds no interval says how far a simulated figure can be trusted"
    assert (document["rows"][0]["simulated_ci95"], document["note"]) == (None, why)
    _, heads, row, note = CliRunner().invoke(cli, few).stdout.splitlines()
    assert note == why
    shown = row[: heads.index("(95 %)") + len("(95 %)")].split()[-1]
    assert shown == f"{document['rows'][0]['simulated_per_flight_hour']:.3g}"
    assert json.loads(CliRunner().invoke(cli, [*few[:-1], "6", "--json"]).stdout)["note"] is None


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--category", "5"], "'5' is not known; known are 1, 2, 3, 4"),
        (["--definition", "none"], "'none' is not known"),
        (["--density", "0"], "0.0 is not in the range"),
        (["--density", "nan"], "'nan' is not"),
        (["--density", "1e-320"], "1e-320 is not in the range"),
        (["--sigma", "-1"], "-1.0 is not in the range"),
        (["--interval", "0"], "0.0 is not in the range"),
        (["--definition", "remote-id", "--density", "500"], "a square kilometre has no room for 500 vehicles 90.6 m"),
        (["--worlds", "1"], "1 is not in the range"),
    ],
)
def test_what_cannot_be_is_one_line(
    arguments: list[str], text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["ridlink", "capacity", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capsys.readouterr()
    assert (end.value.code, out) == (2, "")
    assert text in err
    assert len(err.splitlines()) == 1


def test_a_terminal_is_told_how_far_long_work_is_and_the_table_stays_clean() -> None:
    reading, writing = os.openpty()
    os.set_blocking(reading, False)
    with open(reading, "rb", buffering=0) as terminal, open(writing, "wb", buffering=0) as stderr:
        done = subprocess.run(
            [sys.executable, "-m", "ridlink", "capacity", "--sigma", "3.5,10", "--worlds", "6"],
            stdout=subprocess.PIPE, stderr=stderr, env=os.environ | {"TERM": "xterm"}, check=True,
        )  # fmt: skip
        assert b"simulating" in (terminal.read(4096) or b"")
    assert b"simulating" not in done.stdout and b"\x1b" not in done.stdout
    assert len(done.stdout.splitlines()) == 2 + 2 * len(Definition)
