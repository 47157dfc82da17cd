"""Lines of hexadecimal: tolerant of how people write it, strict about what it says, rejects by line."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.captures import CaptureKind, open_capture, read_messages
from ridlink.captures.hexlines import MAX_LINE_LENGTH, looks_like_hex, read_hex
from ridlink.captures.records import Record, Rejects
from ridlink.errors import CaptureError
from ridlink.remote_id.astm import encode_message
from ridlink.remote_id.astm_pack import join_pack
from ridlink.remote_id.messages import BasicId, Location, Separation
from tests.captures.command import run
from tests.captures.conftest import flight
from tests.remote_id import radio_frames

IDENTITY = encode_message(BasicId(1, 2, b"SERIAL"))
LOCATION = encode_message(Location(latitude_deg=47.4, longitude_deg=8.5))
SEPARATION = encode_message(Separation(horizontal_error_m=4.0))
PACK = join_pack([IDENTITY, LOCATION, SEPARATION])
FRAMES = [frame for _, frame in flight(5)]


def read(text: bytes, chunk: int = 50) -> tuple[list[Record], Rejects]:
    rejects = Rejects()
    return list(read_hex((text[at : at + chunk] for at in range(0, len(text), chunk)), rejects)), rejects


def names(path: Path) -> list[str]:
    return [record.name.removeprefix("OPEN_DRONE_ID_") for record in read_messages(path)]


def test_a_line_is_a_message_a_pack_or_a_frame(tmp_path: Path) -> None:
    path = tmp_path / "lines.txt"
    path.write_text("\n".join(part.hex() for part in (LOCATION, PACK, *FRAMES[:2], SEPARATION)))
    assert names(path) == [
        "LOCATION", "BASIC_ID", "LOCATION", "RIDLINK_SEPARATION", "HEARTBEAT", "LOCATION", "RIDLINK_SEPARATION",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("frame", "transport", "members"),
    [
        (radio_frames.odid_beacon(), "wifi-beacon", 3),
        (radio_frames.nan(), "wifi-nan", 3),
        (radio_frames.legacy(LOCATION), "bt4", 1),
        (radio_frames.extended(), "bt5", 3),
    ],
)
def test_a_line_is_a_frame_of_the_air(tmp_path: Path, frame: bytes, transport: str, members: int) -> None:
    path = tmp_path / "lines.txt"
    path.write_text(f"# heard\n{frame.hex()}\n")
    rows = [json.loads(line) for line in run(path, "-f", "jsonl").stdout.splitlines()]
    assert [(row["transport"], row["counter"], row["index"]) for row in rows] == [
        (transport, 7, index) for index in range(members)
    ]
    assert {row["mac"] for row in rows} == {radio_frames.MAC.hex(":")}


def test_frames_of_the_air_are_refused_by_line() -> None:
    empty = radio_frames.beacon(radio_frames.element(0xDD, b"\xfa\x0b\xbc\x0d"))
    frames = (radio_frames.odid_beacon(PACK[:-1]), radio_frames.beacon(b""), empty)
    records, rejects = read("\n".join(frame.hex() for frame in frames).encode())
    assert len(records) == 2
    assert rejects.first_offset == {"truncated_pack": 1, "wrong_length": 2, "truncated": 3}


@pytest.mark.parametrize(
    "line",
    [
        LOCATION.hex(),
        LOCATION.hex().upper(),
        LOCATION.hex(" "),
        LOCATION.hex(":"),
        LOCATION.hex("-", 4),
        "0x" + LOCATION.hex(),
        " ".join(f"0x{byte:02X}" for byte in LOCATION),
        ", ".join(f"0x{byte:02x}" for byte in LOCATION),
        f"\t {LOCATION.hex()}   # a comment: 00 11",
        LOCATION.hex() + "\r",
    ],
)
@pytest.mark.parametrize("chunk", [1, 1000])
def test_people_write_hexadecimal_in_many_ways(line: str, chunk: int) -> None:
    (record,), rejects = read(f"# what follows\n\n{line}\n".encode(), chunk)
    assert record.frame.msgid == 12901 and record.time_us is None and not rejects
    assert record.offset == len("# what follows\n\n")


def test_rejects_stand_at_their_lines() -> None:
    lines = [
        "# rejects",
        LOCATION.hex(),
        "no hexadecimal",
        LOCATION.hex()[:-1],
        LOCATION.hex()[:-2],
        LOCATION.hex() + "00",
        "62" + "00" * 24,
        PACK.hex()[:-2],
        FRAMES[0].hex()[:-2] + "00",
        FRAMES[0].hex()[:-6],
        "f2190a",
        FRAMES[0].hex(),
    ]
    records, rejects = read("\n".join(lines).encode())
    assert len(records) == 1 + 2 + 1
    assert {cause: (rejects.counts[cause], rejects.first_offset[cause]) for cause in rejects.counts} == {
        "not_hexadecimal": (2, 3), "wrong_length": (2, 5), "unknown_message_type": (1, 7), "truncated_pack": (1, 8),
        "bad_checksum": (1, 9), "truncated": (1, 10), "bad_message_count": (1, 11),
    }  # fmt: skip
    assert "2 not_hexadecimal (first at line 3)" in str(rejects)


def test_a_line_without_end_costs_no_memory() -> None:
    def chunks() -> Any:
        yield LOCATION.hex().encode() + b"\n"
        for _ in range(1000):
            yield b"0" * 10_000
        yield b"\n" + LOCATION.hex().encode()

    rejects = Rejects()
    records = list(read_hex(chunks(), rejects))
    assert [record.offset for record in records] == [0, 51 + 10_000_000 + 1]
    assert rejects.counts == {"line_too_long": 1} and rejects.first_offset["line_too_long"] == 2
    assert read(b"0" * (MAX_LINE_LENGTH + 1))[1].counts == {"line_too_long": 1}


# --- formats told apart ---


@pytest.mark.parametrize("name", ["file.hex", "file.txt", "file.tlog", "file"])
@pytest.mark.parametrize("first", [LOCATION, PACK, FRAMES[0]])
def test_the_content_tells_hexadecimal_whatever_its_name(tmp_path: Path, name: str, first: bytes) -> None:
    path = tmp_path / name
    path.write_text(f"# comment\nnot this one\n{first.hex(' ')}\n")
    with open_capture(path) as capture:
        assert capture.kind is CaptureKind.HEX and list(capture)


@pytest.mark.parametrize(
    "text",
    [b"", b"root:x:0:0:root:/root:/bin/bash\n", b"deadbeef\n", b"62" + b"00" * 24, b"fd09\n", b"\x00" * 50,
     LOCATION.hex().encode() + b"\n\xff", b"20" * 30],
)  # fmt: skip
def test_what_is_no_hexadecimal_of_ours_is_not_taken_for_it(text: bytes) -> None:
    assert not looks_like_hex(text)


def test_a_hex_file_without_anything_of_ours_is_an_error_that_says_where(tmp_path: Path) -> None:
    path = tmp_path / "x.hex"
    path.write_text(":10010000214601360121470136007EFE09D2190140\n" * 3)
    with open_capture(path) as capture, pytest.raises(CaptureError, match=r"3 wrong_length \(first at line 1\)"):
        list(capture)


# --- properties ---

parts = st.sampled_from([LOCATION, PACK, SEPARATION, IDENTITY, *FRAMES])


@given(st.lists(parts | st.binary(max_size=60), max_size=10), st.integers(1, 200))
def test_however_it_is_cut_the_same_records_come_out(lines: list[bytes], chunk: int) -> None:
    text = b"\n".join(line.hex().encode() for line in lines)
    records, rejects = read(text, chunk)
    whole, whole_rejects = read(text, 10**6)
    assert records == whole and rejects.counts == whole_rejects.counts


@given(st.binary(max_size=400))
def test_any_bytes_are_read(data: bytes) -> None:
    looks_like_hex(data)
    records, _ = read(data)
    assert all(0 <= record.offset < len(data) for record in records)


def test_noise_costs_no_good_line() -> None:
    lines = [part.hex().encode() for part in (LOCATION, PACK, *FRAMES)] * 20
    noise = random.Random(7)
    noisy = [line for good in lines for line in (noise.randbytes(30).replace(b"\n", b""), good)]
    assert [record.frame.msgid for record in read(b"\n".join(noisy))[0]] == [
        record.frame.msgid for record in read(b"\n".join(lines))[0]
    ]


# --- the command ---


def test_rows_of_25_bytes_carry_them(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_text(f"{LOCATION.hex(' ')}\nwrong\n{FRAMES[0].hex()}\n{PACK.hex()}\n")
    result = run(path, "--in", "hex", "-f", "jsonl")
    rows = [json.loads(line) for line in result.stdout.splitlines()]
    assert list(rows[0]) == ["t", "index", "type", "hex", "fields"]
    assert (rows[0]["t"], rows[0]["hex"], rows[0]["fields"]["latitude_deg"]) == (None, LOCATION.hex(), 47.4)
    assert rows[0]["fields"]["id_or_mac"] is None
    assert list(rows[1]) == ["t", "src", "seq", "type", "id", "fields"]
    assert [row["index"] for row in rows[2:]] == [0, 1, 2] and rows[4]["type"] == "RIDLINK_SEPARATION"
    assert "1 not_hexadecimal (first at line 2)" in result.stderr
    (statistics,) = [json.loads(line) for line in run(path, "--stats", "-f", "jsonl").stdout.splitlines()]
    assert statistics["rejects"] == [{"file": str(path), "cause": "not_hexadecimal", "count": 1, "first_line": 2}]
    assert statistics["transmitters"] == {"-": {"-": 4}}
    assert "first at line" in run(path, "--stats").stdout
    assert "      -   -  OPEN_DRONE_ID_LOCATION" in run(path).stdout
