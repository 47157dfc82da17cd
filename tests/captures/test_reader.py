"""Captures by path: formats told apart, damage counted, what is no capture refused in one line."""

from __future__ import annotations

import io
import random
from pathlib import Path

import pytest

from ridlink.captures import Capture, CaptureKind, open_capture, read_messages, reader
from ridlink.captures.reader import detect_kind
from ridlink.captures.records import Rejects
from ridlink.errors import CaptureError
from ridlink.mavlink.frames import encode_frame
from ridlink.remote_id.messages import Location, Separation
from tests.captures.conftest import flight, raw_bytes, tlog_bytes

Records = list[tuple[int, bytes]]


@pytest.mark.parametrize(
    ("count", "suffix"),
    # of a single frame the suffix decides, so there a misleading one is not tried
    [(1, ""), (1, ".bin"), *((count, suffix) for count in (2, 1000) for suffix in (".tlog", ".bin", ".raw", ""))],
)
def test_the_content_tells_the_format_whatever_the_name(tmp_path: Path, count: int, suffix: str) -> None:
    path = tmp_path / f"file{suffix}"
    path.write_bytes(tlog_bytes(flight(count)))
    with open_capture(path) as capture:
        assert capture.kind is CaptureKind.TLOG
        assert [record.time_us for record in capture] == [time_us for time_us, _ in flight(count)]
    path.write_bytes(raw_bytes(flight(count)))
    with open_capture(path) as capture:
        assert capture.kind is CaptureKind.MAVLINK
        assert [record.frame.raw for record in capture] == [frame for _, frame in flight(count)]
        assert (capture.size, capture.position) == (path.stat().st_size, path.stat().st_size)


def test_a_damaged_beginning_does_not_hide_the_format(thousand: Records) -> None:
    noise = random.Random(5).randbytes(3000)
    assert detect_kind(noise + tlog_bytes(thousand[:50]), "x") is CaptureKind.TLOG
    assert detect_kind(noise + raw_bytes(thousand[:50]), "x") is CaptureKind.MAVLINK
    assert detect_kind(noise, "x.tlog") is CaptureKind.TLOG


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"root:x:0:0:root:/root:/bin/bash\n", "no capture"),
        (b"ULog\x01\x12\x35" + bytes(50), "a PX4 ULog"),
        *((magic + bytes(50), "unpack it first") for magic in (b"\x1f\x8b", b"BZh9", b"\xfd7zXZ\x00", b"PK\x03\x04")),
    ],
)
def test_what_is_no_capture_is_refused_in_one_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "file.bin"
    path.write_bytes(content)
    with pytest.raises(CaptureError, match=says) as caught:
        open_capture(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["tlog", "mavlink"])
def test_a_file_without_a_frame_is_an_error_at_its_end(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "file.tlog"
    path.write_bytes(random.Random(2).randbytes(5000))
    with open_capture(path, kind) as capture, pytest.raises(CaptureError, match="no MAVLink frame"):
        list(capture)
    path.write_bytes(b"")
    with open_capture(path, kind) as capture, pytest.raises(CaptureError, match="empty"):
        list(capture)


def test_absent_files_directories_and_unknown_formats(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        open_capture(tmp_path / "absent.tlog")
    with pytest.raises(IsADirectoryError):
        open_capture(tmp_path)
    with pytest.raises(ValueError, match="ulog"):
        open_capture(tmp_path, "ulog")


def test_f32_a_hostile_file_name_is_inert_in_the_error(tmp_path: Path) -> None:
    path = tmp_path / "\x1b[2Jé.tlog"
    path.write_bytes(b"")
    with pytest.raises(CaptureError) as caught:
        open_capture(path)
    assert "\\x1b[2Jé.tlog is empty" in str(caught.value)


@pytest.mark.parametrize("damage", [0, 333])
def test_a_raw_stream_counts_what_lies_between_frames(tmp_path: Path, thousand: Records, damage: int) -> None:
    path = tmp_path / "stream.raw"
    path.write_bytes(raw_bytes(thousand[:500]) + b"x" * damage + raw_bytes(thousand[500:]))
    with open_capture(path) as capture:
        assert [record.frame.raw for record in capture] == [frame for _, frame in thousand]
        assert capture.rejects.counts == ({"garbage": 1} if damage else {})
    assert str(capture.rejects) == (f"1 garbage (first at byte {len(raw_bytes(thousand[:500]))})" if damage else "")


def test_garbage_longer_than_a_chunk_is_one_reject(tmp_path: Path, thousand: Records) -> None:
    path = tmp_path / "stream.raw"
    path.write_bytes(raw_bytes(thousand[:5]) + b"x" * 1_000_000 + raw_bytes(thousand[5:10]))
    with open_capture(path) as capture:
        assert len(list(capture)) == 10
    assert capture.rejects.counts == {"garbage": 1}


def test_standard_input_is_read_and_left_open(monkeypatch: pytest.MonkeyPatch, thousand: Records) -> None:
    stream = io.TextIOWrapper(io.BufferedReader(io.BytesIO(tlog_bytes(thousand))))
    monkeypatch.setattr("sys.stdin", stream)
    reads = []
    with open_capture("-", before_read=lambda: reads.append(1)) as capture:
        assert (capture.name, capture.kind) == ("standard input", CaptureKind.TLOG)
        assert len(list(capture)) == 1000
    assert not stream.buffer.closed and reads


def test_messages_are_typed(tmp_path: Path) -> None:
    path = tmp_path / "file.tlog"
    unknown = encode_frame(54321, b"x", 9, seq=0, sysid=9, compid=8)
    path.write_bytes(tlog_bytes([*flight(3), (flight(4)[3][0], unknown)]))
    heartbeat, location, separation, stranger = read_messages(path)
    assert heartbeat.message is not None and heartbeat.message.autopilot == 12 and heartbeat.remote_id is None
    assert isinstance(location.remote_id, Location) and location.remote_id.latitude_deg == 47.4
    assert isinstance(separation.remote_id, Separation) and separation.remote_id.horizontal_error_m == 3.0
    assert (stranger.name, stranger.message, stranger.source) == ("UNKNOWN", None, (9, 8))


class ByteByByte(io.BytesIO):
    """A pipe whose writer does not collect."""

    def read1(self, size: int | None = -1, /) -> bytes:
        return super().read1(1)


def test_a_text_that_comes_byte_by_byte_is_not_judged_anew_with_each(monkeypatch: pytest.MonkeyPatch) -> None:
    judged = []
    monkeypatch.setattr(reader, "looks_like_hex", lambda head: judged.append(len(head)) or False)
    with pytest.raises(CaptureError, match="no capture"):
        Capture("pipe", ByteByByte(b"log line\n" * 4000), None)
    assert len(judged) < 1200 and judged[:1000] == list(range(1, 1001))


def test_what_comes_byte_by_byte_is_told_as_soon_as_it_is_enough(thousand: Records) -> None:
    stream = ByteByByte(tlog_bytes(thousand[:40]))
    assert Capture("pipe", stream, None).kind is CaptureKind.TLOG
    assert stream.tell() < len(stream.getvalue()) // 2


def test_damage_is_told_in_one_order_however_it_was_found() -> None:
    """Readers that take whole blocks find all of one cause before the next."""
    found = [("garbage", 100), ("truncated", 100), ("crc", 40), ("unknown", 200), ("unknown", 300)]
    told = set()
    for order in (found, found[::-1]):
        rejects = Rejects()
        for cause, offset in order:
            rejects.add_one(cause, offset)
        told.add(str(rejects))
    assert told == {
        "2 unknown (first at byte 200), 1 crc (first at byte 40), 1 garbage (first at byte 100), "
        "1 truncated (first at byte 100)"
    }
