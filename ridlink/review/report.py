"""The encounters of recorded traffic: each as a row when it is over, and the worst with their traces."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ridlink.observer import Encounter, EncounterLog, Phase, Scene
from ridlink.observer.sky import FORGET_AFTER_S
from ridlink.observer.states import rounded
from ridlink.review.approach import nearest_since
from ridlink.review.traces import Trace
from ridlink.separation.definitions import Definition

MAX_TRACED = 500
"""Most encounters traced at the same time; further ones get rows but no pictures."""


@dataclass(frozen=True, slots=True)
class Met:
    """An encounter that is over.

    Attributes:
        row: Its figures, from `encounter_row`.
        trace: Its trace for pictures, None if it was not traced.
    """

    row: dict[str, Any]
    trace: Trace | None

    @property
    def margin_m(self) -> float:
        """Least margin under the definition that opened it."""
        margin: float = self.row["margin_m"][self.row["definition"]]
        return margin


@dataclass(frozen=True, slots=True)
class Closest:
    """The closest approach of all.

    Attributes:
        pair: Names of the pair.
        time_s: Time, seconds since 1970.
        distance_m: Distance of centres.
        error_bounds_m: Reported three-sigma errors, NaN where unknown.
    """

    pair: tuple[str, str]
    time_s: float
    distance_m: float
    error_bounds_m: tuple[float, float]


class Report:
    """Watches scenes for encounters.

    Args:
        definition: The definition whose discs open encounters.
        on_encounter: Called with the row of each encounter when it is over.
        keep: How many encounters, those with the least margins, are kept for a page.
        traced: Keep their traces for pictures as well.

    Attributes:
        encounters: Number of encounters.
        closest: The closest approach of all, in an encounter or not; None if there were never two aircraft.
    """

    def __init__(
        self,
        definition: Definition = Definition.CANDIDATE2,
        on_encounter: Callable[[dict[str, Any]], None] = lambda row: None,
        *,
        keep: int = 0,
        traced: bool = True,
    ) -> None:
        self.encounters = 0
        self.closest: Closest | None = None
        self._definition = definition
        self._on_encounter = on_encounter
        self._keep = keep
        self._traced = traced and keep > 0
        self._worst: list[tuple[float, int, Met]] = []
        self._numbers = itertools.count()
        self._begin()

    def _begin(self) -> None:
        self._log = EncounterLog(self._definition, also=tuple(Definition), gone_after_s=FORGET_AFTER_S)
        self._traces: dict[tuple[int, int], Trace] = {}
        self._before: Scene | None = None

    def step(self, scene: Scene) -> None:
        """Take the next scene."""
        for phase, encounter in self._log.step(scene):
            if phase is Phase.CLOSE:
                self._over(encounter, at_end=False)
                continue
            if phase is Phase.OPEN and self._traced and len(self._traces) < MAX_TRACED:
                self._traces[encounter.numbers] = Trace(tuple(Definition))
            trace = self._traces.get(encounter.numbers)
            if trace is not None:
                trace.add(encounter, scene)
        self._look_for_the_closest(scene)

    def end(self) -> None:
        """Finish: the recording is over."""
        for encounter in self._log.close():
            self._over(encounter, at_end=True)
        self._begin()

    def worst(self) -> list[Met]:
        """The encounters that were kept, the least margin first."""
        return [met for _, _, met in sorted(self._worst, reverse=True)]

    def _over(self, encounter: Encounter, *, at_end: bool) -> None:
        trace = self._traces.pop(encounter.numbers, None)
        if encounter.mistaken:
            return
        self.encounters += 1
        met = Met(encounter_row(encounter, self._definition, at_end=at_end), trace)
        self._on_encounter(met.row)
        if self._keep:
            heapq.heappush(self._worst, (-met.margin_m, -next(self._numbers), met))
            if len(self._worst) > self._keep:
                heapq.heappop(self._worst)

    def _look_for_the_closest(self, scene: Scene) -> None:
        before, self._before = self._before, scene
        if len(scene) < 2:
            return
        closest_m = math.inf if self.closest is None else self.closest.distance_m
        approach = nearest_since(before, scene, closest_m)
        if not len(approach.first):
            return
        at = approach.distance_m.argmin()
        i, j, distance_m = approach.first[at], approach.second[at], float(approach.distance_m[at])
        if distance_m < closest_m:
            errors = float(scene.error_bound_m[i]), float(scene.error_bound_m[j])
            pair = scene.names[i], scene.names[j]
            self.closest = Closest(pair, float(approach.time_s[at]), distance_m, errors)


def encounter_row(encounter: Encounter, definition: Definition, *, at_end: bool = False) -> dict[str, Any]:
    """An encounter as a JSON object; unknown values are None.

    Args:
        encounter: An encounter that is over.
        definition: The definition that opened it.
        at_end: Whether it is over only because the recording is.
    """
    return {
        "uas": list(encounter.pair),
        "definition": str(definition),
        "start_t": round(encounter.opened_s, 3),
        "end_t": rounded(encounter.closed_s, 3),
        "closest_t": rounded(encounter.closest_s, 3),
        "closest_m": rounded(encounter.closest_m),
        "closest_vertical_m": rounded(encounter.closest_above_m),
        "horizontal_error_m": [rounded(error) for error in encounter.closest_errors_m],
        "mac_distance_m": rounded(encounter.airframes_m),
        "mac": encounter.collided,
        "margin_m": {str(kind): rounded(encounter.margin_m[kind]) for kind in Definition},
        "inside_s": {str(kind): round(encounter.inside_s[kind], 1) for kind in Definition},
        "moved": list(encounter.moved),
        "manoeuvre_mps": [rounded(change) for change in encounter.manoeuvre_mps],
        "at_end": at_end,
    }
