"""The rows of numbers that every solver's kernels take and give, by the names of their columns.

One own-ship, its neighbours and the result are rows, so that one function serves a single own-ship and whole batches of
worlds, and the same batches feed every solver.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import numpy as np

# Columns of own-ship. AIM is the goal, or the preferred velocity where AIM_IS_VELOCITY is not zero.
(
    POSITION, VELOCITY, COMMAND, AIM, AIM_IS_VELOCITY, LIMIT, CRUISE, CLEARANCE, EXTRA_TURN, OWN_COLUMNS,
) = (0, 2, 4, 6, 8, 9, 10, 11, 12, 13)  # fmt: skip

# Columns of a neighbour. Its position is the reported one, AGE seconds old; the command is NaN where none was given.
N_POSITION, N_VELOCITY, N_COMMAND, AGE, RADIUS, ERROR_SUM, RECIPROCAL, NEIGHBOUR_COLUMNS = (0, 2, 4, 6, 7, 8, 9, 10)

# Columns of the result; BINDING holds three neighbours, -1 where there are fewer.
(
    R_VELOCITY, R_COMMAND, R_PREFERRED, R_STATUS, R_SLACK, R_MARGIN, R_NEAREST, R_TIME, R_BINDING, R_OBSTACLE,
    RESULT_COLUMNS,
) = (0, 2, 4, 6, 7, 8, 9, 10, 11, 14, 15)  # fmt: skip

FREE, CONSTRAINED, OVERLAPPED, INFEASIBLE = 0.0, 1.0, 2.0, 3.0
"""`Status` in a result."""

PASSING_RIGHT, PASSING_LEFT, APART = 1, 2, 4
"""`Memory` of an encounter."""


def result_row() -> np.ndarray:
    """Room for one result."""
    return np.zeros(RESULT_COLUMNS)
