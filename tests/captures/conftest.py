"""A small flight to write, damage and read back."""

from __future__ import annotations

import pytest
from numba import config

from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import BasicId, Location, RemoteIdMessage, Separation, System

needs_compiler = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="without compiled kernels this takes too long")

START_US = 1_700_000_000_123_456


def flight(count: int) -> list[tuple[int, bytes]]:
    """Times and frames of one vehicle: HEARTBEAT, LOCATION and RIDLINK_SEPARATION in turn."""
    encoder = Encoder(1, 1)
    records: list[tuple[int, bytes]] = []
    for index in range(count):
        second = float(index % 3600)
        if index % 3 == 0:
            frame = encoder.encode("HEARTBEAT", type=2, autopilot=12, mavlink_version=3)
        else:
            name, fields = to_mavlink(
                Location(latitude_deg=47.4, longitude_deg=8.5 + index * 1e-6, timestamp_s=second)
                if index % 3 == 1
                else Separation(timestamp_s=second, horizontal_error_m=3.0)
            )
            frame = encoder.encode(name, **fields)
        records.append((START_US + index * 33_333, frame))
    return records


def tlog_bytes(records: list[tuple[int, bytes]]) -> bytes:
    """A tlog of these records."""
    return b"".join(time_us.to_bytes(8, "big") + frame for time_us, frame in records)


def raw_bytes(records: list[tuple[int, bytes]]) -> bytes:
    """A raw stream of these records."""
    return b"".join(frame for _, frame in records)


@pytest.fixture(scope="session")
def thousand() -> list[tuple[int, bytes]]:
    """A thousand records."""
    return flight(1000)


Records = list[tuple[int, bytes]]


def frame_of(message: RemoteIdMessage, encoder: Encoder) -> bytes:
    name, fields = to_mavlink(message)
    return encoder.encode(name, **fields)


def aircraft(seconds: int = 6, sysid: int = 1, uas_id: bytes = b"ABC123") -> Records:
    """One aircraft with everything that is joined, at 1 Hz."""
    encoder = Encoder(sysid, 1)
    records: Records = []
    for second in range(seconds):
        at_us = START_US + second * 1_000_000
        location = Location(
            latitude_deg=47.0 + second * 1e-4, longitude_deg=8.0, altitude_geodetic_m=500.5, timestamp_s=float(second),
            speed_horizontal_mps=10.0, direction_deg=0.0, speed_vertical_mps=1.0,
        )  # fmt: skip
        messages: list[RemoteIdMessage] = [
            BasicId(1, 2, uas_id),
            location,
            Separation(timestamp_s=float(second), horizontal_error_m=3.0),
            System(operator_latitude_deg=46.5, operator_longitude_deg=7.5),
        ]
        records += [(at_us + 1000 * place, frame_of(message, encoder)) for place, message in enumerate(messages)]
    return records
