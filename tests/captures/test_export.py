"""Captures into other formats: the same lines faster, tables, maps, joined rows; inert, and whole or not at all."""

from __future__ import annotations

import csv
import importlib
import json
import math
import os
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import structs

from ridlink.captures import decode_records, open_capture, reader
from ridlink.captures.export.block_lines import BlockLines
from ridlink.captures.export.fields import Fields, fields_of_block, fields_of_records
from ridlink.captures.export.framed import framed_line
from ridlink.captures.export.geo import cut_at_antimeridian
from ridlink.captures.export.join import COLUMNS, MAX_SENDERS, Joiner, join
from ridlink.captures.export.selection import Selection
from ridlink.captures.fast.blocks import BlockReader
from ridlink.captures.lines import json_line, table_line
from ridlink.mavlink.codec import MESSAGES_BY_NAME, Encoder
from ridlink.mavlink.frames import encode_frame
from ridlink.remote_id.astm_pack import encode_pack
from ridlink.remote_id.messages import Authentication, BasicId, Location, RemoteIdMessage, Separation
from ridlink.remote_id.separation import authentication_of
from tests.captures.command import run
from tests.captures.conftest import START_US, aircraft, flight, frame_of, needs_compiler, tlog_bytes
from tests.captures.drawn import ABOUT_REMOTE_ID, PACK_MEMBER, any_frame
from tests.captures.pcap_files import ethernet, ipv4, pcap, timed, udp

REAL = Path(__file__).resolve().parents[3] / "shared" / "captures" / "real_autopilot.tlog"
HOSTILE = b"=1<b>&]]>'\x1b[2J,\"../x"
HOSTILE_TEXT = "=1<b>&]]>'\\x1b[2J,\"../x"


FORMS = {"jsonl": json_line, "table": table_line, "jsonl with frames": lambda one: framed_line(json_line(one), one)}


def one_by_one(path: Path, selection: Selection, form: str) -> bytes:
    """Lines as the reader of records gives them."""
    with open_capture(path) as capture:
        chosen = [record for record in decode_records(capture) if selection.takes(record)]
    return b"".join(map(FORMS[form], chosen))


def by_blocks(path: Path, selection: Selection, form: str) -> bytes:
    lines = BlockLines(selection, form.split()[0], frames=form.endswith("frames"))
    return b"".join(bytes(lines.of(block)) for block in BlockReader(path, block_length=4096))


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What the compiler says is said before a test looks at standard error."""
    for kind in ("tlog", "mavlink"):
        path = tmp_path_factory.mktemp("compiled") / f"f.{kind}"
        path.write_bytes(tlog_bytes(flight(3)) if kind == "tlog" else b"".join(frame for _, frame in flight(3)))
        assert by_blocks(path, Selection(), "jsonl")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "air.tlog"
    path.write_bytes(tlog_bytes(aircraft(uas_id=HOSTILE)))
    return path


# --- JSON lines ---


def float_bits(value: float) -> int:
    return int.from_bytes(struct.pack("<f", value), "little")


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    frames=st.lists(any_frame(), min_size=1, max_size=12),
    first_us=st.sampled_from([START_US, 0, 999_999, 10**15 - 5, 253_402_300_800_000_000 - 3, 2**62]),
    kind=st.sampled_from(["tlog", "mavlink"]),
    selection=st.builds(
        Selection,
        names=st.none() | st.frozensets(st.sampled_from([*ABOUT_REMOTE_ID, "UNKNOWN"]), max_size=5),
        source_system=st.none() | st.integers(0, 3),
        since_us=st.none() | st.sampled_from([START_US + 2, 0]),
        until_us=st.none() | st.sampled_from([START_US + 4, 2**63]),
    ),
    form=st.sampled_from(list(FORMS)),
)
def test_lines_from_columns_are_those_of_the_writer(
    tmp_path: Path, frames: list[bytes], first_us: int, kind: str, selection: Selection, form: str
) -> None:
    path = tmp_path / f"any.{kind}"
    timed = tlog_bytes([(first_us + index, frame) for index, frame in enumerate(frames)])
    path.write_bytes(timed if kind == "tlog" else b"".join(frames))
    assert by_blocks(path, selection, form) == one_by_one(path, selection, form)


def near_ten_digits(digits: int, exponent: int, steps: int) -> float:
    """A number in the middle between two of ten digits, or so many of the least steps beside it."""
    value = float(f"{digits}5e{exponent - 11}")
    for _ in range(abs(steps)):
        value = math.nextafter(value, math.copysign(math.inf, steps))
    return value


BITS_32, BITS_64 = st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)
DOUBLES = st.one_of(
    st.floats(),
    st.integers(-(10**16), 10**16).map(lambda scaled: scaled / 1e7),
    st.sampled_from([-0.0, 1e-7, 9.9e-6, 1e-5, 1e8, 1e15, 1e16, 2.0**53, 123456789.1234567, 0.1 + 0.2, 5e-324]),
    st.builds(near_ten_digits, st.integers(1, 10**10), st.integers(-6, 12), st.integers(-3, 3)),
).map(lambda value: int.from_bytes(struct.pack("<d", value), "little"))


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    floats=st.lists(st.tuples(*[BITS_32 | st.floats(width=32).map(float_bits)] * 3), min_size=1, max_size=5),
    doubles=st.lists(DOUBLES, min_size=16, max_size=16),
    large=st.lists(st.one_of(BITS_64, st.sampled_from([0, 2**62 - 1, 2**62, 2**63 - 1, 2**63, 2**64 - 1]))),
    form=st.sampled_from(["jsonl", "table"]),
)
def test_numbers_of_every_size_are_written_alike(
    tmp_path: Path, floats: list[tuple[int, int, int]], doubles: list[int], large: list[int], form: str
) -> None:
    """All bit patterns, signalling NaNs too: from integers on the wire, and from floats of 32 and 64 bits."""
    attitudes = [bytes(4) + struct.pack("<3I", *bits) for bits in floats]
    payloads = [("ATTITUDE", payload) for payload in attitudes]
    payloads += [("TIMESYNC", struct.pack("<2Q", value, value ^ 1)) for value in large]
    payloads += [("WHEEL_DISTANCE", struct.pack("<17QB", value, *doubles, 7)) for value in large or [0]]
    specs = [MESSAGES_BY_NAME[name] for name, _ in payloads]
    frames = [
        encode_frame(spec.msgid, payload, spec.crc_extra, seq=0, sysid=1, compid=1)
        for spec, (_, payload) in zip(specs, payloads, strict=True)
    ]
    path = tmp_path / "numbers.tlog"
    path.write_bytes(tlog_bytes([(START_US + index, frame) for index, frame in enumerate(frames)]))
    assert by_blocks(path, Selection(), form) == one_by_one(path, Selection(), form)


@needs_compiler
@pytest.mark.parametrize(
    "options",
    [[], ["--types", "OPEN_*,HEARTBEAT"], ["--source-system", "2"], ["-f", "jsonl"], ["-f", "jsonl", "--frames"]],
)
def test_lines_of_a_real_recording_are_the_same(monkeypatch: pytest.MonkeyPatch, options: list[str]) -> None:
    if not REAL.exists():
        pytest.skip("the recording of real autopilots is not part of the project")
    outputs = []
    for large in (10**12, 0):
        monkeypatch.setattr(reader, "LARGE_BYTES", large)
        done = run(REAL, *options)
        assert done.return_value == 0
        outputs.append(done.stdout_bytes)
    assert outputs[0] == outputs[1]
    assert outputs[0].count(b"\n") > 100


@pytest.mark.parametrize("limit", ["-1e20", "-1", "0", "1e12", "18446744073709.551615", "1e20"])
def test_limits_beyond_all_times_are_limits_in_large_files_too(
    log: Path, monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    for option in ("--since", "--until"):
        results = []
        for large in (10**12, 0):
            monkeypatch.setattr(reader, "LARGE_BYTES", large)
            done = run(log, "-f", "jsonl", f"{option}={limit}")
            results.append((done.stdout_bytes, done.stderr, done.return_value))
        assert results[0] == results[1]
        assert bool(results[0][0]) == ((option == "--since") == (float(limit) < 1e12))


def test_large_files_report_damage_like_small_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "f.tlog"
    data = bytearray(tlog_bytes(flight(100)))
    data[500] ^= 1
    path.write_bytes(data[:-3])
    results = []
    for large in (10**12, 0):
        monkeypatch.setattr(reader, "LARGE_BYTES", large)
        done = run(path, "-f", "jsonl", "--strict")
        results.append((done.stdout_bytes, done.stderr, done.return_value))
    assert results[0] == results[1]
    assert results[0][2] == 4 and "1 bad_timestamp (first at byte 499), 1 truncated" in results[0][1]


def test_fields_are_the_same_from_blocks_and_from_records(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    pack = Encoder(1, 1).encode(
        "OPEN_DRONE_ID_MESSAGE_PACK", single_message_size=25, msg_pack_size=2, messages=PACK_MEMBER * 2
    )
    path.write_bytes(tlog_bytes([*flight(30), (START_US + 10**6, pack)]))
    with open_capture(path) as capture:
        expected = list(fields_of_records(decode_records(capture)))
    found = [fields for block in BlockReader(path) for fields in fields_of_block(block, Selection())]
    assert found == expected and len(found) == 33


# --- tables ---


def table(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as stream:
        return list(csv.DictReader(stream))


def test_f32_csv_is_one_file_a_message_and_formulas_are_texts(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "tables"
    done = run(log, "-f", "csv", "-o", out)
    names = ["OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_LOCATION", "OPEN_DRONE_ID_SYSTEM", "RIDLINK_SEPARATION"]
    assert sorted(path.name for path in out.iterdir()) == [f"{name}.csv" for name in names]
    assert str(out) in done.stderr and done.stdout == ""
    (first, *_) = table(out / "OPEN_DRONE_ID_BASIC_ID.csv")
    assert first["uas_id"] == "'" + HOSTILE_TEXT
    assert (first["t"], first["src"], first["seq"], first["offset"]) == ("1700000000.123456", "1/1", "0", "0")
    location = table(out / "OPEN_DRONE_ID_LOCATION.csv")[1]
    assert float(location["latitude_deg"]) == 47.0001 and location["altitude_barometric_m"] == ""
    assert b"\x1b" not in b"".join(path.read_bytes() for path in out.iterdir())


def test_csv_of_other_messages(tmp_path: Path) -> None:
    encoder = Encoder(1, 1)
    frames = [
        encoder.encode("ATTITUDE", roll=float("nan"), pitch=-0.5),
        encoder.encode("MISSION_CURRENT", seq=-0 + 7),
        encoder.encode("BATTERY_STATUS", voltages=list(range(10)), temperature=-7),
        encoder.encode("PARAM_VALUE", param_id=b"@SYS"),
        encode_frame(54321, b"\x01\x02", 0, seq=1, sysid=1, compid=1),
    ]
    path, out = tmp_path / "f.tlog", tmp_path / "out"
    path.write_bytes(tlog_bytes([(START_US + index, frame) for index, frame in enumerate(frames)]))
    run(path, "-f", "csv", "-o", out)
    (attitude,) = table(out / "ATTITUDE.csv")
    assert (attitude["roll"], attitude["pitch"]) == ("", "-0.5")
    (mission,) = table(out / "MISSION_CURRENT.csv")
    assert (mission["seq"], mission["seq_field"]) == ("1", "7")
    (battery,) = table(out / "BATTERY_STATUS.csv")
    assert battery["voltages"] == "[0,1,2,3,4,5,6,7,8,9]" and battery["temperature"] == "-7"
    assert table(out / "PARAM_VALUE.csv")[0]["param_id"] == "'@SYS"
    assert table(out / "UNKNOWN.csv")[0]["payload"] == "0102"


@pytest.mark.parametrize("suffix", ["tlog", "pcap"])
def test_fields_that_are_called_as_a_column_do_not_take_its_place(tmp_path: Path, suffix: str) -> None:
    """MANUAL_CONTROL has a ``t``, which was taken for the time, and COLLISION a ``src``."""
    encoder = Encoder(7, 1)
    frames = [encoder.encode("MANUAL_CONTROL", t=-7), encoder.encode("COLLISION", src=1)]
    path = tmp_path / f"f.{suffix}"
    packets = timed([ethernet(ipv4(udp(frame))) for frame in frames])
    path.write_bytes(pcap(packets) if suffix == "pcap" else tlog_bytes([(START_US, frame) for frame in frames]))
    assert run(path, "-f", "csv", "-o", tmp_path / "csv").return_value == 0
    (manual,), (collision,) = (table(tmp_path / "csv" / f"{name}.csv") for name in ("MANUAL_CONTROL", "COLLISION"))
    assert (manual["t"], manual["src"], manual["t_field"]) == ("1700000000.123456", "7/1", "-7")
    assert (collision["src"], collision["src_field"]) == ("7/1", "1")
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is in the extra 'export'")
    assert run(path, "-f", "parquet", "-o", tmp_path / "columns").return_value == 0
    (manual,) = parquet.read_table(tmp_path / "columns" / "MANUAL_CONTROL.parquet").to_pylist()
    assert (manual["t"].year, manual["src"], manual["t_field"]) == (2023, "7/1", -7)


@pytest.mark.parametrize("suffix", ["tlog", "pcap"])
@pytest.mark.parametrize("output_format", ["csv", "parquet"])
def test_a_message_that_the_dialect_lacks_has_its_row_whatever_the_capture(
    tmp_path: Path, suffix: str, output_format: str
) -> None:
    """It had none where a capture is not read in blocks: of a pcap and of a pipe."""
    frames = [Encoder(1, 1).encode("HEARTBEAT", type=2), encode_frame(54321, b"\x01\x02", 0, seq=1, sysid=1, compid=1)]
    path, out = tmp_path / f"f.{suffix}", tmp_path / "out"
    packets = timed([ethernet(ipv4(udp(frame))) for frame in frames])
    path.write_bytes(pcap(packets) if suffix == "pcap" else tlog_bytes([(START_US, frame) for frame in frames]))
    assert run(path, "-f", output_format, "-o", out).return_value == 0
    if output_format == "csv":
        (row,) = table(out / "UNKNOWN.csv")
        assert (row["src"], row["msgid"], row["payload"]) == ("1/1", "54321", "0102")
    else:
        parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is in the extra 'export'")
        (row,) = parquet.read_table(out / "UNKNOWN.parquet").to_pylist()
        assert (row["src"], row["msgid"], row["payload"]) == ("1/1", 54321, "0102")


def test_broadcasts_come_into_tables_with_their_radio(tmp_path: Path) -> None:
    path, out = tmp_path / "f.hex", tmp_path / "out"
    path.write_text(f"{PACK_MEMBER.hex()}\n{Encoder(1, 1).encode('HEARTBEAT', type=2).hex()}\n")
    run(path, "-f", "csv", "-o", out)
    (heartbeat,) = table(out / "HEARTBEAT.csv")
    assert (heartbeat["t"], heartbeat["src"], heartbeat["type"]) == ("", "1/1", "2")
    assert len(list(out.iterdir())) == 2


def test_parquet_has_types_and_nulls(log: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is in the extra 'export'")
    out = tmp_path / "tables"
    assert run(log, "-f", "parquet", "-o", out).return_value == 0
    found = parquet.read_table(out / "OPEN_DRONE_ID_LOCATION.parquet")
    assert str(found.schema.field("t").type) == "timestamp[us, tz=UTC]"
    assert str(found.schema.field("latitude_deg").type) == "double"
    assert found.column("altitude_barometric_m").to_pylist() == [None] * 6
    assert found.column("latitude_deg").to_pylist() == [47.0, 47.0001, 47.0002, 47.0003, 47.0004, 47.0005]
    moments = found.column("t").to_pylist()
    assert moments[0].isoformat() == "2023-11-14T22:13:20.124456+00:00"
    assert parquet.read_table(out / "OPEN_DRONE_ID_BASIC_ID.parquet").column("uas_id").to_pylist()[0] == HOSTILE_TEXT


@pytest.mark.parametrize("output_format", ["csv", "parquet"])
def test_a_folder_may_have_a_name_that_is_no_text(log: Path, tmp_path: Path, output_format: str) -> None:
    pytest.importorskip("pyarrow.parquet", reason="pyarrow is in the extra 'export'")
    out = tmp_path / os.fsdecode(b"\xff")
    assert run(log, "-f", output_format, "-o", out).return_value == 0
    assert (out / f"OPEN_DRONE_ID_LOCATION.{output_format}").stat().st_size > 0


@pytest.mark.parametrize("output_format", ["csv", "parquet"])
def test_tables_of_a_real_recording_have_all_rows(tmp_path: Path, output_format: str) -> None:
    if not REAL.exists():
        pytest.skip("the recording of real autopilots is not part of the project")
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is in the extra 'export'")
    assert run(REAL, "-f", output_format, "-o", tmp_path / "out").return_value == 0
    (statistics,) = [json.loads(line) for line in run(REAL, "--stats", "-f", "jsonl").stdout.splitlines()]
    rows = {
        path.stem: len(table(path)) if output_format == "csv" else parquet.read_metadata(path).num_rows
        for path in (tmp_path / "out").iterdir()
    }
    assert rows == statistics["types"]


@pytest.mark.parametrize(
    ("module", "arguments"),
    [("pyarrow", ["-f", "parquet"]), ("mcap.writer", ["-f", "mcap"])],
)
def test_a_missing_extra_is_one_line_and_leaves_nothing(
    log: Path, tmp_path: Path, module: str, arguments: list[str]
) -> None:
    script = f"import sys\nsys.modules[{module!r}] = None\nfrom ridlink.cli import main\nmain()"
    command = [sys.executable, "-c", script, "decode", str(log), *arguments, "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and "ridlink[export]" in done.stderr and len(done.stderr.splitlines()) == 1
    assert sorted(tmp_path.iterdir()) == [log]


def test_folders_appear_whole_or_not_at_all(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    assert run(log, "-f", "csv", "-o", out).return_value == 0  # an empty one is taken
    before = {path: path.read_bytes() for path in out.iterdir()}
    again = run(log, "-f", "csv", "-o", out)
    assert isinstance(again.exception, FileExistsError)
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    broken = tmp_path / "broken.tlog"
    broken.write_bytes(b"no frame in here")
    listing = sorted(tmp_path.iterdir())
    assert run(broken, "-f", "csv", "-o", tmp_path / "other").exception is not None
    assert run(log, "-f", "csv", "-o", tmp_path / "nowhere" / "x").exception is not None
    assert sorted(tmp_path.iterdir()) == listing


@pytest.mark.parametrize("name", [".", "link"])
def test_an_empty_folder_that_cannot_be_replaced_is_filled(
    log: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the one that a shell is in, a disk, or a link to one of them."""
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "link").symlink_to(folder)
    monkeypatch.chdir(folder if name == "." else tmp_path)
    (tmp_path / "no.tlog").write_bytes(b"no frame in here")
    assert run(tmp_path / "no.tlog", "-f", "csv", "-o", name).exception is not None and not [*folder.iterdir()]
    assert run(log, "-f", "csv", "-o", name).return_value == 0
    assert len([*folder.glob("*.csv")]) == len([*folder.iterdir()]) > 1
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "link", "no.tlog", log.name}


# --- joined rows ---


def rows_of(result: Result) -> list[dict[str, Any]]:
    return [json.loads(line, parse_constant=pytest.fail) for line in result.stdout.splitlines()]


def test_a_joined_row_is_one_update_of_one_aircraft(log: Path) -> None:
    rows = rows_of(run(log, "--join", "-f", "jsonl"))
    assert len(rows) == 6 and all(list(row) == list(COLUMNS) for row in rows)
    assert [row["timestamp_s"] for row in rows] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    row = rows[2]
    assert (row["uas_id"], row["ua_type"], row["sources"], row["transports"]) == (HOSTILE_TEXT, 2, "1/1", "mavlink")
    assert (row["horizontal_error_m"], row["operator_latitude_deg"], row["received"]) == (3.0, 46.5, 1)
    assert row["t"] == 1700000002.124456


def test_joined_rows_as_csv_and_parquet(log: Path, tmp_path: Path) -> None:
    assert run(log, "--join", "-f", "csv", "-o", tmp_path / "air.csv").return_value == 0
    rows = table(tmp_path / "air.csv")
    assert len(rows) == 6 and rows[0]["uas_id"] == "'" + HOSTILE_TEXT and list(rows[0]) == list(COLUMNS)
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is in the extra 'export'")
    assert run(log, "--join", "-f", "parquet", "-o", tmp_path / "air.parquet").return_value == 0
    found = parquet.read_table(tmp_path / "air.parquet").to_pylist()
    assert len(found) == 6 and found[1]["latitude_deg"] == found[1]["latitude"] == 47.0001
    assert found[1]["groundspeed"] == pytest.approx(19.438, abs=1e-3)
    assert found[1]["altitude"] == pytest.approx(1642.06, abs=0.01)
    assert found[1]["vertical_rate"] == pytest.approx(196.85, abs=0.01)


def heard(name: str, time_us: int | None, transport: str = "mavlink", source: str = "1/1", **fields: Any) -> Fields:
    return Fields(time_us, transport, source, 0, 0, name, {"id_or_mac": None, **fields})


def located(time_us: int | None, timestamp_s: float | None, latitude_deg: float = 47.0, **more: Any) -> Fields:
    return heard(
        "OPEN_DRONE_ID_LOCATION", time_us, latitude_deg=latitude_deg, longitude_deg=8.0, timestamp_s=timestamp_s, **more
    )


def named(uas_id: str, time_us: int = 0, id_type: int = 1, **more: Any) -> Fields:
    return heard("OPEN_DRONE_ID_BASIC_ID", time_us, id_type=id_type, ua_type=2, uas_id=uas_id, **more)


def test_what_several_radios_heard_is_one_row() -> None:
    wifi, bluetooth = {"transport": "wifi-beacon", "source": "90:3a"}, {"transport": "bt5", "source": "aa:bb"}
    messages = [
        named("X"), named("X", **wifi), named("X", **bluetooth),
        located(1_000_000, 10.04), located(1_200_000, 10.0, **wifi), located(1_300_000, 10.1, **bluetooth),
        located(2_000_000, 11.04, 47.1), located(2_100_000, 11.0, 47.1, **wifi),
    ]  # fmt: skip
    rows = list(join(messages))
    assert [(row["transports"], row["received"]) for row in rows] == [("mavlink wifi-beacon bt5", 3),
                                                                      ("mavlink wifi-beacon", 2)]  # fmt: skip
    assert rows[0]["sources"] == "1/1 90:3a aa:bb"


def test_a_hovering_aircraft_keeps_its_updates() -> None:
    messages = [named("X"), *(located(100_000 * index, 0.1 * index) for index in range(20))]
    assert len(list(join(messages))) == 20


def test_who_says_who_it_is_three_seconds_later_is_one_aircraft() -> None:
    messages = [*(located(100_000 * index, 0.1 * index) for index in range(31)), named("X", time_us=3_050_000)]
    messages += [located(100_000 * index, 0.1 * index) for index in range(31, 60)]
    rows = list(join(messages))
    assert len(rows) == 60 and {row["uas_id"] for row in rows} == {"X"}


def test_a_message_whose_time_is_lost_is_of_the_time_of_the_one_before() -> None:
    """Rows of others stay open for their identity, and its own errors find its position."""
    other = {"source": "2/1"}
    lost = [
        located(None, 5.0, **other),
        heard("RIDLINK_SEPARATION", None, timestamp_s=5.0, horizontal_error_m=3.0, **other),
    ]
    crowd = [located(START_US + 10_000 * k, 5.0, 48.0 + k, source=f"{k}/1") for k in range(3, 23)]
    later = [named("X", START_US + 1_000_000), named("Y", START_US + 1_000_000, **other)]
    rows = list(join([located(START_US, 5.0), *crowd, *lost, *later]))
    assert [rows[0]["uas_id"], rows[-1]["uas_id"], len(rows)] == ["X", "Y", 22]
    assert (rows[-1]["t"], rows[-1]["horizontal_error_m"]) == (None, 3.0)


@pytest.mark.parametrize("first", [0, 1], ids=["before", "after"])
def test_what_an_autopilot_says_beside_its_transmitter_is_no_row_of_its_own(first: int) -> None:
    """The same position from the same sender, once with a time and once without, either of them first."""
    rows = []
    for index in range(3):
        two = [located(1_000_000 * index, float(index), 47.0 + index), located(1_000_000 * index, None, 47.0 + index)]
        rows += [two[first], two[1 - first]]
    joined = list(join([named("X"), *rows]))
    assert [(row["timestamp_s"], row["received"]) for row in joined] == [(0.0, 2), (1.0, 2), (2.0, 2)]
    beside = located(0, None, 48.0), located(0, None, 47.0, source="2/1"), located(1_000_000, None, 47.0)
    rows = list(join([located(0, 1.0, 47.0), *beside]))
    assert [row["received"] for row in rows] == [2, 1, 1], "what it says beside it; another sender, and a second later"
    assert rows[0]["latitude_deg"] == 47.0
    assert len(list(join([located(100_000 * index, None) for index in range(5)]))) == 5, "who has no clock moves, too"
    without_log_times = [located(None, None if index else 1.0, 47.0 + index) for index in range(5)]
    assert len(list(join(without_log_times))) == 5, "nobody knows how soon that was"


def test_different_aircraft_at_one_place_stay_apart() -> None:
    second = {"source": "2/1"}
    messages = [named("X"), named("Y", **second), located(0, 5.0), located(10, 5.0, **second)]
    assert [row["uas_id"] for row in join(messages)] == ["X", "Y"]


def test_a_separation_belongs_to_its_own_instant() -> None:
    def separated(time_us: int, timestamp_s: float, error_m: float) -> Fields:
        return heard("RIDLINK_SEPARATION", time_us, timestamp_s=timestamp_s, horizontal_error_m=error_m, flags=0)

    messages = [
        separated(0, 1.0, 1.0), located(10, 1.0), located(1_000_000, 2.0), separated(1_000_010, 2.0, 2.0),
        located(2_000_000, 3.0), separated(3_000_000, 99.0, 9.0), located(3_610_000_000, 2.0),
    ]  # fmt: skip
    assert [row["horizontal_error_m"] for row in join(messages)] == [1.0, 2.0, None, None]


@pytest.mark.parametrize("hour_start_s", [3600 * 60_000, None], ids=["with a clock", "without"])
def test_what_one_broadcast_says_is_one_row(tmp_path: Path, hour_start_s: int | None) -> None:
    """Of 25 bytes a LOCATION has tenths of a second, rounded, and a SEPARATION whole ones, cut off, or none."""
    times_s = [1234.5, 1234.8, 1234.96, 1235.3, 3599.97]
    packs = [
        encode_pack(
            [
                BasicId(1, 2, b"X"),
                Location(latitude_deg=47.0 + 1e-4 * k, longitude_deg=8.0, timestamp_s=timestamp_s),
                Separation(timestamp_s=timestamp_s, horizontal_error_m=float(k + 1)),
            ],
            hour_start_s=hour_start_s,
        )
        for k, timestamp_s in enumerate(times_s)
    ]
    path = tmp_path / "broadcasts.hex"
    path.write_text("".join(f"{pack.hex()}\n" for pack in packs))
    rows = rows_of(run(path, "--join", "-f", "jsonl"))
    assert [row["timestamp_s"] for row in rows] == [1234.5, 1234.8, 1235.0, 1235.3, 3600.0]
    assert [row["horizontal_error_m"] for row in rows] == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_what_a_stock_receiver_relayed_unread_is_part_of_the_row(tmp_path: Path) -> None:
    mac, encoder = bytes.fromhex("84cca8604324").ljust(20, b"\x00"), Encoder(1, 236)
    sent = Separation(timestamp_s=1234.5, horizontal_error_m=3.0, airframe_size_m=0.6)
    messages: list[RemoteIdMessage] = [
        structs.replace(authentication_of(sent, 3600 * 60_000), id_or_mac=mac),
        Location(latitude_deg=47.0, longitude_deg=8.0, timestamp_s=1234.5, id_or_mac=mac),
        Authentication(1, 0, 0, 17, 1.0, bytes(17), mac),
    ]
    frames = [frame_of(message, encoder) for message in messages]
    path = tmp_path / "bus.tlog"
    path.write_bytes(tlog_bytes([(START_US + 1000 * k, frame) for k, frame in enumerate(frames)]))
    (row,) = rows_of(run(path, "--join", "-f", "jsonl"))
    assert (row["horizontal_error_m"], row["airframe_size_m"], row["id_or_mac"]) == (3.0, 0.6, mac.hex())


def test_a_radio_does_not_replace_the_finer_figures_of_the_bus() -> None:
    wifi = {"transport": "wifi-beacon", "source": "90:3a"}
    exact = heard("RIDLINK_SEPARATION", 1_000_001, timestamp_s=10.0, vertical_error_m=1.13, flags=0)
    coarse = heard("RIDLINK_SEPARATION", 1_000_003, timestamp_s=10.0, vertical_error_m=1.5, flags=0, **wifi)
    coarse = coarse._replace(is_25_bytes=True)
    bus = [named("X"), named("X", **wifi), located(1_000_000, 10.0), located(1_000_002, 10.0, **wifi)]
    for messages in ([*bus, exact, coarse], [*bus, coarse, exact]):
        assert [row["vertical_error_m"] for row in join(messages)] == [1.13]
    assert [row["vertical_error_m"] for row in join([*bus, coarse])] == [1.5]
    stale = coarse._replace(fields={**coarse.fields, "timestamp_s": 8.0})
    assert [row["vertical_error_m"] for row in join([*bus, stale])] == [None]


def test_a_serial_number_outlasts_a_registration() -> None:
    messages = [named("REG", id_type=2), located(0, 1.0), named("SERIAL"), named("REG", id_type=2), located(9, 2.0)]
    assert [(row["uas_id"], row["id_type"]) for row in join(messages)] == [("SERIAL", 1)] * 2


def test_rows_leave_when_the_log_has_moved_on() -> None:
    joiner = Joiner()
    assert not list(joiner.receive(named("X")))
    assert not list(joiner.receive(located(0, 1.0))) and not list(joiner.receive(located(2_000_000, 2.0)))
    assert len(list(joiner.receive(located(2_000_001, 3.0)))) == 1
    assert len(list(joiner.flush())) == 2
    unnamed = Joiner()
    assert not list(unnamed.receive(located(0, 1.0))) and not list(unnamed.receive(located(7_000_000, 2.0)))
    assert len(list(unnamed.receive(located(7_000_001, 3.0)))) == 1, "nobody waits for an identity for ever"
    untimed = Joiner()
    assert sum(len(list(untimed.receive(located(None, float(index), index * 1e-3)))) for index in range(100)) > 80


def test_memory_is_bounded_whatever_senders_do() -> None:
    joiner = Joiner()
    for index in range(MAX_SENDERS + 500):
        list(joiner.receive(located(index, 1.0, source=f"{index}")))
    assert len(joiner._senders) == len(joiner._updates) == MAX_SENDERS


# --- maps ---


def features(text: str) -> Iterator[dict[str, Any]]:
    """Features of a GeoJSON text that RFC 7946 allows."""
    whole = json.loads(text, parse_constant=pytest.fail)
    assert whole["type"] == "FeatureCollection"
    for feature in whole["features"]:
        assert feature["type"] == "Feature" and isinstance(feature["properties"], dict)
        geometry = feature["geometry"]
        depth = {"Point": 0, "LineString": 1, "MultiLineString": 2}[geometry["type"]]
        places = [geometry["coordinates"]]
        for _ in range(depth):
            assert all(places)
            places = [inner for outer in places for inner in outer]
        if depth:
            lines = geometry["coordinates"] if depth == 2 else [geometry["coordinates"]]
            assert all(len(line) >= 2 for line in lines)
        assert all(abs(place[0]) <= 180 and abs(place[1]) <= 90 and len(place) in (2, 3) for place in places)
        yield feature


def test_geojson_has_points_and_tracks(log: Path, tmp_path: Path) -> None:
    found = list(features(run(log, "-f", "geojson").stdout))
    assert [feature["geometry"]["type"] for feature in found] == ["Point"] * 6 + ["LineString"]
    assert found[0]["geometry"]["coordinates"] == [8.0, 47.0, 500.5]
    assert found[0]["properties"]["time"] == "2023-11-14T22:13:20.124456Z"
    assert found[0]["properties"]["horizontal_error_m"] == 3.0
    assert found[-1]["properties"]["track"] == HOSTILE_TEXT and found[-1]["properties"]["positions"] == 6
    assert run(log, "-f", "geojson", "-o", tmp_path / "a.geojson").stdout == ""
    assert len(list(features((tmp_path / "a.geojson").read_text()))) == 7


def test_vehicles_have_tracks_too_and_nonsense_has_none(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    places = [(470000000, 80000000), (470000010, 80000000), (0, 0), (2**31 - 1, 5)]
    encoder = Encoder(3, 1)
    path.write_bytes(
        tlog_bytes(
            [
                (START_US + index, encoder.encode("GLOBAL_POSITION_INT", lat=lat, lon=lon, alt=1500))
                for index, (lat, lon) in enumerate(places)
            ]
        )
    )
    *points, line = features(run(path, "-f", "geojson").stdout)
    assert len(points) == 2 and line["geometry"]["coordinates"] == [[8.0, 47.0, 1.5], [8.0, 47.000001, 1.5]]
    assert line["properties"]["track"] == "3/1"


@pytest.mark.parametrize("output_format", ["geojson", "kml"])
def test_an_aircraft_has_one_track_unless_its_telemetry_is_wanted_too(tmp_path: Path, output_format: str) -> None:
    """One that broadcasts beside its telemetry and says late who it is, and one that has nothing but telemetry."""
    path, records = tmp_path / "f.tlog", aircraft(sysid=1)[1:]
    for second in range(6):
        for sysid in (1, 2):
            position = Encoder(sysid, 1).encode("GLOBAL_POSITION_INT", lat=470000000 + second, lon=80000000, alt=1500)
            records.append((START_US + second * 1_000_000 + sysid, position))
    path.write_bytes(tlog_bytes(sorted(records)))

    def tracks(*options: str) -> set[str]:
        text = run(path, "-f", output_format, *options).stdout
        if output_format == "kml":
            names = ET.fromstring(text).iter("{http://www.opengis.net/kml/2.2}name")
            return {name.text or "" for name in names} - {"ridlink"}
        found = list(features(text))
        points = [one["properties"]["track"] for one in found if one["geometry"]["type"] == "Point"]
        lines = {one["properties"]["track"] for one in found if one["geometry"]["type"] == "LineString"}
        assert set(points) == lines and {points.count(name) for name in lines} == {6}
        return lines

    assert tracks() == {"ABC123", "2/1"}
    assert tracks("--telemetry") == {"ABC123", "1/1", "2/1"}
    assert "--telemetry is for" in str(run(path, "-f", "jsonl", "--telemetry").exception)


NOTHING_WANTED = "ridlink: there is no {} in what was asked for; --stats, without limits, shows what there is\n"


def test_a_capture_without_positions_is_an_empty_map_and_told(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    for messages in (flight(1), [(START_US, Encoder(1, 1).encode("GLOBAL_POSITION_INT"))]):  # none, and an unknown one
        path.write_bytes(tlog_bytes(messages))
        maps = [run(path, "-f", "geojson"), run(path, "-f", "kml"), run(path, "-f", "kml", "--source-system", "1")]
        assert list(features(maps[0].stdout)) == []
        ET.fromstring(maps[1].stdout)
        assert [(done.stderr, done.return_value) for done in maps] == [(NOTHING_WANTED.format("position"), 0)] * 3


def test_joined_rows_that_nothing_makes_are_told(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    path.write_bytes(tlog_bytes([(START_US, Encoder(1, 1).encode("GLOBAL_POSITION_INT", lat=470000000, lon=80000000))]))
    done = [run(path, "--join", "-f", output_format) for output_format in ("jsonl", "csv")]
    assert done[0].stdout == "" and done[1].stdout.count("\n") == 1
    assert [(each.stderr, each.return_value) for each in done] == [(NOTHING_WANTED.format("Remote ID position"), 0)] * 2


def test_a_track_is_cut_where_the_map_ends() -> None:
    east = list(cut_at_antimeridian([[179.0, 0.0], [-179.0, 2.0]]))
    assert east == [[179.0, 0.0], [180.0, 1.0], None, [-180.0, 1.0], [-179.0, 2.0]]
    west = list(cut_at_antimeridian([[-179.0, 2.0, 7.0], [179.0, 0.0, 9.0]]))
    assert west == [[-179.0, 2.0, 7.0], [-180.0, 1.0, 8.0], None, [180.0, 1.0, 8.0], [179.0, 0.0, 9.0]]
    assert list(cut_at_antimeridian([[1.0, 2.0], [3.0, 4.0]])) == [[1.0, 2.0], [3.0, 4.0]]
    assert list(cut_at_antimeridian([[180.0, 0.0], [-180.0, 0.0]])).count(None) == 1


def test_long_tracks_are_whole_and_in_order(tmp_path: Path) -> None:
    """Longer than what is kept in memory, of two vehicles in turn; one goes to and fro across the antimeridian."""
    places = [(sysid, 78.2 + sysid * 50.5 + 0.5 * (index % 4), index) for index in range(1300) for sysid in (1, 2)]
    encoders = {sysid: Encoder(sysid, 1) for sysid in (1, 2)}
    path = tmp_path / "long.tlog"
    path.write_bytes(
        tlog_bytes(
            [
                (START_US + index, encoders[sysid].encode(
                    "GLOBAL_POSITION_INT", lat=index, lon=round((lon - 360.0 if lon > 180.0 else lon) * 1e7), alt=1
                ))
                for sysid, lon, index in places
            ]
        )
    )  # fmt: skip
    found = json.loads(run(path, "-f", "geojson").stdout)["features"]
    *points, straight, crossing = found
    assert len(points) == 2600 and [line["properties"]["track"] for line in (straight, crossing)] == ["1/1", "2/1"]
    assert straight["geometry"]["type"] == "LineString" and crossing["geometry"]["type"] == "MultiLineString"
    assert [round(place[1] * 1e7) for place in straight["geometry"]["coordinates"]] == list(range(1300))
    pieces = crossing["geometry"]["coordinates"]
    assert len(pieces) == 650 and all(len(piece) >= 2 for piece in pieces)
    inner = [round(place[1] * 1e7) for piece in pieces for place in piece if abs(place[0]) != 180.0]
    assert inner == list(range(1300)) and crossing["properties"]["positions"] == 1300
    kml, gx = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"
    for track in ET.fromstring(run(path, "-f", "kml").stdout).iter(f"{gx}Track"):
        latitudes = [round(float((place.text or "").split()[1]) * 1e7) for place in track.iter(f"{gx}coord")]
        assert latitudes == list(range(1300)) and len(list(track.iter(f"{kml}when"))) == 1300


def test_kml_is_xml_whatever_the_name(log: Path, tmp_path: Path) -> None:
    kml, gx = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"
    root = ET.fromstring(run(log, "-f", "kml").stdout)
    (placemark,) = root.iter(f"{kml}Placemark")
    assert placemark.findtext(f"{kml}name") == HOSTILE_TEXT
    assert next(placemark.iter(f"{kml}when")).text == "2023-11-14T22:13:20.124456Z"
    assert [place.text for place in placemark.iter(f"{gx}coord")][:1] == ["8.0 47.0 500.5"]
    raw = tmp_path / "f.mavlink"
    raw.write_bytes(b"".join(frame for _, frame in aircraft(3)))
    (line,) = ET.fromstring(run(raw, "-f", "kml").stdout).iter(f"{kml}LineString")
    assert (line.findtext(f"{kml}coordinates") or "").split() == ["8.0,47.0,500.5", "8.0,47.0001,500.5",
                                                                  "8.0,47.0002,500.5"]  # fmt: skip


def test_mcap_has_fixes_and_messages_under_inert_topics(log: Path, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader", reason="mcap is in the extra 'export'")
    path = tmp_path / "air.mcap"
    assert run(log, "-f", "mcap", "-o", path).return_value == 0
    with open(path, "rb") as stream:
        found = [
            (channel.topic, schema.name, message.log_time, json.loads(message.data))
            for schema, channel, message in reader.make_reader(stream).iter_messages()
        ]
    fixes = [entry for entry in found if entry[1] == "foxglove.LocationFix"]
    assert len(found) == 24 + 6 and len(fixes) == 6
    topic, _, log_time, fix = fixes[0]
    assert topic == "/remote_id/_1_b_______x1b_2J____/x/fix"
    assert log_time == 1_700_000_000_124_456_000
    assert (fix["latitude"], fix["longitude"], fix["altitude"]) == (47.0, 8.0, 500.5)
    assert fix["timestamp"] == {"sec": 1_700_000_000, "nsec": 124_456_000}
    assert fix["position_covariance"][0] == 1.0 and fix["position_covariance_type"] == 2
    assert "/mavlink/1/1/RIDLINK_SEPARATION" in {entry[0] for entry in found}


def test_mcap_has_the_fixes_of_telemetry_beside_those_of_remote_id(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader", reason="mcap is in the extra 'export'")
    position = Encoder(1, 1).encode("GLOBAL_POSITION_INT", lat=470000000, lon=80000000, alt=1500)
    (tmp_path / "f.tlog").write_bytes(
        tlog_bytes([*aircraft(2)[:6], (START_US + 1_500_000, position), *aircraft(3)[8:]])
    )
    run(tmp_path / "f.tlog", "-f", "mcap", "-o", tmp_path / "f.mcap")
    with open(tmp_path / "f.mcap", "rb") as stream:
        topics = [channel.topic for _, channel, _ in reader.make_reader(stream).iter_messages()]
    assert topics.count("/remote_id/1/1/fix") == 1 and topics.count("/remote_id/ABC123/fix") == 3


# --- what is written ---


@pytest.mark.parametrize(
    ("options", "count"),
    [
        (["--since", "1700000002"], 16),
        (["--until", "2023-11-14T22:13:22Z"], 8),
        (["--since", "2023-11-14 22:13:21", "--until", "1700000003.124456"], 9),
        (["--since", "2023-11-15T00:13:21+02:00", "--until", "1700000003.124457"], 10),
        (["--since", "2030-01-01"], 0),
    ],
)
def test_since_and_until_are_half_open(log: Path, options: list[str], count: int) -> None:
    assert len(run(log, "-f", "jsonl", *options).stdout.splitlines()) == count


@pytest.mark.parametrize(
    "arguments",
    [
        ["-f", "csv"], ["-f", "parquet"], ["-f", "mcap", "-o", "-"], ["-f", "geojson", "--join"], ["--join"],
        ["-f", "csv", "-o", "x", "--stats"], ["--frames"], ["--since", "soon"], ["--since", "nan"],
        ["--since", "1e999999"],
    ],
)  # fmt: skip
def test_options_that_mean_nothing_are_usage_errors(log: Path, arguments: list[str]) -> None:
    click = importlib.import_module("click")
    assert isinstance(run(log, *arguments).exception, click.UsageError)
