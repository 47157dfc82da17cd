"""Flights as files."""

from __future__ import annotations

import functools
from pathlib import Path

from tests.captures.conftest import START_US, tlog_bytes
from tests.observer.flights import Flyer, frames

NORTHBOUND = Flyer(1, (-200.0, 0.0), (10.0, 0.0), b"ALPHA")
SOUTHBOUND = Flyer(2, (200.0, 6.0), (-10.0, 0.0), b"BRAVO")
START_S = START_US / 1e6


@functools.lru_cache(maxsize=8)
def _flown(flyers: tuple[Flyer, ...], until_s: float) -> list[tuple[int, bytes]]:
    return [(round(time_s * 1e6), frame.raw) for time_s, frame in frames(list(flyers), until_s)]


def records(flyers: list[Flyer], until_s: float, *, from_us: int = START_US) -> list[tuple[int, bytes]]:
    """Times and frames of a flight."""
    return [(from_us + since_us, frame) for since_us, frame in _flown(tuple(flyers), until_s)]


def recorded(path: Path, flyers: list[Flyer], until_s: float, *, from_us: int = START_US) -> Path:
    """A tlog of a flight."""
    path.write_bytes(tlog_bytes(records(flyers, until_s, from_us=from_us)))
    return path
