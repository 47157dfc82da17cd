"""The 25-byte messages against what opendroneid-core-c made and read: agreement, and where we differ on purpose.

The vectors are not part of the project; `message_spec/vectors/astm.jsonl` carries those that both agree on.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from ridlink.errors import PayloadError
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id import accuracy, astm, astm_pack
from ridlink.remote_id.convert import from_mavlink
from ridlink.remote_id.messages import (
    Authentication,
    BasicId,
    Location,
    OperatorId,
    RemoteIdMessage,
    SelfId,
    Separation,
    System,
)

Vector = dict[str, Any]
PATH = Path(__file__).resolve().parents[3] / "shared" / "vectors" / "odid_core_c.jsonl"
pytestmark = pytest.mark.skipif(not PATH.exists(), reason="core-c's own vectors are not part of the project")
VECTORS: list[Vector] = [json.loads(line) for line in PATH.read_text().splitlines()] if PATH.exists() else []


def vectors(kind: str, *types: str) -> list[Vector]:
    found = [vector for vector in VECTORS if vector["kind"] == kind and (not types or vector["type"] in types)]
    assert found or not VECTORS
    return found


def altitude(value: float) -> float | None:
    return None if value == -1000.0 else value


def position(latitude: float, longitude: float) -> tuple[float | None, float | None]:
    return (None, None) if latitude == longitude == 0.0 else (latitude, longitude)


def message_of(kind: str, fields: Vector) -> RemoteIdMessage:
    """What core-c's structure says, in our words."""
    if kind == "basic_id":
        raw = bytes.fromhex(fields.get("UASID_hex") or fields.get("UASID", ""))
        return BasicId(fields.get("IDType", 0), fields.get("UAType", 0), raw.rstrip(b"\x00"))
    if kind == "self_id":
        raw = bytes.fromhex(fields.get("Desc_hex") or fields.get("Desc", ""))
        return SelfId(fields["DescType"], raw.rstrip(b"\x00"))
    if kind == "operator_id":
        raw = bytes.fromhex(fields.get("OperatorId_hex") or fields.get("OperatorId", ""))
        return OperatorId(fields["OperatorIdType"], raw.rstrip(b"\x00"))
    if kind == "auth":
        return Authentication(
            fields["AuthType"], fields["DataPage"], fields.get("LastPageIndex", 0), fields.get("Length", 0),
            float(fields.get("Timestamp", 0)) or None,
            bytes.fromhex(fields.get("AuthData_hex", fields.get("AuthData", ""))),
        )  # fmt: skip
    if kind == "system":
        latitude, longitude = position(fields["OperatorLatitude"], fields["OperatorLongitude"])
        return System(
            fields["OperatorLocationType"], fields["ClassificationType"], latitude, longitude, fields["AreaCount"],
            float(fields["AreaRadius"]), altitude(fields["AreaCeiling"]), altitude(fields["AreaFloor"]),
            fields["CategoryEU"], fields["ClassEU"], altitude(fields["OperatorAltitudeGeo"]),
            float(fields["Timestamp"]) or None,
        )  # fmt: skip
    assert kind == "location"
    latitude, longitude = position(fields["Latitude"], fields["Longitude"])
    return Location(
        status=fields["Status"],
        direction_deg=None if fields["Direction"] == 361 else float(fields["Direction"]),
        speed_horizontal_mps=None if fields["SpeedHorizontal"] == 255 else float(fields["SpeedHorizontal"]),
        speed_vertical_mps=None if fields["SpeedVertical"] == 63 else float(fields["SpeedVertical"]),
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_barometric_m=altitude(fields["AltitudeBaro"]),
        altitude_geodetic_m=altitude(fields["AltitudeGeo"]),
        height_m=altitude(fields["Height"]),
        height_reference=fields["HeightType"],
        horizontal_accuracy=fields["HorizAccuracy"],
        vertical_accuracy=fields["VertAccuracy"],
        barometer_accuracy=fields["BaroAccuracy"],
        speed_accuracy=fields["SpeedAccuracy"],
        horizontal_accuracy_m=accuracy.horizontal_bound_m(fields["HorizAccuracy"]),
        vertical_accuracy_m=accuracy.vertical_bound_m(fields["VertAccuracy"]),
        barometer_accuracy_m=accuracy.vertical_bound_m(fields["BaroAccuracy"]),
        speed_accuracy_mps=accuracy.speed_bound_mps(fields["SpeedAccuracy"]),
        timestamp_s=None if fields["TimeStamp"] == 0xFFFF else round(fields["TimeStamp"], 2),
        timestamp_accuracy_s=accuracy.time_bound_s(fields["TSAccuracy"]),
    )


# --- where we differ, each with its reason ---

ENCODED_OTHERWISE = {
    # core-c cuts vertical speed and altitudes off towards zero and downwards, we take the nearest step; a position
    # within 5 mm of 0/0, which would read as unknown, goes out one unit east of it
    "location": (33, {4, *range(9, 19)}),
    # core-c cuts radius, ceiling and floor of the area of operation off, we never understate it; and the operator's
    # altitude, of which we take the nearest step
    "system": (5, {*range(12, 17), 18, 19}),
    # core-c ends a text at its first zero byte, which the bytes of a private text may contain
    "self_id": (1, {4}),
    "operator_id": (2, {4}),
}
"""By type: how many of the vectors, and in which bytes."""

SATURATED = {
    # what does not fit goes out as unknown or saturated, as over MAVLink: a transmitter must not fall silent
    ("location", note)
    for note in ("direction 362", "direction -1", "speed -0.1", "vspeed 62.5", "vspeed 64", "lat 90.1", "lat -90.1",
                 "lon 180.1", "lon -180.1", "alt -1000.5", "height 31768", "timestamp 3600.5", "timestamp -1")
} | {("system", "radius 2551"), ("system", "ceiling -1001")}  # fmt: skip

DECODED_OTHERWISE = {
    # core-c checks no ranges when it reads
    "direction byte 255 with W bit -> 435 (out of range, library does not check)": {"direction_deg": None},
    "latitude 91 deg is not checked by the decoder": {"latitude_deg": None},
    "vertical speed -128 -> -64": {"speed_vertical_mps": None},
    "all 0xff after header": {"direction_deg": None},
    # core-c stops at the first zero byte of a text
    "binary payload, type 201 (C decoder stops at first NUL: lossy)": {"description": b"RL\x01\x00\x05\x00\x00M"},
}

PACKS_READ_IN_PART = {
    # core-c refuses the whole pack, or keeps the last of several; we keep every good member
    "reserved message type 0x6 inside: whole pack refused": (2, ["unknown_message_type"]),
    "nested pack refused": (1, ["nested_pack"]),
    "two locations refused": (2, []),
    "two systems refused": (2, []),
    "three basic ids refused (library limit 2)": (3, []),
    "zero messages refused": (0, ["bad_message_count"]),
    "ten messages refused": (0, ["bad_message_count"]),
    "single message size 24 refused": (0, ["bad_message_size"]),
}

SINGLE = ("basic_id", "location", "auth", "self_id", "system", "operator_id")


def padded(message: RemoteIdMessage) -> RemoteIdMessage:
    """Authentication data as it is read: of full length."""
    if not isinstance(message, Authentication):
        return message
    length = 23 if message.data_page else 17
    return replace(message, authentication_data=message.authentication_data.ljust(length, b"\x00"))


def test_what_core_c_encodes_we_encode_alike_but_for_what_is_named() -> None:
    different: Counter[str] = Counter()
    for vector in vectors("encode_decode", *SINGLE):
        ours, theirs = astm.encode_message(message_of(vector["type"], vector["input"])), bytes.fromhex(vector["hex"])
        if ours != theirs:
            different[vector["type"]] += 1
            assert {at for at in range(25) if ours[at] != theirs[at]} <= ENCODED_OTHERWISE[vector["type"]][1], vector
            assert_nearer(vector["input"], astm.decode_message(ours))
    assert different == {kind: count for kind, (count, _) in ENCODED_OTHERWISE.items()}


def assert_nearer(wanted: Vector, got: RemoteIdMessage) -> None:
    """Ours is the nearest step (half a unit), or one unit where the nearest would say unknown; areas never shrink."""
    if isinstance(got, Location):
        assert abs((got.speed_vertical_mps or 0.0) - wanted["SpeedVertical"]) <= 0.25
        for name, value in (("AltitudeBaro", got.altitude_barometric_m), ("AltitudeGeo", got.altitude_geodetic_m),
                            ("Height", got.height_m)):  # fmt: skip
            if wanted[name] != -1000.0:
                assert value is not None and abs(value - wanted[name]) <= (0.4 if wanted[name] < -999.75 else 0.25)
    if isinstance(got, System):
        assert 0.0 <= got.area_radius_m - wanted["AreaRadius"] < 10.0
        if got.area_ceiling_m is not None and got.area_floor_m is not None:
            assert got.area_floor_m <= wanted["AreaFloor"] <= wanted["AreaCeiling"] <= got.area_ceiling_m


SHOWN = {
    ("vertical speed", "10.3 m/s"): "vertical speed 10.3 (truncates to zero, not rounds)",
    ("vertical speed", "-10.3 m/s"): "vertical speed -10.3 (truncates to zero, not rounds)",
    ("altitudes, height", "100.3 m"): "altitudes 100.3 (floor to 0.5 m, not rounded)",
    ("altitudes, height", "-0.1 m"): "altitudes -0.1 (floor to 0.5 m, not rounded)",
    ("altitudes, height", "-999.9 m"): "altitudes -999.9 (floor to 0.5 m, not rounded)",
    ("latitude", "1.4e-8 deg, longitude -1.4e-8"): "lat/lon 1.4e-08 -1.4e-08",
    ("area radius (up)", "75 m"): "area count 35 radius 75 (10 m steps, floor)",
}
"""Rows of the table in the specification, and the vectors they show."""


def test_the_specification_shows_both_where_core_c_cuts_off() -> None:
    table = [
        [cell.strip(" `") for cell in line.strip("|").split("|")]
        for line in (Path(__file__).resolve().parents[2] / "message_spec" / "README.md").read_text().splitlines()
        if line.startswith("|") and line.count("|") == 8
    ]
    rows = {(field, value): rest for field, value, *rest in table}
    assert len(rows) == 11
    by_note = {vector["note"]: vector for vector in vectors("encode_decode", "location", "system")}
    for row, note in SHOWN.items():
        at, theirs, _, ours, _ = rows[row]
        first, last = (int(place) for place in (at.split(", ") * 2)[:2])
        vector = by_note[note]
        made = astm.encode_message(message_of(vector["type"], vector["input"]))
        assert bytes.fromhex(vector["hex"])[first : last + 1].hex() == theirs, row
        assert made[first : last + 1].hex() == ours, row


def test_what_core_c_reads_we_read_alike() -> None:
    for vector in vectors("encode_decode", *SINGLE):
        rejects: Counter[str] = Counter()
        got = astm.decode_message(bytes.fromhex(vector["hex"]), rejects)
        if isinstance(got, Separation):
            continue
        assert got == padded(message_of(vector["type"], vector["fields"])), vector
        assert not rejects


def test_what_core_c_only_reads_we_read_alike_but_for_what_is_named() -> None:
    seen = set()
    for vector in vectors("decode_only", *SINGLE):
        got = astm.decode_message(bytes.fromhex(vector["hex"]))
        wanted = message_of(vector["type"], vector["fields"])
        for name, value in DECODED_OTHERWISE.get(vector["note"], {}).items():
            assert getattr(got, name) == value and getattr(wanted, name) != value
            wanted = type(wanted)(**{
                slot: getattr(wanted, slot) if slot != name else value for slot in wanted.__slots__
            })  # fmt: skip
            seen.add(vector["note"])
        assert got == wanted, vector
    assert seen == set(DECODED_OTHERWISE)


def test_what_core_c_refuses_to_encode_we_refuse_or_saturate() -> None:
    seen = set()
    for vector in vectors("encode_reject"):
        name = (vector["type"], vector["note"])
        message = message_of(vector["type"], vector["input"])
        if name in SATURATED:
            astm.encode_message(message)
            seen.add(name)
        else:
            with pytest.raises(PayloadError):
                astm.encode_message(message)
    assert seen == SATURATED


def test_what_core_c_refuses_to_read_we_refuse() -> None:
    for vector in vectors("decode_reject", *SINGLE, "reserved"):
        data = bytes.fromhex(vector["hex"])
        if vector["note"].startswith("wrong"):  # there the decoder of one type was handed another
            assert not isinstance(astm.decode_message(data), {"basic_id": BasicId, "self_id": SelfId}[vector["type"]])
        else:
            with pytest.raises(PayloadError):
                astm.decode_message(data)


def test_packs_are_made_and_read_alike() -> None:
    for vector in vectors("encode_decode", "pack"):
        members = [bytes.fromhex(member) for member in vector["messages"]]
        data = bytes.fromhex(vector["hex"])
        assert astm_pack.join_pack(members) == data
        assert astm_pack.split_broadcast(data) == [astm_pack.Member(*item) for item in enumerate(members)]
    for vector in vectors("decode_only", "pack"):
        assert len(astm_pack.split_broadcast(bytes.fromhex(vector["hex"]))) == 2


def test_of_packs_that_core_c_refuses_the_good_members_are_read() -> None:
    for vector in vectors("decode_reject", "pack"):
        found = astm_pack.split_broadcast(bytes.fromhex(vector["hex"]))
        bad = [item.refusal for item in found if isinstance(item, astm_pack.BadMember)]
        assert (len(found) - len(bad), bad) == PACKS_READ_IN_PART[vector["note"]]


def test_from_mavlink_we_make_the_same_bytes_but_for_what_is_cut_off() -> None:
    different = 0
    for vector in vectors("convert"):
        frame = parse_datagram(bytes.fromhex(vector["frame"]), CRC_EXTRAS)[0]
        assert isinstance(frame, Frame)
        message = from_mavlink(decode_message(frame))
        assert message is not None
        ours, theirs = astm.encode_message(message), bytes.fromhex(vector["hex"])
        if ours != theirs:
            different += 1
            assert isinstance(message, Location) and vector["message"] == "OPEN_DRONE_ID_LOCATION"
            assert {at for at in range(25) if ours[at] != theirs[at]} <= ENCODED_OTHERWISE["location"][1]
            got = astm.decode_message(ours)
            assert isinstance(got, Location) and got.height_m == pytest.approx(message.height_m, abs=0.25)
            assert got.speed_vertical_mps == pytest.approx(message.speed_vertical_mps, abs=0.25)
    assert different == 8


def test_of_mavlink_that_core_c_rejects_only_the_bad_field_is_lost() -> None:
    for vector in vectors("reject"):
        rejects: Counter[str] = Counter()
        frame = parse_datagram(bytes.fromhex(vector["frame"]), CRC_EXTRAS)[0]
        assert isinstance(frame, Frame)
        message = from_mavlink(decode_message(frame), rejects)
        assert message is not None
        decoded = astm.decode_message(astm.encode_message(message))
        if isinstance(decoded, System):  # a radius beyond the range saturates
            assert decoded.area_radius_m == 2550.0 and not rejects
        else:
            (name,) = rejects
            lost = {"latitude": "latitude_deg", "timestamp": "timestamp_s", "speed_horizontal": "speed_horizontal_mps",
                    "speed_vertical": "speed_vertical_mps"}[name.split(".")[1]]  # fmt: skip
            assert getattr(decoded, lost) is None and decoded.altitude_geodetic_m == 165.5


ACCURACY = {
    "horizontal": (accuracy.horizontal_code, accuracy.horizontal_bound_m),
    "vertical": (accuracy.vertical_code, accuracy.vertical_bound_m),
    "speed": (accuracy.speed_code, accuracy.speed_bound_mps),
    "timestamp": (accuracy.time_code, accuracy.time_bound_s),
}


def test_accuracy_codes_agree_but_for_the_unknown_ones_and_a_slip_of_the_pen() -> None:
    for vector in vectors("encode", "accuracy_enum"):
        code = ACCURACY[vector["quantity"]][0](vector["value"])
        if (vector["quantity"], vector["value"]) == ("timestamp", 0):
            assert (code, vector["enum"]) == (1, 0)  # exactly known is not unknown
        elif vector["value"] == 0:
            assert vector["enum"] == 0 and code == max(
                {"horizontal": accuracy.HORIZONTAL_BOUNDS_M, "vertical": accuracy.VERTICAL_BOUNDS_M,
                 "speed": accuracy.SPEED_BOUNDS_MPS}[vector["quantity"]]
            )  # fmt: skip
        else:
            assert code == vector["enum"], vector
    for vector in (*vectors("encode", "accuracy_enum"), *vectors("decode", "accuracy_enum")):
        bound = ACCURACY[vector["quantity"]][1](vector["enum"])
        if bound is None:  # core-c gives the worst bound, or 0 s, for what says nothing
            assert vector["decoded_bound"] in (18520.0, 150.0, 10.0, 0.0)
        elif (vector["quantity"], vector["enum"]) == ("horizontal", 2):
            assert (bound, vector["decoded_bound"]) == (7408.0, 7808.0)  # 4 nautical miles
        else:
            assert bound == pytest.approx(vector["decoded_bound"], rel=1e-6)
