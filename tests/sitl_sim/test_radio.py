"""The air: who hears whom, how late, how often not; and that nothing anybody sends can hurt it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.mavlink.codec import Encoder
from ridlink.technologies import TECHNOLOGIES
from ridlink.units import dege7_from_deg
from sitl_sim.chance import reception_chances
from sitl_sim.listeners import MAX_PLACES, MAX_SUBSCRIBERS
from sitl_sim.radio import Air

HOME = Geodetic(47.0, 8.0, 400.0)

ONE, TWO, THREE = ("127.0.0.1", 50001), ("127.0.0.1", 50002), ("127.0.0.1", 50003)
OBSERVER = ("127.0.0.1", 50255)


def heartbeat(system_id: int) -> bytes:
    return Encoder(system_id, 196).encode("HEARTBEAT", type=18, autopilot=8, mavlink_version=3)


def location(
    system_id: int, north_m: float, east_m: float, *, relayed: bool = False, altitude_m: float | None = None
) -> bytes:
    latitude, longitude, altitude = geodetic_from_ned([north_m, east_m, -50.0], HOME)
    return Encoder(system_id, 236).encode(
        "OPEN_DRONE_ID_LOCATION",
        latitude=dege7_from_deg(float(latitude)),
        longitude=dege7_from_deg(float(longitude)),
        altitude_geodetic=float(altitude) if altitude_m is None else altitude_m,
        id_or_mac=(b"other" if relayed else b"").ljust(20, b"\0"),
    )


def air_of_three(**settings: object) -> Air:
    """Vehicles 1, 2, 3 of the emulator at 0, 300 and 600 m north, each with a subscriber; and an observer."""
    air = Air(home=HOME, **settings)  # type: ignore[arg-type]
    air.listeners.place_vehicles([[0.0, 0.0, -50.0], [300.0, 0.0, -50.0], [600.0, 0.0, -50.0]])
    for system_id, address in ((1, ONE), (2, TWO), (3, THREE), (255, OBSERVER)):
        air.receive(heartbeat(system_id), address, 0.0)
    return air


def heard_by(air: Air, now_s: float = 0.0) -> list[object]:
    return sorted(address for _, address in air.due(now_s))


def test_vehicles_hear_each_other_within_range_and_the_observer_hears_all() -> None:
    air = air_of_three()
    air.broadcast(1, None, b"from 1", 0.0)
    assert heard_by(air) == [TWO, OBSERVER]
    air.broadcast(2, None, b"from 2", 0.0)
    assert heard_by(air) == [ONE, THREE, OBSERVER]
    assert air.counters["out_of_range"] == 1


def test_range_can_be_set_and_ends_sharply() -> None:
    near, far = air_of_three(range_m=299.9), air_of_three(range_m=300.0)
    for air in (near, far):
        air.broadcast(1, None, b"x", 0.0)
    assert heard_by(near) == [OBSERVER]
    assert heard_by(far) == [TWO, OBSERVER]


def test_range_follows_the_true_positions_as_they_move() -> None:
    air = air_of_three()
    air.listeners.place_vehicles([[0.0, 0.0, -50.0], [300.0, 0.0, -50.0], [399.0, 0.0, -50.0]])
    air.broadcast(1, None, b"x", 0.0)
    assert THREE in heard_by(air)
    air.broadcast(1, [900.0, 0.0, -50.0], b"x", 0.0)  # a stated position goes before the placed one
    assert heard_by(air) == [OBSERVER]


def test_who_has_crashed_neither_hears_nor_is_heard() -> None:
    air = air_of_three()
    air.listeners.place_vehicles(np.zeros((3, 3)), on_air=[True, False, True])
    air.broadcast(1, None, b"x", 0.0)
    assert heard_by(air) == [THREE, OBSERVER]
    air.broadcast(2, None, b"x", 0.0)
    assert heard_by(air) == []
    assert air.counters["off_air"] == 1


def test_a_daemon_broadcasts_from_where_its_vehicle_truly_is() -> None:
    air = air_of_three()
    air.receive(location(2, 5000.0, 0.0), TWO, 0.0)  # its receiver is wrong by kilometres; its radio is not
    assert heard_by(air) == [ONE, THREE, OBSERVER]


def test_a_vehicle_outside_the_emulator_is_where_it_says() -> None:
    air = air_of_three()
    outside = ("127.0.0.1", 60000)
    air.receive(heartbeat(77), outside, 0.0)
    air.receive(location(77, -350.0, 0.0), outside, 0.0)
    assert heard_by(air) == [ONE, OBSERVER]
    air.broadcast(3, None, b"x", 0.0)
    assert outside not in heard_by(air)
    air.broadcast(1, None, b"x", 0.0)
    assert outside in heard_by(air)


def test_nobody_knows_where_a_silent_outsider_is_so_it_hears_all_and_only_observers_hear_it() -> None:
    air = air_of_three()
    outside = ("127.0.0.1", 60000)
    air.receive(heartbeat(77), outside, 0.0)
    air.broadcast(3, None, b"x", 0.0)
    assert outside in heard_by(air)
    air.receive(Encoder(77, 236).encode("OPEN_DRONE_ID_BASIC_ID", ua_type=2), outside, 0.0)
    assert heard_by(air) == [OBSERVER]
    assert air.counters["no_position"] == 1


@pytest.mark.parametrize(
    "useless",
    [
        Encoder(77, 236).encode("OPEN_DRONE_ID_LOCATION"),  # latitude and longitude 0 mean unknown
        Encoder(77, 236).encode("OPEN_DRONE_ID_LOCATION", latitude=1_700_000_000, longitude=80_000_000),
    ],
)
def test_a_location_that_says_nothing_of_the_sender_does_not_place_it(useless: bytes) -> None:
    air = air_of_three()
    outside = ("127.0.0.1", 60000)
    air.receive(heartbeat(77), outside, 0.0)
    air.receive(useless, outside, 0.0)
    assert heard_by(air) == [OBSERVER]


@pytest.mark.parametrize("altitude_m", [-1000.0, float("nan"), float("inf")])
def test_an_unknown_altitude_is_taken_for_the_ground(altitude_m: float) -> None:
    air = air_of_three()
    outside = ("127.0.0.1", 60000)
    air.receive(heartbeat(77), outside, 0.0)
    air.receive(location(77, -100.0, 0.0, altitude_m=altitude_m), outside, 0.0)
    assert heard_by(air) == [ONE, OBSERVER]


def test_a_heartbeat_subscribes_for_10_s_and_goes_no_further() -> None:
    air = air_of_three()
    assert air.due(0.0) == []
    air.receive(heartbeat(2), TWO, 6.0)
    air.listeners.expire(10.5)
    assert air.listeners.subscribers == {TWO: 2}
    assert air.counters["expired"] == 3
    air.broadcast(1, None, b"x", 10.5)
    assert heard_by(air, 10.5) == [TWO]
    air.broadcast(1, None, b"x", 16.5)  # silent for too long, even before anybody called expire
    assert heard_by(air, 16.5) == []


def test_frames_travel_as_they_came_without_the_heartbeat_among_them() -> None:
    air = air_of_three()
    frames = location(1, 0.0, 0.0) + Encoder(1, 236).encode("OPEN_DRONE_ID_BASIC_ID", ua_type=2)
    air.receive(heartbeat(1) + b"noise" + frames, ONE, 0.0)
    assert {payload for payload, _ in air.due(0.0)} == {frames}
    assert air.counters["malformed"] == 1


def test_a_sender_hears_neither_itself_nor_its_own_vehicle() -> None:
    air = air_of_three()
    second_ear = ("127.0.0.1", 50111)
    air.receive(heartbeat(1), second_ear, 0.0)
    air.receive(location(1, 0.0, 0.0), ONE, 0.0)
    assert heard_by(air) == [TWO, OBSERVER]


def test_a_transmitter_need_not_listen_to_be_heard_where_it_says_that_it_is() -> None:
    air = air_of_three()
    transmitter = ("127.0.0.1", 60000)
    air.receive(location(77, -350.0, 0.0), transmitter, 0.0)
    assert heard_by(air) == [ONE, OBSERVER]
    air.receive(Encoder(77, 236).encode("OPEN_DRONE_ID_BASIC_ID", ua_type=2), transmitter, 1.0)
    assert heard_by(air, 1.0) == [ONE, OBSERVER]
    assert transmitter not in air.listeners.subscribers
    air.listeners.expire(11.0)
    air.receive(heartbeat(1), ONE, 11.0)
    air.receive(Encoder(77, 236).encode("OPEN_DRONE_ID_BASIC_ID", ua_type=2), transmitter, 11.0)
    assert heard_by(air, 11.0) == []  # it has not said for 10 s where it is
    assert air.counters["no_position"] == 1


def test_a_relayed_aircraft_is_heard_round_where_it_is_and_tells_nothing_of_who_relays_it() -> None:
    air = air_of_three()
    relay = ("127.0.0.1", 60000)
    air.receive(location(254, -350.0, 0.0, relayed=True), relay, 0.0)
    assert heard_by(air) == [ONE, OBSERVER]
    named = Encoder(254, 236).encode("OPEN_DRONE_ID_BASIC_ID", ua_type=2, id_or_mac=b"other".ljust(20, b"\0"))
    air.receive(named, relay, 0.0)
    assert heard_by(air) == [ONE, OBSERVER]
    air.receive(Encoder(254, 236).encode("OPEN_DRONE_ID_BASIC_ID", ua_type=2), relay, 0.0)
    assert heard_by(air) == [OBSERVER]


def test_who_says_where_it_is_relays_from_there() -> None:
    air = air_of_three()
    outside = ("127.0.0.1", 60000)
    air.receive(location(77, 1000.0, 0.0), outside, 0.0)
    assert heard_by(air) == [THREE, OBSERVER]
    air.receive(location(77, -350.0, 0.0, relayed=True), outside, 0.0)
    assert heard_by(air) == [THREE, OBSERVER]


def test_a_flood_of_places_is_bounded() -> None:
    air = air_of_three()
    for port in range(MAX_PLACES + 50):
        air.receive(location(77, -350.0, 0.0), ("127.0.0.2", port), 0.0)
    assert air.counters["refused"] == 50
    air.listeners.expire(10.5)
    air.receive(heartbeat(1), ONE, 10.5)
    air.due(10.5)
    air.receive(location(77, -350.0, 0.0), ("127.0.0.3", 1), 10.5)
    assert heard_by(air, 10.5) == [ONE]


def test_a_flood_of_addresses_is_bounded() -> None:
    air = Air()
    for port in range(MAX_SUBSCRIBERS + 50):
        air.listeners.subscribe(("127.0.0.1", port), 7, 0.0)
    assert len(air.listeners.subscribers) == MAX_SUBSCRIBERS
    assert air.counters["refused"] == 50


def receptions(air: Air, *, count: int = 2000, period_s: float = 0.1) -> Counter[object]:
    for k in range(count):
        air.broadcast(2, None, b"%d" % k, k * period_s)
        air.listeners.subscribe(ONE, 1, k * period_s)
        air.listeners.subscribe(THREE, 3, k * period_s)
        air.listeners.subscribe(OBSERVER, 255, k * period_s)
    return Counter(address for _, address in air.due(1e9))


def test_loss_is_as_set_and_each_receiver_has_its_own() -> None:
    counted = receptions(air_of_three(loss=0.3))
    assert counted[ONE] / 2000 == pytest.approx(0.7, abs=0.035)
    assert counted[THREE] / 2000 == pytest.approx(0.7, abs=0.035)
    assert counted[ONE] != counted[THREE]
    assert counted[OBSERVER] == 2000


def test_loss_repeats_with_the_seed() -> None:
    def lost(seed: int) -> list[bytes]:
        air = air_of_three(loss=0.5, seed=seed)
        receptions(air, count=0)
        for k in range(50):
            air.broadcast(2, None, b"%d" % k, 0.0)
        return [payload for payload, address in air.due(0.0) if address == ONE]

    assert lost(1) == lost(1)
    assert lost(1) != lost(2)


def test_what_one_receiver_loses_does_not_depend_on_who_else_listens() -> None:
    def heard(*, alone: bool) -> list[bytes]:
        air = Air(loss=0.5)
        air.listeners.place_vehicles(np.zeros((3, 3)))
        if not alone:
            air.listeners.subscribe(THREE, 3, 0.0)
        air.listeners.subscribe(ONE, 1, 0.0)
        for k in range(50):
            air.broadcast(2, None, b"%d" % k, 0.0)
        return [payload for payload, address in air.due(0.0) if address == ONE]

    assert heard(alone=True) == heard(alone=False)


@pytest.mark.parametrize("name", list(TECHNOLOGIES))
def test_every_technology_delivers_within_its_latency_and_range(name: str) -> None:
    technology = TECHNOLOGIES[name]
    air = Air(name, loss=0.0)
    air.listeners.place_vehicles(
        [[0.0, 0.0, 0.0], [technology.range_m - 1.0, 0.0, 0.0], [0.0, technology.range_m + 1.0, 0.0]]
    )
    for system_id, address in ((2, TWO), (3, THREE)):
        air.listeners.subscribe(address, system_id, 0.0)
    for _ in range(200):
        air.broadcast(1, None, b"x", 1.0)
    shortest, longest = technology.latency_s
    first_s = air.next_due_s()
    assert first_s is not None
    assert 1.0 + shortest <= first_s <= 1.0 + longest
    assert air.due(1.0 + shortest - 1e-6) == []
    assert [address for _, address in air.due(1.0 + longest)] == [TWO] * 200
    assert air.next_due_s() is None


def test_arrivals_come_in_order_of_time_and_ties_in_order_of_sending() -> None:
    air = air_of_three()
    for k in range(20):
        air.broadcast(1, None, b"%02d" % k, 0.0)
    payloads = [payload for payload, address in air.due(0.0) if address == TWO]
    assert payloads == sorted(payloads)


@pytest.mark.parametrize(
    "settings", [{"technology": "smoke"}, {"range_m": 0.0}, {"range_m": float("nan")}, {"loss": 1.5}, {"loss": -0.1}]
)
def test_impossible_settings_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        Air(**settings)  # type: ignore[arg-type]


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.binary(max_size=80), st.sampled_from([ONE, TWO, ("127.0.0.1", 9)])), max_size=8))
def test_no_datagram_hurts(datagrams: list[tuple[bytes, tuple[str, int]]]) -> None:
    air = air_of_three()
    for datagram, address in datagrams:
        air.receive(datagram, address, 0.0)
        air.receive(location(2, 0.0, 0.0)[:-1] + datagram, address, 0.0)
    air.due(0.0)
    air.broadcast(1, None, b"still here", 0.0)
    assert (b"still here", TWO) in air.due(0.0)


# --- how much arrives -------------------------------------------------------------------------------------------------


def share_heard(air: Air, distance_m: float, *, count: int = 1500) -> float:
    """Share of the broadcasts of vehicle 1 that vehicle 2 hears over a distance."""
    air.listeners.place_vehicles([[0.0, 0.0, -50.0], [distance_m, 0.0, -50.0]])
    air.listeners.subscribe(TWO, 2, 0.0)
    for _ in range(count):
        air.broadcast(1, None, b"x", 0.0)
    return len(air.due(1e9)) / count


@pytest.mark.parametrize("name", list(TECHNOLOGIES))
def test_what_arrives_over_a_distance_is_what_the_table_says(name: str) -> None:
    technology = TECHNOLOGIES[name]
    for part in (0.01, 0.5, 0.8, 0.99):
        distance_m = part * technology.range_m
        expected = float(technology.link_share(distance_m))
        assert share_heard(Air(name, seed=4), distance_m) == pytest.approx(expected, abs=0.035)
    assert share_heard(Air(name), 1.01 * technology.range_m) == 0.0


def test_another_range_stretches_the_fading_with_it() -> None:
    expected = float(TECHNOLOGIES["bt4"].link_share(0.9 * 300.0))
    assert share_heard(Air("bt4", range_m=1000.0), 900.0) == pytest.approx(expected, abs=0.035)


def test_a_stated_loss_is_flat_and_knows_no_crowd() -> None:
    assert share_heard(Air("wifi-beacon", loss=0.2), 399.0) == pytest.approx(0.8, abs=0.035)


@pytest.mark.parametrize("crowd", [0, 20, 100])
def test_senders_in_range_destroy_what_the_table_says(crowd: int) -> None:
    technology = TECHNOLOGIES["wifi-beacon"]
    air = Air("wifi-beacon", seed=2)
    air.listeners.place_vehicles(np.zeros((crowd + 2, 3)))
    for other in range(3, crowd + 3):
        air.broadcast(other, None, b"crowd", 0.0)
    air.broadcast(1, None, b"x", 0.0)
    air.listeners.subscribe(TWO, 2, 0.5)
    for _ in range(1500):
        air.broadcast(1, None, b"x", 0.5)
    expected = float(technology.link_share(0.0) * technology.collision_share(crowd))
    assert len(air.due(1e9)) / 1500 == pytest.approx(expected, abs=0.035)


@pytest.mark.parametrize("crowd", [0, 1])
def test_a_receiver_that_sends_is_none_of_the_others(crowd: int, monkeypatch: pytest.MonkeyPatch) -> None:
    technology = replace(TECHNOLOGIES["wifi-beacon"], loss=0.0, edge_loss=0.0, crowding=1.0)
    monkeypatch.setitem(TECHNOLOGIES, "crowded", technology)
    air = Air("crowded", seed=2)
    air.listeners.place_vehicles(np.zeros((crowd + 2, 3)))
    for sender in range(1, crowd + 3):
        air.broadcast(sender, None, b"crowd", 0.0)
    air.listeners.subscribe(TWO, 2, 0.5)
    for _ in range(1500):
        air.broadcast(1, None, b"x", 0.5)
    assert len(air.due(1e9)) / 1500 == pytest.approx(float(technology.collision_share(crowd)), abs=0.035)


def test_a_crowd_that_has_fallen_silent_destroys_nothing() -> None:
    air = Air("wifi-beacon")
    air.listeners.place_vehicles(np.zeros((102, 3)))
    for other in range(3, 103):
        air.broadcast(other, None, b"crowd", 0.0)
    air.listeners.subscribe(TWO, 2, 9.0)
    for _ in range(2000):
        air.broadcast(1, None, b"x", 9.0)
    assert len(air.due(1e9)) / 2000 == pytest.approx(0.9, abs=0.03)


def test_what_is_lost_does_not_depend_on_the_order_in_which_others_send() -> None:
    def heard(order: list[int]) -> set[bytes]:
        air = Air("wifi-beacon", loss=0.5, seed=3)
        air.listeners.place_vehicles(np.zeros((4, 3)))
        air.listeners.subscribe(ONE, 1, 0.0)
        for k in range(40):
            for sender in order:
                air.broadcast(sender, None, b"%d/%d" % (sender, k), 0.1 * k)
        return {payload for payload, _ in air.due(1e9)}

    assert heard([2, 3, 4]) == heard([4, 2, 3])
    assert {payload for payload in heard([2, 3, 4]) if payload.startswith(b"3/")} == heard([3])


def test_chances_are_uniform_and_independent() -> None:
    first, second = zip(*(reception_chances(1, 5, number, np.arange(1, 251)) for number in range(200)), strict=True)
    lost, late = np.array(first), np.array(second)
    for figures in (lost, late):
        assert figures.min() >= 0.0 and figures.max() < 1.0
        assert np.histogram(figures, 10, (0.0, 1.0))[0] / figures.size == pytest.approx([0.1] * 10, abs=0.006)
    for one, other in ((lost, late), (lost[1:], lost[:-1]), (lost[:, 1:], lost[:, :-1])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.015
