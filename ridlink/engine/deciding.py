"""From present traffic to a velocity: discs, conflicts, solver, altitude.

Axes: north, east, down about the present own position; metres, m/s, seconds of the caller's monotonic clock.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.priority import RightOfWay
from ridlink.avoidance.progress import ProgressWatch
from ridlink.avoidance.solver import new_solver
from ridlink.avoidance.types import OwnShip, SolverKind, Status, Traffic
from ridlink.engine.config import EngineConfig, Goal
from ridlink.engine.decision import Conflict, DecisionRecord
from ridlink.engine.discs import OwnDiscs
from ridlink.engine.identity import Identity, places
from ridlink.engine.static_obstacles import StaticObstacles
from ridlink.geodesy import ned_from_geodetic
from ridlink.separation.reference import REPORT_INTERVAL_S
from ridlink.setpoint import Velocity
from ridlink.traffic.encounter import Encounters, encounters
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.snapshot import Snapshot

FloatArray = NDArray[np.float64]

VERTICAL_GAIN_PER_S = 0.5
"""Climb rate to the goal altitude per metre missing: braking from 2 m/s then takes the 1 m/s^2 autopilots have."""


class Decider:
    """Finds conflicts and chooses the velocity; keeps the memory of one leg of the flight.

    Args:
        config: As the engine has it.

    Attributes:
        discs: Discs of own-ship against others.
        solver: Chooses the horizontal velocity.
        infeasible: Number of decisions without an admissible velocity.
        straight_ne_mps: Velocity straight to the goal at the speed that the last decision wanted, shape (2,).
        cost_mps: Distance of the last decision's velocity from that straight to the goal.
        target_altitude_m: Altitude that the last decision wants, above mean sea level.
    """

    def __init__(self, config: EngineConfig) -> None:
        self.config = config
        self.discs = OwnDiscs(config)
        self.solver = new_solver(config.solver, config.solver_settings)
        self.infeasible = 0
        self.straight_ne_mps = np.zeros(2)
        self.cost_mps = 0.0
        self.target_altitude_m = 0.0
        self._obstacles = StaticObstacles(config.obstacles)
        self.begin_leg()

    def begin_leg(self) -> None:
        """Begin a new leg: a new goal, or a new engagement."""
        self._kept_altitude_m: float | None = None
        self._watch, self._right_of_way = ProgressWatch(), RightOfWay()
        self._route = 0

    def traffic(self, own: OwnState, snapshot: Snapshot) -> tuple[Traffic, Encounters]:
        """Discs and velocities for the solver, and the encounters if all fly on."""
        discs = self.discs.against(own, own.speed_mps, snapshot)
        radius = discs.radius_m + snapshot.widening_m
        position, velocity = snapshot.position_ned_m[:, :2], snapshot.velocity_ned_mps[:, :2]
        traffic = Traffic(
            position_ne_m=position,
            velocity_ne_mps=velocity,
            command_ne_mps=snapshot.command_ned_mps[:, :2],
            age_s=snapshot.age_s,
            radius_m=radius,
            error_sum_m=discs.error_sum_m,
            reciprocal=snapshot.avoiding,
            memory=snapshot.memory,
        )
        now = position + velocity * snapshot.age_s[:, None]
        return traffic, encounters(now, velocity - np.asarray(own.velocity_ned_mps[:2]), radius)

    def resumed_entry_s(self, goal: Goal, speed_mps: float, own: OwnState, snapshot: Snapshot) -> float:
        """Time until the first disc is entered if own-ship flies straight to a goal at a speed, and all others fly on
        [s]; infinity if none is."""
        here = own.position
        north, east, _ = ned_from_geodetic(goal.latitude_deg, goal.longitude_deg, here.altitude_m, here)
        per_m = speed_mps / max(math.hypot(north, east), 1e-9)
        resumed = replace(own, velocity_ned_mps=(per_m * float(north), per_m * float(east), own.velocity_ned_mps[2]))
        _, met = self.traffic(resumed, snapshot)
        return float(np.min(met.entry_s, initial=math.inf))

    def seen(self, record: DecisionRecord, snapshot: Snapshot, seen: Encounters) -> DecisionRecord:
        """The record with the present conflicts."""
        soon = seen.entry_s <= self.config.halfplane.horizon_s
        for track, conflict in zip(snapshot.tracks, soon.tolist(), strict=True):
            track.in_conflict = conflict
        urgent_first = np.flatnonzero(soon)[np.argsort(seen.entry_s[soon], kind="stable")]
        conflicts = tuple(
            Conflict(
                snapshot.tracks[k],
                entry_s=float(seen.entry_s[k]),
                closest_s=float(seen.closest_s[k]),
                miss_m=float(seen.miss_m[k]),
                height_m=-float(snapshot.position_ned_m[k, 2]),
            )
            for k in urgent_first
        )
        return replace(
            record,
            conflicts=conflicts,
            nearest_margin_m=float(np.min(seen.margin_m, initial=math.inf)),
            time_to_violation_s=float(np.min(seen.entry_s, initial=math.inf)),
        )

    def decide(
        self,
        record: DecisionRecord,
        goal: Goal,
        own: OwnState,
        last: Velocity,
        snapshot: Snapshot,
        traffic: Traffic,
        identity: Identity,
        utc_s: float | None = None,
    ) -> DecisionRecord:
        """The record with the velocity to fly.

        Args:
            record: What is known of this step, with its time.
            goal: Where to go.
            own: Own state.
            last: Velocity sent last.
            snapshot: Neighbours that count.
            traffic: The same for the solver.
            identity: Own system id and identity in Remote ID.
            utc_s: UTC now, the clock of turns in a jam.
        """
        config, now_s = self.config, record.time_s
        here = own.position
        down = self._down_mps(goal, here.altitude_m)
        target = ned_from_geodetic(goal.latitude_deg, goal.longitude_deg, here.altitude_m, here)[:2]
        distance = float(np.hypot(*target))
        cruise_mps = min(config.cruise_mps, goal.speed_mps or config.cruise_mps)
        turn = self._watch.update(now_s, distance, cruise_mps)
        ship = OwnShip(
            position_ne_m=np.zeros(2),
            velocity_ne_mps=np.array(own.velocity_ned_mps[:2]),
            command_ne_mps=np.array(last[:2]),
            airframe_m=config.airframe_m,
            speed_limit_mps=config.cruise_mps,
        )
        makes_way = self._makes_way(ship, identity, snapshot, traffic, target, cruise_mps, now_s, utc_s)
        decision = self.solver.solve(
            ship,
            traffic,
            goal_ne_m=target if makes_way is None else None,
            preferred_ne_mps=makes_way,
            cruise_mps=cruise_mps,
            obstacles=self._obstacles.about(here),
            own_clearance_m=config.airframe_m / 2.0 + own.error_bound_m + REPORT_INTERVAL_S * own.speed_mps,
            extra_right_turn_rad=turn if makes_way is None else 0.0,
            route=self._route,
        )
        self._route = decision.route
        for track, memory in zip(snapshot.tracks, decision.memory.tolist(), strict=True):
            track.memory = memory
        self.infeasible += decision.status is Status.INFEASIBLE
        self.straight_ne_mps = target * (float(np.hypot(*decision.preferred_ne_mps)) / max(distance, 1e-9))
        self.cost_mps = float(np.hypot(*(decision.velocity_ne_mps - self.straight_ne_mps)))
        north, east = decision.command_ne_mps.tolist()
        return replace(
            record,
            preferred_ned_mps=(*decision.preferred_ne_mps.tolist(), down),
            commanded_ned_mps=(north, east, down),
            status=decision.status,
            binding=tuple(snapshot.tracks[k] for k in decision.binding),
            goal_distance_m=distance,
        )

    def _down_mps(self, goal: Goal, altitude_m: float) -> float:
        """Velocity towards the altitude of the goal or, where it has none, that at which the leg began."""
        if self._kept_altitude_m is None:
            self._kept_altitude_m = altitude_m
        self.target_altitude_m = self._kept_altitude_m if goal.altitude_m is None else goal.altitude_m
        most = self.config.limits.vertical_mps
        return min(max(VERTICAL_GAIN_PER_S * (altitude_m - self.target_altitude_m), -most), most)

    def _makes_way(
        self,
        ship: OwnShip,
        identity: Identity,
        snapshot: Snapshot,
        traffic: Traffic,
        target_ne_m: FloatArray,
        cruise_mps: float,
        now_s: float,
        utc_s: float | None,
    ) -> FloatArray | None:
        """Velocity that makes way for vehicles before us in a jam; None: fly to the goal."""
        order = places(identity, snapshot.tracks)
        if self.config.solver is not SolverKind.HALFPLANE or order is None:
            return None
        return self._right_of_way.velocity(
            ship,
            order[0],
            traffic,
            order[1],
            goal_ne_m=target_ne_m,
            cruise_mps=cruise_mps,
            now_s=now_s,
            clock_s=utc_s,
        )
