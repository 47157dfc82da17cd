"""A copy of the project to break: nothing is touched here, and no bytecode of a broken file survives."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import QUICK

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("ridlink", "sitl_sim", "message_spec", "tests", "docs")
LONGEST_S = 240.0
PASSED, FAILED = 0, 1
"""What pytest ends with; anything else says that it could not even begin."""


@dataclass(frozen=True)
class Outcome:
    """What tests came to.

    Attributes:
        code: Exit code of pytest; None where it had to be killed.
        text: What it said.
    """

    code: int | None
    text: str

    @property
    def first_failure(self) -> str:
        """Why the first test failed, in a line of pytest's; empty where none did."""
        for line in self.text.splitlines():
            if line.startswith("FAILED ") and " - " in line:
                return line.partition(" - ")[2]
        return ""


@contextmanager
def copy_of_project() -> Iterator[Path]:
    """A folder with everything that tests need."""
    with tempfile.TemporaryDirectory(prefix="ridlink-copy-") as folder:
        where = Path(folder)
        for part in PARTS:
            shutil.copytree(ROOT / part, where / part)
        for name in ("pyproject.toml", "README.md", "Makefile"):
            shutil.copy2(ROOT / name, where)
        yield where


@contextmanager
def changed(path: Path, text: str) -> Iterator[None]:
    """A file with another text for a while."""
    before = path.read_text()
    path.write_text(text)
    try:
        yield
    finally:
        path.write_text(before)


def run_tests(where: Path, *arguments: str) -> Outcome:
    """Run tests of a copy.

    Args:
        where: The copy.
        arguments: Of pytest.
    """
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *arguments]
    # Unbroken modules have their bytecode from the original; what is broken is compiled anew every time.
    environment = {**os.environ, "PYTHONPATH": str(where), "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "200", QUICK: "1"}
    try:
        done = subprocess.run(command, cwd=where, env=environment, capture_output=True, text=True, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        return Outcome(None, "")
    return Outcome(done.returncode, done.stdout + done.stderr)
