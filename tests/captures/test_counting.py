"""Counts of large files, which are taken block by block, are byte by byte those that are taken message by message."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ridlink.captures.export.si import HAVE_RANGES
from ridlink.captures.fast.sources import count_sources
from ridlink.captures.statistics import SourceCount
from ridlink.mavlink.codec import MESSAGES_BY_NAME, Encoder
from ridlink.mavlink.frames import encode_frame
from tests.captures.command import ALWAYS, NEVER, outcome
from tests.captures.conftest import START_US, flight, needs_compiler, tlog_bytes
from tests.captures.drawn import PIECES, TIMES, any_frame, packs

CAPTURES = Path(__file__).resolve().parents[3] / "shared" / "captures"

INTEGERS = (0, 1, -1, 36000, 36001, 36100, 25425, 25426, 25500, 6200, 6201, -6201, 6300, 900000000, -900000001,
            1800000000, 1800000001, -1800000001)  # fmt: skip
FLOATS = (0.0, -0.0, -1.0, -1000.0, -1000.5, -999.5, 31767.5, 31768.0, 3600.0, 3600.5, 65535.0, math.nan, math.inf,
          -math.inf)  # fmt: skip
RANGES = {"uint16_t": (0, 2**16 - 1), "int16_t": (-(2**15), 2**15 - 1), "int32_t": (-(2**31), 2**31 - 1)}


@st.composite
def at_the_ends(draw: st.DrawFn) -> bytes:
    """Remote ID whose fields stand at the ends of their ranges, beyond them, and at what says unknown."""
    spec = MESSAGES_BY_NAME[draw(st.sampled_from(sorted(HAVE_RANGES)))]
    fields: dict[str, float] = {}
    for name, kind in zip(spec.fields, spec.types, strict=True):
        if kind == "float":
            fields[name] = draw(st.sampled_from(FLOATS))
        elif kind in RANGES:
            lowest, highest = RANGES[kind]
            fields[name] = draw(st.sampled_from([value for value in INTEGERS if lowest <= value <= highest]))
    return Encoder(draw(st.integers(1, 2)), 1).encode(spec.name, **fields)


FILES = st.lists(
    st.lists(st.tuples(TIMES, at_the_ends() | packs() | any_frame()), max_size=10).flatmap(
        lambda records: PIECES.map(lambda pieces: [*records, *pieces])
    ),
    min_size=1,
    max_size=3,
)
OPTIONS = st.tuples(
    st.sampled_from([(), ("-f", "jsonl")]),
    st.sampled_from([(), (), (), ("--types", "*PACK*"), ("--types", "*LOCATION,HEART*"), ("--types", "UNKNOWN")]),
    st.sampled_from([(), (), ("--source-system", "1")]),
    st.sampled_from([(), (), ("--since", f"{START_US + 10**6}e-6"), ("--since", "-1")]),
    st.sampled_from([(), (), ("--until", f"{START_US + 9 * 10**6}e-6"), ("--until", "1e20")]),
).map(lambda parts: [word for part in parts for word in part])


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The kernels, so that it is not said in between that they are being compiled."""
    path = tmp_path_factory.mktemp("compiled") / "f"
    for kind, frames in (("tlog", tlog_bytes(flight(9))), ("mavlink", flight(1)[0][1])):
        path.write_bytes(frames)
        outcome(ALWAYS, path, "--stats", "--in", kind)


def write(path: Path, pieces: list[tuple[int | None, bytes]], *, timed: bool) -> None:
    parts = [piece if time_us is None or not timed else time_us.to_bytes(8, "big") + piece for time_us, piece in pieces]
    path.write_bytes(b"".join(parts))


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    files=FILES,
    kind=st.sampled_from(["tlog", "mavlink", "auto"]),
    options=OPTIONS,
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=3),
    cut=st.sampled_from([0, 0, 1, 5, 12]),
    block_length=st.sampled_from([37, 300, 1 << 16]),
    large=st.sampled_from([ALWAYS, ALWAYS, 400]),
)
def test_counts_of_blocks_are_those_of_messages(
    tmp_path: Path, files: list[list[tuple[int | None, bytes]]], kind: str, options: list[str],
    flips: list[tuple[float, int]], cut: int, block_length: int, large: int,
) -> None:  # fmt: skip
    paths = [tmp_path / f"{number}.bin" for number in range(len(files))]
    for path, pieces in zip(paths, files, strict=True):
        write(path, pieces, timed=kind != "mavlink")
    data = bytearray(paths[0].read_bytes())
    for place, bits in flips:
        if data:
            data[int(place * len(data))] ^= bits
    paths[0].write_bytes(data[: len(data) - cut])
    arguments = [*paths, "--stats", "--in", kind, *options]
    assert outcome(large, *arguments, block_length=block_length) == outcome(NEVER, *arguments)


@pytest.mark.parametrize(
    "options", [[], ["--source-system", "2"], ["--types", "UNKNOWN"], ["--types", "*BASIC_ID"], ["--types", "*PACK"],
                ["--since", f"{START_US + 15}e-6"], ["--until", f"{START_US + 15}e-6"]],
)  # fmt: skip
def test_what_is_not_selected_is_not_counted_in_blocks_either(tmp_path: Path, options: list[str]) -> None:
    """Packs between other messages and unknown ids of two systems, each with numbers of its own."""
    path = tmp_path / "f.tlog"
    member = bytes.fromhex("0212") + b"AIRCRAFT-1".ljust(23, b"\x00")
    records: list[tuple[int, bytes]] = []
    for sysid in (1, 2, 1, 2):
        encoder = Encoder(sysid, 1)
        for number in range(5):
            pack = {"single_message_size": 25, "msg_pack_size": number, "messages": member * number}
            frames = [
                encoder.encode("OPEN_DRONE_ID_MESSAGE_PACK", **pack),
                encode_frame(54321 + number * sysid, b"\x01", 0, seq=number * 70, sysid=sysid, compid=1),
                encoder.encode("OPEN_DRONE_ID_LOCATION", direction=40000 - number),
            ]
            records += [(START_US + len(records) + place, frame) for place, frame in enumerate(frames)]
    path.write_bytes(tlog_bytes(records))
    for form in ("table", "jsonl"):
        found = outcome(ALWAYS, path, "--stats", "-f", form, *options, block_length=700)
        assert found == outcome(NEVER, path, "--stats", "-f", form, *options)
        assert found[0] and found[2] == 0


@pytest.mark.parametrize("output_format", ["table", "jsonl"])
def test_large_files_are_counted_without_their_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output_format: str
) -> None:
    path = tmp_path / "f.tlog"
    path.write_bytes(tlog_bytes(flight(90)))
    expected = outcome(NEVER, path, "--stats", "-f", output_format)
    monkeypatch.setattr("ridlink.captures.decode_records", None)
    assert outcome(ALWAYS, path, "--stats", "-f", output_format) == expected
    assert b"90" in expected[0]


@needs_compiler
@pytest.mark.parametrize("options", [[], ["-f", "jsonl"], ["--types", "OPEN_*,HEARTBEAT"], ["--source-system", "2"]])
def test_counts_of_the_sample_captures_are_the_same(tmp_path: Path, options: list[str]) -> None:
    """Those of MAVLink, as they are and with bytes changed, joined to others that cannot be taken in blocks."""
    if not CAPTURES.exists():
        pytest.skip("the sample captures are not part of the project")
    files = sorted(path for path in CAPTURES.iterdir() if path.suffix in (".tlog", ".pcap", ".pcapng"))
    damaged = tmp_path / "damaged.tlog"
    data = bytearray((CAPTURES / "real_autopilot.tlog").read_bytes())
    for at in range(1000, len(data), 4999):
        data[at] ^= 0x55
    damaged.write_bytes(data[:-3])
    for chosen in (*([path] for path in files), [damaged], [*files, damaged]):
        by_messages = outcome(NEVER, *chosen, "--stats", *options)
        assert outcome(ALWAYS, *chosen, "--stats", *options, block_length=50_000) == by_messages
        assert by_messages[2] == 0


@given(
    steps=st.lists(st.tuples(st.integers(0, 2), st.sampled_from([0, 1, 2, 64, 65, 66, 255])), max_size=40),
    cut=st.integers(0, 40),
)
def test_gaps_and_leaps_are_those_of_one_number_after_the_other(steps: list[tuple[int, int]], cut: int) -> None:
    one_by_one: dict[tuple[int, int], SourceCount] = {}
    seqs = [0, 100, 200]
    seen: list[tuple[int, int]] = []
    for sysid, step in steps:
        seqs[sysid] = (seqs[sysid] + step) % 256
        seen.append((sysid, seqs[sysid]))
        one_by_one.setdefault((sysid, 1), SourceCount()).see(seqs[sysid])
    at_once: dict[tuple[int, int], SourceCount] = {}
    for part in (seen[:cut], seen[cut:]):
        sysids, numbers = (np.array([pair[index] for pair in part], np.uint8) for index in (0, 1))
        count_sources(at_once, numbers, sysids, np.ones_like(sysids))
    assert at_once == one_by_one
