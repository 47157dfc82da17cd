"""The referee: collisions and nearest distances of true positions, which no vehicle knows.

Units: metres. W worlds of N vehicles; a mid-air collision (MAC) is a true distance of centres below half the sum of the
airframes, paper Eq. 9.
"""

from __future__ import annotations

import math
from pathlib import Path

from ridlink.compiled import kernel_decorator

kernel = kernel_decorator([Path(__file__)], counted=False)

SHARE_OFF = 1e-9
"""Relative margin far above the rounding error of a distance."""


@kernel
def smallest_distance(a_1, a_2, b_1, b_2):  # type: ignore[no-untyped-def]
    """Smallest distance to the origin on the straight line from a to b."""
    d_1, d_2 = b_1 - a_1, b_2 - a_2
    square = d_1 * d_1 + d_2 * d_2
    share = -(a_1 * d_1 + a_2 * d_2) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(a_1 + share * d_1, a_2 + share * d_2)


@kernel
def judge_world(before, position, present, airframe_m, swept, hit, distance_m, margin_m):  # type: ignore[no-untyped-def]
    """Judge one step of one world; arguments as in `judge_worlds` without the axis of worlds.

    Pairs that are too far apart to collide or to be the nearest so far are skipped by the square of their distance.

    Returns:
        Smallest distance of centres so far, and the same less the MAC radius.
    """
    largest = stride = 0.0
    for i in range(len(position)):
        hit[i] = False
        largest = max(largest, airframe_m[i])
        if swept:
            d_1, d_2 = position[i, 0] - before[i, 0], position[i, 1] - before[i, 1]
            stride = max(stride, math.sqrt(d_1 * d_1 + d_2 * d_2))
    limit = 0.0
    again = True
    for i in range(len(position)):
        if not present[i]:
            continue
        for j in range(i + 1, len(position)):
            if not present[j]:
                continue
            if again:
                # Within a step, a distance shrinks by at most the sum of both flown distances.
                limit = (max(distance_m, margin_m + largest, largest) + 2.0 * stride) * (1.0 + SHARE_OFF)
                limit, again = limit * limit, False
            b_1, b_2 = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1]
            if b_1 * b_1 + b_2 * b_2 > limit:
                continue
            if swept:
                a_1, a_2 = before[j, 0] - before[i, 0], before[j, 1] - before[i, 1]
                distance = smallest_distance(a_1, a_2, b_1, b_2)
            else:
                distance = math.hypot(b_1, b_2)
            margin = distance - (airframe_m[i] + airframe_m[j]) / 2.0
            again = distance < distance_m or margin < margin_m
            distance_m, margin_m = min(distance_m, distance), min(margin_m, margin)
            if margin < 0.0:
                hit[i] = hit[j] = True
    return distance_m, margin_m


@kernel(nogil=True)
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
    for world in range(position.shape[0]):
        distance_m[world], margin_m[world] = judge_world(
            before[world], position[world], present[world], airframe_m[world], swept, hit[world], distance_m[world],
            margin_m[world],
        )  # fmt: skip
