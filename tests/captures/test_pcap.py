"""pcap and pcapng: every form of file and link, damage anywhere."""

from __future__ import annotations

import json
import random
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.captures import CaptureKind, layers, open_capture, read_messages
from ridlink.captures.packet_window import MAX_PACKET_LENGTH, Packet
from ridlink.captures.packets import read_packets, read_pcap
from ridlink.captures.records import Record, Rejects, TracedRecord
from ridlink.captures.tcp import Segment
from ridlink.errors import CaptureError
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.bridge import pack_to_mavlink
from ridlink.remote_id.messages import BasicId, Location, SelfId, Separation
from tests.captures.command import run
from tests.captures.conftest import flight
from tests.captures.pcap_files import (
    START_US,
    STEP_US,
    block,
    enhanced,
    ethernet,
    interface,
    ipv4,
    ipv6,
    pcap,
    pcap_record,
    pcapng,
    section,
    timed,
    udp,
)
from tests.remote_id.radio_frames import MAC, PACK, extended, legacy, nan, nordic, odid_beacon, phdr, radiotap

FRAMES = [frame for _, frame in flight(30)]
DATAGRAMS = timed([ethernet(ipv4(udp(frame))) for frame in FRAMES])


def read(data: bytes, chunk: int = 1000) -> tuple[list[Record], Rejects]:
    rejects = Rejects()
    return list(read_pcap((data[at : at + chunk] for at in range(0, len(data), chunk)), rejects)), rejects


def packets_of(data: bytes, chunk: int = 1000) -> tuple[list[Packet], Rejects]:
    rejects = Rejects()
    return list(read_packets((data[at : at + chunk] for at in range(0, len(data), chunk)), rejects)), rejects


def frames_of(records: list[Record]) -> list[bytes]:
    return [record.frame.raw for record in records]


# --- forms of the file ---


@pytest.mark.parametrize("chunk", [1, 7, 1000, 10**6])
@pytest.mark.parametrize(
    "data",
    [
        *(pcap(DATAGRAMS, order=order, nanoseconds=nano) for order in "<>" for nano in (False, True)),
        pcap(DATAGRAMS, 1 | 0x54000000),  # the high bits say that packets end with a checksum
        *(pcapng(DATAGRAMS, order=order) for order in "<>"),
    ],
    ids=["le", "le-ns", "be", "be-ns", "fcs", "ng-le", "ng-be"],
)
def test_every_form_of_file_gives_the_same(data: bytes, chunk: int) -> None:
    records, rejects = read(data, chunk)
    assert frames_of(records) == FRAMES and not rejects
    assert [record.time_us for record in records] == [START_US + index * STEP_US for index in range(30)]
    assert all(isinstance(record, TracedRecord) and record.origin.transport == "udp" for record in records)
    for record in records:  # the offset is where its record starts
        assert record.frame.raw in data[record.offset : record.offset + 400]


@pytest.mark.parametrize("chunk", [1, 7, 1000, 10**6])
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("nanoseconds", [False, True])
def test_captures_one_behind_the_other_are_each_read_as_its_header_says(
    order: str, nanoseconds: bool, chunk: int
) -> None:
    beacons = timed([radiotap(odid_beacon())])
    data = pcap(DATAGRAMS) + pcap(DATAGRAMS, order=order, nanoseconds=nanoseconds) + pcap(beacons, 127, order=">")
    records, rejects = read(data + pcap([]) + pcap(DATAGRAMS[:1]), chunk)
    times = [START_US + index * STEP_US for index in range(30)]
    expected = [*times, *times, *[START_US] * (len(records) - 61), START_US]
    assert [record.time_us for record in records] == expected and not rejects
    assert frames_of(records)[:60] == FRAMES * 2 and len(records) > 61


@pytest.mark.parametrize("chunk", [1, 7, 1000, 10**6])
@pytest.mark.parametrize("cut", [1, 16, 40, 90])
@pytest.mark.parametrize("order", "<>")
def test_a_capture_behind_one_that_was_cut_is_read_as_its_header_says(order: str, cut: int, chunk: int) -> None:
    first = pcap(DATAGRAMS)[:-cut]
    records, rejects = read(first + pcap(DATAGRAMS, order=order, nanoseconds=True), chunk)
    assert frames_of(records)[-30:] == FRAMES and len(records) >= 58 and len(rejects) == 1
    assert [record.time_us for record in records[-30:]] == [START_US + index * STEP_US for index in range(30)]


@pytest.mark.parametrize("chunk", [1, 7, 100, 10**6])
def test_what_an_impostor_made_us_read_is_judged_too(chunk: int) -> None:
    """Among damage stands what looks like a header, of a record as long as the file: nothing is lost behind it."""
    impostor = struct.pack("<IIII", START_US // 1_000_000, 0, 60_000, 60_000)
    data = pcap(DATAGRAMS)
    records, rejects = read(data[:24] + b"\xff" * 16 + impostor + data[24:], chunk)
    assert frames_of(records) == FRAMES
    assert rejects.counts == {"bad_packet_header": 1} and rejects.first_offset == {"bad_packet_header": 24}


@pytest.mark.parametrize(
    ("resolution", "units"),
    [
        (b"\x06", START_US),
        (b"\x09", START_US * 1000 + 999),
        (b"\x03", START_US // 1000),
        (b"\x94", START_US * 2**20 // 10**6),
    ],
)
def test_pcapng_times_have_the_resolution_of_their_interface(resolution: bytes, units: int) -> None:
    for order in "<>":
        data = section(order) + interface(order, 1, (9, resolution)) + enhanced(order, units, DATAGRAMS[0][1])
        (record,), rejects = read(data)
        exact = {b"\x03": START_US // 1000 * 1000, b"\x94": START_US - 1}.get(resolution, START_US)
        assert record.time_us == exact and not rejects
        shifted = interface(order, 1, (9, resolution), (14, struct.pack(order + "q", -3600)))
        (record,), _ = read(section(order) + shifted + enhanced(order, units, DATAGRAMS[0][1]))
        assert record.time_us == exact - 3_600_000_000


def test_a_pcapng_may_have_several_sections_interfaces_and_kinds_of_block() -> None:
    packet = DATAGRAMS[0][1]
    simple = block("<", 3, struct.pack("<I", len(packet)) + packet)
    head = struct.pack("<HHIIII", 1, 0, START_US >> 32, START_US & 0xFFFFFFFF, len(packet), len(packet))
    old = block("<", 2, head + packet)
    names = block("<", 4, bytes(8))
    custom = block("<", 0x0BAD, b"whatever")
    beacon = timed([radiotap(odid_beacon())])[0][1]
    data = (
        section("<") + interface("<", 1) + interface("<", 1) + names + simple + custom + old
        + section(">") + interface(">", 127) + enhanced(">", START_US, beacon)
    )  # fmt: skip
    records, rejects = read(data)
    assert [record.time_us for record in records] == [None, START_US, *[START_US] * 3] and not rejects
    assert [type(record.frame.raw) for record in records[:2]] == [bytes] * 2


def test_a_packet_of_an_interface_that_was_not_described_is_a_reject() -> None:
    records, rejects = read(section() + interface("<", 1) + enhanced("<", START_US, DATAGRAMS[0][1], number=1))
    assert not records and rejects.counts == {"unknown_interface": 1}


def test_times_beyond_the_calendar_are_none() -> None:
    data = section() + interface("<", 1, (9, b"\x00")) + enhanced("<", 2**64 - 1, DATAGRAMS[0][1])
    (record,), _ = read(data)
    assert record.time_us is None


# --- networks ---

FRAME = FRAMES[1]
IP4, IP6 = ipv4(udp(FRAME)), ipv6(udp(FRAME))


@pytest.mark.parametrize(
    ("link_type", "packet"),
    [
        (1, ethernet(IP4)),
        (1, ethernet(IP6, 0x86DD)),
        (1, ethernet(b"\x00\x07\x08\x00" + IP4, 0x8100)),
        (1, ethernet(b"\x00\x07\x81\x00\x00\x08\x86\xdd" + IP6, 0x88A8)),
        (1, ethernet(ipv4(udp(FRAME), options=bytes(8)))),
        (1, ethernet(ipv6(b"\x11\x00" + bytes(6) + udp(FRAME), header=0), 0x86DD)),
        (0, struct.pack("<I", 2) + IP4),
        (0, struct.pack(">I", 2) + IP4),
        (0, struct.pack("<I", 30) + IP6),
        (0, struct.pack("<I", 24) + IP6),
        (108, struct.pack(">I", 2) + IP4),
        (108, struct.pack(">I", 28) + IP6),
        (113, bytes.fromhex("0000000100060000000000000000") + b"\x08\x00" + IP4),
        (113, bytes.fromhex("0000030400060000000000000000") + b"\x86\xdd" + IP6),
        (276, b"\x08\x00" + bytes.fromhex("000000000001000100060000000000000000") + IP4),
        (276, b"\x86\xdd" + bytes.fromhex("000000000001000100060000000000000000") + IP6),
        (101, IP4),
        (101, IP6),
        (12, IP4),
        (228, IP4),
        (229, IP6),
    ],
)
def test_mavlink_is_found_behind_every_link_layer(link_type: int, packet: bytes) -> None:
    for data in (pcap(timed([packet]), link_type), pcapng(timed([packet]), link_type)):
        records, rejects = read(data)
        assert frames_of(records) == [FRAME] and not rejects


@settings(max_examples=300, deadline=None)
@given(
    link_type=st.sampled_from([1, 113, 276]),
    payload=st.binary(max_size=40),
    changes=st.lists(
        st.tuples(
            st.sampled_from([0, 2, 3, 6, 7, 9, 24, 25]) | st.integers(-2, 27),
            st.sampled_from([0, 7, 8, 17, 20, 27, 28, 29, 0x20, 0x40, 0x46, 0x60, 0x80]) | st.integers(0, 255),
        ),
        max_size=3,
    ),
    behind=st.binary(max_size=20),
    cut=st.just(0) | st.integers(0, 60),
)
def test_plain_packets_are_what_the_library_takes_them_for(
    link_type: int, payload: bytes, changes: list[tuple[int, int]], behind: bytes, cut: int
) -> None:
    """IPv4 on its link with bytes of its headers changed, more behind it, or less of it."""
    head = {1: bytes(12) + b"\x08\x00", 113: bytes(14) + b"\x08\x00", 276: b"\x08\x00" + bytes(18)}[link_type]
    packet = bytearray(head + ipv4(udp(payload)) + behind)
    for place, value in changes:
        packet[len(head) + place] = value
    data = bytes(packet[: max(1, len(packet) - cut)])

    def found() -> tuple[bytes | Segment, Rejects]:
        rejects = Rejects()
        return layers.carried(Packet(0, link_type, data, 24), rejects) or b"", rejects

    payload_here, rejects_here = found()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layers, "_PLAIN", {})
        payload_there, rejects_there = found()
    assert (payload_here, rejects_here.counts) == (payload_there, rejects_there.counts)


def test_several_frames_of_a_datagram_and_the_damaged_among_them() -> None:
    damaged = bytearray(FRAMES[1])
    damaged[-3] ^= 1
    records, rejects = read(pcap(timed([ethernet(ipv4(udp(FRAMES[0] + bytes(damaged) + FRAMES[2])))])))
    assert frames_of(records) == [FRAMES[0], FRAMES[2]]
    assert rejects.counts == {"bad_checksum": 1}


def test_a_datagram_may_be_full_of_frames() -> None:
    many = [Encoder(1, 1).encode("HEARTBEAT", custom_mode=number + 1) for number in range(1000)]
    records, rejects = read(pcap(timed([ethernet(ipv4(udp(b"".join(many))))])))
    assert frames_of(records) == many and not rejects


def test_no_state_crosses_datagrams() -> None:
    """Ten bytes that claim a long payload do not swallow what the next datagram holds."""
    swallow = b"\xfd\xff\x00\x00\x00\x00\x01\x01\x00\x00"
    records, rejects = read(pcap(timed([ethernet(ipv4(udp(part))) for part in (swallow, FRAMES[0], FRAMES[1])])))
    assert frames_of(records) == FRAMES[:2] and rejects.counts == {"truncated": 1}


def test_other_protocols_are_passed_over() -> None:
    others = [
        ethernet(ipv4(udp(b"\x12\x34\x01\x00\x00\x01" + bytes(6) + b"\x07example\x03com\x00\x00\x01\x00\x01", 53))),
        ethernet(ipv4(b"\x00\x50" * 10 + b"\xfd\x09", protocol=6)),
        ethernet(ipv4(b"\x08\x00" + bytes(6), protocol=1)),
        ethernet(b"\x00\x01\x08\x00\x06\x04\x00\x01" + bytes(20), 0x0806),
        ethernet(b"\x42\x42\x03" + bytes(35), 38),
        ethernet(bytes(40), 0x8847),
        ethernet(ipv4(udp(b""))),
    ]
    records, rejects = read(pcap([*timed(others), *DATAGRAMS]))
    assert frames_of(records) == FRAMES and not rejects


def test_fragments_are_counted_and_not_put_together() -> None:
    first = ipv4(udp(FRAME), flags=0x2000)
    rest = ipv4(FRAME, flags=0x0008)
    of_tcp = ipv4(bytes(20), flags=0x2000, protocol=6)
    sixth = ipv6(struct.pack(">BBHI", 17, 0, 1, 7) + udp(FRAME), header=44)
    late = ipv6(struct.pack(">BBHI", 17, 0, 8, 7) + FRAME, header=44)
    whole = ipv6(struct.pack(">BBHI", 17, 0, 0, 7) + udp(FRAME), header=44)
    packets = [ethernet(one) for one in (first, rest, of_tcp)]
    packets += [ethernet(one, 0x86DD) for one in (sixth, late, whole)]
    records, rejects = read(pcap(timed(packets)))
    assert frames_of(records) == [FRAME] and rejects.counts == {"ip_fragment": 4}


def test_a_packet_cut_by_the_snap_length_is_truncated() -> None:
    packet = ethernet(ipv4(udp(FRAMES[0] + FRAMES[1])))
    data = pcap([]) + pcap_record("<", START_US, packet[:-10], original=len(packet))
    records, rejects = read(data)
    assert frames_of(records) == FRAMES[:1] and rejects.counts == {"truncated": 1}
    cut = radiotap(odid_beacon())[:-10]
    records, rejects = read(pcap([], 127) + pcap_record("<", START_US, cut, original=len(cut) + 10))
    assert len(records) == 2 and rejects.counts == {"truncated_pack": 1}


# --- the air ---


@pytest.mark.parametrize(
    ("link_type", "packet", "transport", "count"),
    [
        (127, radiotap(odid_beacon(), 0x10), "wifi-beacon", 3),
        (105, odid_beacon(), "wifi-beacon", 3),
        (127, radiotap(nan()), "wifi-nan", 3),
        (105, nan(), "wifi-nan", 3),
        (272, nordic(extended(coded=True), coded=True), "bt5", 3),
        (272, nordic(legacy()), "bt4", 1),
        (251, extended(), "bt5", 3),
        (251, legacy(), "bt4", 1),
        (256, phdr(extended()), "bt5", 3),
    ],
)
def test_broadcasts_are_found_on_every_link_layer(link_type: int, packet: bytes, transport: str, count: int) -> None:
    for data in (pcap(timed([packet]), link_type), pcapng(timed([packet]), link_type, order=">")):
        records, rejects = read(data)
        assert not rejects and len(records) == count
        for index, record in enumerate(records):
            assert isinstance(record, TracedRecord)
            origin = record.origin
            assert (origin.transport, origin.mac, origin.counter, origin.index) == (transport, MAC, 7, index)
            assert origin.data == PACK[3 + 25 * index : 28 + 25 * index]
            assert (record.frame.compid, record.time_us) == (236, START_US)


def test_a_broadcast_is_a_message_with_who_said_it(tmp_path: Path) -> None:
    path = tmp_path / "air.pcap"
    path.write_bytes(pcap(timed([radiotap(odid_beacon())]), 127))
    identity, location, separation = read_messages(path)
    mac = MAC.ljust(20, b"\x00")
    assert identity.remote_id == BasicId(1, 2, b"1596F302A7K29QX0", mac) and identity.is_broadcast
    assert isinstance(location.remote_id, Location) and location.remote_id.latitude_deg == 47.4
    assert location.message is not None and location.message.latitude == 474000000
    assert location.message.id_or_mac == mac and location.source == (0, 236)
    assert isinstance(separation.remote_id, Separation) and separation.name == "RIDLINK_SEPARATION"


def test_a_frame_with_a_bad_checksum_is_a_reject() -> None:
    good = radiotap(odid_beacon())
    records, rejects = read(pcap(timed([good, radiotap(odid_beacon(), 0x50), radiotap(b"noise", 0x40), good]), 127))
    assert len(records) == 6 and rejects.counts == {"bad_checksum": 2}


def test_an_unknown_link_type_is_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "usb.pcap"
    for data in (pcap(timed([b"x"] * 5), 220), pcapng(timed([b"x"] * 5), 220)):
        path.write_bytes(data)
        with open_capture(path) as capture, pytest.raises(CaptureError, match="link type 220 is not read") as caught:
            list(capture)
        assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    mixed = section() + interface("<", 220) + interface("<", 1) + enhanced("<", START_US, b"x")
    records, rejects = read(mixed + enhanced("<", START_US, DATAGRAMS[0][1], number=1))
    assert len(records) == 1 and rejects.counts == {"link_type_220": 1}


@pytest.mark.parametrize("data", [pcap([]), pcapng([]), pcap(timed([ethernet(bytes(60))])), pcap([])[:20]])
def test_a_capture_without_anything_of_ours_is_an_error_at_its_end(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.pcap"
    path.write_bytes(data)
    with (
        open_capture(path) as capture,
        pytest.raises(CaptureError, match="no MAVLink frame in UDP or TCP and no Remote ID"),
    ):
        list(capture)


# --- damage ---

AIR = [radiotap(odid_beacon(counter=index), tsft=True) for index in range(20)]
FILES = {"pcap": pcap(timed(AIR), 127), "pcapng": pcapng(timed(AIR), 127), "big": pcap(timed(AIR), 127, order=">")}
HEADER_LENGTH = {"pcap": 24, "big": 24, "pcapng": len(pcapng([], 127))}


@pytest.mark.parametrize("kind", FILES)
def test_a_file_cut_anywhere_loses_only_what_is_cut(kind: str) -> None:
    data = FILES[kind]
    packets, _ = packets_of(data)
    ends = [packet.offset for packet in packets[1:]] + [len(data)]
    for length in range(ends[-4], len(data) + 1):
        found, rejects = packets_of(data[:length])
        assert found == packets[: sum(end <= length for end in ends)]
        assert rejects.counts == ({} if length in ends else {"truncated": 1})


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("junk", [b"x" * 333, random.Random(3).randbytes(5000), bytes(1000), b"\x00" * 7])
def test_junk_between_packets_costs_no_packet(kind: str, junk: bytes) -> None:
    data = FILES[kind]
    packets, _ = packets_of(data)
    at = packets[10].offset
    found, rejects = packets_of(data[:at] + junk + data[at:])
    assert [packet.data for packet in found] == [packet.data for packet in packets]
    assert [packet.time_us for packet in found] == [packet.time_us for packet in packets]
    assert rejects.counts == {"bad_packet_header": 1} and rejects.first_offset["bad_packet_header"] == at


@pytest.mark.parametrize("kind", FILES)
def test_f33_a_damaged_length_costs_one_packet(kind: str) -> None:
    data = FILES[kind]
    packets, _ = packets_of(data)
    at = packets[10].offset + {"pcap": 8, "big": 11, "pcapng": 4}[kind]
    for value in (0, 1, 0x20, 0x7F, 0xF0, 0xFF):
        for more in range(3):
            damaged = bytearray(data)
            damaged[at + (more if kind != "big" else -more)] ^= value
            found, _ = packets_of(bytes(damaged))
            times = {packet.time_us for packet in found}
            assert len({packet.time_us for packet in packets} - times) <= (1 if value else 0), (value, more)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("nanoseconds", [False, True])
@pytest.mark.parametrize(
    ("link_type", "packet"),
    [
        (1, ethernet(IP4)),
        (0, struct.pack("<I", 2) + IP4),
        (0, struct.pack(">I", 2) + IP4),
        (113, bytes.fromhex("0000000100060000000000000000") + b"\x08\x00" + IP4),
        (101, IP4),
        (127, radiotap(odid_beacon(), 0x10)),
        (105, odid_beacon()),
        (272, nordic(legacy())),
        (251, extended()),
        (256, phdr(extended())),
    ],
)
def test_f33_bytes_that_are_missing_cost_two_packets(
    link_type: int, packet: bytes, nanoseconds: bool, order: str
) -> None:
    """Four in particular: both lengths of a record say the same, and each stands where the other did."""
    data = pcap(timed([packet] * 21), link_type, order=order, nanoseconds=nanoseconds)
    packets, _ = packets_of(data)
    for at in (packets[10].offset + shift for shift in (0, 5, 8, 12, 20)):
        for missing in range(1, 9):
            found, rejects = packets_of(data[:at] + data[at + missing :])
            times = {whole.time_us for whole in found if whole.data == packet}
            assert len({whole.time_us for whole in packets} - times) <= 2 and rejects, (at, missing)


def test_f33_a_length_on_file_allocates_nothing() -> None:
    hostile = pcap(timed(AIR[:1]), 127) + struct.pack("<IIII", START_US // 10**6, 0, 0xFFFFFFF0, 0xFFFFFFF0)
    found, rejects = packets_of(hostile + b"".join(pcap_record("<", START_US, packet) for packet in AIR))
    assert len(found) == 21 and rejects.counts == {"bad_packet_header": 1}
    largest = pcap_record("<", START_US, bytes(MAX_PACKET_LENGTH))
    too_large = pcap_record("<", START_US, bytes(MAX_PACKET_LENGTH + 1))
    rest = b"".join(pcap_record("<", START_US, packet) for packet in AIR)
    found, rejects = packets_of(pcap([], 127) + largest + too_large + rest, 100_000)
    assert len(found) == 21 and rejects.counts == {"bad_packet_header": 1}
    huge = section() + interface("<", 127) + struct.pack("<II", 6, 0x7FFFFFFC) + bytes(50)
    found, rejects = packets_of(huge + enhanced("<", START_US, AIR[0]))
    assert len(found) == 1 and rejects.counts == {"bad_packet_header": 1}


@pytest.mark.parametrize("kind", [1, 2, 3, 6])
def test_a_block_shorter_than_its_kind_is_a_reject(kind: int) -> None:
    found, rejects = packets_of(
        section() + interface("<", 127) + block("<", kind, b"") + enhanced("<", START_US, AIR[0])
    )
    assert len(found) == 1 and rejects.counts == {"bad_packet_header": 1}


def test_a_packet_longer_than_its_block_is_a_reject() -> None:
    packet = bytearray(enhanced("<", START_US, AIR[0]))
    packet[20] += 8
    found, rejects = packets_of(section() + interface("<", 127) + bytes(packet) + enhanced("<", START_US, AIR[0]))
    assert len(found) == 1 and rejects.counts == {"bad_packet_header": 1}


def test_link_types_without_end_are_named_by_some() -> None:
    data = section()
    for number in range(200):
        data += interface("<", 1000 + number) + enhanced("<", START_US, b"x", number=number)
    with pytest.raises(CaptureError, match="is not read") as caught:
        read(data)
    assert len(str(caught.value)) < 400


def test_interfaces_without_end_are_refused() -> None:
    found, rejects = packets_of(section() + interface("<", 127) * 1500 + enhanced("<", START_US, AIR[0]), 10_000)
    assert len(found) == 1 and rejects.counts == {"too_many_interfaces": 1500 - 1024}


def test_f33_memory_does_not_grow_with_the_file() -> None:
    """The reader holds one packet and one chunk, whatever it has read before."""
    record = pcap_record("<", START_US, AIR[0])
    held = []

    def chunks() -> Any:
        yield pcap([], 127)
        for _ in range(200):
            yield record * 50

    for packet in read_packets(chunks(), Rejects()):
        held.append(packet.offset)
    assert len(held) == 10_000 and held[-1] == 24 + 9_999 * len(record)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([*FILES.values(), pcap(DATAGRAMS), pcapng(DATAGRAMS, order=">")]),
    st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=30),
    st.integers(0, 10_000),
    st.binary(max_size=60),
)
def test_a_mutated_file_is_read_to_its_end(data: bytes, changes: list[tuple[int, int]], at: int, junk: bytes) -> None:
    damaged = bytearray(data)
    for place, value in changes:
        damaged[place % len(damaged)] = value
    at %= len(damaged)
    damaged[at:at] = junk
    try:
        records, rejects = read(bytes(damaged))
    except CaptureError:
        return
    assert all(0 <= record.offset < len(damaged) for record in records)
    assert records == read(bytes(damaged), 10**6)[0] and len(rejects) >= 0


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([0, 1, 12, 101, 105, 108, 113, 127, 228, 229, 251, 256, 272, 276]),
    st.binary(max_size=120),
    st.sampled_from([b"", ethernet(IP4)[:14], ethernet(IP6, 0x86DD)[:14], IP4[:20], IP6[:40], AIR[0][:40]]),
)
def test_any_packet_of_any_link_type_is_read(link_type: int, content: bytes, head: bytes) -> None:
    read(pcap(timed([head + content or b"x"]), link_type))


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([pcap([]), pcapng([]), section(">"), b""]), st.binary(max_size=400))
def test_any_bytes_are_read(head: bytes, data: bytes) -> None:
    for chunk in (1, 1000):
        try:
            read(head + data, chunk)
        except CaptureError as error:
            assert "link type" in str(error)


def test_two_megabytes_of_noise_are_over_soon() -> None:
    """Linear: every byte is looked at once, or a bounded number of times. Bounded here by the test's own patience."""
    noise = random.Random(1).randbytes(2_000_000)
    for head in (pcap(timed(AIR[:3]), 127), pcapng(timed(AIR[:3]), 127)):
        found, rejects = packets_of(head + noise, 65536)
        assert len(found) == 3 and len(rejects) == 1


# --- formats told apart, the command ---


@pytest.mark.parametrize("data", [*FILES.values(), pcap(DATAGRAMS, nanoseconds=True)])
def test_the_content_tells_a_pcap_whatever_its_name(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "file.tlog"
    path.write_bytes(data)
    with open_capture(path) as capture:
        assert capture.kind is CaptureKind.PCAP and list(capture)


def rows_of(*arguments: str | Path) -> list[dict[str, Any]]:
    return [json.loads(line, parse_constant=pytest.fail) for line in run(*arguments, "-f", "jsonl").stdout.splitlines()]


def test_rows_say_how_they_came(tmp_path: Path) -> None:
    path = tmp_path / "x.pcap"
    path.write_bytes(pcap(timed([radiotap(odid_beacon())]), 127))
    result = run(path, "-f", "jsonl")
    first, second, _ = result.stdout.splitlines()
    assert first.startswith(
        '{"t":1700000000.123456,"transport":"wifi-beacon","mac":"84:cc:a8:60:43:24","counter":7,"index":0,'
        '"type":"OPEN_DRONE_ID_BASIC_ID","hex":"0212'
    )
    row = json.loads(second)
    assert list(row) == ["t", "transport", "mac", "counter", "index", "type", "hex", "fields"] and row["index"] == 1
    assert row["hex"] == PACK[28:53].hex() and row["fields"]["latitude_deg"] == 47.4
    table = run(path).stdout
    assert "84:cc:a8:60:43:24   7  OPEN_DRONE_ID_LOCATION" in table
    path.write_bytes(pcap(DATAGRAMS))
    (first, *_) = run(path, "-f", "jsonl").stdout.splitlines()
    assert first.startswith('{"t":1700000000.123456,"transport":"udp","src":"1/1","seq":0,"type":"HEARTBEAT","id":0,')


def test_statistics_count_transmitters(tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    mixed = section() + interface("<", 127) + interface("<", 1)
    mixed += enhanced("<", START_US, AIR[0]) + enhanced("<", START_US, radiotap(nan()))
    mixed += enhanced("<", START_US, DATAGRAMS[0][1], 1)
    path.write_bytes(mixed + enhanced("<", START_US, radiotap(odid_beacon(), 0x40)))
    (statistics,) = rows_of(path, "--stats")
    assert statistics["transmitters"] == {"84:cc:a8:60:43:24": {"wifi-beacon": 3, "wifi-nan": 3}}
    assert statistics["sources"] == {"1/1": {"messages": 1, "gaps": 0, "lost": 0}}
    assert statistics["rejects"][0]["cause"] == "bad_checksum"
    text = run(path, "--stats").stdout
    assert "84:cc:a8:60:43:24  wifi-beacon      3" in text and "OPEN_DRONE_ID_LOCATION  12901      2" in text
    assert run(path, "--strict").return_value == 4


def test_a_message_pack_of_mavlink_is_followed_by_its_members(tmp_path: Path) -> None:
    name, fields = pack_to_mavlink([BasicId(1, 2, b"SERIAL"), SelfId(0, b"hello")], id_or_mac=MAC)
    fields["messages"] = fields["messages"][:50] + b"\x62" + fields["messages"][51:]
    frame = Encoder(1, 236).encode(name, **(fields | {"msg_pack_size": 3}))
    path = tmp_path / "x.tlog"
    path.write_bytes(START_US.to_bytes(8, "big") + frame)
    pack, identity, text = rows_of(path)
    assert (pack["type"], pack["id"]) == ("OPEN_DRONE_ID_MESSAGE_PACK", 12915)
    assert (identity["type"], identity["id"], identity["src"], identity["index"]) == (
        "OPEN_DRONE_ID_BASIC_ID", 12900, "1/236", 0
    )  # fmt: skip
    assert identity["fields"]["uas_id"] == "SERIAL" and identity["fields"]["id_or_mac"].startswith(MAC.hex())
    assert text["index"] == 1 and text["hex"].startswith("3200")
    (statistics,) = rows_of(path, "--stats")
    assert statistics["types"] == {
        "OPEN_DRONE_ID_MESSAGE_PACK": 1, "OPEN_DRONE_ID_BASIC_ID": 1, "OPEN_DRONE_ID_SELF_ID": 1
    }  # fmt: skip
    assert statistics["sources"] == {"1/236": {"messages": 1, "gaps": 0, "lost": 0}}
    assert statistics["fields_out_of_range"] == {"OPEN_DRONE_ID_MESSAGE_PACK.unknown_message_type": 1}
