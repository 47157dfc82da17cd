"""The judgement of one flight as plain values, for each vehicle and for all. Metres, seconds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Outcome(StrEnum):
    """How the mission of one vehicle ended."""

    FLYING = "flying"
    GROUNDED = "grounded"
    """On the ground without arrival: did not take off, or landed by a failsafe or a command."""
    ARRIVED = "arrived"
    COLLIDED = "collided"
    HIT_OBSTACLE = "hit_obstacle"


@dataclass(frozen=True, slots=True)
class VehicleResult:
    """Result of one vehicle; None if a value does not exist."""

    system_id: int
    outcome: Outcome
    arrival_time_s: float | None
    min_separation_m: float | None
    nearest_system_id: int | None
    nearest_time_s: float | None

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "system_id": self.system_id,
            "outcome": str(self.outcome),
            "arrival_time_s": _rounded(self.arrival_time_s),
            "min_separation_m": _rounded(self.min_separation_m),
            "nearest_system_id": self.nearest_system_id,
            "nearest_time_s": _rounded(self.nearest_time_s),
        }


@dataclass(frozen=True, slots=True)
class Verdict:
    """The judgement of one flight.

    Args:
        vehicles: Number of vehicles, without ghosts.
        arrived: Number of vehicles that arrived and did not collide on their way down.
        macs: Mid-air collisions (pairs).
        obstacle_hits: Vehicles that flew into an obstacle.
        unmac_violations: Pairs whose reported positions entered their uNMAC radius.
        unmac_violations_true: Pairs whose true positions entered their uNMAC radius.
        min_separation_m: Smallest true distance between the centres of any pair, None without a pair.
        mission_time_median_s, mission_time_max_s: Median and maximum of those that arrived, None if none did.
        details: One entry per vehicle.
    """

    vehicles: int
    arrived: int
    macs: int
    obstacle_hits: int
    unmac_violations: int
    unmac_violations_true: int
    min_separation_m: float | None
    mission_time_median_s: float | None
    mission_time_max_s: float | None
    details: tuple[VehicleResult, ...]

    @property
    def passed(self) -> bool:
        """Whether all vehicles arrived and none hit anything."""
        return self.arrived == self.vehicles and self.macs == 0 and self.obstacle_hits == 0

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON, with the keys of the last line of ``ridlink demo --json``."""
        return {
            "vehicles": self.vehicles,
            "arrived": self.arrived,
            "macs": self.macs,
            "obstacle_hits": self.obstacle_hits,
            "unmac_violations": self.unmac_violations,
            "unmac_violations_true": self.unmac_violations_true,
            "min_separation_m": _rounded(self.min_separation_m),
            "mission_time_s": {
                "median": _rounded(self.mission_time_median_s),
                "max": _rounded(self.mission_time_max_s),
            },
            "details": [detail.as_dict() for detail in self.details],
        }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
