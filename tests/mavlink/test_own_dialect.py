"""The generated dialect: upstream's messages unchanged, our two beside them, no switch for the whole process."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common, minimal

from message_spec.generate import generate
from ridlink.mavlink import dialect
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, message_spec

ROOT = Path(__file__).parents[2]


BOTH = sorted(MESSAGES.keys() & common.mavlink_map.keys())
"""The dialect was generated when ridlink was built, perhaps with another pymavlink than the one installed now."""


def test_nearly_all_of_upstream_is_there() -> None:
    assert len(BOTH) >= 200
    assert {12900, 12901, 12902, 12903, 12904, 12905, 12915, 12918, 12919} <= set(BOTH)


@pytest.mark.parametrize("msgid", BOTH)
def test_upstream_messages_are_unchanged(msgid: int) -> None:
    theirs, spec = common.mavlink_map[msgid], MESSAGES[msgid]
    ours = dialect.mavlink_map[msgid]
    assert spec.name == theirs.msgname
    assert spec.crc_extra == CRC_EXTRAS[msgid] == theirs.crc_extra
    assert spec.size == theirs.unpacker.size
    assert list(spec.fields) == theirs.ordered_fieldnames
    assert list(spec.xml_fields) == theirs.fieldnames
    for attribute in ("fieldtypes", "array_lengths", "fieldunits_by_name", "fieldenums_by_name", "native_format"):
        assert getattr(ours, attribute) == getattr(theirs, attribute), attribute


def test_only_our_two_messages_are_added() -> None:
    assert {msgid: MESSAGES[msgid].name for msgid in MESSAGES if 61400 <= msgid < 61500} == {
        61400: "RIDLINK_SEPARATION",
        61401: "RIDLINK_STATUS",
    }


def test_the_odid_enums_are_upstreams() -> None:
    for name, entries in common.enums.items():
        if name.startswith("MAV_ODID_"):
            assert {key: entry.name for key, entry in dialect.enums[name].items()} == {
                key: entry.name for key, entry in entries.items()
            }


def test_only_our_enums_have_our_names() -> None:
    assert {name for name in dialect.enums if name.startswith("RIDLINK_")} == {
        "RIDLINK_SEPARATION_FLAGS",
        "RIDLINK_STATE",
        "RIDLINK_SOLVER_STATUS",
    }


FIXED = "a message never changes nor grows: what must carry more gets a new id (message_spec/README.md, Versions)"


def test_layout_of_ridlink_separation() -> None:
    spec = message_spec("RIDLINK_SEPARATION")
    assert (spec.msgid, spec.size, spec.crc_extra) == (61400, 45, 37), FIXED
    assert spec.xml_fields == (
        "target_system", "target_component", "id_or_mac", "timestamp", "horizontal_error", "vertical_error",
        "velocity_error", "airframe_size", "airframe_height", "update_interval", "commanded_vx", "commanded_vy",
        "commanded_vz", "flags",
    )  # fmt: skip
    assert spec.fields == (
        "timestamp", "horizontal_error", "vertical_error", "velocity_error", "airframe_size", "airframe_height",
        "update_interval", "commanded_vx", "commanded_vy", "commanded_vz", "target_system", "target_component",
        "id_or_mac", "flags",
    )  # fmt: skip
    assert spec.units["horizontal_error"] == "cm"
    assert spec.units["velocity_error"] == "cm/s"


def test_layout_of_ridlink_status() -> None:
    spec = message_spec("RIDLINK_STATUS")
    assert (spec.msgid, spec.size, spec.crc_extra) == (61401, 38, 170), FIXED
    assert spec.fields[-3:] == ("binding_systems", "state", "solver_status")


def test_several_dialects_live_in_one_process() -> None:
    assert 61400 not in common.mavlink_map
    assert 61400 in dialect.mavlink_map
    for module, known in ((common, False), (minimal, False), (dialect, True)):
        raw = dialect.MAVLink_ridlink_separation_message(0, 0, [0] * 20, 1.0, 1, 1, 1, 1, 1, 1, 0, 0, 0, 1).pack(
            dialect.MAVLink(None, 1, 1)
        )
        (message,) = module.MAVLink(None).parse_buffer(raw)
        assert (message.get_type() == "RIDLINK_SEPARATION") is known


def test_the_wire_layer_touches_no_global_switch() -> None:
    program = (
        "import os, sys; before = dict(os.environ); import ridlink.mavlink.codec;"
        "assert dict(os.environ) == before; assert not [m for m in sys.modules if m.startswith('pymavlink')];"
        "assert 'numpy' not in sys.modules and 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=30)


def test_dialect_is_what_the_xml_says_now(tmp_path: Path) -> None:
    generate("python", tmp_path / "fresh.py")
    spec = importlib.util.spec_from_file_location("fresh", tmp_path / "fresh.py")
    assert spec is not None and spec.loader is not None
    fresh = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fresh)
    for msgid in [*BOTH, 61400, 61401]:
        ours = fresh.mavlink_map[msgid]
        assert ours.crc_extra == CRC_EXTRAS[msgid], "pip install -e . makes it anew"
        assert ours.fieldunits_by_name == MESSAGES[msgid].units, "pip install -e . makes it anew"


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a git work tree")
def test_the_generated_module_is_not_in_git() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "ridlink/mavlink"], cwd=ROOT, check=True, capture_output=True, text=True, timeout=30
    ).stdout.splitlines()
    assert "ridlink/mavlink/codec.py" in listed
    assert "ridlink/mavlink/dialect.py" not in listed
