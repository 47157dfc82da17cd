"""What holds to the last digit where vehicles obey at once and know where they are: no step leads into a disc."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import Obstacles, OwnShip, Traffic, rows
from ridlink.avoidance.solver import HalfplaneSolver
from ridlink.campaign.deciding import new_decider
from ridlink.campaign.plan import IDEAL_HALFPLANES
from tests.avoidance.exact import EVERYWHERE_M
from tests.avoidance.study_rvo2 import BLOCKS_DISC_M, CIRCLE_DISC_M, blocks, circle

NOTHING = Obstacles.from_polygons(())
ROUNDING_M = 1e-6
STEP_S = IDEAL_HALFPLANES.contact_step_s


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), vehicles=st.integers(2, 20), extent_m=st.sampled_from([5.0, 30.0, 100.0]),
    walled=st.booleans(),
)  # fmt: skip
def test_no_step_leads_into_a_disc_nor_further_into_one(seed, vehicles, extent_m, walled):
    """Whatever they flew and wanted before, packed as tightly as may be, in overlaps and between walls."""
    random = np.random.default_rng(seed)
    shape = (1, vehicles)
    position, velocity = random.uniform(-extent_m, extent_m, (vehicles, 2)), random.uniform(-7.0, 7.0, (vehicles, 2))
    radius = np.full((1, vehicles, vehicles), random.uniform(1.0, 30.0))
    own, heard = np.zeros((*shape, rows.OWN_COLUMNS)), np.zeros((*shape, 8))
    own[0, :, 0:2], own[0, :, 2:4], own[0, :, 4:6] = position, velocity, velocity
    own[0, :, 6:8] = random.uniform(-300.0, 300.0, (vehicles, 2))
    own[..., rows.LIMIT] = own[..., rows.CRUISE] = random.uniform(5.0, 10.0, vehicles)
    own[..., rows.CLEARANCE] = 2.0
    heard[0, :, 0:2], heard[0, :, 2:4], heard[0, :, 4:6] = position, velocity, velocity
    heard[..., 7] = 1.0
    # The vehicles are between two walls 12 m away, or there are none.
    away, wall = np.array([extent_m, 0.0]), np.array([[12.0, -200.0], [20.0, -200.0], [20.0, 200.0], [12.0, 200.0]])
    obstacles = Obstacles.from_polygons([wall + away, -wall - away]) if walled else NOTHING
    everybody = np.ones(shape, bool)
    result = new_decider(IDEAL_HALFPLANES, shape, obstacles).decide(
        own, everybody, heard, everybody, radius, np.zeros_like(radius), EVERYWHERE_M
    )[0]  # fmt: skip
    after = position + STEP_S * result[:, rows.R_COMMAND : rows.R_COMMAND + 2]
    pairs = np.triu_indices(vehicles, 1)
    before_m, after_m = (np.linalg.norm(p[pairs[0]] - p[pairs[1]], axis=1) for p in (position, after))
    assert (after_m >= np.minimum(before_m, radius[0][pairs]) - ROUNDING_M).all()


def between(error_m: float) -> float:
    """Velocity north of a vehicle that a fast one presses from the south towards one at rest.

    The disc of the latter, 10 m with a part for errors or without, begins 5 cm ahead.
    """
    own = OwnShip(np.zeros(2), np.zeros(2), np.zeros(2), 1.0, 10.0)
    others = Traffic(
        np.array([[-10.5, 0.0], [10.05, 0.0]]), np.array([[9.0, 0.0], [0.0, 0.0]]), np.full((2, 2), np.nan),
        np.zeros(2), np.full(2, 10.0), np.array([0.0, error_m]), np.ones(2, bool), np.zeros(2, np.int8),
    )  # fmt: skip
    decision = HalfplaneSolver(IDEAL_HALFPLANES).solve(own, others, preferred_ne_mps=(0.0, 0.0), cruise_mps=10.0)
    return float(decision.velocity_ne_mps[0])


def test_only_a_disc_without_a_part_for_errors_is_firm():
    """Half of the gap may be closed in a step; a disc that is wider than the truth is entered rather."""
    assert between(0.0) <= 0.025 / STEP_S + 1e-9 < between(1.0)


def test_a_crowd_on_a_circle_arrives_and_nobody_touches_anybody():
    """RVO2's first example with fewer agents; all 250 are flown by `python -m tests.avoidance.study_rvo2`."""
    out = circle(60, 48.0)
    assert np.isfinite(out.time_s).all()
    assert out.least_m > CIRCLE_DISC_M - ROUNDING_M


def test_four_crowds_between_blocks_arrive_and_nobody_touches_anybody():
    """RVO2's second example with 9 agents a corner; 25 jam in the middle, too, and take turns."""
    out = blocks(3)
    assert np.isfinite(out.time_s).all()
    assert out.least_m > BLOCKS_DISC_M - ROUNDING_M
