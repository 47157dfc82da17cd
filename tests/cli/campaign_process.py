"""``ridlink campaign run`` as a process of its own, and what it leaves in its folder."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

STARTED: list[subprocess.Popen[str]] = []
"""Whatever is still among them after a test is ended, also where the test failed: see `conftest`."""


def start(*arguments: object, file_bytes: int | None = None, group: bool = False) -> subprocess.Popen[str]:
    """A campaign; `file_bytes` is the largest file that it may write; `group`, as a terminal has it, for signals to all
    of its processes."""

    def limit() -> None:
        if file_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))

    process = subprocess.Popen(
        [sys.executable, "-m", "ridlink", "campaign", "run", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=limit, start_new_session=group,
    )  # fmt: skip
    STARTED.append(process)
    return process


def shards(folder: Path) -> list[Path]:
    return sorted((folder / "shards").rglob("*.parquet"))


def await_shards(process: subprocess.Popen[str], folder: Path, more_than: int) -> None:
    while len(shards(folder)) <= more_than:
        try:
            process.wait(0.01)
        except subprocess.TimeoutExpired:
            continue
        raise AssertionError(f"ended before that: {process.communicate()}")


def rows_of(folder: Path) -> object:
    return json.loads((folder / "rows.json").read_text())
