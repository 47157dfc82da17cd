"""The kernels take and refuse exactly what the readers of records do, on intact and on damaged captures."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ridlink.captures.export.aligned import AlignedRows
from ridlink.captures.export.jsonl import JsonRows
from ridlink.captures.export.rows import Rows
from ridlink.captures.fast import copying, loading, tables
from ridlink.captures.fast.blocks import BlockReader
from ridlink.captures.raw import read_raw
from ridlink.captures.records import Rejects
from ridlink.captures.statistics import SourceCount
from ridlink.captures.tlog import read_tlog
from ridlink.errors import CaptureError
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, Encoder
from ridlink.mavlink.crc import checksum
from ridlink.mavlink.frames import encode_frame
from tests.captures.conftest import START_US, flight, needs_compiler, tlog_bytes
from tests.captures.drawn import PIECES, signed, version_1
from tests.captures.pcap_files import ethernet, ipv4, pcap, timed, udp

Entry = tuple[int | None, bytes, int]
Found = tuple[list[Entry], dict[str, int], dict[str, int], dict[tuple[int, int], SourceCount]]


def by_records(data: bytes, kind: str) -> Found:
    """What the reader of records finds."""
    rejects = Rejects()
    read = read_tlog if kind == "tlog" else read_raw
    entries: list[Entry] = []
    sources: dict[tuple[int, int], SourceCount] = {}
    for time_us, frame, offset in read([data], rejects):
        entries.append((time_us, frame.raw, offset))
        sources.setdefault((frame.sysid, frame.compid), SourceCount()).see(frame.seq)
    return entries, dict(rejects.counts), rejects.first_offset, sources


def by_kernels(path: Path, kind: str, block_length: int = 1 << 19) -> Found:
    """What the kernels find."""
    reader = BlockReader(path, kind, block_length=block_length)
    entries: list[Entry] = []
    try:
        for block in reader:
            for entry in range(block.count):
                time_us = int(block.times[entry])
                entries.append((None if time_us == 2**64 - 1 else time_us, block.frame(entry), block.offset(entry)))
    except CaptureError as error:
        assert not entries and ("no MAVLink frame" in str(error) or "is empty" in str(error))
    return entries, dict(reader.rejects.counts), reader.rejects.first_offset, reader.sources


@pytest.mark.parametrize("kind", ["tlog", "mavlink"])
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    pieces=PIECES,
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=4),
    cut=st.integers(0, 12),
    block_length=st.sampled_from([1, 37, 300, 1 << 16]),
)
def test_on_damaged_captures_kernels_and_readers_agree(
    tmp_path: Path, kind: str, pieces: list[tuple[int | None, bytes]], flips: list[tuple[float, int]], cut: int,
    block_length: int,
) -> None:  # fmt: skip
    data = bytearray()
    for time_us, piece in pieces:
        data += piece if time_us is None or kind == "mavlink" else time_us.to_bytes(8, "big") + piece
    for place, bits in flips:
        if data:
            data[int(place * len(data))] ^= bits
    data = data[: len(data) - cut]
    path = tmp_path / "capture"
    path.write_bytes(data)
    assert by_kernels(path, kind, block_length) == by_records(bytes(data), kind)


@pytest.mark.parametrize("kind", ["tlog", "mavlink"])
def test_many_flipped_bytes_are_judged_alike(tmp_path: Path, kind: str) -> None:
    records = flight(4000)
    data = bytearray(tlog_bytes(records) if kind == "tlog" else b"".join(frame for _, frame in records))
    chance = random.Random(11)
    for at in range(len(data)):
        if chance.random() < 0.004:
            data[at] ^= 1 << chance.randrange(8)
    path = tmp_path / "capture"
    path.write_bytes(data)
    found = by_kernels(path, kind, 10_000)
    assert found == by_records(bytes(data), kind)
    assert len(found[1]) >= 4 and found[3][1, 1].gaps > 100


@pytest.mark.parametrize("kind", ["tlog", "mavlink"])
def test_noise_is_judged_alike(tmp_path: Path, kind: str) -> None:
    data = random.Random(3).randbytes(200_000) + tlog_bytes(flight(3)) + bytes([0xFD, 0xFE] * 500)
    path = tmp_path / "noise"
    path.write_bytes(data)
    assert by_kernels(path, kind, 1000) == by_records(data, kind)


def test_what_would_swallow_the_end_of_another_frame_is_judged_alike(tmp_path: Path) -> None:
    extra = CRC_EXTRAS[0]
    plain = encode_frame(0, b"1", extra, seq=1, sysid=1, compid=1)
    for beat in (version_1(0, bytes(9), extra), signed(0, b"12", extra), plain):
        for swallower in (b"\xfd" + bytes((40, 0, 0, 1, 7, 7, 255, 255, 127)), b"\xfe" + bytes((44, 1, 7, 7, 200))):
            data = swallower + b"\xfd\xfe" * 3 + bytes(swallower[1] - 4 - len(beat)) + beat
            assert len(data) == len(swallower) + swallower[1] + 2
            for stream in (data, data + beat, data + data + plain):
                path = tmp_path / "f.mavlink"
                path.write_bytes(stream)
                found = by_kernels(path, "mavlink")
                assert found == by_records(stream, "mavlink")
                assert beat in [frame for _, frame, _ in found[0]]


@given(data=st.binary(min_size=1, max_size=280), extra=st.integers(0, 255))
@settings(max_examples=100)
def test_the_checksum_is_that_of_the_codec(data: bytes, extra: int) -> None:
    array = np.frombuffer(bytearray(bytes(8) + data + bytes(8)), np.uint8)
    found = loading.checksum(array, 8, 8 + len(data), extra, tables.checksum_table(), tables.initial_table())
    assert found == checksum(data, extra)


def test_a_time_of_all_bits_set_is_no_time(tmp_path: Path) -> None:
    path = tmp_path / "no_clock.tlog"
    path.write_bytes(tlog_bytes([(2**64 - 1, frame) for _, frame in flight(3)]))
    found = by_records(path.read_bytes(), "tlog")
    assert [time_us for time_us, _, _ in found[0]] == [None] * 3 and not found[1]
    assert by_kernels(path, "tlog") == found


@needs_compiler
def test_damage_costs_intact_frames_almost_nothing_and_invents_none(tmp_path: Path) -> None:
    """One byte in a thousand is changed in a raw stream of 100,000 frames.

    A changed length byte can make a frame swallow the next one: only where the checksum happens to fit, or the id is
    unknown and a magic byte within another frame happens to follow, is an intact frame lost.
    """
    stream = [frame for _, frame in flight(100_000)]
    data = np.frombuffer(bytearray(b"".join(stream)), np.uint8)
    chance = np.random.default_rng(5)
    hit = chance.random(len(data)) < 0.001
    data[hit] ^= chance.integers(1, 256, int(hit.sum()), dtype=np.uint8)
    ends = np.cumsum([len(frame) for frame in stream])
    begins = ends - [len(frame) for frame in stream]
    hits = np.concatenate([[0], np.cumsum(hit)])
    intact = {int(begin) for begin in begins[hits[ends] == hits[begins]]}
    path = tmp_path / "damaged.mavlink"
    path.write_bytes(data)
    found = {offset: frame for _, frame, offset in by_kernels(path, "mavlink")[0]}
    recovered = len(intact & found.keys())
    assert 94_000 < len(intact) < 98_000
    assert recovered >= len(intact) - 17
    for frame in found.values():
        msgid = int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]
        if msgid in MESSAGES:
            end = frame[1] + (10 if frame[0] == 0xFD else 6)
            assert checksum(frame[1:end], CRC_EXTRAS[msgid]) == int.from_bytes(frame[end : end + 2], "little")


@pytest.mark.programs
@needs_compiler
def test_without_a_compiler_the_results_are_the_same(tmp_path: Path) -> None:
    data = bytearray(tlog_bytes(flight(60)))
    for at in range(100, len(data), 331):
        data[at] ^= 0x11
    data += tlog_bytes([(START_US, signed(12901, bytes([1]) * 59, CRC_EXTRAS[12901]))])
    data += tlog_bytes([(START_US, version_1(0, b"12", CRC_EXTRAS[0]))])
    (tmp_path / "f.tlog").write_bytes(data)
    (tmp_path / "f.mavlink").write_bytes(b"".join(frame for _, frame in flight(40)) + b"\xfd\x00" + bytes(data))
    datagrams = [frame for _, frame in flight(300)] + [b"\xfd\x00" + bytes(data[:90])]
    (tmp_path / "f.pcap").write_bytes(pcap(timed([ethernet(ipv4(udp(payload))) for payload in datagrams])))
    script = (
        "import hashlib,sys\nfrom ridlink.captures.columns import decode\n"
        "from ridlink.captures.export.block_lines import BlockLines\n"
        "from ridlink.captures.export.selection import Selection\n"
        "from ridlink.captures.fast.blocks import BlockReader\n"
        "for path in sys.argv[1:]:\n"
        "    for lines in (BlockLines(Selection(), frames=True), BlockLines(Selection(), 'table')):\n"
        "        print(b''.join(bytes(lines.of(block)) for block in BlockReader(path)).decode())\n"
        "    columns = decode(path)\n"
        "    print(columns.rejects, columns.sources, [(k, len(v), hashlib.sha256(v).hexdigest()) "
        "for k, v in columns.items()])"
    )
    command = [sys.executable, "-c", script, *(str(tmp_path / f"f.{kind}") for kind in ("tlog", "mavlink", "pcap"))]
    outputs = [
        subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | more).stdout
        for more in ({}, {"NUMBA_DISABLE_JIT": "1"})
    ]
    assert outputs[0] == outputs[1]
    assert (
        "OPEN_DRONE_ID_LOCATION" in outputs[0] and " latitude_deg=47.4 " in outputs[0] and "bad_checksum" in outputs[0]
    )


@pytest.mark.programs
@needs_compiler
def test_the_compiler_is_announced_once_and_kept(tmp_path: Path) -> None:
    (tmp_path / "f.tlog").write_bytes(tlog_bytes(flight(9)))
    script = "import sys\nfrom ridlink.captures.columns import decode\nprint(len(decode(sys.argv[1])['HEARTBEAT']))"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    said = [
        subprocess.run(
            [sys.executable, "-c", script, str(tmp_path / "f.tlog")],
            capture_output=True, text=True, check=True, env=environment,
        )
        for _ in range(2)
    ]  # fmt: skip
    assert [done.stdout for done in said] == ["3\n", "3\n"]
    assert "compiling the decoder" in said[0].stderr and said[1].stderr == ""


@pytest.mark.parametrize("form", [JsonRows, AlignedRows])
def test_f33_one_long_text_makes_no_room_for_itself_in_every_cell(form: type[Rows]) -> None:
    """Lines of many cells and the bytes of one long frame: gigabytes were asked for, which a small machine refuses."""
    rows = form(1000)
    for _ in range(250):
        rows.literal(",")
        rows.numbers(np.zeros(1000, np.uint8))
    rows.texts(["ab" * 280, *["ab" * 13] * 999])
    rows.finish()
    out, bounds = np.zeros(rows.longest(), np.uint8), np.zeros(1000, np.int64)
    assert rows.write(out, 0, np.arange(1000), bounds, bounds.copy()) < len(out) < 10_000_000


def test_every_message_of_the_dialect_has_a_layout_that_fits_its_payload() -> None:
    for layout in tables.layouts()[1:]:
        assert layout.spec is not None and layout.dtype.fields is not None
        fields = [layout.dtype.fields[tables.column_of(name)] for name in layout.spec.fields]
        assert fields[0][1] == copying.HEAD_LENGTH
        assert fields[-1][1] + fields[-1][0].itemsize == copying.HEAD_LENGTH + layout.spec.size
        assert layout.dtype.itemsize % 8 == 0


def test_an_encoder_is_enough_to_make_a_stream(tmp_path: Path) -> None:
    path = tmp_path / "f.mavlink"
    path.write_bytes(Encoder(3, 4).encode("HEARTBEAT", type=2))
    assert by_kernels(path, "mavlink")[3] == {(3, 4): SourceCount(1, 0, 0, 0)}
