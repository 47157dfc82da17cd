"""Vertical avoidance in the engine: the traffic picture as cylinders, the band of heights, the greater identity.

Heights: metres, positive upwards, about own-ship; the band is counted above mean sea level and above home.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ridlink.avoidance.types import Status
from ridlink.avoidance.vertical import Cylinder, VerticalAvoidance, VerticalSettings
from ridlink.engine.config import EngineConfig
from ridlink.engine.deciding import Decider
from ridlink.engine.decision import DecisionRecord
from ridlink.engine.identity import Identity, greater
from ridlink.traffic.encounter import encounters
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.snapshot import Snapshot

PX4_DESCENT_MPS = 1.5
"""MPC_Z_VEL_MAX_DN: faster setpoints are clipped, so own-ship would leave a slab later than calculated."""

LONGEST_STEP_S = 0.5
"""After a longer pause the climb rate changes as after this time."""

ALONGSIDE_MPS = 1.0
"""A neighbour that moves no faster relative to own-ship flies alongside."""


class Climber:
    """Puts the climb rate of vertical avoidance into decisions.

    Args:
        config: As the engine has it.
    """

    def __init__(self, config: EngineConfig) -> None:
        self._config = config
        self._avoidance = VerticalAvoidance(
            VerticalSettings(
                climb_mps=config.limits.vertical_mps, descent_mps=min(config.limits.vertical_mps, PX4_DESCENT_MPS)
            )
        )
        self._last_s: float | None = None

    @property
    def leaving(self) -> int:
        """1 while own-ship has left a slab upwards, -1 downwards, 0 otherwise."""
        return self._avoidance.leaving

    def begin_leg(self) -> None:
        """Begin a new leg: a new goal, or a new engagement."""
        self._avoidance.forget()

    def climb(
        self,
        record: DecisionRecord,
        own: OwnState,
        everybody: Snapshot,
        decider: Decider,
        *,
        last_down_mps: float,
        identity: Identity,
    ) -> DecisionRecord:
        """The record with its vertical velocity decided.

        Args:
            record: Record with a horizontal decision.
            own: Own state.
            everybody: Neighbours at all heights.
            decider: Decider that made the horizontal decision.
            last_down_mps: Vertical velocity sent last, positive downwards.
            identity: Own system id and identity in Remote ID.
        """
        if record.commanded_ned_mps is None:
            return record
        elapsed_s = 0.0 if self._last_s is None else min(record.time_s - self._last_s, LONGEST_STEP_S)
        self._last_s = record.time_s
        bad = record.status in (Status.INFEASIBLE, Status.OVERLAPPED)
        bad |= decider.cost_mps > self._config.vertical_cost * self._config.cruise_mps
        altitude_m = own.position.altitude_m
        climb_mps = self._avoidance.step(
            self._cylinders(own, everybody, decider, identity),
            bad=bad,
            own_climb_mps=-own.velocity_ned_mps[2],
            to_goal_m=decider.target_altitude_m - altitude_m,
            room_m=self._room_m(own, decider.target_altitude_m),
            last_mps=-last_down_mps,
            elapsed_s=elapsed_s,
        )
        north, east, _ = record.commanded_ned_mps
        return replace(record, commanded_ned_mps=(north, east, -climb_mps))

    def _room_m(self, own: OwnState, goal_altitude_m: float) -> tuple[float, float]:
        """How far the band reaches up and down from here [m]; the goal is always in it."""
        config, here = self._config, own.position.altitude_m
        highest = min(goal_altitude_m + config.vertical_band_m, own.home_altitude_m + config.max_height_m)
        lowest = max(goal_altitude_m - config.vertical_band_m, own.home_altitude_m + config.min_height_m)
        return max(highest, goal_altitude_m) - here, here - min(lowest, goal_altitude_m)

    def _cylinders(
        self,
        own: OwnState,
        everybody: Snapshot,
        decider: Decider,
        identity: Identity,
    ) -> list[Cylinder]:
        radius = decider.discs.against(own, own.speed_mps, everybody).radius_m + everybody.widening_m
        velocity = everybody.velocity_ned_mps[:, :2]
        now = everybody.position_ned_m[:, :2] + velocity * everybody.age_s[:, None]
        relative = velocity - np.asarray(own.velocity_ned_mps[:2])
        seen = encounters(now, relative, radius)
        # With the own velocity, and with the one straight to the goal: a neighbour that was avoided is not gone.
        straight = encounters(now, velocity - decider.straight_ne_mps, radius)
        entry = np.minimum(seen.entry_s, straight.entry_s)
        look_s, held = self._avoidance.settings.look_s, self._avoidance.held
        alongside = (np.hypot(relative[:, 0], relative[:, 1]) < ALONGSIDE_MPS) | (seen.closest_s > look_s)
        receding = (seen.margin_m > 0.0) & ((seen.closest_s <= 0.0) | (alongside & np.isinf(seen.entry_s)))
        return [
            Cylinder(
                key=track.key,
                above_m=float(everybody.above_m[k]),
                climb_mps=float(everybody.climb_mps[k]),
                half_height_m=float(everybody.vertical_bound_m[k]),
                entry_s=float(entry[k]),
                receding=bool(receding[k]),
                reciprocal=bool(everybody.avoiding[k]),
                greater=greater(identity, track),
            )
            for k, track in enumerate(everybody.tracks)
            if entry[k] <= look_s or track.key in held
        ]
