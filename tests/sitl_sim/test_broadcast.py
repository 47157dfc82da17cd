"""What a vehicle transmits of itself: when, in which datagrams, and never better than it knows."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import pytest

from ridlink.geodesy import Geodetic
from ridlink.mavlink.codec import CRC_EXTRAS, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.accuracy import three_sigma_bound_m
from ridlink.remote_id.convert import from_mavlink
from ridlink.remote_id.messages import Location, Separation, SeparationFlags
from ridlink.scenario import VehicleSpec
from sitl_sim.autopilot import Navigation
from sitl_sim.autopilot.navigation import Place
from sitl_sim.broadcast import Broadcaster
from sitl_sim.vehicle import VehicleState

HOME = Geodetic(47.397742, 8.545594, 488.0)
UTC_S = 1_800_000_123.4
FLYING = Navigation(
    time_s=10.0,
    position_ned_m=(100.0, 50.0, -50.0),
    velocity_ned_mps=(3.0, -4.0, 0.5),
    acceleration_ned_mps2=(0.0, 0.0, 0.0),
    place=lambda: Place(47.3986, 8.5462, 538.0, 541.0),
    h_acc_m=3.5,
    v_acc_m=5.25,
    vel_acc_mps=0.1,
    bound_3sigma_m=10.501,
    fix_type=3,
    ekf_h_acc_m=1.1,
    innovation_ratio=0.05,
    battery_remaining=0.9,
    battery_v=15.8,
    battery_a=10.0,
    link_on=True,
    state=VehicleState.AIRBORNE,
)
SPEC = VehicleSpec((0.0, 0.0, -50.0), (100.0, 0.0, -50.0), airframe_m=0.601)


def broadcaster(spec: VehicleSpec = SPEC, interval_s: float = 0.1, **details: Any) -> Broadcaster:
    return Broadcaster(7, spec, HOME, interval_s=interval_s, utc_clock=lambda: UTC_S, **details)


def read(datagram: bytes) -> list[tuple[Frame, Message]]:
    frames = parse_datagram(datagram, CRC_EXTRAS)
    return [(frame, decode_message(frame)) for frame in frames if isinstance(frame, Frame)]


def first_update(
    navigation: Navigation = FLYING, command: Any = None, spec: VehicleSpec = SPEC
) -> tuple[Location, Separation | None]:
    datagram = broadcaster(spec).tick(navigation, command, 5.0)[0]
    messages = [from_mavlink(message) for _, message in read(datagram)]
    location = messages[0]
    separation = messages[1] if len(messages) > 1 else None
    assert isinstance(location, Location) and (separation is None or isinstance(separation, Separation))
    return location, separation


def timeline(sender: Broadcaster, duration_s: float, navigation: Navigation = FLYING) -> list[tuple[float, list[str]]]:
    """When which messages went out together."""
    sent = []
    for tick in range(round(duration_s / 0.02)):
        now_s = 100.0 + tick * 0.02
        for datagram in sender.tick(navigation, None, now_s):
            sent.append((now_s - 100.0, [message.name for _, message in read(datagram)]))
    return sent


def test_location_and_separation_share_a_datagram_a_timestamp_and_a_sender() -> None:
    datagram = broadcaster().tick(FLYING, None, 5.0)[0]
    (one, location), (other, separation) = read(datagram)
    assert (location.name, separation.name) == ("OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION")
    assert (one.sysid, one.compid) == (other.sysid, other.compid) == (7, 1)
    expected = struct.unpack("<f", struct.pack("<f", UTC_S % 3600.0))[0]
    assert location.timestamp == separation.timestamp == expected
    assert location.id_or_mac == separation.id_or_mac == bytes(20)


@pytest.mark.parametrize(("interval_s", "updates"), [(0.1, 100), (0.5, 20), (1.0, 10)])
def test_updates_keep_their_interval_and_statics_come_every_three_seconds(interval_s: float, updates: int) -> None:
    sent = timeline(broadcaster(interval_s=interval_s), 10.0)
    dynamic = [at for at, names in sent if names[0] == "OPEN_DRONE_ID_LOCATION"]
    static = [at for at, names in sent if names == ["OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_SYSTEM"]]
    assert len(dynamic) == pytest.approx(updates, abs=1)
    assert static == pytest.approx([0.0, 3.0, 6.0, 9.0], abs=0.05)


def test_a_fleet_does_not_speak_all_at_once() -> None:
    assert timeline(broadcaster(phase=0.6), 0.2)[0][0] == pytest.approx(0.06, abs=0.001)
    assert timeline(broadcaster(phase=0.1), 0.2)[0][0] == pytest.approx(0.02, abs=0.001)


def test_report_is_the_navigation_solution() -> None:
    location, separation = first_update()
    assert separation is not None
    assert (location.latitude_deg, location.longitude_deg) == (47.3986, 8.5462)
    assert (location.altitude_geodetic_m, location.height_m, location.height_reference) == (538.0, 50.0, 0)
    assert (location.speed_horizontal_mps, location.speed_vertical_mps, location.status) == (5.0, -0.5, 2)
    assert location.direction_deg == pytest.approx(306.87, abs=0.01)
    assert separation.update_interval_s == 0.1


def test_errors_and_sizes_are_rounded_up() -> None:
    _, separation = first_update()
    assert separation is not None
    assert separation.horizontal_error_m == 10.51  # 10.501
    assert separation.vertical_error_m == 15.75
    assert separation.velocity_error_mps == pytest.approx(0.3)
    assert separation.airframe_size_m == 0.61  # 0.601
    assert separation.airframe_height_m == 0.31  # 0.3005


def test_an_exact_position_goes_out_as_a_centimetre_and_not_as_unknown() -> None:
    exact = replace(FLYING, bound_3sigma_m=0.0, h_acc_m=0.001, v_acc_m=0.001, vel_acc_mps=0.001)
    location, separation = first_update(exact)
    assert separation is not None
    assert (separation.horizontal_error_m, separation.vertical_error_m, separation.velocity_error_mps) == (0.01,) * 3
    assert (location.horizontal_accuracy, location.vertical_accuracy, location.speed_accuracy) == (12, 6, 4)


@pytest.mark.parametrize("bound_m", [0.5, 3.0, 10.5, 30.0, 100.0])
def test_accuracy_code_never_promises_more_than_the_error(bound_m: float) -> None:
    location, _ = first_update(replace(FLYING, bound_3sigma_m=bound_m))
    promised_m = three_sigma_bound_m(location.horizontal_accuracy)
    assert promised_m is not None and promised_m >= bound_m


def test_a_stock_sender_has_no_extension() -> None:
    location, separation = first_update(spec=replace(SPEC, extended=False))
    assert separation is None
    assert location.horizontal_accuracy == 10


def test_flags_tell_who_avoids_and_what_is_commanded() -> None:
    _, idle = first_update()
    _, avoiding = first_update(command=(1.0, -2.5, 0.25))
    assert idle is not None and avoiding is not None
    assert idle.flags == SeparationFlags.SIMULATED | SeparationFlags.ERROR_MEASURED
    assert idle.commanded_vx_mps is None
    assert avoiding.flags == 1 | 2 | 4 | 8
    assert (avoiding.commanded_vx_mps, avoiding.commanded_vy_mps, avoiding.commanded_vz_mps) == (1.0, -2.5, 0.25)


def test_without_a_fix_the_error_is_no_longer_a_measured_one() -> None:
    _, separation = first_update(replace(FLYING, fix_type=0))
    assert separation is not None
    assert separation.flags == SeparationFlags.SIMULATED


def test_who_stands_before_the_flight_says_so_and_who_has_landed_leaves_after_two_seconds() -> None:
    standing, landing = replace(FLYING, state=VehicleState.GROUNDED), replace(FLYING, state=VehicleState.LANDING)
    sender = broadcaster()
    assert read(sender.tick(standing, None, 0.0)[0])[0][1].status == 1
    assert read(sender.tick(landing, None, 10.0)[0])[0][1].status == 2
    heard = [at / 10.0 for at in range(200, 300) if sender.tick(standing, None, at / 10.0)]
    assert (heard[0], heard[-1]) == (20.0, 22.0)
    assert sender.tick(FLYING, None, 40.0)  # it flies again


def test_a_wreck_is_silent_at_once() -> None:
    sender = broadcaster()
    assert sender.tick(FLYING, None, 0.0)
    assert sender.tick(replace(FLYING, state=VehicleState.GONE), None, 1.0) == []


def test_statics_name_the_vehicle_and_where_it_took_off() -> None:
    statics = broadcaster().tick(FLYING, None, 5.0)[1]
    (_, basic_id), (_, system) = read(statics)
    assert basic_id.uas_id.rstrip(b"\x00") == b"RDLK40007"
    assert (basic_id.id_type, basic_id.ua_type) == (1, 2)
    assert (system.operator_latitude, system.operator_longitude) == (473977420, 85455940)
    assert system.timestamp == round(UTC_S - 1_546_300_800)
