"""Flights as Remote ID frames, for tests of everything that watches."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.observer import Scene, Sky, discs_at
from ridlink.observer.scene import FloatArray
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import STATUS_AIRBORNE, BasicId, Location, RemoteIdMessage, Separation
from ridlink.separation.definitions import Definition

HOME = Geodetic(47.3977, 8.5456, 500.0)


@dataclass(frozen=True)
class Flyer:
    """A vehicle that flies straight.

    Args:
        sysid: System id.
        start_ne_m: Where it is at time 0.
        velocity_ne_mps: How it flies.
        identity: Its BASIC_ID, None for none.
        identity_from_s: When it begins to say so.
        extended: It sends RIDLINK_SEPARATION.
        altitude_m: Above the ellipsoid.
    """

    sysid: int
    start_ne_m: tuple[float, float]
    velocity_ne_mps: tuple[float, float]
    identity: bytes | None = None
    identity_from_s: float = 0.0
    extended: bool = True
    altitude_m: float = 550.0
    airframe_m: float = 0.6
    error_m: float = 10.5
    id_or_mac: bytes | None = None
    compid: int = 1

    def at(self, time_s: float) -> tuple[float, float]:
        """Where it is, north and east [m]."""
        return tuple(p + v * time_s for p, v in zip(self.start_ne_m, self.velocity_ne_mps, strict=True))  # type: ignore[return-value]

    def velocity(self, time_s: float) -> tuple[float, float]:
        """How it flies at a time."""
        return self.velocity_ne_mps

    def messages(self, time_s: float) -> list[RemoteIdMessage]:
        """What it says at a time."""
        north, east = self.at(time_s)
        latitude, longitude, _ = geodetic_from_ned((north, east, 0.0), HOME)
        vn, ve = self.velocity(time_s)
        said: list[RemoteIdMessage] = []
        if self.identity is not None and time_s >= self.identity_from_s:
            said.append(BasicId(id_type=1, ua_type=2, uas_id=self.identity, id_or_mac=self.id_or_mac))
        said.append(
            Location(
                status=STATUS_AIRBORNE,
                direction_deg=math.degrees(math.atan2(ve, vn)) % 360.0,
                speed_horizontal_mps=math.hypot(vn, ve),
                speed_vertical_mps=0.0,
                latitude_deg=float(latitude),
                longitude_deg=float(longitude),
                altitude_geodetic_m=self.altitude_m,
                horizontal_accuracy=10,
                timestamp_s=round(time_s % 3600.0, 1),
                id_or_mac=self.id_or_mac,
            )
        )
        if self.extended:
            said.append(
                Separation(
                    timestamp_s=round(time_s % 3600.0, 1),
                    horizontal_error_m=self.error_m,
                    vertical_error_m=3.0,
                    airframe_size_m=self.airframe_m,
                    airframe_height_m=0.3,
                    update_interval_s=0.1,
                    id_or_mac=self.id_or_mac,
                )
            )
        return said


def frames(flyers: list[Flyer], until_s: float, *, period_s: float = 0.1) -> Iterator[tuple[float, Frame]]:
    """What all of them say, with the times at which it is heard."""
    encoders = {flyer: Encoder(flyer.sysid, flyer.compid) for flyer in flyers}
    for step in range(round(until_s / period_s)):
        time_s = round(step * period_s, 6)
        for flyer in flyers:
            for message in flyer.messages(time_s):
                name, fields = to_mavlink(message)
                [frame] = parse_datagram(encoders[flyer].encode(name, **fields), CRC_EXTRAS)
                assert isinstance(frame, Frame)
                yield time_s, frame


def seen(flyers: list[Flyer], until_s: float, **options: float) -> Sky:
    sky = Sky(origin=HOME, **options)  # type: ignore[arg-type]
    for time_s, frame in frames(flyers, until_s):
        sky.receive(frame, time_s)
    return sky


def a_crowd(seed: int, count: int, side_m: float) -> Scene:
    """Some of them stand, some at one place, some are unknown in part or boast."""
    draws = np.random.default_rng(seed)

    def some(values: Any, share: float, instead: float) -> Any:
        return np.where(draws.random(count) < share, instead, values)

    velocity = draws.uniform(-20.0, 20.0, (count, 2)) * (draws.random((count, 1)) < 0.8)
    place = draws.uniform(-side_m / 2.0, side_m / 2.0, (count, 2))
    place[draws.random(count) < 0.1] = side_m / 3.0
    return Scene(
        time_s=0.0,
        numbers=tuple(range(count)),
        names=tuple(map(str, range(count))),
        position_ne_m=place,
        velocity_ne_mps=velocity,
        speed_mps=some(np.hypot(*velocity.T), 0.1, np.nan),
        airframe_m=some(draws.uniform(0.1, 8.0, count), 0.2, np.nan),
        error_bound_m=some(some(draws.uniform(0.0, 20.0, count), 0.2, np.nan), 0.05, 500.0),
        accuracy_bound_m=some(draws.uniform(1.0, 30.0, count), 0.2, np.nan),
        interval_s=draws.uniform(0.05, 3.0, count),
        age_s=draws.uniform(0.0, 2.0, count),
        altitude_m=some(draws.uniform(0.0, 120.0, count), 0.2, np.nan),
        climb_mps=draws.uniform(-3.0, 3.0, count),
        vertical_error_m=some(draws.uniform(0.0, 10.0, count), 0.2, np.nan),
        airframe_height_m=draws.uniform(0.1, 1.0, count),
        command_ne_mps=np.full((count, 2), np.nan),
        avoiding=np.ones(count, np.bool_),
    )


def all_discs(scene: Scene, definition: Definition) -> FloatArray:
    """Radius of the disc of every pair, shape (n, n); the diagonal has no meaning."""
    everybody = np.arange(len(scene))
    return discs_at(scene, everybody[:, None], everybody, definition)
