"""The same decision for whole batches of worlds: every vehicle of a world against all others of it.

Shapes: W worlds of N vehicles. A world is one task of the thread pool; all its vehicles decide from the same picture,
    at the
same instant.
"""

from __future__ import annotations

from numba import prange

from ridlink.avoidance.halfplane import avoid_one
from ridlink.avoidance.kernel import kernel
from ridlink.avoidance.rows import (
    AGE,
    ERROR_SUM,
    N_COMMAND,
    N_POSITION,
    N_VELOCITY,
    POSITION,
    RADIUS,
    RECIPROCAL,
)


@kernel(parallel=True)
def avoid_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, error_sum_m, range_m, side, route, pieces, piece_start, hulls, hull_start,
    settings, neighbours, lines, work, owner, ring, row_side, index, result,
):  # fmt: skip
    """Decide for every vehicle of every world.

    Args:
        own: Own-ships, rows as in `avoid_one`, shape (W, N, OWN_COLUMNS).
        deciding: True where a decision is wanted, shape (W, N).
        heard: What the others hear of each vehicle: position at the time of the report, velocity, command (NaN where
            none is sent), age, reciprocity in columns 0-1, 2-3, 4-5, 6, 7, shape (W, N, 8).
        present: True while a vehicle is in the air, shape (W, N).
        radius_m: Radius of the disc that the first vehicle keeps from the second, shape (W, N, N).
        error_sum_m: Part of it that stands for localization errors, shape (W, N, N).
        range_m: Vehicles further than this are not heard.
        side: Memory of the head-on rule, read and written, shape (W, N, N), int8.
        route: Memory of the way round obstacles, read and written, shape (W, N), int64.
        pieces: Obstacles, the same in every world, as in `avoid_one`; so are `piece_start`, `hulls`, `hull_start`.
        piece_start: See `pieces`.
        hulls: See `pieces`.
        hull_start: See `pieces`.
        settings: Constants, shape (16,).
        neighbours: Scratch, shape (W, N, NEIGHBOUR_COLUMNS).
        lines: Scratch, shape (W, 2 N + pieces + 2, 3).
        work: Scratch of the same shape.
        owner: Scratch, shape (W, 2 N + pieces), int64.
        ring: Scratch, shape (W, `ring_size`, 2).
        row_side: Scratch, shape (W, N), int8.
        index: Scratch, shape (W, N), int64.
        result: Results, shape (W, N, RESULT_COLUMNS); the neighbours in it are indices of vehicles of the world.
    """
    worlds, vehicles = own.shape[0], own.shape[1]
    for world in prange(worlds):
        rows, sides, names = neighbours[world], row_side[world], index[world]
        for i in range(vehicles):
            if not deciding[world, i]:
                continue
            p_1, p_2 = own[world, i, POSITION], own[world, i, POSITION + 1]
            count = 0
            for j in range(vehicles):
                if j == i or not present[world, j]:
                    continue
                report = heard[world, j]
                if (report[0] - p_1) ** 2 + (report[1] - p_2) ** 2 > range_m * range_m:
                    side[world, i, j] = 0
                    continue
                rows[count, N_POSITION], rows[count, N_POSITION + 1] = report[0], report[1]
                rows[count, N_VELOCITY], rows[count, N_VELOCITY + 1] = report[2], report[3]
                rows[count, N_COMMAND], rows[count, N_COMMAND + 1] = report[4], report[5]
                rows[count, AGE], rows[count, RECIPROCAL] = report[6], report[7]
                rows[count, RADIUS], rows[count, ERROR_SUM] = radius_m[world, i, j], error_sum_m[world, i, j]
                sides[count] = side[world, i, j]
                names[count] = j
                count += 1
            answer = result[world, i]
            route[world, i] = avoid_one(
                own[world, i], rows, count, sides, pieces, piece_start, hulls, hull_start, route[world, i], settings,
                lines[world], work[world], owner[world], ring[world], answer,
            )  # fmt: skip
            for k in range(count):
                side[world, i, names[k]] = sides[k]
            # The nearest neighbour and the binding ones, by their place in the world.
            for column in (9, 11, 12, 13):
                if answer[column] >= 0.0:
                    answer[column] = names[int(answer[column])]
