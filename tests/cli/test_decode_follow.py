"""``ridlink decode --follow`` on files that grow, are cut back and are replaced."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.captures.conftest import flight, raw_bytes, tlog_bytes

RECORDS = flight(12)
Follow = Callable[..., "Following"]


class Following:
    """The program, following a file."""

    def __init__(self, path: Path, *arguments: str) -> None:
        command = [sys.executable, "-m", "ridlink", "decode", str(path), "--follow", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert self.process.stdout is not None and self.process.stderr is not None
        self.stdout, self.stderr = self.process.stdout, self.process.stderr

    def sequence_numbers(self, count: int) -> list[int]:
        """Of so many messages, which are waited for."""
        return [json.loads(self.stdout.readline())["seq"] for _ in range(count)]

    def ends(self, number: int = signal.SIGINT) -> tuple[int, bytes, bytes]:
        """Exit code after a signal, and what was still written."""
        self.process.send_signal(number)
        output, errors = self.process.communicate(timeout=20)
        return self.process.returncode, output, errors


@pytest.fixture
def follow() -> Iterator[Follow]:
    started: list[Following] = []

    def start(path: Path, *arguments: str) -> Following:
        started.append(Following(path, *arguments))
        return started[-1]

    yield start
    for following in started:
        following.process.kill()
        following.process.communicate()


def append(path: Path, data: bytes) -> None:
    with open(path, "ab") as stream:
        stream.write(data)


def hex_bytes(records: list[tuple[int, bytes]]) -> bytes:
    return b"".join(frame.hex().encode() + b"\n" for _, frame in records)


@pytest.mark.parametrize(
    ("name", "encoded"), [("a.tlog", tlog_bytes), ("a.bin", tlog_bytes), ("a.raw", raw_bytes), ("a.hex", hex_bytes)]
)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_is_appended_follows_what_was_there(
    tmp_path: Path, follow: Follow, name: str, encoded: Callable[[Any], bytes], number: int
) -> None:
    path = tmp_path / name
    path.write_bytes(encoded(RECORDS[:5]))
    following = follow(path, "-f", "jsonl")
    assert following.sequence_numbers(5) == [0, 1, 2, 3, 4]
    cut = encoded(RECORDS[5:7])
    append(path, cut[:-7])
    assert following.sequence_numbers(1) == [5]
    append(path, cut[-7:])
    assert following.sequence_numbers(1) == [6]
    append(path, encoded(RECORDS[7:8])[:-7])  # never completed: waited for to the end, and no damage
    assert following.ends(number) == (0, b"", b"")


def test_a_table_is_followed_too(tmp_path: Path, follow: Follow) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(tlog_bytes(RECORDS[:1]))
    following = follow(path)
    assert b"HEARTBEAT" in following.stdout.readline()
    append(path, tlog_bytes(RECORDS[1:2]))
    assert b"OPEN_DRONE_ID_LOCATION" in following.stdout.readline()
    assert following.ends() == (0, b"", b"")


def test_a_file_that_is_cut_back_is_read_from_its_beginning(tmp_path: Path, follow: Follow) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(tlog_bytes(RECORDS[:5]))
    following = follow(path, "-f", "jsonl")
    following.sequence_numbers(5)
    os.truncate(path, 0)
    assert following.stderr.readline() == f"ridlink: {path} was cut back; reading from its beginning\n".encode()
    append(path, tlog_bytes(RECORDS[6:8]))
    assert following.sequence_numbers(2) == [6, 7]
    assert following.ends() == (0, b"", b"")


def test_a_file_that_is_rotated_is_read_to_its_end_and_then_its_successor(tmp_path: Path, follow: Follow) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(tlog_bytes(RECORDS[:5]))
    following = follow(path, "-f", "jsonl")
    following.sequence_numbers(5)
    path.rename(tmp_path / "a.tlog.1")
    append(tmp_path / "a.tlog.1", tlog_bytes(RECORDS[5:6]))
    assert following.sequence_numbers(1) == [5]
    path.write_bytes(tlog_bytes(RECORDS[6:8]))
    assert following.sequence_numbers(2) == [6, 7]
    assert following.stderr.readline() == f"ridlink: {path} was replaced; reading from its beginning\n".encode()
    assert following.ends() == (0, b"", b"")


@pytest.mark.parametrize("content", [b"", tlog_bytes(RECORDS[:1])[:-5]])
def test_a_file_without_a_record_yet_is_waited_for(tmp_path: Path, follow: Follow, content: bytes) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(content)
    following = follow(path, "-f", "jsonl")
    append(path, tlog_bytes(RECORDS[:5])[len(content) :])
    assert following.sequence_numbers(5) == [0, 1, 2, 3, 4]
    assert following.ends() == (0, b"", b"")


@pytest.mark.parametrize(
    "arguments",
    [("-f", "geojson"), ("--stats",), ("--join", "-f", "jsonl"), ("--in", "pcap"), ("-o", "out"), ("other",)],
)
def test_what_cannot_be_followed_is_a_usage_error(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(tlog_bytes(RECORDS))
    command = [sys.executable, "-m", "ridlink", "decode", str(path), "--follow", *arguments]
    done = subprocess.run(command, capture_output=True, timeout=60, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"--follow" in done.stderr and len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("content", [b"\xd4\xc3\xb2\xa1" + bytes(2000), b"text\n" * 1000])
def test_what_is_no_capture_to_follow_is_one_line_and_exit_code_3(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "file.bin"
    path.write_bytes(content)
    command = [sys.executable, "-m", "ridlink", "decode", str(path), "--follow"]
    done = subprocess.run(command, capture_output=True, timeout=60)
    assert (done.returncode, done.stdout) == (3, b"")
    assert str(path).encode() in done.stderr and len(done.stderr.splitlines()) == 1
