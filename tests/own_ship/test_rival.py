"""Several daemons on one vehicle, by mistake: exactly one of them flies, whatever the time between their starts."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.engine import Engine, EngineConfig, Goal
from ridlink.failsafe import OTHER_WRITER, State
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.own_ship.rival import FRESH_S, MOST, PATIENCE_S, WRAP, Rivals, claim_of, is_earlier
from tests.daemon.emulated import Emulated, at
from tests.daemon.invariants import Observer

STARTS_S = (0.0, 0.1, 1.0, 2.9)
UTC_S = 1_700_000_000.0
TICK_S = 0.02


class Copilots:
    """A vehicle with engines, each on a link of its own, in virtual time; heartbeats are passed on, or are not."""

    def __init__(self, autopilot: int, *starts_s: float, apart_s: float = 1e-4, passes_on: bool = True) -> None:
        self.vehicle = Emulated(autopilot=autopilot)
        # Each has a goal of its own: whoever wants the same cannot be seen in what the autopilot flies after.
        self.begins_s = (0.0, *starts_s)
        goals = ((300.0, 0.0), (0.0, 300.0), (-300.0, 0.0))[: len(self.begins_s)]
        self.engines = [Engine(EngineConfig(goal=Goal(*at(*goal)))) for goal in goals]
        self.observers = [Observer(target=1) for _ in goals]
        self.clocks_s = [apart_s * which for which in range(len(goals))]
        self.passes_on, self.tells_targets = passes_on, True
        self.tick = 0

    def fly(self, seconds: float) -> list[list[bool]]:
        """Who steered in every step."""
        steered = []
        for _ in range(round(seconds / TICK_S)):
            now_s = TICK_S * self.tick
            self.tick += 1
            told = self.vehicle.telemetry(now_s) + (self.vehicle.target_message(now_s) if self.tells_targets else b"")
            for engine, begins_s in zip(self.engines, self.begins_s, strict=True):
                if now_s >= begins_s:
                    engine.receive_vehicle(told, now_s, source="autopilot")
            if self.tick % 5:
                continue
            for which, engine in enumerate(self.engines):
                if now_s >= self.begins_s[which]:
                    self._step(which, engine, now_s)
            self.vehicle.advance(0.1)
            steered.append([self.steers(which) for which in range(len(self.engines))])
        return steered

    def _step(self, which: int, engine: Engine, now_s: float) -> None:
        for datagram in engine.step(now_s, utc_s=UTC_S + now_s + self.clocks_s[which]).to_vehicle:
            self.vehicle.hear(datagram, self.observers[which])
            heartbeats = [one for one in parse_datagram(datagram, CRC_EXTRAS) if isinstance(one, Frame)]
            for frame in heartbeats:
                for other, begins_s in zip(self.engines, self.begins_s, strict=True):
                    if frame.msgid == 0 and self.passes_on and now_s >= begins_s and other is not engine:
                        other.receive_vehicle(frame.raw, now_s, source="autopilot")

    def ask(self, which: int) -> None:
        """An operator's request to one of them, to fly back."""
        asked = Encoder(255, 190).encode(
            "COMMAND_INT", target_system=1, target_component=196, command=192, frame=5,
            param1=-1.0, x=round(at(0.0)[0] * 1e7), y=round(at(0.0)[1] * 1e7), z=self.vehicle._place()[2],
        )  # fmt: skip
        self.engines[which].receive_vehicle(asked, TICK_S * self.tick, source="autopilot")

    def steers(self, which: int) -> bool:
        return self.engines[which].rung.state is State.ENGAGED


@pytest.mark.no_cover
@pytest.mark.parametrize("autopilot", [12, 3], ids=["px4", "ardupilot"])
@pytest.mark.parametrize("start_s", STARTS_S)
def test_exactly_one_of_two_daemons_flies_and_it_is_the_first(start_s: float, autopilot: int) -> None:
    both = Copilots(autopilot, start_s)
    steered = both.fly(12.0)
    began = next(step for step, who in enumerate(steered) if any(who))
    assert all(first for first, _ in steered[began:]), "the first one is never disturbed"
    assert sum(second for _, second in steered) <= 2, "the second gives way at once"
    assert both.engines[1].rung.reason == OTHER_WRITER
    assert float(both.vehicle.position[0]) > 50.0 and abs(float(both.vehicle.position[1])) < 1.0


@pytest.mark.no_cover
@pytest.mark.parametrize("clock_s", [-3600.0, -1.0, 1.0, 3600.0])
def test_one_flies_even_if_the_clocks_of_their_computers_disagree(clock_s: float) -> None:
    steered = Copilots(12, 1.0, apart_s=clock_s).fly(12.0)
    assert {sum(who) for who in steered[30:]} == {1}


def test_the_one_that_stood_by_flies_after_another_request_when_the_first_is_gone() -> None:
    both = Copilots(12, 0.1)
    both.fly(5.0)
    both.begins_s = (math.inf, 0.0)
    both.fly(FRESH_S + 1.0)
    assert both.engines[1].rung.state is State.STANDBY
    both.ask(1)
    both.fly(2.0)
    assert both.steers(1)


@pytest.mark.no_cover
def test_a_third_that_is_asked_stands_by_whenever_that_is_while_the_second_does() -> None:
    """Heartbeats of the second, which steers nothing, say nothing of the first; nobody says what is flown after."""
    three = Copilots(12, 1.0, 2.3)
    three.tells_targets = False
    three.fly(4.0)
    for _ in range(10):
        three.ask(2)
        assert [who for who in three.fly(1.1) if who != [True, False, False]] == []


def test_claims_of_nobody_of_this_vehicle_stop_nothing() -> None:
    one = Copilots(12, math.inf)
    one.fly(3.0)
    claim = {"type": 18, "autopilot": 8, "custom_mode": 1}
    for sysid, compid, source in ((2, 196, "autopilot"), (1, 191, "autopilot"), (1, 196, "elsewhere")):
        one.engines[0].receive_vehicle(Encoder(sysid, compid).encode("HEARTBEAT", **claim), 3.0, source=source)
    assert all(first for first, _ in one.fly(2.0))


claims = st.integers(1, WRAP - 1)


@given(claims, st.integers(1, WRAP // 2 - 1))
def test_of_two_claims_one_is_earlier_and_both_sides_agree(one: int, later: int) -> None:
    other = (one + later) % WRAP
    assert is_earlier(one, other) and not is_earlier(other, one) and not is_earlier(one, one)


@given(st.floats(0.0, 4e9), st.floats(1e-4, 60_000.0))
def test_claims_order_engagements_up_to_half_a_day_apart(utc_s: float, after_s: float) -> None:
    assert is_earlier(claim_of(utc_s), claim_of(utc_s + after_s))


def test_a_later_claim_that_is_not_given_up_is_not_waited_for_without_end() -> None:
    ours = Rivals()
    ours.steer(True, UTC_S)
    theirs = claim_of(UTC_S + 1.0)
    for second in range(20):
        ours.hear(theirs, float(second))
        assert not ours.must_yield(float(second))
        assert ours.gives_way(float(second)) is (second <= PATIENCE_S)
    ours.hear(0, 20.0)
    assert not ours.gives_way(20.5) and not ours.must_yield(20.0)
    ours.steer(False, UTC_S)
    ours.hear(theirs, 30.0)
    ours.hear(0, 30.0)
    assert ours.must_yield(30.0) and not ours.gives_way(30.0)
    assert not ours.must_yield(30.1 + FRESH_S)


def test_the_earliest_of_many_claims_counts_and_a_flood_of_them_is_not_kept() -> None:
    ours = Rivals()
    ours.steer(True, UTC_S)
    ours.hear(claim_of(UTC_S - 1.0), 0.0)
    for k in range(1, 100):
        ours.hear(claim_of(UTC_S + k), 0.1)
        assert ours.must_yield(0.1) and ours.gives_way(0.1)
    assert len(ours._theirs) == MOST


def test_ones_own_claim_come_back_is_no_rival() -> None:
    ours = Rivals()
    ours.steer(True, UTC_S)
    ours.hear(ours.claim, 0.1)
    assert not ours.answer and not ours.must_yield(0.1) and not ours.gives_way(0.1)
