"""The check of foreign definitions: what differs on the wire is found, and a hostile file does no harm."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from message_spec.check import OWN_ENUMS, OWN_IDS, check_file
from message_spec.definitions import DefinitionError, Definitions, read_definitions
from message_spec.generate import DIALECT_XML, definition_files
from ridlink.files import write_together
from ridlink.mavlink.codec import MESSAGES

OURS = DIALECT_XML.read_text()
COUNT = len(read_definitions(DIALECT_XML).messages)

Edit = Callable[[str, str], Path]


@pytest.fixture
def edited(tmp_path: Path) -> Edit:
    def edit(old: str, new: str) -> Path:
        assert old in OURS
        path = tmp_path / "theirs.xml"
        path.write_text(OURS.replace(old, new, 1))
        return path

    return edit


def lines(path: Path) -> list[str]:
    return [f"{d.kind} {d.msgid} {d.text}" for d in check_file(path)[0]]


def test_reads_what_mavgen_reads() -> None:
    definitions = read_definitions(DIALECT_XML).messages
    assert len(definitions) >= 200
    for definition in definitions:
        if definition.msgid in MESSAGES:  # the installed pymavlink may be newer than the one of the build
            spec = MESSAGES[definition.msgid]
            assert (definition.name, definition.size, definition.crc_extra) == (spec.name, spec.size, spec.crc_extra)
            assert tuple(field.name for field in definition.fields) == spec.fields
    assert next(d.origin for d in definitions if d.msgid == 12901) == "common.xml"


def test_our_own_file_is_compatible() -> None:
    assert check_file(DIALECT_XML) == ([], COUNT)


def test_a_dialect_that_includes_ours_and_adds_to_it_is_compatible(tmp_path: Path) -> None:
    write_together(tmp_path, definition_files())
    theirs = tmp_path / "theirs.xml"
    theirs.write_text(
        "<mavlink><include>ridlink.xml</include><messages>"
        '<message id="52000" name="THEIRS"><field type="uint8_t" name="a">b</field></message></messages></mavlink>'
    )
    assert check_file(theirs) == ([], COUNT + 1)


def test_a_definition_that_lies_in_two_places_is_one(tmp_path: Path) -> None:
    """The dialect of a vehicle, as pymavlink ships it, and ours: either brings a common.xml, and they are the same."""
    write_together(tmp_path, definition_files())
    theirs = tmp_path / "theirs.xml"
    text = DIALECT_XML.with_name("README.md").read_text()  # the example of the specification
    theirs.write_text(text[text.index("    <mavlink>") : text.index("    </mavlink>")] + "</mavlink>")
    assert "<include>ardupilotmega.xml</include>" in theirs.read_text() and "MY_WIND" in theirs.read_text()
    differences, count = check_file(theirs)
    assert not differences and count > COUNT
    common = tmp_path / "common.xml"
    common.write_text(common.read_text() + "<!-- of another day -->")
    assert "collision 0 defined 2 times: HEARTBEAT" not in lines(theirs)  # minimal.xml is still the same
    assert "collision 12901 defined 2 times: OPEN_DRONE_ID_LOCATION" in lines(theirs)


def test_missing(edited: Edit) -> None:
    assert lines(edited("<include>common.xml</include>", "<include>minimal.xml</include>"))[:2] == [
        "missing 1 SYS_STATUS of common.xml",
        "missing 2 SYSTEM_TIME of common.xml",
    ]


def test_changed_type(edited: Edit) -> None:
    (line,) = lines(edited('"uint16_t" name="airframe_size"', '"uint32_t" name="airframe_size"'))
    assert line.startswith("changed 61400 RIDLINK_SEPARATION: 47 bytes, 45 in ridlink.xml; CRC_EXTRA ")
    assert line.endswith("field 1 on the wire is uint32_t airframe_size, not uint16_t horizontal_error")


def test_renamed_field(edited: Edit) -> None:
    (line,) = lines(edited('name="airframe_height"', 'name="height"'))
    assert "37 in ridlink.xml" in line
    assert "uint16_t height, not uint16_t airframe_height" in line


def test_appended_extension_outside_the_checksum(edited: Edit) -> None:
    extra = '<extensions/><field type="uint8_t" name="colour">x</field>\n    </message>\n    <message id="61401"'
    (line,) = lines(edited('</message>\n    <message id="61401"', extra))
    assert line == "changed 61400 RIDLINK_SEPARATION: 46 bytes, 45 in ridlink.xml; added: colour"


def test_changed_upstream_message(tmp_path: Path) -> None:
    files = definition_files()
    files["common.xml"] = files["common.xml"].replace(b'name="speed_horizontal"', b'name="speed"')
    write_together(tmp_path, files)
    (line,) = lines(tmp_path / "ridlink.xml")
    assert line.startswith("changed 12901 OPEN_DRONE_ID_LOCATION: CRC_EXTRA ")
    assert "254 in common.xml" in line


def test_colliding_ids(edited: Edit) -> None:
    assert lines(edited('name="RIDLINK_STATUS"', 'name="THEIR_STATUS"')) == [
        "collision 61401 THEIR_STATUS, which is RIDLINK_STATUS in ridlink.xml",
    ]
    assert lines(edited('id="61401"', 'id="61400"')) == [
        "collision 61400 defined 2 times: RIDLINK_SEPARATION, RIDLINK_STATUS",
        "collision 61400 RIDLINK_STATUS, which is RIDLINK_SEPARATION in ridlink.xml",
    ]
    assert lines(edited('id="61401" name="RIDLINK_STATUS"', 'id="61499" name="OTHER"')) == [
        "missing 61401 RIDLINK_STATUS of ridlink.xml",
        "collision 61499 OTHER takes an id that is reserved for ridlink",
    ]


def test_moved_id(edited: Edit) -> None:
    assert lines(edited('id="61401"', 'id="52001"')) == ["changed 52001 RIDLINK_STATUS has this id, 61401 in ours"]


SIMULATED, HOLD = "RIDLINK_SEPARATION_FLAGS_SIMULATED", "RIDLINK_STATE_HOLD"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            f'value="4" name="{SIMULATED}"',
            f'value="16" name="{SIMULATED}"',
            f"changed None {SIMULATED} is 16, 4 in ours",
        ),
        (f'value="4" name="{SIMULATED}"', f'value="" name="{SIMULATED}"', f"changed None {SIMULATED} is '', 4 in ours"),
        (f'value="4" name="{SIMULATED}"', f'name="{SIMULATED}"', f"changed None {SIMULATED} is 3, 4 in ours"),
        (
            f'value="2" name="{HOLD}"',
            'value="2" name="RIDLINK_STATE_WAIT"',
            f"collision None RIDLINK_STATE_WAIT takes 2 in RIDLINK_STATE, which is {HOLD}",
        ),
        (
            'name="horizontal_error" units="cm"',
            'name="horizontal_error" units="m"',
            "changed 61400 RIDLINK_SEPARATION.horizontal_error has units 'm', 'cm' in ridlink.xml",
        ),
        (
            'name="nearest_margin" units="cm"',
            'name="nearest_margin"',
            "changed 61401 RIDLINK_STATUS.nearest_margin has units '', 'cm' in ridlink.xml",
        ),
        (
            'units="s" invalid="65535"',
            'units="s" invalid="\x9b2J"',
            r"changed 61400 RIDLINK_SEPARATION.timestamp has invalid '\x9b2J', '65535' in ridlink.xml",
        ),
        (
            'enum="RIDLINK_STATE"',
            'enum="RIDLINK_SOLVER_STATUS"',
            "changed 61401 RIDLINK_STATUS.state has enum 'RIDLINK_SOLVER_STATUS', 'RIDLINK_STATE' in ridlink.xml",
        ),
    ],
)
def test_the_same_bytes_that_mean_something_else(edited: Edit, old: str, new: str, says: str) -> None:
    assert lines(edited(old, new)) == [says]


@pytest.mark.parametrize("value", ["0x4", "0b100", " 4 ", "4"])
def test_numbers_may_be_written_in_other_ways(edited: Edit, value: str) -> None:
    assert lines(edited('value="4"', f'value="{value}"')) == []


def test_values_that_are_added_to_ours_and_words_of_upstream_are_no_difference(tmp_path: Path) -> None:
    files = definition_files()
    own, upstream = files["ridlink.xml"], files["common.xml"]
    files["ridlink.xml"] = own.replace(b"</enum>", b'<entry value="16" name="THEIRS"/></enum>', 1)
    files["common.xml"] = upstream.replace(b'name="speed_horizontal" units="cm/s"', b'name="speed_horizontal"')
    assert files["ridlink.xml"] != own and files["common.xml"] != upstream
    write_together(tmp_path, files)
    assert lines(tmp_path / "ridlink.xml") == []


def test_a_changed_value_of_upstream(tmp_path: Path) -> None:
    files = definition_files()
    files["common.xml"] = files["common.xml"].replace(
        b'value="1" name="MAV_ODID_STATUS_GROUND"', b'value="5" name="MAV_ODID_STATUS_GROUND"'
    )
    write_together(tmp_path, files)
    assert lines(tmp_path / "ridlink.xml") == ["changed None MAV_ODID_STATUS_GROUND is 5, 1 in ours"]


def test_no_dialect_that_pymavlink_ships_uses_our_numbers_or_names() -> None:
    shipped = sorted(Path(str(resources.files("pymavlink") / "dialects" / "v20")).glob("*.xml"))
    assert len(shipped) >= 10
    for path in shipped:
        found = read_definitions(path)
        assert not [each for each in found.messages if each.msgid in OWN_IDS or each.name.startswith(OWN_ENUMS)], path
        assert not [entry for entry in found.entries if entry.enum.startswith(OWN_ENUMS)], path
        assert {difference.kind for difference in check_file(path)[0]} <= {"missing"}, path


BOMB = '<!DOCTYPE l [<!ENTITY a "ha">' + "".join(
    f'<!ENTITY {b} "{f"&{a};" * 20}">' for a, b in zip("abcdefghijkl", "bcdefghijklm", strict=True)
) + "]>"  # fmt: skip

MESSAGE = (
    '<mavlink><messages><message id="{id}" name="A"><field type="{type}" name="b">c</field></message></messages>'
    "</mavlink>"
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no element found"),
        ("<mavlink>", "no element found"),
        ("<mavlink><a></mavlink>", "mismatched tag"),
        ("\x00\x01\x02", "not well-formed"),
        ("<html/>", "the root is <html>, not <mavlink>"),
        ('<?xml version="1.0" encoding="klingon"?><mavlink/>', "unknown encoding"),
        (BOMB + "<mavlink>&m;</mavlink>", "a document type is declared"),
        ('<!DOCTYPE m SYSTEM "file:///etc/passwd"><mavlink/>', "a document type is declared"),
        ("<mavlink>&undeclared;</mavlink>", "undefined entity"),
        ("<mavlink><include>gone.xml</include></mavlink>", "includes 'gone.xml', which is neither"),
        ("<mavlink><include>/dev/zero</include></mavlink>", "includes '/dev/zero', which is neither"),
        ('<mavlink><messages><message name="A"/></messages></mavlink>', "line 1: <message> has no id"),
        ('<mavlink><messages><message id="1" name="A"/></messages></mavlink>', "A has 0 bytes"),
        (MESSAGE.format(id=1 << 24, type="uint8_t"), "is not a number of 24 bits"),
        (MESSAGE.format(id="9" * 100_000, type="uint8_t"), "is not a number of 24 bits"),
        (MESSAGE.format(id="__import__('os')", type="uint8_t"), "is not a number of 24 bits"),
        (MESSAGE.format(id=1, type="colour"), "unknown type 'colour'"),
        (MESSAGE.format(id=1, type="\x9b2J"), r"unknown type '\x9b2J'"),
        (MESSAGE.format(id=1, type="uint8_t").replace('"A"', '"A&#10;B"'), r"'A\nB' is no name"),
        (MESSAGE.format(id=1, type="uint8_t").replace('"b"', '"\x9b2J"'), r"'\x9b2J' is no name"),
        (MESSAGE.format(id=1, type="uint8_t[0]"), "unknown type"),
        (MESSAGE.format(id=1, type="uint8_t[256]"), "an array of 256"),
        (MESSAGE.format(id=1, type="uint64_t[32]"), "A has 256 bytes"),
        ('<mavlink><enums><enum name="A"><entry value="1"/></enum></enums></mavlink>', "line 1: <entry> has no name"),
    ],
)
def test_what_is_no_definition_is_refused_in_one_line(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(text, encoding="utf-8")
    begin = time.process_time()
    with pytest.raises(DefinitionError) as caught:
        check_file(path)
    assert reason in str(caught.value)
    assert str(caught.value).startswith("bad.xml: ")
    assert "\n" not in str(caught.value)
    assert time.process_time() - begin < 5.0


def test_enum_values_are_never_evaluated(tmp_path: Path) -> None:
    path = tmp_path / "theirs.xml"
    trap = tmp_path / "trap"
    value = f"open({str(trap)!r}, 'w').close() or 1"
    path.write_text(OURS.replace('<entry value="1"', f'<entry value="{value}"', 1))
    (line,) = lines(path)
    assert line.startswith("changed None RIDLINK_SEPARATION_FLAGS_AVOIDING is \"open('")
    assert not trap.exists()


def test_includes_may_go_in_a_circle(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<mavlink><include>b.xml</include></mavlink>")
    (tmp_path / "b.xml").write_text("<mavlink><include>a.xml</include><include>ridlink.xml</include></mavlink>")
    write_together(tmp_path, definition_files())
    assert check_file(tmp_path / "a.xml") == ([], COUNT)


def test_a_chain_of_includes_ends(tmp_path: Path) -> None:
    for index in range(100):
        (tmp_path / f"{index}.xml").write_text(f"<mavlink><include>{index + 1}.xml</include></mavlink>")
    with pytest.raises(DefinitionError, match="more than 64 files"):
        check_file(tmp_path / "0.xml")


def test_deep_nesting_takes_no_time(tmp_path: Path) -> None:
    path = tmp_path / "deep.xml"
    path.write_text("<mavlink>" + "<a>" * 500_000 + "</a>" * 500_000 + "</mavlink>")
    begin = time.process_time()
    assert read_definitions(path) == Definitions()
    assert time.process_time() - begin < 5.0


def test_large_files_folders_and_devices_are_not_read(tmp_path: Path) -> None:
    with (tmp_path / "large.xml").open("wb") as stream:
        stream.truncate(20 * 1024 * 1024)
    with pytest.raises(DefinitionError, match="larger than 16 MiB"):
        check_file(tmp_path / "large.xml")
    with pytest.raises(DefinitionError, match="not a file"):
        check_file(Path("/dev/zero"))
    with pytest.raises(IsADirectoryError):
        check_file(tmp_path)
    with pytest.raises(FileNotFoundError):
        check_file(tmp_path / "gone.xml")


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, len(OURS) - 1), st.integers(0, 40), st.text(max_size=5))
def test_a_damaged_definition_gives_differences_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, at: int, cut: int, put: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.xml"
    path.write_text(OURS[:at] + put + OURS[at + cut :], encoding="utf-8")
    try:
        check_file(path)
    except DefinitionError as error:
        assert "\n" not in str(error)
