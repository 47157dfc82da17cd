"""The recording: complete, apart from the loop, and never in the way of the flight."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from ridlink.captures.records import Rejects
from ridlink.captures.tlog import TlogWriter, read_tlog
from ridlink.daemon.recorder import QUEUE_LENGTH, Recorder
from ridlink.errors import LinkError
from tests.daemon.emulated import Emulated

NOW_US = 1_700_000_000_000_000


def records(path: Path) -> list[tuple[int | None, bytes]]:
    return [(record.time_us, record.frame.raw) for record in read_tlog([path.read_bytes()], Rejects())]


def test_every_frame_of_every_datagram_is_a_record(tmp_path: Path) -> None:
    vehicle = Emulated()
    datagrams = [vehicle.telemetry(k * 0.1) for k in range(20)]
    recorder = Recorder(tmp_path / "a.tlog")
    for k, datagram in enumerate(datagrams):
        recorder.record(NOW_US + k, datagram)
    recorder.record(NOW_US + 99, b"junk")
    recorder.close()
    found = records(tmp_path / "a.tlog")
    assert b"".join(raw for _, raw in found) == b"".join(datagrams)
    assert len(found) == 60
    assert found[-1][0] == NOW_US + 19


def test_a_file_that_cannot_be_made_is_an_error_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="No such file"):
        Recorder(tmp_path / "none" / "a.tlog")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_disk_that_refuses_ends_the_recording_only() -> None:
    recorder = Recorder(Path("/dev/full"))
    recorder.record(NOW_US, Emulated().heartbeat())
    recorder.close()
    recorder.record(NOW_US, Emulated().heartbeat())
    assert recorder.counters["recording_failed"] == 1
    assert "No space left" in recorder.failure


def test_a_slow_disk_costs_records_not_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate = threading.Event()
    write = TlogWriter.write

    def slow(self: TlogWriter, time_us: int, frame: bytes) -> None:
        gate.wait()
        write(self, time_us, frame)

    monkeypatch.setattr(TlogWriter, "write", slow)
    recorder = Recorder(tmp_path / "a.tlog")
    beat = Emulated().heartbeat()
    for _ in range(QUEUE_LENGTH + 100):
        recorder.record(NOW_US, beat)
    assert recorder.counters["recording_dropped"] >= 90
    gate.set()
    recorder.close()
    assert len(records(tmp_path / "a.tlog")) + recorder.counters["recording_dropped"] == QUEUE_LENGTH + 100
