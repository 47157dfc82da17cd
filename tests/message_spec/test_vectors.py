"""The golden vectors: fields to bytes and bytes to fields, by ridlink and by the oracle that made them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from ridlink.mavlink import dialect
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, Encoder, decode_message, message_spec
from ridlink.mavlink.frames import Frame, parse_datagram

VECTORS = [
    json.loads(line)
    for line in (Path(__file__).parents[2] / "message_spec" / "vectors" / "mavlink.jsonl").read_text().splitlines()
]
each_vector = pytest.mark.parametrize("vector", VECTORS, ids=lambda v: f"{v['type']}: {v['note'][:40]}")


def typed(vector: dict[str, Any]) -> dict[str, Any]:
    return {name: bytes.fromhex(value) if isinstance(value, str) else value for name, value in vector["fields"].items()}


def test_every_message_has_vectors() -> None:
    covered = {vector["type"] for vector in VECTORS}
    assert covered == {spec.name for spec in MESSAGES.values() if spec.name.startswith(("OPEN_DRONE_ID_", "RIDLINK_"))}


@each_vector
def test_vector_is_complete(vector: dict[str, Any]) -> None:
    spec = message_spec(vector["type"])
    assert vector["id"] == spec.msgid
    assert vector["note"]
    assert tuple(vector["fields"]) == spec.xml_fields


@each_vector
def test_fields_to_bytes(vector: dict[str, Any]) -> None:
    encoder = Encoder(vector["sysid"], vector["compid"])
    encoder.seq = vector["seq"]
    assert encoder.encode(vector["type"], **typed(vector)).hex() == vector["hex"]


@each_vector
def test_bytes_to_fields(vector: dict[str, Any]) -> None:
    (frame,) = parse_datagram(bytes.fromhex(vector["hex"]), CRC_EXTRAS)
    assert isinstance(frame, Frame)
    assert (frame.sysid, frame.compid, frame.seq) == (vector["sysid"], vector["compid"], vector["seq"])
    message = decode_message(frame)
    assert message.name == vector["type"]
    assert message.fields == typed(vector)


@each_vector
def test_the_oracle_agrees(vector: dict[str, Any]) -> None:
    module: Any = common if vector["id"] in common.mavlink_map else dialect
    spec = message_spec(vector["type"])
    fields = {
        name: list(value) if isinstance(value, bytes) and spec.types[spec.fields.index(name)] != "char" else value
        for name, value in typed(vector).items()
    }
    writer = module.MAVLink(None, vector["sysid"], vector["compid"])
    writer.seq = vector["seq"]
    assert module.mavlink_map[vector["id"]](**fields).pack(writer).hex() == vector["hex"]
