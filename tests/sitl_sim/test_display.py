"""What ground stations are shown, and what a receiver on board delivers."""

from __future__ import annotations

from typing import Any

import pytest

from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.scenario import Scenario, VehicleSpec
from sitl_sim.autopilot import FleetNavigation
from sitl_sim.bus import BusReceiver, mac_of
from sitl_sim.clock import FleetClock
from sitl_sim.display import NEAREST, TrafficDisplay, icao_address
from sitl_sim.vehicle import VehicleState
from sitl_sim.world import World
from tests.sitl_sim.flight import HOME


def messages(frames: list[bytes]) -> list[tuple[int, int, Message]]:
    found: Any = [frame for datagram in frames for frame in parse_datagram(datagram, CRC_EXTRAS)]
    return [(frame.sysid, frame.compid, decode_message(frame)) for frame in found]


def fleet(count: int) -> tuple[World, list[Any]]:
    specs = [VehicleSpec((50.0 * k, 0.0, -50.0), (50.0 * k, 900.0, -50.0), sigma_m=0.0) for k in range(count)]
    world = World(Scenario("row", 600.0, tuple(specs)))
    return world, [FleetNavigation(world, HOME)[k] for k in range(count)]


def test_the_nearest_ten_are_shown_from_component_156() -> None:
    _, navigation = fleet(14)
    heartbeat, *contacts = messages(TrafficDisplay(1).frames(navigation))
    assert (heartbeat[0], heartbeat[1], heartbeat[2].type) == (1, 156, 27)
    assert len(contacts) == NEAREST and all(message.name == "ADSB_VEHICLE" for _, _, message in contacts)
    assert [message.callsign.rstrip(b"\0") for _, _, message in contacts] == [b"RDLK%04d" % k for k in range(2, 12)]
    assert contacts[0][2].lat == round(navigation[1].place().latitude_deg * 1e7)
    assert len({message.ICAO_address for _, _, message in contacts}) == NEAREST


def test_who_has_crashed_is_shown_no_longer() -> None:
    world, _ = fleet(3)
    world.state[1] = VehicleState.GONE
    frames = TrafficDisplay(1).frames([FleetNavigation(world, HOME)[k] for k in range(3)])
    assert [message.callsign.rstrip(b"\0") for _, _, message in messages(frames)[1:]] == [b"RDLK0003"]


def test_icao_addresses_have_24_bits() -> None:
    assert 0 <= icao_address("RDLK0001") < 2**24 and icao_address("RDLK0001") != icao_address("RDLK0002")


def test_a_receiver_on_board_says_who_was_heard() -> None:
    other = Encoder(7, 1)
    broadcast = other.encode("OPEN_DRONE_ID_LOCATION", latitude=473977420) + other.encode(
        "RIDLINK_SEPARATION", horizontal_error=300
    )
    delivered = messages(BusReceiver(3).deliver(broadcast))
    assert [(sysid, compid, message.name) for sysid, compid, message in delivered] == [
        (3, 236, "OPEN_DRONE_ID_LOCATION"),
        (3, 236, "RIDLINK_SEPARATION"),
    ]
    assert delivered[0][2].latitude == 473977420
    assert {message.id_or_mac for _, _, message in delivered} == {mac_of(7).ljust(20, b"\0")}


def test_what_another_receiver_relays_keeps_its_sender_and_other_messages_stay_away() -> None:
    relayed = Encoder(7, 236).encode("OPEN_DRONE_ID_BASIC_ID", id_or_mac=b"somebody".ljust(20, b"\0"))
    noise = Encoder(7, 1).encode("HEARTBEAT", type=2) + b"noise"
    delivered = messages(BusReceiver(3).deliver(noise + relayed))
    assert [message.id_or_mac.rstrip(b"\0") for _, _, message in delivered] == [b"somebody"]


def test_frames_stay_whole() -> None:
    (frame,) = parse_datagram(BusReceiver(3).deliver(Encoder(7, 1).encode("OPEN_DRONE_ID_SYSTEM"))[0], CRC_EXTRAS)
    assert isinstance(frame, Frame) and frame.checked


@pytest.mark.parametrize("speedup", [1.0, 4.0])
def test_a_clock_runs_so_many_times_as_fast_with_its_utc(speedup: float) -> None:
    real = [100.0]
    clock = FleetClock(lambda: real[0], lambda: 1e9, speedup)
    real[0] = 110.0
    assert clock.now_s() == 100.0 + 10.0 * speedup
    assert clock.utc_s() == 1e9 + 10.0 * speedup
    assert clock.real_of(clock.now_s()) == pytest.approx(110.0)


def test_in_lockstep_time_stands_until_it_is_advanced() -> None:
    real = [100.0]
    clock = FleetClock(lambda: real[0], lambda: 1e9, 0.0)
    real[0] = 200.0
    assert clock.is_lockstep and clock.now_s() == 0.0
    clock.advance(0.5)
    assert clock.now_s() == 0.5 and clock.utc_s() == 1e9 + 0.5
