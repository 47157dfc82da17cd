"""The ladder: when the stream begins, holds and ends, and that nothing but an operator begins it again."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.failsafe import Conditions, FailsafeSettings, Rung, State, Stream, advance, request

FLYING = Conditions(
    autopilot_heard_s=0.3,
    own_state_age_s=0.05,
    armed=True,
    external_mode=True,
    wants_stream=True,
    latitude_deg=47.0,
    since_last_step_s=0.1,
    has_goal=True,
)
ASKED = request(Rung())


def climb(rung: Rung, *steps: Conditions) -> Rung:
    for seen in steps:
        rung = advance(rung, seen)
    return rung


ENGAGED = climb(ASKED, FLYING, FLYING)


def test_an_operators_request_engages_and_the_first_setpoint_is_zero() -> None:
    first = climb(ASKED, FLYING)
    assert (first.state, first.stream) == (State.ENGAGED, Stream.ZERO)
    second = climb(first, FLYING)
    assert (second.state, second.stream) == (State.ENGAGED, Stream.DECISION)
    assert first.requested and second.requested


def test_nothing_engages_unasked() -> None:
    rung = climb(Rung(), FLYING, FLYING)
    assert (rung.state, rung.stream) == (State.STANDBY, Stream.NOTHING)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"autopilot_heard_s": math.inf}, "autopilot"),
        ({"has_goal": False}, "goal"),
        ({"goal_away_m": 300_001.0}, "waiting for another goal: this one is more than 300 km away"),
        ({"goal_away_m": math.nan}, "more than 300 km"),
        ({"armed": False}, "armed"),
        ({"external_mode": False}, "OFFBOARD"),
        ({"ready": False}, "take-off"),
        ({"own_state_age_s": math.inf}, "own state"),
        ({"latitude_deg": 85.1}, "latitude"),
        ({"latitude_deg": math.nan}, "latitude"),
        ({"since_last_step_s": 0.6}, "paused"),
        ({"stalled": True}, "paused"),
        ({"own_jumped": True}, "jumped"),
        ({"on_ground": True}, "ground"),
        ({"warming": True}, "kernels"),
        ({"deciding_fails": True}, "decisions"),
    ],
)
def test_what_an_engagement_waits_for(change: dict[str, object], reason: str) -> None:
    rung = climb(ASKED, replace(FLYING, **change))
    assert rung.state is State.STANDBY
    assert reason in rung.reason
    assert rung.requested
    assert climb(rung, FLYING).state is State.ENGAGED


def test_px4_gets_a_stream_while_it_waits_armed_and_ardupilot_does_not() -> None:
    waiting = replace(FLYING, external_mode=False)
    assert climb(ASKED, waiting).stream is Stream.ZERO
    assert climb(ASKED, replace(waiting, wants_stream=False)).stream is Stream.NOTHING
    assert climb(ASKED, replace(waiting, armed=False)).stream is Stream.NOTHING


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"external_mode": False}, "left GUIDED or OFFBOARD"),
        ({"armed": False}, "disarmed"),
        ({"autopilot_heard_s": 3.1}, "heartbeat"),
        ({"rebooted": True}, "restarted"),
        ({"other_writer": True}, "another writer"),
        ({"unheard": True}, "does not obey"),
    ],
)
def test_what_ends_an_engagement_is_not_undone_by_its_return(change: dict[str, object], reason: str) -> None:
    ended = climb(ENGAGED, replace(FLYING, **change))
    assert (ended.state, ended.stream) == (State.STANDBY, Stream.NOTHING)
    assert reason in ended.reason
    again = climb(ended, FLYING, FLYING, FLYING)
    assert (again.state, again.stream) == (State.STANDBY, Stream.NOTHING)
    assert reason in again.reason
    assert climb(request(again), FLYING).state is State.ENGAGED


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"own_state_age_s": 1.1}, "own state is stale: no position to trust for 1 s"),
        ({"own_state_age_s": 5.1}, "own state lost for 5 s: the autopilot's own failsafe takes over"),
        ({"autopilot_heard_s": 3.1}, "no heartbeat of the autopilot for 3 s, it was armed"),
        ({"autopilot_heard_s": 3.1, "on_ground": True},
         "no heartbeat of the autopilot for 3 s, it was armed, on the ground"),
        ({"armed": False}, "disarmed"),
        ({"armed": False, "on_ground": True}, "disarmed, on the ground"),
    ],
)  # fmt: skip
def test_who_asks_where_the_vehicle_is_is_told_what_it_said_last(change: dict[str, object], reason: str) -> None:
    assert climb(ENGAGED, replace(FLYING, **change)).reason == reason


@pytest.mark.parametrize(
    "change",
    [
        {"own_state_age_s": 1.1},
        {"since_last_step_s": 0.6},
        {"latitude_deg": -85.5},
        {"goal_away_m": 300_001.0},
        {"goal_away_m": math.nan},
        {"deciding_fails": True},
        {"stalled": True},
        {"own_jumped": True},
        {"on_ground": True},
    ],
)
def test_doubt_holds_and_goes_by(change: dict[str, object]) -> None:
    held = climb(ENGAGED, replace(FLYING, **change))
    assert (held.state, held.stream, held.requested) == (State.HOLD, Stream.ZERO, True)
    back = climb(held, FLYING)
    assert (back.state, back.stream) == (State.ENGAGED, Stream.DECISION)


@pytest.mark.parametrize("slept_s", [3.5, 6.0, 60.0])
def test_f17_a_loop_that_slept_holds_before_it_calls_the_autopilot_silent(slept_s: float) -> None:
    unread = replace(FLYING, since_last_step_s=slept_s, autopilot_heard_s=slept_s + 0.5, own_state_age_s=slept_s)
    held = climb(ENGAGED, unread)
    assert (held.state, held.stream, held.reason) == (State.HOLD, Stream.ZERO, "the loop paused")
    assert climb(held, FLYING).state is State.ENGAGED
    silent = replace(unread, since_last_step_s=0.1)  # the sockets have been read, and there was nothing
    assert climb(held, silent).stream is Stream.NOTHING
    assert climb(ENGAGED, replace(unread, external_mode=False)).stream is Stream.NOTHING


def test_f17_silence_from_before_the_sleep_counts() -> None:
    slept = replace(FLYING, since_last_step_s=2.0)
    assert climb(ENGAGED, replace(slept, autopilot_heard_s=5.1)).state is State.STANDBY
    assert climb(ENGAGED, replace(slept, own_state_age_s=7.1)).state is State.STOPPED
    # Nor is any step longer than it was: 0.3 s is no sleep.
    assert climb(ENGAGED, replace(FLYING, since_last_step_s=0.3, autopilot_heard_s=3.1)).state is State.STANDBY


def test_lasting_doubt_stops_the_stream_for_good() -> None:
    held = climb(ENGAGED, replace(FLYING, own_state_age_s=4.9))
    assert held.state is State.HOLD
    stopped = climb(held, replace(FLYING, own_state_age_s=5.1))
    assert (stopped.state, stopped.stream) == (State.STOPPED, Stream.NOTHING)
    still = climb(stopped, FLYING, FLYING)
    assert (still.state, still.stream) == (State.STOPPED, Stream.NOTHING)
    assert climb(still, replace(FLYING, armed=False)).state is State.STANDBY
    assert climb(request(still), FLYING).state is State.ENGAGED


NEVER_PLACED = replace(FLYING, own_state_age_s=math.inf, obeying_s=5.1)


def test_f14_px4_that_waits_in_offboard_without_a_position_is_not_hovered_for_ever() -> None:
    waiting = climb(ASKED, replace(NEVER_PLACED, obeying_s=5.0))
    assert (waiting.state, waiting.stream, waiting.requested) == (State.STANDBY, Stream.ZERO, True)
    stopped = climb(waiting, NEVER_PLACED)
    assert (stopped.state, stopped.stream, stopped.requested) == (State.STOPPED, Stream.NOTHING, False)
    assert stopped.reason == "own state lost for 5 s: the autopilot's own failsafe takes over"
    # PX4 takes a stream that resumes for a wish to be in OFFBOARD again.
    left = climb(stopped, replace(NEVER_PLACED, external_mode=False, obeying_s=0.0), FLYING)
    assert left.stream is Stream.NOTHING
    assert climb(request(left), FLYING).state is State.ENGAGED


@pytest.mark.parametrize(
    "change",
    [
        {"own_state_age_s": 5.0},  # it may come back yet
        {"own_state_age_s": 0.1, "warming": True},  # it is no position that is missing
        {"since_last_step_s": 0.5},  # what was said meanwhile has not been read
        {"external_mode": False},  # PX4 ignores it there, and wants it
    ],
)
def test_f14_who_waits_for_something_else_is_streamed_to(change: dict[str, object]) -> None:
    rung = climb(ASKED, replace(NEVER_PLACED, **change))
    assert (rung.state, rung.stream, rung.requested) == (State.STANDBY, Stream.ZERO, True)


def test_f14_ardupilot_without_a_position_is_waited_for_in_silence() -> None:
    rung = climb(ASKED, replace(NEVER_PLACED, wants_stream=False))
    assert (rung.state, rung.stream, rung.requested) == (State.STANDBY, Stream.NOTHING, True)


def test_who_finds_another_writer_before_it_begins_stands_by_until_asked_again() -> None:
    rung = climb(ASKED, replace(FLYING, other_writer=True))
    assert (rung.state, rung.stream, rung.requested) == (State.STANDBY, Stream.NOTHING, False)
    assert climb(rung, FLYING).stream is Stream.NOTHING
    # Outside its mode a vehicle obeys nobody: what was seen of others says nothing.
    assert climb(ASKED, replace(FLYING, other_writer=True, external_mode=False)).requested


def test_a_request_while_engaged_changes_nothing_of_the_stream() -> None:
    assert request(ENGAGED) == ENGAGED


def test_every_way_out_of_engaged_with_nan_ages_is_safe() -> None:
    rung = climb(ENGAGED, replace(FLYING, own_state_age_s=math.nan))
    assert rung.stream is not Stream.DECISION


SWITCHES = [field.name for field in fields(Conditions) if isinstance(getattr(FLYING, field.name), bool)]
CHANGES: dict[str, list[object]] = {
    "autopilot_heard_s": [3.1],
    "own_state_age_s": [1.1, 5.1],
    "obeying_s": [5.1],
    "latitude_deg": [86.0],
    "since_last_step_s": [0.6],
    **{name: [not getattr(FLYING, name)] for name in SWITCHES},
}
conditions = (
    st.lists(st.sampled_from(sorted(CHANGES)), max_size=2, unique=True)
    .flatmap(lambda names: st.fixed_dictionaries({name: st.sampled_from(CHANGES[name]) for name in names}))
    .map(lambda changes: replace(FLYING, **changes))
)
"""A flight with little wrong at a time: where everything may be wrong at once something is, and nobody steers."""


@settings(max_examples=500)
@given(st.lists(st.tuples(conditions, st.booleans()), max_size=12), st.sampled_from([Rung(), ENGAGED]))
def test_decisions_are_streamed_only_to_an_armed_vehicle_in_its_mode(
    seen: list[tuple[Conditions, bool]], rung: Rung
) -> None:
    for step, asked in seen:
        before = request(rung) if asked else rung
        rung = advance(before, step)
        if rung.stream is Stream.DECISION:
            assert step.armed and step.external_mode and step.own_state_age_s <= 1.0 and step.autopilot_heard_s <= 3.0
            assert not (
                step.stalled
                or step.warming
                or step.own_jumped
                or step.on_ground
                or step.other_writer
                or step.unheard
                or step.rebooted
                or step.deciding_fails
            )
            assert before.state in (State.ENGAGED, State.HOLD)
        if rung.stream is Stream.ZERO:
            asleep_s = step.since_last_step_s if step.since_last_step_s > 0.3 else 0.0
            assert step.armed and step.autopilot_heard_s - asleep_s <= 3.0
            assert step.external_mode or (step.wants_stream and rung.requested)
        if not before.requested and before.state is not State.ENGAGED:
            assert rung.stream is Stream.NOTHING


def test_what_is_not_told_is_neither_an_alarm_nor_a_permission() -> None:
    told = Conditions()
    assert (told.armed, told.external_mode, told.ready, told.has_goal, told.wants_stream) == (
        False, False, True, False, False,
    )  # fmt: skip
    assert math.isinf(told.autopilot_heard_s) and math.isinf(told.own_state_age_s)
    alarms = (
        told.rebooted,
        told.stalled,
        told.warming,
        told.own_jumped,
        told.on_ground,
        told.other_writer,
        told.unheard,
        told.deciding_fails,
    )
    assert not any(alarms) and told.latitude_deg == 0.0 and told.since_last_step_s == told.obeying_s == 0.0
    assert (Rung().state, Rung().requested, Rung().stream) == (State.STANDBY, False, Stream.NOTHING)


def test_the_times_are_those_of_the_contract_and_the_states_those_of_the_dialect() -> None:
    assert FailsafeSettings() == FailsafeSettings(3.0, 1.0, 5.0, 0.3, 85.0, 300e3)
    assert [int(state) for state in (State.STANDBY, State.ENGAGED, State.HOLD, State.STOPPED)] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("seen", "state"),
    [
        ({"autopilot_heard_s": 3.0}, State.ENGAGED),
        ({"own_state_age_s": 1.0}, State.ENGAGED),
        ({"own_state_age_s": 5.0}, State.HOLD),
        ({"since_last_step_s": 0.3}, State.ENGAGED),
        ({"latitude_deg": 85.0}, State.ENGAGED),
        ({"latitude_deg": -85.0}, State.ENGAGED),
        ({"goal_away_m": 300e3}, State.ENGAGED),
    ],
)
def test_a_limit_itself_is_still_within(seen: dict[str, float], state: State) -> None:
    assert climb(ENGAGED, replace(FLYING, **seen)).state is state


def test_a_stopped_vehicle_that_is_asked_for_and_not_there_waits() -> None:
    rung = climb(request(Rung(State.STOPPED)), replace(FLYING, autopilot_heard_s=9.0))
    assert (rung.state, rung.requested) == (State.STANDBY, True)
    assert climb(Rung(State.STOPPED, reason="lost"), FLYING).reason == "lost"
