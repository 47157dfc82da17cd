"""F11: escalate fast, recover slowly."""

from __future__ import annotations

import pytest

from ridlink.engine.recovery import Recovery
from ridlink.setpoint import Velocity


def test_f11_a_conflict_counts_for_two_seconds_after_it_has_gone() -> None:
    recovery = Recovery()
    assert not recovery.recovering(0.0)
    recovery.conflict(10.0)
    assert recovery.recovering(10.0) and recovery.recovering(11.9)
    assert not recovery.recovering(12.0)


@pytest.mark.parametrize(
    ("wanted", "last", "flown"),
    [
        ((10.0, 0.0, 0.5), (0.0, 0.0, 0.0), (0.25, 0.0, 0.5)),
        ((0.0, 10.0, 0.0), (10.0, 0.0, 0.0), (9.823, 0.177, 0.0)),
        ((0.2, 0.0, 0.0), (0.0, 0.0, 0.0), (0.2, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((5.0, 0.0, 0.0), (10.0, 0.0, 0.0), (5.0, 0.0, 0.0)),
        ((5.1, 5.1, 0.0), (5.0, 5.0, 0.0), (5.1, 5.1, 0.0)),  # near what is flown already
        ((8.0, 6.0, 0.0), (5.0, 2.0, 0.0), (5.15, 2.2, 0.0)),  # straight towards it
        ((3.0, 0.0, 5.0), (4.0, 0.0, 0.0), (3.0, 0.0, 5.0)),  # only the horizontal speed counts
        ((5.0, 0.0, 0.0), (4.0, 0.0, 9.0), (4.25, 0.0, 0.0)),
    ],
)
def test_f11_the_way_back_takes_half_of_the_acceleration_and_braking_is_free(
    wanted: Velocity, last: Velocity, flown: Velocity
) -> None:
    assert Recovery().slowed(wanted, last, step_s=0.1, acceleration_mps2=5.0) == pytest.approx(flown, abs=1e-3)
