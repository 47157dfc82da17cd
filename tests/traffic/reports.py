"""An own-ship, reports about it, and pictures of them."""

from __future__ import annotations

from msgspec import structs

from ridlink.geodesy import Geodetic, moved
from ridlink.remote_id.report import RemoteIdReport
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.picture import TrafficPicture
from ridlink.traffic.snapshot import PictureSettings

HERE = (47.3977, 8.5456)
SETTINGS = PictureSettings(unknown_error_m=40.0, unusable_error_m=185.0, unknown_speed_mps=30.7, own_height_m=0.3)
OWN = OwnState(
    position=Geodetic(*HERE, 540.0),
    altitude_ellipsoid_m=587.0,
    velocity_ned_mps=(10.0, 0.0, 0.0),
    error_bound_m=3.0,
    vertical_error_bound_m=5.0,
    home_altitude_m=490.0,
    age_s=0.0,
)


def report(sysid: int = 5, north: float = 100.0, east: float = 0.0, **fields: object) -> RemoteIdReport:
    latitude, longitude = moved(*HERE, north, east)
    plain = RemoteIdReport(
        source=(sysid, 1), status=2, latitude_deg=latitude, longitude_deg=longitude, altitude_geodetic_m=587.0,
        velocity_ned_mps=(-10.0, 0.0, 0.0), climb_mps=0.0, speed_horizontal_mps=10.0, horizontal_error_m=3.0,
        vertical_error_m=5.0, airframe_size_m=0.6, airframe_height_m=0.3, update_interval_s=0.1, avoiding=True,
        extended=True, timestamp_s=100.0, received_at_s=10.0,
    )  # fmt: skip
    return structs.replace(plain, **fields)


def picture(
    *reports: RemoteIdReport, settings: PictureSettings = SETTINGS, own: OwnState | None = OWN
) -> TrafficPicture:
    made = TrafficPicture(settings)
    if own is not None:
        made.snapshot(own, 10.0)
    for one in reports:
        made.receive("rid", one)
    return made


def still(**fields: object) -> RemoteIdReport:
    return report(velocity_ned_mps=(0.0, 0.0, 0.0), **fields)  # type: ignore[arg-type]
