"""Discs of pairs, and rings whose touching is a pair at its distance."""

from __future__ import annotations

import numpy as np
import pytest

from ridlink.observer import rings
from ridlink.separation.definitions import Definition
from tests.observer.flights import Flyer, all_discs, seen

FLYERS = [
    Flyer(1, (0.0, 0.0), (10.0, 0.0), airframe_m=0.6, error_m=6.0),
    Flyer(2, (300.0, 0.0), (0.0, 5.0), airframe_m=2.0, error_m=20.0),
    Flyer(3, (0.0, 300.0), (0.0, 0.0), extended=False),
]
ADDITIVE = [definition for definition in Definition if definition is not Definition.CHANCE]


@pytest.mark.parametrize("definition", list(Definition))
def test_discs_are_those_of_the_definition_whoever_looks(definition: Definition) -> None:
    radius = all_discs(seen(FLYERS, 2.0).at(2.0), definition)
    assert radius == pytest.approx(radius.T)
    assert np.isfinite(radius).all() and (radius >= 0.6).all()
    if definition is Definition.CANDIDATE2:
        assert radius[0, 1] == pytest.approx((0.6 + 2.0) / 2 + 6.0 + 20.0 + 0.1 * 15.0, abs=0.05)
        assert radius[0, 2] == pytest.approx((0.6 + 7.5) / 2 + 6.0 + 40.0 + 0.1 * 10.0, abs=0.05)


@pytest.mark.parametrize("definition", ADDITIVE)
def test_where_outer_rings_touch_the_pair_is_at_its_distance(definition: Definition) -> None:
    scene = seen(FLYERS, 2.0).at(2.0)
    radius, outer = all_discs(scene, definition), rings(scene, definition)[:, 2]
    for i in range(3):
        for j in range(i):
            assert outer[i] + outer[j] == pytest.approx(radius[i, j], abs=0.06)


@pytest.mark.parametrize("definition", list(Definition))
def test_rings_lie_in_each_other(definition: Definition) -> None:
    ring = rings(seen(FLYERS, 2.0).at(2.0), definition)
    assert ring.shape == (3, 3)
    assert (np.diff(ring, axis=1) >= 0.0).all()
