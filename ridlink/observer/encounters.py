"""Who comes near whom: encounters of pairs, opened while they are still to come, followed, and closed.

An encounter of a definition opens when a pair is inside its disc, or would enter it within the horizon if both flew on.
It closes when neither was so for a while and the two have flown apart as long, or one of them is gone. Between two
instants everybody flies straight, and the closest approach is taken on that line.
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

CLOSES_AFTER_S = 3.0
ABANDONED_AFTER_S = 60.0
"""A pair that still comes nearer so long after its way was clear, as in a slow overtaking, is no encounter any more."""

MOVED_MPS = 1.0
"""Who changed its velocity by more than this between the opening and the closest approach has manoeuvred."""


class Phase(StrEnum):
    """Where an encounter stands."""

    OPEN = "open"
    UPDATE = "update"
    CLOSE = "close"


@dataclass(slots=True, eq=False)
class Encounter:
    """A pair that comes near each other.

    Attributes:
        numbers: Of the two, the lower first.
        pair: Names of the two, in order; the latest, if an identity was heard meanwhile.
        opened_s, closed_s: When; the latter None while it goes on.
        closest_s, closest_m: Time and distance of the closest approach so far, between centres.
        margin_m: Least distance less the radius of the disc, by definition.
        inside_s: Time spent inside the disc, by definition [s].
        airframes_m: Distance of centres at which the airframes would touch.
        manoeuvre_mps: How much each of the two changed its velocity until the closest approach.
        closest_errors_m: Reported error bounds of the two at the closest approach, NaN where unknown.
        closest_above_m: How much higher the second flew there, NaN if that is unknown.
        entry_in_s: Time until the disc is entered if both fly on, 0 inside, infinite if never; of the last step.
        distance_m, required_m: Distance, and radius of the disc by definition; of the last step in which both were
            heard, which is at `seen_s`.
        mistaken: One of the two turned out to be somebody else, heard over another way: there was no such encounter.
        last_alert_s, last_closing_s: When the disc was last entered or about to be, and when the two last came nearer.
        opening_velocities: How the two flew when it opened [m/s], shape (2,) each.
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
        """The reported airframes touched, by reported positions."""
        return self.closest_m < self.airframes_m

    @property
    def moved(self) -> tuple[str, ...]:
        """Who of the two manoeuvred."""
        return tuple(
            name for name, change in zip(self.pair, self.manoeuvre_mps, strict=True) if change > MOVED_MPS
        )  # fmt: skip


class EncounterLog:
    """Follows all pairs of a sky.

    Args:
        definition: Whose discs open encounters.
        also: Definitions whose margins are kept beside.
        gone_after_s: Silence of one of a pair that ends its encounter, which then ended when both were last heard.
        most: Encounters that are followed at a time; of more, those that come first. None for all: their number is that
            of pairs, and whoever floods an observer makes some thousand aircraft.

    Attributes:
        open: Encounters that go on, by the numbers of the pair.
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
        self._before: Scene | None = None
        self._index: dict[int, int] = {}

    def step(self, scene: Scene, pairs: Pairs | None = None) -> list[tuple[Phase, Encounter]]:
        """What changed since the scene before: encounters that opened, go on, or have closed.

        Args:
            scene: Everybody, later than the scene before.
            pairs: Its pairs under the definition of this log, if they are known already.
        """
        before, self._before = self._before, scene
        index_before, self._index = self._index, {number: at for at, number in enumerate(scene.numbers)}
        index = self._index
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
                was = None if before is None else (index_before.get(key[0]), index_before.get(key[1]))
                encounter.required_m = dict(zip(self._definitions, radius, strict=True))
                self._follow(encounter, scene, before, (i, j), was, apart=bool(apart))
                clear_s = scene.time_s - encounter.last_alert_s
                if _closing(scene, i, j):
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
        """Of the open pairs that are both here: time until the disc is entered, whether they are apart, radii of the
        discs under every definition."""
        keys = [key for key in self.open if key[0] in index and key[1] in index]
        first, second = np.array([(index[one], index[other]) for one, other in keys], np.intp).reshape(-1, 2).T
        pairs = pairs_at(scene, first, second, self.definition)
        radii = [discs_at(scene, first, second, definition) for definition in self._definitions[1:]]
        facts = np.column_stack([pairs.entry_s, pairs.apart, pairs.radius_m, *radii])
        return dict(zip(keys, facts.tolist(), strict=True))

    def close(self) -> Iterator[Encounter]:
        """Close what is still open; the end of a recording."""
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
        before: Scene | None,
        at: tuple[int, int],
        was_at: tuple[int | None, int | None] | None,
        *,
        apart: bool,
    ) -> None:
        i, j = at
        now = scene.position_ne_m[j] - scene.position_ne_m[i]
        distance, when = float(np.hypot(*now)), scene.time_s
        encounter.distance_m, encounter.seen_s = distance, scene.time_s
        if apart:  # they pass above each other
            return
        lasted_s = 0.0
        if before is not None and was_at is not None and was_at[0] is not None and was_at[1] is not None:
            was = before.position_ne_m[was_at[1]] - before.position_ne_m[was_at[0]]
            lasted_s = scene.time_s - before.time_s
            share, distance = _nearest_of_segment(was, now)
            when = before.time_s + share * lasted_s
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


def _closing(scene: Scene, i: int, j: int) -> bool:
    offset = scene.position_ne_m[j] - scene.position_ne_m[i]
    return float(offset @ (scene.velocity_ne_mps[j] - scene.velocity_ne_mps[i])) < 0.0


def _ordered(one: int, other: int) -> tuple[int, int]:
    return (one, other) if one <= other else (other, one)


def _nearest_of_segment(start: FloatArray, end: FloatArray) -> tuple[float, float]:
    """Where between two points the origin is nearest, as a share of the way, and how far that is."""
    way = end - start
    square = float(way @ way)
    share = 0.0 if square == 0.0 else min(1.0, max(0.0, -float(start @ way) / square))
    return share, float(np.hypot(*(start + share * way)))
