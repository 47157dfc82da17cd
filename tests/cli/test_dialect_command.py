"""``ridlink dialect``: forms on standard output and in files, and the verdict of ``check``."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from message_spec import generate
from message_spec.generate import DIALECT_XML, definition_files, render
from ridlink.cli import cli
from ridlink.errors import ConfigError
from tests.full_disk import largest_file


def invoke(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["dialect", *map(str, arguments)])


class TestForms:
    def test_xml_to_standard_output(self) -> None:
        result = invoke("xml")
        assert result.exit_code == 0
        assert result.stdout_bytes == DIALECT_XML.read_bytes()

    def test_a_dash_is_standard_output(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        assert invoke("xml", "-o", "-").stdout_bytes == DIALECT_XML.read_bytes()
        assert list(tmp_path.iterdir()) == []

    def test_xml_to_a_file(self, tmp_path: Path) -> None:
        assert invoke("xml", "-o", tmp_path / "mine.xml").exit_code == 0
        assert (tmp_path / "mine.xml").read_bytes() == DIALECT_XML.read_bytes()
        assert len(list(tmp_path.iterdir())) == 1

    @pytest.mark.parametrize("folder", [".", "new/folder"])
    def test_xml_to_a_folder_brings_what_it_includes(self, tmp_path: Path, folder: str) -> None:
        assert invoke("xml", "-o", tmp_path / folder).exit_code == 0
        assert {path.name: path.read_bytes() for path in (tmp_path / folder).iterdir()} == definition_files()

    @pytest.mark.parametrize(("form", "suffix"), [("python", ".py"), ("lua", ".lua")])
    def test_one_file_bindings(self, tmp_path: Path, form: str, suffix: str) -> None:
        printed = invoke(form)
        assert printed.exit_code == 0
        assert b"RIDLINK_SEPARATION" in printed.stdout_bytes
        assert invoke(form, "-o", tmp_path).exit_code == 0
        assert invoke(form, "-o", tmp_path / "other.txt").exit_code == 0
        assert (tmp_path / f"ridlink{suffix}").read_bytes() == printed.stdout_bytes
        assert sorted(path.name for path in tmp_path.iterdir()) == ["other.txt", f"ridlink{suffix}"]

    @pytest.mark.parametrize("name", [b"\xff.py", b'a".py'])
    def test_a_file_name_that_is_no_python_text_names_no_dialect(self, tmp_path: Path, name: bytes) -> None:
        path = tmp_path / os.fsdecode(name)
        assert invoke("python", "-o", path).exit_code == 0
        names: dict[str, object] = {"__name__": "ridlink_dialect"}
        exec(compile(path.read_bytes(), "ridlink.py", "exec"), names)
        assert names["DIALECT"] == "ridlink"

    def test_printed_python_runs(self) -> None:
        names: dict[str, object] = {"__name__": "ridlink_dialect"}
        exec(compile(invoke("python").stdout, "ridlink.py", "exec"), names)
        assert names["DIALECT"] == "ridlink"
        assert "MAVLink_ridlink_separation_message" in names

    @pytest.mark.parametrize(("form", "file"), [("c", "ridlink/mavlink.h"), ("typescript", "message-registry.ts")])
    def test_bindings_of_many_files(self, tmp_path: Path, form: str, file: str) -> None:
        without = invoke(form)
        assert without.exit_code == 2
        assert f"{form} makes many files: name a folder with -o FOLDER" in without.stderr
        assert invoke(form, "-o", tmp_path / "new" / "folder").exit_code == 0
        assert (tmp_path / "new" / "folder" / file).is_file()

    @pytest.mark.parametrize("form", ["xml", "c", "typescript"])
    def test_a_full_disk_gets_no_part_of_a_folder(
        self, tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        rendered = {} if form == "xml" else render(form)  # before, since mavgen writes files of its own
        monkeypatch.setattr(generate, "render", lambda *_: rendered)
        with largest_file(20_000):
            result = invoke(form, "-o", tmp_path / "new" / "folder")
        assert isinstance(result.exception, OSError) and not any(tmp_path.iterdir())

    @pytest.mark.parametrize("form", ["xml", "python", "lua", "c", "typescript"])
    def test_a_path_that_cannot_be_written(self, tmp_path: Path, form: str) -> None:
        (tmp_path / "file").touch()
        result = invoke(form, "-o", tmp_path / "file" / "below")
        assert isinstance(result.exception, OSError), "main() turns it into one line and exit code 3"
        assert [path.name for path in tmp_path.iterdir()] == ["file"]

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
    def test_a_folder_without_permission(self, tmp_path: Path) -> None:
        tmp_path.chmod(0o500)
        assert isinstance(invoke("xml", "-o", tmp_path / "a.xml").exception, PermissionError)


class TestCheck:
    def test_ours_is_compatible(self) -> None:
        result = invoke("check", DIALECT_XML)
        assert result.exit_code == 0
        assert result.stdout.startswith("compatible: ")

    def test_upstream_lacks_ours(self, tmp_path: Path) -> None:
        invoke("xml", "-o", tmp_path)
        result = invoke("check", tmp_path / "common.xml")
        assert result.exit_code == 1
        assert result.stdout.splitlines() == [
            "missing      61400 RIDLINK_SEPARATION of ridlink.xml",
            "missing      61401 RIDLINK_STATUS of ridlink.xml",
            "not compatible: 2 missing",
        ]
        assert invoke("check", "--allow-missing", tmp_path / "common.xml").exit_code == 0

    def test_differences_are_named(self, tmp_path: Path) -> None:
        path = tmp_path / "theirs.xml"
        path.write_text(DIALECT_XML.read_text().replace('name="airframe_size"', 'name="size"'))
        result = invoke("check", path)
        assert result.exit_code == 1
        assert result.stdout.startswith("changed      61400 RIDLINK_SEPARATION: CRC_EXTRA ")
        assert result.stdout.endswith("\nnot compatible: 1 changed\n")

    def test_a_message_of_id_0_is_named_by_its_id(self, tmp_path: Path) -> None:
        invoke("xml", "-o", tmp_path)
        path = tmp_path / "minimal.xml"
        path.write_text(path.read_text().replace('name="system_status"', 'name="status"'))
        result = invoke("check", tmp_path / "ridlink.xml")
        assert result.exit_code == 1 and result.stdout.startswith("changed          0 HEARTBEAT: CRC_EXTRA ")

    def test_malformed_xml(self, tmp_path: Path) -> None:
        path = tmp_path / "theirs.xml"
        path.write_text("<mavlink>")
        error = invoke("check", path).exception
        assert isinstance(error, ConfigError), "main() turns it into one line and exit code 2"
        assert str(error).startswith("theirs.xml: no element found")

    def test_a_file_that_is_not_there(self, tmp_path: Path) -> None:
        assert isinstance(invoke("check", tmp_path / "gone.xml").exception, FileNotFoundError)
