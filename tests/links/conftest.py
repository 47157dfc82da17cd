"""A signing key in a file of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

KEY = bytes(range(32))


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    return path
