"""Random draws, with a random generator for each vehicle.

Every source of chance has a stream, and every vehicle has its own generator in it. So vehicle k gets the same errors,
losses and parameters for any size of the fleet and any draws of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

BLOCK = 128
"""Draws per call; the numbers do not depend on it."""


class Stream(IntEnum):
    """Sources of chance; the numbers determine the draws of a seed and never change."""

    GNSS = 1
    PHASE = 4
    WIND = 5
    GNSS_COMMON = 6


def vehicle_generator(seed: int | Sequence[int], stream: Stream, index: int) -> np.random.Generator:
    """The generator of one vehicle (or receiver) in one stream.

    Args:
        seed: Seed of the run; several integers if the run is part of a campaign.
        stream: Source of chance.
        index: Number of the vehicle from 0, or of the receiver; not negative.
    """
    words = [seed] if isinstance(seed, int) else [*seed]
    return np.random.default_rng(np.random.SeedSequence([*words, int(stream), index]))


class NormalDraws:
    """Standard normal numbers for every vehicle from its own generator, drawn in blocks because calls are slow.

    Args:
        seed: Seed of the run.
        stream: Source of chance.
        count: Number of vehicles.
        width: Numbers per vehicle and call.
    """

    def __init__(self, seed: int | Sequence[int], stream: Stream, count: int, width: int) -> None:
        self._generators = [vehicle_generator(seed, stream, index) for index in range(count)]
        self._block = np.empty((count, BLOCK, width))
        self._drawn = BLOCK

    def next(self) -> FloatArray:
        """The next numbers, shape (n, width); valid until the next call."""
        if self._drawn == BLOCK:
            for generator, block in zip(self._generators, self._block, strict=True):
                generator.standard_normal(out=block)
            self._drawn = 0
        self._drawn += 1
        return self._block[:, self._drawn - 1]
