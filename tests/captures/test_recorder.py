"""The recording: complete, apart from the loop, and never in the way of the flight."""

from __future__ import annotations

import os
import threading
from itertools import count
from pathlib import Path

import pytest

from ridlink.captures.recorder import QUEUE_LENGTH, Recorder, steady_clock
from ridlink.captures.records import Rejects
from ridlink.captures.tlog import TlogWriter, read_tlog
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import parse_datagram
from tests.daemon.emulated import Emulated

NOW_US = 1_700_000_000_000_000


def records(path: Path) -> list[tuple[int | None, bytes]]:
    return [(record.time_us, record.frame.raw) for record in read_tlog([path.read_bytes()], Rejects())]


def test_every_frame_of_every_datagram_is_a_record(tmp_path: Path) -> None:
    vehicle = Emulated()
    datagrams = [vehicle.telemetry(k * 0.1) for k in range(20)]
    ticks = count(NOW_US)
    recorder = Recorder(tmp_path / "a.tlog", clock=lambda: next(ticks))
    for datagram in datagrams:
        recorder.receive(datagram)
    recorder.receive(b"junk")
    recorder.close()
    found = records(tmp_path / "a.tlog")
    sent = sum(len(parse_datagram(datagram, CRC_EXTRAS)) for datagram in datagrams)
    assert sent >= 40, "more than one frame a datagram"
    assert b"".join(raw for _, raw in found) == b"".join(datagrams)
    assert len(found) == sent
    assert found[-1][0] == NOW_US + 19
    assert (recorder.messages, recorder.bytes_written) == (sent, (tmp_path / "a.tlog").stat().st_size)
    assert recorder.types.total() == sent and recorder.sources == {"1/1": sent}
    assert recorder.rejects.counts == {"garbage": 1}


def test_a_datagram_may_be_full_of_frames(tmp_path: Path) -> None:
    vehicle = Emulated()
    frames = [vehicle.heartbeat() for _ in range(1000)]
    recorder = Recorder(tmp_path / "a.tlog", clock=lambda: NOW_US)
    recorder.receive(b"".join(frames))
    recorder.close()
    assert [raw for _, raw in records(tmp_path / "a.tlog")] == frames and not recorder.rejects


def test_a_file_that_cannot_be_made_or_exists_is_an_error_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Recorder(tmp_path / "none" / "a.tlog")
    (tmp_path / "old.tlog").write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        Recorder(tmp_path / "old.tlog")
    assert (tmp_path / "old.tlog").read_bytes() == b"precious"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_f29_a_disk_that_refuses_ends_the_recording_only() -> None:
    recorder = Recorder("/dev/full", overwrite=True)
    recorder.receive(Emulated().heartbeat())
    recorder.close()
    recorder.receive(Emulated().heartbeat())
    assert recorder.error is not None and "No space left" in str(recorder.error)
    assert recorder.messages == 0


def test_a_pipe_that_is_read_is_a_log(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    recorder = Recorder(pipe, overwrite=True)
    os.set_blocking(reader, True)
    datagram = Emulated().telemetry(0.0)
    for _ in range(500):  # more than a pipe holds
        recorder.receive(datagram)
    with open(reader, "rb") as log:
        threading.Thread(target=recorder.close).start()
        frames = [record.frame.raw for record in read_tlog([log.read()], Rejects())]
    assert b"".join(frames) == datagram * 500


def test_f29_a_slow_disk_costs_records_not_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate = threading.Event()
    write = TlogWriter.write

    def slow(self: TlogWriter, time_us: int, frame: bytes) -> None:
        gate.wait()
        write(self, time_us, frame)

    monkeypatch.setattr(TlogWriter, "write", slow)
    recorder = Recorder(tmp_path / "a.tlog")
    beat = Emulated().heartbeat()
    for _ in range(QUEUE_LENGTH + 100):
        recorder.receive(beat)
    assert recorder.dropped >= 90
    recorder.close(0.01)
    gate.set()
    recorder.close()
    assert len(records(tmp_path / "a.tlog")) + recorder.dropped == QUEUE_LENGTH + 100


def test_the_clock_of_a_recording_does_not_step(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = steady_clock()
    before_us = clock()
    monkeypatch.setattr("time.time_ns", lambda: 0)  # the system clock is set back to 1970
    assert 0 <= clock() - before_us < 60_000_000
