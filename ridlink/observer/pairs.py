"""All pairs of a scene under one definition: how far apart, how far they must be, when that will be broken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ridlink.observer.discs import pair_discs
from ridlink.observer.scene import CONSIDERED_M, BoolArray, FloatArray, Scene
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import Definition


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """The pairs of n vehicles. What stands on the diagonals means nothing.

    Attributes:
        radius_m: Radii of their discs, shape (n, n).
        distance_m: Distances between centres, shape (n, n).
        entry_s: Time until the disc is entered if both fly on: 0 inside, infinite if never, shape (n, n).
        apart: Those that are known to fly at safely different heights, shape (n, n).
    """

    radius_m: FloatArray
    distance_m: FloatArray
    entry_s: FloatArray
    apart: BoolArray

    def least_margin(self) -> tuple[int, int] | None:
        """The pair with the least distance over the radius of its disc; None if no pair counts."""
        count = len(self.distance_m)
        if count < 2:
            return None
        excluded = self.apart | (self.distance_m > CONSIDERED_M)
        margin = np.where(excluded, np.inf, self.distance_m - self.radius_m)
        np.fill_diagonal(margin, np.inf)
        least = int(np.argmin(margin))
        first, second = divmod(least, count)
        return (first, second) if np.isfinite(margin[first, second]) else None


def pairs_of(scene: Scene, definition: Definition, *, eta: float = DEFAULT_ETA) -> Pairs:
    """The pairs of a scene.

    Args:
        scene: Everybody.
        definition: What sizes the discs.
        eta: Of ``chance`` only.
    """
    return _pairs(scene, pair_discs(scene, definition, eta=eta))


def closing_times(scene: Scene, radius_m: FloatArray) -> FloatArray:
    """Time until each pair enters its disc if both fly on [s].

    Args:
        scene: Everybody, n of them.
        radius_m: Radii of the discs of the pairs, shape (n, n).

    Returns:
        0 inside, infinite if never or at safely different heights, shape (n, n).
    """
    return _pairs(scene, radius_m).entry_s


def _pairs(scene: Scene, radius_m: FloatArray) -> Pairs:
    gaps = scene.gaps()
    entry = np.full(radius_m.shape, np.inf)
    beyond = gaps.distance_square_m2.take(gaps.nearing) - radius_m.take(gaps.nearing) ** 2
    root = gaps.closing * gaps.closing - gaps.square * beyond
    enters = np.flatnonzero((beyond >= 0.0) & (root > 0.0) & (gaps.square > 1e-12))
    # (closing - sqrt(root)) / square, in the form that does not cancel.
    entry.put(gaps.nearing.take(enters), beyond.take(enters) / (gaps.closing.take(enters) + np.sqrt(root.take(enters))))
    entry = np.minimum(entry, entry.T)
    entry[gaps.counted & (gaps.distance_m < radius_m)] = 0.0
    return Pairs(radius_m, gaps.distance_m, entry, scene.apart())
