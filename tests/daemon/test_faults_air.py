"""F1 to F22 where they arrive: as datagrams on the Remote ID port of a daemon that flies."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from ridlink.engine import EngineConfig, Goal
from ridlink.failsafe import State
from ridlink.impair.model import Impairment
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import BasicId
from tests.daemon.emulated import Emulated, at
from tests.daemon.harness import running
from tests.daemon.hostile import Hostile, flown, location, v1_frame
from tests.loopback import run


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
        displacement = 5.0  # a second of its flight, since it does not tell when it will be heard again
        assert radius == pytest.approx(40.0 + 3.0 + (0.6 + 7.5) / 2.0 + displacement, abs=1.0)
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


@pytest.mark.parametrize("allowed", [False, True])
def test_f06_version_1_is_heard_where_it_is_allowed_only(allowed: bool) -> None:
    async def test() -> None:
        config = EngineConfig(goal=Goal(*at(300.0)), allow_v1=allowed)
        async with running(engine=config) as flight:
            await flight.vehicle.until(lambda: len(flight.vehicle.setpoints()) >= 2)
            engine = flight.daemon.engine
            flight.vehicle.send(v1_frame())
            flight.vehicle.send(b"what was sent before was read")
            await flight.vehicle.until(lambda: engine.counters["garbage"] == 1)
            assert engine.counters["foreign_autopilot"] == allowed
            assert engine.counters["mavlink_1_frame"] == (not allowed)

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


def test_f08_four_far_away_under_one_identity_hide_no_fifth_that_comes_at_us() -> None:
    async def test(hostile: Hostile) -> None:
        far = [Emulated(9, ned_m=(300.0 + 60.0 * k, 400.0, -50.0)) for k in range(4)]
        await hostile.send(*(each.remote_id(0.01 * k) for k, each in enumerate(far)))
        assert len(hostile.picture) == 4
        hostile.other.position = hostile.vehicle.vehicle.position + np.array((90.0, 0.0, 0.0))
        hostile.other.velocity[:] = (-10.0, 0.0, 0.0)
        await hostile.send(hostile.other.remote_id(0.1))
        assert len(hostile.picture) == 4 and hostile.counted("track_displaced") == 1
        await hostile.vehicle.until(lambda: len(hostile.last.conflicts) == 1)
        await hostile.send(*(each.remote_id(0.2 + 0.01 * k) for k, each in enumerate(far)))
        assert hostile.counted("track_refused") == 1, "who is further away takes no place of one that matters"
        await hostile.vehicle.until(lambda: len(hostile.last.conflicts) == 1)

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


def test_f09_a_stranger_at_our_place_is_no_echo() -> None:
    async def test(hostile: Hostile) -> None:
        hostile.other.position = hostile.vehicle.vehicle.position.copy()
        await hostile.send(hostile.other.remote_id(1.0))
        assert len(hostile.picture) == 1 and hostile.counted("own_echo") == 0

    flown(test)


def named(sender: Encoder, id_type: int, uas_id: bytes, id_or_mac: bytes | None = None) -> bytes:
    name, fields = to_mavlink(BasicId(id_type, 2, uas_id, id_or_mac))
    return sender.encode(name, **fields)


def test_f09_a_vehicle_with_a_serial_number_and_a_registration_is_its_own_echo_under_both() -> None:
    async def test(hostile: Hostile) -> None:
        emulated, receiver, mac = hostile.vehicle.vehicle, Encoder(1, 236), b"\x02RIDLNK".ljust(20, b"\0")
        for id_type, name in ((1, b"SERIAL"), (2, b"REGISTRATION")):
            hostile.vehicle.send(named(emulated.encoder, id_type, name))
            relayed = Emulated(1, ned_m=tuple(emulated.position))
            relayed.encoder = receiver
            hostile.vehicle.send(named(receiver, id_type, name, mac))
            hostile.vehicle.send(relayed.remote_id(float(id_type), id_or_mac=mac, extended=False))
            await hostile.vehicle.until(lambda count=id_type: hostile.counted("own_echo") >= count)  # type: ignore[misc]
        assert not len(hostile.picture) and hostile.engine._hearing.names.uas_id == b"SERIAL"

    flown(test)


def test_f09_somebody_with_our_system_id_who_calls_itself_otherwise_is_no_echo() -> None:
    async def test(hostile: Hostile) -> None:
        hostile.vehicle.send(named(hostile.vehicle.vehicle.encoder, 1, b"OURS"))
        await hostile.vehicle.until(lambda: hostile.engine._hearing.names.uas_id == b"OURS")
        twin = Emulated(1)
        twin.position = hostile.vehicle.vehicle.position + np.array((8.0, 0.0, 0.0))
        await hostile.send(named(twin.encoder, 1, b"THEIRS"), twin.remote_id(0.0))
        assert len(hostile.picture) == 1 and not hostile.counted("own_echo")

    flown(test)


def test_f09_an_echo_that_was_heard_before_its_name_is_given_up() -> None:
    async def test(hostile: Hostile) -> None:
        emulated, receiver, mac = hostile.vehicle.vehicle, Encoder(1, 236), b"\x02RIDLNK".ljust(20, b"\0")
        hostile.vehicle.send(named(emulated.encoder, 1, b"SERIAL"))
        relayed = Emulated(1, ned_m=tuple(emulated.position))
        relayed.encoder = receiver
        hostile.vehicle.send(relayed.remote_id(0.0, id_or_mac=mac))
        await hostile.vehicle.until(lambda: len(hostile.picture) == 1)
        relayed.position = emulated.position.copy()
        hostile.vehicle.send(named(receiver, 1, b"SERIAL", mac) + relayed.remote_id(0.5, id_or_mac=mac))
        await hostile.vehicle.until(lambda: not len(hostile.picture))

    flown(test)


def test_f09_who_came_here_is_no_echo_though_somebody_calls_it_by_our_name() -> None:
    async def test(hostile: Hostile) -> None:
        hostile.vehicle.send(named(hostile.vehicle.vehicle.encoder, 1, b"SERIAL"))
        await hostile.vehicle.until(lambda: hostile.engine._hearing.names.uas_id == b"SERIAL")
        for k in range(12):  # 50 m/s, until it is within the gate of an echo
            hostile.other.position = hostile.vehicle.vehicle.position + np.array((63.0 - 5.0 * k, 0.0, 0.0))
            hostile.other.velocity[:] = (-50.0, 0.0, 0.0)
            name = named(Encoder(9, 1), 1, b"SERIAL") if k == 11 else b""
            await hostile.send(name + hostile.other.remote_id(0.1 * k))
            count = len(hostile.vehicle.setpoints())
            await hostile.vehicle.until(lambda count=count: len(hostile.vehicle.setpoints()) > count)  # type: ignore[misc]
        assert len(hostile.picture) == 1 and not hostile.counted("own_echo")

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


def test_f11_the_way_back_from_a_conflict_that_is_gone_is_slow_for_two_seconds() -> None:
    async def test(hostile: Hostile) -> None:
        vehicle = hostile.vehicle
        ahead = float(vehicle.vehicle.position[0]) + 17.0
        wall = [Emulated(20 + k, ned_m=(ahead, 6.0 * (k - 2), -50.0)) for k in range(5)]
        await hostile.send(*(each.remote_id(1.0) for each in wall))
        await vehicle.until(lambda: bool(hostile.last.conflicts) and hostile.last.state is State.ENGAGED)
        await hostile.send(*(each.remote_id(1.1, status=1) for each in wall))  # landed, all of them
        await vehicle.until(lambda: not hostile.last.conflicts)
        gone_s, count = hostile.last.time_s, len(vehicle.setpoints())
        await vehicle.until(lambda: not hostile.last.recovering)
        assert hostile.last.time_s - gone_s > 1.7
        back = vehicle.setpoints()[count - 1 : -1]
        for before, after in pairwise(back):
            faster = math.hypot(after.vx, after.vy) > math.hypot(before.vx, before.vy)
            change = math.hypot(after.vx - before.vx, after.vy - before.vy)
            elapsed_s = (after.time_boot_ms - before.time_boot_ms + 2) / 1e3  # two roundings
            assert not faster or change <= 2.5 * elapsed_s + 1e-3, "half of the acceleration"
        assert back[-1].vx > 2.0, "it is on its way again"

    flown(test)


def test_f12_a_flood_is_refused_in_part_said_once_and_costs_nobody_who_is_known() -> None:
    async def test(hostile: Hostile) -> None:
        vehicle = hostile.flight.vehicle
        await hostile.send(hostile.other.remote_id(0.0))
        far = at(500.0)

        def ghost(number: int) -> bytes:
            return location(id_or_mac=b"g%d" % number, latitude=round(far[0] * 1e7), longitude=round(far[1] * 1e7))

        for chunk in range(4):  # ten datagrams of sixty each
            ghosts = [b"".join(ghost(600 * chunk + 60 * k + n) for n in range(60)) for k in range(10)]
            await hostile.send(*ghosts, hostile.other.remote_id(0.1 * (chunk + 1)))
        assert hostile.counted("newcomer_refused") > 100
        assert len(hostile.picture) <= 2000
        (known,) = [track for track in hostile.picture.tracks.values() if track.key[3] is None]
        assert known.report.timestamp_s == pytest.approx(0.4)
        await vehicle.until(
            lambda: any(message.name == "STATUSTEXT" and b"flood" in message.text for message in vehicle.vehicle.heard)
        )

    flown(test)


def test_f13_ghosts_that_close_in_from_all_sides_are_met_with_the_least_bad_velocity() -> None:
    async def test(hostile: Hostile) -> None:
        vehicle = hostile.vehicle
        centre = vehicle.vehicle.position.copy()
        ring = [(math.cos(a), math.sin(a)) for a in 2.0 * math.pi * np.arange(12) / 12]
        ghosts = [Emulated(20 + k, ned_m=(27.0 * n, 27.0 * e, 0.0)) for k, (n, e) in enumerate(ring)]
        for ghost, (north, east) in zip(ghosts, ring, strict=True):
            ghost.position += centre
            ghost.velocity[:] = (-2.5 * north, -2.5 * east, 0.0)
        first = len(vehicle.setpoints())
        for k in range(25):
            count = len(vehicle.setpoints())
            await hostile.send(*(ghost.remote_id(0.1 * k) for ghost in ghosts))
            await vehicle.until(lambda count=count: len(vehicle.setpoints()) > count)  # type: ignore[misc]
            assert hostile.last.state is State.ENGAGED
            for ghost in ghosts:
                ghost.advance(0.1)
        assert hostile.engine.summary().infeasible_steps > 5, "no velocity keeps out of all discs"
        assert math.dist(vehicle.vehicle.position, centre) < 2.0, "nor does it fly at one of them"
        assert math.hypot(vehicle.setpoints()[-1].vx, vehicle.setpoints()[-1].vy) < 1.0
        norths = [message.vx for message in vehicle.setpoints()[first:] if abs(message.vx) >= 0.5]
        assert sum(a * b < 0.0 for a, b in pairwise(norths)) <= 3, "one change of sign a second"

    flown(test)


def test_f19_a_height_over_another_reference_is_our_own_height() -> None:
    async def test(hostile: Hostile) -> None:
        hostile.other.position[2] = -200.0  # 150 m above us
        await hostile.send(hostile.other.remote_id(0.0))
        assert len(hostile.snapshot()) == 0, "known to fly far above"
        above_m = hostile.other.remote_id(0.1, altitude_geodetic_m=None, altitude_barometric_m=747.0)
        await hostile.send(above_m)
        assert len(hostile.snapshot()) == 1

    flown(test)


def test_f19_a_receiver_whose_two_heights_contradict_each_other_has_none() -> None:
    own = Emulated()
    own.ellipsoid_wrong_m = 200.0  # and a neighbour at our height would be far below

    async def test(hostile: Hostile) -> None:
        await hostile.send(hostile.other.remote_id(0.0))
        assert len(hostile.snapshot()) == 1
        assert hostile.engine.counters["own_height_implausible"] > 0

    flown(test, emulated=own)


def test_f19_without_the_own_height_above_the_ellipsoid_everybody_flies_at_it() -> None:
    own = Emulated()
    own.knows_ellipsoid = False

    async def test(hostile: Hostile) -> None:
        hostile.other.position[2] = -200.0
        await hostile.send(hostile.other.remote_id(0.0))
        assert len(hostile.snapshot()) == 1

    flown(test, emulated=own)


def test_f20_behind_a_bad_network_the_measured_interval_sizes_the_disc() -> None:
    bad = Impairment(loss=0.5, burst=3.0, delay_s=0.02, jitter_s=0.02, duplicate=0.2)

    async def test(hostile: Hostile) -> None:
        link, other = hostile.flight.air.link, hostile.other
        assert link is not None
        other.velocity[:] = (-5.0, 0.0, 0.0)
        for k in range(30):
            count = len(hostile.vehicle.setpoints())
            link.send(other.remote_id(0.1 * k))
            other.advance(0.1)
            await hostile.vehicle.until(lambda count=count: len(hostile.vehicle.setpoints()) > count)  # type: ignore[misc]
        (interval_s,) = hostile.snapshot().interval_s
        assert interval_s > 0.13
        assert hostile.counted("report_repeated") > 0
        (radius_m,) = hostile.radius_m()
        assert radius_m == pytest.approx(6.0 + 0.6 + 5.0 * min(interval_s, 1.0), abs=0.05)

    flown(test, impairment=bad)


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
