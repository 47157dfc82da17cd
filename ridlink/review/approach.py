"""Least distance of every pair between two scenes, assuming straight flight in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ridlink.observer.scene import FloatArray, Scene


@dataclass(frozen=True, slots=True)
class Approach:
    """Least distances of all pairs since the scene before; n aircraft.

    Attributes:
        distance_m: Least distances of centres, shape (n, n); infinite on the diagonal and for pairs that are known to
            fly at safely different heights.
        time_s: When, shape (n, n).
        lasted_s: Time since the scene before, shape (n, n); 0 for a pair if one of the two is not in that scene.
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
    # One axis at a time: arrays whose last axis has length 2 are several times as slow.
    now = [_offsets(axis) for axis in np.ascontiguousarray(scene.position_ne_m.T)]
    count = len(scene)
    was, known, lasted_s = now, np.zeros((count, count), np.bool_), 0.0
    if before is not None and len(before):
        at = {number: index for index, number in enumerate(before.numbers)}
        index = np.array([at.get(number, -1) for number in scene.numbers], np.intp)
        known = (index >= 0)[:, None] & (index >= 0)[None, :]
        places = np.ascontiguousarray(before.position_ne_m[index].T)
        was = [np.where(known, _offsets(place), axis) for place, axis in zip(places, now, strict=True)]
        lasted_s = scene.time_s - before.time_s
    north, east = now[0] - was[0], now[1] - was[1]
    square = north * north + east * east
    share = np.clip(-(was[0] * north + was[1] * east) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    distance = np.sqrt((was[0] + share * north) ** 2 + (was[1] + share * east) ** 2)
    distance[scene.apart()] = np.inf
    np.fill_diagonal(distance, np.inf)
    return Approach(
        distance_m=distance,
        time_s=np.where(known, scene.time_s - (1.0 - share) * lasted_s, scene.time_s),
        lasted_s=np.where(known, lasted_s, 0.0),
    )


def _offsets(positions_m: FloatArray) -> FloatArray:
    return np.asarray(positions_m[None, :] - positions_m[:, None])
