"""``ridlink mqtt``: what it is given to read, and what it refuses before it speaks to anybody."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("broker", "option", "content", "code", "says"),
    [
        ("mqtt://127.0.0.1", "--password-file", None, 3, "No such file or directory"),
        ("mqtt://127.0.0.1", "--password-file", b"\xff", 2, "is not UTF-8 text"),
        ("mqtt://127.0.0.1", "--ca-file", b"", 2, "mqtt: does not encrypt"),
        ("mqtts://127.0.0.1", "--ca-file", None, 3, "no certificates: No such file or directory"),
        ("mqtts://127.0.0.1", "--ca-file", b"no certificate", 3, "no certificates: "),
    ],
)
def test_files_that_cannot_be_used(
    tmp_path: Path, broker: str, option: str, content: bytes | None, code: int, says: str
) -> None:
    path = tmp_path / "file"
    if content is not None:
        path.write_bytes(content)
        path.chmod(0o600)
    command = [sys.executable, "-m", "ridlink", "mqtt", "--broker", broker, option, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (code, "") and says in line
