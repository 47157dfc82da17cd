"""Both tracks and the distance of an encounter over time, in bounded memory: a long one is kept more coarsely."""

from __future__ import annotations

from array import array

import numpy as np

from ridlink.observer import Encounter, Scene
from ridlink.observer.scene import FloatArray
from ridlink.separation.definitions import Definition

MAX_SAMPLES = 600


class Trace:
    """Tracks and distances of one encounter, for its pictures.

    Args:
        definitions: Definitions whose required distances are kept.
    """

    def __init__(self, definitions: tuple[Definition, ...]) -> None:
        self._definitions = definitions
        self._width = 6 + len(definitions)
        self._values = array("d")
        self._every = 1
        self._asked = 0

    def __len__(self) -> int:
        return len(self._values) // self._width

    def add(self, encounter: Encounter, scene: Scene) -> None:
        """Add the scene to the trace, if both aircraft are in it."""
        if encounter.seen_s != scene.time_s:
            return
        self._asked += 1
        if (self._asked - 1) % self._every:
            return
        i, j = (scene.numbers.index(number) for number in encounter.numbers)
        self._values.append(scene.time_s)
        self._values.extend(scene.position_ne_m[i])
        self._values.extend(scene.position_ne_m[j])
        self._values.append(encounter.distance_m)
        self._values.extend(encounter.required_m[definition] for definition in self._definitions)
        if len(self) > MAX_SAMPLES:
            self._values = array("d", self._table()[::2].ravel())
            self._every *= 2

    @property
    def time_s(self) -> FloatArray:
        """Times, shape (k,)."""
        return self._table()[:, 0]

    @property
    def tracks_ne_m(self) -> tuple[FloatArray, FloatArray]:
        """Positions of the two, shape (k, 2) each."""
        table = self._table()
        return table[:, 1:3], table[:, 3:5]

    @property
    def distance_m(self) -> FloatArray:
        """Distances of centres, shape (k,)."""
        return self._table()[:, 5]

    @property
    def required_m(self) -> dict[Definition, FloatArray]:
        """Radii of the discs, shape (k,) each."""
        table = self._table()
        return {definition: table[:, 6 + at] for at, definition in enumerate(self._definitions)}

    def _table(self) -> FloatArray:
        return np.array(self._values, np.float64).reshape(-1, self._width)
