"""``ridlink replay`` on loopback: every frame arrives, when it is due, until the end or a signal."""

from __future__ import annotations

import re
import shlex
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ridlink.mavlink.codec import Encoder
from tests.captures.conftest import START_US, flight, tlog_bytes
from tests.loopback import PATIENCE_S, free_port

Arrivals = list[tuple[float, bytes]]
SO_TIMESTAMPNS = 35
"""Of Linux; the module has no name for it."""


@contextmanager
def replaying(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "ridlink", "replay", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def ground() -> Iterator[tuple[socket.socket, str]]:
    """A bound socket, and the link that leads to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(PATIENCE_S)
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        yield sock, f"udpout:127.0.0.1:{sock.getsockname()[1]}"


def receive(sock: socket.socket, count: int) -> Arrivals:
    """Datagrams with the time at which the kernel took them: this process may be late itself."""
    arrivals: Arrivals = []
    while len(arrivals) < count:
        data, ((_, _, stamp),), *_ = sock.recvmsg(2048, socket.CMSG_SPACE(16))
        seconds, nanoseconds = struct.unpack("@qq", stamp)
        arrivals.append((seconds + 1e-9 * nanoseconds, data))
    return arrivals


def spaced(tmp_path: Path, times_s: list[float]) -> tuple[Path, list[bytes]]:
    """A log with heartbeats at these times."""
    encoder = Encoder(1, 1)
    frames = [encoder.encode("HEARTBEAT", custom_mode=index) for index in range(len(times_s))]
    path = tmp_path / "f.tlog"
    path.write_bytes(
        tlog_bytes([(START_US + round(at_s * 1e6), frame) for at_s, frame in zip(times_s, frames, strict=True)])
    )
    return path, frames


def test_frames_come_whole_in_order_and_when_they_are_due(tmp_path: Path) -> None:
    path, frames = spaced(tmp_path, [0.0, 0.01, 0.5, 0.51, 1.0])
    with ground() as (sock, url), replaying(path, "--out", url, "--speed", "2") as process:
        arrivals = receive(sock, 5)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert [data for _, data in arrivals] == frames
    since = [at_s - arrivals[0][0] for at_s, _ in arrivals]
    # never early; how late depends on the machine
    assert all(arrived > due / 2 - 0.02 for arrived, due in zip(since, [0.0, 0.01, 0.5, 0.51, 1.0], strict=True))
    assert process.returncode == 0 and err == ""
    assert re.fullmatch(rf"{url}: 5 messages in \d\.\d s\n", out)


def test_only_the_messages_asked_for_are_sent(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    path.write_bytes(tlog_bytes(flight(9)))
    with (
        ground() as (sock, url),
        replaying(path, "--out", url, "--types", "OPEN_DRONE_ID_*", "--speed", "9") as process,
    ):
        out, err = process.communicate(timeout=PATIENCE_S)
        arrivals = receive(sock, 3)
    assert [data for _, data in arrivals] == [frame for _, frame in flight(9)[1::3]]
    assert process.returncode == 0 and err == "" and ": 3 messages in" in out


def test_a_raw_stream_has_a_rate(tmp_path: Path) -> None:
    path = tmp_path / "f.mavlink"
    path.write_bytes(b"".join(frame for _, frame in flight(11)))
    with ground() as (sock, url), replaying(path, "--out", url, "--rate", "40") as process:
        arrivals = receive(sock, 11)
        assert process.wait(timeout=PATIENCE_S) == 0
    assert [data for _, data in arrivals] == [frame for _, frame in flight(11)]
    assert arrivals[-1][0] - arrivals[0][0] > 10 / 40 - 0.02


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_loop_begins_again_until_a_signal_stops_it(tmp_path: Path, number: signal.Signals) -> None:
    path, frames = spaced(tmp_path, [0.0, 0.02])
    with ground() as (sock, url), replaying(path, "--out", url, "--loop") as process:
        arrivals = receive(sock, 7)
        process.send_signal(number)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert [data for _, data in arrivals] == [frames[index % 2] for index in range(7)]
    assert process.returncode == 0 and err == "" and "messages in" in out


def test_a_signal_stops_a_long_wait(tmp_path: Path) -> None:
    path, _ = spaced(tmp_path, [0.0, 3600.0])
    with ground() as (sock, url), replaying(path, "--out", url) as process:
        receive(sock, 1)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and ": 1 message in" in out


@pytest.mark.parametrize(
    ("times_s", "said"),
    [
        ([0.0, 12.0], r"1[12] s until the next message \(2023-11-14T22:13:32\.123456Z\); --speed makes it less, .*\n"),
        ([0.0, 94_672_800.0, 94_672_801.0], r"3\.0 years until the next message \(2026-11-14T.*Z\); --speed .*\n"),
    ],
)
def test_how_long_a_long_gap_lasts_is_said_once(tmp_path: Path, times_s: list[float], said: str) -> None:
    path, _ = spaced(tmp_path, times_s)
    with ground() as (_, url), replaying(path, "--out", url) as process:
        assert process.stderr is not None
        assert re.fullmatch(f"ridlink: {said}", process.stderr.readline())
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and err == ""


def test_messages_without_times_that_are_far_apart_are_the_rates_doing(tmp_path: Path) -> None:
    path = tmp_path / "f.mavlink"
    path.write_bytes(b"".join(frame for _, frame in flight(2)))
    with ground() as (_, url), replaying(path, "--out", url, "--rate", "0.0001") as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "ridlink: 2.8 h until the next message; --rate makes it less\n"


def test_a_time_that_goes_back_or_is_damaged_does_not_stop_it(tmp_path: Path) -> None:
    path, frames = spaced(tmp_path, [3.0, 3.01, 0.0, 0.01])
    data = bytearray(path.read_bytes())
    length = 8 + len(frames[0])
    data[length] ^= 0x80  # the second has no time
    path.write_bytes(data)
    with ground() as (sock, url), replaying(path, "--out", url) as process:
        assert [data for _, data in receive(sock, 4)] == frames
        assert process.wait(timeout=PATIENCE_S) == 0


def test_that_nobody_listens_is_said(tmp_path: Path) -> None:
    path, _ = spaced(tmp_path, [0.0, 0.05, 0.1])
    url = f"udpout:127.0.0.1:{free_port()}"
    with replaying(path, "--out", url) as process:
        out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and out.startswith(f"{url}: 3 messages in ")
    assert err == f"ridlink: 2 messages came back: nobody listened on {url}\n"


def test_a_listening_link_waits_for_somebody(tmp_path: Path) -> None:
    path, frames = spaced(tmp_path, [0.0, 0.01, 0.02])
    with replaying(path, "--out", "udpin:127.0.0.1:0") as process, ground() as (sock, _):
        assert process.stderr is not None
        found = re.search(r"waiting for somebody to speak to udpin:127\.0\.0\.1:(\d+)", process.stderr.readline())
        assert found
        sock.sendto(b"here", ("127.0.0.1", int(found[1])))
        assert [data for _, data in receive(sock, 3)] == frames
        assert process.wait(timeout=PATIENCE_S) == 0


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["absent.tlog", "--out", "udpout:127.0.0.1:9"], 3),
        (["{log}", "--out", "udpout:nowhere"], 2),
        (["{log}"], 2),
        (["{log}", "--out", "mqtt://127.0.0.1:1883"], 2),
        (["{log}", "--out", "copy.tlog"], 2),
        (["{log}", "--out", "udpout:127.0.0.1:9", "--speed", "0"], 2),
        (["{log}", "--out", "udpout:127.0.0.1:9", "--rate", "nan"], 2),
        (["-", "--out", "udpout:127.0.0.1:9", "--loop"], 2),
        (["{log}", "--out", "udpout:127.0.0.1:9", "--types", "NOPE"], 2),
        (["{log}", "--out", "udpout:127.0.0.1:9", "--types", "RIDLINK_*", "--loop"], 3),
    ],
)
def test_errors_are_one_line(tmp_path: Path, arguments: list[str], code: int) -> None:
    path, _ = spaced(tmp_path, [0.0])
    with replaying(*(argument.replace("{log}", str(path)) for argument in arguments)) as process:
        out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code and len(err.splitlines()) == 1 and out == ""


def test_who_wants_a_file_is_told_what_writes_one(tmp_path: Path) -> None:
    path, _ = spaced(tmp_path, [0.0, 0.1])
    copy = tmp_path / "copy.tlog"
    with replaying(str(path), "--out", str(copy)) as process:
        _, err = process.communicate(timeout=PATIENCE_S)
    (command,) = re.findall(r"'(ridlink decode [^']*)'", err)
    program = f'ridlink() {{ {shlex.quote(sys.executable)} -m ridlink "$@"; }}'
    subprocess.run(f"{program}; {command}", shell=True, check=True)
    assert copy.read_bytes() == path.read_bytes()
