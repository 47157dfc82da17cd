"""The velocities that the selected vehicle may fly: the half-planes of its neighbours, from the solver of a daemon.

The rows are those of `ridlink.avoidance`. For facts that only a daemon knows, its defaults are used: it meets all of
its neighbours for the first time, and a vehicle of unknown speed limit flies 10 m/s, or as fast as it says.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np

from ridlink.avoidance.obstacles import NO_OBSTACLES, Obstacles
from ridlink.avoidance.solver import HalfplaneSolver
from ridlink.avoidance.types import OwnShip, Traffic
from ridlink.observer import Pairs, Scene, pairs_at
from ridlink.observer.scene import CONSIDERED_M
from ridlink.separation.definitions import Definition, bounded_airframe, bounded_error, separation_discs
from ridlink.separation.reference import REPORT_INTERVAL_S
from ridlink.setpoint import VelocityLimits
from ridlink.view.scenery import Scenery

USUAL_SPEED_MPS = 10.0

NOTHING = b"null"


class VelocitySpace:
    """Computes velocity spaces one at a time; keeps its scratch memory."""

    def __init__(self) -> None:
        self._solver = HalfplaneSolver()
        self._limits = VelocityLimits()
        self._obstacles: tuple[Scenery | None, Obstacles] = None, NO_OBSTACLES

    def of(self, name: str, scene: Scene, definition: Definition, scenery: Scenery) -> bytes:
        """The velocity space of a vehicle as JSON; ``null`` if it is not in the air.

        Args:
            name: Name of the vehicle.
            scene: All vehicles.
            definition: Separation definition.
            scenery: Goals, cruise speeds and obstacles, if known.
        """
        if name not in scene.names:
            return NOTHING
        own = scene.names.index(name)
        everybody = np.arange(len(scene))
        pairs = pairs_at(scene, np.full(len(scene), own), everybody, definition)
        pairs = pairs.only(~pairs.apart & (everybody != own) & (pairs.distance_m < CONSIDERED_M))
        others = pairs.second
        velocity, command = scene.velocity_ne_mps[own], scene.command_ne_mps[own]
        chosen = velocity if np.isnan(command).any() else command
        goal = scenery.goals.get(name)
        cruise = scenery.cruises.get(name, USUAL_SPEED_MPS)
        limit = max(cruise, math.hypot(*velocity), math.hypot(*chosen))
        here = scene.position_ne_m[own]
        ship = OwnShip(here, velocity, chosen, float(bounded_airframe(scene.airframe_m[own])), limit)
        clearance = (
            ship.airframe_m / 2.0
            + float(bounded_error(scene.error_bound_m[own]))
            + REPORT_INTERVAL_S * float(np.hypot(*velocity))
        )
        decision = self._solver.solve(
            ship,
            self._traffic(own, scene, pairs, definition),
            goal_ne_m=goal,
            preferred_ne_mps=chosen if goal is None else None,
            cruise_mps=cruise,
            obstacles=self._obstacles_of(scenery),
            own_clearance_m=clearance,
        )
        planes = [
            [*np.round(plane[:3], 4).tolist(), None if who < 0 else scene.names[others[who]]]
            for plane, who in self._solver.half_planes()
        ]
        response_s = self._solver.settings.response_time_s
        space: dict[str, Any] = {
            "name": name,
            "v": _pair(velocity),
            "chosen": _pair(chosen),
            "preferred": None if goal is None else _pair(decision.preferred_ne_mps),
            "max_speed": round(limit, 2),
            "reachable": {
                "centre": _pair(velocity),
                "radius": round(self._limits.acceleration_mps2 * response_s, 2),
            },
            "planes": planes,
        }
        return msgspec.json.encode(space)

    def _obstacles_of(self, scenery: Scenery) -> Obstacles:
        if self._obstacles[0] is not scenery:
            self._obstacles = scenery, Obstacles.from_polygons([np.array(one) for one in scenery.obstacles])
        return self._obstacles[1]

    def _traffic(self, own: int, scene: Scene, pairs: Pairs, definition: Definition) -> Traffic:
        others = pairs.second
        discs = separation_discs(
            definition, scene.reported[own], scene.reported[others], neighbours=max(1, len(scene) - 1)
        )
        age = scene.age_s[others]
        velocity = scene.velocity_ne_mps[others]
        return Traffic(
            position_ne_m=scene.position_ne_m[others] - velocity * age[:, None],
            velocity_ne_mps=velocity,
            command_ne_mps=scene.command_ne_mps[others],
            age_s=age,
            radius_m=pairs.radius_m,
            error_sum_m=discs.error_sum_m,
            reciprocal=scene.avoiding[others],
            memory=np.zeros(len(others), np.int8),
        )


def _pair(values: np.ndarray[Any, Any]) -> list[float]:
    return [round(float(value), 3) for value in values]
