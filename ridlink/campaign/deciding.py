"""The batch kernel of a solver with its constants and its scratch, behind one call."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import graded, rotation, rows, worlds
from ridlink.avoidance.obstacles import Obstacles
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
        """Results, shape (W, N, RESULT_COLUMNS); arguments as in `ridlink.avoidance.worlds`, and so is what of them is
        filled in."""

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
            self._scratch = worlds.rotation_scratch(*shape, obstacles)
        else:
            self._kernel = worlds.grade_worlds
            fan = graded.candidates()
            self._scratch = worlds.graded_scratch(*shape, obstacles)
        self._constants = (obstacles.piece_vertex_ne_m, obstacles.piece_start, settings.as_vector(), fan)
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
    """The half-plane solver, which remembers its encounters."""

    def __init__(self, settings: HalfplaneSettings, shape: tuple[int, int], obstacles: Obstacles) -> None:
        self._memory = worlds.new_memory(*shape)
        self._route = np.zeros(shape, np.int64)
        self._constants = (
            obstacles.piece_vertex_ne_m, obstacles.piece_start, obstacles.hull_vertex_ne_m, obstacles.hull_start,
            settings.as_vector(),
        )  # fmt: skip
        self._scratch = worlds.halfplane_scratch(*shape, obstacles)
        self._result = np.zeros((*shape, rows.RESULT_COLUMNS))

    def decide(
        self, own: FloatArray, deciding: BoolArray, heard: FloatArray, present: BoolArray, radius_m: FloatArray,
        error_sum_m: FloatArray, range_m: float,
    ) -> FloatArray:  # fmt: skip
        worlds.avoid_worlds(
            own, deciding, heard, present, radius_m, error_sum_m, range_m, self._memory, self._route, *self._constants,
            *self._scratch, self._result,
        )  # fmt: skip
        return self._result[: len(own)]

    def keep(self, kept: BoolArray) -> None:
        self._memory, self._route = self._memory[kept], self._route[kept]
