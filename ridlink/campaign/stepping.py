"""A step of batches of worlds, without the decision itself: the inputs of the decision, and the flight after it.

Axes: north-east, metres, m/s, seconds. W worlds of N vehicles. Nothing here allocates.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import rows
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.rows import (
    AIM,
    CLEARANCE,
    COMMAND,
    CRUISE,
    INFEASIBLE,
    LIMIT,
    POSITION,
    R_STATUS,
    R_VELOCITY,
    VELOCITY,
)
from ridlink.campaign import referee
from ridlink.campaign.referee import judge_world
from ridlink.compiled import kernel_decorator

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

kernel = kernel_decorator([Path(module) for module in (__file__, referee.__file__, rows.__file__)], counted=False)


@kernel(nogil=True)
def brief_worlds(  # type: ignore[no-untyped-def]
    position, reported, velocity, goal, speed_mps, still_m, clearance_m, displaced_s, own, heard, radius_m
):
    """Compute own-ships, their reports, and discs, as inputs of `ridlink.avoidance.worlds`.

    Args:
        position: True positions, shape (W, N, 2).
        reported: Reported positions, which the vehicle itself uses, too, shape (W, N, 2).
        velocity: Velocities, shape (W, N, 2).
        goal: Goals, shape (N, 2).
        speed_mps: Cruise speeds, also the speed limits, shape (W, N).
        still_m: Radii without displacement, shape (W, N, N).
        clearance_m: Distances to obstacles without displacement, shape (W, N).
        displaced_s: Time of flight that discs and clearances allow for.
        own: Result, shape (W, N, OWN_COLUMNS); the caller has filled in constant columns.
        heard: Result, shape (W, N, 8); constant columns are filled in, too.
        radius_m: Result, shape (W, N, N).
    """
    for world in range(position.shape[0]):
        for i in range(position.shape[1]):
            row, report = own[world, i], heard[world, i]
            for axis in range(2):
                here, motion = reported[world, i, axis], velocity[world, i, axis]
                row[POSITION + axis] = report[axis] = here
                row[VELOCITY + axis] = row[COMMAND + axis] = report[2 + axis] = motion
                # Vehicles fly to the goal by the true position, as in the paper.
                row[AIM + axis] = goal[i, axis] - position[world, i, axis] + here
            row[LIMIT] = row[CRUISE] = speed_mps[world, i]
            # Temporary place of the speed until the discs are computed.
            row[CLEARANCE] = math.hypot(velocity[world, i, 0], velocity[world, i, 1])
        for i in range(position.shape[1]):
            speed = own[world, i, CLEARANCE]
            for j in range(position.shape[1]):
                radius_m[world, i, j] = still_m[world, i, j] + displaced_s * (speed + own[world, j, CLEARANCE])
        for i in range(position.shape[1]):
            own[world, i, CLEARANCE] = clearance_m[world, i] + displaced_s * own[world, i, CLEARANCE]


@kernel
def is_in_piece(vertex, start, p_1, p_2):  # type: ignore[no-untyped-def]
    """Whether a point lies in one of the convex pieces `vertex[start[k]:start[k + 1]]`."""
    for piece in range(len(start) - 1):
        first, last = start[piece], start[piece + 1]
        inside = True
        for k in range(first, last):
            following = k + 1 if k + 1 < last else first
            side_1, side_2 = vertex[following, 0] - vertex[k, 0], vertex[following, 1] - vertex[k, 1]
            if side_1 * (p_2 - vertex[k, 1]) - side_2 * (p_1 - vertex[k, 0]) < 0.0:
                inside = False
                break
        if inside:
            return True
    return False


class Rules(NamedTuple):
    """Facts that are the same in every world and at every step.

    Attributes:
        goal: Goals, shape (N, 2).
        avoiding: Mask of vehicles that decide, shape (N,).
        arrived_m: A vehicle this close to its goal has arrived.
        pieces: Convex pieces of the obstacles, as in `is_in_piece`; so is `piece_start`.
        piece_start: See `pieces`.
        swept: Judge the whole interval, and not only its end.
        interval_s: Time to fly.
    """

    goal: FloatArray
    avoiding: BoolArray
    arrived_m: float
    pieces: FloatArray
    piece_start: IntArray
    swept: bool
    interval_s: float


class Flight(NamedTuple):
    """Worlds in flight; everything except the airframes is written.

    Attributes:
        position: True positions, shape (W, N, 2).
        before: True positions before the step, shape (W, N, 2).
        velocity: Velocities, shape (W, N, 2).
        present: Mask of vehicles in the air, shape (W, N).
        hit: Mask of vehicles that collided in the step, shape (W, N).
        airframe_m: Airframe sizes, shape (W, N).
    """

    position: FloatArray
    before: FloatArray
    velocity: FloatArray
    present: BoolArray
    hit: BoolArray
    airframe_m: FloatArray


class Log(NamedTuple):
    """Columns of `worlds.Outcomes` that are written during the flight, of R runs."""

    arrival_s: FloatArray
    collided: BoolArray
    distance_m: FloatArray
    margin_m: FloatArray
    decisions: IntArray
    infeasible: IntArray
    in_obstacle: IntArray


@kernel(nogil=True)
def fly_on(result, now_s, rules, flight, row, log):  # type: ignore[no-untyped-def]
    """Fly for an interval as decided, and log the outcomes.

    Args:
        result: Decisions, shape (W, N, RESULT_COLUMNS).
        now_s: Time at the end of the interval.
        rules: `Rules`.
        flight: `Flight`, written.
        row: Row of each world in the log, shape (W,).
        log: `Log`, written.
    """
    goal, avoiding, arrived_m, pieces, piece_start, swept, interval_s = rules
    position, before, velocity, present, hit, airframe_m = flight
    arrival_s, collided, distance_m, margin_m, decisions, infeasible, in_obstacle = log
    near = arrived_m * arrived_m
    for world in range(position.shape[0]):
        at, here = row[world], present[world]
        for i in range(position.shape[1]):
            if here[i] and avoiding[i]:
                decisions[at] += 1
                if result[world, i, R_STATUS] == INFEASIBLE:
                    infeasible[at] += 1
                velocity[world, i, 0] = result[world, i, R_VELOCITY]
                velocity[world, i, 1] = result[world, i, R_VELOCITY + 1]
            for axis in range(2):
                before[world, i, axis] = position[world, i, axis]
                position[world, i, axis] += velocity[world, i, axis] * interval_s
        distance_m[at], margin_m[at] = judge_world(
            before[world], position[world], here, airframe_m[world], swept, hit[world], distance_m[at], margin_m[at]
        )
        for i in range(position.shape[1]):
            if not here[i]:
                continue
            p_1, p_2 = position[world, i, 0], position[world, i, 1]
            if is_in_piece(pieces, piece_start, p_1, p_2):
                in_obstacle[at] += 1
            to_1, to_2 = goal[i, 0] - p_1, goal[i, 1] - p_2
            if hit[world, i]:
                collided[at, i] = True
                here[i] = False
            elif to_1 * to_1 + to_2 * to_2 < near:
                arrival_s[at, i] = now_s
                here[i] = False


@kernel
def mark_inside(vertex, start, position, inside):  # type: ignore[no-untyped-def]
    """`is_in_piece` of positions (n, 2), into `inside`, shape (n,)."""
    for k in range(len(position)):
        inside[k] = is_in_piece(vertex, start, position[k, 0], position[k, 1])


def is_inside(obstacles: Obstacles, position_ne_m: FloatArray) -> BoolArray:
    """Whether positions (..., 2) lie in an obstacle, shape (...)."""
    flat = np.ascontiguousarray(position_ne_m).reshape(-1, 2)
    inside = np.zeros(len(flat), np.bool_)
    mark_inside(obstacles.piece_vertex_ne_m, obstacles.piece_start, flat, inside)
    return inside.reshape(position_ne_m.shape[:-1])
