"""Discs that own-ship keeps, and how far away a neighbour must be heard so that they can be kept.

Under `Definition.ODID_ACCURACY` the own error is what its accuracy code tells others, whatever finer figure the
autopilot gives. Others, and any referee, size the disc of the pair by that, so both vehicles keep one disc. By the
letter, and as one sigma, that is never less than the error itself.

Metres, m/s, seconds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.turning import buffer_growth
from ridlink.avoidance.types import SolverKind
from ridlink.engine.config import EngineConfig
from ridlink.engine.detection import Reaction, needed_range
from ridlink.remote_id.accuracy import coded_bound_m
from ridlink.separation.definitions import Discs, Reported, bounded_interval, bounded_speed, separation_discs
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.snapshot import Snapshot

FloatArray = NDArray[np.float64]


class OwnDiscs:
    """Discs of own-ship against others under one definition.

    Args:
        config: As the engine has it.
    """

    def __init__(self, config: EngineConfig) -> None:
        self._config = config

    def against(self, own: OwnState, own_speed_mps: float, snapshot: Snapshot) -> Discs:
        """Discs against all n neighbours of a snapshot, at an own speed [m/s]."""
        others = Reported(snapshot.airframe_m, snapshot.error_bound_m, snapshot.accuracy_bound_m, snapshot.speed_mps)
        # As measured, not as announced: lost reports are time without a report.
        return self._discs(own, own_speed_mps, others, bounded_interval(snapshot.interval_s))

    def needed_range_m(self, own: OwnState, snapshot: Snapshot, reaction: Reaction) -> float:
        """Range [m] from which the most demanding neighbour must be heard at cruise speed; 0 without neighbours."""
        discs = self.against(own, self._config.cruise_mps, snapshot)
        return self._needed_m(discs, snapshot.speed_mps, snapshot.avoiding, snapshot.interval_s, reaction)

    def stranger_range_m(self, own: OwnState, reaction: Reaction) -> float:
        """The same for a neighbour that says nothing of itself, avoids nobody and is heard once a second [m]."""
        unknown, once_a_second = np.full(1, math.nan), np.ones(1)
        discs = self._discs(own, self._config.cruise_mps, Reported(), once_a_second)
        return self._needed_m(discs, unknown, np.zeros(1, np.bool_), once_a_second, reaction)

    def _discs(self, own: OwnState, own_speed_mps: float, others: Reported, interval_s: FloatArray) -> Discs:
        config = self._config
        coded_m = coded_bound_m(own.error_bound_m, config.accuracy_convention)
        return separation_discs(
            config.definition,
            Reported(config.airframe_m, own.error_bound_m, coded_m, own_speed_mps),
            others,
            interval_s=interval_s,
            eta=config.eta,
            neighbours=len(interval_s),
            bound=config.chance_bound,
        )

    def _needed_m(
        self,
        discs: Discs,
        speed_mps: FloatArray,
        avoiding: NDArray[np.bool_],
        interval_s: FloatArray,
        reaction: Reaction,
    ) -> float:
        config, disc_m = self._config, discs.radius_m
        if config.solver is SolverKind.HALFPLANE:
            growth = buffer_growth(config.cruise_mps, config.halfplane.response_time_s)
            disc_m = disc_m + growth * config.halfplane.buffer_share * discs.error_sum_m
        needed_m = needed_range(
            disc_m,
            bounded_speed(speed_mps),
            avoiding,
            speed_mps=config.cruise_mps,
            reaction=reaction,
            interval_s=interval_s,
        )
        return float(np.max(needed_m, initial=0.0))
