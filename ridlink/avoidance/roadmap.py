"""Cache of the ways among obstacles that were worked out.

Ways belong to a goal, rounded to the metre, a clearance, in steps, and a width. With coarser rounding, the last corner
before the rounded goal might not be the last one before the goal itself.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.kernel import kernel
from ridlink.avoidance.obstacles import Obstacles, Polygons
from ridlink.avoidance.ways import (
    KEEP_COLUMNS,
    OWNER,
    POINT_COLUMNS,
    ROUND,
    TANGENT,
    WAY_COLUMNS,
    measure_ways,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDTHS = 3
"""Kinds of ways to a goal: with the route margin, without it if that leaves no way, and with SCANT of the clearance."""

SCANT = 0.25
"""A vehicle that begins between walls that are too near gets out with this share of the clearance. None gets in, for
half-planes keep out."""

STEPS_PER_M = 2.0
"""Clearances are rounded down to such steps: they change with the speed, and each needs ways of its own."""

MOST_STEPS = 2**16 - 1
"""Clearances of this many steps or more count as one."""

CELLS = 2**22
"""Cells of a goal along one axis, in metres: goals this far apart count as one, but no vehicle flies so far."""

SHELF = 8
"""Ways in one set: the key of a goal says in which shelf to look, and there the oldest ways make room."""

LEAST_WAYS, MOST_WAYS, MOST_BYTES = 128, 4096, 2**22
"""Least and most ways that are kept; in between, as many as fit into MOST_BYTES."""

NO_KEY = -1


class Roadmap(NamedTuple):
    """Known ways among obstacles, and scratch to find more. Each user has its own, made for its obstacles by
    `new_roadmap`: it is not for two threads at a time, nor for two solvers.

    Attributes:
        vertex: Vertices of the convex pieces about the origin that ways are worked out about, shape (m, 2).
        points: Fixed data of the points of ways, shape (ROUND * m, POINT_COLUMNS).
        keys: Keys of the ways in each place; last column: newest place of the shelf; shape (shelves, SHELF + 1).
        table: The ways, shape (SHELF * shelves, ROUND * m, WAY_COLUMNS).
        keep: Scratch of `measure_ways`, shape (ROUND * m, KEEP_COLUMNS).
        room: Scratch of `next_waypoint`, shape (ROUND * m, ROOM_COLUMNS).
    """

    vertex: FloatArray
    points: FloatArray
    keys: IntArray
    table: FloatArray
    keep: FloatArray
    room: FloatArray


# Columns of room. Those of `ways.KEEP_COLUMNS`, then of a piece: its distance from own-ship and from the goal, and the
# length of the shortest way past it; of a point: the length of the way past it, the share of the clearance that is left
# to its piece, and where it lies.
(OWN_OFF, GOAL_OFF, SHORTEST, LENGTH, SHARE, POINT, ROOM_COLUMNS) = (
    KEEP_COLUMNS + place for place in (0, 1, 2, 3, 4, 5, 7)
)


def new_roadmap(obstacles: Obstacles) -> Roadmap:
    """An empty roadmap.

    Args:
        obstacles: Obstacles about any origin; later ones must have the same layout.
    """
    count = ROUND * len(obstacles.piece_vertex_ne_m)
    ways = min(max(MOST_BYTES // max(8 * WAY_COLUMNS * count, 1), LEAST_WAYS), MOST_WAYS) if count else 0
    # Keys are made of multiples of twos and threes: if the number of shelves were one, too, most would stay empty.
    shelves = 6 * (ways // (6 * SHELF)) + 1
    return Roadmap(
        vertex=obstacles.piece_vertex_ne_m, points=_points(obstacles.pieces),
        keys=np.full((shelves, SHELF + 1), NO_KEY, np.int64), table=np.empty((SHELF * shelves, count, WAY_COLUMNS)),
        keep=np.zeros((count, KEEP_COLUMNS)), room=np.zeros((count, ROOM_COLUMNS)),
    )  # fmt: skip


def _points(pieces: Polygons) -> FloatArray:
    """See `Roadmap.points`."""
    vertex, start = pieces
    points = np.zeros((ROUND * len(vertex), POINT_COLUMNS))
    for piece, (first, last) in enumerate(pairwise(start)):
        ring = vertex[first:last]
        edge = ring - np.roll(ring, 1, axis=0)
        begin = np.arctan2(-edge[:, 0], edge[:, 1])
        # At a corner that is straight but for rounding, this may come out below zero, which is no full circle.
        turn = np.maximum((np.roll(begin, -1) - begin + np.pi) % (2.0 * np.pi) - np.pi, 0.0)
        angle = begin[:, None] + turn[:, None] * (np.arange(ROUND) + 0.5) / ROUND
        reach = 1.0 / np.cos(turn / (2.0 * ROUND))
        mine = points[ROUND * first : ROUND * last]
        tangent = reach[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        mine[:, TANGENT : TANGENT + 2], mine[:, OWNER] = tangent.reshape(-1, 2), piece
    return points


@kernel(inner=True)
def width_of_way(steps, width, margin_m):  # type: ignore[no-untyped-def]
    """Distance [m] that a way keeps from obstacles.

    Args:
        steps: The clearance, in steps.
        width: Index below WIDTHS.
        margin_m: Further distance that routes keep.
    """
    clearance_m = steps / STEPS_PER_M
    if width == 0:
        return clearance_m + margin_m
    return clearance_m if width == 1 else SCANT * clearance_m


@kernel(inner=True)
def ways_to(pieces, roadmap, goal_1, goal_2, steps, width, margin_m, outward):  # type: ignore[no-untyped-def]
    """Index in the table of the ways to a goal; ways that are not known are worked out.

    Args:
        pieces: Convex pieces, `Obstacles.pieces`, about the present origin.
        roadmap: `Roadmap`.
        goal_1: North of the goal.
        goal_2: East of it.
        steps: The clearance, in steps.
        width: Index below WIDTHS.
        margin_m: Further distance that routes keep, always the same.
        outward: Scratch, shape (2,).
    """
    (vertex, start), (about, points, keys, table, keep, _) = pieces, roadmap
    # By the nearest corner: about another origin, north is another direction, too.
    nearest, least = 0, math.inf
    for k in range(len(vertex)):
        square = (vertex[k, 0] - goal_1) * (vertex[k, 0] - goal_1) + (vertex[k, 1] - goal_2) * (vertex[k, 1] - goal_2)
        if square < least:
            nearest, least = k, square
    goal_1 = goal_1 - (vertex[nearest, 0] - about[nearest, 0])
    goal_2 = goal_2 - (vertex[nearest, 1] - about[nearest, 1])
    cell_1, cell_2 = round(goal_1), round(goal_2)
    key = int((cell_1 % CELLS * CELLS + cell_2 % CELLS) * (MOST_STEPS + 1) + steps) * WIDTHS + width
    shelf = int(key % len(keys))
    for place in range(SHELF):
        if keys[shelf, place] == key:
            return SHELF * shelf + place
    place = (keys[shelf, SHELF] + 1) % SHELF
    keys[shelf, SHELF], keys[shelf, place] = place, key
    found = SHELF * shelf + place
    measure_ways(
        (about, start), points, width_of_way(steps, width, margin_m), float(cell_1), float(cell_2), keep, outward,
        table[found],
    )  # fmt: skip
    return found
