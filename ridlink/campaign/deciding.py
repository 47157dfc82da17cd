"""The batch kernel of a solver with its constants and scratch memory, as one call."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import graded, rotation, rows, worlds
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.roadmap import new_roadmap
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
        """Results, shape (W, N, RESULT_COLUMNS); arguments, and those that are written, as in
        `ridlink.avoidance.worlds`."""

    def keep(self, kept: BoolArray) -> None:
        """Keep only some worlds of the batch, shape (W,)."""


def new_decider(
    settings: HalfplaneSettings | GradedSettings | RotationSettings,
    shape: tuple[int, int],
    obstacles: Obstacles,
    *,
    threads: int = 1,
) -> Decider:
    """A decider with the solver of these settings.

    Args:
        settings: Constants.
        shape: Worlds and vehicles, (W, N).
        obstacles: Obstacles, the same in every world.
        threads: Number of threads for the worlds; results do not depend on it.
    """
    if isinstance(settings, HalfplaneSettings):
        return _Halfplanes(settings, shape, obstacles, threads)
    return _Headings(settings, shape, obstacles, threads)


class _Batched:
    """A kernel with its arguments; an axis of worlds is always the first one."""

    _kernel: Any
    _memories: tuple[Any, ...] = ()
    _constants: list[tuple[Any, ...]]
    """Arguments that are the same in every world, for each thread."""
    _scratch: tuple[Any, ...]

    def __init__(self, shape: tuple[int, int], threads: int) -> None:
        self._result = np.zeros((*shape, rows.RESULT_COLUMNS))
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def decide(
        self, own: FloatArray, deciding: BoolArray, heard: FloatArray, present: BoolArray, radius_m: FloatArray,
        error_sum_m: FloatArray, range_m: float,
    ) -> FloatArray:  # fmt: skip
        """See `Decider.decide`."""
        picture = (own, deciding, heard, present, radius_m, error_sum_m)
        room = (*self._scratch, self._result)
        if self._pool is None:
            self._kernel(*picture, range_m, *self._memories, *self._constants[0], *room)
        else:
            edges = [len(own) * k // len(self._constants) for k in range(len(self._constants) + 1)]

            def decide_part(edge: tuple[int, int], constants: tuple[Any, ...]) -> None:
                part = slice(*edge)
                mine, memories, scratch = (_of_worlds(one, part) for one in (picture, self._memories, room))
                self._kernel(*mine, range_m, *memories, *constants, *scratch)

            list(self._pool.map(decide_part, pairwise(edges), self._constants))
        return self._result[: len(own)]

    def keep(self, kept: BoolArray) -> None:
        """See `Decider.keep`; scratch memory may be larger than needed."""
        self._memories = tuple(each[kept] for each in self._memories)


def _of_worlds(arrays: tuple[Any, ...], part: slice) -> tuple[Any, ...]:
    """Some worlds of arrays, also in tuples of arrays."""
    return tuple(_of_worlds(each, part) if isinstance(each, tuple) else each[part] for each in arrays)


class _Headings(_Batched):
    """The solvers that choose among headings; they have no memory."""

    def __init__(
        self, settings: GradedSettings | RotationSettings, shape: tuple[int, int], obstacles: Obstacles, threads: int
    ) -> None:
        super().__init__(shape, threads)
        if isinstance(settings, RotationSettings):
            self._kernel = worlds.rotate_worlds
            fan = rotation.candidates(settings.step_deg, settings.left_weight)
        else:
            self._kernel = worlds.grade_worlds
            fan = graded.candidates()
        self._scratch = worlds.heading_scratch(*shape, obstacles)
        self._constants = [(obstacles.pieces, settings.as_vector(), fan)] * threads


class _Halfplanes(_Batched):
    """The half-plane solver, which remembers its encounters and the way round obstacles."""

    def __init__(self, settings: HalfplaneSettings, shape: tuple[int, int], obstacles: Obstacles, threads: int) -> None:
        super().__init__(shape, threads)
        self._kernel = worlds.avoid_worlds
        self._memories = (worlds.new_memory(*shape), np.zeros(shape, np.int64))
        self._scratch = worlds.halfplane_scratch(*shape, obstacles)
        self._constants = [(obstacles.pieces, new_roadmap(obstacles), settings.as_vector()) for _ in range(threads)]
