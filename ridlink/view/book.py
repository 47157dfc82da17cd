"""The history under one definition: encounters, and the tightest pair of each time. It is read in slices."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ridlink.observer import Encounter, EncounterLog, Pairs, Phase, Scene
from ridlink.separation.definitions import Definition
from ridlink.view.instants import History, Instant

MOST_ENCOUNTERS = 500
MOST_POINTS = 2000
GONE_AFTER_S = 2.0
CROWD, IN_A_CROWD = 100, 5
"""With more than 100 vehicles, encounters are evaluated at every fifth instant, with straight flight in between."""

Seen = Callable[[Instant], tuple[Scene, Pairs, Pairs]]
"""An instant as a scene, its pairs that are or will be too near, and the pair with the least margin."""


class Book:
    """Encounters and tightest pairs of a history under one definition.

    Args:
        definition: Separation definition.
        history: The history.
        seen: Computes scene and pairs of an instant.

    Attributes:
        changes: Counter of changes of encounters.
        caught_up: Whether it has reached the end of the history at least once; from then on it keeps up.
    """

    def __init__(self, definition: Definition, history: History, seen: Seen) -> None:
        self.changes = 0
        self.definition = definition
        self._history = history
        self._seen = seen
        self._log = EncounterLog(definition, gone_after_s=GONE_AFTER_S, most=MOST_ENCOUNTERS)
        self._open: dict[tuple[int, int], tuple[int, Encounter]] = {}
        self._closed: deque[tuple[int, Encounter]] = deque(maxlen=MOST_ENCOUNTERS)
        self._met = 0
        self._next = self._first = history.first
        self.caught_up = self._next >= history.end
        self._least = array("f")

    @property
    def behind(self) -> int:
        """Instants that it has not read yet."""
        return self._history.end - max(self._next, self._history.first)

    def read(self) -> bool:
        """Read the next instant; False if there is none."""
        history = self._history
        if self._next >= history.end:
            return False
        if self._next < history.first:  # instants were forgotten before they were read
            self._least.extend([np.nan] * (2 * (history.first - self._next)))
            self._next = history.first
        moment = history.at(self._next)
        scene, pairs, tightest = self._seen(moment)
        self._least.extend((tightest.distance_m[0], tightest.radius_m[0]) if len(tightest) else (np.nan, np.nan))
        self._next += 1
        self.caught_up = self.caught_up or self._next >= history.end
        surplus = history.first - self._first
        if 4 * surplus > len(self._least) // 2:
            del self._least[: 2 * surplus]
            self._first = history.first
        if len(moment) <= CROWD or self._next % IN_A_CROWD == 0:
            for phase, encounter in self._log.step(scene, pairs):
                self._note(phase, encounter)
        return True

    def end(self) -> None:
        """The source has ended: open encounters end with the last instant."""
        for encounter in self._log.close():
            self._note(Phase.CLOSE, encounter)

    def encounters(self) -> list[tuple[int, Encounter]]:
        """The newest encounters with their ids, in order of time."""
        known = sorted([*self._closed, *self._open.values()], key=lambda one: one[0])
        return known[-MOST_ENCOUNTERS:]

    def series(self, from_s: float, to_s: float) -> tuple[float, float, NDArray[np.float64], bool]:
        """Distance and radius of the tightest pair, between two times.

        Returns:
            Time of the first bucket, length of a bucket, distance and radius in each, shape (n, 2), NaN if there is no
            pair; and whether the whole requested time has been read.
        """
        history = self._history
        extent = history.extent_s
        if extent is None:
            return from_s, 0.1, np.empty((0, 2)), True
        from_s, to_s = max(from_s, extent[0]), min(to_s, extent[1])
        first, last = history.find(from_s), history.find(to_s)
        if first is None or last is None or to_s < from_s:
            return from_s, 0.1, np.empty((0, 2)), True
        step_s = max(0.1 * 2**history.thinned, (to_s - from_s) / (MOST_POINTS - 1))
        read = range(first, min(last + 1, self._next))
        least = np.array(self._least, np.float64).reshape(-1, 2)[read.start - self._first : read.stop - self._first]
        times = np.array([history.at(number).time_s for number in read])
        bucket = np.clip(np.floor((times - from_s) / step_s + 1e-6), 0, MOST_POINTS - 1).astype(np.int64)
        result = np.full((1 + int(bucket.max(initial=-1)), 2), np.nan)
        known = ~np.isnan(least[:, 0])
        # The least margin is written last.
        order = np.argsort(-(least[known, 0] - least[known, 1]), kind="stable")
        result[bucket[known][order]] = least[known][order]
        return from_s, step_s, result, self._next > last

    def _note(self, phase: Phase, encounter: Encounter) -> None:
        self.changes += 1
        key = encounter.numbers
        if phase is Phase.OPEN:
            self._met += 1
            self._open[key] = self._met, encounter
        elif phase is Phase.CLOSE:
            number, _ = self._open.pop(key)
            if not encounter.mistaken:
                self._closed.append((number, encounter))
