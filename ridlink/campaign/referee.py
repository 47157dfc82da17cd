"""Who collided, and how near everybody came: judged on true positions, which no vehicle knows.

Units: metres. W worlds of N vehicles; a mid-air collision (MAC) is a true distance of centres below half the sum of the
airframes, paper Eq. 9.
"""

from __future__ import annotations

import math
from pathlib import Path

from numba import prange

from ridlink.compiled import kernel_decorator

kernel = kernel_decorator([Path(__file__)])


@kernel
def smallest_distance(a_1, a_2, b_1, b_2):  # type: ignore[no-untyped-def]
    """Smallest distance to the origin on the straight way from a to b."""
    d_1, d_2 = b_1 - a_1, b_2 - a_2
    square = d_1 * d_1 + d_2 * d_2
    share = -(a_1 * d_1 + a_2 * d_2) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(a_1 + share * d_1, a_2 + share * d_2)


@kernel(parallel=True)
def judge_worlds(before, position, present, airframe_m, swept, hit, distance_m, margin_m):  # type: ignore[no-untyped-def]
    """Judge one step of every world.

    Args:
        before: True positions at its beginning, shape (W, N, 2).
        position: True positions at its end, shape (W, N, 2).
        present: True while a vehicle is in the air, shape (W, N).
        airframe_m: Airframe sizes, shape (W, N).
        swept: Judge the whole step, and not only its end.
        hit: Result: True for vehicles in a collision, shape (W, N).
        distance_m: Smallest distance of centres so far, read and written, shape (W,).
        margin_m: The same less the MAC radius, read and written, shape (W,).
    """
    for world in prange(position.shape[0]):
        for i in range(position.shape[1]):
            hit[world, i] = False
        for i in range(position.shape[1]):
            if not present[world, i]:
                continue
            for j in range(i + 1, position.shape[1]):
                if not present[world, j]:
                    continue
                b_1 = position[world, j, 0] - position[world, i, 0]
                b_2 = position[world, j, 1] - position[world, i, 1]
                if swept:
                    a_1 = before[world, j, 0] - before[world, i, 0]
                    a_2 = before[world, j, 1] - before[world, i, 1]
                    distance = smallest_distance(a_1, a_2, b_1, b_2)
                else:
                    distance = math.hypot(b_1, b_2)
                margin = distance - (airframe_m[world, i] + airframe_m[world, j]) / 2.0
                distance_m[world] = min(distance_m[world], distance)
                margin_m[world] = min(margin_m[world], margin)
                if margin < 0.0:
                    hit[world, i] = hit[world, j] = True
