"""What both wires of Remote ID write alike: positions and lengths, to the ends of their ranges."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.remote_id.quantities import MAX_UINT8, MAX_UINT16, read_position, write_error, write_position, write_up


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
