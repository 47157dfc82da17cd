"""The specification in prose agrees with the XML: sizes, offsets, types, units, flags."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import pytest

from ridlink.mavlink import dialect
from ridlink.mavlink.codec import message_spec

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


def test_every_field_and_entry_is_described_in_the_xml() -> None:
    fields = re.findall(r"<field [^>]*>([^<]*)</field>", XML)
    entries = re.findall(r"<entry [^>]*>\s*<description>([^<]*)</description>", XML)
    assert len(fields) == XML.count("<field ") and len(entries) == XML.count("<entry ")
    assert all(text.endswith(".") for text in fields + entries)
