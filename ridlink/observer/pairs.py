"""Pairs of a scene under one definition: which come too near, and when; and the nearest neighbour of each vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ridlink.observer.discs import discs_at, largest_disc
from ridlink.observer.near import meeting, within
from ridlink.observer.scene import CONSIDERED_M, BoolArray, FloatArray, Places, Scene
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import Definition

HORIZON_S = 30.0
NOBODY: Places = np.empty(0, np.intp)
FEW = 100
"""Up to this number of vehicles, each is compared with all others."""

FURTHER = 4.0
"""With more vehicles, the reach grows by this factor for those that have found no neighbour."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Some pairs of a scene, k of them.

    Attributes:
        first, second: Indices of the two, shape (k,).
        radius_m: Radii of their discs, shape (k,).
        distance_m: Distances between centres, shape (k,).
        entry_s: Time until the disc is entered if both fly on: 0 inside, infinite if never, if they are apart, or if
            they are more than 2 km from each other, shape (k,).
        apart: Whether they are known to fly at safely different heights, shape (k,).
    """

    first: Places
    second: Places
    radius_m: FloatArray
    distance_m: FloatArray
    entry_s: FloatArray
    apart: BoolArray

    def __len__(self) -> int:
        return len(self.first)

    def only(self, which: BoolArray) -> Pairs:
        """The pairs for which the mask is true, shape (k,)."""
        return Pairs(
            self.first[which],
            self.second[which],
            self.radius_m[which],
            self.distance_m[which],
            self.entry_s[which],
            self.apart[which],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Nearest:
    """For each of n vehicles, the neighbour with the least margin to the disc of the pair.

    Attributes:
        who: Index of the neighbour, -1 if there is none, shape (n,).
        distance_m, radius_m: Distance and disc radius of the pair; infinite and 0 if there is none, shape (n,).
    """

    who: Places
    distance_m: FloatArray
    radius_m: FloatArray


def pairs_of(scene: Scene, definition: Definition) -> Pairs:
    """Pairs of a scene that are inside their discs, or will be within half a minute if both fly on.

    Args:
        scene: All aircraft.
        definition: What sizes the discs.

    Returns:
        Each pair once, the lower index first, sorted by index.
    """
    if not len(scene):
        return pairs_at(scene, NOBODY, NOBODY, definition)
    largest = 1.001 * largest_disc(scene, definition)
    first, second = meeting(scene.position_ne_m, scene.velocity_ne_mps, largest, HORIZON_S)
    pairs = pairs_at(scene, first, second, definition)
    return pairs.only(pairs.entry_s <= HORIZON_S)


def pairs_at(scene: Scene, first: Places, second: Places, definition: Definition, *, eta: float = DEFAULT_ETA) -> Pairs:
    """Facts of given pairs of a scene.

    Args:
        scene: All aircraft.
        first, second: Indices of the two of each pair, shape (k,).
        definition: What sizes the discs.
        eta: Parameter of ``chance`` only.
    """
    radius, apart = discs_at(scene, first, second, definition, eta=eta), scene.apart_at(first, second)
    north, east = (scene.position_ne_m[second] - scene.position_ne_m[first]).T
    distance_square = north * north + east * east
    distance = np.sqrt(distance_square)
    entry = _entry(distance_square - radius * radius, *_closing(scene, first, second))
    entry[distance < radius] = 0.0
    entry[apart | (distance > CONSIDERED_M)] = np.inf
    return Pairs(first, second, radius, distance, entry, apart)


def least_margin(scene: Scene, definition: Definition) -> Pairs:
    """The pair with the least margin between distance and disc radius, of those within 2 km that are not apart.

    Args:
        scene: All aircraft.
        definition: What sizes the discs.

    Returns:
        One pair, or none.
    """
    for surely_m, pairs in _further_and_further(scene, definition, CONSIDERED_M):
        margin = pairs.distance_m - pairs.radius_m
        if len(pairs) and margin.min() <= surely_m:
            return pairs.only(np.arange(len(pairs)) == margin.argmin())
    return pairs_at(scene, NOBODY, NOBODY, definition)


def nearest_of(scene: Scene, definition: Definition) -> Nearest:
    """For each vehicle the neighbour with the least margin to the disc of the pair, of those not at safely different
    heights.

    Args:
        scene: All n aircraft.
        definition: What sizes the discs.
    """
    count = len(scene)
    found = Nearest(np.full(count, -1, np.intp), np.full(count, np.inf), np.zeros(count))
    looks = np.ones(count, np.bool_)
    for surely_m, pairs in _further_and_further(scene, definition, np.inf, looks):
        own, other = np.concatenate([pairs.second, pairs.first]), np.concatenate([pairs.first, pairs.second])
        distance, radius = np.tile(pairs.distance_m, 2), np.tile(pairs.radius_m, 2)
        chosen = np.argsort(distance - radius, kind="stable")[::-1]  # the least margin is written last
        chosen = chosen[looks[own[chosen]]]
        places = own[chosen]
        found.who[places], found.distance_m[places], found.radius_m[places] = (
            other[chosen],
            distance[chosen],
            radius[chosen],
        )
        looks &= found.distance_m - found.radius_m > surely_m
    return found


def _further_and_further(
    scene: Scene, definition: Definition, farthest_m: float, looks: BoolArray | None = None
) -> Iterator[tuple[float, Pairs]]:
    """Pairs within a reach that grows until it is the farthest, or no vehicle needs more.

    Args:
        scene: All n aircraft.
        definition: What sizes the discs.
        farthest_m: Largest distance of a pair that counts.
        looks: Mask of vehicles whose pairs are wanted, by default all, shape (n,); the caller may clear entries
            meanwhile.

    Yields:
        The margin up to which no pair is missing, and pairs that are not apart.
    """
    if len(scene) < 2:
        return
    looks = np.ones(len(scene), np.bool_) if looks is None else looks
    largest = largest_disc(scene, definition)
    farthest_m = min(farthest_m, 1.001 * float(np.hypot(*np.ptp(scene.position_ne_m, axis=0))))
    reach = 2.0 * largest if len(scene) > FEW else farthest_m
    while looks.any():
        reach, is_all = min(reach, farthest_m), reach >= farthest_m
        first, second = within(scene.position_ne_m, np.where(looks, reach / (1.0 + looks.all()), 0.0))
        pairs = pairs_at(scene, first, second, definition)
        yield np.inf if is_all else reach - largest, pairs.only(~pairs.apart & (pairs.distance_m <= reach))
        if is_all:
            return
        reach *= FURTHER


def _closing(scene: Scene, first: Places, second: Places) -> tuple[FloatArray, FloatArray]:
    """Offset times relative velocity, positive where they come nearer [m2/s], and its square [m2/s2]; shape (k,)."""
    north, east = (scene.position_ne_m[second] - scene.position_ne_m[first]).T
    v_north, v_east = (scene.velocity_ne_mps[second] - scene.velocity_ne_mps[first]).T
    return np.asarray(-(north * v_north + east * v_east)), v_north * v_north + v_east * v_east


def _entry(beyond: FloatArray, closing: FloatArray, square: FloatArray) -> FloatArray:
    """Time until a disc is entered from outside [s], infinite if never; shape (k,).

    Args:
        beyond: Square of the distance less that of the radius [m2], shape (k,).
        closing, square: As from `_closing`.
    """
    entry = np.full(beyond.shape, np.inf)
    root = closing * closing - square * beyond
    enters = np.flatnonzero((closing > 0.0) & (beyond >= 0.0) & (root > 0.0) & (square > 1e-12))
    # (closing - sqrt(root)) / square, in a form without cancellation.
    entry[enters] = beyond[enters] / (closing[enters] + np.sqrt(root[enters]))
    return entry
