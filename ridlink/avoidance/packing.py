"""Reports of neighbours to blocks of columns, and the memory of encounters back again; see `rows`."""

from __future__ import annotations

import math

from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.lanes import turn_lanes
from ridlink.avoidance.rows import (
    AGE,
    ERROR_SUM,
    HEARD,
    KEPT,
    LANES,
    N_COMMAND,
    N_POSITION,
    N_VELOCITY,
    RADIUS,
    RECIPROCAL,
    REPORTED,
    SPEED,
)
from ridlink.avoidance.sift import SURELY


@kernel(forceinline=True, inner=True)
def place_report(report, block, lane):  # type: ignore[no-untyped-def]
    """Put one report into a lane, as `place_reports` does."""
    age = report[6]
    for axis in range(2):
        column = LANES * axis + lane
        block[REPORTED + column], block[N_VELOCITY + column] = report[axis], report[2 + axis]
        block[N_POSITION + column] = report[axis] + report[2 + axis] * age
    commands = not (math.isnan(report[4]) or math.isnan(report[5]))
    block[N_COMMAND + lane] = report[4] if commands else report[2]
    block[N_COMMAND + LANES + lane] = report[5] if commands else report[3]
    block[SPEED + lane] = SURELY * norm(report[2], report[3])
    block[AGE + lane], block[RECIPROCAL + lane] = age, report[7]


@kernel(forceinline=True, inner=True)
def place_reports(reports, count, blocks):  # type: ignore[no-untyped-def]
    """Put reports into blocks.

    Args:
        reports: Position at its time, velocity, command (NaN where none is sent), age, reciprocity in columns 0-1, 2-3,
            4-5, 6, 7, shape (>= count, >= 8).
        count: Number of reports.
        blocks: Result.
    """
    whole = count // LANES
    for b in range(whole):
        block = blocks[b]
        turn_lanes(reports, LANES * b, 0, block, REPORTED, REPORTED + LANES, N_VELOCITY, N_VELOCITY + LANES)
        turn_lanes(reports, LANES * b, 4, block, N_COMMAND, N_COMMAND + LANES, AGE, RECIPROCAL)
        for k in range(LANES):
            u_1, u_2, age = block[N_VELOCITY + k], block[N_VELOCITY + LANES + k], block[AGE + k]
            block[N_POSITION + k] = block[REPORTED + k] + u_1 * age
            block[N_POSITION + LANES + k] = block[REPORTED + LANES + k] + u_2 * age
            c_1, c_2 = block[N_COMMAND + k], block[N_COMMAND + LANES + k]
            # Nothing but NaN differs from itself.
            commands = (c_1 == c_1) & (c_2 == c_2)
            block[N_COMMAND + k], block[N_COMMAND + LANES + k] = c_1 if commands else u_1, c_2 if commands else u_2
            block[SPEED + k] = SURELY * norm(u_1, u_2)
    for j in range(LANES * whole, count):
        place_report(reports[j], blocks[whole], j % LANES)


@kernel
def pack(reports, memory, count, blocks):  # type: ignore[no-untyped-def]
    """Put neighbours into blocks.

    Args:
        reports: Rows as in `place_reports`, with radius and error sum in columns 8 and 9, shape (>= count, 10).
        memory: `Memory` flags of the encounters, shape (>= count,), int8.
        count: Number of neighbours.
        blocks: Result; lanes without a neighbour are not heard.
    """
    place_reports(reports, count, blocks)
    for j in range(count):
        block, lane = blocks[j // LANES], j % LANES
        block[RADIUS + lane], block[ERROR_SUM + lane], block[HEARD + lane] = reports[j, 8], reports[j, 9], 1.0
        block[KEPT + lane] = memory[j]
    for j in range(count, LANES * len(blocks)):
        blocks[j // LANES, HEARD + j % LANES] = 0.0


@kernel
def unpack_memory(blocks, count, memory):  # type: ignore[no-untyped-def]
    """Write the `Memory` flags of the first `count` neighbours to `memory`."""
    for j in range(count):
        memory[j] = blocks[j // LANES, KEPT + j % LANES]
