"""Telemetry logs: read whole, cut anywhere, damaged anywhere; written complete or not at all."""

from __future__ import annotations

import random
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.captures import Record, Rejects, TlogWriter, open_capture
from ridlink.captures.tlog import read_tlog
from ridlink.mavlink.codec import Encoder, message_spec
from ridlink.mavlink.frames import encode_frame
from tests.captures.conftest import START_US, flight, tlog_bytes

Records = list[tuple[int, bytes]]


def read(data: bytes, chunk: int = 1 << 20) -> tuple[list[Record], Rejects]:
    rejects = Rejects()
    return list(read_tlog((data[at : at + chunk] for at in range(0, len(data), chunk)), rejects)), rejects


def pairs(records: list[Record]) -> list[tuple[int | None, bytes]]:
    return [(record.time_us, record.frame.raw) for record in records]


@pytest.mark.parametrize("chunk", [1, 7, 4096, 1 << 20])
def test_however_it_is_cut_the_same_records_come_out(thousand: Records, chunk: int) -> None:
    records, rejects = read(tlog_bytes(thousand), chunk)
    assert pairs(records) == thousand
    assert not rejects
    offsets = [record.offset for record in records]
    assert offsets[:2] == [0, 8 + len(thousand[0][1])]
    assert offsets == sorted(offsets)


def test_f33_a_cut_tail_costs_the_last_record_and_is_counted(thousand: Records) -> None:
    data = tlog_bytes(thousand)
    records, rejects = read(data[:-5])
    assert pairs(records) == thousand[:-1]
    assert rejects.counts == {"truncated": 1}
    assert rejects.first_offset["truncated"] == len(data) - 8 - len(thousand[-1][1])


@pytest.mark.parametrize("left", [1, 7, 8, 9, 15])
def test_a_tail_of_a_few_bytes_is_one_reject(thousand: Records, left: int) -> None:
    records, rejects = read(tlog_bytes(thousand[:10]) + tlog_bytes(thousand[10:11])[:left])
    assert len(records) == 10
    assert rejects.counts == {"truncated": 1}


def test_f33_corrupt_bytes_between_records_cost_nothing(thousand: Records) -> None:
    noise = random.Random(1).randbytes(333)
    data = tlog_bytes(thousand[:500]) + noise + tlog_bytes(thousand[500:])
    records, rejects = read(data)
    assert pairs(records) == thousand
    assert len(rejects) == 1
    assert list(rejects.first_offset.values()) == [len(tlog_bytes(thousand[:500]))]


def test_one_flipped_byte_costs_one_record_and_says_where(thousand: Records) -> None:
    data = bytearray(tlog_bytes(thousand))
    at = len(tlog_bytes(thousand[:400]))
    data[at + 8 + 12] ^= 0x40  # in the payload
    records, rejects = read(bytes(data))
    assert pairs(records) == thousand[:400] + thousand[401:]
    assert rejects.counts == {"bad_checksum": 1}
    assert rejects.first_offset == {"bad_checksum": at}


def test_damaged_records_in_a_row_are_counted_one_by_one(thousand: Records) -> None:
    data = bytearray(tlog_bytes(thousand))
    for index in (400, 401, 402, 500):
        data[len(tlog_bytes(thousand[:index])) + 8 + 12] ^= 0x40
    records, rejects = read(bytes(data))
    assert len(records) == 996
    assert rejects.counts == {"bad_checksum": 4}


def test_f33_a_damaged_length_byte_does_not_swallow_what_follows(thousand: Records) -> None:
    data = bytearray(tlog_bytes(thousand))
    data[len(tlog_bytes(thousand[:998])) + 8 + 1] = 255
    assert pairs(read(bytes(data))[0]) == thousand[:998] + thousand[999:]


def test_a_damaged_time_keeps_the_frame_and_loses_the_time(thousand: Records) -> None:
    data = bytearray(tlog_bytes(thousand[:10]))
    data[len(tlog_bytes(thousand[:5]))] ^= 0x80
    records, rejects = read(bytes(data))
    assert pairs(records) == [*thousand[:5], (None, thousand[5][1]), *thousand[6:10]]
    assert rejects.counts == {"bad_timestamp": 1}


def test_among_flipped_bytes_no_intact_record_is_lost(thousand: Records) -> None:
    data = bytearray(tlog_bytes(thousand))
    chance = random.Random(7)
    flipped = {at for at in range(len(data)) if chance.random() < 0.002}
    for at in flipped:
        data[at] ^= 1 << chance.randrange(8)
    intact, start = [], 0
    for _, frame in thousand:
        end = start + 8 + len(frame)
        if not flipped.intersection(range(start + 8, end)):
            intact.append(frame)
        start = end
    records, rejects = read(bytes(data))
    assert 900 < len(intact) < 970
    # a flip in the message id makes an unknown message, which no checksum can refuse: those are not `checked`
    assert [record.frame.raw for record in records if record.frame.checked] == intact
    assert rejects.counts["bad_checksum"] > 0


def test_a_frame_inside_the_payload_of_a_damaged_one_is_no_record(thousand: Records) -> None:
    inner = thousand[0][1]
    outer = bytearray(Encoder(1, 1).encode("TUNNEL", payload_length=len(inner) + 8, payload=(bytes(8) + inner)))
    outer[4] ^= 0xFF
    data = tlog_bytes([*thousand[:5], (START_US, bytes(outer)), *thousand[5:10]])
    assert pairs(read(data)[0]) == thousand[:10]


def test_logs_of_different_years_in_one_file_are_both_read() -> None:
    old = flight(5)
    new = [(time_us + 400 * 24 * 3600 * 1_000_000, frame) for time_us, frame in flight(5)]
    records, rejects = read(tlog_bytes(old) + tlog_bytes(new))
    assert pairs(records) == old + new and not rejects
    records, rejects = read(tlog_bytes(old) + b"\x00\xfd garbage" + tlog_bytes(new))
    assert pairs(records) == old + new and len(rejects) == 1


@pytest.mark.parametrize("first_us", [0, 33_333, 2**62])
def test_simulated_clocks_are_taken_as_they_are(first_us: int) -> None:
    records = [(first_us + index, frame) for index, (_, frame) in enumerate(flight(3))]
    assert pairs(read(tlog_bytes(records))[0]) == records
    assert pairs(read(tlog_bytes(records[:1]))[0]) == records[:1]


def test_unknown_ids_pass_where_a_record_follows_and_are_marked(thousand: Records) -> None:
    unknown = encode_frame(54321, b"whatever", 99, seq=3, sysid=1, compid=1)
    records, rejects = read(tlog_bytes([thousand[0], (START_US, unknown), thousand[1], (START_US + 1, unknown)]))
    assert [record.frame.msgid for record in records] == [0, 54321, 12901, 54321]
    assert [record.frame.checked for record in records] == [True, False, True, False]
    assert not rejects
    damaged = bytearray(unknown)
    damaged[1] += 1
    records, rejects = read(tlog_bytes([thousand[0], (START_US, bytes(damaged)), thousand[1]]))
    assert [record.frame.msgid for record in records] == [0, 12901]
    assert rejects.counts == {"unknown_unconfirmed": 1}


def test_signed_frames_and_version_one_are_records(thousand: Records) -> None:
    spec = message_spec("HEARTBEAT")
    from ridlink.mavlink.crc import checksum

    body = bytes([9, 7, 1, 1, 0]) + bytes([0, 0, 0, 0, 2, 3, 81, 4, 3])
    version_1 = b"\xfe" + body + checksum(body, spec.crc_extra).to_bytes(2, "little")
    body = bytes([1, 1, 0, 7, 1, 1, 0, 0, 0, 5])
    signed = b"\xfd" + body + checksum(body, spec.crc_extra).to_bytes(2, "little") + bytes(13)
    written = [thousand[0], (START_US, version_1), (START_US, signed), thousand[1]]
    records, rejects = read(tlog_bytes(written))
    assert pairs(records) == written and not rejects
    assert [record.frame.version for record in records] == [2, 1, 2, 2]


@settings(max_examples=60)
@given(st.binary(max_size=600), st.binary(max_size=600), st.integers(1, 700))
def test_no_bytes_raise_and_records_among_them_are_found(before: bytes, after: bytes, chunk: int) -> None:
    inside = flight(3)
    whole, _ = read(before + tlog_bytes(inside) + after)
    assert pairs(whole) == pairs(read(before + tlog_bytes(inside) + after, chunk)[0])
    found = [frame for _, frame in pairs(whole)]
    assert all(frame in found for _, frame in inside)


def test_two_megabytes_of_noise_hold_nothing_and_end(thousand: Records) -> None:
    records, rejects = read(random.Random(3).randbytes(2_000_000) + tlog_bytes(thousand))
    assert pairs(records)[-1000:] == thousand
    assert len(rejects) >= 1


def test_f33_memory_does_not_grow_with_the_file(tmp_path: Path, thousand: Records) -> None:
    path = tmp_path / "large.tlog"
    path.write_bytes(tlog_bytes(thousand) * 400)
    script = (
        "import re,sys\nfrom ridlink.captures import open_capture\n"
        # not ru_maxrss: through fork and exec that remembers the parent; and what imports took for a while is forgotten
        "peak = lambda: int(re.search(r'VmHWM:\\s*(\\d+)', open('/proc/self/status').read())[1])\n"
        "records = iter(open_capture(sys.argv[1])); next(records); open('/proc/self/clear_refs', 'w').write('5')\n"
        "before = peak()\n"
        "print(sum(1 for _ in records), peak() - before)"
    )
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True)
    count, grown_kib = map(int, done.stdout.split())
    assert count == 399_999
    assert grown_kib < 8 * 1024 < path.stat().st_size / 1024


def test_the_writer_writes_what_the_reader_reads(tmp_path: Path, thousand: Records) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as writer:
        for time_us, frame in thousand:
            writer.write(time_us, frame)
    assert path.read_bytes() == tlog_bytes(thousand)
    assert (writer.records, writer.bytes_written) == (1000, path.stat().st_size)
    with open_capture(path) as capture:
        assert pairs(list(capture)) == thousand


def test_an_existing_file_is_not_overwritten_unasked(tmp_path: Path, thousand: Records) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        TlogWriter(path)
    assert path.read_bytes() == b"precious"
    with TlogWriter(path, overwrite=True) as writer:
        writer.write(*thousand[0])
    assert path.read_bytes() == tlog_bytes(thousand[:1])


def test_what_is_older_than_a_second_of_log_is_on_disk(tmp_path: Path, thousand: Records) -> None:
    path = tmp_path / "flight.tlog"
    writer = TlogWriter(path)
    writer.write(START_US, thousand[0][1])
    on_disk = path.stat().st_size
    writer.write(START_US + 500_000, thousand[1][1])
    assert path.stat().st_size == on_disk > 0
    writer.write(START_US + 1_000_000, thousand[2][1])
    assert path.stat().st_size > on_disk
    writer.write(START_US + 1_000_001, thousand[3][1])
    writer.flush()
    assert len(read(path.read_bytes())[0]) == 4
    writer.close()
    writer.close()
    with pytest.raises(ValueError, match="closed"):
        writer.write(START_US, thousand[0][1])


def test_a_clock_that_goes_back_does_not_take_the_log_with_it(tmp_path: Path, thousand: Records) -> None:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as writer:
        for time_us in (2_000_000, 1_000_000, 3_000_000):
            writer.write(time_us, thousand[0][1])
        with pytest.raises(ValueError, match="time_us"):
            writer.write(-1, thousand[0][1])
    assert [record.time_us for record in read(path.read_bytes())[0]] == [2_000_000, 2_000_000, 3_000_000]


def test_f29_a_full_disk_leaves_complete_records(tmp_path: Path) -> None:
    """The kernel refuses to let the file grow beyond 10,000 bytes; what is left of it decodes without a reject."""
    path = tmp_path / "flight.tlog"
    script = (
        "import sys\nfrom ridlink.captures import TlogWriter\nfrom tests.captures.conftest import flight\n"
        "writer = TlogWriter(sys.argv[1])\n"
        "try:\n    [writer.write(*record) for record in flight(1000)]\n"
        "except OSError as error:\n    print(writer.records, error.filename == sys.argv[1])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000)),
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    count, named = done.stdout.split()
    records, rejects = read(path.read_bytes())
    assert 100 < len(records) == int(count) and named == "True"
    assert not rejects and pairs(records) == flight(len(records))
    assert 9_900 < path.stat().st_size <= 10_000


def test_a_device_without_space_raises_once_and_closes() -> None:
    writer = TlogWriter("/dev/full", overwrite=True)
    with pytest.raises(OSError, match="No space left"):
        writer.write(START_US, flight(1)[0][1])
    writer.close()
    assert (writer.records, writer.bytes_written) == (0, 0)
