"""The map of ways among static obstacles: worked out where it is first asked for, and kept.

What kernels cannot do at every step is done here once for a goal, to the metre, and a clearance, in steps. Rounded
further, the last corner before a goal may be another one than that of the goal itself.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.rows import AIM, AIM_IS_VELOCITY, BUFFER_SHARE, CLEARANCE, OWN_COLUMNS, ROUTE_MARGIN, WAY
from ridlink.avoidance.ways import EAST, KEEP_COLUMNS, NORTH, ROUND, WAY_COLUMNS, measure_ways

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SPARE, SPARE_TIMES = 64, 8
"""Ways that are kept: so many, and so many for each own-ship."""

CELL_BITS = 20
"""Of the place of a goal along one axis: as far as half a million metres and more. Beyond, goals lie on the edge."""

STEPS_PER_M = 2.0
"""Clearances are rounded down to such steps: they change with the speed, and each has ways of its own."""

MOST_STEPS = 2**16 - 1
"""Clearances of so many steps and more are one."""

WIDTHS = 3
"""Ways to a goal: with the route margin, without it for where that leaves none, and with SCANT of the rest."""

SCANT = 0.25
"""Who is between walls that are too near from the beginning gets out with this share of the clearance; nobody gets in,
for half-planes keep out."""


def rounded_corners(vertex_ne_m: FloatArray, start: NDArray[np.int64]) -> FloatArray:
    """Where the points lie that stand for a grown corner, for each metre of growth, as seen from the corner.

    Args:
        vertex_ne_m: Vertices of convex pieces, shape (m, 2).
        start: Where each piece begins in these, with the end, shape (pieces + 1,).

    Returns:
        Shape (ROUND * m, 2).
    """
    corners = []
    for ring in (vertex_ne_m[first:last] for first, last in pairwise(start)):
        edge = ring - np.roll(ring, 1, axis=0)
        begin = np.arctan2(-edge[:, 0], edge[:, 1])
        # Of a corner that is straight but for rounding it may come out below zero, which is no full circle.
        turn = np.maximum((np.roll(begin, -1) - begin + np.pi) % (2.0 * np.pi) - np.pi, 0.0)
        angle = begin[:, None] + turn[:, None] * (np.arange(ROUND) + 0.5) / ROUND
        reach = 1.0 / np.cos(turn / (2.0 * ROUND))
        corners.append((reach[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2))
    return np.concatenate(corners) if corners else np.empty((0, 2))


def rounded(goals_ne_m: FloatArray, clearance_m: FloatArray) -> IntArray:
    """Goals, shape (n, 2), and clearances, shape (n,), rounded, as one number for each."""
    most = 2 ** (CELL_BITS - 1) - 1
    cells = np.clip(np.rint(goals_ne_m), -most, most).astype(np.int64) + most
    steps = np.clip(np.floor(clearance_m * STEPS_PER_M), 0, MOST_STEPS).astype(np.int64)
    return np.asarray(((cells[:, 0] << CELL_BITS) | cells[:, 1]) * (MOST_STEPS + 1) + steps)


class Roadmap:
    """Ways among obstacles. Whoever asks has one of its own: it is not for two threads at a time.

    Args:
        obstacles: Them, about any origin.
    """

    def __init__(self, obstacles: Obstacles) -> None:
        self._pieces = obstacles.pieces
        vertex, start = self._pieces
        points = ROUND * len(vertex)
        self._rounding = rounded_corners(vertex, start)
        self._owner = np.repeat(np.arange(len(start) - 1), ROUND * np.diff(start))
        self._scratch = np.empty((points, KEEP_COLUMNS)), np.empty(points, np.bool_), np.empty(2)
        self._table = np.empty((0, WIDTHS, points, WAY_COLUMNS))
        self._keys, self._order, self._margin_m = np.empty(0, np.int64), np.empty(0, np.int64), math.nan

    def ways(self, own: FloatArray, settings: FloatArray, obstacles: Obstacles) -> FloatArray:
        """The ways to the goals of own-ships; those that are new are worked out.

        Args:
            own: Own-ships, rows as in `rows`, shape (..., OWN_COLUMNS); the number of their ways is written to WAY.
            settings: Constants, `HalfplaneSettings.as_vector`.
            obstacles: The obstacles about the origin that holds for them now.

        Returns:
            Ways about that origin, shape (n, WIDTHS, points, WAY_COLUMNS).
        """
        if not len(self._owner):  # where there is no way, whatever stands in WAY
            return self._table
        rows = own.reshape(-1, OWN_COLUMNS)
        rows[:, WAY] = 0.0
        meant = (rows[:, AIM_IS_VELOCITY] == 0.0) & np.all(np.isfinite(rows[:, [AIM, AIM + 1, CLEARANCE]]), axis=1)
        if not meant.any():
            return self._table
        vertex, goals = obstacles.pieces[0], rows[meant, AIM : AIM + 2]
        # Corner by corner: about another origin north is another direction, too.
        moved = vertex - self._pieces[0]
        stays = not moved.any()
        if not stays:
            nearest = np.argmin(np.sum(np.square(vertex - goals[:, None]), axis=2), axis=1)
            goals = goals - moved[nearest]
        keys = rounded(goals, rows[meant, CLEARANCE] * (1.0 + settings[BUFFER_SHARE]))
        if settings[ROUTE_MARGIN] != self._margin_m or len(self._keys) > SPARE + SPARE_TIMES * len(rows):
            self._keys, self._margin_m = np.empty(0, np.int64), float(settings[ROUTE_MARGIN])
            self._table = self._table[:0]
        places, known = self._found(keys)
        if not known.all():
            self._add(np.unique(keys[~known]))
            places, _ = self._found(keys)
        if stays:
            rows[meant, WAY] = places + 1.0
            return self._table
        asked, which = np.unique(places, return_inverse=True)
        ways: FloatArray = self._table[asked]
        ways[..., NORTH : EAST + 1] += np.repeat(moved, ROUND, axis=0)
        rows[meant, WAY] = which.reshape(-1) + 1.0
        return ways

    def _found(self, keys: IntArray) -> tuple[IntArray, BoolArray]:
        """Where the ways of keys are, and whether they are."""
        if not len(self._keys):
            return np.zeros(len(keys), np.int64), np.zeros(len(keys), np.bool_)
        places = self._order[np.minimum(np.searchsorted(self._keys, keys, sorter=self._order), len(self._keys) - 1)]
        return places, self._keys[places] == keys

    def _add(self, keys: IntArray) -> None:
        """Work out the ways of keys that are not known yet."""
        first = len(self._keys)
        self._keys = np.concatenate([self._keys, keys])
        self._order = np.argsort(self._keys)
        if len(self._keys) > len(self._table):
            spare = np.empty((2 * len(self._keys) - len(self._table), *self._table.shape[1:]))
            self._table = np.concatenate([self._table, spare])
        most = 2 ** (CELL_BITS - 1) - 1
        for place, key in enumerate(keys.tolist(), first):
            cell, steps = divmod(key, MOST_STEPS + 1)
            north_m, east_m = (float(part - most) for part in divmod(cell, 2**CELL_BITS))
            clearance_m = steps / STEPS_PER_M
            widths = clearance_m + self._margin_m, clearance_m, SCANT * clearance_m
            for way, width in zip(self._table[place], widths, strict=True):
                measure_ways(self._pieces, self._rounding, self._owner, width, north_m, east_m, *self._scratch, way)
