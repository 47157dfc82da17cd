"""WGS-84 and local north-east-down: there and back, the axes, and the places where maps tear."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ridlink.geodesy import Geodetic, geodetic_from_ned, great_circle_m, moved, ned_from_geodetic, offset_m

unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine is no failure."""

latitudes = st.floats(-85.0, 85.0)
longitudes = st.floats(-180.0, 180.0)
altitudes = st.floats(-400.0, 9000.0)
metres = st.floats(-20_000.0, 20_000.0)


@unhurried
@given(st.builds(Geodetic, latitudes, longitudes, altitudes), metres, metres, st.floats(-500.0, 500.0))
def test_there_and_back(origin: Geodetic, north: float, east: float, down: float) -> None:
    position = np.array([north, east, down])
    latitude, longitude, altitude = geodetic_from_ned(position, origin)
    again = ned_from_geodetic(latitude, longitude, altitude, origin)
    np.testing.assert_allclose(again, position, atol=1e-6)


def test_axes() -> None:
    origin = Geodetic(47.4, 8.54, 500.0)
    north = ned_from_geodetic(47.401, 8.54, 500.0, origin)
    east = ned_from_geodetic(47.4, 8.541, 500.0, origin)
    up = ned_from_geodetic(47.4, 8.54, 510.0, origin)
    # WGS-84 at 47.4 deg: 111.18 km per degree of latitude, 75.49 km per degree of longitude, at 500 m
    np.testing.assert_allclose(north, [111.19, 0.0, 0.0], atol=0.02)
    np.testing.assert_allclose(east, [0.0, 75.49, 0.0], atol=0.02)
    np.testing.assert_allclose(up, [0.0, 0.0, -10.0], atol=1e-6)


def test_the_plane_is_tangent_and_the_earth_falls_away() -> None:
    origin = Geodetic(47.4, 8.54, 0.0)
    down = ned_from_geodetic(47.4, 8.54 + 1000.0 / 75_483.0, 0.0, origin)[2]
    assert down == pytest.approx(1000.0**2 / (2 * 6_388_000.0), rel=0.01)  # 8 cm at 1 km


def test_across_the_antimeridian() -> None:
    position = ned_from_geodetic(-17.0, -179.9999, 0.0, Geodetic(-17.0, 179.9999, 0.0))
    assert position[1] == pytest.approx(21.3, abs=0.1)
    longitude = geodetic_from_ned([0.0, 21.3, 0.0], Geodetic(-17.0, 179.9999, 0.0))[1]
    assert float(longitude) == pytest.approx(-179.9999, abs=1e-6)


def test_shapes_broadcast() -> None:
    origin = Geodetic(0.0, 0.0)
    assert ned_from_geodetic(0.0, 0.0, 0.0, origin).shape == (3,)
    assert ned_from_geodetic([0.0, 1e-4], 0.0, 0.0, origin).shape == (2, 3)
    assert ned_from_geodetic(np.zeros((4, 2)), np.zeros(2), 0.0, origin).shape == (4, 2, 3)
    latitude, longitude, altitude = geodetic_from_ned(np.zeros((4, 2, 3)), origin)
    assert latitude.shape == longitude.shape == altitude.shape == (4, 2)


def test_an_unknown_altitude_stays_unknown() -> None:
    position = ned_from_geodetic(47.4, 8.54, np.nan, Geodetic(47.4, 8.54, 0.0))
    assert np.isnan(position).any()


@given(st.floats(-84, 84), st.floats(-180, 179.99), st.floats(-500, 500), st.floats(-500, 500))
def test_near_points_lie_in_the_tangent_plane(latitude: float, longitude: float, north: float, east: float) -> None:
    there = moved(latitude, longitude, north, east)
    assert -180.0 <= there[1] < 180.0
    exact = ned_from_geodetic(*there, 0.0, Geodetic(latitude, longitude))
    # Flat coordinates err with the square of the distance and the tangent of the latitude.
    allowed = 0.1 + 0.06 * abs(math.tan(math.radians(latitude)))
    assert exact[:2] == pytest.approx((north, east), abs=allowed)
    assert offset_m((latitude, longitude), there) == pytest.approx((north, east), abs=1e-3)


def test_near_points_across_the_antimeridian() -> None:
    east = moved(10.0, 179.9999, 0.0, 50.0)
    assert -180.0 <= east[1] < -179.999
    assert offset_m((10.0, 179.9999), east)[1] == pytest.approx(50.0, abs=1e-6)


@pytest.mark.parametrize(
    ("here", "there", "away_m"),
    [
        ((47.4, 8.54), (47.4, 8.54), 0.0),
        ((0.0, 0.0), (0.0, 1.0), 111_319.5),  # on the equator of WGS-84
        ((0.0, 0.0), (90.0, 77.0), 10_001_965.7),  # a quarter of its meridian
        ((-17.0, 179.9), (-17.0, -179.9), 21_297.2),  # across the antimeridian
        ((10.0, 20.0), (-10.0, -160.0), 20_003_931.5),  # to the other side, half a meridian
    ],
)
def test_far_points_on_a_sphere(here: tuple[float, float], there: tuple[float, float], away_m: float) -> None:
    assert great_circle_m(here, there) == pytest.approx(away_m, rel=0.006)
    assert great_circle_m(there, here) == pytest.approx(great_circle_m(here, there))
