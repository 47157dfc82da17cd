"""Static obstacles in degrees: laid out once, given in metres about any own position."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.obstacles import Obstacles
from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic, geodetic_from_ned, ned_from_geodetic

Polygon = tuple[tuple[float, float], ...]
"""Vertices, latitude and longitude in degrees."""

FloatArray = NDArray[np.float64]


class StaticObstacles:
    """Polygons that no vehicle may enter.

    Args:
        polygons: Simple polygons, convex or not, either orientation.

    Raises:
        ConfigError: If a polygon is invalid.
    """

    def __init__(self, polygons: tuple[Polygon, ...]) -> None:
        self._layout: Obstacles | None = None
        if not polygons:
            return
        for number, polygon in enumerate(polygons, 1):
            _check(number, polygon)
        flat: list[FloatArray] = []
        origin = Geodetic(*polygons[0][0])
        for polygon in polygons:
            latitude, longitude = np.array(polygon, dtype=np.float64).T
            flat.append(ned_from_geodetic(latitude, longitude, 0.0, origin)[:, :2])
        try:
            self._layout = Obstacles.from_polygons(flat)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        self._pieces = _degrees(self._layout.piece_vertex_ne_m, origin)

    def about(self, origin: Geodetic) -> Obstacles | None:
        """The obstacles in north-east metres about a position; None without any."""
        if self._layout is None:
            return None
        return replace(self._layout, piece_vertex_ne_m=_metres(self._pieces, origin))


def _check(number: int, polygon: Polygon) -> None:
    if not polygon:
        raise ConfigError(f"obstacle {number} has no vertices")
    for vertex, (latitude_deg, longitude_deg) in enumerate(polygon, 1):
        if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
            place = f"obstacle {number}, vertex {vertex}"
            raise ConfigError(f"{place}: {latitude_deg:g}, {longitude_deg:g} is no latitude and longitude")


def _degrees(vertices_ne_m: FloatArray, origin: Geodetic) -> tuple[FloatArray, FloatArray]:
    level = np.column_stack([vertices_ne_m, np.zeros(len(vertices_ne_m))])
    latitude, longitude, _ = geodetic_from_ned(level, origin)
    return latitude, longitude


def _metres(vertices_deg: tuple[FloatArray, FloatArray], origin: Geodetic) -> FloatArray:
    # Walls stand at every height: their distance is the one at our height.
    return np.ascontiguousarray(ned_from_geodetic(*vertices_deg, origin.altitude_m, origin)[:, :2])
