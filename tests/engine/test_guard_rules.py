"""The guard alone, step by step, without a vehicle; `test_guard.py` flies it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from ridlink.engine import EngineConfig, Goal
from ridlink.engine.decision import DecisionRecord
from ridlink.engine.guard import (
    CHANGED,
    EXTERNAL_MODE,
    FOREIGN_MODE,
    GIVE_UP_S,
    Guard,
    Phase,
    Seen,
    Wish,
    is_autonomous,
    mode_command,
)
from ridlink.engine.guarding import AHEAD_M, RESUMED_FREE_S, goal_ahead, seen_by_guard
from ridlink.errors import ConfigError
from ridlink.failsafe import OTHER_WRITER, Rung, State
from ridlink.geodesy import offset_m
from ridlink.own_ship import ARDUPILOT, PX4
from ridlink.setpoint import Velocity
from tests.own_ship.autopilot import flying
from tests.sitl_sim.flight import PX4_HOLD, PX4_MISSION, PX4_RETURN
from tests.traffic.reports import HERE, OWN

AUTO = 3
"""Of ArduPilot."""

CLEAR = Seen(PX4, PX4_MISSION, True, True, False, True, sysid=1, mission_item=1)


def seen(**fields: Any) -> Seen:
    return replace(CLEAR, **fields)


def taking_over(at_s: float = 0.0) -> Guard:
    guard = Guard()
    assert guard.step(seen(conflict=True), at_s).begin
    return guard


def test_only_autonomous_modes_are_taken_over_from() -> None:
    assert is_autonomous(PX4, PX4_MISSION) and is_autonomous(PX4, PX4_RETURN)
    assert is_autonomous(ARDUPILOT, 3) and not is_autonomous(ARDUPILOT, 5)
    for mode in (3 << 16, 6 << 16, PX4_HOLD | 1):
        guard = Guard()
        guard.step(seen(conflict=True, custom_mode=mode), 0.0)
        assert (guard.phase is Phase.WATCHING) is (not is_autonomous(PX4, mode))
    for hindrance in ({"flying": False}, {"interruptible": False}):
        guard = Guard()
        assert not guard.step(seen(conflict=True, **hindrance), 0.0).begin


def test_the_mode_is_asked_for_after_the_stream_and_again_until_a_heartbeat_says_it() -> None:
    guard = taking_over()
    asked = [k for k in range(30) if guard.step(seen(conflict=True), 0.1 * k).commands]
    assert asked[0] == 5 and asked[1:4] == [10, 15, 20]
    assert mode_command(PX4, 6 << 16) == (176, (1.0, 6.0, 0.0))
    guard.step(seen(conflict=True, custom_mode=6 << 16), 3.0)
    assert guard.phase is Phase.RESOLVING


def test_without_the_mode_it_gives_up_and_watches_on() -> None:
    guard = taking_over()
    assert guard.step(seen(conflict=True), GIVE_UP_S + 0.1).end
    assert guard.phase is Phase.WATCHING


@pytest.mark.parametrize(
    ("fields", "phase"), [({"custom_mode": 3 << 16}, Phase.ENDED), ({"flying": False}, Phase.WATCHING)]
)
def test_whoever_changes_the_mode_before_us_has_it(fields: dict[str, Any], phase: Phase) -> None:
    guard = taking_over()
    assert guard.step(seen(conflict=True, **fields), 0.2).end
    assert guard.phase is phase
    assert guard.engage() is (phase is Phase.ENDED)
    assert guard.phase is Phase.WATCHING


def test_a_landing_that_is_ordered_while_it_takes_over_from_a_hold_is_another_mode() -> None:
    guard, landing = Guard(), 4 << 16 | 6 << 24
    assert guard.step(seen(conflict=True, custom_mode=PX4_HOLD), 0.0).begin
    assert guard.step(seen(conflict=True, custom_mode=landing), 0.2).end
    assert guard.phase is Phase.ENDED


def test_a_mission_item_that_moved_is_set_back_before_the_mode() -> None:
    guard = taking_over()
    guard.step(seen(custom_mode=6 << 16, clear=False), 1.0)
    assert not guard.step(seen(custom_mode=6 << 16, clear=False, mission_item=2), 1.1).commands
    wish = guard.step(seen(custom_mode=6 << 16, mission_item=2), 1.2)
    assert [number for number, _ in wish.commands] == [224, 176]
    assert guard.phase is Phase.HANDING_BACK
    assert not guard.step(seen(custom_mode=6 << 16, clear=False), 1.3).commands
    guard.step(seen(custom_mode=3 << 16), 1.5)
    assert guard.phase is Phase.ENDED
    assert guard.hand_back(seen()) == ()


def test_a_waypoint_that_is_passed_before_the_takeover_is_not_flown_to_again() -> None:
    guard = taking_over()
    guard.step(seen(conflict=True, mission_item=2), 0.5)
    assert guard.hand_back(seen(conflict=True, mission_item=2)) == (mode_command(PX4, PX4_MISSION),)
    guard.step(seen(custom_mode=6 << 16, clear=False, mission_item=2), 1.0)
    wish = guard.step(seen(custom_mode=6 << 16, mission_item=2), 2.0)
    assert wish.commands == (mode_command(PX4, PX4_MISSION),)


def test_what_was_found_is_asked_for_again_until_a_heartbeat_says_it() -> None:
    guard = taking_over()
    guard.step(seen(custom_mode=6 << 16, clear=False), 1.0)
    asked = [k for k in range(12) if guard.step(seen(custom_mode=6 << 16), 2.0 + 0.1 * k).commands]
    assert asked == [0, 5, 10]
    assert guard.step(seen(), 4.0).end
    assert guard.phase is Phase.WATCHING and guard.takeovers == 1


def holding() -> Guard:
    """One that found an ArduPilot's AUTO paused, since the conflict is over."""
    guard = Guard()
    assert guard.step(paused(custom_mode=AUTO, conflict=True), 0.0).begin
    guard.step(paused(custom_mode=AUTO, conflict=True, paused=False), 0.1)  # the mode is there, and not told yet
    guard.step(paused(clear=False), 1.0)
    assert guard.hand_back(paused(clear=False)) == ()
    assert guard.step(paused(), 3.0) == Wish()
    assert guard.phase is Phase.HOLDING and guard.pauses_kept == 1
    return guard


def paused(**fields: Any) -> Seen:
    return seen(**({"autopilot": ARDUPILOT, "custom_mode": EXTERNAL_MODE[ARDUPILOT], "paused": True} | fields))


def test_a_mission_that_was_found_paused_is_not_handed_back() -> None:
    guard = holding()
    for k in range(200):
        assert guard.step(paused(clear=k % 10 != 0), 4.0 + k) == Wish()
    assert guard.hand_back(paused()) == () and guard.pauses_kept == 1
    assert guard.step(paused(custom_mode=AUTO), 300.0) == Wish(end=True)
    assert guard.phase is Phase.WATCHING


@pytest.mark.parametrize(
    ("autopilot", "mode", "mission_state", "is_paused"),
    [(ARDUPILOT, AUTO, 4, True), (ARDUPILOT, AUTO, 3, False), (ARDUPILOT, 6, 4, False), (PX4, PX4_HOLD, 4, False)],
)
def test_only_the_auto_of_an_ardupilot_is_paused_in_its_mode(
    autopilot: int, mode: int, mission_state: int, is_paused: bool
) -> None:
    telemetry, vehicle = flying()
    vehicle.source = "b"
    vehicle.heartbeat(20.0, autopilot=autopilot, mode=mode)
    vehicle.say(20.0, "MISSION_CURRENT", seq=2, mission_state=mission_state)
    given = seen_by_guard(EngineConfig(guard=True), telemetry, None, Rung(), None, 20.0)
    assert (given.mission_item, given.paused) == (2, is_paused)
    for other in (EXTERNAL_MODE[autopilot], mode):  # what was said in another mode says nothing of this one
        vehicle.heartbeat(20.1, autopilot=autopilot, mode=other)
    assert not seen_by_guard(EngineConfig(guard=True), telemetry, None, Rung(), None, 20.1).paused


@pytest.mark.parametrize(
    ("resumed_entry_s", "is_clear"), [(0.0, False), (RESUMED_FREE_S, False), (5.1, True), (math.inf, True)]
)
def test_a_plan_that_would_soon_lead_into_a_disc_is_not_handed_back(resumed_entry_s: float, is_clear: bool) -> None:
    """The way was free at the speed of the takeover. Handed back 7 m apart, two missions sped up and collided."""
    telemetry, _ = flying()
    record = DecisionRecord(20.0, State.ENGAGED, OWN, 1, resumed_entry_s=resumed_entry_s)
    given = seen_by_guard(EngineConfig(guard=True), telemetry, OWN, Rung(State.ENGAGED), record, 20.1)
    assert given.clear is is_clear


@pytest.mark.parametrize("fields", [{"custom_mode": 17}, {"taken": True}])
def test_who_holds_is_ended_by_another_mode_and_by_another_writer(fields: dict[str, Any]) -> None:
    guard = holding()
    assert guard.step(paused(**fields), 4.0).end
    assert guard.phase is Phase.ENDED


def test_who_holds_avoids_again_when_the_avoidance_has_ended() -> None:
    guard = holding()
    begun = [k for k in range(120) if guard.step(paused(clear=False, steering=False), 4.0 + 0.1 * k).begin]
    assert begun == [41, 92]
    assert guard.phase is Phase.HOLDING


def test_a_guard_has_no_goal_of_its_own() -> None:
    with pytest.raises(ConfigError, match="leave out goal"):
        EngineConfig(guard=True, goal=Goal(47.0, 8.0))
    with pytest.raises(ConfigError, match="takeoff-height"):
        EngineConfig(takeoff_height_m=-1.0)


# --- times far from zero, the other autopilot, and modes with sub modes ---

T = 1000.0


def test_the_modes_of_both_autopilots() -> None:
    px4 = {
        main << 16 | sub << 24 for main in range(9) for sub in range(9) if is_autonomous(PX4, main << 16 | sub << 24)
    }
    assert px4 == {4 << 16 | 3 << 24, 4 << 16 | 4 << 24, 4 << 16 | 5 << 24}, "hold, mission, return"
    assert [mode for mode in range(30) if is_autonomous(ARDUPILOT, mode)] == [3, 6], "AUTO, RTL"
    assert not is_autonomous(8, 3), "of another autopilot nothing is known"
    assert mode_command(ARDUPILOT, EXTERNAL_MODE[ARDUPILOT]) == (176, (1.0, 4.0, 0.0))
    assert mode_command(PX4, PX4_MISSION) == (176, (1.0, 4.0, 4.0))


def test_nobody_asks_for_anything_while_all_is_clear() -> None:
    guard = Guard()
    assert guard.step(seen(), T) == Wish(begin=False, end=False, commands=())
    assert (guard.phase, guard.found_mode, guard.takeovers) == (Phase.WATCHING, 0, 0)


def test_a_px4_gets_half_a_second_of_stream_and_an_ardupilot_is_asked_at_once() -> None:
    guard = taking_over(T)
    assert not guard.step(seen(conflict=True), T + 0.4).commands
    assert guard.step(seen(conflict=True), T + 0.5).commands
    copter = Guard()
    flying_auto = seen(autopilot=ARDUPILOT, custom_mode=3, conflict=True)
    assert copter.step(flying_auto, T).begin
    assert copter.step(flying_auto, T).commands == (mode_command(ARDUPILOT, 4),)
    copter.step(replace(flying_auto, custom_mode=4), T + 0.1)
    assert copter.phase is Phase.RESOLVING
    copter.step(replace(flying_auto, custom_mode=5), T + 0.2)
    assert copter.phase is Phase.ENDED, "LOITER is a pilot's"


def test_five_seconds_without_anybody_who_steers_are_enough() -> None:
    guard = taking_over(T)
    ours = seen(custom_mode=6 << 16, conflict=True, clear=False)
    guard.step(ours, T + 1.0)
    assert not guard.step(ours, T + 9.0).commands and guard.phase is Phase.RESOLVING
    idle = replace(ours, steering=False)
    assert not guard.step(idle, T + 14.0).commands and guard.phase is Phase.RESOLVING
    assert guard.step(idle, T + 14.1).commands == (mode_command(PX4, PX4_MISSION),)
    assert guard.phase is Phase.HANDING_BACK
    guard = taking_over(T)
    guard.step(replace(idle, steering=False), T + 1.0)
    assert not guard.step(idle, T + 6.0).commands, "since it has the mode, where nobody ever steered"
    assert guard.step(idle, T + 6.1).commands


def test_a_vehicle_that_somebody_else_steers_as_well_is_theirs() -> None:
    guard = taking_over(T)
    guard.step(seen(custom_mode=6 << 16, clear=False), T + 1.0)
    assert guard.step(seen(custom_mode=6 << 16, clear=False, steering=False, taken=True), T + 2.0) == Wish(end=True)
    assert guard.phase is Phase.ENDED


@pytest.mark.parametrize("handing_back", [False, True])
def test_of_a_vehicle_that_is_disarmed_no_mode_is_asked(handing_back: bool) -> None:
    """A PX4 that is armed in Mission takes off."""
    guard = taking_over(T)
    ours = seen(custom_mode=6 << 16, clear=handing_back)
    guard.step(ours, T + 1.0)
    assert bool(guard.step(ours, T + 1.1).commands) is handing_back
    stands = replace(ours, armed=False, flying=False, steering=False)
    assert guard.step(stands, T + 1.2) == Wish(end=True)
    assert guard.phase is Phase.WATCHING and guard.hand_back(stands) == ()
    assert guard.step(stands, T + 9.0) == Wish()
    guard = taking_over(T)
    guard.step(ours, T + 1.0)
    assert guard.step(replace(stands, custom_mode=3 << 16), T + 1.1).end
    assert guard.phase is Phase.ENDED, "somebody took it and landed"


def test_who_hands_back_takes_nobody_for_another_writer_than_the_plan_that_is_flown_again() -> None:
    guard = taking_over(T)
    ours = seen(custom_mode=6 << 16)
    guard.step(ours, T + 1.0)
    assert guard.step(ours, T + 1.1).commands
    assert guard.phase is Phase.HANDING_BACK
    told_late = replace(ours, steering=False, taken=True, clear=False)
    assert guard.step(told_late, T + 2.5) == Wish()
    assert guard.step(told_late, T + 6.2).commands, "it is asked for until it is told"
    assert guard.step(seen(), T + 7.0).end and guard.phase is Phase.WATCHING


def test_what_was_not_asked_for_yet_is_not_handed_back() -> None:
    guard = taking_over(T)
    guard.step(seen(conflict=True), T + 0.4)
    assert not guard.hand_back(seen(conflict=True))
    guard.step(seen(conflict=True), T + 0.5)
    assert guard.hand_back(seen(conflict=True)) == (mode_command(PX4, PX4_MISSION),)


def test_whether_the_mode_came_before_the_link_was_lost_is_told_by_the_next_heartbeat() -> None:
    guard = Guard()
    flying_auto = seen(autopilot=ARDUPILOT, custom_mode=3, conflict=True)
    lost = replace(flying_auto, heard=False, conflict=False)
    assert not guard.step(replace(flying_auto, heard=False), T).begin, "whoever is not heard is not taken over from"
    guard.step(flying_auto, T)
    assert guard.step(flying_auto, T + 0.1).commands
    assert guard.step(lost, T + 4.0) == guard.step(lost, T + 40.0) == Wish()
    guard.step(replace(lost, heard=True, custom_mode=4, steering=False, clear=False), T + 41.0)
    assert guard.phase is Phase.RESOLVING, "an ArduPilot would hover there for ever"
    for told, phase in (({"custom_mode": 3}, Phase.WATCHING), ({"custom_mode": 5}, Phase.ENDED)):
        guard = Guard()
        guard.step(flying_auto, T)
        guard.step(lost, T + 4.0)
        assert guard.step(replace(lost, heard=True, **told), T + 6.0).end and guard.phase is phase


def test_another_vehicle_on_the_link_is_told_nothing_of_what_was_found_on_the_last_one() -> None:
    for mode in (PX4_MISSION, 6 << 16):
        guard = taking_over(T)
        guard.step(seen(conflict=True), T + 0.5)
        guard.step(seen(conflict=True, clear=False, custom_mode=mode), T + 1.0)
        other = seen(sysid=2, custom_mode=mode, steering=False)
        assert guard.hand_back(other) == ()
        assert guard.step(other, T + 9.0) == Wish(end=True)
        assert guard.phase is Phase.ENDED
        assert guard.step(other, T + 9.1) == Wish()


def test_it_tries_for_five_seconds() -> None:
    guard = taking_over(T)
    assert not guard.step(seen(conflict=True), T + 5.0).end and guard.phase is Phase.TAKING_OVER
    assert guard.refused == 0
    assert guard.step(seen(conflict=True), T + 5.1).end and guard.phase is Phase.WATCHING
    assert guard.refused == 1 and guard.step(seen(conflict=True), T + 5.2).begin


def test_what_it_found_and_is_not_given_back_within_five_seconds_is_refused() -> None:
    guard = taking_over(T)
    ours = seen(custom_mode=6 << 16)
    guard.step(ours, T + 1.0)
    for now_s, refused in ((1.1, 0), (6.1, 0), (6.2, 0), (6.7, 1), (7.2, 2)):
        guard.step(ours, T + now_s)
        assert guard.phase is Phase.HANDING_BACK and guard.refused == refused
    guard.step(replace(ours, heard=False), T + 8.0)
    assert guard.refused == 2, "who is not heard refuses nothing"


def test_why_it_has_ended_or_takes_over_from_nothing() -> None:
    guard = Guard()
    for fields, remark in (
        ({}, ""),
        ({"custom_mode": 3 << 16}, FOREIGN_MODE),
        ({"custom_mode": 3 << 16, "flying": False}, ""),
        ({"custom_mode": 3 << 16, "heard": False}, ""),
    ):
        guard.step(seen(**fields), T)
        assert (guard.phase, guard.remark) == (Phase.WATCHING, remark)
    ours = seen(custom_mode=6 << 16, clear=False)
    for last, remark in (
        (replace(ours, custom_mode=3 << 16), CHANGED),
        (replace(ours, taken=True), OTHER_WRITER),
        (replace(ours, sysid=2), "another vehicle speaks on the link"),
    ):
        guard = taking_over(T)
        guard.step(ours, T + 1.0)
        guard.step(last, T + 2.0)
        assert (guard.phase, guard.remark) == (Phase.ENDED, remark)
        guard.engage()
        assert guard.remark == ""


def test_a_sub_mode_of_offboard_is_offboard_and_another_one_of_auto_is_another_mode() -> None:
    guard = taking_over(T)
    guard.step(seen(conflict=True, custom_mode=6 << 16 | 1 << 24), T + 1.0)
    assert guard.phase is Phase.RESOLVING
    for found, now in ((PX4_MISSION, PX4_HOLD), (PX4_HOLD, PX4_MISSION)):
        guard = Guard()
        assert guard.step(seen(conflict=True, custom_mode=found), T).begin
        assert guard.step(seen(conflict=True, custom_mode=found), T + 0.6).commands
        assert guard.step(seen(conflict=True, custom_mode=now), T + 0.7).end
        assert guard.phase is Phase.ENDED, "it may be somebody's answer to our request"


def test_a_mission_that_ends_before_its_vehicle_is_asked_for_is_taken_over_from_its_hold() -> None:
    """The guard had ended for good, with the conflict before it: it took the end for somebody who changed the mode."""
    guard = taking_over(T)
    holding = seen(conflict=True, custom_mode=PX4_HOLD)
    assert guard.step(holding, T + 0.2).begin, "its place is the goal now"
    assert guard.step(holding, T + 0.6).commands == (mode_command(PX4, EXTERNAL_MODE[PX4]),)
    guard.step(seen(custom_mode=EXTERNAL_MODE[PX4]), T + 1.0)
    assert guard.step(seen(custom_mode=EXTERNAL_MODE[PX4]), T + 1.1).commands == (mode_command(PX4, PX4_HOLD),)
    assert (guard.takeovers, guard.remark) == (1, "")


@pytest.mark.parametrize(
    ("found", "now", "numbers"),
    [(1, 1, [176]), (1, 2, [224, 176]), (1, None, [176]), (None, 2, [176]), (None, None, [176])],
)
def test_the_item_is_set_back_where_it_was_known_and_has_moved(
    found: int | None, now: int | None, numbers: list[int]
) -> None:
    guard = Guard()
    guard.step(seen(conflict=True, mission_item=found), T)
    guard.step(seen(custom_mode=6 << 16, clear=False), T + 1.0)
    assert [number for number, _ in guard.hand_back(seen(mission_item=now))] == numbers


# --- where the plan leads ---


@pytest.mark.parametrize("drift_ned_mps", [(0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (-0.5, 0.7, -1.0)])
def test_the_plan_of_a_vehicle_that_hovers_is_to_stay(drift_ned_mps: Velocity) -> None:
    goal = goal_ahead(replace(OWN, velocity_ned_mps=drift_ned_mps))
    assert goal == Goal(*HERE), "at cruise speed, should it be driven off"


def test_the_plan_of_a_vehicle_that_brakes_for_a_pause_is_to_stay() -> None:
    """Led on where it was flying, it went away from the place at which the operator had paused it."""
    assert goal_ahead(replace(OWN, velocity_ned_mps=(6.0, 0.0, 0.0)), paused=True) == Goal(*HERE)


@pytest.mark.parametrize("velocity_ned_mps", [(1.0, 0.0, 0.0), (-3.0, 4.0, 1.0)])
def test_the_plan_of_a_vehicle_that_flies_leads_ahead(velocity_ned_mps: Velocity) -> None:
    goal = goal_ahead(replace(OWN, velocity_ned_mps=velocity_ned_mps))
    north_m, east_m = offset_m(HERE, (goal.latitude_deg, goal.longitude_deg))
    assert math.hypot(north_m, east_m) == pytest.approx(AHEAD_M, abs=0.1)
    assert math.atan2(east_m, north_m) == pytest.approx(math.atan2(velocity_ned_mps[1], velocity_ned_mps[0]), abs=1e-3)
    assert goal.altitude_m is None
    assert goal.speed_mps == math.hypot(*velocity_ned_mps[:2])
