"""Codec: what goes in comes out, for every message of the dialect, and stock pymavlink agrees both ways."""

from __future__ import annotations

import copy
import math
import pickle
import struct
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from ridlink.errors import PayloadError, UnknownMessageError
from ridlink.mavlink import dialect
from ridlink.mavlink.codec import (
    CRC_EXTRAS,
    MESSAGES,
    Encoder,
    MessageSpec,
    decode_message,
    decode_payload,
    encode_payload,
    message_spec,
)
from ridlink.mavlink.frames import Frame, encode_frame, parse_datagram

unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine is no failure."""

RANGES = {
    f"{sign}int{bits}_t": (-(1 << bits - 1) if not sign else 0, (1 << bits - (not sign)) - 1)
    for bits in (8, 16, 32, 64)
    for sign in ("", "u")
}


def scalar(kind: str) -> st.SearchStrategy[Any]:
    if kind == "float":
        return st.floats(width=32)
    if kind == "double":
        return st.floats()
    return st.integers(*RANGES[kind])


def fields_of(spec: MessageSpec) -> st.SearchStrategy[dict[str, Any]]:
    values: dict[str, st.SearchStrategy[Any]] = {}
    for name, kind, length in zip(spec.fields, spec.types, spec.array_lengths, strict=True):
        if length and kind in ("uint8_t", "char"):
            values[name] = st.binary(min_size=length, max_size=length)
        elif length:
            values[name] = st.tuples(*[scalar(kind)] * length)
        else:
            values[name] = scalar(kind)
    return st.fixed_dictionaries(values)


def single(data: bytes) -> Frame:
    (frame,) = parse_datagram(data, CRC_EXTRAS)
    assert isinstance(frame, Frame)
    return frame


def sample(spec: MessageSpec) -> dict[str, Any]:
    """Distinct values in every field, the last byte of the wire not zero."""
    fields: dict[str, Any] = {}
    for index, (name, kind, length) in enumerate(zip(spec.fields, spec.types, spec.array_lengths, strict=True)):
        if kind == "char":
            fields[name] = f"text{index}"[:length].encode().ljust(length, b"\0")
        elif kind == "uint8_t" and length:
            fields[name] = bytes((index + i) % 255 + 1 for i in range(length))
        else:
            low = -1 if kind[0] != "u" else 1
            numbers = tuple(
                low * (index + i + 1) / (2 if kind in ("float", "double") else 1) for i in range(length or 1)
            )
            typed = numbers if kind in ("float", "double") else tuple(int(number) for number in numbers)
            fields[name] = typed if length else typed[0]
    return fields


def plain(spec: MessageSpec, message: Any) -> dict[str, Any]:
    """Fields of a pymavlink message in our types."""
    fields: dict[str, Any] = {}
    for name, kind, length in zip(spec.fields, spec.types, spec.array_lengths, strict=True):
        value = getattr(message, name)
        if kind == "char" and length:
            fields[name] = value.encode().ljust(length, b"\0")
        elif kind == "uint8_t" and length:
            fields[name] = bytes(value)
        else:
            fields[name] = tuple(value) if length else value
    return fields


class TestRoundTrip:
    @settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(
        st.sampled_from(sorted(MESSAGES))
        .map(MESSAGES.__getitem__)
        .flatmap(lambda s: st.tuples(st.just(s), fields_of(s)))
    )
    def test_decode_of_encode_is_the_identity(self, case: tuple[MessageSpec, dict[str, Any]]) -> None:
        spec, fields = case
        message = decode_message(single(Encoder(1, 2).encode(spec.name, **fields)))
        assert message.name == spec.name
        # bytes are compared, because NaN equals nothing; the bits of a NaN survive the wire
        assert encode_payload(spec, message.fields) == encode_payload(spec, fields)
        assert list(message.fields) == list(spec.fields)
        for name, value in fields.items():
            if not isinstance(value, float) or not math.isnan(value):
                assert repr(message.fields[name]) == repr(value)

    @unhurried
    @given(st.sampled_from(sorted(MESSAGES)), st.binary(max_size=255))
    def test_any_payload_decodes_and_encodes_to_itself(self, msgid: int, payload: bytes) -> None:
        spec = MESSAGES[msgid]
        again = encode_payload(spec, decode_payload(spec, payload))
        expected = payload[: spec.size].ljust(spec.size, b"\0")
        if not any(kind in ("float", "double") for kind in spec.types):  # a signalling NaN may come back quiet
            assert again == expected
        assert len(again) == spec.size

    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_commands_may_carry_nan_and_infinity(self, value: float) -> None:
        message = decode_message(single(Encoder(1, 1).encode("COMMAND_LONG", param4=value)))
        assert struct.pack("<f", message.param4) == struct.pack("<f", value)

    def test_cut_zeros_come_back(self) -> None:
        fields = {"horizontal_error": 300}
        frame = single(Encoder(1, 1).encode("RIDLINK_SEPARATION", **fields))
        assert frame.payload == bytes.fromhex("000000002c01")
        message = decode_message(frame)
        assert (message.horizontal_error, message.flags, message.id_or_mac) == (300, 0, bytes(20))

    def test_a_longer_payload_of_a_newer_dialect_is_read_as_far_as_known(self) -> None:
        spec = message_spec("RIDLINK_SEPARATION")
        payload = encode_payload(spec, {"flags": 3}) + b"\x07\x08"
        frame = single(encode_frame(spec.msgid, payload, spec.crc_extra, seq=0, sysid=1, compid=1))
        assert decode_message(frame).flags == 3


class TestRefusals:
    @pytest.mark.parametrize(
        ("name", "fields", "field"),
        [
            ("RIDLINK_SEPARATION", {"horizontal_error": 65536}, "horizontal_error"),
            ("RIDLINK_SEPARATION", {"horizontal_error": -1}, "horizontal_error"),
            ("RIDLINK_SEPARATION", {"horizontal_error": 1.5}, "horizontal_error"),
            ("RIDLINK_SEPARATION", {"horizontal_error": None}, "horizontal_error"),
            ("RIDLINK_SEPARATION", {"flags": "8"}, "flags"),
            ("RIDLINK_SEPARATION", {"id_or_mac": bytes(21)}, "id_or_mac"),
            ("RIDLINK_SEPARATION", {"id_or_mac": [256]}, "id_or_mac"),
            ("RIDLINK_SEPARATION", {"id_or_mac": 20}, "id_or_mac"),
            ("RIDLINK_SEPARATION", {"id_or_mac": None}, "id_or_mac"),
            ("RIDLINK_SEPARATION", {"colour": 1}, "colour"),
            ("RIDLINK_SEPARATION", {"timestamp": 1e39}, "timestamp"),
            ("GPS_STATUS", {"satellite_prn": bytes(21)}, "satellite_prn"),
            ("ATTITUDE_QUATERNION_COV", {"q": [1.0, 0.0]}, "q"),
            ("ATTITUDE_QUATERNION_COV", {"q": [1.0, 0.0, "0", 0.0]}, "q"),
            ("ATTITUDE_QUATERNION_COV", {"q": 1.0}, "q"),
        ],
    )
    def test_a_field_that_does_not_fit_is_named(self, name: str, fields: dict[str, Any], field: str) -> None:
        with pytest.raises(PayloadError) as caught:
            Encoder(1, 1).encode(name, **fields)
        assert (caught.value.message, caught.value.field) == (name, field)
        assert field in str(caught.value)
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize(
        ("name", "fields", "text"),
        [
            ("RIDLINK_SEPARATION", {"colour": 1}, "RIDLINK_SEPARATION has no field 'colour'"),
            ("RIDLINK_SEPARATION", {"id_or_mac": bytes(21)}, "RIDLINK_SEPARATION.id_or_mac takes 20 bytes, not 21"),
            ("ATTITUDE_QUATERNION_COV", {"q": (1.0, 0.0)}, "ATTITUDE_QUATERNION_COV.q takes 4 values, not 2"),
        ],
    )
    def test_the_text_says_what_would_fit(self, name: str, fields: dict[str, Any], text: str) -> None:
        with pytest.raises(PayloadError) as caught:
            Encoder(1, 1).encode(name, **fields)
        assert str(caught.value) == text

    def test_a_refused_message_takes_no_sequence_number(self) -> None:
        encoder = Encoder(1, 1)
        with pytest.raises(PayloadError):
            encoder.encode("HEARTBEAT", type=300)
        assert encoder.encode("HEARTBEAT")[4] == 0

    def test_unknown_names_and_ids(self) -> None:
        with pytest.raises(UnknownMessageError, match="NO_SUCH"):
            Encoder(1, 1).encode("NO_SUCH")
        with pytest.raises(UnknownMessageError) as caught:
            decode_message(single(encode_frame(99_999, b"\x01", 0, seq=0, sysid=1, compid=1)))
        assert caught.value.message == 99_999

    @pytest.mark.parametrize("value", ["PX4", b"PX4", [80, 88, 52], bytearray(b"PX4"), memoryview(b"PX4")])
    def test_bytes_may_come_as_text_bytes_or_integers(self, value: Any) -> None:
        message = decode_message(single(Encoder(1, 1).encode("OPEN_DRONE_ID_BASIC_ID", uas_id=value)))
        assert message.uas_id == b"PX4".ljust(20, b"\0")


class TestMessage:
    def test_attributes_and_text(self) -> None:
        message = decode_message(single(Encoder(1, 1).encode("SYSTEM_TIME", time_boot_ms=5)))
        assert (message.name, message.msgid, message.time_boot_ms) == ("SYSTEM_TIME", 2, 5)
        assert repr(message) == "SYSTEM_TIME(time_unix_usec=0, time_boot_ms=5)"
        with pytest.raises(AttributeError, match="SYSTEM_TIME has no field 'altitude'"):
            _ = message.altitude

    def test_a_field_called_name_is_in_fields(self) -> None:
        message = decode_message(single(Encoder(1, 1).encode("NAMED_VALUE_INT", name="margin", value=3)))
        assert message.name == "NAMED_VALUE_INT"
        assert message.fields["name"] == b"margin\0\0\0\0"

    def test_copies_and_pickles(self) -> None:
        message = decode_message(single(Encoder(1, 1).encode("SYSTEM_TIME", time_boot_ms=5)))
        for twin in (copy.copy(message), copy.deepcopy(message), pickle.loads(pickle.dumps(message))):
            assert twin == message
        assert message != decode_message(single(Encoder(1, 1).encode("SYSTEM_TIME", time_boot_ms=6)))


class TestPymavlink:
    """Stock pymavlink, common dialect; for ids that are ours alone, the module that mavgen made of our XML."""

    @pytest.mark.parametrize("spec", MESSAGES.values(), ids=lambda spec: spec.name)
    def test_reads_what_we_write(self, spec: MessageSpec) -> None:
        reader = (common if spec.msgid in common.mavlink_map else dialect).MAVLink(None)
        fields = sample(spec)
        (message,) = reader.parse_buffer(Encoder(17, 196).encode(spec.name, **fields))
        assert message.get_msgId() == spec.msgid
        assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (17, 196, 0)
        assert plain(spec, message) == fields

    @pytest.mark.parametrize("spec", MESSAGES.values(), ids=lambda spec: spec.name)
    def test_writes_what_we_read(self, spec: MessageSpec) -> None:
        module = common if spec.msgid in common.mavlink_map else dialect
        writer = module.MAVLink(None, 17, 196)
        fields = sample(spec)
        given_as = {
            name: list(value) if isinstance(value, bytes) and kind != "char" else value
            for (name, value), kind in zip(fields.items(), spec.types, strict=True)
        }
        version = {"mavlink_version": given_as.pop("mavlink_version")} if "mavlink_version" in given_as else {}
        frame = single(module.mavlink_map[spec.msgid](**given_as, **version).pack(writer))
        assert decode_message(frame).fields == fields
        assert frame.raw == Encoder(17, 196).encode(spec.name, **fields)

    def test_reads_our_location_byte_for_byte(self) -> None:
        spec = message_spec("OPEN_DRONE_ID_LOCATION")
        raw = Encoder(1, 236).encode(spec.name, **sample(spec))
        (message,) = common.MAVLink(None).parse_buffer(raw)
        assert message.get_type() == "OPEN_DRONE_ID_LOCATION"
        assert bytes(message.get_msgbuf()) == raw
        assert bytes(message.pack(common.MAVLink(None, 1, 236))) == raw

    @pytest.mark.parametrize("name", ["RIDLINK_SEPARATION", "RIDLINK_STATUS"])
    def test_stock_reader_passes_over_our_own_messages(self, name: str) -> None:
        spec = message_spec(name)
        encoder = Encoder(1, 1)
        data = encoder.encode("HEARTBEAT") + encoder.encode(name, **sample(spec)) + encoder.encode("HEARTBEAT")
        reader = common.MAVLink(None)  # strict: it raises where it finds an error
        messages = reader.parse_buffer(data)
        assert [message.get_type() for message in messages] == ["HEARTBEAT", f"UNKNOWN_{spec.msgid}", "HEARTBEAT"]
        assert isinstance(messages[1], common.MAVLink_unknown)
        assert reader.total_receive_errors == 0
