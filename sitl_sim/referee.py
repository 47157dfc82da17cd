"""The referee: separations, collisions and arrivals, judged on true positions, at samples and between them.

Units and axes: metres, seconds; north-east-down. Between two samples vehicles fly straight, so the closest approach of
a pair inside a step is known exactly, and no vehicle passes through another between two samples, however fast.

- MAC, mid-air collision: true horizontal distance below half the sum of the airframe sizes (paper Eq. 9) while the
  airframes overlap vertically (heights: ``VehicleSpec.airframe_height_m``). Judged for all vehicles in the air.
- Separation and uNMAC: judged for pairs on their missions that are inside each other's height bound. A pair violates
  its uNMAC when it *enters* the cylinder of its radius and that bound; a pair that is inside from the start counts only
  after it was clear once. On true positions, violations include those caused by position errors, which the radius is
  meant to cover; avoidance is responsible only for the count on reported positions. Both are kept.
- Arrival: the true or the reported position is within 5 m of the goal horizontally.
"""

from __future__ import annotations

import itertools
import math
import statistics
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ridlink.scenario import Scenario, distance_to_polygon
from sitl_sim.verdict import Outcome, VehicleResult, Verdict

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

ARRIVAL_RADIUS_M = 5.0
"""Horizontal distance to the goal that counts as arrived: the paper's simulation."""

ALTITUDE_SLICE_M = 15.0
"""Least height bound, also used if no vertical errors are reported: pairs further apart vertically are in different
slices of airspace, and their horizontal distance does not matter."""

SWEPT_WITHIN_M = 25.0
"""Pairs that may come nearer than this inside a step are also judged between samples. For others, samples suffice: with
1 m of relative motion in a step, the closest approach of a pair 25 m apart is missed by 5 mm."""

OBSTACLE_LOOK_M = 0.5
"""Largest distance between two obstacle checks along a vehicle's way; far smaller than the thickness of any
obstacle."""


class Collision(NamedTuple):
    """A mid-air collision: mission time [s] and both indices."""

    time_s: float
    first: int
    second: int


class Referee:
    """Watches one flight, step by step.

    Args:
        scenario: Goals, airframes and obstacles.
        position_ned_m: True positions now, shape (n, 3).

    Attributes:
        arrival_time_s: Mission time of arrival, shape (n,), NaN if not arrived.
        collisions: Mid-air collisions in order.
        obstacle_hits: Mission time and index of vehicles that hit an obstacle.
    """

    def __init__(self, scenario: Scenario, position_ned_m: npt.ArrayLike) -> None:
        vehicles = scenario.vehicles
        count = len(vehicles)
        self._goal_ne_m = np.array([vehicle.goal_ned_m[:2] for vehicle in vehicles]).reshape(count, 2)
        self._is_ghost = [vehicle.ghost for vehicle in vehicles]
        self._airframe_m = np.array([vehicle.airframe_m for vehicle in vehicles], dtype=np.float64)
        self._height_m = np.array([vehicle.airframe_height_m for vehicle in vehicles], dtype=np.float64)
        self._polygons = [np.array(obstacle.polygon_ne_m) for obstacle in scenario.obstacles]
        self._others = ~np.eye(count, dtype=np.bool_)
        self._distances = _PairDistances(count)
        self._bound_m: FloatArray = np.full((count, count), ALTITUDE_SLICE_M)
        self.begin(position_ned_m)

    def begin(self, position_ned_m: npt.ArrayLike) -> None:
        """Reset all judgements; the mission begins now, from these true positions, shape (n, 3)."""
        count = len(self._others)
        self._before: FloatArray = np.array(position_ned_m, dtype=np.float64).reshape(count, 3)
        self.arrival_time_s: FloatArray = np.full(count, np.nan)
        self.collisions: list[Collision] = []
        self.obstacle_hits: list[tuple[float, int]] = []
        self._closest_m = np.full((count, count), np.inf)
        self._closest_at_s = np.full((count, count), np.nan)
        self._true_entries = _EntryCounter(count)
        self._reported_entries = _EntryCounter(count)

    @property
    def arrived(self) -> BoolArray:
        """Mask of vehicles that have arrived, shape (n,)."""
        return ~np.isnan(self.arrival_time_s)

    @property
    def removed(self) -> BoolArray:
        """Mask of vehicles that have collided with a vehicle or an obstacle, shape (n,)."""
        removed = np.zeros(len(self._before), dtype=np.bool_)
        for collision in self.collisions:
            removed[[collision.first, collision.second]] = True
        removed[[index for _, index in self.obstacle_hits]] = True
        return removed

    def observe(
        self,
        time_s: float,
        dt_s: float,
        position_ned_m: FloatArray,
        reported_position_ned_m: FloatArray,
        *,
        in_air: BoolArray,
        active: BoolArray,
    ) -> IntArray:
        """Judge the step that ends now.

        Args:
            time_s: Mission time at the end of the step.
            dt_s: Length of the step.
            position_ned_m: True positions now, shape (n, 3).
            reported_position_ned_m: Reported positions now, shape (n, 3).
            in_air: Mask of vehicles in the air during the step, shape (n,).
            active: Mask of vehicles on their mission, shape (n,).

        Returns:
            Indices of vehicles that collided in this step, with another or with an obstacle.
        """
        start, step = self._before, position_ned_m - self._before
        self._before = position_ned_m.copy()
        hit = self._judge_pairs(time_s, dt_s, start, step, in_air, active)
        hit |= self._judge_obstacles(time_s, start, step, in_air & ~hit)
        for position in (position_ned_m, reported_position_ned_m):
            gap = position[:, :2] - self._goal_ne_m
            here = np.hypot(gap[:, 0], gap[:, 1]) <= ARRIVAL_RADIUS_M
            self.arrival_time_s[here & active & ~hit & ~self.arrived] = time_s
        return np.flatnonzero(hit)

    def observe_reports(
        self,
        position_ned_m: FloatArray,
        reported_position_ned_m: FloatArray,
        pair_radius_m: FloatArray,
        *,
        active: BoolArray,
        vertical_error_m: FloatArray | None = None,
    ) -> None:
        """Judge the uNMAC of every pair at the moment of a report.

        Args:
            position_ned_m: True positions, shape (n, 3).
            reported_position_ned_m: Reported positions, shape (n, 3).
            pair_radius_m: uNMAC radii, shape (n, n), symmetric.
            active: Mask of vehicles on their mission, shape (n,).
            vertical_error_m: Three-sigma vertical errors that the vehicles report, shape (n,); with the heights of the
                airframes they make the height bound of each pair, from now on.
        """
        if vertical_error_m is not None:
            half_m = np.asarray(vertical_error_m) + self._height_m / 2.0
            np.maximum(half_m[:, None] + half_m[None, :], ALTITUDE_SLICE_M, out=self._bound_m)
        judged = self._pairs(active)
        for entries, position in (
            (self._true_entries, position_ned_m),
            (self._reported_entries, reported_position_ned_m),
        ):
            entries.see(self._distances.of(position), pair_radius_m, judged, self._level(position))

    def _pairs(self, active: BoolArray) -> BoolArray:
        judged = self._others & active[:, None]
        judged &= active[None, :]
        return judged

    def _level(self, position_ned_m: FloatArray) -> BoolArray | None:
        """Mask of pairs inside each other's height bound, shape (n, n); None if all are."""
        down = position_ned_m[:, 2]
        if np.ptp(down) < ALTITUDE_SLICE_M:
            return None
        return np.asarray(np.abs(down[:, None] - down[None, :]) < self._bound_m)

    def _judge_pairs(
        self, time_s: float, dt_s: float, start: FloatArray, step: FloatArray, in_air: BoolArray, active: BoolArray
    ) -> BoolArray:
        """Keep the closest approach of every pair; return those that collided."""
        hit = np.zeros(len(start), dtype=np.bool_)
        if np.count_nonzero(in_air) < 2:
            return hit
        judged, level = self._pairs(active), self._level(self._before)
        if level is not None:
            judged &= level
        distance_m = self._distances.of(self._before)
        nearer = judged & (distance_m < self._closest_m)
        np.copyto(self._closest_m, distance_m, where=nearer)
        np.copyto(self._closest_at_s, time_s, where=nearer)

        longest_m = math.sqrt(float(np.max(np.einsum("ij,ij->i", step[:, :2], step[:, :2]))))
        first, second = np.nonzero(distance_m < SWEPT_WITHIN_M + float(np.max(self._airframe_m)) + 2.0 * longest_m)
        counted = (first < second) & in_air[first] & in_air[second]
        first, second = first[counted], second[counted]
        if not len(first):
            return hit
        gap, motion = start[first] - start[second], step[first] - step[second]
        length = np.einsum("ij,ij->i", motion[:, :2], motion[:, :2])
        share = np.clip(-np.einsum("ij,ij->i", gap[:, :2], motion[:, :2]) / np.maximum(length, 1e-12), 0.0, 1.0)
        at_closest = gap[:, :2] + share[:, None] * motion[:, :2]
        closest_m = np.hypot(at_closest[:, 0], at_closest[:, 1])
        nearer = judged[first, second] & (closest_m < self._closest_m[first, second])
        closest_at_s = time_s - (1.0 - share) * dt_s
        for i, j in ((first, second), (second, first)):
            self._closest_m[i[nearer], j[nearer]] = closest_m[nearer]
            self._closest_at_s[i[nearer], j[nearer]] = closest_at_s[nearer]

        touch_m = (self._airframe_m[first] + self._airframe_m[second]) / 2.0
        overlap_m = (self._height_m[first] + self._height_m[second]) / 2.0
        contacts = []
        for pair in np.flatnonzero(closest_m < touch_m):
            when = _contact(gap[pair], motion[pair], float(touch_m[pair]), float(overlap_m[pair]))
            if when is not None:
                contacts.append((when, int(first[pair]), int(second[pair])))
        for when, one, other in sorted(contacts):  # a vehicle that has collided cannot be hit again
            if not (hit[one] or hit[other]):
                hit[[one, other]] = True
                self.collisions.append(Collision(time_s - (1.0 - when) * dt_s, one, other))
        return hit

    def _judge_obstacles(self, time_s: float, start: FloatArray, step: FloatArray, in_air: BoolArray) -> BoolArray:
        """Mask of vehicles nearer to an obstacle than half their airframe, checked often enough not to miss an edge."""
        hit = np.zeros(len(start), dtype=np.bool_)
        if not self._polygons or not len(start):
            return hit
        looks = 1 + math.floor(float(np.max(np.hypot(step[:, 0], step[:, 1]))) / OBSTACLE_LOOK_M)
        for polygon in self._polygons:
            for look in range(1, looks + 1):
                at = start[:, :2] + step[:, :2] * (look / looks)
                hit |= in_air & (distance_to_polygon(at, polygon) < self._airframe_m / 2.0)
        self.obstacle_hits.extend((time_s, int(index)) for index in np.flatnonzero(hit))
        return hit

    def verdict(self, grounded: BoolArray | None = None) -> Verdict:
        """The judgement so far.

        Args:
            grounded: Mask of vehicles on the ground, shape (n,); None: none.
        """
        stands = np.zeros(len(self._before), dtype=np.bool_) if grounded is None else grounded
        details = tuple(
            self._result(row, bool(stands[row])) for row in range(len(self._before)) if not self._is_ghost[row]
        )
        times = sorted(
            d.arrival_time_s for d in details if d.outcome is Outcome.ARRIVED and d.arrival_time_s is not None
        )
        return Verdict(
            vehicles=len(details),
            arrived=len(times),
            macs=len(self.collisions),
            obstacle_hits=len(self.obstacle_hits),
            unmac_violations=self._reported_entries.count,
            unmac_violations_true=self._true_entries.count,
            min_separation_m=_finite(float(np.min(self._closest_m, initial=np.inf))),
            mission_time_median_s=statistics.median(times) if times else None,
            mission_time_max_s=times[-1] if times else None,
            details=details,
        )

    def _result(self, index: int, stands: bool) -> VehicleResult:
        separation_m = self._closest_m[index]
        nearest = int(np.argmin(separation_m))
        known = math.isfinite(separation_m[nearest])
        return VehicleResult(
            system_id=index + 1,
            outcome=self._outcome(index, stands),
            arrival_time_s=_finite(self.arrival_time_s[index]),
            min_separation_m=float(separation_m[nearest]) if known else None,
            nearest_system_id=nearest + 1 if known else None,
            nearest_time_s=float(self._closest_at_s[index, nearest]) if known else None,
        )

    def _outcome(self, index: int, stands: bool) -> Outcome:
        if index in itertools.chain.from_iterable(collision[1:] for collision in self.collisions):
            return Outcome.COLLIDED
        if any(index == other for _, other in self.obstacle_hits):
            return Outcome.HIT_OBSTACLE
        if not math.isnan(self.arrival_time_s[index]):
            return Outcome.ARRIVED
        return Outcome.GROUNDED if stands else Outcome.FLYING


class _EntryCounter:
    """Counts pairs that entered their cylinder after having been outside of it."""

    def __init__(self, count: int) -> None:
        self._was_clear = np.zeros((count, count), dtype=np.bool_)
        self._entered = np.zeros((count, count), dtype=np.bool_)

    def see(self, distance_m: FloatArray, radius_m: FloatArray, judged: BoolArray, level: BoolArray | None) -> None:
        inside = distance_m < radius_m
        if level is not None:
            inside &= level
        self._entered |= inside & judged & self._was_clear
        self._was_clear |= judged & ~inside

    @property
    def count(self) -> int:
        return int(np.count_nonzero(np.triu(self._entered, 1)))


class _PairDistances:
    """Horizontal distances of all pairs, always in the same memory: allocation costs more than the arithmetic."""

    def __init__(self, count: int) -> None:
        self._distance_m = np.empty((count, count))
        self._spare = np.empty((count, count))

    def of(self, position_ned_m: FloatArray) -> FloatArray:
        """Distances [m], shape (n, n), valid until the next call."""
        distance, spare = self._distance_m, self._spare
        for axis, out in ((0, distance), (1, spare)):
            np.subtract(position_ned_m[:, None, axis], position_ned_m[None, :, axis], out=out)
            np.multiply(out, out, out=out)
        np.add(distance, spare, out=distance)
        return np.sqrt(distance, out=distance)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _contact(gap: FloatArray, motion: FloatArray, touch_m: float, overlap_m: float) -> float | None:
    """Share of the step at which two airframes begin to touch, None if they never do.

    Horizontally they touch while the distance is below ``touch_m``, vertically while it is below ``overlap_m``; both
    are intervals of the step, and a collision is their intersection.
    """
    north, east, down = gap.tolist()
    to_north, to_east, to_down = motion.tolist()
    square = to_north**2 + to_east**2
    half = north * to_north + east * to_east
    rest = north**2 + east**2 - touch_m**2
    if square > 1e-18:
        root = half**2 - square * rest
        if root <= 0.0:
            return None
        enters, leaves = (-half - math.sqrt(root)) / square, (-half + math.sqrt(root)) / square
    elif rest < 0.0:
        enters, leaves = 0.0, 1.0
    else:
        return None
    if abs(to_down) > 1e-9:
        one, other = (-overlap_m - down) / to_down, (overlap_m - down) / to_down
        enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
    elif abs(down) >= overlap_m:
        return None
    enters, leaves = max(enters, 0.0), min(leaves, 1.0)
    return enters if enters <= leaves else None
