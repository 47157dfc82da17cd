"""MAVLink over TCP in a capture: streams cut anywhere, what comes twice, late or never, and other protocols."""

from __future__ import annotations

import itertools
import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.captures import tcp as tcp_streams
from ridlink.captures.packets import read_pcap
from ridlink.captures.raw import read_raw
from ridlink.captures.records import Record, Rejects, TracedRecord
from ridlink.captures.tcp import JUDGED_BYTES, MOST_STREAMS, REACH
from tests.captures.command import run
from tests.captures.conftest import flight
from tests.captures.pcap_files import START_US, STEP_US, ethernet, ipv4, ipv6, pcap, tcp, timed, udp

FRAMES = [frame for _, frame in flight(30)]
STREAM = b"".join(FRAMES)
FIRST = 2**32 - 100
"""Sequence numbers wrap within the stream."""


def packet(content: bytes) -> bytes:
    return ethernet(ipv4(content, protocol=6))


def segments(stream: bytes, length: int, first: int = FIRST, port: int = 5760) -> list[bytes]:
    return [packet(tcp(stream[at : at + length], first + at, port=port)) for at in range(0, len(stream), length)]


def read(packets: list[bytes]) -> tuple[list[Record], Rejects]:
    rejects = Rejects()
    return list(read_pcap([pcap(timed(packets))], rejects)), rejects


def as_raw(stream: bytes) -> Rejects:
    """What is refused of the same bytes in a file."""
    rejects = Rejects()
    assert list(read_raw([stream], rejects))
    return rejects


def frames_of(records: list[Record]) -> list[bytes]:
    return [record.frame.raw for record in records]


@pytest.mark.parametrize("length", [1, 13, 40, 1460])
@pytest.mark.parametrize("begins", [True, False])
def test_a_stream_is_read_however_it_is_cut(length: int, begins: bool) -> None:
    beginning = [packet(tcp(b"", FIRST - 1, syn=True))] if begins else []
    records, rejects = read(beginning + segments(STREAM, length))
    assert frames_of(records) == FRAMES and not rejects
    assert all(isinstance(record, TracedRecord) and record.origin.transport == "tcp" for record in records)
    last = START_US + (len(beginning) + (len(STREAM) - 1) // length) * STEP_US
    assert records[-1].time_us == last  # when its last byte came


def test_both_directions_and_both_families_are_streams_of_their_own() -> None:
    sixth = (
        ethernet(ipv6(tcp(STREAM[:50], 7), header=6), 0x86DD),
        ethernet(ipv6(tcp(STREAM[50:], 57), header=6), 0x86DD),
    )
    there, here = segments(STREAM, 50), segments(STREAM, 50, first=12, port=5761)
    mixed = [each for pair in zip(there, here, strict=True) for each in pair]
    records, rejects = read([sixth[0], *mixed, sixth[1]])
    assert sorted(frames_of(records)) == sorted(FRAMES * 3) and not rejects


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 120), st.integers(0, 200)), max_size=20))
def test_what_is_sent_again_is_taken_once(steps: list[tuple[int, int]]) -> None:
    """Each begins some way back, and may bring something new."""
    sent, packets = 0, []
    for back, length in [*steps, (0, len(STREAM))]:
        start = max(sent - back, 0)
        packets.append(packet(tcp(STREAM[start : start + length], FIRST + start)))
        sent = max(sent, min(start + length, len(STREAM)))
    records, rejects = read(packets)
    assert frames_of(records) == FRAMES and not rejects


def test_what_is_missing_is_a_gap_and_costs_the_frames_in_it() -> None:
    ends = itertools.accumulate(map(len, FRAMES))
    sent = [packet(tcp(frame, FIRST + end - len(frame))) for frame, end in zip(FRAMES, ends, strict=True)]
    records, rejects = read(sent[:10] + sent[12:])
    assert frames_of(records) == FRAMES[:10] + FRAMES[12:]
    assert rejects.counts == {"tcp_gap": 1}
    halves = segments(STREAM, 40)
    records, rejects = read(halves[:5] + halves[6:])
    assert set(frames_of(records)) < set(FRAMES) and len(records) >= 27
    assert rejects.counts["tcp_gap"] == 1


@settings(deadline=None)
@given(st.randoms(use_true_random=False), st.integers(1, 60), st.booleans())
def test_what_comes_late_takes_its_place(chance: random.Random, length: int, again: bool) -> None:
    """Each segment up to half a second late, and some of them twice."""
    sent = segments(STREAM, length)
    places = [*range(len(sent)), *chance.sample(range(len(sent)), len(sent) // 3 if again else 0)]
    places.sort(key=lambda place: place + chance.randrange(15))
    records, rejects = read([packet(tcp(b"", FIRST - 1, syn=True)), *(sent[place] for place in places)])
    assert frames_of(records) == FRAMES and not rejects
    times = [record.time_us for record in records]
    assert times == sorted(times)  # type: ignore[type-var]  # each when the last of it came


def test_what_does_not_come_for_seconds_is_missing() -> None:
    sent = segments(STREAM, len(FRAMES[0]))
    other = ethernet(ipv4(udp(b"x")))
    records, rejects = read([*sent[:3], *sent[4:], *[other] * 100, sent[3]])
    assert 25 <= len(records) < 30 and rejects.counts["tcp_gap"] == 1
    assert records[-1].time_us == START_US + (len(sent) - 2) * STEP_US  # as it came


def test_loss_everywhere_delays_nothing_for_good() -> None:
    sent = [each for index, each in enumerate(segments(STREAM * 20, 33)) if index % 5]
    records, rejects = read(sent)
    assert len(records) > 300 and rejects.counts["tcp_gap"] > 50
    latest = 0
    for record in records:
        assert record.time_us is not None and record.time_us > latest - STEP_US
        latest = max(latest, record.time_us)
    assert len({record.time_us for record in records}) > 250  # those behind a gap keep the times at which they came


def test_a_segment_of_nobody_costs_nothing() -> None:
    """Resets with a sequence number of their own, and bytes far ahead of all others."""
    sent = segments(STREAM, len(FRAMES[0]))
    nobodys = [packet(tcp(b"", 0)), packet(tcp(b"x" * 10, FIRST + REACH // 2))]
    records, rejects = read(sent[:9] + nobodys + sent[9:])
    assert frames_of(records) == FRAMES and rejects.first_offset["tcp_gap"] > 0


def test_an_opening_segment_that_is_seen_twice_or_late_opens_once() -> None:
    opening = packet(tcp(b"", FIRST - 1, syn=True))
    sent = segments(STREAM, 50)
    for packets in ([opening, opening, *sent], [sent[0], opening, *sent[1:]], [opening, *sent[:5], opening, *sent[5:]]):
        records, rejects = read(packets)
        assert frames_of(records) == FRAMES and not rejects


def test_f33_what_waits_has_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp_streams, "MOST_WAITING_BYTES", 10_000)
    rejects = Rejects()
    streams = tcp_streams.TcpStreams(rejects)
    for at in range(3000):
        segment = tcp_streams.Segment((b"", b"", at % 30, 1), 8 + 70 * (at // 30), False, FRAMES[0])
        assert len(list(streams.records(segment, START_US, at))) <= 40
        assert streams.waiting_bytes <= 10_000
    assert list(streams.finish()) and not streams.waiting_bytes and len(rejects) > 2000


def test_a_capture_that_begins_within_a_frame_has_no_damage() -> None:
    records, rejects = read(segments(STREAM, 30)[1:])
    assert frames_of(records) == FRAMES[-len(records) :] and len(records) >= 27 and not rejects


def test_one_that_ends_within_a_frame_is_truncated() -> None:
    records, rejects = read(segments(STREAM[:-3], 200))
    assert frames_of(records) == FRAMES[:-1] and rejects.counts == as_raw(STREAM[:-3]).counts != {}


def test_a_connection_after_another_one_between_the_same_ports_begins_anew() -> None:
    for beginning, first in (([packet(tcp(b"", FIRST - 5000, syn=True))], FIRST - 4999), ([], FIRST - REACH - 5000)):
        records, rejects = read(segments(STREAM, 200) + beginning + segments(STREAM, 200, first=first))
        assert frames_of(records) == FRAMES * 2 and not rejects


def test_other_protocols_are_passed_over_and_those_after_them_are_not() -> None:
    noise = random.Random(1).randbytes(40 * JUDGED_BYTES).replace(b"\xfd", b"x").replace(b"\xfe", b"y")
    web = b"HTTP/1.1 200 OK\r\n\r\n\xfd\x09\x00" + noise + STREAM  # too late
    records, rejects = read(segments(web, 1400, port=80) + segments(STREAM, 100))
    assert frames_of(records) == FRAMES and not rejects


def test_damage_within_a_stream_is_counted() -> None:
    damaged = bytearray(STREAM)
    damaged[len(FRAMES[0]) + len(FRAMES[1]) - 3] ^= 1
    records, rejects = read(segments(bytes(damaged), 1000))
    assert frames_of(records) == [FRAMES[0], *FRAMES[2:]]
    assert rejects.counts == as_raw(bytes(damaged)).counts != {}


def test_f33_connections_without_end_are_forgotten() -> None:
    half = len(FRAMES[0]) // 2
    first = [packet(tcp(FRAMES[0][:half], 5, port=port)) for port in range(1, MOST_STREAMS + 2)]
    rest = [packet(tcp(FRAMES[0][half:], 5 + half, port=port)) for port in (1, MOST_STREAMS + 1)]
    records, rejects = read(first + rest)
    assert frames_of(records) == FRAMES[:1] and not rejects


def test_the_command_shows_them_as_any_others(tmp_path: Path) -> None:
    path = tmp_path / "x.pcap"
    path.write_bytes(pcap(timed(segments(STREAM, 100))))
    first, *others = run(path, "-f", "jsonl").stdout.splitlines()
    assert '"transport":"tcp","src":"1/1","seq":0,"type":"HEARTBEAT"' in first and len(others) == 29
    assert "no rejects" in run(path, "--stats").stdout
