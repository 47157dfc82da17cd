"""No kernel takes memory while it decides: everything it needs was there before."""

from __future__ import annotations

import os

import numpy as np
import pytest

from ridlink.avoidance import GradedSettings, HalfplaneSettings, Obstacles, OwnShip, RotationSettings, Traffic, rows
from ridlink.avoidance.solver import new_solver
from ridlink.campaign.deciding import new_decider

pytestmark = pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="plain Python allocates")

SETTINGS = (HalfplaneSettings(acceleration_mps2=20.0, contact_step_s=0.1), GradedSettings(), RotationSettings())
SQUARE = Obstacles.from_polygons([[[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]])


def taken() -> int:
    """Pieces of memory that compiled code has taken so far."""
    from numba.core.runtime import rtsys

    return int(rtsys.get_allocation_stats().alloc)


@pytest.fixture(autouse=True, scope="module")
def counted():
    from numba import njit
    from numba.core.runtime import _nrt_python

    _nrt_python.memsys_enable_stats()
    before = taken()
    njit(lambda: np.zeros(100).sum())()
    assert taken() == before + 1, "what a kernel takes is counted"
    yield
    _nrt_python.memsys_disable_stats()


@pytest.mark.parametrize("settings", SETTINGS, ids=["halfplane", "graded", "rotation"])
@pytest.mark.parametrize("error_m", [0.0, 21.0])
def test_a_decision_of_one_own_ship_takes_none(settings, error_m):
    random, count = np.random.default_rng(3), 23
    name = type(settings).__name__.removesuffix("Settings").lower()
    solver = new_solver(name, settings)
    before = None
    for _ in range(50):
        place, velocity = random.uniform(-150.0, 150.0, (count, 2)), random.uniform(-9.0, 9.0, (count, 2))
        others = Traffic(
            place, velocity, velocity, np.zeros(count), np.full(count, 24.0), np.full(count, error_m),
            np.ones(count, np.bool_), np.zeros(count, np.int8),
        )  # fmt: skip
        own = OwnShip(random.uniform(-60.0, 60.0, 2), np.zeros(2), np.zeros(2), 1.0, 10.0)
        solver.solve(own, others, goal_ne_m=(300.0, 0.0), cruise_mps=10.0, obstacles=SQUARE, own_clearance_m=5.0)
        before = taken() if before is None else before
    assert taken() == before


@pytest.mark.parametrize("settings", SETTINGS, ids=["halfplane", "graded", "rotation"])
@pytest.mark.parametrize("vehicles", [7, 70])
def test_a_step_of_many_worlds_takes_none(settings, vehicles):
    random, shape = np.random.default_rng(4), (3, vehicles)
    decider = new_decider(settings, shape, SQUARE)
    own, heard = np.zeros((*shape, rows.OWN_COLUMNS)), np.ones((*shape, 8))
    everybody, pairs = np.ones(shape, np.bool_), (*shape, vehicles)
    own[..., rows.LIMIT] = own[..., rows.CRUISE] = 9.0
    before = None
    for _ in range(5):
        own[..., :8] = heard[..., :6].take([0, 1, 2, 3, 4, 5, 0, 1], axis=-1)
        heard[..., :2], heard[..., 2:6] = random.uniform(-90.0, 90.0, (*shape, 2)), random.uniform(-9, 9, (*shape, 4))
        decider.decide(own, everybody, heard, everybody, np.full(pairs, 15.0), np.full(pairs, 5.0), 200.0)
        before = taken() if before is None else before
    assert taken() == before
