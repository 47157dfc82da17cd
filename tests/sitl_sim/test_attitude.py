"""A multirotor leans as it accelerates: its rotors push along the one axis that they have."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_sim.autopilot.attitude import attitude_rad, quaternion
from sitl_sim.vehicle import GRAVITY_MPS2

accelerations = st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0), st.floats(-4.0, 4.0))


def test_at_rest_it_is_level() -> None:
    assert attitude_rad((0.0, 0.0, 0.0), 1.0) == (0.0, 0.0, 1.0)
    assert quaternion(0.0, 0.0, 0.0) == (1.0, 0.0, 0.0, 0.0)
    assert quaternion(0.0, 0.0, math.pi) == pytest.approx((0.0, 0.0, 0.0, 1.0))


@given(accelerations, st.floats(-math.pi, math.pi))
def test_the_rotors_push_where_the_acceleration_and_gravity_need_it(
    acceleration_ned_mps2: tuple[float, float, float], yaw_rad: float
) -> None:
    w, x, y, z = quaternion(*attitude_rad(acceleration_ned_mps2, yaw_rad))
    assert math.hypot(w, x, y, z) == pytest.approx(1.0)
    up_ned = np.array([-2.0 * (x * z + w * y), -2.0 * (y * z - w * x), -(1.0 - 2.0 * (x * x + y * y))])
    north, east, down = acceleration_ned_mps2
    thrust_ned = np.array([north, east, down - GRAVITY_MPS2])
    assert up_ned == pytest.approx(thrust_ned / np.linalg.norm(thrust_ned), abs=1e-9)
