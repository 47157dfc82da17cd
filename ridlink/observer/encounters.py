"""Encounters of pairs: opened before the pair meets, followed, and closed.

An encounter under a definition opens when a pair is inside its disc, or would enter it within the horizon if both flew
on. It closes when neither has been true for some time and the two have flown apart for the same time, or when one of
them is gone. Between two instants aircraft fly straight, and the closest approach is computed on these lines.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from ridlink.observer.discs import discs_at
from ridlink.observer.pairs import Pairs, pairs_at, pairs_of
from ridlink.observer.scene import FloatArray, Scene
from ridlink.separation.definitions import Definition, bounded_airframe

Point = tuple[float, float]
"""A place or a velocity, north and east."""

CLOSES_AFTER_S = 3.0
ABANDONED_AFTER_S = 60.0
"""A pair that still comes nearer this long after its last alert, as in slow overtaking, is no encounter any more."""

MOVED_MPS = 1.0
"""An aircraft that changed its velocity by more than this between the opening and the closest approach has
manoeuvred."""


class Phase(StrEnum):
    """Phase of an encounter."""

    OPEN = "open"
    UPDATE = "update"
    CLOSE = "close"


@dataclass(slots=True, eq=False)
class Encounter:
    """One encounter of a pair.

    Attributes:
        numbers: Numbers of the two, the lower first.
        pair: Names of the two, in the same order; the newest ones, if an identity was heard later.
        opened_s, closed_s: Start and end; the end is None while it continues.
        closest_s, closest_m: Time and distance of the closest approach so far, between centres.
        margin_m: Least distance less the radius of the disc, by definition.
        inside_s: Time spent inside the disc, by definition [s].
        airframes_m: Distance of centres at which the airframes would touch.
        manoeuvre_mps: How much each of the two changed its velocity until the closest approach.
        closest_errors_m: Reported error bounds of the two at the closest approach, NaN where unknown.
        closest_above_m: How much higher the second one was then, NaN if unknown.
        entry_in_s: Time until the disc is entered if both fly on, 0 inside, infinite if never; at the last step.
        distance_m, required_m: Distance, and radius of the disc by definition, at `seen_s`, the last step in which both
            were heard.
        mistaken: Whether one of the two turned out to be a known aircraft, heard over another link: no such encounter
            existed.
        last_alert_s, last_closing_s: Last time of an alert (inside the disc or about to enter it), and last time the
            two came nearer.
        opening_velocities: Velocities of the two when it opened [m/s], shape (2,) each.
    """

    numbers: tuple[int, int]
    pair: tuple[str, str]
    opened_s: float
    airframes_m: float
    closed_s: float | None = None
    closest_s: float = math.nan
    closest_m: float = math.inf
    margin_m: dict[Definition, float] = field(default_factory=dict)
    inside_s: dict[Definition, float] = field(default_factory=dict)
    manoeuvre_mps: tuple[float, float] = (0.0, 0.0)
    closest_errors_m: tuple[float, float] = (math.nan, math.nan)
    closest_above_m: float = math.nan
    entry_in_s: float = math.inf
    distance_m: float = math.nan
    required_m: dict[Definition, float] = field(default_factory=dict)
    seen_s: float = math.nan
    mistaken: bool = False
    last_alert_s: float = math.nan
    last_closing_s: float = -math.inf
    opening_velocities: tuple[FloatArray, FloatArray] | None = None

    @property
    def collided(self) -> bool:
        """Whether the reported airframes touched at the reported positions."""
        return self.closest_m < self.airframes_m

    @property
    def moved(self) -> tuple[str, ...]:
        """Names of those of the two that manoeuvred."""
        return tuple(
            name for name, change in zip(self.pair, self.manoeuvre_mps, strict=True) if change > MOVED_MPS
        )  # fmt: skip


class EncounterLog:
    """Follows all pairs of a sky.

    Args:
        definition: Definition whose discs open encounters.
        also: Further definitions whose margins are kept.
        gone_after_s: Silence of one aircraft that ends its encounters; the end is then the time when both were last
            heard.
        most: Limit of encounters followed at a time; of more, those that come first are followed. None for no limit:
            their number can be that of all pairs, and a flood can make thousands of aircraft.

    Attributes:
        open: Open encounters, by the numbers of the pair.
    """

    def __init__(
        self,
        definition: Definition = Definition.CANDIDATE2,
        *,
        also: Sequence[Definition] = (),
        gone_after_s: float = 0.0,
        most: int | None = None,
    ) -> None:
        self.open: dict[tuple[int, int], Encounter] = {}
        self.definition = definition
        self._definitions = tuple(dict.fromkeys((definition, *also)))
        self._gone_after_s = gone_after_s
        self._most = most
        self._before_s = math.nan
        self._places: dict[int, Point] = {}

    def step(self, scene: Scene, pairs: Pairs | None = None) -> list[tuple[Phase, Encounter]]:
        """Changes since the previous scene: encounters that opened, continue, or closed.

        Args:
            scene: All aircraft, later than the previous scene.
            pairs: Its pairs under the definition of this log, if they are known already.
        """
        before_s, self._before_s = self._before_s, scene.time_s
        places_before, self._places = self._places, dict(zip(scene.numbers, _points(scene.position_ne_m), strict=True))
        velocities = dict(zip(scene.numbers, _points(scene.velocity_ne_mps), strict=True))
        index = {number: at for at, number in enumerate(scene.numbers)}
        changes: list[tuple[Phase, Encounter]] = []
        pairs = pairs_of(scene, self.definition) if pairs is None else pairs
        for i, j in self._alerts(pairs):
            key = _ordered(scene.numbers[i], scene.numbers[j])
            if key not in self.open:
                self.open[key] = self._opened(key, scene, index)
                changes.append((Phase.OPEN, self.open[key]))
            self.open[key].last_alert_s = scene.time_s
        if self._most is not None and len(self.open) > self._most:
            surplus = len(self.open) - self._most
            for key in heapq.nsmallest(surplus, self.open, key=lambda key: self.open[key].last_alert_s):
                changes.append((Phase.CLOSE, self._closed(key)))
        present = self._present(scene, index)
        for key, encounter in list(self.open.items()):
            if key in present:
                i, j = index[key[0]], index[key[1]]
                encounter.pair = scene.names[i], scene.names[j]
                encounter.entry_in_s, apart, *radius = present[key]
                encounter.required_m = dict(zip(self._definitions, radius, strict=True))
                now = _between(self._places, key)
                was = _between(places_before, key) if key[0] in places_before and key[1] in places_before else None
                self._follow(encounter, scene, (i, j), now, was, before_s, apart=bool(apart))
                clear_s = scene.time_s - encounter.last_alert_s
                to_north, to_east = _between(velocities, key)
                if now[0] * to_north + now[1] * to_east < 0.0:  # they come nearer
                    encounter.last_closing_s = scene.time_s
                parting_s = scene.time_s - max(encounter.last_alert_s, encounter.last_closing_s)
                if clear_s <= ABANDONED_AFTER_S and parting_s <= CLOSES_AFTER_S:
                    if encounter.opened_s < scene.time_s:
                        changes.append((Phase.UPDATE, encounter))
                    continue
            elif not scene.merged.isdisjoint(key):
                encounter.mistaken = True
            elif scene.time_s - encounter.seen_s <= self._gone_after_s:
                continue
            changes.append((Phase.CLOSE, self._closed(key)))
        return changes

    def _alerts(self, pairs: Pairs) -> Iterator[tuple[int, int]]:
        """Pairs that are inside their discs, or would enter them within the horizon."""
        first, second = pairs.first, pairs.second
        if self._most is not None and len(pairs) > self._most:
            soonest = np.argsort(pairs.entry_s, kind="stable")[: self._most]
            first, second = first[soonest], second[soonest]
        return zip(first.tolist(), second.tolist(), strict=True)

    def _present(self, scene: Scene, index: dict[int, int]) -> dict[tuple[int, int], list[float]]:
        """For open pairs with both aircraft present: time until the disc is entered, whether they are apart, radii of
        the discs under every definition."""
        keys = [key for key in self.open if key[0] in index and key[1] in index]
        if not keys:  # as in most scenes
            return {}
        first, second = np.array([(index[one], index[other]) for one, other in keys], np.intp).reshape(-1, 2).T
        pairs = pairs_at(scene, first, second, self.definition)
        radii = [discs_at(scene, first, second, definition) for definition in self._definitions[1:]]
        facts = np.column_stack([pairs.entry_s, pairs.apart, pairs.radius_m, *radii])
        return dict(zip(keys, facts.tolist(), strict=True))

    def close(self) -> Iterator[Encounter]:
        """Close all open encounters, at the end of a recording."""
        for key in list(self.open):
            yield self._closed(key)

    def _opened(self, key: tuple[int, int], scene: Scene, index: dict[int, int]) -> Encounter:
        i, j = index[key[0]], index[key[1]]
        airframes = bounded_airframe(scene.airframe_m[[i, j]])
        velocities = scene.velocity_ne_mps[i].copy(), scene.velocity_ne_mps[j].copy()
        pair = scene.names[i], scene.names[j]
        return Encounter(key, pair, scene.time_s, float(airframes.sum() / 2.0), opening_velocities=velocities)

    def _closed(self, key: tuple[int, int]) -> Encounter:
        encounter = self.open.pop(key)
        encounter.closed_s = encounter.seen_s
        return encounter

    def _follow(
        self,
        encounter: Encounter,
        scene: Scene,
        at: tuple[int, int],
        now: Point,
        was: Point | None,
        before_s: float,
        *,
        apart: bool,
    ) -> None:
        i, j = at
        distance, when = math.hypot(*now), scene.time_s
        encounter.distance_m, encounter.seen_s = distance, scene.time_s
        if apart:  # they pass above each other
            return
        lasted_s = 0.0
        if was is not None:
            lasted_s = scene.time_s - before_s
            share, distance = _nearest_of_segment(was, now)
            when = before_s + share * lasted_s
        if distance < encounter.closest_m:
            encounter.closest_m, encounter.closest_s = distance, when
            encounter.closest_errors_m = float(scene.error_bound_m[i]), float(scene.error_bound_m[j])
            encounter.closest_above_m = float(scene.altitude_m[j] - scene.altitude_m[i])
            if encounter.opening_velocities is not None:
                first, second = encounter.opening_velocities
                encounter.manoeuvre_mps = (
                    float(np.hypot(*(scene.velocity_ne_mps[i] - first))),
                    float(np.hypot(*(scene.velocity_ne_mps[j] - second))),
                )
        for definition, radius in encounter.required_m.items():
            margin = distance - radius
            encounter.margin_m[definition] = min(margin, encounter.margin_m.get(definition, math.inf))
            inside = lasted_s if margin < 0.0 else 0.0
            encounter.inside_s[definition] = encounter.inside_s.get(definition, 0.0) + inside


def _points(rows: FloatArray) -> list[Point]:
    """Rows of an array, shape (n, 2), as numbers: for one pair they are several times as fast as arrays."""
    return [(north, east) for north, east in rows.tolist()]


def _between(points: dict[int, Point], pair: tuple[int, int]) -> Point:
    """From the first of a pair to the second."""
    (north, east), (to_north, to_east) = points[pair[0]], points[pair[1]]
    return to_north - north, to_east - east


def _ordered(one: int, other: int) -> tuple[int, int]:
    return (one, other) if one <= other else (other, one)


def _nearest_of_segment(start: Point, end: Point) -> tuple[float, float]:
    """Point of a segment nearest to the origin, as a share of its length, and its distance."""
    north, east = end[0] - start[0], end[1] - start[1]
    square = north * north + east * east
    share = 0.0 if square == 0.0 else min(1.0, max(0.0, -(start[0] * north + start[1] * east) / square))
    return share, math.hypot(start[0] + share * north, start[1] + share * east)
