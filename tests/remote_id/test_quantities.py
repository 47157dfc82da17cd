"""What both wires of Remote ID write alike: positions and lengths, to the ends of their ranges."""

from __future__ import annotations

import math
from collections import Counter
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.remote_id.quantities import (
    EPOCH_2019_S,
    MAX_UINT8,
    MAX_UINT16,
    read_position,
    read_seconds_since_2019,
    write_error,
    write_position,
    write_seconds_since_2019,
    write_up,
)


@pytest.mark.parametrize(("latitude", "longitude"), [(1, 0), (0, 1), (900_000_000, 1_800_000_000)])
def test_positions_reach_to_the_poles_and_the_antimeridian(latitude: int, longitude: int) -> None:
    for sign in (1, -1):
        rejects: Counter[str] = Counter()
        assert read_position(sign * latitude, sign * longitude, ("lat", "lon"), rejects) == (
            pytest.approx(sign * latitude / 1e7), pytest.approx(sign * longitude / 1e7),
        )  # fmt: skip
        assert not rejects
        over = read_position(sign * 900_000_001, sign * 1_800_000_001, ("lat", "lon"), rejects)
        assert over == (None, None) and rejects == {"lat": 1, "lon": 1}
        assert write_position(sign * latitude / 1e7, sign * longitude / 1e7) == (sign * latitude, sign * longitude)
    assert write_position(90.1, 0.0) == write_position(0.0, 180.1) == write_position(-90.1, -180.1) == (0, 0)
    assert write_position(None, 8.0) == write_position(47.0, None) == (0, 0)


@given(
    st.floats(min_value=0.0, max_value=1e6),
    st.sampled_from([(0.01, MAX_UINT16), (0.001, MAX_UINT16), (0.5, MAX_UINT8), (0.1, MAX_UINT8), (0.02, MAX_UINT8)]),
)
def test_an_extent_rounds_up_in_every_unit_and_saturates(value: float, unit_and_limit: tuple[float, int]) -> None:
    unit, limit = unit_and_limit
    units = write_up(value, unit, limit)
    assert units == limit or value - 1e-6 * unit <= units * unit <= value + unit + 1e-9
    assert write_error(value, unit, limit) == (units or 1), "0 would say unknown"
    assert write_up(None, unit, limit) == write_error(None, unit, limit) == 0


@pytest.mark.parametrize(
    ("value", "unit", "limit", "units"),
    [(655.34, 0.01, MAX_UINT16, 65534), (655.36, 0.01, MAX_UINT16, 65535), (700.0, 0.01, MAX_UINT16, 65535),
     (25.4, 0.1, MAX_UINT8, 254), (26.0, 0.1, MAX_UINT8, 255), (200.0, 0.5, MAX_UINT8, 255)],
)  # fmt: skip
def test_what_is_too_large_is_the_largest_figure(value: float, unit: float, limit: int, units: int) -> None:
    assert write_up(value, unit, limit) == write_error(value, unit, limit) == units


def test_absolute_times_count_from_the_beginning_of_2019() -> None:
    assert datetime.fromtimestamp(EPOCH_2019_S, UTC) == datetime(2019, 1, 1, tzinfo=UTC)


@pytest.mark.parametrize(
    ("seconds", "wire"), [(-5.0, 0), (0.0, 0), (1.0, 1), (1e12, 2**32 - 1), (math.inf, 0), (math.nan, 0), (None, 0)]
)
def test_seconds_since_2019_stay_within_their_field(seconds: float | None, wire: int) -> None:
    assert write_seconds_since_2019(seconds) == wire
    assert read_seconds_since_2019(wire) == (wire or None)
