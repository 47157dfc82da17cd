"""Scenarios in files."""

from __future__ import annotations

from pathlib import Path

ALONE = """
name = "alone"
duration_s = 20.0
[[vehicle]]
start_ned_m = [0.0, 0.0, -50.0]
goal_ned_m = [30.0, 0.0, -50.0]
speed_mps = 20.0
"""


def scenario(folder: Path, text: str) -> str:
    path = folder / "scenario.toml"
    path.write_text(text)
    return str(path)
