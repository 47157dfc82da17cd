"""Who is served by the emulated autopilot, and what it carries from one peer to the others."""

from __future__ import annotations

import itertools

import pytest

from ridlink.mavlink.codec import Encoder, decode_message
from tests.sitl_sim.flight import COMPANION, GROUND_STATION, Flight, both


def test_four_others_are_served_beside_the_companion_until_they_fall_silent() -> None:
    flight = Flight()
    flight.advance(0.1)
    others = [("127.0.0.1", 50000 + k) for k in range(5)]
    for address in others:
        answer = flight.send("PING", address=address, seq=1)
        assert answer[0].name == "PING"  # the fifth is answered, but gets no streams
    flight.advance(1.0)
    assert [len(flight.messages("HEARTBEAT", address)) for address in [COMPANION, *others]] == [2, 1, 1, 1, 1, 0]
    flight.advance(5.0)
    flight.send("HEARTBEAT", address=others[0], type=6)
    flight.advance(6.0)
    flight.heard.clear()
    flight.advance(1.0)
    assert set(flight.heard) == {COMPANION, others[0]}
    flight.send("HEARTBEAT", address=others[4], type=6)
    flight.advance(1.0)
    assert flight.messages("HEARTBEAT", others[4])


def test_sequence_numbers_of_a_link_have_no_gaps() -> None:
    flight = Flight()
    flight.advance(0.1)
    flight.send("HEARTBEAT", type=6)
    seen: list[int] = []
    for _ in range(100):
        flight.now_s += 0.02
        flight.world.step(0.02)
        for datagram, address in flight.autopilot.tick(flight.now_s) + flight.autopilot.receive(
            flight.client.encode("PING", seq=1), GROUND_STATION, flight.now_s
        ):
            if address == GROUND_STATION:
                at = 0
                while at < len(datagram):
                    seen.append(datagram[at + 4])
                    at += 12 + datagram[at + 1]
    assert len(seen) > 150
    assert all((one + 1) % 256 == other for one, other in itertools.pairwise(seen))


@both
def test_a_parameter_that_somebody_sets_is_told_to_all(flavour: str) -> None:
    """Who showed the old value showed it for ever."""
    name = "RTL_RETURN_ALT" if flavour == "px4" else "GUID_TIMEOUT"
    flight = Flight(flavour)
    other = ("127.0.0.1", 50001)
    flight.advance(0.1)
    flight.send("HEARTBEAT", address=other, type=6)
    (echo,) = flight.send("PARAM_SET", target_system=1, param_id=name, param_value=4.5, param_type=9)
    flight.advance(1.0)
    for address in (COMPANION, other, GROUND_STATION):
        assert [message for _, message in flight.messages("PARAM_VALUE", address)] == [echo]
    flight.send("PARAM_SET", target_system=1, param_id=name, param_value=-1.0, param_type=9)
    flight.send("PARAM_REQUEST_READ", target_system=1, param_id=name, param_index=-1)
    flight.advance(1.0)  # a value that stays is for who asked
    assert [len(flight.messages("PARAM_VALUE", each)) for each in (COMPANION, other, GROUND_STATION)] == [1, 1, 3]


@both
def test_words_of_others_are_passed_on_untouched_and_what_is_for_the_autopilot_is_not(flavour: str) -> None:
    flight = Flight(flavour)
    flight.advance(0.1)
    other, foreign = ("127.0.0.1", 50001), Encoder(42, 1)
    flight.send("HEARTBEAT", address=other, type=6)
    flight.advance(0.1)
    flight.passed_on.clear()
    sent = [
        foreign.encode("HEARTBEAT", type=2, autopilot=12),
        foreign.encode("OPEN_DRONE_ID_LOCATION", latitude=473977420),
        foreign.encode("COMMAND_LONG", target_system=1, target_component=196, command=192),
    ]
    alone = [foreign.encode("PING", seq=1), foreign.encode("PARAM_REQUEST_LIST", target_system=1, target_component=1)]
    for datagram in (*sent, *alone):
        flight.autopilot.receive(datagram, GROUND_STATION, flight.now_s)
    flight.advance(0.02)
    for address in (COMPANION, other):
        assert [frame.raw for to, frame in flight.passed_on if to == address] == sent
    assert not [frame for to, frame in flight.passed_on if to == GROUND_STATION]


@pytest.mark.parametrize(("flavour", "repeats"), [("px4", 1), ("ardupilot", 0)])
def test_px4_gives_foreign_traffic_out_again_as_its_own(flavour: str, repeats: int) -> None:
    flight = Flight(flavour)
    flight.advance(0.1)
    flight.send("ADSB_VEHICLE", sender=Encoder(42, 1), ICAO_address=7, callsign="GHOST")
    flight.advance(0.02)
    assert len(flight.messages("ADSB_VEHICLE", GROUND_STATION)) == repeats  # also to whoever sent it
    assert [decode_message(frame).ICAO_address for _, frame in flight.passed_on] == [7]


def test_a_flood_is_not_passed_on() -> None:
    flight = Flight()
    flight.advance(0.1)
    for _ in range(5):
        flight.autopilot.receive(Encoder(42, 1).encode("HEARTBEAT") * 60, GROUND_STATION, flight.now_s)
    flight.advance(0.02)
    assert len(flight.passed_on) == 64 and flight.autopilot.counters["not_passed_on"] == 236
