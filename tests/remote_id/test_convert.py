"""Remote ID between the wire and SI: sentinels, ranges, rounding, and the way there and back."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.errors import PayloadError
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES_BY_NAME, Encoder, Message, decode_message, message_spec
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.astm import decode_message as decode_broadcast
from ridlink.remote_id.astm import encode_message as encode_broadcast
from ridlink.remote_id.convert import from_mavlink, to_mavlink
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

NAMES = [
    "OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_LOCATION", "OPEN_DRONE_ID_AUTHENTICATION", "OPEN_DRONE_ID_SELF_ID",
    "OPEN_DRONE_ID_SYSTEM", "OPEN_DRONE_ID_OPERATOR_ID", "RIDLINK_SEPARATION",
]  # fmt: skip


def over_the_wire(message: RemoteIdMessage, rejects: Counter[str] | None = None) -> RemoteIdMessage | None:
    name, fields = to_mavlink(message)
    frame = parse_datagram(Encoder(1, 1).encode(name, **fields), CRC_EXTRAS)[0]
    assert isinstance(frame, Frame)
    return from_mavlink(decode_message(frame), rejects)


def received(name: str, rejects: Counter[str] | None = None, **fields: Any) -> Any:
    """What a receiver makes of a frame with these fields and zeros elsewhere."""
    frame = parse_datagram(Encoder(1, 1).encode(name, **fields), CRC_EXTRAS)[0]
    assert isinstance(frame, Frame)
    return from_mavlink(decode_message(frame), rejects)


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (BasicId(1, 2, "1596F001"), "uas_id"),  # type: ignore[arg-type]
        (SelfId(0, "Survey"), "description"),  # type: ignore[arg-type]
        (OperatorId(0, "CHE123"), "operator_id"),  # type: ignore[arg-type]
        (Authentication(1, 0, 0, 1, None, "1"), "authentication_data"),  # type: ignore[arg-type]
    ],
)
@pytest.mark.parametrize("write", [to_mavlink, encode_broadcast])
def test_text_in_place_of_bytes_is_refused_by_name(
    write: Callable[[RemoteIdMessage], object], message: RemoteIdMessage, field: str
) -> None:
    with pytest.raises(PayloadError, match=f"{field} takes bytes, not str") as caught:
        write(message)
    assert caught.value.field == field and caught.value.message == MAVLINK_NAMES[type(message)]


SENTINELS: dict[str, Any] = {
    "direction": 36100, "speed_horizontal": 25500, "speed_vertical": 6300, "latitude": 0, "longitude": 0,
    "altitude_barometric": -1000.0, "altitude_geodetic": -1000.0, "height": -1000.0, "timestamp": 65535.0,
}  # fmt: skip


def test_a_location_of_sentinels_knows_nothing_and_rejects_nothing() -> None:
    rejects: Counter[str] = Counter()
    assert received("OPEN_DRONE_ID_LOCATION", rejects, **SENTINELS) == Location()
    assert to_mavlink(Location())[1].items() >= SENTINELS.items()
    assert not rejects


@pytest.mark.parametrize(
    ("wire_field", "value", "si_field"),
    [
        ("latitude", 900000001, "latitude_deg"),
        ("longitude", -1800000001, "longitude_deg"),
        ("latitude", 2**31 - 1, "latitude_deg"),
        ("direction", 36001, "direction_deg"),
        ("direction", 65535, "direction_deg"),
        ("speed_horizontal", 25426, "speed_horizontal_mps"),
        ("speed_horizontal", 65535, "speed_horizontal_mps"),
        ("speed_vertical", -6201, "speed_vertical_mps"),
        ("speed_vertical", 6201, "speed_vertical_mps"),
        ("altitude_geodetic", math.nan, "altitude_geodetic_m"),
        ("altitude_barometric", math.inf, "altitude_barometric_m"),
        ("height", -1001.0, "height_m"),
        ("height", 31768.0, "height_m"),
        ("timestamp", 3600.5, "timestamp_s"),
        ("timestamp", -math.inf, "timestamp_s"),
    ],
)
def test_f01_a_field_out_of_range_is_lost_alone(wire_field: str, value: float, si_field: str) -> None:
    good: dict[str, Any] = {
        "latitude": 508765432, "longitude": 43210987, "direction": 9000, "speed_horizontal": 1225,
        "speed_vertical": 150, "altitude_barometric": 120.5, "altitude_geodetic": 165.5, "height": 45.0,
        "timestamp": 1234.5,
    }  # fmt: skip
    rejects: Counter[str] = Counter()
    location = received("OPEN_DRONE_ID_LOCATION", rejects, **(good | {wire_field: value}))
    assert getattr(location, si_field) is None
    assert rejects == {f"OPEN_DRONE_ID_LOCATION.{wire_field}": 1}
    untouched = received("OPEN_DRONE_ID_LOCATION", **good)
    others = [name for name in Location.__slots__ if name != si_field]
    assert [getattr(location, name) for name in others] == [getattr(untouched, name) for name in others]


def test_limits_of_the_ranges_are_in_range() -> None:
    rejects: Counter[str] = Counter()
    location = received(
        "OPEN_DRONE_ID_LOCATION", rejects, latitude=-900000000, longitude=1800000000, direction=36000,
        speed_horizontal=25425, speed_vertical=-6200, height=31767.5, timestamp=3600.0,
    )  # fmt: skip
    assert (location.latitude_deg, location.longitude_deg) == (-90.0, 180.0)
    assert location.direction_deg == 0.0
    assert (location.speed_horizontal_mps, location.speed_vertical_mps) == (254.25, -62.0)
    assert (location.height_m, location.timestamp_s) == (31767.5, 3600.0)
    assert not rejects


def test_a_timestamp_that_is_no_number_is_unknown_not_wrong() -> None:
    rejects: Counter[str] = Counter()
    assert received("OPEN_DRONE_ID_LOCATION", rejects, timestamp=math.nan).timestamp_s is None
    assert not rejects


def test_the_equator_at_greenwich_is_a_place() -> None:
    location = over_the_wire(Location(latitude_deg=0.0, longitude_deg=0.0))
    assert isinstance(location, Location)
    assert (location.latitude_deg, location.longitude_deg) == (0.0, 1e-7)


def test_reserved_codes_stay_and_promise_nothing() -> None:
    location = received("OPEN_DRONE_ID_LOCATION", horizontal_accuracy=13, vertical_accuracy=7, speed_accuracy=255)
    assert (location.horizontal_accuracy, location.vertical_accuracy, location.speed_accuracy) == (13, 7, 255)
    assert location.horizontal_accuracy_m is location.vertical_accuracy_m is location.speed_accuracy_mps is None


def test_a_code_is_derived_where_only_the_bound_is_given() -> None:
    fields = to_mavlink(Location(horizontal_accuracy_m=10.0, vertical_accuracy=3, vertical_accuracy_m=0.5))[1]
    assert fields["horizontal_accuracy"] == 9  # "smaller than 30 m": 10 m are not smaller than 10 m
    assert fields["vertical_accuracy"] == 3


def test_a_separation_that_was_cut_to_nothing_is_unknown_everywhere() -> None:
    separation = received("RIDLINK_SEPARATION", timestamp=65535.0)
    assert separation == Separation()


@pytest.mark.parametrize(
    ("error_m", "wire_cm"),
    [(None, 0), (0.0, 1), (1e-9, 1), (0.011, 2), (0.3, 30), (3 * 0.1, 30), (30.001, 3001), (655.35, 65535),
     (1e9, 65535), (math.inf, 65535), (math.nan, 0), (-1.0, 0)],
)  # fmt: skip
def test_errors_round_up_and_saturate(error_m: float | None, wire_cm: int) -> None:
    assert to_mavlink(Separation(horizontal_error_m=error_m))[1]["horizontal_error"] == wire_cm


def test_an_airframe_without_extent_is_unknown() -> None:
    assert to_mavlink(Separation(airframe_size_m=0.0))[1]["airframe_size"] == 0
    assert to_mavlink(Separation(airframe_size_m=0.601))[1]["airframe_size"] == 61


@given(st.floats(min_value=0.0, max_value=655.35))
def test_an_error_is_never_understated_nor_blown_up(error_m: float) -> None:
    separation = over_the_wire(Separation(horizontal_error_m=error_m))
    assert isinstance(separation, Separation) and separation.horizontal_error_m is not None
    assert error_m - 1e-8 <= separation.horizontal_error_m <= error_m + 0.01 + 1e-8


def test_commanded_velocity_counts_only_with_its_flag() -> None:
    without = received("RIDLINK_SEPARATION", timestamp=65535.0, commanded_vx=500, flags=1)
    assert without.commanded_vx_mps is None and without.avoiding
    given_ = received("RIDLINK_SEPARATION", timestamp=65535.0, commanded_vx=500, flags=9)
    assert (given_.commanded_vx_mps, given_.commanded_vy_mps, given_.commanded_vz_mps) == (5.0, 0.0, 0.0)
    sent = to_mavlink(Separation(commanded_vx_mps=5.0, commanded_vy_mps=-400.0, commanded_vz_mps=0.0))[1]
    assert (sent["commanded_vx"], sent["commanded_vy"], sent["flags"]) == (500, -32767, 8)
    half = to_mavlink(Separation(commanded_vx_mps=5.0, commanded_vy_mps=math.nan, commanded_vz_mps=0.0, flags=9))[1]
    assert (half["commanded_vx"], half["flags"]) == (0, 1)


@pytest.mark.parametrize("large", [327.68, 1e6, 1e307])
def test_a_commanded_velocity_saturates_however_large(large: float) -> None:
    message = Separation(commanded_vx_mps=large, commanded_vy_mps=-large, commanded_vz_mps=large)
    fields = to_mavlink(message)[1]
    assert [fields[f"commanded_{axis}"] for axis in ("vx", "vy", "vz")] == [32767, -32767, 32767]
    heard = decode_broadcast(encode_broadcast(message))
    assert isinstance(heard, Separation) and heard.commanded_ned_mps == (327.67, -327.67, 12.7)


def test_the_unscaled_speeds_saturate() -> None:
    fields = to_mavlink(Location(speed_horizontal_mps=1e6, speed_vertical_mps=-1e6, direction_deg=359.999))[1]
    assert (fields["speed_horizontal"], fields["speed_vertical"], fields["direction"]) == (25425, -6200, 0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nothing_that_is_not_finite_reaches_the_wire(value: float) -> None:
    location = Location(**{
        name: value for name in Location.__slots__ if name.endswith(("_deg", "_m", "_mps", "_s"))
    })  # fmt: skip
    for message in (location, System(**{name: value for name in System.__slots__ if name.endswith(("_deg", "_m"))})):
        name, fields = to_mavlink(message)
        Encoder(1, 1).encode(name, **fields)
        assert all(math.isfinite(v) for v in fields.values() if isinstance(v, int | float))


def test_text_and_identity_lose_their_padding_and_keep_their_bytes() -> None:
    for message in (
        BasicId(1, 2, b"1596F302A7K29QX0"),
        BasicId(4, 2, b"\x01\x00\xff" + b"x" * 17, id_or_mac=b"\x90\x3a\xe6".ljust(20, b"\x00")),
        SelfId(0, b"=cmd|'\x1b[2J"),
        OperatorId(0, b"FIN87astrdge12k8"),
        Authentication(10, 0, 0, 16, None, b"RL\x01".ljust(17, b"\x00")),
        Authentication(1, 3, 3, 63, 12345.0, bytes(range(23))),
        System(1, 1, 50.5, -4.25, 3, 120.0, 400.0, None, 1, 5, 35.5, 1e8),
    ):
        assert over_the_wire(message) == message


def test_what_is_no_remote_id_is_none_and_packs_are_counted() -> None:
    rejects: Counter[str] = Counter()
    assert received("HEARTBEAT", rejects, type=2) is None
    assert received("RIDLINK_STATUS", rejects, tracks=2) is None
    assert not rejects
    assert received("OPEN_DRONE_ID_MESSAGE_PACK", rejects, single_message_size=25, msg_pack_size=1) is None
    assert rejects == {"OPEN_DRONE_ID_MESSAGE_PACK": 1}


@given(st.sampled_from(NAMES), st.binary(min_size=60, max_size=60))
def test_any_payload_reads_and_what_was_read_survives_a_second_trip(name: str, payload: bytes) -> None:
    spec = message_spec(name)
    first = from_mavlink(decode_message(Frame(2, 0, 0, 0, 1, 1, spec.msgid, payload, b"", True, 0, b"")))
    assert first is not None
    for field in first.__slots__:
        value = getattr(first, field)
        assert not isinstance(value, float) or math.isfinite(value)
    again_name, fields = to_mavlink(first)
    assert again_name == name
    assert fields.keys() == set(MESSAGES_BY_NAME[name].fields)
    second = over_the_wire(first)
    assert second == over_the_wire(second)  # type: ignore[arg-type]
    if not isinstance(first, Location):  # reserved time accuracy codes and lone coordinates do not survive
        assert second == first or isinstance(first, System)


def test_a_mavgen_reader_agrees_on_the_bytes() -> None:
    """The generated class of pymavlink packs the same fields into the same frame."""
    from ridlink.mavlink import dialect

    location = Location(
        status=2, direction_deg=90.0, speed_horizontal_mps=12.25, speed_vertical_mps=1.5, latitude_deg=50.8765432,
        longitude_deg=4.3210987, altitude_barometric_m=120.5, altitude_geodetic_m=165.5, height_m=45.0,
        horizontal_accuracy=10, vertical_accuracy=4, barometer_accuracy=4, speed_accuracy=3, timestamp_s=1234.5,
        timestamp_accuracy_s=0.1,
    )  # fmt: skip
    name, fields = to_mavlink(location)
    theirs = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    packed = theirs.open_drone_id_location_encode(**fields).pack(theirs)
    assert Encoder(1, 1).encode(name, **fields) == bytes(packed)
    assert isinstance(from_mavlink(Message(name, 12901, fields)), Location)


@pytest.mark.parametrize("name", NAMES)
def test_every_message_is_for_everybody(name: str) -> None:
    heard = received(name)
    assert heard is not None
    fields = to_mavlink(heard)[1]
    assert (fields["target_system"], fields["target_component"]) == (0, 0)


def test_small_figures_are_figures() -> None:
    assert received("OPEN_DRONE_ID_LOCATION", timestamp=0.1).timestamp_s == pytest.approx(0.1)
    assert to_mavlink(Location(speed_horizontal_mps=0.25))[1]["speed_horizontal"] == 25


@pytest.mark.parametrize(("degrees", "cdeg"), [(-10.0, 35000), (365.0, 500), (725.0, 500), (359.996, 0)])
def test_directions_go_round(degrees: float, cdeg: int) -> None:
    assert to_mavlink(Location(direction_deg=degrees))[1]["direction"] == cdeg


def test_codes_that_a_sender_states_stay_without_their_bounds() -> None:
    stated = {"horizontal_accuracy": 5, "vertical_accuracy": 2, "barometer_accuracy": 4, "speed_accuracy": 3}
    assert to_mavlink(Location(**stated))[1].items() >= stated.items()


@pytest.mark.parametrize(("page", "filled", "length"), [(0, 17, 17), (0, 18, 23), (1, 17, 23), (1, 23, 23)])
def test_the_first_page_of_an_authentication_is_shorter_unless_it_is_filled(
    page: int, filled: int, length: int
) -> None:
    data = bytes(range(1, filled + 1))
    read = received("OPEN_DRONE_ID_AUTHENTICATION", data_page=page, authentication_data=data.ljust(23, b"\0"))
    assert len(read.authentication_data) == length and read.authentication_data.startswith(data)
