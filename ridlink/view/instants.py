"""Every tenth of a second as a compact array, and a history of them within a memory limit.

An instant is one row of 32-bit numbers for each vehicle; tuples of names and numbers are shared between instants as
long as the set of vehicles does not change. Positions within 100 km of the origin are exact to a centimetre.
"""

from __future__ import annotations

import sys
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ridlink.observer import Scene
from ridlink.view.scenery import Pair

Table = NDArray[np.float32]

SINGLE = ("speed_mps", "airframe_m", "error_bound_m", "accuracy_bound_m", "interval_s", "age_s", "altitude_m",
          "climb_mps", "vertical_error_m", "airframe_height_m", "avoiding")  # fmt: skip
"""Columns of a scene that are one number, in the order of a table behind the pairs."""

POSITION, VELOCITY, COMMAND, TRUTH, FIRST_SINGLE = 0, 2, 4, 6, 8
COLUMNS = FIRST_SINGLE + len(SINGLE)

MEMORY_BYTES = 64 * 2**20
OVERHEAD_BYTES = 320
"""Bytes of an instant in addition to its numbers: its Python objects."""


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """All vehicles at one instant.

    Attributes:
        time_s: Time on the clock of the source.
        numbers, names: As in `Scene`.
        table: One row per vehicle, shape (n, COLUMNS), NaN if unknown.
        merged: As in `Scene`.
    """

    time_s: float
    numbers: tuple[int, ...]
    names: tuple[str, ...]
    table: Table
    merged: frozenset[int] = frozenset()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def truth_ne_m(self) -> Table:
        """True positions, NaN if unknown, shape (n, 2)."""
        return self.table[:, TRUTH : TRUTH + 2]

    def scene(self) -> Scene:
        """The scene of the instant, in single precision."""
        table = self.table.astype(np.float64)
        single = {name: table[:, FIRST_SINGLE + place] for place, name in enumerate(SINGLE)}
        return Scene(
            time_s=self.time_s,
            numbers=self.numbers,
            names=self.names,
            position_ne_m=table[:, POSITION : POSITION + 2],
            velocity_ne_mps=table[:, VELOCITY : VELOCITY + 2],
            command_ne_mps=table[:, COMMAND : COMMAND + 2],
            merged=self.merged,
            **(single | {"avoiding": single["avoiding"] > 0.0}),  # type: ignore[arg-type]
        )


def instant_of(scene: Scene, truth: Mapping[str, Pair] | None = None, before: Instant | None = None) -> Instant:
    """The instant of a scene.

    Args:
        scene: All vehicles.
        truth: True positions by name.
        before: The previous instant, whose tuples are reused if they are equal.
    """
    table = np.full((len(scene), COLUMNS), np.nan, np.float32)
    table[:, POSITION : POSITION + 2] = scene.position_ne_m
    table[:, VELOCITY : VELOCITY + 2] = scene.velocity_ne_mps
    table[:, COMMAND : COMMAND + 2] = scene.command_ne_mps
    for place, name in enumerate(SINGLE):
        table[:, FIRST_SINGLE + place] = getattr(scene, name)
    if truth:
        for row, name in enumerate(scene.names):
            if name in truth:
                table[row, TRUTH : TRUTH + 2] = truth[name]
    numbers, names, merged = scene.numbers, scene.names, scene.merged
    if before is not None:
        numbers = before.numbers if before.numbers == numbers else numbers
        names = before.names if before.names == names else names
        merged = before.merged if before.merged == merged else merged
    return Instant(scene.time_s, numbers, names, table, merged)


class History:
    """Instants in the order of time, within a memory limit.

    Args:
        memory_bytes: The limit.
        keeps_all: At the limit, drop every second instant instead of the oldest: for sources that end.

    Attributes:
        first: Sequence number of the oldest instant that is kept; they count up from 0.
        bytes: Memory of all instants.
        thinned: How many times every second instant was dropped.
    """

    def __init__(self, memory_bytes: int = MEMORY_BYTES, *, keeps_all: bool = False) -> None:
        self.first = 0
        self.bytes = 0
        self.thinned = 0
        self._memory_bytes = memory_bytes
        self._keeps_all = keeps_all
        self._instants: list[Instant] = []
        self._sizes: list[int] = []
        self._gone = 0

    def __len__(self) -> int:
        return len(self._instants) - self._gone

    def __iter__(self) -> Iterator[Instant]:
        return iter(self._instants[self._gone :])

    @property
    def end(self) -> int:
        """Sequence number of the next instant."""
        return self.first + len(self)

    @property
    def extent_s(self) -> tuple[float, float] | None:
        """Times of the first and the last instant; None if there are none."""
        return (self._instants[self._gone].time_s, self._instants[-1].time_s) if len(self) else None

    def add(self, instant: Instant) -> int:
        """Add the next instant; returns its sequence number."""
        before = self._instants[-1] if len(self) else None
        size = OVERHEAD_BYTES + instant.table.nbytes
        if before is None or before.names is not instant.names:
            size += sys.getsizeof(instant.names) + sum(map(sys.getsizeof, instant.names))
        if before is None or before.numbers is not instant.numbers:
            size += sys.getsizeof(instant.numbers) + 32 * len(instant.numbers)
        self._instants.append(instant)
        self._sizes.append(size)
        self.bytes += size
        while self.bytes > self._memory_bytes and len(self) > 1:
            self._make_room()
        return self.end - 1

    def at(self, sequence: int) -> Instant:
        """The instant with that number.

        Raises:
            IndexError: If it is not kept, or not there yet.
        """
        if not self.first <= sequence < self.end:
            raise IndexError(f"instant {sequence} is not within {self.first} to {self.end - 1}")
        return self._instants[self._gone + sequence - self.first]

    def find(self, time_s: float) -> int | None:
        """Number of the last instant at or before that time; of the first if all are later; None if there are none."""
        if not len(self):
            return None
        place = bisect_right(self._instants, time_s, lo=self._gone, key=lambda one: one.time_s) - 1
        return self.first + max(place - self._gone, 0)

    def _make_room(self) -> None:
        if self._keeps_all:
            self._instants = self._instants[self._gone :: 2]
            self._sizes = self._sizes[self._gone :: 2]
            self.thinned += 1
            self._gone = self.first = 0
            self.bytes = sum(self._sizes)
            return
        self.bytes -= self._sizes[self._gone]
        self._instants[self._gone] = _NOTHING
        self._gone += 1
        self.first += 1
        if 2 * self._gone > len(self._instants):
            del self._instants[: self._gone], self._sizes[: self._gone]
            self._gone = 0


_NOTHING = Instant(float("-inf"), (), (), np.empty((0, COLUMNS), np.float32))
