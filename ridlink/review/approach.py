"""Least distances of pairs between two scenes, assuming straight flight in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ridlink.observer import within
from ridlink.observer.scene import FloatArray, Places, Scene

SURELY_M = 0.001
"""More than the rounding error of any position."""


@dataclass(frozen=True, slots=True)
class Approach:
    """Least distances of k pairs since the scene before: each pair once, the lower index first, sorted by index.

    Attributes:
        first, second: Indices of the two, shape (k,).
        distance_m: Least distances of centres, shape (k,); infinite for pairs that are known to fly at safely different
            heights.
        time_s: When, shape (k,).
        lasted_s: Time since the scene before, shape (k,); 0 for a pair if one of the two is not in that scene.
    """

    first: Places
    second: Places
    distance_m: FloatArray
    time_s: FloatArray
    lasted_s: FloatArray


def nearest_since(before: Scene | None, scene: Scene, within_m: float, *, ahead_s: float = 0.0) -> Approach:
    """The approach of pairs from one scene to the next.

    Args:
        before: The scene before, None for none.
        scene: The present one.
        within_m: A distance: no pair is missing that came this near,
        ahead_s: or will within this time, if both fly on.
    """
    at = {} if before is None else {number: index for index, number in enumerate(before.numbers)}
    index = np.array([at.get(number, -1) for number in scene.numbers], np.intp)
    seen = index >= 0
    place, was = scene.position_ne_m, scene.position_ne_m.copy()
    lasted_s = 0.0
    if before is not None:
        was[seen] = before.position_ne_m[index[seen]]
        lasted_s = scene.time_s - before.time_s
    flown_m = np.maximum(np.hypot(*(place - was).T), ahead_s * np.hypot(*scene.velocity_ne_mps.T))
    first, second = within(place, within_m / 2.0 + flown_m + SURELY_M)
    known = seen[first] & seen[second]
    now = (place[second] - place[first]).T
    then = np.where(known, (was[second] - was[first]).T, now)
    north, east = now - then
    square = north * north + east * east
    share = np.clip(-(then[0] * north + then[1] * east) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    distance = np.sqrt((then[0] + share * north) ** 2 + (then[1] + share * east) ** 2)
    distance[scene.apart_at(first, second)] = np.inf
    return Approach(
        first,
        second,
        distance,
        time_s=np.where(known, scene.time_s - (1.0 - share) * lasted_s, scene.time_s),
        lasted_s=np.where(known, lasted_s, 0.0),
    )
