"""The map of ways among static obstacles: worked out where it is first asked for, and kept.

What kernels cannot do at every step is done here once for a goal, to the metre, and a clearance, in steps.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.rows import AIM, AIM_IS_VELOCITY, BUFFER_SHARE, CLEARANCE, OWN_COLUMNS, ROUTE_MARGIN, WAY
from ridlink.avoidance.ways import EAST, KEEP_COLUMNS, NORTH, ROUND, WAY_COLUMNS, measure_ways

FloatArray = NDArray[np.float64]

SPARE, SPARE_TIMES = 64, 4
"""Ways that are kept: so many, and so many for each own-ship."""

STEPS_PER_M = 2.0
"""Clearances are rounded down to such steps: they change with the speed, and each has ways of its own."""

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


def in_steps(clearance_m: FloatArray) -> FloatArray:
    """Clearances rounded down."""
    return np.asarray(np.floor(clearance_m * STEPS_PER_M) / STEPS_PER_M)


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
        self._places: dict[tuple[float, ...], int] = {}
        self._keys, self._numbers = np.empty((0, 2 + WIDTHS)), np.empty(0)

    def ways(self, own: FloatArray, settings: FloatArray, obstacles: Obstacles) -> FloatArray:
        """The ways to the goals of own-ships; those that are new are worked out.

        Args:
            own: Own-ships, rows as in `rows`, shape (..., OWN_COLUMNS); the number of their ways is written to WAY.
            settings: Constants, `HalfplaneSettings.as_vector`.
            obstacles: The obstacles about the origin that holds for them now.

        Returns:
            Ways about that origin, shape (n, WIDTHS, points, WAY_COLUMNS).
        """
        rows = own.reshape(-1, OWN_COLUMNS)
        rows[:, WAY] = 0.0
        if not len(self._owner):
            return self._table
        vertex, goals = obstacles.pieces[0], rows[:, AIM : AIM + 2]
        # Corner by corner: about another origin north is another direction, too.
        moved = vertex - self._pieces[0]
        stays = not moved.any()
        if not stays:
            nearest = np.argmin(np.sum(np.square(vertex - goals[:, None]), axis=2), axis=1)
            goals = goals - moved[nearest]
        narrow = rows[:, CLEARANCE] * (1.0 + settings[BUFFER_SHARE])
        keys = np.empty((len(rows), 2 + WIDTHS))
        keys[:, :2] = np.rint(goals)
        clearances = narrow + settings[ROUTE_MARGIN], narrow, SCANT * narrow
        keys[:, 2:] = in_steps(np.stack(clearances, axis=1))
        keys[rows[:, AIM_IS_VELOCITY] != 0.0] = np.nan
        changed = np.ones(len(keys), np.bool_)
        if len(self._places) > SPARE + SPARE_TIMES * len(keys):
            self._places.clear()
        elif len(self._keys) == len(keys):
            changed = np.any(self._keys != keys, axis=1)
            rows[:, WAY] = self._numbers
        self._keys = keys
        for row in np.flatnonzero(changed).tolist():
            rows[row, WAY] = self._number(keys[row])
        self._numbers = rows[:, WAY].copy()
        if stays or not self._places:
            return self._table
        asked, which = np.unique(rows[:, WAY], return_inverse=True)
        ways: FloatArray = self._table[np.maximum(asked.astype(np.int64) - 1, 0)]
        ways[..., NORTH : EAST + 1] += np.repeat(moved, ROUND, axis=0)
        rows[:, WAY] = np.where(rows[:, WAY] > 0.0, which.reshape(-1) + 1.0, 0.0)
        return ways

    def _number(self, key: FloatArray) -> int:
        """Number of the ways to a goal, from 1; 0 for no goal."""
        if not np.all(np.isfinite(key)):
            return 0
        known = tuple(key.tolist())
        if known not in self._places:
            place = len(self._places)
            if place == len(self._table):
                self._table = np.concatenate([self._table, np.empty((max(place, 1), *self._table.shape[1:]))])
            for way, clearance in zip(self._table[place], key[2:], strict=True):
                measure_ways(
                    self._pieces, self._rounding, self._owner, clearance, key[0], key[1], *self._scratch, way
                )  # fmt: skip
            self._places[known] = place
        return self._places[known] + 1
