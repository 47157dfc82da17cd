"""The whole program in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

ANY_PORT = ["--vehicle-port", "0", "--companion-port", "0", "--air-port", "0"]
"""Options of ``ridlink sim``."""


def ridlink(*arguments: str | Path, **options: Any) -> subprocess.CompletedProcess[bytes]:
    """Run it until it ends."""
    command = [sys.executable, "-m", "ridlink", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, timeout=60, **options)
