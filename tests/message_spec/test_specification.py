"""The specification in prose agrees with the XML: sizes, offsets, types, units, flags."""

from __future__ import annotations

import re
import struct
from enum import IntEnum, IntFlag
from pathlib import Path

import pytest

from message_spec.definitions import read_definitions
from message_spec.generate import DIALECT_XML
from ridlink.avoidance.types import Status
from ridlink.failsafe import State
from ridlink.mavlink import dialect
from ridlink.mavlink.codec import message_spec
from ridlink.remote_id.messages import SeparationFlags

TEXT = (Path(__file__).parents[2] / "message_spec" / "README.md").read_text()
XML = (Path(__file__).parents[2] / "message_spec" / "ridlink.xml").read_text()


def section(title: str) -> str:
    return TEXT.split(f"## {title}", 1)[1].split("\n## ", 1)[0]


@pytest.mark.parametrize("name", ["RIDLINK_SEPARATION", "RIDLINK_STATUS"])
def test_ids_sizes_and_seeds(name: str) -> None:
    spec = message_spec(name)
    assert f"| {spec.msgid} | {name} | {spec.size} bytes | {spec.crc_extra} |" in TEXT


def test_offsets_and_types_of_separation() -> None:
    spec = message_spec("RIDLINK_SEPARATION")
    rows = re.findall(
        r"^\| (\d+) \| `(\w+)` \| (\S+) \| ([^ |]*) ?\|", section("RIDLINK_SEPARATION (61400)"), re.MULTILINE
    )
    assert [name for _, name, _, _ in rows] == list(spec.fields)
    at = 0
    for (offset, name, kind, unit), wire_kind, length in zip(rows, spec.types, spec.array_lengths, strict=True):
        assert int(offset) == at, name
        assert kind == wire_kind.removesuffix("_t") + (f"[{length}]" if length else ""), name
        assert unit == spec.units.get(name, ""), name
        at += struct.calcsize({"float": "f", "uint16_t": "H", "int16_t": "h", "uint8_t": "B"}[wire_kind]) * (
            length or 1
        )
    assert at == spec.size


def test_offsets_of_status() -> None:
    spec = message_spec("RIDLINK_STATUS")
    rows = re.findall(r"^\| ([\d, ]+) \| (`\w+`(?:, `\w+`)*) \|", section("RIDLINK_STATUS (61401)"), re.MULTILINE)
    offsets = [int(offset) for row, _ in rows for offset in row.split(", ")]
    names: list[str] = []
    for _, row in rows:
        first, *others = re.findall(r"`(\w+)`", row)
        names += [first, *(first.removesuffix("_vx") + other for other in others)]
    assert names == list(spec.fields)
    # each offset is where a payload that is zero but for this field first differs
    for offset, name, length in zip(offsets, spec.fields, spec.array_lengths, strict=True):
        fields = spec.zeros | {name: b"\1" + bytes(length - 1) if length else 1}
        assert spec.layout.pack(*fields.values()).index(1) == offset


def test_flags() -> None:
    entries = dialect.enums["RIDLINK_SEPARATION_FLAGS"]
    rows = re.findall(r"^\| (\d+) \| ([A-Z_]+) \|", TEXT, re.MULTILINE)
    documented = {int(value): name for value, name in rows if int(value) < 256}
    assert documented == {
        value: entry.name.removeprefix("RIDLINK_SEPARATION_FLAGS_")
        for value, entry in entries.items()
        if not entry.name.endswith("ENUM_END")
    }


def own_fields(name: str) -> dict[str, dict[str, str]]:
    """What the XML says numbers mean: units, enum and value for unknown, by field."""
    (definition,) = (each for each in read_definitions(DIALECT_XML).messages if each.name == name)
    return {each.name: each.meaning for each in definition.fields}


def test_what_unknown_is_in_separation() -> None:
    rows = re.findall(
        r"^\| \d+ \| `(\w+)` \|(?:[^|]*\|){3} ([^|]*?) ?\|$", section("RIDLINK_SEPARATION (61400)"), re.MULTILINE
    )
    told = {name: unknown for name, unknown in rows if unknown.isdecimal()}
    said = {
        name: meaning["invalid"] for name, meaning in own_fields("RIDLINK_SEPARATION").items() if "invalid" in meaning
    }
    assert told == said and len(said) == 7


def test_units_and_none_of_status() -> None:
    rows = re.findall(
        r"^\| [\d, ]+ \| (`\w+`(?:, `\w+`)*) \| \S+ \| ([^ |]*) ?\| ([^|]*) \|$",
        section("RIDLINK_STATUS (61401)"),
        re.MULTILINE,
    )
    told = {name: (unit, text) for names, unit, text in rows for name in re.findall(r"`(\w+)`", names)[:1]}
    for name, meaning in own_fields("RIDLINK_STATUS").items():
        unit, text = told[re.sub("_v[yz]$", "_vx", name)]
        assert unit == meaning.get("units", ""), name
        assert meaning.get("invalid", "") in text, name


ENUMS = {
    "RIDLINK_SEPARATION_FLAGS": {"AVOIDING": 1, "ERROR_MEASURED": 2, "SIMULATED": 4, "COMMANDED_VELOCITY_GIVEN": 8},
    "RIDLINK_STATE": {"STANDBY": 0, "ENGAGED": 1, "HOLD": 2, "STOPPED": 3},
    "RIDLINK_SOLVER_STATUS": {"FREE": 0, "CONSTRAINED": 1, "OVERLAPPED": 2, "INFEASIBLE": 3},
}
"""Sent by everybody who has this version: values may be added, and none is ever changed or used again."""


def test_values_of_enums_stay() -> None:
    entries = [entry for entry in read_definitions(DIALECT_XML).entries if entry.enum.startswith("RIDLINK_")]
    assert {(entry.enum, entry.name.removeprefix(f"{entry.enum}_")): entry.value for entry in entries} == {
        (enum, name): value for enum, values in ENUMS.items() for name, value in values.items()
    }


@pytest.mark.parametrize(("enum", "field"), [("RIDLINK_STATE", "state"), ("RIDLINK_SOLVER_STATUS", "solver_status")])
def test_the_text_has_the_values_of_enums(enum: str, field: str) -> None:
    (told,) = re.findall(rf"^\| \d+ \| `{field}` \|.*\| ([^|]*) \|$", section("RIDLINK_STATUS (61401)"), re.MULTILINE)
    assert told == ", ".join(f"{value} {name.lower()}" for name, value in ENUMS[enum].items())


@pytest.mark.parametrize(
    ("ours", "enum"),
    [(SeparationFlags, "RIDLINK_SEPARATION_FLAGS"), (State, "RIDLINK_STATE"), (Status, "RIDLINK_SOLVER_STATUS")],
)
def test_the_code_has_the_values_of_enums(ours: type[IntEnum | IntFlag], enum: str) -> None:
    assert {member.name: int(member) for member in ours} == ENUMS[enum]


def test_fields_are_of_their_enums() -> None:
    messages = ("RIDLINK_SEPARATION", "RIDLINK_STATUS")
    said = {
        field: meaning["enum"] for name in messages for field, meaning in own_fields(name).items() if "enum" in meaning
    }
    assert said == dict(zip(("flags", "state", "solver_status"), ENUMS, strict=True))
    assert '<enum name="RIDLINK_SEPARATION_FLAGS" bitmask="true">' in XML
    assert 'enum="RIDLINK_SEPARATION_FLAGS" display="bitmask"' in XML


def test_every_field_and_entry_is_described_in_the_xml() -> None:
    fields = re.findall(r"<field [^>]*>([^<]*)</field>", XML)
    entries = re.findall(r"<entry [^>]*>\s*<description>([^<]*)</description>", XML)
    assert len(fields) == XML.count("<field ") and len(entries) == XML.count("<entry ")
    assert all(text.endswith(".") for text in fields + entries)
