"""``ridlink encode``: what was decoded comes back, byte by byte, or is said to be lost."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ridlink.captures import decode_records
from ridlink.captures.export.from_lines import frame_of_line, from_text
from ridlink.captures.lines import json_line
from ridlink.captures.records import Record
from ridlink.cli.decode import decode
from ridlink.cli.encode import encode
from ridlink.errors import WireError
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES_BY_NAME, Encoder
from ridlink.mavlink.frames import Frame, encode_frame, parse_datagram
from ridlink.remote_id.text import display_text
from tests.captures.conftest import START_US, flight, tlog_bytes
from tests.captures.drawn import signed, version_1

REAL = Path(__file__).resolve().parents[3] / "shared" / "captures" / "real_autopilot.tlog"
PACK_MEMBER = bytes.fromhex("0212") + b"AIRCRAFT-1".ljust(23, b"\x00")


def run(command: Any, *arguments: str | Path, **options: Any) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments], standalone_mode=False, **options)


def there_and_back(path: Path, *options: str) -> tuple[bytes, Result]:
    """A dump decoded to lines and encoded again."""
    lines, back = path.with_suffix(".jsonl"), path.with_name(f"back{path.suffix}")
    assert run(decode, path, "-f", "jsonl", "-o", lines, *options).return_value == 0
    result = run(encode, lines, "-o", back)
    return back.read_bytes(), result


def lines_file(tmp_path: Path, *rows: dict[str, Any] | str) -> Path:
    path = tmp_path / "rows.jsonl"
    path.write_text("".join((row if isinstance(row, str) else json.dumps(row)) + "\n" for row in rows))
    return path


@pytest.mark.parametrize("options", [[], ["--frames"]])
@pytest.mark.parametrize("suffix", [".tlog", ".mavlink"])
def test_an_intact_dump_comes_back_byte_by_byte(tmp_path: Path, suffix: str, options: list[str]) -> None:
    path = tmp_path / f"flight{suffix}"
    records = flight(300)
    path.write_bytes(tlog_bytes(records) if suffix == ".tlog" else b"".join(frame for _, frame in records))
    back, result = there_and_back(path, *options)
    assert back == path.read_bytes()
    assert result.stdout == f"{path.with_name('back' + suffix)}: 300 frames\n" and result.stderr == ""


def test_hexadecimal_comes_back_line_by_line(tmp_path: Path) -> None:
    path = tmp_path / "some.hex"
    frames = [frame.hex() for _, frame in flight(6)]
    path.write_text("".join(f"{line}\n" for line in (*frames, PACK_MEMBER.hex())))
    assert there_and_back(path)[0] == path.read_bytes()


def test_with_frames_everything_comes_back_whatever_it_is(tmp_path: Path) -> None:
    path = tmp_path / "odd.tlog"
    pack = Encoder(1, 1).encode(
        "OPEN_DRONE_ID_MESSAGE_PACK", single_message_size=25, msg_pack_size=2, messages=PACK_MEMBER * 2
    )
    frames = [
        signed(12901, b"\x07" * 59, CRC_EXTRAS[12901]),
        version_1(0, bytes(9), CRC_EXTRAS[0]),
        encode_frame(54321, b"unknown", 7, seq=1, sysid=2, compid=3),
        Encoder(1, 1).encode("ATTITUDE", roll=float("nan"), pitch=float("inf")),
        pack,
        Encoder(4, 5).encode("OPEN_DRONE_ID_LOCATION", direction=40000, target_system=9),
        flight(1)[0][1],
    ]
    path.write_bytes(tlog_bytes([(START_US + index, frame) for index, frame in enumerate(frames)]))
    assert there_and_back(path, "--frames")[0] == path.read_bytes()


def test_without_frames_signatures_and_unknown_messages_are_lost_and_said(tmp_path: Path) -> None:
    path = tmp_path / "odd.tlog"
    unknown = encode_frame(54321, b"unknown", 7, seq=1, sysid=2, compid=3)
    whole = signed(0, b"\x01" * 9, CRC_EXTRAS[0])
    path.write_bytes(tlog_bytes([(START_US, whole), (START_US + 1, unknown), (START_US + 2, whole)]))
    back, result = there_and_back(path)
    unsigned = encode_frame(0, b"\x01" * 9, CRC_EXTRAS[0], seq=7, sysid=2, compid=1)
    assert back == tlog_bytes([(START_US, unsigned), (START_US + 2, unsigned)])
    assert "1 of 3 lines not encoded; line 2: " in result.stderr and "--frames" in result.stderr


@pytest.mark.parametrize("frames", [True, False])
def test_a_real_recording_comes_back(tmp_path: Path, frames: bool) -> None:
    if not REAL.exists():
        pytest.skip("the recording of real autopilots is not part of the project")
    path = tmp_path / "real.tlog"
    path.write_bytes(REAL.read_bytes())
    back, _ = there_and_back(path, *(["--frames"] if frames else []))
    if frames:
        assert back == path.read_bytes()
    else:  # a third of it is signed or unknown
        assert 15_000 < run(decode, path.with_name("back.tlog"), "-f", "jsonl").stdout.count("\n") < 19_887


@pytest.mark.parametrize("name", sorted(MESSAGES_BY_NAME))
def test_a_frame_of_zeros_made_anew_says_the_same(name: str) -> None:
    """Much of what is unknown is a zero on the wire and a null in the line, which is no missing field."""
    spec = MESSAGES_BY_NAME[name]
    raw = encode_frame(spec.msgid, b"\x00", spec.crc_extra, seq=4, sysid=5, compid=6)
    (frame,) = parse_datagram(raw, CRC_EXTRAS)
    assert isinstance(frame, Frame)
    line, *_ = [json_line(record) for record in decode_records([Record(START_US, frame, 0)])]
    made = frame_of_line(line)
    assert made is not None and made.frame == raw


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_frames_made_anew_say_the_same(data: st.DataObject) -> None:
    """Decoding what the line of a frame encodes to gives that line again, if none of its values was out of range."""
    spec = MESSAGES_BY_NAME[data.draw(st.sampled_from(sorted(MESSAGES_BY_NAME)))]
    payload = data.draw(st.binary(min_size=1, max_size=spec.size))
    assume(b"\\x" not in payload)  # a sender's own backslash looks like ours
    raw = encode_frame(spec.msgid, payload, spec.crc_extra, seq=4, sysid=5, compid=6)
    frame = parse_datagram(raw, CRC_EXTRAS)[0]
    assert isinstance(frame, Frame)
    records = list(decode_records([Record(START_US, frame, 0)]))
    line, *members = map(json_line, records)
    made = frame_of_line(line)
    assert made is not None and made.time_us == START_US
    again = parse_datagram(made.frame, CRC_EXTRAS)[0]
    assert isinstance(again, Frame)
    if not any(record.refused for record in records):
        assert json_line(next(decode_records([Record(START_US, again, 0)]))) == line
    assert all(frame_of_line(member) is None for member in members)


@given(st.binary(max_size=50))
def test_texts_come_back(raw: bytes) -> None:
    assume(b"\\x" not in raw)  # a sender's own backslash looks like ours
    assert from_text(display_text(raw)) == raw.rstrip(b"\x00")


def test_broadcasts_become_what_a_receiver_makes_of_them(tmp_path: Path) -> None:
    path, out = tmp_path / "air.hex", tmp_path / "air.tlog"
    path.write_text(f"{PACK_MEMBER.hex()}\n")
    run(decode, path, "-f", "jsonl", "-o", tmp_path / "air.jsonl")
    result = run(encode, tmp_path / "air.jsonl", "-o", out)
    (row,) = [json.loads(line) for line in run(decode, out, "-f", "jsonl").stdout.splitlines()]
    assert (row["src"], row["type"], row["fields"]["uas_id"]) == ("0/236", "OPEN_DRONE_ID_BASIC_ID", "AIRCRAFT-1")
    assert "1 line without a time" in result.stderr


HEARTBEAT = {"t": 1.5, "src": "1/1", "seq": 3, "type": "HEARTBEAT", "fields": {"type": 2}}


@pytest.mark.parametrize(
    "row",
    [
        "not json",
        "[]",
        "{}",
        '{"type":"HEARTBEAT","t":"soon"}',
        '{"type":"HEARTBEAT","t":-1.5}',
        '{"type":"HEARTBEAT","t":1e300}',
        '{"type":"HEARTBEAT","t":99999999999999.0}',
        HEARTBEAT | {"type": "HEARTBEET"},
        HEARTBEAT | {"src": "1"},
        HEARTBEAT | {"src": "1/999"},
        HEARTBEAT | {"seq": 256},
        HEARTBEAT | {"fields": {"type": 256}},
        HEARTBEAT | {"fields": {"nope": 1}},
        HEARTBEAT | {"fields": {"type": "x"}},
        HEARTBEAT | {"frame": "zz"},
        HEARTBEAT | {"frame": "fd00"},
        HEARTBEAT | {"frame": flight(1)[0][1].hex() + "00"},
        HEARTBEAT | {"type": "PARAM_VALUE", "fields": {"param_id": 7}},
        HEARTBEAT | {"type": "PARAM_VALUE", "fields": {"param_id": "\u20ac"}},
        HEARTBEAT | {"type": "BATTERY_STATUS", "fields": {"voltages": [1]}},
        HEARTBEAT | {"type": "OPEN_DRONE_ID_LOCATION", "fields": {"latitude_deg": "x", "longitude_deg": 1.0}},
        HEARTBEAT | {"type": "OPEN_DRONE_ID_LOCATION", "fields": {"latitude": 1}},
        HEARTBEAT | {"type": "OPEN_DRONE_ID_LOCATION", "fields": {"id_or_mac": "zz"}},
        HEARTBEAT | {"type": "OPEN_DRONE_ID_BASIC_ID", "fields": {"id_type": 1, "ua_type": 1, "uas_id": "x" * 21}},
        HEARTBEAT | {"type": "UNKNOWN"},
    ],
)
def test_what_cannot_be_encoded_is_counted_and_the_rest_is_written(tmp_path: Path, row: Any) -> None:
    path, out = lines_file(tmp_path, HEARTBEAT, row, "", HEARTBEAT), tmp_path / "out.tlog"
    result = run(encode, path, "-o", out, "--strict")
    assert result.return_value == 4, result.exception
    assert "1 of 4 lines not encoded; line 2: " in result.stderr and len(result.stderr.splitlines()) == 1
    written = out.read_bytes()
    heartbeat = encode_frame(0, bytes([0, 0, 0, 0, 2]), CRC_EXTRAS[0], seq=3, sysid=1, compid=1)
    assert written == tlog_bytes([(1_500_000, heartbeat)]) * 2
    assert run(encode, path, "-o", out).return_value == 0


LINE = json.dumps(HEARTBEAT | {"frame": flight(1)[0][1].hex(), "hex": "00", "fields": {"type": 2, "x": "é"}}).encode()


@given(st.binary(max_size=80), st.integers(0, len(LINE)), st.integers(0, 8))
def test_any_line_is_a_frame_or_refused(junk: bytes, at: int, cut: int) -> None:
    for line in (junk, LINE[:at] + junk + LINE[at + cut :]):
        with contextlib.suppress(WireError):
            frame_of_line(line)


def test_a_line_that_is_no_utf_8_is_refused() -> None:
    with pytest.raises(WireError, match=r"(?i)utf-8"):
        frame_of_line(b'{"type":"HEARTBEAT\xfd"}')


def test_times_are_exact_to_the_microsecond_however_large(tmp_path: Path) -> None:
    exact = {"1700000000.123457": 1_700_000_000_123_457, "4611686018427.387904": 2**62, "7": 7_000_000}
    for text, time_us in exact.items():
        found = frame_of_line(f'{{"type":"HEARTBEAT","src":"1/1","t":{text}}}'.encode())
        assert found is not None and found.time_us == time_us
    with pytest.raises(WireError):
        frame_of_line(b'{"type":"HEARTBEAT","t":1.2345678}')


def test_a_line_without_an_end_costs_itself_alone(tmp_path: Path) -> None:
    path = lines_file(tmp_path, HEARTBEAT, '{"type":"' + "x" * 200_000, HEARTBEAT)
    result = run(encode, path, "-o", tmp_path / "out.mavlink")
    assert "1 of 3 lines not encoded; line 2: longer than" in result.stderr
    assert len((tmp_path / "out.mavlink").read_bytes()) == 2 * len(Encoder(1, 1).encode("HEARTBEAT", type=2))


def test_the_format_is_told_by_the_suffix_or_said(tmp_path: Path) -> None:
    path = lines_file(tmp_path, HEARTBEAT)
    command = [sys.executable, "-m", "ridlink", "encode", str(path), "-o"]
    done = subprocess.run([*command, str(tmp_path / "out.bin")], capture_output=True, text=True)
    assert done.returncode == 2 and "--to" in done.stderr and not (tmp_path / "out.bin").exists()
    piped = subprocess.run([*command, "-", "--to", "hex"], capture_output=True, text=True)
    assert piped.returncode == 0
    assert bytes.fromhex(piped.stdout)[0] == 0xFD and piped.stderr == "-: 1 frame\n"


def test_of_an_encoder_that_a_signal_ends_nothing_stays(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ridlink", "encode", "-", "-o", str(tmp_path / "out.tlog")]
    line = b'{"t":1700000000.0,"src":"1/1","seq":0,"type":"HEARTBEAT","id":0,"fields":{"type":2}}\n'
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        process.stdin.write(line * 3000)  # more than a pipe takes: the reader has begun
        process.stdin.flush()
        assert [path.name[:9] for path in tmp_path.iterdir()] == [".out.tlog"]
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=30)
    assert process.returncode == 128 + signal.SIGTERM and list(tmp_path.iterdir()) == []


def test_nothing_is_left_of_what_cannot_be_read(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ridlink", "encode", str(tmp_path / "absent.jsonl"), "-o"]
    done = subprocess.run([*command, str(tmp_path / "o.tlog")], capture_output=True, text=True)
    assert done.returncode == 3 and len(done.stderr.splitlines()) == 1 and list(tmp_path.iterdir()) == []


def test_a_decoder_before_us_that_gave_nothing_leaves_what_stands_under_the_name(tmp_path: Path) -> None:
    out = tmp_path / "out.tlog"
    out.write_bytes(b"a flight")
    command = [sys.executable, "-m", "ridlink", "encode", "-", "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, input="")
    assert (done.returncode, done.stdout, done.stderr) == (3, "", "ridlink: standard input is empty\n")
    assert out.read_bytes() == b"a flight"


def test_where_no_line_can_be_encoded_what_stands_under_the_name_stays(tmp_path: Path) -> None:
    path, out = lines_file(tmp_path, "no", "lines", "of", "decode"), tmp_path / "out.tlog"
    out.write_bytes(b"a flight")
    command = [sys.executable, "-m", "ridlink", "encode", str(path), "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (3, "") and out.read_bytes() == b"a flight"
    (line,) = done.stderr.splitlines()
    assert "no line that can be encoded; line 1: " in line


def test_a_field_that_is_none_and_where_it_was_read_are_told_by_their_names(tmp_path: Path) -> None:
    line = json.dumps({"t": 1, "src": "1/1", "seq": 0, "type": "HEARTBEAT", "fields": {"tipe": 2}})
    result = run(encode, "-", "-o", tmp_path / "a.tlog", input=line)
    assert (
        str(result.exception) == "standard input has no line that can be encoded; line 1: HEARTBEAT has no field 'tipe'"
    )
