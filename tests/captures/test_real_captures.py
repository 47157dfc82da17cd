"""Captures of real transmitters, read a second time here, by hand: packets, checksums and every field.

They are not part of the project.
"""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from ridlink.cli.decode import decode

CAPTURES = Path(__file__).resolve().parents[3] / "shared" / "captures"
pytestmark = pytest.mark.skipif(
    not CAPTURES.exists(), reason="the captures of real transmitters are not in the project"
)


def rows_of(path: Path, *options: str) -> list[dict[str, Any]]:
    result = CliRunner().invoke(decode, [str(path), "-f", "jsonl", *options], standalone_mode=False)
    return [json.loads(line) for line in result.stdout.splitlines()]


Walk = Callable[[bytes], list[tuple[int, bytes]]]


def walk_pcap(data: bytes) -> list[tuple[int, bytes]]:
    found, at = [], 24
    while at < len(data):
        seconds, fraction, length, _ = struct.unpack_from("<IIII", data, at)
        found.append((seconds * 1_000_000 + fraction, data[at + 16 : at + 16 + length]))
        at += 16 + length
    return found


def walk_pcapng(data: bytes) -> list[tuple[int, bytes]]:
    found, at = [], 0
    while at < len(data):
        kind, length = struct.unpack_from("<II", data, at)
        if kind == 6:
            _, high, low, captured, _ = struct.unpack_from("<IIIII", data, at + 8)
            found.append((high << 32 | low, data[at + 28 : at + 28 + captured]))
        at += length
    return found


def ble_crc(data: bytes) -> int:
    """CRC of an advertisement, bit by bit."""
    register = 0xAAAAAA
    for byte in data:
        for bit in range(8):
            feedback = (register ^ byte >> bit) & 1
            register = register >> 1 ^ (0xDA6000 if feedback else 0)
    return register


def broadcasts(packet: bytes) -> list[bytes]:
    """Payloads of Open Drone ID in a packet of these captures, found by their marks alone."""
    found = []
    for mark, skip in ((b"\x16\xfa\xff\x0d", 5), (b"\xfa\x0b\xbc\x0d", 5), (bytes.fromhex("8869199d92090100"), 11)):
        at = packet.find(mark)
        if at >= 0:
            found.append(packet[at + skip :])
    return found


REAL = {
    "odid_wifi_sample.pcap": (walk_pcap, {"OPEN_DRONE_ID_LOCATION": 31, "OPEN_DRONE_ID_SELF_ID": 4,
                                          "OPEN_DRONE_ID_SYSTEM": 4, "OPEN_DRONE_ID_OPERATOR_ID": 3}, {}),
    "odid_wifi_bcn_sample.pcap": (walk_pcap, dict.fromkeys(
        [f"OPEN_DRONE_ID_{name}" for name in ("BASIC_ID", "LOCATION", "SELF_ID", "SYSTEM", "OPERATOR_ID")], 21), {}),
    "odid_bt5_lr_sample.pcapng": (walk_pcapng, {
        "OPEN_DRONE_ID_BASIC_ID": 225, "OPEN_DRONE_ID_LOCATION": 222, "OPEN_DRONE_ID_SELF_ID": 216,
        "OPEN_DRONE_ID_SYSTEM": 207, "OPEN_DRONE_ID_OPERATOR_ID": 199},
        {"bad_checksum": 30, "bad_message_count": 19}),
}  # fmt: skip


@pytest.mark.parametrize("name", REAL)
def test_a_real_capture_holds_what_a_walk_by_hand_finds_in_it(name: str) -> None:
    walk, types, refused = REAL[name]
    by_hand: list[tuple[int, str]] = []
    for time_us, packet in walk((CAPTURES / name).read_bytes()):
        if name.endswith("pcapng"):  # coded PHY: one byte before the PDU
            length = packet[23]
            if ble_crc(packet[22 : 24 + length]) != int.from_bytes(packet[24 + length : 27 + length], "little"):
                continue
        for payload in broadcasts(packet):
            assert payload[0] == 0xF0 and payload[1] == 25  # these speak version 0
            by_hand += [(time_us, payload[3 + 25 * at : 28 + 25 * at].hex()) for at in range(payload[2])]
    rows = rows_of(CAPTURES / name)
    assert [(round(row["t"] * 1e6), row["hex"]) for row in rows] == by_hand
    assert Counter(row["type"] for row in rows) == types
    (statistics,) = rows_of(CAPTURES / name, "--stats")
    assert {reject["cause"]: reject["count"] for reject in statistics["rejects"]} == refused
    assert {len(row["mac"]) for row in rows} == {17} and len({row["mac"] for row in rows}) == 1


def test_packs_that_the_sniffer_flagged_are_told_from_good_ones() -> None:
    """Of 274 packets 273 carry a pack: 225 have members, 19 are good and empty, 29 have a bad checksum."""
    told: Counter[tuple[bool, bool, int]] = Counter()
    for _, packet in walk_pcapng((CAPTURES / "odid_bt5_lr_sample.pcapng").read_bytes()):
        length = packet[23]
        good = ble_crc(packet[22 : 24 + length]) == int.from_bytes(packet[24 + length : 27 + length], "little")
        assert good == bool(packet[8] & 1)
        told[good, bool(broadcasts(packet)), good and min(broadcasts(packet)[0][2], 1)] += 1
    assert told == {(True, True, 1): 225, (True, True, 0): 19, (False, True, 0): 29, (False, False, 0): 1}
    rows = rows_of(CAPTURES / "odid_bt5_lr_sample.pcapng")
    assert len({row["t"] for row in rows}) == 225


def test_beacons_and_nan_frames_are_counted_apart() -> None:
    rows = rows_of(CAPTURES / "odid_wifi_bcn_sample.pcap")
    assert set(Counter(row["t"] for row in rows).values()) == {5} and len({row["t"] for row in rows}) == 21
    rows = rows_of(CAPTURES / "odid_wifi_sample.pcap")
    assert Counter(row["transport"] for row in rows) == {"wifi-nan": 21, "wifi-beacon": 21}
    assert len({row["t"] for row in rows if row["transport"] == "wifi-nan"}) == 21


def text_by_hand(data: bytes) -> str:
    return data.rstrip(b"\x00").decode("ascii")


def altitude_by_hand(units: int) -> float | None:
    return None if units == 0 else units / 2 - 1000


HORIZONTAL_M = [None, 18520, 7408, 3704, 1852, 926, 555.6, 185.2, 92.6, 30, 10, 3, 1]
VERTICAL_M = [None, 150, 45, 25, 10, 3, 1]
SPEED_MPS = [None, 10, 3, 1, 0.3]


def basic_id_by_hand(data: bytes) -> dict[str, Any]:
    return {"id_type": data[1] >> 4, "ua_type": data[1] & 15, "uas_id": text_by_hand(data[2:22])}


def location_by_hand(data: bytes) -> dict[str, Any]:
    fast, west = data[1] & 1, data[1] >> 1 & 1
    latitude, longitude = struct.unpack("<ii", data[5:13])
    known = latitude != 0 or longitude != 0
    barometric, geodetic, height = struct.unpack("<HHH", data[13:19])
    tenths = int.from_bytes(data[21:23], "little")
    direction = data[2] + 180 * west
    climb = int.from_bytes(data[4:5], "little", signed=True)
    return {
        "status": data[1] >> 4,
        "direction_deg": None if direction == 361 else direction % 360,
        "speed_horizontal_mps": None if fast and data[3] == 255 else data[3] * 0.75 + 63.75 if fast else data[3] / 4,
        "speed_vertical_mps": None if climb == 126 else climb / 2,
        "latitude_deg": latitude / 1e7 if known else None,
        "longitude_deg": longitude / 1e7 if known else None,
        "altitude_barometric_m": altitude_by_hand(barometric),
        "altitude_geodetic_m": altitude_by_hand(geodetic),
        "height_m": altitude_by_hand(height),
        "height_reference": data[1] >> 2 & 1,
        "horizontal_accuracy": data[19] & 15,
        "vertical_accuracy": data[19] >> 4,
        "barometer_accuracy": data[20] >> 4,
        "speed_accuracy": data[20] & 15,
        "horizontal_accuracy_m": HORIZONTAL_M[data[19] & 15],
        "vertical_accuracy_m": VERTICAL_M[data[19] >> 4],
        "barometer_accuracy_m": VERTICAL_M[data[20] >> 4],
        "speed_accuracy_mps": SPEED_MPS[data[20] & 15],
        "timestamp_s": None if tenths == 0xFFFF else tenths / 10,
        "timestamp_accuracy_s": (data[23] & 15) / 10 or None,
    }


def system_by_hand(data: bytes) -> dict[str, Any]:
    latitude, longitude = struct.unpack("<ii", data[2:10])
    known = latitude != 0 or longitude != 0
    ceiling, floor = struct.unpack("<HH", data[13:17])
    return {
        "operator_location_type": data[1] & 3,
        "classification_type": data[1] >> 2 & 7,
        "operator_latitude_deg": latitude / 1e7 if known else None,
        "operator_longitude_deg": longitude / 1e7 if known else None,
        "area_count": data[10] | data[11] << 8,
        "area_radius_m": data[12] * 10,
        "area_ceiling_m": altitude_by_hand(ceiling),
        "area_floor_m": altitude_by_hand(floor),
        "category_eu": data[17] >> 4,
        "class_eu": data[17] & 15,
        "operator_altitude_geo_m": altitude_by_hand(data[18] | data[19] << 8),
        "timestamp_s": int.from_bytes(data[20:24], "little") or None,
    }


BY_HAND: dict[int, tuple[str, Callable[[bytes], dict[str, Any]]]] = {
    0: ("BASIC_ID", basic_id_by_hand),
    1: ("LOCATION", location_by_hand),
    3: ("SELF_ID", lambda data: {"description_type": data[1], "description": text_by_hand(data[2:])}),
    4: ("SYSTEM", system_by_hand),
    5: ("OPERATOR_ID", lambda data: {"operator_id_type": data[1], "operator_id": text_by_hand(data[2:22])}),
}
"""By the type in the first byte, written from the tables of ASTM F3411 and sharing no code with ridlink."""


@pytest.mark.parametrize("name", REAL)
def test_every_field_is_what_a_reading_by_hand_gives(name: str) -> None:
    rows = rows_of(CAPTURES / name)
    for row in rows:
        data = bytes.fromhex(row["hex"])
        kind, read = BY_HAND[data[0] >> 4]
        assert row["type"] == f"OPEN_DRONE_ID_{kind}"
        assert row["fields"].pop("id_or_mac").startswith(row["mac"].replace(":", ""))
        assert row["fields"] == read(data), row
    assert len(rows) >= 42
