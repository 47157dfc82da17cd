"""The batch kernel of a solver with its constants and its scratch, behind one call."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import graded, headings, rotation, rows, worlds
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.programme import new_lines
from ridlink.avoidance.route import ring_size
from ridlink.avoidance.settings import GradedSettings, RotationSettings
from ridlink.avoidance.types import HalfplaneSettings

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
        """Results, shape (W, N, RESULT_COLUMNS); arguments as in `ridlink.avoidance.worlds`."""

    def keep(self, kept: BoolArray) -> None:
        """Go on with some worlds of the batch only, shape (W,)."""


def new_decider(
    settings: HalfplaneSettings | GradedSettings | RotationSettings, shape: tuple[int, int], obstacles: Obstacles
) -> Decider:
    """A decider of the solver whose settings these are.

    Args:
        settings: Constants.
        shape: Worlds and vehicles, (W, N).
        obstacles: The same in every world.
    """
    if isinstance(settings, HalfplaneSettings):
        return _Halfplanes(settings, shape, obstacles)
    return _Headings(settings, shape, obstacles)


class _Headings:
    """The solvers that choose among headings; they remember nothing."""

    def __init__(
        self, settings: GradedSettings | RotationSettings, shape: tuple[int, int], obstacles: Obstacles
    ) -> None:
        if isinstance(settings, RotationSettings):
            self._kernel: Any = worlds.rotate_worlds
            fan = rotation.candidates(settings.step_deg, settings.left_weight)
        else:
            self._kernel = worlds.grade_worlds
            fan = graded.candidates()
        self._constants = (obstacles.piece_vertex_ne_m, obstacles.piece_start, settings.as_vector(), fan)
        count = shape[0]
        self._scratch = (
            np.zeros((*shape, rows.NEIGHBOUR_COLUMNS)),
            np.zeros((*shape, headings.SIGHT_COLUMNS)),
            np.zeros((count, obstacles.piece_count, headings.WALL_COLUMNS)),
            np.zeros((count, headings.WAY_COLUMNS)),
            np.zeros(shape, np.int64),
        )
        self._result = np.zeros((*shape, rows.RESULT_COLUMNS))

    def decide(
        self, own: FloatArray, deciding: BoolArray, heard: FloatArray, present: BoolArray, radius_m: FloatArray,
        error_sum_m: FloatArray, range_m: float,
    ) -> FloatArray:  # fmt: skip
        self._kernel(
            own, deciding, heard, present, radius_m, error_sum_m, range_m, *self._constants, *self._scratch,
            self._result,
        )  # fmt: skip
        return self._result[: len(own)]

    def keep(self, kept: BoolArray) -> None:
        """Nothing is remembered from one step to the next; scratch may be too large."""


class _Halfplanes:
    """The half-plane solver, which remembers sides."""

    def __init__(self, settings: HalfplaneSettings, shape: tuple[int, int], obstacles: Obstacles) -> None:
        count, vehicles = shape
        lines = 2 * vehicles + obstacles.piece_count
        self._side = np.zeros((count, vehicles, vehicles), np.int8)
        self._route = np.zeros(shape, np.int64)
        self._constants = (
            obstacles.piece_vertex_ne_m, obstacles.piece_start, obstacles.hull_vertex_ne_m, obstacles.hull_start,
            settings.as_vector(),
        )  # fmt: skip
        self._scratch = (
            np.zeros((*shape, rows.NEIGHBOUR_COLUMNS)),
            np.stack([new_lines(lines)] * count),
            np.stack([new_lines(lines)] * count),
            np.zeros((count, lines), np.int64),
            np.zeros((count, ring_size(obstacles.hull_start), 2)),
            np.zeros(shape, np.int8),
            np.zeros(shape, np.int64),
        )
        self._result = np.zeros((*shape, rows.RESULT_COLUMNS))

    def decide(
        self, own: FloatArray, deciding: BoolArray, heard: FloatArray, present: BoolArray, radius_m: FloatArray,
        error_sum_m: FloatArray, range_m: float,
    ) -> FloatArray:  # fmt: skip
        worlds.avoid_worlds(
            own, deciding, heard, present, radius_m, error_sum_m, range_m, self._side, self._route, *self._constants,
            *self._scratch, self._result,
        )  # fmt: skip
        return self._result[: len(own)]

    def keep(self, kept: BoolArray) -> None:
        self._side, self._route = self._side[kept], self._route[kept]
