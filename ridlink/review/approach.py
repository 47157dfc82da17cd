"""How near every pair came between two scenes, everybody flying straight in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ridlink.observer.sky import BoolArray, FloatArray, Scene


@dataclass(frozen=True, slots=True)
class Approach:
    """Least distances of all pairs since the scene before; n aircraft.

    Attributes:
        distance_m: Least distances of centres, shape (n, n); infinite on the diagonal and for pairs that are known to
            fly at safely different heights.
        time_s: When, shape (n, n).
        lasted_s: Time since the scene before, shape (n, n); 0 for a pair of whom one was not heard then.
    """

    distance_m: FloatArray
    time_s: FloatArray
    lasted_s: FloatArray


def nearest_since(before: Scene | None, scene: Scene) -> Approach:
    """The approach of all pairs from one scene to the next.

    Args:
        before: The scene before, None for none.
        scene: The present one.
    """
    now = _offsets(scene.position_ne_m)
    was, known = now, np.zeros(now.shape[:2], np.bool_)
    lasted_s = 0.0
    if before is not None:
        at = {number: index for index, number in enumerate(before.numbers)}
        index = np.array([at.get(number, -1) for number in scene.numbers], np.intp)
        present = index >= 0
        known = present[:, None] & present[None, :]
        place = np.where(present[:, None], before.position_ne_m[index] if len(before) else 0.0, scene.position_ne_m)
        was = np.where(known[..., None], _offsets(place), now)
        lasted_s = scene.time_s - before.time_s
    way = now - was
    square = (way**2).sum(axis=-1)
    share = np.clip(-(was * way).sum(axis=-1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = was + share[..., None] * way
    distance = np.hypot(nearest[..., 0], nearest[..., 1])
    distance[_nobody(scene)] = np.inf
    return Approach(
        distance_m=distance,
        time_s=np.where(known, scene.time_s - (1.0 - share) * lasted_s, scene.time_s),
        lasted_s=np.where(known, lasted_s, 0.0),
    )


def _offsets(position_ne_m: FloatArray) -> FloatArray:
    return position_ne_m[None, :, :] - position_ne_m[:, None, :]


def _nobody(scene: Scene) -> BoolArray:
    return np.asarray(scene.apart() | np.eye(len(scene), dtype=np.bool_))
