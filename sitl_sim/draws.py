"""What is drawn, and the random generator that each vehicle has to itself.

Every source of chance has a stream, every vehicle its own generator in it: vehicle k sees the same errors, losses and
parameters whatever the size of the fleet, and whatever the others draw.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

BLOCK = 128
"""Draws at a time; what is drawn does not depend on it."""


class Stream(IntEnum):
    """Sources of chance; the numbers are part of what a seed means and never change."""

    GNSS = 1
    PHASE = 4
    WIND = 5
    GNSS_COMMON = 6


def vehicle_generator(seed: int | Sequence[int], stream: Stream, index: int) -> np.random.Generator:
    """The generator of one vehicle (or receiver) in one stream.

    Args:
        seed: Seed of the run; several integers where a run is one of a campaign.
        stream: Source of chance.
        index: Number of the vehicle from 0, or of the receiver; not negative.
    """
    words = [seed] if isinstance(seed, int) else [*seed]
    return np.random.default_rng(np.random.SeedSequence([*words, int(stream), index]))


class NormalDraws:
    """Standard normal figures for every vehicle, each from its own generator, in blocks because calls are slow.

    Args:
        seed: Seed of the run.
        stream: Source of chance.
        count: Number of vehicles.
        width: Figures of one vehicle at a time.
    """

    def __init__(self, seed: int | Sequence[int], stream: Stream, count: int, width: int) -> None:
        self._generators = [vehicle_generator(seed, stream, index) for index in range(count)]
        self._block = np.empty((count, BLOCK, width))
        self._drawn = BLOCK

    def next(self) -> FloatArray:
        """The next figures, shape (n, width); good until the call after."""
        if self._drawn == BLOCK:
            for generator, block in zip(self._generators, self._block, strict=True):
                generator.standard_normal(out=block)
            self._drawn = 0
        self._drawn += 1
        return self._block[:, self._drawn - 1]
