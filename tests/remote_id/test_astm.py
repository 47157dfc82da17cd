"""The 25-byte messages and their packs: golden vectors, safe rounding, and whatever strangers may send."""

from __future__ import annotations

import json
import math
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.errors import PayloadError
from ridlink.remote_id.astm import (
    MESSAGE_LENGTH,
    Refusal,
    decode_message,
    encode_message,
    refusal_of,
)
from ridlink.remote_id.astm_pack import BadMember, Member, encode_pack, is_pack, join_pack, split_broadcast
from ridlink.remote_id.messages import (
    MAVLINK_NAMES,
    Authentication,
    BasicId,
    Location,
    OperatorId,
    RemoteIdMessage,
    SelfId,
    Separation,
    System,
)
from tests.remote_id.vectors import KINDS, PACKS, SINGLE, VECTORS, any_25_bytes, message_of, messages_25

LOCATION = bytes.fromhex("12205a3103f824531eeb589302c1081b092a084a4339300100")


def test_every_message_has_vectors_in_both_directions() -> None:
    ways = {(vector["type"], vector["way"]) for vector in VECTORS}
    for name in (*KINDS, "OPEN_DRONE_ID_MESSAGE_PACK"):
        assert (name, "both") in ways
    assert len(VECTORS) == len({(vector["way"], json.dumps(vector.get("fields")), vector["hex"]) for vector in VECTORS})


def test_fields_become_the_bytes_of_the_vectors() -> None:
    for vector in SINGLE:
        if vector["way"] != "decode":
            data = encode_message(message_of(vector), hour_start_s=vector.get("hour_start_s"))
            assert data.hex() == vector["hex"], vector["note"]


def test_bytes_become_the_fields_of_the_vectors() -> None:
    for vector in SINGLE:
        if vector["way"] != "encode":
            assert decode_message(bytes.fromhex(vector["hex"])) == message_of(vector), vector["note"]


def test_packs_come_apart_and_together_as_in_the_vectors() -> None:
    for vector in PACKS:
        found = split_broadcast(bytes.fromhex(vector["hex"]))
        assert [item.data.hex() for item in found if isinstance(item, Member)] == vector["messages"]
        assert [item.refusal for item in found if isinstance(item, BadMember)] == vector.get("refused", [])
        if vector["way"] == "both":
            assert join_pack([bytes.fromhex(member) for member in vector["messages"]]).hex() == vector["hex"]


# --- what is out of range, unknown or damaged ---


def changed(data: bytes, **values: int) -> bytes:
    """The bytes with some of them replaced: ``b4=0x84``."""
    copy = bytearray(data)
    for name, value in values.items():
        copy[int(name[1:])] = value
    return bytes(copy)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"b1": 0x22, "b2": 182}, "direction"),
        ({"b4": 125}, "speed_vertical"),
        ({"b4": 0x80}, "speed_vertical"),
        ({"b8": 0x7F}, "latitude"),
        ({"b12": 0x7F}, "longitude"),
        ({"b21": 0xFE, "b22": 0xFF}, "timestamp"),
    ],
)
def test_a_field_out_of_range_is_lost_alone_and_counted(change: dict[str, int], field: str) -> None:
    rejects: Counter[str] = Counter()
    good, bad = decode_message(LOCATION), decode_message(changed(LOCATION, **change), rejects)
    assert rejects == {f"OPEN_DRONE_ID_LOCATION.{field}": 1}
    lost = [name for name in Location.__struct_fields__ if getattr(bad, name) != getattr(good, name)]
    assert len(lost) == 1 and lost[0].startswith(field) and getattr(bad, lost[0]) is None


@pytest.mark.parametrize("version", range(16))
def test_every_version_is_read_and_unknown_ones_are_counted(version: int) -> None:
    rejects: Counter[str] = Counter()
    assert decode_message(changed(LOCATION, b0=0x10 | version), rejects) == decode_message(LOCATION)
    assert rejects == ({} if version <= 2 else {"OPEN_DRONE_ID_LOCATION.protocol_version": 1})


def test_what_an_old_version_left_zero_is_unknown() -> None:
    """Version 0 had neither the operator's altitude nor a time in its System message."""
    message = decode_message(bytes.fromhex("4004a485251b6edbb3b601003200000000150000000000000000"[:50]))
    assert isinstance(message, System)
    assert (message.operator_altitude_geo_m, message.timestamp_s, message.area_radius_m) == (None, None, 500.0)
    assert (message.category_eu, message.class_eu, message.area_ceiling_m) == (1, 5, None)


@pytest.mark.parametrize(
    ("direction_deg", "west", "byte"), [(360.0, 0, 0), (370.0, 0, 10), (-90.0, 1, 90), (720.4, 0, 0)]
)
def test_directions_beyond_a_turn_are_directions(direction_deg: float, west: int, byte: int) -> None:
    sent = encode_message(Location(direction_deg=direction_deg))
    assert (sent[1] >> 1 & 1, sent[2]) == (west, byte)


def test_a_whole_turn_is_north() -> None:
    message = decode_message(bytes((0x12, 0x02, 180)) + LOCATION[3:])
    assert isinstance(message, Location) and message.direction_deg == 0.0


def test_reserved_codes_are_kept_as_numbers() -> None:
    message = decode_message(changed(LOCATION, b1=0xF0, b19=0xFF, b20=0xFF))
    assert isinstance(message, Location)
    assert (message.status, message.horizontal_accuracy, message.vertical_accuracy) == (15, 15, 15)
    assert message.horizontal_accuracy_m is message.vertical_accuracy_m is message.speed_accuracy_mps is None


@pytest.mark.parametrize(
    ("data", "refusal"),
    [
        (b"", Refusal.WRONG_LENGTH),
        (LOCATION[:-1], Refusal.WRONG_LENGTH),
        (LOCATION + b"\x00", Refusal.WRONG_LENGTH),
        (b"\xf2" + bytes(24), Refusal.NESTED_PACK),
        (b"\x62" + bytes(24), Refusal.UNKNOWN_TYPE),
        (b"\x22\x00\x10" + bytes(22), Refusal.BAD_PAGE),
    ],
)
def test_what_is_no_message_says_why(data: bytes, refusal: Refusal) -> None:
    assert refusal_of(data) is refusal
    with pytest.raises(PayloadError, match=refusal):
        decode_message(data)


def test_an_authentication_longer_than_its_pages_is_counted() -> None:
    rejects: Counter[str] = Counter()
    message = decode_message(b"\x22\x10\x00\xff" + bytes(21), rejects)
    assert isinstance(message, Authentication) and message.length == 255
    assert rejects == {"OPEN_DRONE_ID_AUTHENTICATION.length": 1}
    with pytest.raises(PayloadError, match="length"):
        encode_message(message)


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (BasicId(16, 0, b""), "id_type"),
        (BasicId(0, -1, b""), "ua_type"),
        (BasicId(0, 16, b""), "ua_type"),
        (BasicId(0, 0, bytes(21)), "uas_id"),
        (Location(status=16), "status"),
        (Location(height_reference=2), "height_reference"),
        (Location(horizontal_accuracy=16), "horizontal_accuracy"),
        (Location(vertical_accuracy=16), "vertical_accuracy"),
        (Location(barometer_accuracy=16), "barometer_accuracy"),
        (Location(speed_accuracy=99), "speed_accuracy"),
        (System(operator_location_type=4), "operator_location_type"),
        (System(classification_type=8), "classification_type"),
        (System(category_eu=16), "category_eu"),
        (System(class_eu=16), "class_eu"),
        (System(area_count=65536), "area_count"),
        (SelfId(256, b""), "description_type"),
        (SelfId(0, bytes(24)), "description"),
        (OperatorId(256, b""), "operator_id_type"),
        (OperatorId(0, bytes(21)), "operator_id"),
        (Authentication(16, 0, 0, 0, None, b""), "authentication_type"),
        (Authentication(1, 16, 0, 0, None, b""), "data_page"),
        (Authentication(1, 0, 16, 0, None, b""), "last_page_index"),
        (Authentication(1, 0, 0, 18, None, b""), "length"),
        (Authentication(1, 0, 15, 256, None, b""), "length"),
        (Authentication(1, 0, 0, 17, None, bytes(18)), "authentication_data"),
        (Authentication(1, 1, 0, 0, None, bytes(24)), "authentication_data"),
        (Separation(flags=256), "flags"),
    ],
)
def test_what_does_not_fit_its_bits_is_refused_by_name(message: RemoteIdMessage, field: str) -> None:
    with pytest.raises(PayloadError, match=field) as caught:
        encode_message(message)
    assert caught.value.field == field and caught.value.message == MAVLINK_NAMES[type(message)]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1e30, 1e30])
def test_no_number_breaks_the_encoder(value: float) -> None:
    names = [name for name in Location.__struct_fields__ if name.endswith(("_deg", "_mps", "_m", "_s"))]
    decode_message(encode_message(Location(**dict.fromkeys(names, value))))
    decode_message(encode_message(System(0, 0, value, value, 1, value, value, value, 0, 0, value, value)))
    decode_message(encode_message(Separation(*[value] * 10, flags=8), hour_start_s=0))


# --- properties ---

degrees = st.floats(-90, 90)
heights = st.none() | st.floats(-999, 31767)
codes = st.integers(0, 15)
locations = st.builds(
    Location, status=codes, direction_deg=st.none() | st.floats(0, 360),
    speed_horizontal_mps=st.none() | st.floats(0, 254), speed_vertical_mps=st.none() | st.floats(-62, 62),
    latitude_deg=degrees, longitude_deg=degrees,
    altitude_barometric_m=heights, altitude_geodetic_m=heights, height_m=heights, height_reference=st.integers(0, 1),
    horizontal_accuracy=codes, vertical_accuracy=codes, barometer_accuracy=codes, speed_accuracy=codes,
    timestamp_s=st.none() | st.floats(0, 3600), timestamp_accuracy_s=st.none() | st.floats(0, 1.5),
)  # fmt: skip


def within(sent: float | None, got: float | None, step: float) -> bool:
    if sent is None or got is None:
        return sent is got
    return abs(sent - got) <= step / 2 + 1e-9


@given(locations)
def test_a_location_survives_within_its_steps(sent: Location) -> None:
    got = decode_message(encode_message(sent))
    assert isinstance(got, Location)
    coarse = sent.speed_horizontal_mps is not None and sent.speed_horizontal_mps > 63.75
    assert within(sent.speed_horizontal_mps, got.speed_horizontal_mps, 0.75 if coarse else 0.25)
    assert within(sent.speed_vertical_mps, got.speed_vertical_mps, 0.5)
    for name in ("altitude_barometric_m", "altitude_geodetic_m", "height_m"):
        assert within(getattr(sent, name), getattr(got, name), 0.5)
    assert within(sent.timestamp_s, got.timestamp_s, 0.1)
    assert got.latitude_deg is not None and sent.latitude_deg is not None
    assert got.latitude_deg == pytest.approx(sent.latitude_deg, abs=6e-8)
    if sent.direction_deg is not None:
        assert got.direction_deg is not None
        assert abs((got.direction_deg - sent.direction_deg + 180) % 360 - 180) <= 0.5 + 1e-9
    if sent.timestamp_accuracy_s is not None:
        assert got.timestamp_accuracy_s is not None and got.timestamp_accuracy_s >= sent.timestamp_accuracy_s - 1e-6


@given(st.floats(0, 5000), st.none() | st.floats(-900, 3000), st.none() | st.floats(-900, 3000))
def test_an_area_of_operation_is_never_understated(radius: float, ceiling: float | None, floor: float | None) -> None:
    got = decode_message(encode_message(System(area_radius_m=radius, area_ceiling_m=ceiling, area_floor_m=floor)))
    assert isinstance(got, System)
    assert got.area_radius_m >= min(radius, 2550.0) - 1e-3
    assert (got.area_ceiling_m is None) == (ceiling is None) and (got.area_floor_m is None) == (floor is None)
    assert ceiling is None or got.area_ceiling_m is None or got.area_ceiling_m >= ceiling - 1e-6
    assert floor is None or got.area_floor_m is None or got.area_floor_m <= floor + 1e-6


@given(any_25_bytes)
def test_any_25_bytes_are_a_message_or_refused(data: bytes) -> None:
    if refusal_of(data) is None:
        decode_message(data)
    else:
        with pytest.raises(PayloadError):
            decode_message(data)


@given(messages_25)
def test_what_was_read_is_written_back_alike(data: bytes) -> None:
    """Once the reserved bits and the two ways to say one thing are gone, bytes and fields are the same thing."""
    try:
        canonical = encode_message(decode_message(data), hour_start_s=0)
    except PayloadError as error:
        assert error.field == "length"
        return
    again = encode_message(decode_message(canonical), hour_start_s=0)
    assert again == canonical and decode_message(again) == decode_message(canonical)


@given(st.binary(max_size=300))
def test_any_bytes_come_apart(data: bytes) -> None:
    for item in split_broadcast(data) + split_broadcast(b"\xf2\x19" + data):
        if isinstance(item, Member):
            decode_message(item.data)


@given(st.lists(messages_25, min_size=1, max_size=9), st.integers(0, 300))
def test_a_cut_pack_gives_its_whole_members_and_one_reject(members: list[bytes], length: int) -> None:
    pack = join_pack(members)
    found = split_broadcast(pack[:length])
    if length >= len(pack):
        assert found == [Member(*item) for item in enumerate(members)]
    elif length:
        whole = max(0, (length - 3) // MESSAGE_LENGTH)
        assert found == [*(Member(*item) for item in enumerate(members[:whole])),
                         BadMember(whole, Refusal.TRUNCATED_PACK)]  # fmt: skip


def test_a_message_alone_is_a_broadcast_too() -> None:
    assert split_broadcast(LOCATION + b"trailer") == [Member(0, LOCATION)] and not is_pack(LOCATION)
    assert split_broadcast(LOCATION[:20]) == [BadMember(0, Refusal.WRONG_LENGTH)]


@pytest.mark.parametrize("count", [0, 10])
def test_packs_have_one_to_nine_members(count: int) -> None:
    with pytest.raises(PayloadError, match="1 to 9"):
        encode_pack([SelfId(0, b"")] * count)
    with pytest.raises(PayloadError, match="nested"):
        join_pack([b"\xf2" + bytes(24)])
