"""When the engine flies, holds and stops: the failsafe ladder with a vehicle under it, and decisions that fail."""

from __future__ import annotations

from typing import Any

import pytest

from ridlink.failsafe import State
from tests.daemon.emulated import LOITER, POSITION_MODE, Emulated, at
from tests.engine.flight import Flight, config


@pytest.mark.parametrize(("autopilot", "other_mode"), [(12, POSITION_MODE), (3, LOITER)])
def test_a_pilots_mode_change_ends_the_stream_and_its_return_does_not_renew_it(autopilot: int, other_mode: int) -> None:
    flight = Flight(Emulated(autopilot=autopilot))
    own_mode = flight.vehicle.mode
    flight.step(20)
    flight.vehicle.mode = other_mode
    before = len(flight.vehicle.observer.setpoints)
    flight.step(10)
    flight.vehicle.mode = own_mode
    flight.step(20)
    assert len(flight.vehicle.observer.setpoints) == before
    assert flight.engine.rung.state is State.STANDBY
    latitude, longitude, altitude = at(80.0)
    result = flight.command(
        "COMMAND_INT", command=192, frame=5, x=round(latitude * 1e7), y=round(longitude * 1e7), z=altitude
    )
    assert result == 0
    assert flight.engine.rung.state is State.ENGAGED
    assert flight.vehicle.observer.setpoints[-1].vx == 0.0
    flight.step(200)
    assert flight.vehicle.position[0] == pytest.approx(80.0, abs=1.0)


def test_px4_is_prepared_for_offboard_with_zero_velocity() -> None:
    flight = Flight()
    flight.vehicle.mode = POSITION_MODE
    flight.step(10)
    assert len(flight.vehicle.observer.setpoints) == 10
    assert {message.vx for message in flight.vehicle.observer.setpoints} == {0.0}
    flight.vehicle.armed = False
    flight.step(10)
    assert len(flight.vehicle.observer.setpoints) == 10
    waiting = Flight(Emulated(autopilot=3))
    waiting.vehicle.mode = LOITER
    waiting.step(10)
    assert waiting.vehicle.observer.setpoints == []


def test_an_automatic_take_off_is_not_disturbed() -> None:
    flight = Flight(Emulated(autopilot=3))
    flight.vehicle.landed_state = 3
    flight.step(20)
    assert flight.vehicle.observer.setpoints == []
    flight.vehicle.landed_state = 2
    assert flight.step().decision.state is State.ENGAGED


def test_f14_stale_own_state_holds_and_then_stops_on_purpose() -> None:
    flight = Flight()
    flight.step(20)
    flight.telling = False
    states = []
    for _ in range(70):
        flight.engine.receive_vehicle(flight.vehicle.heartbeat(), flight.now_s, source="autopilot")
        states.append(flight.step().decision.state)
    assert states[:9] == [State.ENGAGED] * 9
    assert set(states[11:48]) == {State.HOLD}
    assert set(states[52:]) == {State.STOPPED}
    held = flight.vehicle.observer.setpoints[32:]
    assert {(message.vx, message.vy, message.vz) for message in held} == {(0.0, 0.0, 0.0)}
    assert 65 <= len(flight.vehicle.observer.setpoints) <= 72
    flight.telling = True
    flight.step(10)
    assert flight.engine.rung.state is State.STOPPED


def test_f14_px4_that_never_has_a_position_in_offboard_is_left_to_its_own_failsafe() -> None:
    flight = Flight()
    flight.vehicle.fix_type = 1
    flight.vehicle.armed = False
    flight.step(80)
    assert flight.vehicle.observer.setpoints == []
    flight.vehicle.armed = True
    flight.step(80)
    assert flight.engine.rung.state is State.STOPPED
    assert len(flight.vehicle.observer.setpoints) == 51
    assert {(message.vx, message.vy, message.vz) for message in flight.vehicle.observer.setpoints} == {(0.0, 0.0, 0.0)}


def test_a_lost_fix_holds_although_positions_keep_coming() -> None:
    flight = Flight()
    flight.step(20)
    flight.vehicle.fix_type = 1
    flight.step(15)
    assert flight.engine.rung.state is State.HOLD
    flight.vehicle.fix_type = 3
    flight.step(2)
    assert flight.engine.rung.state is State.ENGAGED


def test_f15_a_silent_autopilot_ends_the_engagement() -> None:
    flight = Flight()
    flight.step(20)
    flight.telling = False
    flight.step(32)
    assert flight.engine.rung.state is State.STANDBY
    flight.telling = True
    flight.step(5)
    assert flight.engine.rung.state is State.STANDBY


@pytest.mark.parametrize("paused_s", [2.0, 5.0, 12.0])
def test_f17_a_pause_of_the_loop_holds_first_and_sends_no_burst(paused_s: float) -> None:
    flight = Flight()
    flight.step(20)
    before = len(flight.vehicle.observer.setpoints)
    flight.now_s += paused_s
    flight.telling = False  # the clock wakes a stopped process before its sockets are read
    output = flight.step()
    assert output.decision.state is State.HOLD and output.decision.commanded_ned_mps == (0.0, 0.0, 0.0)
    assert len(flight.vehicle.observer.setpoints) == before + 1
    flight.telling = True
    assert flight.step().decision.state is State.ENGAGED


def test_f15_an_autopilot_that_restarts_ends_the_engagement() -> None:
    flight = Flight()
    flight.step(30)
    restarted = flight.vehicle.position_messages(0.1)
    flight.engine.receive_vehicle(restarted, flight.now_s, source="autopilot")
    flight.step()
    assert flight.engine.rung.state is State.STANDBY
    assert "restarted" in flight.engine.rung.reason


def test_f28_stop_is_three_zero_setpoints_and_only_while_streaming() -> None:
    flight = Flight()
    assert flight.engine.stop(0.0) == []
    flight.step(20)
    frames = flight.engine.stop(flight.now_s)
    assert len(frames) == 3
    for frame in frames:
        (message,) = flight.vehicle.hear(frame)
        assert (message.vx, message.vy, message.vz) == (0.0, 0.0, 0.0)
    assert flight.engine.rung.reason == "ended: the vehicle is told to stop, and leaves OFFBOARD by its own failsafe"
    assert flight.engine.stop(flight.now_s) == []


@pytest.mark.parametrize(
    ("dry_run", "reason"), [(False, "ended: the vehicle is told to stop, and hovers in GUIDED"), (True, "ended")]
)
def test_f28_it_is_said_how_an_ardupilot_is_left(dry_run: bool, reason: str) -> None:
    flight = Flight(Emulated(autopilot=3), config(dry_run=dry_run))
    flight.step(20)
    flight.engine.stop(flight.now_s)
    assert flight.engine.rung.reason == reason


def test_f25_decisions_that_fail_become_zero_velocity_and_then_a_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    flight.step(20)

    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("no")

    monkeypatch.setattr(flight.engine.steering.decider.solver, "solve", broken)
    assert flight.step().decision.commanded_ned_mps == (0.0, 0.0, 0.0)
    assert not flight.engine.fatal
    flight.step(2)
    assert flight.engine.fatal
    assert flight.step().decision.state is State.HOLD
    assert flight.engine.last_error == "ZeroDivisionError: no"
    assert flight.engine.counters["decision_failed"] == 3


def test_rare_failures_are_not_fatal(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    flight.step(2)
    right = flight.engine.steering.decider.solver.solve
    for _ in range(4):
        monkeypatch.setattr(flight.engine.steering.decider.solver, "solve", lambda *_, **__: 1 / 0)
        flight.step()
        monkeypatch.setattr(flight.engine.steering.decider.solver, "solve", right)
        flight.step(10)
    assert flight.engine.counters["decision_failed"] == 4
    assert not flight.engine.fatal
