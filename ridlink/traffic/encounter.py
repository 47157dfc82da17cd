"""Encounters at constant velocities: when a disc is entered, and how near the pair gets. Arrays over n neighbours.

Axes: north-east about own-ship, metres, m/s, seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Encounters:
    """Encounters if all vehicles fly on.

    Attributes:
        margin_m: Distance now less the radius of the disc, shape (n,).
        entry_s: Time until the disc is entered; 0 inside, infinite if never, shape (n,).
        closest_s: Time of the closest approach, 0 if it is past, shape (n,).
        miss_m: Distance at that time, shape (n,).
    """

    margin_m: FloatArray
    entry_s: FloatArray
    closest_s: FloatArray
    miss_m: FloatArray


def encounters(relative_position_m: FloatArray, relative_velocity_mps: FloatArray, radius_m: FloatArray) -> Encounters:
    """Closest approaches and entries into discs.

    Args:
        relative_position_m: Neighbours as seen from own-ship now, shape (n, 2).
        relative_velocity_mps: Their velocities less the own one, shape (n, 2).
        radius_m: Radii of the discs of the pairs, shape (n,).
    """
    distance = np.hypot(relative_position_m[:, 0], relative_position_m[:, 1])
    square = (relative_velocity_mps**2).sum(axis=1)
    closing = -(relative_position_m * relative_velocity_mps).sum(axis=1)
    moving = square > 1e-12
    safe = np.where(moving, square, 1.0)
    closest = np.where(moving, np.maximum(closing / safe, 0.0), 0.0)
    at_closest = relative_position_m + relative_velocity_mps * closest[:, None]
    inside = distance < radius_m
    root = closing**2 - square * (distance**2 - radius_m**2)
    enters = moving & (closing > 0.0) & (root > 0.0)
    entry = np.where(enters, (closing - np.sqrt(np.maximum(root, 0.0))) / safe, np.inf)
    return Encounters(
        margin_m=distance - radius_m,
        entry_s=np.where(inside, 0.0, entry),
        closest_s=closest,
        miss_m=np.hypot(at_closest[:, 0], at_closest[:, 1]),
    )
