"""The solvers for worlds in which each vehicle has its own picture: the same kernels, with tracks of pairs as input."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import graded, halfplane, headings, rotation, rows
from ridlink.avoidance.graded import grade_one
from ridlink.avoidance.halfplane import avoid_one
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.packing import pack, unpack_memory
from ridlink.avoidance.priority import give_way, new_turns
from ridlink.avoidance.roadmap import new_roadmap
from ridlink.avoidance.rotation import choose_heading
from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.campaign.tracks import Picture, collect, kernel

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@kernel
def remember(names, kept, count, memory):  # type: ignore[no-untyped-def]
    """Write the memory of heard neighbours back to their indices."""
    memory[:] = 0
    for k in range(count):
        memory[names[k]] = kept[k]


@kernel(nogil=True)
def avoid_pairs(  # type: ignore[no-untyped-def]
    own, deciding, picture, memory, room, pieces, settings, roadmap, route, turns, scratch, result,
):  # fmt: skip
    """Decide by half-planes; up to `result` see `PairDecider.decide`, scratch memory has a leading axis of worlds."""
    reports, kept, names, blocks = room
    candidates, places, lines, chosen, work = scratch
    for world in range(own.shape[0]):
        few, names_here, kept_here = blocks[world], names[world], kept[world]
        mine = (candidates[world], places[world], lines[world], chosen[world], work[world])
        for i in range(own.shape[1]):
            if not deciding[world, i]:
                continue
            count = collect(own[world, i], world, i, picture, memory[world, i], room)
            give_way(own[world, i], i, reports[world], names_here, count, picture.now_s, picture.now_s, turns[world, i])
            pack(reports[world], kept_here, count, few)
            route[world, i] = avoid_one(
                own[world, i], few, -(-count // rows.LANES), math.inf, pieces, roadmap, route[world, i], settings,
                mine, result[world, i],
            )  # fmt: skip
            unpack_memory(few, count, kept_here)
            remember(names_here, kept_here, count, memory[world, i])


@kernel(nogil=True)
def rotate_pairs(  # type: ignore[no-untyped-def]
    own, deciding, picture, memory, room, pieces, settings, fan, scratch, result,
):  # fmt: skip
    """Decide by rotation, as the paper does."""
    reports, kept, _, blocks = room
    sights, walls, way = scratch
    for world in range(own.shape[0]):
        mine = (sights[world], walls[world], way[world])
        for i in range(own.shape[1]):
            if not deciding[world, i]:
                continue
            count = collect(own[world, i], world, i, picture, memory[world, i], room)
            pack(reports[world], kept[world], count, blocks[world])
            choose_heading(
                own[world, i], blocks[world], -(-count // rows.LANES), math.inf, pieces, settings, fan, mine,
                result[world, i],
            )  # fmt: skip


@kernel(nogil=True)
def grade_pairs(  # type: ignore[no-untyped-def]
    own, deciding, picture, memory, room, pieces, settings, fan, scratch, result,
):  # fmt: skip
    """Decide by graded risk."""
    reports, kept, _, blocks = room
    sights, walls, way = scratch
    for world in range(own.shape[0]):
        mine = (sights[world], walls[world], way[world])
        for i in range(own.shape[1]):
            if not deciding[world, i]:
                continue
            count = collect(own[world, i], world, i, picture, memory[world, i], room)
            pack(reports[world], kept[world], count, blocks[world])
            grade_one(own[world, i], blocks[world], count, pieces, settings, fan, mine, result[world, i])


class PairDecider:
    """A solver with its constants, its scratch memory, and the memory of encounters of its vehicles.

    Args:
        settings: Constants; their type selects the solver.
        shape: Worlds and vehicles, (W, N).
        obstacles: Obstacles, the same in every world.
    """

    def __init__(
        self, settings: HalfplaneSettings | GradedSettings | RotationSettings, shape: tuple[int, int],
        obstacles: Obstacles,
    ) -> None:  # fmt: skip
        worlds, vehicles = shape
        self._memory = np.zeros((worlds, vehicles, vehicles), np.int8)
        self._room: tuple[Any, ...] = (
            np.zeros((worlds, vehicles, 10)), np.zeros((worlds, vehicles), np.int8),
            np.zeros((worlds, vehicles), np.int64), rows.for_worlds(rows.new_blocks(vehicles), worlds),
        )  # fmt: skip
        self._walls = (obstacles.pieces, settings.as_vector())
        self._route: NDArray[np.int64] | None = None
        self._result = np.zeros((*shape, rows.RESULT_COLUMNS))
        if isinstance(settings, HalfplaneSettings):
            self._kernel: Any = avoid_pairs
            self._route, self._turns = np.zeros(shape, np.int64), new_turns(*shape)
            self._roadmap = new_roadmap(obstacles)
            self._constants: tuple[Any, ...] = ()
            self._scratch = rows.for_all_worlds(halfplane.new_scratch(vehicles, obstacles), worlds)
            return
        self._scratch = rows.for_all_worlds(headings.new_scratch(vehicles, obstacles), worlds)
        if isinstance(settings, RotationSettings):
            self._kernel = rotate_pairs
            self._constants = (rotation.candidates(settings.step_deg, settings.left_weight),)
        else:
            self._kernel = grade_pairs
            self._constants = (graded.candidates(),)

    def decide(self, own: FloatArray, deciding: BoolArray, picture: Picture) -> FloatArray:
        """Decide for all vehicles of W worlds.

        Args:
            own: Own-ships, rows as in `ridlink.avoidance.rows`, shape (W, N, OWN_COLUMNS); the aim of those that make
                way for others is overwritten.
            deciding: Mask of vehicles that decide, shape (W, N).
            picture: Their tracks of each other; tracks that are too old are dropped.

        Returns:
            Results, shape (W, N, RESULT_COLUMNS).
        """
        constants = self._constants
        if self._route is not None:
            constants = self._roadmap, self._route, self._turns
        self._kernel(
            own, deciding, picture, self._memory, self._room, *self._walls, *constants, self._scratch, self._result
        )  # fmt: skip
        return self._result[: len(own)]

    def keep(self, kept: BoolArray) -> None:
        """Keep only some worlds of the batch, shape (W,)."""
        self._memory = self._memory[kept]
        if self._route is not None:
            self._route, self._turns = self._route[kept], self._turns[kept]
