"""Between the radio and MAVLink: nothing is lost that both can hold, and packs reach the reports."""

from __future__ import annotations

from collections import Counter

from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from ridlink.errors import PayloadError
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id import astm
from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.bridge import messages_of, pack_to_mavlink
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import (
    Authentication,
    BasicId,
    Location,
    RemoteIdMessage,
    SelfId,
    Separation,
)
from tests.remote_id.vectors import messages_25

MAC = bytes.fromhex("84cca8604324").ljust(20, b"\x00")
HERE = Location(latitude_deg=47.4, longitude_deg=8.5, timestamp_s=1234.5)
ERRORS = Separation(timestamp_s=1234.5, horizontal_error_m=3.0, airframe_size_m=0.6)


def over_mavlink(name: str, fields: dict[str, object]) -> Message:
    frame = parse_datagram(Encoder(1, 236).encode(name, **fields), CRC_EXTRAS)[0]
    assert isinstance(frame, Frame)
    return decode_message(frame)


separations_25 = st.builds(
    Separation,
    timestamp_s=st.none() | st.floats(0.0, 3599.0),
    horizontal_error_m=st.none() | st.floats(0.0, 700.0),
    vertical_error_m=st.none() | st.floats(0.0, 130.0),
    airframe_size_m=st.none() | st.floats(0.0, 30.0),
    flags=st.integers(0, 7),
).map(lambda message: astm.encode_message(message, hour_start_s=0))


@given(messages_25 | separations_25, st.sampled_from([None, MAC]))
def test_a_broadcast_survives_mavlink_byte_for_byte(data: bytes, mac: bytes | None) -> None:
    try:
        canonical = astm.encode_message(astm.decode_message(data), hour_start_s=0)
    except PayloadError:
        return
    heard = astm.decode_message(canonical, id_or_mac=mac)
    (relayed,) = messages_of(over_mavlink(*to_mavlink(heard)))
    assert relayed.id_or_mac == mac
    if isinstance(relayed, Separation):  # both know it: its time is a float there and whole seconds here
        assert relayed.timestamp_s == heard.timestamp_s
    assert astm.encode_message(relayed, hour_start_s=0) == canonical


@given(st.lists(messages_25.map(astm.decode_message), min_size=1, max_size=9), st.sampled_from([None, MAC]))
def test_a_pack_survives_mavlink(messages: list[RemoteIdMessage], mac: bytes | None) -> None:
    try:
        name, fields = pack_to_mavlink(messages, id_or_mac=mac, hour_start_s=0)
    except PayloadError:
        return
    rejects: Counter[str] = Counter()
    got = messages_of(over_mavlink(name, fields), rejects)
    alone = [astm.decode_message(astm.encode_message(message, hour_start_s=0), id_or_mac=mac) for message in messages]
    assert len(got) == len(alone) and all(message.id_or_mac == mac for message in got)
    assert [one for one in got if not isinstance(one, Separation)] == [
        one for one in alone if not isinstance(one, Separation)
    ]


def test_a_damaged_member_of_a_pack_costs_only_itself() -> None:
    name, fields = pack_to_mavlink([BasicId(1, 2, b"SERIAL"), HERE, SelfId(0, b"hello")])
    fields["messages"] = fields["messages"][:25] + b"\x62" + fields["messages"][26:]
    rejects: Counter[str] = Counter()
    got = messages_of(over_mavlink(name, fields), rejects)
    assert got == [BasicId(1, 2, b"SERIAL"), SelfId(0, b"hello")]
    assert rejects == {"OPEN_DRONE_ID_MESSAGE_PACK.unknown_message_type": 1}


@given(st.integers(0, 255), st.integers(0, 255), st.binary(max_size=225))
def test_any_pack_is_read(size: int, count: int, content: bytes) -> None:
    rejects: Counter[str] = Counter()
    fields = {"single_message_size": size, "msg_pack_size": count, "messages": content}
    got = messages_of(over_mavlink("OPEN_DRONE_ID_MESSAGE_PACK", fields), rejects)
    if size != 25 or not 1 <= count <= 9:
        assert not got and rejects.total() == 1


def test_what_is_no_remote_id_says_nothing() -> None:
    assert messages_of(over_mavlink("HEARTBEAT", {})) == []


def test_a_separation_that_a_stock_receiver_relayed_is_recognised() -> None:
    """It knows only Authentication, and hands that on."""
    page = astm.encode_message(ERRORS)
    authentication = Authentication(0xA, 0, 0, 16, None, page[8:], MAC)
    (got,) = messages_of(over_mavlink(*to_mavlink(authentication)))
    assert isinstance(got, Separation) and (got.horizontal_error_m, got.id_or_mac) == (3.0, MAC)
    (other,) = messages_of(over_mavlink(*to_mavlink(Authentication(1, 0, 0, 16, None, page[8:]))))
    assert isinstance(other, Authentication)


def test_in_a_pack_a_separation_takes_the_time_of_its_location() -> None:
    """The radio gives it in whole seconds or, from a sender without a clock, not at all."""
    for hour_start_s in (None, 3600 * 60_000):
        _, fields = pack_to_mavlink([HERE, ERRORS], hour_start_s=hour_start_s)
        location, separation = messages_of(over_mavlink("OPEN_DRONE_ID_MESSAGE_PACK", fields))
        assert isinstance(location, Location) and isinstance(separation, Separation)
        assert separation.timestamp_s == location.timestamp_s == 1234.5
        assembler = ReportAssembler()
        assembler.receive((1, 236), location, 10.0)
        report = assembler.receive((1, 236), separation, 10.0)
        assert report is not None and report.extended and report.horizontal_error_m == 3.0
    stale = Separation(timestamp_s=900.0, horizontal_error_m=3.0)
    _, fields = pack_to_mavlink([HERE, stale], hour_start_s=3600)
    _, separation = messages_of(over_mavlink("OPEN_DRONE_ID_MESSAGE_PACK", fields))
    assert isinstance(separation, Separation) and separation.timestamp_s == 900.0


@given(st.floats(0.0, 3600.0, exclude_max=True))
@example(1234.96)  # 1235.0 s in the one, second 1234 in the other
@example(3599.96)  # 3600.0 s in the one, second 3599 in the other
@example(0.0)
def test_in_a_pack_both_of_one_instant_are_joined_whenever_it_is(timestamp_s: float) -> None:
    both = replace(HERE, timestamp_s=timestamp_s), replace(ERRORS, timestamp_s=timestamp_s)
    _, fields = pack_to_mavlink(both, hour_start_s=3600 * 60_000)
    location, separation = messages_of(over_mavlink("OPEN_DRONE_ID_MESSAGE_PACK", fields))
    assert isinstance(location, Location) and isinstance(separation, Separation)
    assert separation.timestamp_s == location.timestamp_s
