"""Bindings in other languages: they are made, they are complete, and they are written whole or not at all."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import stat
import subprocess
from pathlib import Path
from typing import Any

import pytest
from lxml import etree
from pymavlink.generator import mavgen

from message_spec.generate import (
    DIALECT_XML,
    GenerationError,
    definition_files,
    generate,
    render,
    write_file,
)
from ridlink.files import write_together
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder


def load(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class TestBindings:
    def test_python_is_one_importable_file(self, tmp_path: Path) -> None:
        generate("python", tmp_path / "my_dialect.py")
        module = load(tmp_path / "my_dialect.py")
        assert module.DIALECT == "my_dialect"
        (message,) = module.MAVLink(None).parse_buffer(Encoder(1, 1).encode("RIDLINK_SEPARATION", horizontal_error=7))
        assert message.horizontal_error == 7
        assert "ridlink.mavlink" not in (tmp_path / "my_dialect.py").read_text()

    def test_lua_knows_our_messages(self) -> None:
        (content,) = render("lua").values()
        assert b"RIDLINK_SEPARATION" in content

    def test_typescript_has_a_class_for_each_message(self) -> None:
        files = render("typescript")
        assert b"horizontal_error" in files["messages/ridlink-separation.ts"]
        assert b"[61400, RidlinkSeparation]" in files["message-registry.ts"]
        assert len([name for name in files if name.startswith("messages/")]) >= 200

    @pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
    def test_c_headers_compile_and_read_our_frames(self, tmp_path: Path) -> None:
        write_together(tmp_path, render("c"))
        frame = Encoder(3, 1).encode(
            "RIDLINK_SEPARATION", timestamp=2.5, horizontal_error=1050, commanded_vx=-300, flags=9
        )
        (tmp_path / "main.c").write_text(
            '#include <stdio.h>\n#include "ridlink/mavlink.h"\n'
            f"static const uint8_t frame[] = {{{', '.join(map(str, frame))}}};\n"
            "int main(void) {\n"
            "  mavlink_message_t message; mavlink_status_t status; mavlink_ridlink_separation_t fields;\n"
            "  for (unsigned i = 0; i < sizeof frame; i++)\n"
            "    if (mavlink_parse_char(MAVLINK_COMM_0, frame[i], &message, &status)) {\n"
            "      mavlink_msg_ridlink_separation_decode(&message, &fields);\n"
            '      printf("%u %d %.1f %u %d %u", (unsigned)message.msgid, message.sysid, fields.timestamp,\n'
            "             fields.horizontal_error, fields.commanded_vx, fields.flags);\n"
            "    }\n"
            "  return 0;\n}\n"
        )
        program = tmp_path / "main"
        subprocess.run(
            ["cc", "-w", "-I", str(tmp_path), "-o", str(program), str(tmp_path / "main.c")], check=True, timeout=60
        )
        assert subprocess.check_output([program], text=True, timeout=10) == "61400 3 2.5 1050 -300 9"

    def test_xml_with_its_includes_suits_plain_mavgen(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        write_together(tmp_path, definition_files())
        options = mavgen.Opts(str(tmp_path / "out.py"), wire_protocol="2.0", language="Python3", validate=True)
        assert mavgen.mavgen(options, [str(tmp_path / "ridlink.xml")])
        capsys.readouterr()
        assert load(tmp_path / "out.py").mavlink_map[61400].crc_extra == CRC_EXTRAS[61400]

    def test_units_are_those_that_the_schema_knows(self) -> None:
        schema = (Path(mavgen.__file__).parent / "mavschema.xsd").read_text()
        known = set(re.findall(r'<xs:enumeration value="([^"]+)"', schema))
        assert set(etree.parse(str(DIALECT_XML)).xpath("//field/@units")) <= known

    def test_nothing_is_printed(self, capfd: pytest.CaptureFixture[str]) -> None:
        render("lua")
        assert capfd.readouterr() == ("", "")


class TestRefusals:
    def test_unknown_language(self) -> None:
        with pytest.raises(GenerationError, match="'cobol'; known: python, c, lua, typescript"):
            render("cobol")

    @pytest.mark.parametrize("language", ["c", "typescript", "cobol"])
    def test_a_language_of_many_files_or_none_is_not_written_to_one(self, tmp_path: Path, language: str) -> None:
        with pytest.raises(GenerationError, match=f"'{language}'; known: python, lua$"):
            generate(language, tmp_path / "x")
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize(
        "text",
        [
            "<mavlink><messages><message",
            "<mavlink></nothing>",
            "<mavlink><include>gone.xml</include></mavlink>",
            DIALECT_XML.read_text().replace('type="float"', 'type="colour"'),
        ],
    )
    def test_a_definition_that_mavgen_refuses(self, tmp_path: Path, text: str) -> None:
        (tmp_path / "bad.xml").write_text(text)
        with pytest.raises(GenerationError):
            generate("python", tmp_path / "out.py", tmp_path / "bad.xml")
        assert not (tmp_path / "out.py").exists()


class TestWriting:
    def test_replaces_whole_and_leaves_nothing_beside(self, tmp_path: Path) -> None:
        target = tmp_path / "a.py"
        target.write_bytes(b"old")
        target.chmod(0o640)
        write_file(target, b"new")
        assert target.read_bytes() == b"new"
        assert stat.S_IMODE(target.stat().st_mode) == 0o640
        assert [path.name for path in tmp_path.iterdir()] == ["a.py"]

    def test_a_new_file_has_the_usual_mode(self, tmp_path: Path) -> None:
        (tmp_path / "usual").touch()
        write_file(tmp_path / "a.py", b"")
        assert (tmp_path / "a.py").stat().st_mode == (tmp_path / "usual").stat().st_mode

    def test_a_link_stays_a_link(self, tmp_path: Path) -> None:
        (tmp_path / "real").write_bytes(b"old")
        (tmp_path / "link").symlink_to("real")
        write_file(tmp_path / "link", b"new")
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "real").read_bytes() == b"new"

    def test_a_device_stays_a_device(self) -> None:
        write_file(Path("/dev/null"), b"new")
        assert stat.S_ISCHR(os.stat("/dev/null").st_mode)

    @pytest.mark.parametrize("name", ["missing/a.py", "file/a.py", "folder"])
    def test_names_the_path_that_cannot_be_written(self, tmp_path: Path, name: str) -> None:
        (tmp_path / "file").touch()
        (tmp_path / "folder").mkdir()
        before = sorted(path.name for path in tmp_path.iterdir())
        with pytest.raises(OSError) as caught:
            write_file(tmp_path / name, b"new")
        assert caught.value.filename == str(tmp_path / name)
        assert sorted(path.name for path in tmp_path.iterdir()) == before
