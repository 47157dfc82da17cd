"""The same decision for whole batches of worlds: every vehicle of a world against all others of it.

One entry point for each solver, so that whoever flies one does not compile the others. Their first arguments are the
same: W worlds of N vehicles, a world is one task of the thread pool, and all its vehicles decide from the same picture,
at the same instant.

    own           own-ships, rows as in `rows`, shape (W, N, OWN_COLUMNS)
    deciding      True where a decision is wanted, shape (W, N)
    heard         what the others hear of each vehicle: position at the time of the report, velocity, command (NaN where
                  none is sent), age, reciprocity in columns 0-1, 2-3, 4-5, 6, 7, shape (W, N, 8)
    present       True while a vehicle is in the air, shape (W, N)
    radius_m      radius of the disc that the first vehicle keeps from the second, shape (W, N, N)
    error_sum_m   part of it that stands for localization errors, shape (W, N, N)
    range_m       vehicles further than this are not heard
    result        results, shape (W, N, RESULT_COLUMNS); the neighbours in them are indices of vehicles of the world
"""

from __future__ import annotations

from numba import prange

from ridlink.avoidance.graded import grade_one
from ridlink.avoidance.halfplane import avoid_one
from ridlink.avoidance.kernel import kernel
from ridlink.avoidance.rotation import rotate_one
from ridlink.avoidance.rows import (
    AGE,
    ERROR_SUM,
    N_COMMAND,
    N_POSITION,
    N_VELOCITY,
    POSITION,
    R_BINDING,
    R_NEAREST,
    RADIUS,
    RECIPROCAL,
)


@kernel
def hear(own, i, heard, present, radius_m, error_sum_m, range_m, rows, names):  # type: ignore[no-untyped-def]
    """Rows and names of the neighbours that vehicle `i` of one world hears; returns their number."""
    p_1, p_2 = own[i, POSITION], own[i, POSITION + 1]
    count = 0
    for j in range(len(present)):
        if j == i or not present[j]:
            continue
        report = heard[j]
        if (report[0] - p_1) ** 2 + (report[1] - p_2) ** 2 > range_m * range_m:
            continue
        rows[count, N_POSITION], rows[count, N_POSITION + 1] = report[0], report[1]
        rows[count, N_VELOCITY], rows[count, N_VELOCITY + 1] = report[2], report[3]
        rows[count, N_COMMAND], rows[count, N_COMMAND + 1] = report[4], report[5]
        rows[count, AGE], rows[count, RECIPROCAL] = report[6], report[7]
        rows[count, RADIUS], rows[count, ERROR_SUM] = radius_m[i, j], error_sum_m[i, j]
        names[count] = j
        count += 1
    return count


@kernel
def name_vehicles(names, answer):  # type: ignore[no-untyped-def]
    """The nearest neighbour and the binding ones by their place in the world."""
    for column in (R_NEAREST, R_BINDING, R_BINDING + 1, R_BINDING + 2):
        if answer[column] >= 0.0:
            answer[column] = names[int(answer[column])]


@kernel(parallel=True)
def avoid_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, error_sum_m, range_m, memory, route, pieces, piece_start, hulls,
    hull_start, settings, neighbours, lines, work, owner, ring, row_memory, index, result,
):  # fmt: skip
    """Decide by half-planes for every vehicle of every world.

    Args:
        own: See above; so are `deciding` to `range_m` and `result`.
        deciding: See above.
        heard: See above.
        present: See above.
        radius_m: See above.
        error_sum_m: See above.
        range_m: See above.
        memory: What each vehicle keeps of its encounters, read and written, shape (W, N, N), int8.
        route: Memory of the way round obstacles, read and written, shape (W, N), int64.
        pieces: Obstacles, the same in every world, as in `avoid_one`; so are `piece_start`, `hulls`, `hull_start`.
        piece_start: See `pieces`.
        hulls: See `pieces`.
        hull_start: See `pieces`.
        settings: Constants, `HalfplaneSettings.as_vector`.
        neighbours: Scratch, shape (W, N, NEIGHBOUR_COLUMNS).
        lines: Scratch, shape (W, 2 N + pieces + 2, 3).
        work: Scratch of the same shape.
        owner: Scratch, shape (W, 2 N + pieces), int64.
        ring: Scratch, shape (W, `ring_size`, 2).
        row_memory: Scratch, shape (W, N), int8.
        index: Scratch, shape (W, N), int64.
        result: See above.
    """
    worlds, vehicles = own.shape[0], own.shape[1]
    for world in prange(worlds):
        rows, kept, names = neighbours[world], row_memory[world], index[world]
        for i in range(vehicles):
            if not deciding[world, i]:
                continue
            count = hear(
                own[world], i, heard[world], present[world], radius_m[world], error_sum_m[world], range_m, rows, names
            )
            for k in range(count):
                kept[k] = memory[world, i, names[k]]
            # An encounter is forgotten with the vehicle that goes out of range.
            for j in range(vehicles):
                if present[world, j]:
                    memory[world, i, j] = 0
            answer = result[world, i]
            route[world, i] = avoid_one(
                own[world, i], rows, count, kept, pieces, piece_start, hulls, hull_start, route[world, i], settings,
                lines[world], work[world], owner[world], ring[world], answer,
            )  # fmt: skip
            for k in range(count):
                memory[world, i, names[k]] = kept[k]
            name_vehicles(names, answer)


@kernel(parallel=True)
def rotate_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, error_sum_m, range_m, pieces, piece_start, settings, fan, neighbours,
    sights, walls, way, index, result,
):  # fmt: skip
    """Decide by rotation, as the paper does, for every vehicle of every world.

    Args:
        own: See above; so are `deciding` to `range_m` and `result`.
        deciding: See above.
        heard: See above.
        present: See above.
        radius_m: See above.
        error_sum_m: See above.
        range_m: See above.
        pieces: Obstacles, the same in every world, as in `rotate_one`; so is `piece_start`.
        piece_start: See `pieces`.
        settings: Constants, `RotationSettings.as_vector`.
        fan: Candidates, `rotation.candidates`.
        neighbours: Scratch, shape (W, N, NEIGHBOUR_COLUMNS).
        sights: Scratch, shape (W, N, SIGHT_COLUMNS).
        walls: Scratch, shape (W, pieces, WALL_COLUMNS).
        way: Scratch, shape (W, WAY_COLUMNS).
        index: Scratch, shape (W, N), int64.
        result: See above.
    """
    for world in prange(own.shape[0]):
        rows, names = neighbours[world], index[world]
        for i in range(own.shape[1]):
            if deciding[world, i]:
                count = hear(
                    own[world], i, heard[world], present[world], radius_m[world], error_sum_m[world], range_m, rows,
                    names,
                )  # fmt: skip
                rotate_one(
                    own[world, i], rows, count, pieces, piece_start, settings, fan, sights[world], walls[world],
                    way[world], result[world, i],
                )  # fmt: skip
                name_vehicles(names, result[world, i])


@kernel(parallel=True)
def grade_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, error_sum_m, range_m, pieces, piece_start, settings, fan, neighbours,
    sights, walls, way, index, result,
):  # fmt: skip
    """Decide by graded risk for every vehicle of every world; arguments as in `rotate_worlds`, with `GradedSettings`
    and `graded.candidates`."""
    for world in prange(own.shape[0]):
        rows, names = neighbours[world], index[world]
        for i in range(own.shape[1]):
            if deciding[world, i]:
                count = hear(
                    own[world], i, heard[world], present[world], radius_m[world], error_sum_m[world], range_m, rows,
                    names,
                )  # fmt: skip
                grade_one(
                    own[world, i], rows, count, pieces, piece_start, settings, fan, sights[world], walls[world],
                    way[world], result[world, i],
                )  # fmt: skip
                name_vehicles(names, result[world, i])
