"""What is heard over Remote ID makes tracks, and nothing else."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.engine import EngineConfig
from ridlink.failsafe import State
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.bridge import pack_to_mavlink
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import BasicId, Location, Separation
from tests.daemon.emulated import Emulated, at
from tests.daemon.invariants import messages
from tests.engine.flight import Flight, reposition


def test_i5_nothing_on_the_remote_id_link_changes_own_state_goal_or_request() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    before = flight.engine.telemetry.state(0.05)
    hostile = Emulated(1, ned_m=(500.0, 0.0, -50.0))
    hostile.armed = False
    command = Encoder(255, 190).encode("COMMAND_INT", target_system=1, target_component=196, **reposition())
    flight.engine.receive_remote_id(hostile.telemetry(0.05) + command, 0.05, source="air")
    assert flight.engine.telemetry.state(0.05) == before
    assert flight.engine.telemetry.armed
    assert flight.engine.goal is None and not flight.engine.rung.requested
    assert flight.engine.step(0.1).replies == []


def test_own_remote_id_on_the_own_bus_is_no_traffic_and_tells_our_identity() -> None:
    flight = Flight()
    flight.step(2)
    name, fields = to_mavlink(BasicId(1, 2, b"OWN-ID"))
    own = flight.vehicle.encoder.encode(name, **fields) + flight.vehicle.remote_id(flight.now_s)
    flight.engine.receive_vehicle(own, flight.now_s, source="autopilot")
    assert len(flight.engine.picture) == 0
    relayed = Emulated(3, ned_m=(1.0, 0.0, -50.0)).remote_id(flight.now_s, id_or_mac=b"OWN-ID")
    flight.engine.receive_remote_id(relayed, flight.now_s, source="air")
    assert len(flight.engine.picture) == 0
    assert flight.engine.counters["own_echo"] >= 1


def test_f09_our_own_remote_id_is_no_intruder_while_the_telemetry_is_lost_nor_when_it_is_back() -> None:
    """The autopilot flies home meanwhile, far from where it was heard last."""
    flight = Flight(settings=EngineConfig(standby=True))
    flight.others = [lambda now_s: flight.vehicle.remote_id(now_s)]
    flight.vehicle.velocity = np.array([10.0, 0.0, 0.0])
    flight.step(20)
    flight.telling = False
    flight.vehicle.velocity = np.zeros(3)
    flight.step(100)
    flight.vehicle.velocity = np.array([-10.0, 0.0, 0.0])
    flight.step(300)
    flight.telling = True
    flight.vehicle.velocity = np.zeros(3)
    flight.step(20)
    assert flight.outputs[-1].decision.own is not None
    assert len(flight.engine.picture) == 0 and flight.engine.counters["own_id_elsewhere"] == 0
    assert flight.engine.counters["own_echo"] == 440


def test_own_remote_id_that_comes_before_the_first_heartbeat_is_no_neighbour() -> None:
    flight = Flight()
    own = flight.vehicle.remote_id(0.0, extended=False)
    flight.engine.receive_vehicle(own, 0.0, source="autopilot")
    flight.engine.receive_remote_id(own, 0.0, source="air")
    flight.step(10)
    assert len(flight.engine.picture) == 0
    assert flight.engine.counters["heard_before_the_vehicle"] == 2


def test_another_vehicle_on_the_link_does_not_inherit_the_name_of_the_last_one() -> None:
    flight = Flight()
    flight.step(2)
    name, fields = to_mavlink(BasicId(1, 2, b"FIRST"))
    first = flight.vehicle.encoder.encode(name, **fields)
    flight.engine.receive_vehicle(first, flight.now_s, source="autopilot")
    flight.now_s += 4.0
    flight.vehicle = Emulated(2)
    flight.step(2)
    assert flight.engine.telemetry.lock is not None and flight.engine.telemetry.lock.sysid == 2
    near = Emulated(1, ned_m=(10.0, 0.0, -50.0)).remote_id(flight.now_s)
    flight.engine.receive_remote_id(first + near, flight.now_s, source="air")
    assert len(flight.engine.picture) == 1, "taken for an echo of ourselves it would be flown into"


def test_another_vehicle_on_the_link_is_not_broadcast_under_the_name_of_the_last_one() -> None:
    flight = Flight(settings=EngineConfig(standby=True, broadcast=True))
    flight.step(2)
    name, fields = to_mavlink(BasicId(1, 2, b"FIRST"))
    flight.engine.receive_vehicle(flight.vehicle.encoder.encode(name, **fields), flight.now_s, source="autopilot")
    flight.now_s += 4.0
    flight.vehicle = Emulated(2)
    said = [message for datagram in flight.step().broadcasts for message in messages(datagram)]
    (basic_id,) = [message for message in said if message.name == name]
    assert basic_id.id_type == 0 and not any(basic_id.uas_id)


def test_a_vehicle_that_tells_a_registration_alone_is_broadcast_under_a_registration() -> None:
    flight = Flight(settings=EngineConfig(standby=True, broadcast=True))
    flight.engine.receive_vehicle(flight.vehicle.telemetry(0.0), 0.0, source="autopilot")
    name, fields = to_mavlink(BasicId(2, 2, b"REGISTRATION"))
    flight.engine.receive_vehicle(flight.vehicle.encoder.encode(name, **fields), 0.0, source="autopilot")
    said = [message for datagram in flight.step().broadcasts for message in messages(datagram)]
    (basic_id,) = [message for message in said if message.name == name]
    assert basic_id.id_type == 2 and bytes(basic_id.uas_id).rstrip(b"\0") == b"REGISTRATION"


def test_a_stranger_on_the_vehicle_link_cannot_lend_us_the_identity_of_an_intruder() -> None:
    flight = Flight()
    flight.step(2)
    name, fields = to_mavlink(BasicId(1, 2, b"INTRUDER"))
    lie = flight.vehicle.encoder.encode(name, **fields)
    flight.engine.receive_vehicle(lie, flight.now_s, source="stranger")
    near = Emulated(3, ned_m=(10.0, 0.0, -50.0)).remote_id(flight.now_s, id_or_mac=b"INTRUDER")
    flight.engine.receive_remote_id(near, flight.now_s, source="air")
    assert len(flight.engine.picture) == 1, "taken for an echo of ourselves it would be flown into"


def test_foreign_remote_id_forwarded_on_the_vehicle_link_is_traffic() -> None:
    flight = Flight()
    flight.step(2)
    flight.engine.receive_vehicle(Emulated(42, ned_m=(99.0, 0.0, -50.0)).remote_id(0.2), 0.2, source="autopilot")
    assert len(flight.engine.picture) == 1


def test_a_message_pack_that_a_receiver_relays_is_traffic_whole() -> None:
    flight = Flight()
    flight.step(2)
    latitude, longitude, altitude = at(99.0, up_m=50.0)
    pack = [
        BasicId(1, 2, b"OTHER"),
        Location(2, latitude_deg=latitude, longitude_deg=longitude, altitude_geodetic_m=altitude, timestamp_s=0.2),
        Separation(horizontal_error_m=4.0, airframe_size_m=0.5),
    ]
    name, fields = pack_to_mavlink(pack, id_or_mac=b"\x84\xcc\xa8\x60\x43\x24")
    fields["messages"] = fields["messages"][:75] + b"\x62" + bytes(149)
    frame = Encoder(1, 236).encode(name, **(fields | {"msg_pack_size": 4}))
    flight.engine.receive_vehicle(frame, 0.2, source="autopilot")
    (track,) = flight.engine.picture.tracks.values()
    assert track.report.uas_id == b"OTHER" and track.report.horizontal_error_m == 4.0
    assert flight.engine.counters["OPEN_DRONE_ID_MESSAGE_PACK.unknown_message_type"] == 1


def test_bad_bytes_are_counted_by_cause_and_the_good_ones_beside_them_count() -> None:
    flight = Flight()
    flight.step()
    other = Emulated(9, ned_m=(100.0, 0.0, -50.0))
    good = other.remote_id(0.0, extended=False)
    flipped = good[:20] + bytes([good[20] ^ 1]) + good[21:]
    version_1 = bytes.fromhex("fe09004301000000000002030403031b68")
    flight.engine.receive_remote_id(b"junk" + flipped + good, 0.0, source="air")
    flight.engine.receive_remote_id(b"", 0.0, source="air")
    flight.engine.receive_remote_id(version_1, 0.0, source="air")
    counters = flight.engine.counters
    assert len(flight.engine.picture) == 1
    assert counters["garbage"] >= 1 and counters["bad_checksum"] >= 1
    assert flight.engine.summary().reports_received == 1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=8), st.integers(0, 2**32 - 1))
def test_any_bytes_on_either_link_leave_a_valid_stream(datagrams: list[bytes], seed: int) -> None:
    random = np.random.default_rng(seed)
    flight = Flight()
    flight.step(2)
    whole = Emulated(9, ned_m=(60.0, 1.0, -50.0)).remote_id(0.2) + flight.vehicle.position_messages(0.2)
    for data in datagrams:
        mixed = bytearray(whole)
        for index in random.integers(0, len(mixed), 3):
            mixed[index] = int(random.integers(0, 256))
        flight.engine.receive_remote_id(data + bytes(mixed), flight.now_s, source="air")
        flight.engine.receive_vehicle(data, flight.now_s, source="autopilot")
        flight.engine.receive_vehicle(bytes(mixed), flight.now_s, source="stranger")
    flight.step(3)
    assert flight.engine.rung.state is State.ENGAGED
    assert flight.engine.counters["decision_failed"] == 0
