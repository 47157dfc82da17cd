"""The same decision for whole batches of worlds: every vehicle of a world against all others of it.

There is one entry point for each solver, so that a user of one does not compile the others. Their first arguments are
the same: W worlds of N vehicles; all vehicles of a world decide from the same picture, at the same instant. Worlds are
independent, so parts of a batch may be given to several threads.

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

from typing import Any

import numpy as np

from ridlink.avoidance import halfplane, headings
from ridlink.avoidance.graded import grade_one
from ridlink.avoidance.halfplane import avoid_one
from ridlink.avoidance.kernel import kernel
from ridlink.avoidance.lanes import copy_lanes, lane_of
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.packing import place_reports
from ridlink.avoidance.rotation import choose_heading
from ridlink.avoidance.rows import (
    ERROR_SUM,
    GAP,
    HEARD,
    KEPT,
    LANES,
    POSITION,
    R_BINDING,
    R_NEAREST,
    RADIUS,
    REPORTED,
    blocks_for,
    for_all_worlds,
    for_worlds,
    new_blocks,
    new_names,
)

SMALL_WORLD = 64
"""In worlds of up to this many vehicles, each looks at all others."""


@kernel(inner=True)
def draw_picture(heard, present, picture):  # type: ignore[no-untyped-def]
    """Write what the others hear of each vehicle of one world to blocks of neighbours."""
    place_reports(heard, len(heard), picture)
    for j in range(len(heard)):
        picture[j // LANES, HEARD + j % LANES] = 1.0 if present[j] else 0.0


@kernel(forceinline=True, inner=True)
def fill_in(numbers, picture, column):  # type: ignore[no-untyped-def]
    """Write a column of all blocks, a number for each vehicle."""
    whole = len(numbers) // LANES
    for b in range(whole):
        copy_lanes(numbers, LANES * b, picture[b], column)
    for j in range(LANES * whole, len(numbers)):
        picture[whole, column + j % LANES] = numbers[j]


@kernel(forceinline=True, inner=True)
def complete(picture, radius_m, error_sum_m, kept):  # type: ignore[no-untyped-def]
    """Write the data of each neighbour for one vehicle: radius of its disc, part of it for errors, `Memory` flags."""
    whole = len(radius_m) // LANES
    for b in range(whole):
        block, first = picture[b], LANES * b
        copy_lanes(radius_m, first, block, RADIUS)
        copy_lanes(error_sum_m, first, block, ERROR_SUM)
        copy_lanes(kept, first, block, KEPT)
    for j in range(LANES * whole, len(radius_m)):
        block, lane = picture[whole], lane_of(j)
        block[RADIUS + lane], block[ERROR_SUM + lane], block[KEPT + lane] = radius_m[j], error_sum_m[j], kept[j]


@kernel(inner=True)
def gather(own, i, radius_m, error_sum_m, range_m, picture, neighbours, names):  # type: ignore[no-untyped-def]
    """Copy the vehicles that vehicle `i` of one world hears to blocks of their own.

    Args:
        own: Own-ships of the world.
        i: Index of the vehicle that hears.
        radius_m: Radii of its discs, shape (N,).
        error_sum_m: Parts of them, shape (N,).
        range_m: Vehicles further than this are not heard.
        picture: The world, as `draw_picture` left it.
        neighbours: Result, blocks.
        names: Result: places of these vehicles in the world.

    Returns:
        Number of vehicles that are heard.
    """
    p_1, p_2, reach = own[i, POSITION], own[i, POSITION + 1], range_m * range_m
    count = 0
    for j in range(len(radius_m)):
        block, lane = picture[j // LANES], j % LANES
        off_1, off_2 = block[REPORTED + lane] - p_1, block[REPORTED + LANES + lane] - p_2
        if block[HEARD + lane] != 0.0 and j != i and off_1 * off_1 + off_2 * off_2 <= reach:
            target, place = neighbours[count // LANES], count % LANES
            for column in range(0, GAP, LANES):
                target[column + place] = block[column + lane]
            target[RADIUS + place], target[ERROR_SUM + place] = radius_m[j], error_sum_m[j]
            names[count] = j
            count += 1
    for k in range(count, LANES * (-(-count // LANES))):
        neighbours[k // LANES, HEARD + k % LANES] = 0.0
    return count


@kernel(inner=True)
def name_vehicles(names, answer):  # type: ignore[no-untyped-def]
    """Replace the indices of the nearest and binding neighbours by their places in the world."""
    for column in (R_NEAREST, R_BINDING, R_BINDING + 1, R_BINDING + 2):
        if answer[column] >= 0.0:
            answer[column] = names[int(answer[column])]


@kernel(nogil=True)
def avoid_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, error_sum_m, range_m, memory, route, pieces, roadmap, settings, picture,
    scratch, result,
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
        memory: Memory of each vehicle's encounters, read and written, see `new_memory`.
        route: Memory of the way round obstacles, read and written, shape (W, N), int64.
        pieces: Obstacles, the same in every world, as in `avoid_one`; so is `roadmap`.
        roadmap: See `pieces`.
        settings: Constants, `HalfplaneSettings.as_vector`.
        picture: Scratch, blocks for all vehicles of each world; it and `scratch` come from `halfplane_scratch`.
        scratch: Of each world, as in `avoid_one`.
        result: See above.
    """
    # Each thread is given its own worlds, with scratch of their own, so that of the first world is enough.
    candidates, names, lines, chosen, work = scratch
    view, mine = picture[0], (candidates[0], names[0], lines[0], chosen[0], work[0])
    blocks = len(view)
    for world in range(own.shape[0]):
        draw_picture(heard[world], present[world], view)
        for i in range(own.shape[1]):
            if not deciding[world, i]:
                continue
            kept = memory[world, i]
            complete(view, radius_m[world, i], error_sum_m[world, i], kept)
            view[i // LANES, HEARD + i % LANES] = 0.0
            route[world, i] = avoid_one(
                own[world, i],
                view,
                blocks,
                range_m,
                pieces,
                roadmap,
                route[world, i],
                settings,
                mine,
                result[world, i],
            )
            view[i // LANES, HEARD + i % LANES] = 1.0 if present[world, i] else 0.0
            for b in range(blocks):
                copy_lanes(view[b], KEPT, kept, LANES * b)


@kernel(nogil=True)
def rotate_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, error_sum_m, range_m, pieces, settings, fan, crowd, scratch, result
):
    """Decide by rotation, as the paper does, for every vehicle of every world.

    Args:
        own: See above; so are `deciding` to `range_m` and `result`, in which velocity, preferred velocity, command and
            status are filled in.
        deciding: See above.
        heard: See above.
        present: See above.
        radius_m: See above.
        error_sum_m: See above.
        range_m: See above.
        pieces: Obstacles, the same in every world, as in `choose_heading`.
        settings: Constants, `RotationSettings.as_vector`.
        fan: Candidates, `rotation.candidates`.
        crowd: Scratch: blocks for all vehicles of each world, for those that one of them hears, and the places of
            these; it and `scratch` come from `heading_scratch`.
        scratch: Of each world, as in `choose_heading`.
        result: See above.
    """
    picture, neighbours, names = crowd
    sights, walls, way = scratch
    for world in range(own.shape[0]):
        view, few, places = picture[world], neighbours[world], names[world]
        mine = (sights[world], walls[world], way[world])
        vehicles = own.shape[1]
        draw_picture(heard[world], present[world], view)
        for i in range(vehicles):
            if not deciding[world, i]:
                continue
            if vehicles <= SMALL_WORLD:
                fill_in(radius_m[world, i], view, RADIUS)
                view[i // LANES, HEARD + i % LANES] = 0.0
                choose_heading(own[world, i], view, len(view), range_m, pieces, settings, fan, mine, result[world, i])
                view[i // LANES, HEARD + i % LANES] = 1.0 if present[world, i] else 0.0
            else:
                count = gather(own[world], i, radius_m[world, i], error_sum_m[world, i], range_m, view, few, places)
                choose_heading(
                    own[world, i], few, -(-count // LANES), range_m, pieces, settings, fan, mine, result[world, i]
                )


@kernel(nogil=True)
def grade_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, error_sum_m, range_m, pieces, settings, fan, crowd, scratch, result
):
    """Decide by graded risk for every vehicle of every world; arguments as in `rotate_worlds`, with `GradedSettings`
    and `graded.candidates`. Results are complete."""
    picture, neighbours, names = crowd
    sights, walls, way = scratch
    for world in range(own.shape[0]):
        view, few, places = picture[world], neighbours[world], names[world]
        mine = (sights[world], walls[world], way[world])
        draw_picture(heard[world], present[world], view)
        for i in range(own.shape[1]):
            if deciding[world, i]:
                count = gather(own[world], i, radius_m[world, i], error_sum_m[world, i], range_m, view, few, places)
                grade_one(own[world, i], few, count, pieces, settings, fan, mine, result[world, i])
                name_vehicles(places, result[world, i])


def new_memory(worlds: int, vehicles: int) -> np.ndarray:
    """Empty memory of encounters: `Memory` flags, shape (W, N, LANES * blocks), int8."""
    return np.zeros((worlds, vehicles, LANES * blocks_for(vehicles)), np.int8)


def halfplane_scratch(worlds: int, vehicles: int, obstacles: Obstacles) -> tuple[Any, ...]:
    """Scratch arguments of `avoid_worlds`, in its order, for so many worlds of so many vehicles."""
    return for_worlds(new_blocks(vehicles), worlds), for_all_worlds(halfplane.new_scratch(vehicles, obstacles), worlds)


def heading_scratch(worlds: int, vehicles: int, obstacles: Obstacles) -> tuple[Any, ...]:
    """Scratch arguments of `rotate_worlds` and `grade_worlds`, in their order."""
    blocks = new_blocks(vehicles)
    crowd = (blocks, blocks, new_names(len(blocks)))
    return for_all_worlds(crowd, worlds), for_all_worlds(headings.new_scratch(vehicles, obstacles), worlds)
