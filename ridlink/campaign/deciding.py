"""The batch kernel of a solver with its constants and its scratch, behind one call."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import graded, rotation, rows, worlds
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.roadmap import Roadmap
from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Decider(Protocol):
    """Decides for batches of worlds."""

    def decide(
        self,
        own: FloatArray,
        deciding: BoolArray,
        heard: FloatArray,
        present: BoolArray,
        radius_m: FloatArray,
        error_sum_m: FloatArray,
        range_m: float,
    ) -> FloatArray:
        """Results, shape (W, N, RESULT_COLUMNS); arguments as in `ridlink.avoidance.worlds`, and so is what of them is
        filled in."""

    def keep(self, kept: BoolArray) -> None:
        """Go on with some worlds of the batch only, shape (W,)."""


def new_decider(
    settings: HalfplaneSettings | GradedSettings | RotationSettings,
    shape: tuple[int, int],
    obstacles: Obstacles,
    *,
    threads: int = 1,
) -> Decider:
    """A decider of the solver whose settings these are.

    Args:
        settings: Constants.
        shape: Worlds and vehicles, (W, N).
        obstacles: The same in every world.
        threads: Threads among which the worlds are divided; answers do not depend on it.
    """
    decider: _Headings | _Halfplanes
    if isinstance(settings, HalfplaneSettings):
        decider = _Halfplanes(settings, shape, obstacles)
    else:
        decider = _Headings(settings, shape, obstacles)
    if threads > 1:
        decider.pool, decider.threads = ThreadPoolExecutor(threads), threads
    return decider


class _Batched:
    """A kernel with its arguments: whatever has an axis of worlds, it is the first one."""

    pool: ThreadPoolExecutor | None = None
    threads = 1

    _kernel: Any
    _memories: tuple[Any, ...] = ()
    _constants: tuple[Any, ...]
    _scratch: tuple[Any, ...]
    _result: FloatArray

    def decide(
        self, own: FloatArray, deciding: BoolArray, heard: FloatArray, present: BoolArray, radius_m: FloatArray,
        error_sum_m: FloatArray, range_m: float,
    ) -> FloatArray:  # fmt: skip
        """See `Decider.decide`."""
        picture = (own, deciding, heard, present, radius_m, error_sum_m)
        room = (*self._scratch, self._result)
        if self.pool is None:
            self._kernel(*picture, range_m, *self._memories, *self._constants, *room)
        else:
            edges = [len(own) * k // self.threads for k in range(self.threads + 1)]

            def decide_part(edge: tuple[int, int]) -> None:
                part = slice(*edge)
                mine, memories, scratch = (_of_worlds(one, part) for one in (picture, self._memories, room))
                self._kernel(*mine, range_m, *memories, *self._constants, *scratch)

            list(self.pool.map(decide_part, pairwise(edges)))
        return self._result[: len(own)]

    def keep(self, kept: BoolArray) -> None:
        """See `Decider.keep`; scratch may be too large."""
        self._memories = tuple(each[kept] for each in self._memories)


def _of_worlds(arrays: tuple[Any, ...], part: slice) -> tuple[Any, ...]:
    """Some worlds of arrays, and of tuples of arrays."""
    return tuple(_of_worlds(each, part) if isinstance(each, tuple) else each[part] for each in arrays)


class _Headings(_Batched):
    """The solvers that choose among headings; they remember nothing."""

    def __init__(
        self, settings: GradedSettings | RotationSettings, shape: tuple[int, int], obstacles: Obstacles
    ) -> None:
        if isinstance(settings, RotationSettings):
            self._kernel = worlds.rotate_worlds
            fan = rotation.candidates(settings.step_deg, settings.left_weight)
        else:
            self._kernel = worlds.grade_worlds
            fan = graded.candidates()
        self._scratch = worlds.heading_scratch(*shape, obstacles)
        self._constants = (obstacles.pieces, settings.as_vector(), fan)
        self._result = np.zeros((*shape, rows.RESULT_COLUMNS))


class _Halfplanes(_Batched):
    """The half-plane solver, which remembers its encounters and the way round obstacles."""

    def __init__(self, settings: HalfplaneSettings, shape: tuple[int, int], obstacles: Obstacles) -> None:
        self._kernel = worlds.avoid_worlds
        self._memories = (worlds.new_memory(*shape), np.zeros(shape, np.int64))
        self._obstacles, self._roadmap, self._settings = obstacles, Roadmap(obstacles), settings.as_vector()
        self._scratch = worlds.halfplane_scratch(*shape, obstacles)
        self._result = np.zeros((*shape, rows.RESULT_COLUMNS))

    def decide(
        self, own: FloatArray, deciding: BoolArray, heard: FloatArray, present: BoolArray, radius_m: FloatArray,
        error_sum_m: FloatArray, range_m: float,
    ) -> FloatArray:  # fmt: skip
        """See `Decider.decide`; the ways of own-ships are filled in."""
        ways = self._roadmap.ways(own, self._settings, self._obstacles)
        self._constants = (self._obstacles.pieces, ways, self._settings)
        return super().decide(own, deciding, heard, present, radius_m, error_sum_m, range_m)
