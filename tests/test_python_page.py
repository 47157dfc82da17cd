"""docs/python.md is one program, which prints what stands there; and the package says which version it is."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import ridlink

TEXT = (Path(__file__).resolve().parents[1] / "docs" / "python.md").read_text()


def test_the_page_runs_from_top_to_bottom_and_prints_what_stands_there(tmp_path: Path) -> None:
    program = "\n".join(line[4:] for line in TEXT.splitlines() if line.startswith("    ") or not line)
    shown = re.findall(r"^#> (.*)$", program, re.MULTILINE)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == shown and len(shown) > 15


def test_the_package_says_its_version() -> None:
    assert ridlink.__version__ == version("ridlink")
