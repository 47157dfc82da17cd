"""Finds pairs that are near each other without comparing all pairs: vehicles are sorted by northing and taken a few at
a time.

For n vehicles with reach r in a square of side s, about n * n * r / s pairs are compared, in pieces that fit into a
processor cache. Positions are in metres, velocities in metres a second, both north and east, shape (n, 2). Pairs are
returned as two arrays of indices, shape (k,) each: each pair once, the lower index first, sorted by index.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ridlink.observer.scene import BoolArray, FloatArray, Places

AT_ONCE = 32


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """A few vehicles, and the vehicles after the first of them that are not too far north for any of the few.

    Attributes:
        few, others: Their indices.
        to_north_m, to_east_m: Offsets from the few to the others, shape (few, others).
    """

    few: Places
    others: Places
    to_north_m: FloatArray
    to_east_m: FloatArray


def within(position_ne_m: FloatArray, reach_m: FloatArray) -> tuple[Places, Places]:
    """Pairs whose distance is at most the sum of their reaches.

    Args:
        position_ne_m: Positions of all vehicles.
        reach_m: Reach of each vehicle, not negative, shape (n,).
    """

    def near(piece: _Piece) -> BoolArray:
        both = reach_m[piece.others] + reach_m[piece.few, None]
        return np.asarray(piece.to_north_m**2 + piece.to_east_m**2 <= both * both)

    return _together((piece, near(piece)) for piece in _pieces(position_ne_m, reach_m))


def meeting(
    position_ne_m: FloatArray, velocity_ne_mps: FloatArray, distance_m: float, horizon_s: float
) -> tuple[Places, Places]:
    """Pairs whose distance is at most `distance_m`, or will be within the horizon if both fly on.

    Args:
        position_ne_m, velocity_ne_mps: Positions and velocities of all vehicles.
        distance_m: The distance.
        horizon_s: The horizon.
    """
    north_mps, east_mps = np.ascontiguousarray(velocity_ne_mps.T)

    def near(piece: _Piece) -> BoolArray:
        few, others = piece.few[:, None], piece.others
        v_north, v_east = north_mps[others] - north_mps[few], east_mps[others] - east_mps[few]
        closing = piece.to_north_m * v_north + piece.to_east_m * v_east
        until_s = np.clip(-closing / np.maximum(v_north * v_north + v_east * v_east, 1e-12), 0.0, horizon_s)
        north, east = piece.to_north_m + until_s * v_north, piece.to_east_m + until_s * v_east
        return np.asarray(north * north + east * east <= distance_m * distance_m)

    reach = distance_m / 2.0 + horizon_s * np.hypot(north_mps, east_mps)
    return _together((piece, near(piece)) for piece in _pieces(position_ne_m, reach))


def _pieces(position_ne_m: FloatArray, reach_m: FloatArray) -> Iterator[_Piece]:
    order = np.argsort(position_ne_m[:, 0], kind="stable")
    north, east = np.ascontiguousarray(position_ne_m[order].T)
    last = np.searchsorted(north, north + reach_m[order] + reach_m.max(initial=0.0), side="right")
    for begin in range(0, len(order), AT_ONCE):
        few = slice(begin, begin + AT_ONCE)
        others = slice(begin, int(last[few].max()))
        yield _Piece(order[few], order[others], north[others] - north[few, None], east[others] - east[few, None])


def _together(found: Iterator[tuple[_Piece, BoolArray]]) -> tuple[Places, Places]:
    pairs = []
    for piece, near in found:
        i, j = np.nonzero(np.triu(near, 1))  # the few are the first of the others
        pairs.append((piece.few[i], piece.others[j]))
    if not pairs:
        return np.empty(0, np.intp), np.empty(0, np.intp)
    one, other = map(np.concatenate, zip(*pairs, strict=True))
    first, second = np.minimum(one, other), np.maximum(one, other)
    placed = np.lexsort((second, first))
    return first[placed], second[placed]
