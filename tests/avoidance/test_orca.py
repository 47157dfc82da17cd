"""Half-planes beside plain ORCA, which was written apart from them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ridlink.avoidance import HalfplaneSettings, Obstacles, rows
from ridlink.campaign.deciding import new_decider
from tests.avoidance.reference_orca import Orca

PLAIN = replace(
    HalfplaneSettings(), response_time_s=0.0, buffer_share=0.0, right_turn_rad=0.0, start_turn_rad=0.0, smoothing=1.0,
    head_on_cosine=-1.0, arrival_deceleration_mps2=math.inf,
)  # fmt: skip
DISC_M, SPEED_MPS, EXTENT_M = 24.0, 10.0, 600.0


@pytest.mark.parametrize("count", [2, 8, 16])
def test_without_buffers_sides_delays_and_turns_half_planes_are_orca(count: int) -> None:
    """In every decision that is feasible and begins outside of all discs; inside, a barrier takes the place of ORCA's
    way out within a step."""
    seed, shape = 1, (400, count)
    random = np.random.default_rng(seed)
    angle = random.uniform(-np.pi, np.pi, shape)
    position = random.uniform(0.0, EXTENT_M, (*shape, 2))
    velocity = SPEED_MPS * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    everybody = np.ones(shape, np.bool_)
    own, heard, radius = np.zeros((*shape, rows.OWN_COLUMNS)), np.zeros((*shape, 8)), np.full((*shape, count), DISC_M)
    own[..., 0:2], own[..., 2:4], own[..., 4:6], own[..., 6:8] = (
        position, velocity, velocity, position + 60.0 * velocity,
    )  # fmt: skip
    own[..., rows.LIMIT] = own[..., rows.CRUISE] = SPEED_MPS
    heard[..., 0:2], heard[..., 2:4], heard[..., 4:6], heard[..., 7] = position, velocity, np.nan, 1.0
    decider = new_decider(PLAIN, shape, Obstacles.from_polygons(()))
    result = decider.decide(own, everybody, heard, everybody, radius, 0.0 * radius, 1e9)
    plain = Orca(position, velocity, everybody, DISC_M, SPEED_MPS).step()

    status = result[..., rows.R_STATUS]
    apart = np.linalg.norm(result[..., rows.R_VELOCITY : rows.R_VELOCITY + 2] - plain, axis=-1)
    judged = (status == rows.FREE) | (status == rows.CONSTRAINED)
    assert (status == rows.CONSTRAINED).sum() > 10, f"seed {seed}"
    assert apart[judged].max() < 1e-9, f"seed {seed}"
