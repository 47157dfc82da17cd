"""Reports of neighbours in, blocks of columns out, and what is kept of the encounters back again; see `rows`."""

from __future__ import annotations

import math

from ridlink.avoidance.kernel import kernel
from ridlink.avoidance.rows import (
    AGE,
    APART,
    ERROR_SUM,
    HEARD,
    IS_APART,
    LANES,
    N_COMMAND,
    N_POSITION,
    N_VELOCITY,
    PASSING_LEFT,
    PASSING_RIGHT,
    RADIUS,
    RECIPROCAL,
    REPORTED,
    SIDE,
)


@kernel(forceinline=True)
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
        block, lane, flags = blocks[j // LANES], j % LANES, memory[j]
        place_report(reports[j], block, lane)
        block[RADIUS + lane], block[ERROR_SUM + lane], block[HEARD + lane] = reports[j, 8], reports[j, 9], 1.0
        left = -1.0 if (flags & PASSING_LEFT) != 0 else 0.0
        block[SIDE + lane] = 1.0 if (flags & PASSING_RIGHT) != 0 else left
        block[APART + lane] = 1.0 if (flags & IS_APART) != 0 else 0.0
    for j in range(count, LANES * len(blocks)):
        blocks[j // LANES, HEARD + j % LANES] = 0.0


@kernel
def unpack_memory(blocks, count, memory):  # type: ignore[no-untyped-def]
    """`Memory` flags of the first `count` neighbours, into `memory`."""
    for j in range(count):
        block, lane = blocks[j // LANES], j % LANES
        side, apart = block[SIDE + lane], block[APART + lane]
        flags = PASSING_RIGHT if side > 0.0 else PASSING_LEFT if side < 0.0 else 0
        memory[j] = flags + (IS_APART if apart != 0.0 else 0)
