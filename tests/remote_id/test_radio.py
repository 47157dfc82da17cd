"""Broadcasts out of radio frames: golden frames, every optional field before them, and whatever else is in the air."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.remote_id.astm_pack import Member, split_broadcast
from ridlink.remote_id.radio import (
    Heard,
    Transport,
    Unheard,
    read_80211,
    read_ble,
    read_ble_with_phdr,
    read_nordic_ble,
    read_radiotap,
)
from tests.remote_id.radio_frames import (
    MAC,
    PACK,
    beacon,
    element,
    element_of_advertisement,
    extended,
    legacy,
    nan,
    nordic,
    odid_beacon,
    odid_element,
    phdr,
    radiotap,
)

READERS = (read_radiotap, read_80211, read_nordic_ble, read_ble, read_ble_with_phdr)
CORE_C = Path(__file__).resolve().parents[3] / "shared" / "vectors" / "odid_core_c.jsonl"

GOLDEN = [
    # made by opendroneid-core-c
    ("80000000ffffffffffff0a1b2c3d4e5f0a1b2c3d4e5f000003b98d3e000000006400200400055249442d3401018cdd6cfa0bbc0d44f21904021c"
     "313539364633313241374b32395158300000000000000012205a3103f824531eeb589302c1081b092a084a439f8c010022a0000940e20100524c"
     "01a40109035f0000000000000000004205d136531e032e9302010000000000004bf907d51cac0100",
     Transport.WIFI_BEACON, "0a1b2c3d4e5f", 0x44, 4),
    ("d0000000516f9a0100000a1b2c3d4e5f506f9a0100ff00000409506f9a130340008869199d92090100103600f219020215313539364633303541"
     "374b32395158300000000000000012205a3103ffe8a435012eb694c1081b092a084a43393001000e040001000200",
     Transport.WIFI_NAN, "0a1b2c3d4e5f", 0, 2),
]  # fmt: skip


def heard(transport: Transport, payload: bytes = PACK, counter: int = 7) -> list[Heard]:
    return [Heard(transport, MAC, counter, payload)]


@pytest.mark.parametrize(("raw", "transport", "mac", "counter", "members"), GOLDEN)
def test_golden_frames(raw: str, transport: Transport, mac: str, counter: int, members: int) -> None:
    (found,) = read_80211(bytes.fromhex(raw))
    assert isinstance(found, Heard)
    assert (found.transport, found.mac.hex(), found.counter) == (transport, mac, counter)
    assert [type(item) for item in split_broadcast(found.payload)] == [Member] * members


@pytest.mark.skipif(not CORE_C.exists(), reason="core-c's own vectors are not part of the project")
def test_every_frame_of_core_c() -> None:
    vectors: list[dict[str, Any]] = [json.loads(line) for line in CORE_C.read_text().splitlines()]
    frames = [vector for vector in vectors if vector["kind"] == "frame"]
    assert len(frames) == 12
    for vector in frames:
        found = read_80211(bytes.fromhex(vector["hex"]))
        if vector["fields"] is None:  # a sync beacon says nothing
            assert found == []
            continue
        ((transport, mac, counter, payload),) = found
        assert transport == {"wifi_beacon": "wifi-beacon", "wifi_nan_action": "wifi-nan"}[vector["type"]]
        assert (mac.hex(), counter) == (vector["mac"], vector["counter"])
        said = vector["fields"]
        count = len(said["BasicID"]) + len(said["Auth"]) + sum(
            said[name] is not None for name in ("Location", "SelfID", "System", "OperatorID")
        )  # fmt: skip
        assert len(split_broadcast(payload)) == count


# --- Wi-Fi ---


def test_a_beacon_is_heard_bare_and_behind_radiotap() -> None:
    for frame in (odid_beacon(), odid_beacon() + b"\xde\xad\xbe\xef"):
        assert read_80211(frame) == heard(Transport.WIFI_BEACON)
    for packet in (
        radiotap(odid_beacon()), radiotap(odid_beacon(), 0x10), radiotap(odid_beacon(), 0x10, tsft=True),
        radiotap(odid_beacon(), 0, tsft=True, more=1), radiotap(odid_beacon(), 0x10, tsft=True, more=2),
        radiotap(odid_beacon(), 0, more=3),
    ):  # fmt: skip
        assert read_radiotap(packet) == heard(Transport.WIFI_BEACON)


@pytest.mark.parametrize("options", [{}, {"tsft": True}, {"more": 2}, {"tsft": True, "more": 1}])
def test_a_checksum_that_the_capture_calls_bad_is_a_reject(options: dict[str, Any]) -> None:
    assert read_radiotap(radiotap(odid_beacon(), 0x40, **options)) == [Unheard.BAD_CHECKSUM]
    assert read_radiotap(radiotap(odid_beacon(), 0x50, **options)) == [Unheard.BAD_CHECKSUM]


def test_a_beacon_may_have_several_elements_or_none_of_ours() -> None:
    other = b"\xf1" + PACK[1:]
    assert read_80211(beacon(odid_element() + odid_element(other, 8))) == (
        heard(Transport.WIFI_BEACON) + heard(Transport.WIFI_BEACON, other, 8)
    )
    dji = (b"\x26\x37\x12\x58", b"\x60\x60\x1f\x13")
    for foreign in (*(oui + PACK for oui in dji), b"\xfa\x0b\xbc\x0e\x07" + PACK, b"\x50\x6f\x9a"):
        assert read_80211(beacon(element(0xDD, foreign))) == []
    assert read_80211(beacon(b"")) == []


def test_an_ht_control_field_moves_the_body() -> None:
    frame = odid_beacon()
    assert read_80211(frame[:1] + b"\x80" + frame[2:24] + bytes(4) + frame[24:]) == heard(Transport.WIFI_BEACON)


@pytest.mark.parametrize("subtype", [0x08, 0x40, 0x50, 0xB4, 0xC0])
def test_other_kinds_of_frame_say_nothing(subtype: int) -> None:
    assert read_80211(bytes((subtype,)) + odid_beacon()[1:]) == []


@pytest.mark.parametrize(
    ("control", "optional"),
    [(0x10, b""), (0x50, b"\x01\x00"), (0x14, b"\x02ab"), (0x18, b"\x00"), (0x5C, b"\x01\x00\x01a\x02bc"), (0x30, b"")],
)
def test_a_nan_frame_is_heard_whatever_stands_before_its_service_info(control: int, optional: bytes) -> None:
    assert read_80211(nan(control=control, optional=optional)) == heard(Transport.WIFI_NAN)
    assert read_radiotap(radiotap(nan(control=control, optional=optional), 0x10)) == heard(Transport.WIFI_NAN)


def test_nan_frames_of_other_services_subscriptions_and_encrypted_ones_say_nothing() -> None:
    assert read_80211(nan(control=0x01)) == []
    assert read_80211(nan().replace(bytes.fromhex("8869199d9209"), b"other!")) == []
    assert read_80211(b"\xd0\x40" + nan()[2:]) == []
    assert read_80211(nan().replace(bytes.fromhex("0409506f9a13"), bytes.fromhex("0409506f9a14"))) == []


# --- Bluetooth ---


@pytest.mark.parametrize("kind", [0, 2, 4, 6])
@pytest.mark.parametrize("flags", [True, False])
def test_a_legacy_advertisement_is_heard(kind: int, flags: bool) -> None:
    message = PACK[3:28]
    packet = legacy(kind=kind, flags=flags)
    for found in (read_ble(packet), read_nordic_ble(nordic(packet)), read_ble_with_phdr(phdr(packet))):
        assert found == heard(Transport.BT4, message)


@pytest.mark.parametrize("kind", [1, 3, 5, 8])
def test_pdus_without_advertising_data_say_nothing(kind: int) -> None:
    assert read_ble(legacy(kind=kind)) == []


@pytest.mark.parametrize("header_flags", [0x01, 0x09, 0x0B, 0x19, 0x49, 0x7F])
@pytest.mark.parametrize("coded", [True, False])
def test_an_extended_advertisement_is_heard(header_flags: int, coded: bool) -> None:
    packet = extended(coded=coded, header_flags=header_flags)
    for found in (
        read_ble(packet, coded=coded), read_nordic_ble(nordic(packet, coded=coded)),
        read_ble_with_phdr(phdr(packet, 0x8C01 if coded else 0x4C01)),
    ):  # fmt: skip
        assert found == heard(Transport.BT5)


@pytest.mark.parametrize("version", [1, 2, 3])
def test_every_version_of_the_sniffers_header_is_read(version: int) -> None:
    assert read_nordic_ble(nordic(legacy(), version=version)) == heard(Transport.BT4, PACK[3:28])
    assert read_nordic_ble(nordic(legacy(), crc_ok=False, version=version)) == [Unheard.BAD_CHECKSUM]
    assert read_nordic_ble(nordic(legacy(), version=9)) == []


def test_the_pseudo_header_says_what_can_be_believed() -> None:
    assert read_ble_with_phdr(phdr(legacy(), 0x0401)) == [Unheard.BAD_CHECKSUM]
    assert read_ble_with_phdr(phdr(legacy(), 0x0001)) == heard(Transport.BT4, PACK[3:28])
    assert read_ble_with_phdr(phdr(legacy(), 0x0C00)) == [Unheard.WHITENED]


def test_other_advertisements_and_connections_say_nothing() -> None:
    for foreign in (b"\x16\xfa\xff\x0e\x07", b"\x16\xfe\xff\x0d\x07", b"\xff\xfa\xff\x0d\x07", b"\x16", b""):
        body = MAC + element_of_advertisement(foreign)
        assert read_ble(bytes.fromhex("d6be898e") + bytes((2, len(body))) + body + b"crc") == []
    assert read_ble(b"\x01\x02\x03\x04" + legacy()[4:]) == []
    assert read_nordic_ble(nordic(b"\x01\x02\x03\x04" + legacy()[4:], crc_ok=False)) == []


def test_an_advertiser_without_an_address_has_none() -> None:
    (found,) = read_ble(extended(header_flags=0x08))
    assert isinstance(found, Heard) and found.mac == b"" and found.payload == PACK


# --- cut and hostile frames ---

FRAMES = [
    (read_80211, odid_beacon()),
    (read_radiotap, radiotap(odid_beacon(), tsft=True, more=1)),
    (read_80211, nan()),
    (read_radiotap, radiotap(nan())),
    (read_ble, extended()),
    (read_nordic_ble, nordic(extended(coded=True), coded=True)),
    (read_ble_with_phdr, phdr(legacy(PACK[3:28]))),
]


@pytest.mark.parametrize(("reader", "packet"), FRAMES)
def test_a_frame_cut_anywhere_gives_the_messages_that_are_whole(reader: Any, packet: bytes) -> None:
    whole = split_broadcast(reader(packet)[0].payload)
    counts = []
    for length in range(len(packet) + 1):
        members = [
            item
            for found in reader(packet[:length])
            if isinstance(found, Heard)
            for item in split_broadcast(found.payload)
            if isinstance(item, Member)
        ]
        assert members == whole[: len(members)]
        counts.append(len(members))
    assert counts == sorted(counts) and counts[-1] == len(whole)


@given(st.sampled_from(READERS), st.binary(max_size=200))
def test_any_bytes_are_read(reader: Any, data: bytes) -> None:
    for found in reader(data):
        if isinstance(found, Heard):
            split_broadcast(found.payload)


@given(st.sampled_from(FRAMES), st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_frame_with_bytes_changed_is_read(frame: Any, changes: list[tuple[int, int]]) -> None:
    reader, packet = frame
    damaged = bytearray(packet)
    for at, value in changes:
        damaged[at % len(damaged)] = value
    for found in reader(bytes(damaged)):
        if isinstance(found, Heard):
            split_broadcast(found.payload)
