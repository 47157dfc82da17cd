"""``ridlink record`` on loopback: everything that comes is in the log when it stops, however it stops."""

from __future__ import annotations

import json
import re
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from ridlink.captures import Record, Rejects, open_capture
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from tests.captures.conftest import flight


@contextmanager
def recording(*arguments: str | Path, **options: Any) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A running ``ridlink record`` that is ready, and the line with which it said so."""
    command = [sys.executable, "-m", "ridlink", "record", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options) as process:
        assert process.stderr is not None
        try:
            yield process, process.stderr.readline()
        finally:
            process.kill()


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ridlink", "record", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=30)


def port_of(line: str) -> int:
    found = re.search(r"udpin:127\.0\.0\.1:(\d+) into", line)
    assert found, line
    return int(found[1])


def read(path: Path) -> tuple[list[Record], Rejects]:
    with open_capture(path) as capture:
        return list(capture), capture.rejects


def until(condition: Callable[[], bool], sock: socket.socket) -> None:
    """Wait until a condition holds, asking every 20 ms; the socket is the clock."""
    sock.settimeout(0.02)
    for _ in range(500):
        if condition():
            return
        try:
            sock.recv(1)
        except TimeoutError:
            continue
    pytest.fail("did not happen within ten seconds")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_everything_received_is_in_the_log_when_a_signal_stops_it(tmp_path: Path, number: signal.Signals) -> None:
    path = tmp_path / "flight.tlog"
    frames = [frame for _, frame in flight(50)]
    with (
        recording("udpin:127.0.0.1:0", "-o", path, "--json") as (process, line),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sender.connect(("127.0.0.1", port_of(line)))
        sender.send(b"".join(frames[:10]))
        for frame in frames[10:]:
            sender.send(frame)
        sender.send(b"not mavlink")
        until(lambda: path.stat().st_size == sum(8 + len(frame) for frame in frames), sender)
        process.send_signal(number)
        out, err = process.communicate(timeout=10)
    assert process.returncode == 0 and err == ""
    records, rejects = read(path)
    assert [record.frame.raw for record in records] == frames and not rejects
    times = [record.time_us for record in records]
    assert times == sorted(times, key=lambda time_us: time_us or 0)
    summary = json.loads(out.splitlines()[-1])
    assert summary["path"] == str(path) and summary["messages"] == 50
    assert summary["bytes"] == path.stat().st_size
    assert summary["types"]["HEARTBEAT"] == 17 and summary["sources"] == {"1/1": 50}
    assert summary["rejects"] == {"garbage": 1}


def test_udpout_subscribes_by_heartbeat_and_a_duration_ends_it(tmp_path: Path) -> None:
    path = tmp_path / "air.tlog"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as air:
        air.bind(("127.0.0.1", 0))
        air.settimeout(10)
        url = f"udpout:127.0.0.1:{air.getsockname()[1]}"
        with recording(url, "-o", path, "--duration", "0.5") as (process, line):
            assert line == f"ridlink: recording {url} into {path}; Ctrl-C stops\n"
            data, subscriber = air.recvfrom(2048)
            air.sendto(flight(1)[0][1], subscriber)
            out, _ = process.communicate(timeout=10)
    (frame,) = parse_datagram(data, CRC_EXTRAS)
    assert isinstance(frame, Frame) and (frame.sysid, decode_message(frame).type) == (255, 6)
    assert process.returncode == 0
    assert out.splitlines()[-1].startswith(f"{path}: 1 message of 1 type from 1 source, 29 bytes, 0.5 s")
    assert len(read(path)[0]) == 1


def test_silent_says_nothing_and_silence_is_hinted_at(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as air:
        air.bind(("127.0.0.1", 0))
        url = f"udpout:127.0.0.1:{air.getsockname()[1]}"
        done = run(url, "-o", tmp_path / "air.tlog", "--duration", "0.2", "--silent")
        air.setblocking(False)
        with pytest.raises(BlockingIOError):
            air.recv(2048)
    assert done.returncode == 0 and "nothing was received" in done.stderr


def test_an_existing_log_is_kept_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"precious")
    done = run("udpin:127.0.0.1:0", "-o", path, "--duration", "0.1")
    assert done.returncode == 3 and "--force" in done.stderr and len(done.stderr.splitlines()) == 1
    assert path.read_bytes() == b"precious"
    assert run("udpin:127.0.0.1:0", "-o", path, "--duration", "0.1", "--force").returncode == 0
    assert path.read_bytes() == b""


def test_an_empty_log_is_nothing_to_keep(tmp_path: Path) -> None:
    """As one that heard nothing leaves it; a link to what is not there, and a folder, are none."""
    path, link = tmp_path / "flight.tlog", tmp_path / "link.tlog"
    link.symlink_to(tmp_path / "nowhere")
    for _ in range(2):
        assert run("udpin:127.0.0.1:0", "-o", path, "--duration", "0.1").returncode == 0
        assert path.read_bytes() == b""
    for other in (link, tmp_path):
        assert run("udpin:127.0.0.1:0", "-o", other, "--duration", "0.1").returncode == 3


def test_a_port_in_use_costs_neither_the_old_log_nor_leaves_a_new_one(tmp_path: Path) -> None:
    old, new = tmp_path / "old.tlog", tmp_path / "new.tlog"
    old.write_bytes(b"precious")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        url = f"udpin:127.0.0.1:{other.getsockname()[1]}"
        assert run(url, "-o", old, "--force").returncode == 3
        assert run(url, "-o", new).returncode == 3
    assert old.read_bytes() == b"precious" and not new.exists()


@pytest.mark.parametrize(
    "arguments", [("udp:127.0.0.1:14550", "-o", "x.tlog"), ("udpin:127.0.0.1:0",), ("udpin:127.0.0.1:0", "-o", "x",
                                                                                    "--duration", "nan")]
)  # fmt: skip
def test_usage_errors_are_one_line(arguments: tuple[str, ...]) -> None:
    done = run(*arguments)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and done.stdout == ""


def test_a_folder_that_does_not_exist_is_exit_code_3(tmp_path: Path) -> None:
    done = run("udpin:127.0.0.1:0", "-o", tmp_path / "nowhere" / "f.tlog")
    assert done.returncode == 3 and len(done.stderr.splitlines()) == 1


def test_a_full_disk_ends_it_with_one_line_and_a_readable_log(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    frames = [frame for _, frame in flight(400)]
    limit = 4_000
    with (
        recording(
            "udpin:127.0.0.1:0", "-o", path,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        ) as (process, line),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):  # fmt: skip
        sender.connect(("127.0.0.1", port_of(line)))
        for frame in frames:
            try:
                sender.send(frame)
            except ConnectionRefusedError:  # it has stopped already
                break
        out, err = process.communicate(timeout=10)
    assert process.returncode == 3
    assert err == f"ridlink: {path}: File too large\n"
    assert out.startswith(f"{path}: ")
    records, rejects = read(path)
    assert [record.frame.raw for record in records] == frames[: len(records)] and not rejects
    assert limit - 100 < path.stat().st_size <= limit
