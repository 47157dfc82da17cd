"""The guard alone, step by step, without a vehicle; `test_guard.py` flies it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from ridlink.engine import EngineConfig, Goal
from ridlink.engine.guard import GIVE_UP_S, Guard, Phase, Seen, is_autonomous, mode_command
from ridlink.errors import ConfigError
from ridlink.own_ship import ARDUPILOT, PX4
from tests.sitl_sim import test_autopilot_missions as missions

CLEAR = Seen(PX4, missions.PX4_MISSION, True, True, False, True, 1)


def seen(**fields: Any) -> Seen:
    return replace(CLEAR, **fields)


def taking_over(at_s: float = 0.0) -> Guard:
    guard = Guard()
    assert guard.step(seen(conflict=True), at_s).begin
    return guard


def test_only_autonomous_modes_are_taken_over_from() -> None:
    assert is_autonomous(PX4, missions.PX4_MISSION) and is_autonomous(PX4, missions.PX4_RETURN)
    assert is_autonomous(ARDUPILOT, 3) and not is_autonomous(ARDUPILOT, 5)
    for mode in (3 << 16, 6 << 16, missions.PX4_HOLD | 1):
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
    guard.engage()
    assert guard.phase is Phase.WATCHING


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


def test_what_was_found_is_asked_for_again_until_a_heartbeat_says_it() -> None:
    guard = taking_over()
    guard.step(seen(custom_mode=6 << 16, clear=False), 1.0)
    asked = [k for k in range(12) if guard.step(seen(custom_mode=6 << 16), 2.0 + 0.1 * k).commands]
    assert asked == [0, 5, 10]
    assert guard.step(seen(), 4.0).end
    assert guard.phase is Phase.WATCHING and guard.takeovers == 1


def test_a_guard_has_no_goal_of_its_own() -> None:
    with pytest.raises(ConfigError, match="leave out goal"):
        EngineConfig(guard=True, goal=Goal(47.0, 8.0))
    with pytest.raises(ConfigError, match="takeoff-height"):
        EngineConfig(takeoff_height_m=-1.0)
