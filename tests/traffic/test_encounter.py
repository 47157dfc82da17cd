"""Closest approaches and entries into discs, against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.traffic.encounter import encounters

coordinate = st.floats(-300, 300)
speed = st.floats(-30, 30)


def one(r: tuple[float, float], w: tuple[float, float], radius: float) -> tuple[float, float, float, float]:
    found = encounters(np.array([r]), np.array([w]), np.array([radius]))
    return float(found.margin_m[0]), float(found.entry_s[0]), float(found.closest_s[0]), float(found.miss_m[0])


def test_head_on() -> None:
    assert one((100.0, 3.0), (-20.0, 0.0), 5.0) == pytest.approx((95.0449, 4.8, 5.0, 3.0), abs=1e-3)


def test_inside_departing_standing_and_passing() -> None:
    assert one((3.0, 0.0), (10.0, 0.0), 5.0) == pytest.approx((-2.0, 0.0, 0.0, 3.0))
    assert one((30.0, 0.0), (10.0, 0.0), 5.0) == (25.0, np.inf, 0.0, 30.0)
    assert one((30.0, 0.0), (0.0, 0.0), 5.0) == (25.0, np.inf, 0.0, 30.0)
    assert one((30.0, 8.0), (-10.0, 0.0), 5.0)[1:] == (np.inf, 3.0, 8.0)


def test_nobody() -> None:
    found = encounters(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    assert found.entry_s.shape == (0,)


@given(st.tuples(coordinate, coordinate), st.tuples(speed, speed), st.floats(1.0, 80.0))
def test_against_brute_force(r: tuple[float, float], w: tuple[float, float], radius: float) -> None:
    _, entry, closest, miss = one(r, w, radius)
    times = np.linspace(0.0, 60.0, 6001)
    distance = np.hypot(r[0] + w[0] * times, r[1] + w[1] * times)
    assert miss <= distance.min() + 1e-4  # who moves a micrometre per second stands
    inside = times[distance < radius - 0.5]
    if len(inside):
        assert entry <= inside[0] + 1e-6
    if entry <= 60.0 and entry > 0.0:
        assert np.hypot(r[0] + w[0] * entry, r[1] + w[1] * entry) == pytest.approx(radius, abs=1e-3)
    assert closest >= 0.0
