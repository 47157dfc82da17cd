"""Every command of docs/captures.md runs and prints what stands there, and no column of it is left out."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from ridlink.captures.export import geo
from ridlink.captures.export.join import COLUMNS
from ridlink.cli import cli
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.messages import Location, System
from tests.captures.conftest import aircraft, frame_of, tlog_bytes

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "captures.md").read_text()


def commands() -> list[tuple[list[str], list[str]]]:
    """Commands of the page, each with the lines that stand below it in its block."""
    found: list[tuple[list[str], list[str]]] = []
    in_block = False
    for line in TEXT.splitlines():
        if line.startswith("    ridlink "):
            found.append((shlex.split(line, comments=True)[1:], []))
            in_block = True
        elif line.startswith("    ") and in_block:
            found[-1][1].append(line[4:])
        elif line:
            in_block = False
    return found


def test_every_command_of_the_page_runs_and_prints_what_stands_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow", reason="needs ridlink[export]")
    monkeypatch.chdir(tmp_path)
    Path("flight.tlog").write_bytes(tlog_bytes(aircraft(3)))
    assert len(commands()) >= 10
    for arguments, shown in commands():
        done = CliRunner().invoke(cli, arguments, catch_exceptions=False)
        assert done.exit_code == 0, (arguments, done.output)
        printed = [line for line in done.stdout.splitlines() if line]
        for said, meant in zip(printed, shown, strict=False):
            if meant == "...":
                break
            beginning = meant.removesuffix(" ...")
            assert said.startswith(beginning) and (beginning != meant or said == meant), arguments
        assert len(printed) >= len(shown), arguments
    assert Path("again.tlog").read_bytes() == Path("flight.tlog").read_bytes()


def test_the_page_names_every_column_and_property() -> None:
    named = set(re.findall(r"`([a-z0-9_]+)`", TEXT))
    assert set(COLUMNS) <= named
    assert {*geo._POINT_PROPERTIES, "track", "time", "t", "positions", "first_time", "last_time"} <= named


def test_the_time_of_a_joined_system_message_counts_from_the_year_that_the_page_says(tmp_path: Path) -> None:
    encoder, new_year_2019_us = Encoder(1, 1), 1_546_300_800_000_000
    sent = [System(timestamp_s=5.0), Location(latitude_deg=47.0, longitude_deg=8.0, timestamp_s=5.0)]
    log = tmp_path / "flight.tlog"
    log.write_bytes(tlog_bytes([(new_year_2019_us + 5_000_000, frame_of(message, encoder)) for message in sent]))
    row = json.loads(CliRunner().invoke(cli, ["decode", str(log), "--join", "-f", "jsonl"]).stdout)
    says = re.search(r"`system_timestamp_s`: seconds since (\d+)", TEXT)
    assert says and says[1] == "2019" and row["system_timestamp_s"] == 5.0
