"""Static obstacles: polygons in north-east metres, checked once and laid out flat for the kernels.

The half-plane of an obstacle comes from its nearest point, which needs convex pieces. Concave polygons are cut into
triangles ("ear clipping"), which are merged again while they stay convex.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.avoidance.types import FARTHEST

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Polygons = tuple[FloatArray, IntArray]
"""Vertices of convex polygons, shape (m, 2), and the index at which each polygon begins, with the end."""

MIN_AREA_M2 = 1e-6
"""A smaller polygon is a point or a line and has no inside."""

STRAIGHT_M2 = -1e-9
"""A corner that turns back by no more than rounding is straight."""

LOST_SHARE = 1e-6
"""Pieces whose area differs by more than this share are not those of the polygon: nothing is flown by them."""


def _cross(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def signed_area(polygon: FloatArray) -> float:
    """Area [m^2], positive when the vertices turn from north to east (clockwise on a map)."""
    following = np.roll(polygon, -1, axis=0)
    return float(np.sum(polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]) / 2.0)


def _checked(polygon: ArrayLike, name: str) -> FloatArray:
    vertices = np.asarray(polygon, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 2:
        raise ValueError(f"{name} must have shape (k, 2), got {vertices.shape}")
    within = np.all(np.abs(vertices) <= FARTHEST, axis=1)
    if not np.all(within):
        raise ValueError(f"{name} must be finite and within {FARTHEST:g}, got {vertices[~within][0].tolist()}")
    distinct = np.any(np.abs(vertices - np.roll(vertices, 1, axis=0)) > 1e-9, axis=1)
    distinct[:1] |= not distinct.any()  # if all coincide, there is one
    vertices = vertices[distinct]
    if len(vertices) < 3:
        raise ValueError(f"{name} needs at least three distinct vertices, got {len(vertices)}")
    area = signed_area(vertices)
    if abs(area) < MIN_AREA_M2:
        raise ValueError(f"{name} encloses no area, its vertices are {vertices[:4].tolist()}")
    if (met := _meeting_edge(vertices)) is not None:
        at = int(np.flatnonzero(distinct)[met]) + 1
        raise ValueError(f"{name} crosses or touches itself, on its edge from vertex {at}")
    if area < 0.0:
        vertices = vertices[::-1]
    return np.ascontiguousarray(vertices)


def _meeting_edge(vertices: FloatArray) -> int | None:
    """Index where the first edge begins that meets another one not adjacent to it, or leads back along the one before;
    None if there is none. A polygon that touches itself has no inside that could be cut into pieces."""
    ends, places = np.roll(vertices, -1, axis=0), np.arange(len(vertices))
    lowest, highest = np.minimum(vertices, ends), np.maximum(vertices, ends)
    for i, (here, end) in enumerate(zip(vertices, ends, strict=True)):
        # Two edges meet if neither has both ends of the other on the same side.
        points = np.sign(_cross_all(here, end, vertices))
        split = points * np.roll(points, -1) <= 0.0
        splits = np.sign(_cross_all(vertices, ends, here)) * np.sign(_cross_all(vertices, ends, end)) <= 0.0
        near = np.all((lowest <= highest[i]) & (highest >= lowest[i]), axis=1)
        apart = (np.abs(places - i) > 1) & (np.abs(places - i) < len(places) - 1)
        back = points[i - 1] == 0.0 and (end - here) @ (here - vertices[i - 1]) < 0.0
        if back or np.any(near & apart & split & splits):
            return i
    return None


def _cross_all(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """`_cross` over leading axes."""
    along, offset = b - a, c - a
    return np.asarray(along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0])


def _is_convex(vertices: FloatArray) -> bool:
    count = len(vertices)
    return all(_cross(vertices[i - 1], vertices[i], vertices[(i + 1) % count]) >= STRAIGHT_M2 for i in range(count))


def _triangles(vertices: FloatArray) -> list[list[int]]:
    """Ear clipping; vertex indices of positively oriented triangles."""
    left = list(range(len(vertices)))
    triangles = []
    while len(left) > 3:
        for place, index in enumerate(left):
            before, after = left[place - 1], left[(place + 1) % len(left)]
            a, b, c = vertices[before], vertices[index], vertices[after]
            if _cross(a, b, c) <= 0.0:
                continue
            others = vertices[[k for k in left if k not in (before, index, after)]]
            edges = ((a, b), (b, c), (c, a))
            if np.any(np.all([_cross_all(*edge, others) >= 0.0 for edge in edges], axis=0)):
                continue
            triangles.append([before, index, after])
            left.pop(place)
            break
        else:
            # Only collinear remains are left: no area is lost with them.
            return triangles
    triangles.append(left)
    return triangles


def convex_pieces(vertices: FloatArray) -> list[FloatArray]:
    """Cut a simple, positively oriented polygon into convex pieces that cover it exactly."""
    if _is_convex(vertices):
        return [vertices]
    pieces = dict(enumerate(_triangles(vertices)))
    owner = {edge: name for name, piece in pieces.items() for edge in _edges(piece)}
    # Cuts with the pieces on both sides; a piece that has grown is looked at again with all that it touches.
    cuts = [(owner[b, a], name, b, a) for (a, b), name in owner.items() if owner.get((b, a), name) < name]
    heapify(cuts)
    while cuts:
        first, second, a, b = heappop(cuts)
        if first not in pieces or second not in pieces:
            continue
        joined = _joined(vertices, pieces[first], pieces[second], a, b)
        if joined is None:
            continue
        pieces[first] = joined
        del pieces[second]
        for a, b in _edges(joined):
            owner[a, b] = first
            if (other := owner.get((b, a))) is not None:
                heappush(cuts, (first, other, a, b) if first < other else (other, first, b, a))
    return [np.ascontiguousarray(vertices[piece]) for piece in pieces.values()]


def _edges(ring: list[int]) -> Iterator[tuple[int, int]]:
    return pairwise([*ring, ring[0]])


def _joined(vertices: FloatArray, first: list[int], second: list[int], a: int, b: int) -> list[int] | None:
    """Two convex pieces as one ring without the edge from a to b of the first; None if it would not be convex."""
    i, j = first.index(a), second.index(b)
    rest = (second[j:] + second[:j])[2:]
    before, after = first[i - 1], first[(i + 2) % len(first)]
    # Only the corners where they meet can be concave.
    for one, corner, other in ((before, a, rest[0]), (rest[-1], b, after)):
        if _cross(vertices[one], vertices[corner], vertices[other]) < STRAIGHT_M2:
            return None
    return [*first[: i + 1], *rest, *first[i + 1 :]]


@dataclass(frozen=True, slots=True)
class Obstacles:
    """Static obstacles as flat arrays of vertices, as `from_polygons` makes them.

    Attributes:
        piece_vertex_ne_m: Vertices of all convex pieces, shape (m, 2).
        piece_start: Index at which each piece begins, with the end, shape (pieces + 1,).
        layout: The same object for the same obstacles about another origin.
    """

    piece_vertex_ne_m: FloatArray
    piece_start: IntArray
    layout: object = field(default_factory=object, compare=False, repr=False)

    @classmethod
    def from_polygons(cls, polygons_ne_m: Sequence[ArrayLike]) -> Obstacles:
        """Check polygons and lay them out; either orientation, convex or not.

        Args:
            polygons_ne_m: Simple polygons, each of shape (k, 2), north and east in metres.

        Raises:
            ValueError: If a polygon has fewer than three distinct vertices, no area, a value that is not finite, or
                crosses or touches itself.
        """
        pieces: list[FloatArray] = []
        for number, polygon in enumerate(polygons_ne_m, 1):
            vertices = _checked(polygon, f"obstacle {number}")
            parts = convex_pieces(vertices)
            if abs(sum(map(signed_area, parts)) / signed_area(vertices) - 1.0) > LOST_SHARE:
                raise ValueError(f"obstacle {number} cannot be cut into convex pieces")
            pieces.extend(parts)
        return cls(*_flat(pieces))

    @property
    def pieces(self) -> Polygons:
        """The convex pieces as the kernels take them."""
        return self.piece_vertex_ne_m, self.piece_start

    @property
    def piece_count(self) -> int:
        """Number of convex pieces."""
        return len(self.piece_start) - 1


def _flat(rings: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    start = np.cumsum([0, *(len(ring) for ring in rings)]).astype(np.int64)
    return (np.ascontiguousarray(np.concatenate(rings)) if rings else np.empty((0, 2))), start


NO_OBSTACLES = Obstacles.from_polygons([])
