"""Captures as columns, and columns as frames."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ridlink
from ridlink.captures import decode_records, open_capture
from ridlink.captures.columns import NO_TIME_US, decode, encode, iter_blocks, units, zeros
from ridlink.captures.fast.tables import column_of
from ridlink.captures.statistics import SourceCount
from ridlink.errors import CaptureError, UnknownMessageError
from ridlink.mavlink.codec import MESSAGES_BY_NAME, Encoder, encode_payload, message_spec
from ridlink.mavlink.frames import encode_frame
from tests.captures.conftest import START_US, flight, needs_compiler, tlog_bytes

Records = list[tuple[int, bytes]]
REAL = Path(__file__).resolve().parents[3] / "shared" / "captures" / "real_autopilot.tlog"


def written(tmp_path: Path, data: bytes, name: str = "flight.tlog") -> Path:
    path = tmp_path / name
    path.write_bytes(data)
    return path


def test_links_that_were_recorded_side_by_side_are_told_from_losses(tmp_path: Path) -> None:
    one, other = Encoder(1, 1), Encoder(1, 1)
    other.seq = 120
    path = tmp_path / "two-links.tlog"
    path.write_bytes(tlog_bytes([(START_US + k, (one, other)[k % 2].encode("HEARTBEAT")) for k in range(1000)]))
    source = decode(path).sources[1, 1]
    assert source.is_of_several_links and (source.messages, source.gaps) == (1000, 999)


def test_columns_have_the_names_and_values_of_the_xml(tmp_path: Path, thousand: Records) -> None:
    columns = ridlink.decode(written(tmp_path, tlog_bytes(thousand)))
    assert list(columns) == ["HEARTBEAT", "OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION"]
    location = columns["OPEN_DRONE_ID_LOCATION"]
    assert location.dtype.names is not None
    assert location.dtype.names[:8] == (
        "t_us", "sysid", "compid", "seq", "offset", "target_system", "target_component", "id_or_mac",
    )  # fmt: skip
    assert location["latitude"].tolist() == [474000000] * 333
    assert location["longitude"][:2].tolist() == [85000010, 85000040]
    assert location["t_us"].tolist() == [time_us for time_us, _ in thousand[1::3]]
    assert location["seq"].tolist() == [index % 256 for index in range(1, 1000, 3)]
    assert set(location["sysid"].tolist()) == {1}
    assert location["id_or_mac"].shape == (333, 20)
    assert columns["HEARTBEAT"]["offset"][:2].tolist() == [0, len(tlog_bytes(thousand[:3]))]
    assert not columns.rejects and columns.sources == {(1, 1): SourceCount(1000, 0, 0, 999 % 256)}
    assert units("OPEN_DRONE_ID_LOCATION")["latitude"] == "degE7"


@needs_compiler
def test_every_field_of_a_real_recording_is_what_the_codec_decodes() -> None:
    if not REAL.exists():
        pytest.skip("the recording of real autopilots is not part of the project")
    columns = decode(REAL)
    seen = dict.fromkeys(columns, 0)
    with open_capture(REAL) as capture:
        for record in decode_records(capture):
            if record.is_member:
                continue
            row = columns[record.name][seen[record.name]]
            seen[record.name] += 1
            assert (int(row["t_us"]), int(row["offset"])) == (record.time_us, record.offset)
            if record.message is None:
                assert row["payload"][: row["length"]].tobytes() == record.frame.payload
                continue
            if record.frame.seq % 8:  # an eighth of them tells as much
                continue
            for field, value in record.message.fields.items():
                found = row[column_of(field)]
                if isinstance(value, bytes):
                    assert bytes(found).rstrip(b"\x00") == value.rstrip(b"\x00")
                else:
                    np.testing.assert_array_equal(found, value)
    assert seen == {name: len(rows) for name, rows in columns.items()}


def test_types_select_and_misspelled_ones_are_errors(tmp_path: Path, thousand: Records) -> None:
    path = written(tmp_path, tlog_bytes(thousand))
    assert list(decode(path, ["RIDLINK_SEPARATION"])) == ["RIDLINK_SEPARATION"]
    assert list(decode(path, "HEARTBEAT")) == ["HEARTBEAT"]
    assert decode(path, ["HEARTBEAT"]).sources[1, 1].messages == 1000
    assert list(decode(path, ["UNKNOWN"])) == []
    with pytest.raises(UnknownMessageError, match="HEARTBEET"):
        decode(path, ["HEARTBEET"])


def test_raw_streams_have_no_times_and_unknown_messages_keep_their_payload(tmp_path: Path, thousand: Records) -> None:
    unknown = encode_frame(0x123456, b"what\x00ever", 99, seq=3, sysid=9, compid=8)
    path = written(tmp_path, thousand[0][1] + unknown + thousand[1][1], "stream.mavlink")
    columns = decode(path)
    assert columns["HEARTBEAT"]["t_us"].tolist() == [NO_TIME_US]
    (row,) = columns["UNKNOWN"]
    assert (row["msgid"], row["length"], row["sysid"], row["compid"], row["seq"]) == (0x123456, 9, 9, 8, 3)
    assert row["payload"][:9].tobytes() == b"what\x00ever" and not row["payload"][9:].any()


def test_a_field_that_is_called_seq_stands_beside_the_sequence_number(tmp_path: Path) -> None:
    frame = Encoder(1, 1).encode("MISSION_CURRENT", seq=777)
    (row,) = decode(written(tmp_path, tlog_bytes([(START_US, frame)])))["MISSION_CURRENT"]
    assert (row["seq"], row["seq_field"]) == (0, 777)


def test_gaps_and_rejects_are_counted(tmp_path: Path, thousand: Records) -> None:
    data = bytearray(tlog_bytes(thousand[:10] + thousand[15:20]))
    data[len(tlog_bytes(thousand[:5])) + 20] ^= 1
    columns = decode(written(tmp_path, bytes(data)))
    assert columns.rejects.counts == {"bad_checksum": 1} and repr(columns.rejects) == "Rejects({'bad_checksum': 1})"
    assert columns.sources[1, 1] == SourceCount(14, 2, 6, 19)


def test_pieces_are_the_whole(tmp_path: Path) -> None:
    path = written(tmp_path, tlog_bytes(flight(30_000)))
    whole, pieces = decode(path), list(iter_blocks(path, ["OPEN_DRONE_ID_LOCATION"]))
    assert len(pieces) > 2
    joined = np.concatenate([piece["OPEN_DRONE_ID_LOCATION"] for piece in pieces])
    np.testing.assert_array_equal(joined, whole["OPEN_DRONE_ID_LOCATION"])
    assert encode("OPEN_DRONE_ID_LOCATION", joined) == encode("OPEN_DRONE_ID_LOCATION", whole["OPEN_DRONE_ID_LOCATION"])


def test_a_message_that_comes_late_and_often_finds_room(tmp_path: Path) -> None:
    """The room for a message is reckoned from the beginning of the file, which may be unlike the rest."""
    encoder = Encoder(1, 1)
    beats = encoder.encode("HEARTBEAT", type=2)
    first = (beats + encoder.encode("ATTITUDE", roll=1.0)) + beats * 25_000
    rest = b"".join(encoder.encode("ATTITUDE", roll=float(index)) for index in range(30_000))
    rolls = decode(written(tmp_path, first + rest, "f.mavlink"))["ATTITUDE"]["roll"]
    assert rolls.tolist() == [1.0, *map(float, range(30_000))]


@pytest.mark.parametrize("content", [b"", b"no frame in here", None])
def test_what_is_no_capture_raises(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "f.tlog"
    if content is None:
        with pytest.raises(FileNotFoundError):
            decode(path)
        return
    path.write_bytes(content)
    with pytest.raises(CaptureError):
        decode(path)


def test_a_single_line_of_hexadecimal_becomes_a_column(tmp_path: Path) -> None:
    path = tmp_path / "one.hex"
    path.write_text(flight(1)[0][1].hex())
    assert decode(path)["HEARTBEAT"]["offset"].tolist() == [0]


def test_hexadecimal_lines_become_columns_too(tmp_path: Path, thousand: Records) -> None:
    path = written(tmp_path, b"".join(frame.hex().encode() + b"\n" for _, frame in thousand[:9]), "f.hex")
    columns = decode(path)
    assert {name: len(rows) for name, rows in columns.items()} == {
        "HEARTBEAT": 3, "OPEN_DRONE_ID_LOCATION": 3, "RIDLINK_SEPARATION": 3,
    }  # fmt: skip
    assert columns["HEARTBEAT"]["offset"].tolist()[0] == 0 and columns.sources[1, 1].messages == 9


@needs_compiler
def test_memory_does_not_grow_with_the_file(tmp_path: Path, thousand: Records) -> None:
    small, large = (written(tmp_path, tlog_bytes(thousand) * times, f"{times}.tlog") for times in (30, 1500))
    script = (
        "import re,sys\nfrom ridlink.captures.columns import iter_blocks\n"
        "for path in sys.argv[1:]:\n    count = sum(len(piece['HEARTBEAT']) for piece in iter_blocks(path))\n"
        # not ru_maxrss: through fork and exec that remembers the parent
        "    print(count, re.search(r'VmHWM:\\s*(\\d+)', open('/proc/self/status').read())[1])"
    )
    decode(small)  # the compiler's own memory is not what is measured here
    done = subprocess.run([sys.executable, "-c", script, small, large], capture_output=True, text=True, check=True)
    (few, before_kib), (many, after_kib) = (map(int, line.split()) for line in done.stdout.splitlines())
    assert (few, many) == (30 * 334, 1500 * 334)
    assert after_kib - before_kib < 8 * 1024 < large.stat().st_size / 1024
    assert after_kib < 300 * 1024


def test_importing_the_package_stays_instant_and_unknown_names_are_errors() -> None:
    assert ridlink.__all__ == ["decode"]
    assert "decode" in dir(ridlink)  # before it is asked for, too: what a prompt completes
    with pytest.raises(AttributeError, match="nope"):
        _ = ridlink.nope


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_columns_become_the_frames_of_the_codec(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(MESSAGES_BY_NAME)))
    spec = message_spec(name)
    rows = zeros(name, 3)
    expected = b""
    for row in rows:
        payload = data.draw(st.binary(max_size=spec.size)).ljust(spec.size, b"\x00")
        values = spec.layout.unpack(payload)
        payload = spec.layout.pack(*values)  # Python makes signalling NaNs quiet
        at = 0
        for field, kind, length in zip(spec.fields, spec.types, spec.array_lengths, strict=True):
            if length == 0 or kind in ("uint8_t", "char"):
                value = values[at]
                at += 1
                row[column_of(field)] = np.frombuffer(value, "u1") if kind == "uint8_t" and length else value
            else:
                row[column_of(field)] = values[at : at + length]
                at += length
        row["t_us"], row["sysid"], row["compid"], row["seq"] = 1_700_000_000_000_000, 7, 8, 9
        expected += struct.pack(">Q", 1_700_000_000_000_000)
        expected += encode_frame(spec.msgid, payload, spec.crc_extra, seq=9, sysid=7, compid=8)
    assert encode(name, rows, timed=True) == expected


def test_a_file_goes_through_columns_and_back(tmp_path: Path, thousand: Records) -> None:
    heartbeats = [frame for _, frame in thousand[::3]]
    columns = decode(written(tmp_path, tlog_bytes(thousand)))
    assert encode("HEARTBEAT", columns["HEARTBEAT"]) == b"".join(heartbeats)
    assert encode("HEARTBEAT", columns["HEARTBEAT"][::2]) == b"".join(heartbeats[::2])
    assert encode("HEARTBEAT", columns["HEARTBEAT"][:0]) == b""


def test_records_of_another_message_are_refused() -> None:
    with pytest.raises(ValueError, match="records of ATTITUDE"):
        encode("ATTITUDE", zeros("HEARTBEAT", 1))
    with pytest.raises(UnknownMessageError):
        zeros("NOPE", 1)
    spec = message_spec("HEARTBEAT")
    frame = encode_frame(0, encode_payload(spec, {}), spec.crc_extra, seq=0, sysid=0, compid=0)
    assert encode("HEARTBEAT", zeros("HEARTBEAT", 1)) == frame
