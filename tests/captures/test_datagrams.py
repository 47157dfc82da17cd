"""Packets in blocks hold exactly what they hold one by one, and say so in the same bytes."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ridlink.captures import open_capture
from ridlink.captures.columns import decode
from ridlink.captures.fast import datagrams
from ridlink.captures.fast.block import Block
from ridlink.captures.fast.blocks import BlockReader
from tests.captures.command import ALWAYS, NEVER, Outcome, outcome
from tests.captures.conftest import flight
from tests.captures.drawn import frames, packs
from tests.captures.pcap_files import (
    START_US,
    enhanced,
    ethernet,
    interface,
    ipv4,
    ipv6,
    pcap,
    pcap_record,
    pcapng,
    section,
    tcp,
    timed,
    udp,
)
from tests.remote_id.radio_frames import PACK, odid_beacon, radiotap

FRAMES = [frame for _, frame in flight(40)]
PAYLOADS = st.one_of(
    st.lists(frames() | packs(), min_size=1, max_size=4).map(b"".join),
    st.tuples(st.binary(max_size=3), frames(), st.binary(max_size=3)).map(b"".join),
    st.builds(lambda frame, cut: frame[:cut], frames(), st.integers(1, 12)),
    st.sampled_from([FRAMES[0] + b"\xfd\x40\0\0\1\7\7\xff\xff\x7f", b"\xfe", b"\xfd\x00" * 20, b"GET / HTTP/1.1"]),
)
PACKETS = st.one_of(
    PAYLOADS.map(lambda payload: ethernet(ipv4(udp(payload)))),
    PAYLOADS.map(lambda payload: ethernet(ipv4(udp(payload)))),
    PAYLOADS.map(lambda payload: ethernet(ipv6(udp(payload)), 0x86DD)),
    PAYLOADS.map(lambda payload: ethernet(struct.pack(">HH", 7, 0x0800) + ipv4(udp(payload)), 0x8100)),
    PAYLOADS.map(lambda payload: ethernet(ipv4(udp(payload), flags=0x2000))),
    PAYLOADS.map(lambda payload: ethernet(ipv4(udp(payload)))[:-5]),
    st.tuples(PAYLOADS, st.integers(0, 300)).map(lambda of: ethernet(ipv4(tcp(*of), protocol=6))),
    st.just(ethernet(bytes(46), 0x0806)),
)
OPTIONS = st.tuples(
    st.sampled_from([(), ("-f", "jsonl"), ("-f", "jsonl", "--frames"), ("--stats",), ("--stats", "-f", "jsonl")]),
    st.sampled_from([(), (), ("--types", "*PACK,UNKNOWN"), ("--types", "*LOCATION,HEART*")]),
    st.sampled_from([(), (), ("--source-system", "1"), ("--since", f"{START_US + 90_000}e-6")]),
).map(lambda parts: [word for part in parts for word in part])


def in_blocks(*arguments: str | Path, fewest: int = 1, most: int = 8192) -> Outcome:
    """What the command writes and how it ends, where so many datagrams make a block."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(datagrams, "FEWEST", fewest)
        patch.setattr(datagrams, "MOST", most)
        return outcome(ALWAYS, *arguments)


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The kernels, so that it is not said in between that they are being compiled."""
    path = tmp_path_factory.mktemp("compiled") / "f.pcap"
    path.write_bytes(pcap(timed([ethernet(ipv4(udp(frame))) for frame in FRAMES])))
    assert in_blocks(path)[0].count(b"\n") == len(FRAMES)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    packets=st.lists(st.tuples(st.sampled_from([0, 0, 0, 0, 1, 2, 3]), PACKETS), min_size=1, max_size=14),
    is_pcapng=st.booleans(),
    options=OPTIONS,
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=3),
    cut=st.sampled_from([0, 0, 1, 30]),
    fewest=st.sampled_from([1, 1, 3]),
    most=st.sampled_from([1, 4, 8192]),
)
def test_packets_in_blocks_are_written_as_one_by_one(
    tmp_path: Path, packets: list[tuple[int, bytes]], is_pcapng: bool, options: list[str],
    flips: list[tuple[float, int]], cut: int, fewest: int, most: int,
) -> None:  # fmt: skip
    """pcapng has interfaces of a network, of the air and of a foreign link type, and one that is not described."""
    path = tmp_path / "packets"
    if is_pcapng:
        data = section() + b"".join(interface("<", link_type) for link_type in (1, 127, 195))
        for index, (number, packet) in enumerate(packets):
            heard = radiotap(odid_beacon(PACK, index)) if number == 1 else packet
            data += enhanced("<", START_US + index * 33_333, heard, number)
    else:
        data = pcap(timed([packet for _, packet in packets]))
    damaged = bytearray(data)
    for place, bits in flips:
        at = 40 + int(place * (len(data) - 40))
        damaged[at] ^= bits
    path.write_bytes(damaged[: len(damaged) - cut])
    assert in_blocks(path, *options, fewest=fewest, most=most) == outcome(NEVER, path, *options)


@pytest.mark.parametrize("reaches", [0, 3, 57, 200])
@pytest.mark.parametrize("before", [b"", bytes(3), FRAMES[0]])
def test_no_frame_spans_datagrams_in_blocks_either(tmp_path: Path, before: bytes, reaches: int) -> None:
    """In a stream the first would end with a frame of an unknown id, which takes in so much of what follows."""
    length = 20
    header = b"\xfd" + bytes((length + reaches, 0, 0, 1, 7, 7, 255, 255, 127))
    follows = bytes(reaches % 57) + FRAMES[1]
    payloads = [before + header + bytes(length + 2), follows, *FRAMES[:12]]
    path = tmp_path / "f.pcap"
    path.write_bytes(pcap(timed([ethernet(ipv4(udp(payload))) for payload in payloads])))
    for options in (["-f", "jsonl", "--frames"], ["--stats"]):
        assert in_blocks(path, *options) == outcome(NEVER, path, *options)
    (block,) = _blocks(path)
    found = [block.frame(entry) for entry in range(block.count)]
    assert found[-13:] == [FRAMES[1], *FRAMES[:12]] and (len(found) > 14) == (before == FRAMES[0] and not reaches)


def _blocks(path: Path) -> list[Block]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(datagrams, "FEWEST", 1)
        return [part for part in BlockReader(path).parts() if isinstance(part, Block)]


def test_damage_is_told_in_the_order_of_the_file(tmp_path: Path) -> None:
    """The file is read ahead of its datagrams: its tail, which is cut, is met before what was truncated long before."""
    packets = [
        ethernet(ipv4(udp(FRAMES[0][:-3]))),
        ethernet(ipv4(udp(FRAMES[0]), flags=0x2000)),
        ethernet(ipv4(udp(FRAMES[0]))),
    ]
    path = tmp_path / "f.pcap"
    path.write_bytes(pcap(timed(packets)) + pcap_record("<", START_US, packets[0])[:-1])
    found = in_blocks(path, "-f", "jsonl")
    assert found == outcome(NEVER, path, "-f", "jsonl")
    assert "2 truncated (first at byte 24), 1 ip_fragment" in found[1]


def test_columns_of_packets_are_those_of_their_records(tmp_path: Path) -> None:
    """Enough datagrams for blocks, broadcasts of the air between them, and some of everything in the last."""
    data = section() + interface("<", 1) + interface("<", 127)
    stream = [frame for _, frame in flight(1500)]
    for index, frame in enumerate(stream):
        data += enhanced("<", START_US + index, ethernet(ipv4(udp(frame))))
        if index in (600, 601, 1490):
            data += enhanced("<", START_US + index, radiotap(odid_beacon(PACK, index % 256)), 1)
    path = tmp_path / "f.pcapng"
    path.write_bytes(data)
    columns = decode(path)
    with open_capture(path) as capture:
        records = list(capture)
    by_name = {
        name: list(zip(rows["t_us"].tolist(), rows["offset"].tolist(), strict=True)) for name, rows in columns.items()
    }
    assert sum(map(len, by_name.values())) == len(records) > 1500
    assert sorted(pair for pairs in by_name.values() for pair in pairs) == sorted(
        (record.time_us, record.offset) for record in records
    )
    assert columns.sources[1, 1].messages == 1500 and columns.sources[1, 1].lost == 0
    assert {type(part) for part in BlockReader(path).parts()} == {Block, list}
    assert {part.transport for part in BlockReader(path).parts() if isinstance(part, Block)} == {"udp"}


def test_other_protocols_alone_are_no_capture_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "f.pcapng"
    path.write_bytes(pcapng(timed([ethernet(ipv4(udp(b"GET / HTTP/1.1")))] * 300)))
    found = in_blocks(path)
    assert found == outcome(NEVER, path)
    assert "has no MAVLink frame in UDP or TCP and no Remote ID broadcast (pcap)" in found[3]
