"""F11, F13, F17, F20 and the invariants I4 to I7 in virtual time, over encoded bytes."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance.types import Status
from ridlink.engine import Engine, EngineConfig
from ridlink.failsafe import State
from ridlink.traffic.picture import TrafficPicture
from tests.daemon.emulated import Emulated
from tests.engine.flight import STEP_S, Flight, config
from tests.traffic.reports import OWN, SETTINGS, report

MAC_RADIUS_M = 0.6


def test_f11_after_a_conflict_the_way_back_is_slow_and_the_way_out_is_not() -> None:
    flight = Flight()
    intruder = Emulated(9, ned_m=(150.0, 1.0, -50.0))
    intruder.velocity[:] = (-8.0, 0.0, 0.0)

    def tell(now_s: float) -> bytes:
        intruder.advance(STEP_S)
        return intruder.remote_id(now_s)

    flight.others.append(tell)
    flight.step(250)
    steps = list(zip(flight.outputs, flight.outputs[1:], strict=False))
    ends = [
        k
        for k, (a, b) in enumerate(steps)
        if a.decision.status is not Status.FREE and b.decision.status is Status.FREE and a.decision.status is not None
    ]
    assert ends, "there was a conflict"
    after = steps[ends[-1] + 1 : ends[-1] + 19]
    assert all(output.decision.recovering for _, output in after)
    back = [
        (change(a.decision.commanded_ned_mps, b.decision.commanded_ned_mps), b.decision.status)
        for a, b in after
        if speed(b.decision.commanded_ned_mps) >= speed(a.decision.commanded_ned_mps)
    ]
    assert back and max(change for change, status in back if status is Status.FREE) <= 0.25 + 1e-6
    out = [change(a.decision.commanded_ned_mps, b.decision.commanded_ned_mps) for a, b in steps[: ends[0]]]
    assert max(out) > 0.45, "towards safety the whole acceleration counts"
    assert not flight.outputs[ends[-1] + 25].decision.recovering


def change(a: tuple[float, ...] | None, b: tuple[float, ...] | None) -> float:
    assert a is not None and b is not None
    return math.hypot(b[0] - a[0], b[1] - a[1])


def speed(velocity: tuple[float, ...] | None) -> float:
    assert velocity is not None
    return math.hypot(*velocity[:2])


@pytest.mark.no_cover
@pytest.mark.parametrize("count", [12, 60])
def test_f13_ghosts_all_around_end_in_a_bounded_velocity_that_does_not_oscillate(count: int) -> None:
    flight = Flight()
    ghosts = [
        Emulated(10 + k, ned_m=(25.0 * math.cos(a), 25.0 * math.sin(a), -50.0))
        for k, a in enumerate(2.0 * math.pi * np.arange(count) / count)
    ]
    flight.step(20)
    for ghost in ghosts:
        ghost.position = ghost.position + flight.vehicle.position + (0.0, 0.0, 50.0)
        ghost.velocity[:] = -(ghost.position - flight.vehicle.position) * 0.05
    flight.others += [lambda now_s, ghost=ghost: ghost.remote_id(now_s) for ghost in ghosts]  # type: ignore[misc]
    flight.step(100)
    outputs = flight.outputs[-90:]
    assert all(output.decision.state is State.ENGAGED for output in outputs)
    commands = np.array([output.decision.commanded_ned_mps for output in outputs])
    assert np.isfinite(commands).all()
    for axis in (0, 1):
        signs = np.sign(np.where(np.abs(commands[:, axis]) < 0.5, 0.0, commands[:, axis]))
        signs = signs[signs != 0.0]
        assert np.count_nonzero(np.diff(signs)) <= 9, "more than one change of sign per second"


class Air:
    """A bad one: loss, bursts, duplicates, late and reordered datagrams."""

    def __init__(self, rng: random.Random, loss: float, burst: float) -> None:
        self._rng, self._loss, self._stay = rng, loss, 1.0 - 1.0 / burst
        self._bad = False
        self._under_way: list[tuple[float, bytes]] = []

    def carry(self, datagram: bytes, now_s: float) -> list[bytes]:
        rng = self._rng
        to_bad = self._loss * (1.0 - self._stay) / (1.0 - self._loss)
        self._bad = rng.random() < (self._stay if self._bad else to_bad)
        if not self._bad:
            for _ in range(2 if rng.random() < 0.05 else 1):
                self._under_way.append((now_s + max(rng.gauss(0.1, 0.05), 0.0), datagram))
        arrived = [each for each in self._under_way if each[0] <= now_s]
        self._under_way = [each for each in self._under_way if each[0] > now_s]
        return [data for _, data in sorted(arrived)]


@pytest.mark.no_cover
@pytest.mark.parametrize("seed", range(6))
def test_f20_head_on_through_a_bad_air_nobody_collides(seed: int) -> None:
    rng = random.Random(seed)
    vehicles = [Emulated(1, ned_m=(-150.0, rng.uniform(-3, 3), -50.0)), Emulated(2, ned_m=(150.0, 0.0, -50.0))]
    engines = [Engine(config(150.0)), Engine(config(-150.0, vehicle_sysid=2))]
    airs = [Air(rng, 0.3, 5.0), Air(rng, 0.3, 5.0)]
    nearest, now_s = math.inf, 0.0
    for _ in range(450):
        for k in (0, 1):
            own, other = vehicles[k], vehicles[1 - k]
            engines[k].receive_vehicle(own.telemetry(now_s), now_s, source="a")
            noise = np.array([rng.gauss(0, 1), rng.gauss(0, 1), 0.0])
            other.position += noise
            heard = airs[k].carry(other.remote_id(now_s), now_s)
            other.position -= noise
            for datagram in heard:
                engines[k].receive_remote_id(datagram, now_s, source="air", utc_s=now_s)
        for engine, vehicle in zip(engines, vehicles, strict=True):
            for frame in engine.step(now_s).to_vehicle:
                vehicle.hear(frame)
            vehicle.advance(STEP_S)
        nearest = min(nearest, float(np.hypot(*(vehicles[0].position - vehicles[1].position)[:2])))
        now_s += STEP_S
    assert nearest > MAC_RADIUS_M + 4.0, f"seed {seed}: {nearest:.1f} m"
    assert all(abs(vehicle.position[0]) > 120.0 for vehicle in vehicles), "both arrived"
    assert sum(engine.counters["report_repeated"] for engine in engines) > 0


def test_f17_a_clock_that_comes_round_after_fifty_days_is_no_restart() -> None:
    flight = Flight()
    flight.now_s = 2**32 / 1e3 - 3.0
    flight.step(20)
    assert flight.engine.rung.state is State.ENGAGED
    before = len(flight.vehicle.observer.setpoints)
    flight.step(20)
    assert flight.engine.rung.reason == "avoiding"
    assert len(flight.vehicle.observer.setpoints) == before + 20
    assert all(setpoint.vx > 0.0 for setpoint in flight.vehicle.observer.setpoints[before:])
    assert not flight.engine.counters.keys() & {"autopilot_restart", "own_position_delayed", "own_position_jump"}


def test_f17_after_a_stop_of_five_seconds_what_waited_in_the_socket_is_no_own_state() -> None:
    flight = Flight()
    flight.step(30)
    flight.telling = False
    waiting = []
    for _ in range(50):
        waiting.append(flight.vehicle.telemetry(flight.now_s))
        flight.vehicle.advance(STEP_S)
        flight.now_s += STEP_S
    for datagram in waiting[:20]:  # as many as one turn of the loop reads
        flight.engine.receive_vehicle(datagram, flight.now_s, source="autopilot")
    for _ in range(2):  # the first one would hold after a pause in any case
        output = flight.step()
        assert output.decision.state is not State.ENGAGED
        assert output.decision.commanded_ned_mps in (None, (0.0, 0.0, 0.0))
    assert flight.engine.counters["own_position_delayed"] > 0


# --- invariants -------------------------------------------------------------------------------------------------------


def radius(made: TrafficPicture, now_s: float = 10.0) -> float:
    engine = Engine(EngineConfig())
    snapshot = made.snapshot(OWN, now_s)
    traffic, _ = engine.steering.decider.traffic(OWN, snapshot)
    return float(traffic.radius_m[0])


def disc(now_s: float = 10.0, **fields: object) -> float:
    made = TrafficPicture(SETTINGS)
    made.snapshot(OWN, 10.0)
    made.receive("rid", report(**fields))
    return radius(made, now_s)


@given(st.floats(0.0, 60.0), st.floats(0.0, 60.0))
def test_i4_the_disc_never_shrinks_with_age(age: float, more: float) -> None:
    assert disc(10.0 + age + more) >= disc(10.0 + age)
    assert math.isfinite(disc(10.0 + age + more))


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("horizontal_error_m", (0.01, 3.0, 39.0, None)),
        ("airframe_size_m", (0.05, 0.6, 7.5, None)),
        ("speed_horizontal_mps", (0.0, 5.0, 30.7, None)),
        ("update_interval_s", (0.02, 0.1, 0.5, 1.0, 60.0, None)),
        ("horizontal_error_m", (0.01, 100.0, 185.0, 655.35)),
        ("airframe_size_m", (0.6, 20.0, 30.0, 655.35)),
    ],
)
def test_i4_the_disc_grows_with_every_figure_and_unknown_is_the_worst_of_the_standard(
    field: str, values: tuple[float | None, ...]
) -> None:
    discs = [disc(**{field: value, "velocity_ned_mps": None, "accuracy_bound_m": None}) for value in values]
    assert discs == sorted(discs)
    assert discs[0] >= MAC_RADIUS_M


def fingerprint(engine: Engine) -> object:
    telemetry = engine.telemetry
    return (
        engine.config, engine.goal, engine.rung, telemetry.lock, telemetry.armed, telemetry.external_mode,
        telemetry.state(2.0), engine.encoder.sysid, engine.encoder.compid, engine._hearing.names.uas_id,
    )  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=6), st.integers(0, 2**32 - 1))
def test_i5_no_bytes_of_the_air_change_own_state_goal_targets_or_identity(junk: list[bytes], seed: int) -> None:
    engine, rng = Engine(config()), random.Random(seed)
    vehicle, other = Emulated(1), Emulated(rng.choice([1, 2, 200]))
    engine.receive_vehicle(vehicle.telemetry(2.0), 2.0, source="a")
    engine.step(2.0)
    before = fingerprint(engine)
    forged: list[Callable[[], bytes]] = [
        other.heartbeat, lambda: other.telemetry(2.0), lambda: other.remote_id(2.0),
        lambda: other.encoder.encode("COMMAND_LONG", command=192, target_system=1, target_component=196, param5=47.0),
        lambda: other.encoder.encode("OPEN_DRONE_ID_BASIC_ID", uas_id=b"OURS", id_type=1),
        lambda: other.encoder.encode("POSITION_TARGET_LOCAL_NED", vx=9.0),
    ]  # fmt: skip
    for datagram in junk:
        data = bytearray(rng.choice(forged)() + datagram)
        if rng.random() < 0.5:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        engine.receive_remote_id(bytes(data), 2.0, source="air", utc_s=2.0)
    assert fingerprint(engine) == before


def test_i6_i7_a_flood_is_bounded_and_every_datagram_is_accounted_for() -> None:
    flight = Flight()
    flight.step(3)
    sent = 0
    for k in range(3000):
        ghost = Emulated(50, ned_m=(400.0 + k % 50, 0.0, -50.0))
        flight.engine.receive_remote_id(
            ghost.remote_id(1.0, extended=False, id_or_mac=b"g%d" % k), flight.now_s + k / 400.0, source="air"
        )
        sent += 1
    counters = flight.engine.counters
    refused = counters["newcomer_refused"] + counters["track_refused"] + counters["track_evicted"]
    assert len(flight.engine.picture) <= 2000
    assert len(flight.engine.picture) + refused == sent == flight.engine.summary().reports_received


def test_f12_a_picture_that_is_full_of_those_who_are_nearer_is_said() -> None:
    flight = Flight()
    flight.step(3)
    near = [Emulated(50, ned_m=(60.0, 10.0, -50.0)).remote_id(0.3, id_or_mac=b"g%d" % k) for k in range(2000)]
    for k, datagram in enumerate(near):
        flight.engine.receive_remote_id(datagram, flight.now_s, source=f"source {k % 5}")
    assert not any("flood" in text for text in flight.step().warnings) and len(flight.engine.picture) == 2000
    far = Emulated(9, ned_m=(400.0, 0.0, -50.0))
    flight.others = [lambda now_s: far.remote_id(now_s)]
    flight.step(11)
    assert flight.engine.counters["track_refused"] > 0 and not flight.engine.counters["track_evicted"]
    assert [text for output in flight.outputs for text in output.warnings if "flood" in text]
