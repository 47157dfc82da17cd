"""F1 to F22 where they arrive: as datagrams on the Remote ID port of a daemon that flies."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest

from ridlink.engine import EngineConfig, Goal
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.crc import checksum
from ridlink.traffic.picture import TrafficPicture
from ridlink.traffic.snapshot import Snapshot
from tests.daemon.emulated import PATIENCE_S, Emulated, at
from tests.daemon.harness import Running, run, running


class Hostile:
    """Whoever sends to the Remote ID port of a flying daemon."""

    def __init__(self, flight: Running) -> None:
        self.flight, self.engine = flight, flight.daemon.engine
        self.other = Emulated(9, ned_m=(150.0, 60.0, -50.0))

    @property
    def picture(self) -> TrafficPicture:
        return self.engine.picture

    def counted(self, cause: str) -> int:
        return self.engine.counters[cause]

    async def send(self, *datagrams: bytes) -> None:
        """Send, and wait until a datagram sent last was read: a message that nobody knows."""
        link = self.flight.air.link
        assert link is not None
        before = self.counted("mavlink_1_frame")
        for datagram in datagrams:
            assert link.send(datagram)
        link.send(v1_frame())
        await self.flight.vehicle.until(lambda: self.counted("mavlink_1_frame") > before)

    def snapshot(self) -> Snapshot:
        loop_s = self.engine._last_step_s
        assert loop_s is not None
        own = self.engine.telemetry.state(loop_s)
        assert own is not None
        return self.picture.snapshot(own, loop_s)

    def radius_m(self) -> np.ndarray:
        """Radii of the discs now, without what age adds."""
        loop_s, snapshot = self.engine._last_step_s, self.snapshot()
        own = self.engine.telemetry.state(loop_s or 0.0)
        assert own is not None
        return self.engine.steering.decider.discs(own, 0.0, snapshot).radius_m


def v1_frame() -> bytes:
    """A MAVLink 1 HEARTBEAT."""
    body = bytes((9, 0, 9, 1, 0)) + struct.pack("<IBBBBB", 0, 2, 12, 0, 0, 3)
    return b"\xfe" + body + checksum(body, CRC_EXTRAS[0]).to_bytes(2, "little")


def location(**fields: Any) -> bytes:
    """A LOCATION of vehicle 9 with any integers at all."""
    north = at(150.0, 60.0)
    plain: dict[str, Any] = {
        "status": 2, "latitude": round(north[0] * 1e7), "longitude": round(north[1] * 1e7), "direction": 18000,
        "speed_horizontal": 500, "altitude_geodetic": 597.0, "timestamp": 65535.0,
    }  # fmt: skip
    return Encoder(9, 1).encode("OPEN_DRONE_ID_LOCATION", **(plain | fields))


def flown(test: Callable[[Hostile], Awaitable[None]], engine: EngineConfig | None = None) -> None:
    async def main() -> None:
        async with running(engine=engine or EngineConfig(goal=Goal(*at(300.0)), vehicle_sysid=1)) as flight:
            await flight.vehicle.until(lambda: len(flight.vehicle.setpoints()) >= 2)
            async with asyncio.timeout(PATIENCE_S):
                await flight.air.changed.wait()  # it knows us by our HEARTBEAT
            await test(Hostile(flight))
            count = len(flight.vehicle.setpoints())
            await flight.vehicle.until(lambda: len(flight.vehicle.setpoints()) > count)

    run(main)


@pytest.mark.parametrize(
    "fields",
    [
        {"latitude": 0, "longitude": 0},
        {"latitude": 900_000_001},
        {"longitude": -1_800_000_001},
        {"latitude": 2**31 - 1, "altitude_geodetic": math.nan},
    ],
)
def test_f01_without_a_position_a_track_coasts_and_none_begins(fields: dict[str, Any]) -> None:
    async def test(hostile: Hostile) -> None:
        await hostile.send(location(), location(**fields))
        (track,) = hostile.picture.tracks.values()
        assert track.latitude_deg == pytest.approx(at(150.0, 60.0)[0], abs=1e-6)
        assert hostile.counted("report_without_position") == 1

    flown(test)


def test_f01_a_bad_field_costs_itself_only() -> None:
    async def test(hostile: Hostile) -> None:
        await hostile.send(
            location(speed_horizontal=25_450, direction=36_050, altitude_geodetic=math.inf, speed_vertical=6_299)
        )
        (track,) = hostile.picture.tracks.values()
        assert track.report.latitude_deg is not None
        assert track.report.velocity_ned_mps is None
        assert track.report.altitude_geodetic_m is None

    flown(test)


@pytest.mark.parametrize("accuracy", [0, 13, 15, 255])
def test_f02_an_unknown_accuracy_is_40_m_and_one_beyond_use_is_capped(accuracy: int) -> None:
    async def test(hostile: Hostile) -> None:
        await hostile.send(location(horizontal_accuracy=accuracy))
        (radius,) = hostile.radius_m()
        assert radius == pytest.approx(40.0 + 3.0 + (0.6 + 7.5) / 2.0, abs=1.0)
        hostile.other.error_m = 650.0
        await hostile.send(hostile.other.remote_id(1.0))
        (radius,) = hostile.radius_m()
        assert 185.0 < radius < 192.0
        assert hostile.counted("position_unusable") == 1

    flown(test)


@pytest.mark.parametrize(("size_m", "taken_m"), [(0.0, 7.5), (0.05, 0.1), (0.6, 0.6), (500.0, 30.0)])
def test_f03_sizes_are_taken_within_reason(size_m: float, taken_m: float) -> None:
    async def test(hostile: Hostile) -> None:
        hostile.other.airframe_m = size_m
        await hostile.send(hostile.other.remote_id(1.0))
        (radius,) = hostile.radius_m()
        assert radius == pytest.approx(6.0 + (0.6 + taken_m) / 2.0, abs=0.05)
        assert hostile.counted("airframe_absurd") == (size_m > 30.0)

    flown(test)


@pytest.mark.parametrize(
    ("fields", "grows_mps"),
    [
        ({"speed_horizontal": 25500}, 30.7),
        ({"speed_horizontal": 25500, "direction": 36100}, 30.7),
        ({"direction": 36100}, 5.0),
    ],
)
def test_f04_an_unknown_direction_is_a_disc_that_grows_all_round(fields: dict[str, int], grows_mps: float) -> None:
    async def test(hostile: Hostile) -> None:
        await hostile.send(location(**fields))
        count = len(hostile.flight.vehicle.setpoints())
        await hostile.flight.vehicle.until(lambda: len(hostile.flight.vehicle.setpoints()) >= count + 4)
        snapshot = hostile.snapshot()
        assert snapshot.velocity_ned_mps[0].tolist() == [0.0, 0.0, 0.0]
        age = snapshot.age_s[0]
        assert age > 0.2
        assert snapshot.widening_m[0] == pytest.approx(grows_mps * age + 2.5 * age**2)

    flown(test)


def test_f05_times_that_cannot_be_leave_the_time_of_receipt_and_late_reports_change_nothing() -> None:
    async def test(hostile: Hostile) -> None:
        await hostile.send(location(timestamp=float("nan")), location(timestamp=65535.0))
        (track,) = hostile.picture.tracks.values()
        assert track.report.timestamp_s is None and track.measured_at_s == track.received_at_s
        hostile.other.sysid = 10
        other = Emulated(10, ned_m=(-150.0, 0.0, -50.0))
        await hostile.send(other.remote_id(3599.9), other.remote_id(3600.1), other.remote_id(3599.0))
        assert hostile.counted("timestamp_implausible") > 0
        assert hostile.counted("report_older") == 1
        assert len(hostile.picture) == 2

    flown(test)


def test_f06_a_datagram_twice_is_one_and_an_old_frame_is_none() -> None:
    async def test(hostile: Hostile) -> None:
        hostile.other.encoder.seq = 255
        datagram = hostile.other.remote_id(1.0)
        await hostile.send(datagram)
        (track,) = hostile.picture.tracks.values()
        received_at_s = track.received_at_s
        await hostile.send(datagram, datagram)
        assert track.received_at_s == received_at_s and len(hostile.picture) == 1
        assert hostile.counted("report_repeated") == 2
        assert hostile.counted("mavlink_1_frame") == 2, "the two markers of this test"

    flown(test)


def test_f06_version_1_is_taken_where_it_is_allowed() -> None:
    async def test() -> None:
        engine = EngineConfig(goal=Goal(*at(300.0)), allow_v1=True)
        async with running(engine=engine) as flight:
            await flight.vehicle.until(lambda: len(flight.vehicle.setpoints()) >= 2)
            flight.vehicle.send(v1_frame())
            await flight.vehicle.until(lambda: flight.daemon.engine.counters["foreign_autopilot"] == 1)
            assert flight.daemon.engine.counters["mavlink_1_frame"] == 0

    run(test)


def test_f07_f08_two_places_under_one_identity_are_two_tracks_and_both_count() -> None:
    async def test(hostile: Hostile) -> None:
        twin = Emulated(9, ned_m=(-250.0, 0.0, -50.0))
        for k in range(6):
            await hostile.send(hostile.other.remote_id(0.1 * k), twin.remote_id(0.1 * k + 0.05))
        north = hostile.snapshot().position_ned_m[:, 0]
        assert len(north) == 2 and north.max() - north.min() == pytest.approx(400.0, abs=5.0)
        assert hostile.counted("identity_doubtful") == 1
        await hostile.flight.vehicle.until(lambda: hostile.flight.events[-1].get("doubtful") == 1)

    flown(test)


def test_f09_our_identity_at_our_place_is_an_echo_and_elsewhere_an_intruder_with_an_alert() -> None:
    async def test(hostile: Hostile) -> None:
        own = hostile.flight.vehicle.vehicle
        echo, spoof = Emulated(1), Emulated(1, ned_m=(200.0, 0.0, -50.0))
        echo.position = own.position.copy()
        await hostile.send(echo.remote_id(1.0))
        assert hostile.counted("own_echo") == 1 and len(hostile.picture) == 0
        await hostile.send(spoof.remote_id(2.0))
        assert len(hostile.picture) == 1
        await hostile.flight.vehicle.until(
            lambda: any(message.name == "STATUSTEXT" and b"our own" in message.text for message in own.heard)
        )

    flown(test)


def test_f10_who_falls_silent_coasts_and_grows() -> None:
    async def test(hostile: Hostile) -> None:
        hostile.other.velocity[:] = (-5.0, 0.0, 0.0)
        await hostile.send(hostile.other.remote_id(0.0))
        early = hostile.snapshot()
        count = len(hostile.flight.vehicle.setpoints())
        await hostile.flight.vehicle.until(lambda: len(hostile.flight.vehicle.setpoints()) >= count + 15)
        late = hostile.snapshot()
        assert late.age_s[0] > early.age_s[0] + 1.0
        assert late.widening_m[0] == pytest.approx(2.5 * late.age_s[0] ** 2)

    flown(test)


def test_f12_a_flood_is_refused_in_part_said_once_and_costs_nobody_who_is_known() -> None:
    async def test(hostile: Hostile) -> None:
        vehicle = hostile.flight.vehicle
        await hostile.send(hostile.other.remote_id(0.0))
        far = at(500.0)

        def ghost(number: int) -> bytes:
            return location(id_or_mac=b"g%d" % number, latitude=round(far[0] * 1e7), longitude=round(far[1] * 1e7))

        for chunk in range(24):
            ghosts = [ghost(100 * chunk + k) for k in range(100)]
            await hostile.send(*ghosts, hostile.other.remote_id(0.1 * (chunk + 1)))
        assert hostile.counted("newcomer_refused") > 100
        assert len(hostile.picture) <= 2000
        (known,) = [track for track in hostile.picture.tracks.values() if track.key[3] is None]
        assert known.report.timestamp_s == pytest.approx(2.4)
        await vehicle.until(
            lambda: any(message.name == "STATUSTEXT" and b"flood" in message.text for message in vehicle.vehicle.heard)
        )

    flown(test)


def test_f21_every_frame_of_a_datagram_counts_whatever_lies_between_and_64_at_most() -> None:
    async def test(hostile: Hostile) -> None:
        frames = [
            Encoder(20 + k, 1).encode("OPEN_DRONE_ID_LOCATION", status=2, latitude=1, longitude=1) for k in range(3)
        ]
        await hostile.send(b"", b"junk" + frames[0] + b"\xfd\x00" + frames[1] + b"\xfe" * 20)
        assert len(hostile.picture) == 2
        await hostile.send(frames[2] + bytes(65_507 - len(frames[2])))
        assert len(hostile.picture) == 3
        many = [
            Encoder(50 + k, 1).encode("OPEN_DRONE_ID_LOCATION", status=2, latitude=1, longitude=1) for k in range(80)
        ]
        await hostile.send(b"".join(many))
        assert len(hostile.picture) == 3 + 64

    flown(test)


def test_f22_what_is_no_message_of_ours_is_no_traffic() -> None:
    async def test(hostile: Hostile) -> None:
        good = hostile.other.remote_id(0.0, extended=False)
        bad_checksum = good[:-1] + bytes([good[-1] ^ 1])
        bad_flags = good[:2] + b"\x40" + good[3:]
        unknown = b"\xfd\x01\x00\x00\x00\x09\x01\xff\xee\x0c\x00\x12\x34"
        await hostile.send(bad_checksum, bad_flags, unknown)
        assert len(hostile.picture) == 0
        for cause in ("bad_checksum", "incompatible_flags", "unknown_message"):
            assert hostile.counted(cause) >= 1, cause

    flown(test)


def test_f22_poison_beside_every_good_datagram_costs_none_of_them() -> None:
    async def test(hostile: Hostile) -> None:
        poison = b"\xfd\xff\x00\x00\x00\x09\x01\x65\x32\x00"  # ten bytes that claim 255
        for k in range(5):
            good = [hostile.other.remote_id(0.1 * (10 * k + n)) for n in range(10)]
            await hostile.send(*(datagram for each in good for datagram in (poison, each)))
        assert hostile.engine.summary().reports_received == 50

    flown(test)
