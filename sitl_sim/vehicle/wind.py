"""Wind over a fleet: a mean, and independent gusts for each vehicle.

Units and axes: m/s, the air's velocity north and east (where it blows to). Gusts are Gauss-Markov per axis, the
first-order form of Dryden's spectrum; vehicles tens of metres apart are in different gusts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ridlink.scenario import Wind
from sitl_sim.draws import NormalDraws, Stream

FloatArray = npt.NDArray[np.float64]


class FleetWind:
    """The wind at every vehicle, one generator each.

    Args:
        wind: Mean and gusts.
        count: Number of vehicles.
        seed: Seed of the run.
        tick_s: Time between two steps.

    Attributes:
        velocity_ne_mps: Air velocity at each vehicle now, shape (n, 2).
    """

    def __init__(self, wind: Wind, count: int, *, seed: int | Sequence[int], tick_s: float) -> None:
        self._mean = np.array(wind.velocity_ne_mps)
        self._sigma_mps = wind.gust_sigma_mps
        self._keep = math.exp(-tick_s / wind.gust_time_s)
        self._draws = NormalDraws(seed, Stream.WIND, count, 2)
        self._unit = np.zeros((count, 2))
        self.velocity_ne_mps: FloatArray = np.tile(self._mean, (count, 1))
        if self._sigma_mps > 0.0 and count:
            self._unit = self._draws.next().copy()
            self._update()

    def step(self) -> None:
        """Advance by one tick."""
        if self._sigma_mps > 0.0 and len(self._unit):
            self._unit = self._keep * self._unit + math.sqrt(1.0 - self._keep**2) * self._draws.next()
            self._update()

    def _update(self) -> None:
        self.velocity_ne_mps = self._mean + self._sigma_mps * self._unit
