"""Files that appear when everything is in them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ridlink.files import LONGEST_PART, file_part, unfinished, write_together, write_whole
from tests.full_disk import files_below, largest_file

SLOW = """
import os, sys
from pathlib import Path
from ridlink.files import write_whole

def wait(_):
    print("written", flush=True)
    input()

os.fsync, forced = wait, os.fsync
write_whole(Path(sys.argv[1]), b"theirs")
"""


def test_two_that_write_one_file_are_not_in_each_others_way(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    slow = subprocess.Popen(
        [sys.executable, "-c", SLOW, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert slow.stdin is not None and slow.stdout is not None
    assert slow.stdout.readline() == "written\n"
    write_whole(path, b"ours")
    assert path.read_bytes() == b"ours"
    slow.communicate("\n\n", timeout=60)
    assert slow.returncode == 0
    assert path.read_bytes() == b"theirs" and list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_is_said_of_the_file_that_was_asked_for(tmp_path: Path) -> None:
    """Where nothing can be written nothing can be taken away, and that was what was said."""
    path = tmp_path / "report.json"
    unfinished(path).mkdir()
    with pytest.raises(IsADirectoryError) as refused:
        write_whole(path, b"")
    assert refused.value.filename == str(path)


@pytest.mark.parametrize("folder", ["there", "new/one"])
@pytest.mark.parametrize("too_large", [0, 1, 2])
def test_a_full_disk_gets_all_files_or_none(tmp_path: Path, folder: str, too_large: int) -> None:
    old = tmp_path / "there" / "a.h"
    write_together(old.parent, {"a.h": b"old"})
    files = {name: bytes(9000 if at == too_large else 9) for at, name in enumerate(("a.h", "deep/er/b.h", "c.h"))}
    with largest_file(1000), pytest.raises(OSError) as refused:
        write_together(tmp_path / folder, files)
    assert refused.value.filename == str(tmp_path / folder / [*files][too_large])
    assert [*tmp_path.iterdir()] == [old.parent] and [*old.parent.iterdir()] == [old] and old.read_bytes() == b"old"
    write_together(tmp_path / folder, files)
    written = {str(path.relative_to(tmp_path / folder)): path.read_bytes() for path in files_below(tmp_path / folder)}
    assert written == files


def test_a_folder_in_the_place_of_a_file_is_found_before_any_is_written(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    with pytest.raises(IsADirectoryError) as refused:
        write_together(tmp_path, {"a": b"", "b": b""})
    assert refused.value.filename == str(tmp_path / "b") and [*tmp_path.iterdir()] == [tmp_path / "b"]


def test_a_file_in_the_place_of_a_folder_leaves_no_other_folder(tmp_path: Path) -> None:
    (tmp_path / "b").touch()
    with pytest.raises(OSError) as refused:
        write_together(tmp_path, {"a/1": b"", "b/2": b"", "c/3": b""})
    assert refused.value.filename == str(tmp_path / "b") and [*tmp_path.iterdir()] == [tmp_path / "b"]


def test_any_text_may_be_part_of_a_file_name() -> None:
    assert file_part("circle8@80") == "circle8%4080" and file_part("../a b") == "..%2Fa%20b"
    long = ["x" * 300, "x" * 299, "\u98db" * 40, "\ud800" * 99]
    parts = [file_part(text) for text in long]
    assert len(set(parts)) == len(parts) and {len(part) for part in parts} == {LONGEST_PART}
    assert file_part("x" * LONGEST_PART) == "x" * LONGEST_PART
