"""Messages as lines: strict JSON, exact times, SI names, inert strings."""

from __future__ import annotations

import itertools
import json
import math
import re
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.captures.lines import clock_time, json_line, table_line
from ridlink.captures.messages import MessageRecord, decode_records
from ridlink.captures.records import Record
from ridlink.captures.statistics import SourceCount, Statistics
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, encode_frame, parse_datagram

HOSTILE = b"=cmd|' /C calc'!A0\x1b[2"


def record_of(raw: bytes, time_us: int | None = 1_700_000_000_123_456) -> MessageRecord:
    frame = parse_datagram(raw, CRC_EXTRAS)[0]
    assert isinstance(frame, Frame)
    return next(decode_records([Record(time_us, frame, 0)]))


def strict(line: bytes) -> dict[str, Any]:
    """Parsed as JSON without NaN; numbers as they are written."""
    assert line.endswith(b"\n") and line.count(b"\n") == 1
    parsed: dict[str, Any] = json.loads(line, parse_constant=pytest.fail, parse_float=Decimal)
    return parsed


def decoded(name: str, **fields: Any) -> dict[str, Any]:
    return strict(json_line(record_of(Encoder(1, 1).encode(name, **fields))))


def test_a_location_has_the_names_and_units_of_the_specification() -> None:
    line = decoded(
        "OPEN_DRONE_ID_LOCATION", status=2, direction=36100, speed_horizontal=1225, speed_vertical=6300,
        latitude=508765432, longitude=43210987, altitude_barometric=-1000, altitude_geodetic=165.5, height=45,
        horizontal_accuracy=10, vertical_accuracy=4, speed_accuracy=13, timestamp=1234.5, timestamp_accuracy=1,
        id_or_mac=b"\x90\x3a\xe6",
    )  # fmt: skip
    assert line == {
        "t": Decimal("1700000000.123456"), "src": "1/1", "seq": 0, "type": "OPEN_DRONE_ID_LOCATION", "id": 12901,
        "fields": {
            "status": 2, "direction_deg": None, "speed_horizontal_mps": Decimal("12.25"), "speed_vertical_mps": None,
            "latitude_deg": Decimal("50.8765432"), "longitude_deg": Decimal("4.3210987"),
            "altitude_barometric_m": None, "altitude_geodetic_m": Decimal("165.5"), "height_m": 45,
            "height_reference": 0, "horizontal_accuracy": 10, "vertical_accuracy": 4, "barometer_accuracy": 0,
            "speed_accuracy": 13, "horizontal_accuracy_m": 10, "vertical_accuracy_m": 10,
            "barometer_accuracy_m": None, "speed_accuracy_mps": None, "timestamp_s": Decimal("1234.5"),
            "timestamp_accuracy_s": Decimal("0.1"), "id_or_mac": "903ae6" + "00" * 17,
        },
    }  # fmt: skip


FIELDS = {
    "OPEN_DRONE_ID_BASIC_ID": "id_type ua_type uas_id",
    "OPEN_DRONE_ID_AUTHENTICATION": "authentication_type data_page last_page_index length timestamp_s "
    "authentication_data",
    "OPEN_DRONE_ID_SELF_ID": "description_type description",
    "OPEN_DRONE_ID_OPERATOR_ID": "operator_id_type operator_id",
    "OPEN_DRONE_ID_SYSTEM": "operator_location_type classification_type operator_latitude_deg operator_longitude_deg "
    "area_count area_radius_m area_ceiling_m area_floor_m category_eu class_eu operator_altitude_geo_m timestamp_s",
    "RIDLINK_SEPARATION": "timestamp_s horizontal_error_m vertical_error_m velocity_error_mps airframe_size_m "
    "airframe_height_m update_interval_s commanded_vx_mps commanded_vy_mps commanded_vz_mps flags",
}


@pytest.mark.parametrize("name", FIELDS)
def test_every_remote_id_message_has_its_si_names(name: str) -> None:
    assert list(decoded(name)["fields"]) == [*FIELDS[name].split(), "id_or_mac"]


def test_other_messages_keep_the_xml() -> None:
    fields = decoded("GLOBAL_POSITION_INT", lat=473977430, lon=-85455939, alt=488_000, vx=-7)["fields"]
    assert list(fields) == ["time_boot_ms", "lat", "lon", "alt", "relative_alt", "vx", "vy", "vz", "hdg"]
    assert (fields["lat"], fields["lon"], fields["vx"]) == (473977430, -85455939, -7)
    assert decoded("PARAM_VALUE", param_id=b"SYSID_THISMAV")["fields"]["param_id"] == "SYSID_THISMAV"
    assert decoded("BATTERY_STATUS", voltages=tuple(range(10)))["fields"]["voltages"] == list(range(10))
    assert decoded("FILE_TRANSFER_PROTOCOL", payload=b"\x01\x02")["fields"]["payload"][:3] == [1, 2, 0]


def test_what_is_no_number_is_null() -> None:
    fields = decoded("ATTITUDE", roll=math.nan, pitch=math.inf, yaw=-math.inf)["fields"]
    assert fields["roll"] is fields["pitch"] is fields["yaw"] is None
    fields = decoded("ODOMETRY", pose_covariance=(math.nan, *[0.5] * 20))["fields"]
    assert fields["pose_covariance"][:2] == [None, Decimal("0.5")]


def test_an_unknown_message_shows_its_payload() -> None:
    line = strict(json_line(record_of(encode_frame(54321, b"\x01\xff", 9, seq=3, sysid=2, compid=1), None)))
    assert line == {
        "t": None, "src": "2/1", "seq": 3, "type": "UNKNOWN", "id": 54321, "fields": {}, "payload": "01ff"
    }  # fmt: skip
    assert b"payload=01ff" in table_line(record_of(encode_frame(54321, b"\x01\xff", 9, seq=3, sysid=2, compid=1)))


@pytest.mark.parametrize(
    ("name", "field"),
    [("OPEN_DRONE_ID_BASIC_ID", "uas_id"), ("OPEN_DRONE_ID_SELF_ID", "description"),
     ("OPEN_DRONE_ID_OPERATOR_ID", "operator_id"), ("STATUSTEXT", "text")],
)  # fmt: skip
@given(raw=st.one_of(st.just(HOSTILE[:20]), st.binary(max_size=20)))
def test_f32_strings_are_inert(name: str, field: str, raw: bytes) -> None:
    record = record_of(Encoder(1, 1).encode(name, **{field: raw}))
    text = strict(json_line(record))["fields"][field]
    assert text.isascii() and text.isprintable()
    row = table_line(record)
    assert row.endswith(b"\n") and all(0x20 <= byte <= 0x7E for byte in row[:-1])


def test_bytes_that_are_not_printable_are_shown_as_numbers() -> None:
    assert decoded("OPEN_DRONE_ID_BASIC_ID", uas_id=b"A\x00\x1b\xff\x7f~")["fields"]["uas_id"] == r"A\x00\x1b\xff\x7f~"


@given(st.integers(0, 2**63))
def test_times_are_exact(time_us: int) -> None:
    line = strict(json_line(record_of(Encoder(1, 1).encode("HEARTBEAT"), time_us)))
    assert line["t"] * 1_000_000 == time_us
    assert clock_time(time_us).isprintable()


def test_a_row_reads_well() -> None:
    row = table_line(record_of(Encoder(1, 1).encode("RIDLINK_SEPARATION", timestamp=1.5, horizontal_error=2100)))
    assert row == (
        b"2023-11-14T22:13:20.123456Z     1/1   0  RIDLINK_SEPARATION          timestamp_s=1.5 horizontal_error_m=21 "
        b"vertical_error_m=- velocity_error_mps=- airframe_size_m=- airframe_height_m=- update_interval_s=- "
        b"commanded_vx_mps=- commanded_vy_mps=- commanded_vz_mps=- flags=0 id_or_mac=-\n"
    )
    assert table_line(record_of(Encoder(1, 1).encode("HEARTBEAT"), None)).startswith(b"-   ")


def test_sequence_gaps_wrap_and_duplicates_are_none() -> None:
    source = SourceCount()
    for seq in (254, 255, 0, 1, 1, 5, 4):
        source.see(seq)
    assert (source.messages, source.gaps, source.lost) == (7, 2, 3 + 254)


def test_the_table_says_what_a_gap_may_be_where_there_is_one() -> None:
    """A daemon answers on the recorded link, and numbers what it sends over others with the same count."""
    whole, partial = Statistics(), Statistics()
    for seq in range(20):
        whole.sources.setdefault((1, 196), SourceCount()).see(seq)
        partial.sources.setdefault((1, 196), SourceCount()).see(5 * seq)
    assert "gaps: " not in whole.as_text()
    assert (
        "gaps: lost on the way, or sent over another link of that source, which was not recorded" in partial.as_text()
    )


def test_of_several_links_json_knows_no_losses_either() -> None:
    mixed = Statistics()
    for k in range(40):
        mixed.sources.setdefault((1, 1), SourceCount()).see(120 * (k % 2) + k // 2)
    assert mixed.as_dict()["sources"] == {"1/1": {"messages": 40, "gaps": None, "lost": None}}
    assert re.search(r"^1/1 +40 +- +-$", mixed.as_text(), re.MULTILINE)


@given(st.lists(st.integers(1, 60), min_size=10, max_size=100), st.integers(0, 255))
def test_two_links_that_number_for_themselves_are_not_called_a_loss(runs: list[int], apart: int) -> None:
    """The log of a vehicle that is heard on its own link and on the air, some from the one and some from the other."""
    source, numbers = SourceCount(), [itertools.count(), itertools.count(apart)]
    for k, run in enumerate(runs):
        for seq in itertools.islice(numbers[k % 2], run):
            source.see(seq % 256)
    assert source.lost <= source.messages or source.missing == (None, None)


@given(st.lists(st.integers(0, 63), min_size=1, max_size=300))
def test_a_bad_link_is_called_a_loss_however_much_is_lost(lost: list[int]) -> None:
    source, seq = SourceCount(), 0
    source.see(seq)
    for missing in lost:
        seq = (seq + missing + 1) % 256
        source.see(seq)
    assert source.missing == (sum(map(bool, lost)), sum(lost))
