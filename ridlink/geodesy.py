"""WGS-84 positions and local north-east-down coordinates about a stated origin.

Axes: x north, y east, z down, metres. Latitudes and longitudes in degrees. Altitudes in metres above whatever datum the
caller uses for both the origin and the points (mean sea level and ellipsoid must not be mixed). The tangent plane is
exact (pymap3d); at 1 km its "down" differs from an altitude difference by 8 cm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pymap3d

Array = npt.NDArray[np.float64]


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
