"""What the engine tells of itself, to whom and how often."""

from __future__ import annotations

import numpy as np
import pytest

from ridlink.engine import Engine
from ridlink.failsafe import State
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.own_ship.requests import steers
from ridlink.periodic import Periodic
from tests.daemon.emulated import Emulated
from tests.daemon.invariants import messages
from tests.engine.flight import STEP_S, Flight, config, intruder, reposition


class Stubborn(Emulated):
    """Flies on as it does, whatever it is told: its conflicts last."""

    def hear(self, data: bytes) -> list[Message]:
        found = self.observer.watch(data)
        self.heard += found
        return found


def test_conflicts_are_announced_once_a_second_and_status_tells_the_rest() -> None:
    flight = Flight(Stubborn(ned_m=(-100.0, 0.0, -50.0)), config(200.0))
    flight.vehicle.velocity = np.array((5.0, 0.0, 0.0))
    other = intruder(-20.0, 0.0, (-10.0, 0.0, 0.0))
    flight.others.append(lambda now_s: other.remote_id(now_s) + (other.advance(STEP_S) or b""))
    flight.step(60)
    collisions = flight.heard("COLLISION")
    assert 2 <= len(collisions) <= 6
    assert {message.id for message in collisions} == {9}
    assert {message.src for message in collisions} == {1}
    assert all(message.horizontal_minimum_delta < 60.0 for message in collisions)
    statuses = flight.heard("RIDLINK_STATUS")
    assert len(statuses) == 6
    assert {message.tracks for message in statuses[1:]} == {1}
    assert any(message.conflicts == 1 for message in statuses)
    assert any(message.binding_systems[0] == 9 for message in statuses)
    assert all(message.state == State.ENGAGED for message in statuses[1:])
    assert any(message.nearest_margin < 10_000 for message in statuses)


def test_no_more_than_eight_conflicts_are_announced_within_a_second_however_they_change() -> None:
    flight = Flight(Stubborn(), config(200.0))
    flight.vehicle.velocity = np.array((5.0, 0.0, 0.0))
    for k in range(25):
        # Eight more in every step, each time nearer than all before: the most urgent are always new.
        north_m = float(flight.vehicle.position[0]) + 45.0 - k
        ghosts = [intruder(north_m, 0.1 * j, (0.0, 0.0, 0.0)) for j in range(8)]
        flight.others = [
            lambda now_s, ghost=ghost, name=b"%d-%d" % (k, j): ghost.remote_id(now_s, id_or_mac=name)  # type: ignore[misc]
            for j, ghost in enumerate(ghosts)
        ]
        flight.step()
    told = [sum(m.name == "COLLISION" for f in o.to_vehicle for m in messages(f)) for o in flight.outputs]
    assert max(sum(told[k : k + 10]) for k in range(16)) == 8
    assert sum(told) == 24, "and in the next second others"


def test_relayed_traffic_in_conflict_is_named_by_a_checksum_of_its_id() -> None:
    flight = Flight(Emulated(ned_m=(-100.0, 0.0, -50.0)), config(200.0))
    other = intruder(-40.0, 0.0, (-10.0, 0.0, 0.0))
    receiver = Encoder(1, 236)

    def relay(now_s: float) -> bytes:
        other.encoder = receiver
        flight.engine.receive_vehicle(other.remote_id(now_s, id_or_mac=b"FA-07"), now_s, source="autopilot")
        return b""

    flight.others.append(relay)
    flight.step(10)
    assert len(flight.engine.picture) == 1
    assert flight.heard("COLLISION")[0].id > 255


def test_heartbeats_go_to_the_vehicle_and_to_the_air() -> None:
    flight = Flight(Emulated(7))
    flight.step(30)
    (beat, *_) = beats = flight.heard("HEARTBEAT")
    assert len(beats) == 3
    assert (beat.type, beat.autopilot) == (18, 8)
    to_air = [frame for output in flight.outputs for frame in output.to_air]
    assert len(to_air) == 3
    assert (to_air[-1][5], to_air[-1][6]) == (7, 196)


@pytest.mark.parametrize(("dry_run", "apart"), [(False, False), (True, False), (False, True)])
def test_each_link_counts_its_own_messages_so_that_nobody_sees_a_loss(dry_run: bool, apart: bool) -> None:
    flight = Flight(Emulated(autopilot=3), config(broadcast=True, broadcast_apart=apart, dry_run=dry_run))
    flight.step(10)
    assert flight.command("COMMAND_INT", **reposition()) == 0
    flight.step(60)
    to_vehicle, to_air, to_transmitter = b"", b"", b""
    for output in flight.outputs:
        leaving = [frame for frame in output.to_vehicle if not (dry_run and steers(frame))]
        to_vehicle += b"".join((*leaving, *(answer for answer, _ in output.replies)))
        to_air += b"".join((*output.to_air, *(() if apart else output.broadcasts)))
        to_transmitter += b"".join((*output.to_transmitter, *(output.broadcasts if apart else ())))
    links = {to_vehicle: 15, to_air: 6 if apart else 15, to_transmitter: 15 if apart else 0}
    for sent, least in links.items():
        numbers = [frame.seq for frame in parse_datagram(sent, CRC_EXTRAS, limit=None) if isinstance(frame, Frame)]
        assert numbers == list(range(len(numbers))) and len(numbers) >= least
    assert bool(to_transmitter) is apart


def test_before_an_autopilot_is_heard_the_air_is_left_alone() -> None:
    engine = Engine(config())
    output = engine.step(0.0)
    assert output.to_air == []
    assert [message.name for message in messages(b"".join(output.to_vehicle))] == ["HEARTBEAT"]
    pinned = Engine(config(vehicle_sysid=12))
    assert len(pinned.step(0.0).to_air) == 1


def test_messages_are_requested_from_an_ardupilot_that_sends_none() -> None:
    flight = Flight(Emulated(autopilot=3))
    flight.telling = False
    for _ in range(25):
        flight.engine.receive_vehicle(flight.vehicle.heartbeat(), flight.now_s, source="autopilot")
        flight.step()
    requests = flight.heard("COMMAND_LONG")
    assert [message.param1 for message in requests] == [33, 24, 85, 193, 245] * 3
    assert {(message.command, message.target_system, message.target_component) for message in requests} == {(511, 1, 1)}
    flight.telling = True
    flight.vehicle.heard.clear()
    flight.step(20)
    assert flight.heard("COMMAND_LONG") == []
    assert flight.engine.rung.state is State.ENGAGED


def test_positions_that_a_ground_station_has_slowed_down_are_asked_for_again() -> None:
    flight, slow = Flight(Emulated(autopilot=3)), True
    told, due = flight.vehicle.telemetry, Periodic(0.5)
    flight.vehicle.telemetry = lambda now_s: told(now_s) if due.due(now_s) or not slow else b""  # type: ignore[method-assign]
    flight.step(30)
    assert {(asked.param1, asked.param2) for asked in flight.heard("COMMAND_LONG")} == {(33.0, 50_000.0)}
    slow = False
    flight.vehicle.heard.clear()
    flight.step(100)
    assert flight.heard("COMMAND_LONG") == []


def test_an_autopilot_that_tells_no_more_whether_it_stands_or_flies_is_asked_again() -> None:
    flight = Flight(Emulated(autopilot=3))
    flight.step(20)
    assert flight.heard("COMMAND_LONG") == []
    flight.vehicle.landed_state = None
    flight.step(60)
    assert [message.param1 for message in flight.heard("COMMAND_LONG")] == [85, 193, 245]


@pytest.mark.parametrize("autopilot", [3, 12])
def test_targets_that_are_told_in_the_rhythm_of_setpoints_are_asked_for_in_another_one(autopilot: int) -> None:
    flight, every = Flight(Emulated(autopilot=autopilot)), 1
    told = flight.vehicle.telemetry
    flight.vehicle.telemetry = lambda now_s: told(now_s) + flight.vehicle.target_message(now_s) * every  # type: ignore[method-assign]
    flight.step(40)
    assert {(asked.param1, asked.param2) for asked in flight.heard("COMMAND_LONG")} == {(85.0, 70_000.0)}
    count, every = len(flight.heard("COMMAND_LONG")), 2
    assert count == 1
    flight.step(100)
    assert len(flight.heard("COMMAND_LONG")) == count


def test_what_lasts_is_told_every_ten_seconds_and_what_is_over_not_once_more() -> None:
    flight, told_s = Flight(), []
    for step in range(500):
        lasts = 10 <= step < 25 or 200 <= step < 330
        flight.engine._counters["decision_failed"] += lasts
        told_s += [step // 10 for text in flight.step().warnings if text == "a decision failed"]
    assert told_s == [1, 20, 30]


def test_a_dry_run_takes_nobody_for_another_writer_because_its_own_setpoints_are_not_flown() -> None:
    flight = Flight(Stubborn(), config(200.0, dry_run=True))
    warned = []
    for steered_mps in (None, 4.0):
        for step in range(40):
            target_mps = 0.0 if steered_mps is None else steered_mps + 0.1 * step
            target = flight.vehicle.encoder.encode("POSITION_TARGET_LOCAL_NED", type_mask=0x0DC7, vx=target_mps)
            flight.engine.receive_vehicle(target, flight.now_s, source="autopilot")
            flight.step()
        warned.append(flight.engine.counters["other_writer"] > 0)
    assert warned == [False, True]  # a hover that is not ours, then a velocity that changes
