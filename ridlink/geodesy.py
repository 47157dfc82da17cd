"""WGS-84 positions and local north-east-down coordinates about a stated origin.

Axes: x north, y east, z down, metres. Latitudes and longitudes in degrees. Altitudes are in metres above the datum of
the caller, the same for the origin and the points (do not mix mean sea level and ellipsoid). The tangent plane is exact
(pymap3d); at 1 km its "down" differs from an altitude difference by 8 cm. `moved` and `offset_m` do the same for single
near points, only horizontally and tens of times as fast. `great_circle_m` is for distances of any length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pymap3d

from ridlink.units import wrap_deg

Array = npt.NDArray[np.float64]

EQUATOR_RADIUS_M = 6378137.0
ECCENTRICITY_SQUARED = 6.69437999014e-3
MEAN_RADIUS_M = 6371e3


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A point: latitude and longitude in degrees, altitude in metres."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0


def ned_from_geodetic(
    latitude_deg: npt.ArrayLike, longitude_deg: npt.ArrayLike, altitude_m: npt.ArrayLike, origin: Geodetic
) -> Array:
    """North, east, down [m] of points about an origin, shape (..., 3)."""
    north, east, down = pymap3d.geodetic2ned(
        np.asarray(latitude_deg, dtype=np.float64),
        np.asarray(longitude_deg, dtype=np.float64),
        np.asarray(altitude_m, dtype=np.float64),
        origin.latitude_deg,
        origin.longitude_deg,
        origin.altitude_m,
    )
    return np.stack(np.broadcast_arrays(north, east, down), axis=-1).astype(np.float64, copy=False)


def geodetic_from_ned(position_ned_m: npt.ArrayLike, origin: Geodetic) -> tuple[Array, Array, Array]:
    """Latitude [deg], longitude [deg], altitude [m] of points given as north, east, down, shape (..., 3)."""
    ned = np.asarray(position_ned_m, dtype=np.float64)
    latitude, longitude, altitude = pymap3d.ned2geodetic(
        ned[..., 0], ned[..., 1], ned[..., 2], origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )
    return np.asarray(latitude), np.asarray(longitude), np.asarray(altitude)


@lru_cache(maxsize=1024)
def _metres_per_degree(latitude_millideg: int) -> tuple[float, float]:
    """Length [m] of one degree of latitude and of longitude."""
    latitude = math.radians(latitude_millideg / 1e3)
    root = math.sqrt(1.0 - ECCENTRICITY_SQUARED * math.sin(latitude) ** 2)
    meridian = EQUATOR_RADIUS_M * (1.0 - ECCENTRICITY_SQUARED) / root**3
    parallel = EQUATOR_RADIUS_M / root * max(math.cos(latitude), 1e-6)
    return math.radians(meridian), math.radians(parallel)


def _scale(latitude_deg: float) -> tuple[float, float]:
    """As `_metres_per_degree`, for a latitude within 60 m: at 85 degrees the error is 0.1 mm in a metre."""
    return _metres_per_degree(round(latitude_deg * 1e3))


def moved(latitude_deg: float, longitude_deg: float, north_m: float, east_m: float) -> tuple[float, float]:
    """The point [deg] moved north and east, accurate to centimetres over the hundreds of metres of an extrapolation."""
    per_latitude, per_longitude = _scale(latitude_deg)
    latitude = min(max(latitude_deg + north_m / per_latitude, -90.0), 90.0)
    return latitude, wrap_deg(longitude_deg + east_m / per_longitude)


def offset_m(from_deg: tuple[float, float], to_deg: tuple[float, float]) -> tuple[float, float]:
    """North and east [m] from one point to a near one, each given as latitude and longitude."""
    per_latitude, per_longitude = _scale(from_deg[0])
    return (to_deg[0] - from_deg[0]) * per_latitude, wrap_deg(to_deg[1] - from_deg[1]) * per_longitude


def great_circle_m(from_deg: tuple[float, float], to_deg: tuple[float, float]) -> float:
    """Distance [m] between two points given as latitude and longitude, on a sphere: error below 1 % at any distance."""
    here, there = math.radians(from_deg[0]), math.radians(to_deg[0])
    east = math.radians(to_deg[1] - from_deg[1])
    haversine = math.sin((there - here) / 2.0) ** 2 + math.cos(here) * math.cos(there) * math.sin(east / 2.0) ** 2
    return 2.0 * MEAN_RADIUS_M * math.asin(math.sqrt(min(haversine, 1.0)))
