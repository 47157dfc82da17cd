"""Reports of neighbours in, blocks of columns out, and what is kept of the encounters back again; see `rows`."""

from __future__ import annotations

import math

from ridlink.avoidance.kernel import kernel, norm
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


@kernel(forceinline=True, inner=True)
def place_report(report, block, lane):  # type: ignore[no-untyped-def]
    """Put one report into a lane: position at its time, velocity, command (NaN where none is sent), age, reciprocity in
    columns 0-1, 2-3, 4-5, 6, 7."""
    age = report[6]
    for axis in range(2):
        column = LANES * axis + lane
        block[REPORTED + column], block[N_VELOCITY + column] = report[axis], report[2 + axis]
        block[N_POSITION + column] = report[axis] + report[2 + axis] * age
    commands = not (math.isnan(report[4]) or math.isnan(report[5]))
    block[N_COMMAND + lane] = report[4] if commands else report[2]
    block[N_COMMAND + LANES + lane] = report[5] if commands else report[3]
    block[SPEED + lane] = norm(report[2], report[3])
    block[AGE + lane], block[RECIPROCAL + lane] = age, report[7]


@kernel
def pack(reports, memory, count, blocks):  # type: ignore[no-untyped-def]
    """Put neighbours into blocks.

    Args:
        reports: Rows as in `place_report`, with radius and error sum in columns 8 and 9, shape (>= count, 10).
        memory: `Memory` flags of the encounters, shape (>= count,), int8.
        count: Number of neighbours.
        blocks: Result; lanes without one are not heard.
    """
    for j in range(count):
        block, lane = blocks[j // LANES], j % LANES
        place_report(reports[j], block, lane)
        block[RADIUS + lane], block[ERROR_SUM + lane], block[HEARD + lane] = reports[j, 8], reports[j, 9], 1.0
        block[KEPT + lane] = memory[j]
    for j in range(count, LANES * len(blocks)):
        blocks[j // LANES, HEARD + j % LANES] = 0.0


@kernel
def unpack_memory(blocks, count, memory):  # type: ignore[no-untyped-def]
    """`Memory` flags of the first `count` neighbours, into `memory`."""
    for j in range(count):
        memory[j] = blocks[j // LANES, KEPT + j % LANES]
