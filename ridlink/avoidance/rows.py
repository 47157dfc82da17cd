"""Columns of the numbers that every solver's kernels take and give.

One own-ship and its result are rows of numbers, its neighbours are blocks of numbers. So one function serves a single
own-ship and whole batches of worlds, and the same batches feed every solver.

A block holds LANES neighbours column after column: number `COLUMN + lane` of a block is COLUMN of the neighbour in that
lane. What is done to every neighbour alike is done to all lanes of a block in a few instructions. The first number of a
pair is at its COLUMN, the second at COLUMN + LANES.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import numpy as np

# Columns of own-ship. AIM is the goal, or the preferred velocity if AIM_IS_VELOCITY is not zero.
(
    POSITION, VELOCITY, COMMAND, AIM, AIM_IS_VELOCITY, LIMIT, CRUISE, CLEARANCE, EXTRA_TURN, OWN_COLUMNS,
) = (0, 2, 4, 6, 8, 9, 10, 11, 12, 13)  # fmt: skip

LANES = 4
"""Neighbours in a block: as many as a register of 256 bits holds, which the compiler uses. Eight are no faster."""

# Columns of a block of neighbours. N_POSITION is where the neighbour is now, REPORTED where its report had it.
# N_COMMAND is its velocity if it sent no command; SPEED is its speed, rounded up. Lanes with HEARD zero do not count.
# KEPT is the memory of the encounter, a sum of `Memory` flags. The kernels fill in WIDE, the radius with its buffer,
# and the columns from GAP on: distance less radius, whether the neighbour matters, the passing side, half-planes of now
# and of later (n_1, n_2, bound). What half-planes are made of comes first, then the command.
(
    N_POSITION, N_VELOCITY, RECIPROCAL, RADIUS, KEPT, WIDE, N_COMMAND, HEARD, ERROR_SUM, AGE, SPEED, REPORTED, GAP,
    MATTERS, SIDE, NOW, LATER, BLOCK,
) = (LANES * column for column in (0, 2, 4, 5, 6, 7, 8, 10, 11, 12, 13, 14, 16, 17, 18, 19, 22, 25))  # fmt: skip

# Columns of the result. BINDING holds three neighbours, -1 if there are fewer; HARD is the number of columns of
# half-planes that obstacles have, if a solver has any; MATTERING is the number of neighbours that could matter.
(
    R_VELOCITY, R_COMMAND, R_PREFERRED, R_STATUS, R_SLACK, R_MARGIN, R_NEAREST, R_TIME, R_BINDING, R_OBSTACLE, R_HARD,
    R_MATTERING, RESULT_COLUMNS,
) = (0, 2, 4, 6, 7, 8, 9, 10, 11, 14, 15, 16, 17)  # fmt: skip

FREE, CONSTRAINED, OVERLAPPED, INFEASIBLE = 0.0, 1.0, 2.0, 3.0
"""`Status` in a result."""

PASSING_RIGHT, PASSING_LEFT, IS_APART = 1, 2, 4
"""`Memory` of an encounter."""

# Columns of the settings vector of the half-plane solver, in the order of the fields of HalfplaneSettings.
(
    HORIZON, RESPONSE, BARRIER, BARRIER_SHARE, SMOOTHING, RIGHT_TURN, START_TURN, AGE_ACCELERATION, BUFFER_SHARE,
    ARRIVAL, HEAD_ON_COSINE, HEAD_ON_SPEED, OBSTACLE_HORIZON, OBSTACLE_DECELERATION, OBSTACLE_RESPONSE, ROUTE_MARGIN,
    CONTACT_STEP, ACCELERATION,
) = range(18)  # fmt: skip


LINE_BYTES = 64
"""Bytes in a line of the cache."""


def aligned(array: np.ndarray) -> np.ndarray:
    """Copy that begins at a line of the cache; otherwise what is read in one piece may lie in two lines."""
    room = np.zeros(array.nbytes + LINE_BYTES, np.uint8)
    begin = -room.ctypes.data % LINE_BYTES
    copy = room[begin : begin + array.nbytes].view(array.dtype).reshape(array.shape)
    copy[...] = array
    return copy


def for_worlds(array: np.ndarray, worlds: int) -> np.ndarray:
    """A copy of the scratch for each of so many worlds, on a leading axis."""
    return aligned(np.stack([array] * worlds))


def for_all_worlds(scratch: tuple[np.ndarray, ...], worlds: int) -> tuple[np.ndarray, ...]:
    """`for_worlds` for every array of a scratch."""
    return tuple(for_worlds(array, worlds) for array in scratch)


def blocks_for(count: int) -> int:
    """Number of blocks that hold so many neighbours."""
    return -(-count // LANES)


def new_blocks(count: int) -> np.ndarray:
    """Room for so many neighbours, shape (blocks, BLOCK); none is heard yet."""
    return aligned(np.zeros((blocks_for(count), BLOCK)))


def new_names(blocks: int) -> np.ndarray:
    """Room for the places of all neighbours in so many blocks, int64, which are written LANES at a time."""
    return np.zeros(LANES * (blocks + 1), np.int64)


def result_row() -> np.ndarray:
    """Room for one result."""
    return np.zeros(RESULT_COLUMNS)
