"""``ridlink report`` as its users run it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tty
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ridlink.cli import cli, main
from ridlink.cli.report import report
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import Location
from tests.captures.conftest import tlog_bytes
from tests.cli.program import ridlink
from tests.review.recordings import NORTHBOUND, SOUTHBOUND, recorded, records


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "logs").mkdir()
    return recorded(tmp_path / "logs" / "flight.tlog", [NORTHBOUND, SOUTHBOUND], 26.0)


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(report, [str(argument) for argument in arguments], standalone_mode=False)


@pytest.mark.parametrize(
    "words",
    [
        ["decode", "-f", "jsonl", "-o"],
        ["decode", "-f", "geojson", "-o"],
        ["encode", "--to", "tlog", "-o"],
        ["report", "--no-html", "-o"],
        ["report", "--html"],
        ["whatif", "-o"],
    ],
)
def test_no_command_writes_over_what_it_reads(log: Path, tmp_path: Path, words: list[str]) -> None:
    before = log.read_bytes()
    (tmp_path / "same.tlog").symlink_to(log)
    command, *options = words
    result = CliRunner().invoke(cli, [command, "logs/flight.tlog", *options, "same.tlog"], standalone_mode=False)
    assert "same.tlog is what is read: write to another file" in str(result.exception)
    assert log.read_bytes() == before and (tmp_path / "same.tlog").is_symlink()


def test_who_tells_no_position_was_heard_and_met_nobody(log: Path) -> None:
    name, fields = to_mavlink(Location(timestamp_s=1.0, height_m=2.0))
    log.write_bytes(tlog_bytes([(1_700_000_000_000_000, Encoder(1, 1).encode(name, **fields))]))
    done = run(log, "--no-html")
    assert (done.stdout, done.stderr) == ("", "ridlink: nobody in it tells a position, by Remote ID or by telemetry\n")


def test_lines_on_standard_output_and_a_page_beside(log: Path, tmp_path: Path) -> None:
    done = run(log)
    [row] = [json.loads(line, parse_constant=pytest.fail) for line in done.stdout.splitlines()]
    assert row["uas"] == ["ALPHA", "BRAVO"]
    assert (tmp_path / "flight-report.html").read_text().startswith("<!doctype html>")
    assert "2 aircraft, 1 encounter under candidate2" in done.stderr and "flight-report.html" in done.stderr
    assert done.return_value == 0


def test_files_instead(log: Path, tmp_path: Path) -> None:
    done = run(log, "-o", tmp_path / "e.jsonl", "--html", tmp_path / "p.html", "--definition", "snmac")
    assert done.stdout == "" and done.return_value == 0
    assert json.loads((tmp_path / "e.jsonl").read_text())["definition"] == "snmac"
    assert {path.name for path in tmp_path.iterdir()} == {"logs", "e.jsonl", "p.html"}
    run(log, "--no-html", "-o", tmp_path / "e.jsonl")
    assert {path.name for path in tmp_path.iterdir()} == {"logs", "e.jsonl", "p.html"}


def test_standard_input_is_read(log: Path, tmp_path: Path) -> None:
    with log.open("rb") as stream:
        done = ridlink("report", "-", "--no-html", stdin=stream, cwd=tmp_path)
    assert len(done.stdout.splitlines()) == 1 and done.returncode == 0


def test_what_could_be_read_of_a_broken_file_is_reported(log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    data[5000:5100] = bytes(100)
    log.write_bytes(data[:-7])
    done = run(log, "--no-html")
    assert len(done.stdout.splitlines()) == 1 and "damaged: " in done.stderr and done.return_value == 0
    assert run(log, "--no-html", "--strict").return_value == 4


@pytest.mark.parametrize("command", [["report", "-", "--no-html"], ["whatif", "-"]])
def test_what_was_read_before_the_disk_failed_counts(log: Path, tmp_path: Path, command: list[str]) -> None:
    reading, writing = os.openpty()  # a terminal whose other end is gone answers as a broken disk does
    tty.setraw(writing)
    with ThreadPoolExecutor(1) as pool, open(reading, "rb") as stream:
        pool.submit(write_whole, writing, log.read_bytes())
        done = ridlink(*command, stdin=stream, cwd=tmp_path)
    assert done.returncode == 3 and done.stdout
    assert b"standard input: Input/output error\n" in done.stderr


def write_whole(descriptor: int, data: bytes) -> None:
    with open(descriptor, "wb") as file:
        file.write(data)


def test_other_files_are_done_when_one_is_none(log: Path, tmp_path: Path) -> None:
    (tmp_path / "no.txt").write_text("nothing of the kind\n" * 100)
    done = run(tmp_path / "no.txt", log, tmp_path / "absent.tlog", "--no-html")
    assert len(done.stdout.splitlines()) == 1 and done.return_value == 3
    assert "no.txt is no capture" in done.stderr and "absent.tlog" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "what"),
    [
        (["{text}"], 3, "no.txt is no capture that ridlink reads"),
        (["absent.tlog"], 3, "absent.tlog"),
        (["{raw}"], 3, "has no times"),
        (["{log}", "--definition", "candidate3"], 2, "known are snmac, remote-id"),
        (["{log}", "--html", "nowhere/p.html"], 3, "there is no folder nowhere"),
        (["{log}", "--html", "p.html", "--no-html"], 2, "exclude each other"),
        (["{log}", "-o", "flight.html", "--html", "./flight.html"], 2, "-o and --html name one file"),
        (["-", "-"], 2, "only once"),
        ([], 2, "FILE"),
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
    Path("no.txt").write_text("nothing of the kind\n" * 100)
    Path("f.mavlink").write_bytes(b"".join(frame for _, frame in records([NORTHBOUND], 1.0)))
    names = {"{text}": "no.txt", "{raw}": "f.mavlink", "{log}": str(log)}
    monkeypatch.setattr(sys, "argv", ["ridlink", "report", *(names.get(word, word) for word in arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    out, err = capsys.readouterr()
    assert stop.value.code == code and what in err
    assert len(err.splitlines()) == 1 and out == ""


def test_a_log_without_remote_id_is_an_empty_report(tmp_path: Path) -> None:
    from tests.captures.conftest import flight

    path = tmp_path / "f.tlog"
    path.write_bytes(tlog_bytes(flight(30)[::3]))
    done = run(path, "--no-html")
    assert done.stdout == "" and done.return_value == 0
    assert "nobody in it tells a position, by Remote ID or by telemetry" in done.stderr


@pytest.mark.parametrize("command", [["report", "-o", "rows.jsonl"], ["whatif", "--json"], ["whatif"]])
def test_of_files_that_turn_out_to_be_no_recordings_nothing_is_told(tmp_path: Path, command: list[str]) -> None:
    for name in ("one.tlog", "other.tlog"):  # a suffix that promises much
        (tmp_path / name).write_bytes(b"\x55" * 3000)
    done = subprocess.run(
        [sys.executable, "-m", "ridlink", *command, "one.tlog", "other.tlog"],
        cwd=tmp_path, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": os.getcwd()},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr.splitlines() == [
        f"ridlink: {name} has no MAVLink frame (tlog)" for name in ("one.tlog", "other.tlog")
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.tlog", "other.tlog"]
