"""What a conductor concludes from a daemon's own words."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from ridlink.conductor.daemon_words import ARRIVED_WITHIN_M, ARRIVED_WORDS, DaemonWords

STATUS = {"preferred_vx": 0, "preferred_vy": 0, "conflicts": 0}
M_PER_DEG = 111_195.0


def engaged() -> DaemonWords:
    words = DaemonWords()
    words.take_heartbeat({"system_status": 4}, 0.0)
    return words


def say(words: DaemonWords, times: int, *, north_mps: float = 0.0, **said: int) -> None:
    for second in range(times):
        words.take_status(STATUS | said, 47.0 + north_mps * second / M_PER_DEG, 8.0)


def test_a_daemon_is_heard_for_three_heartbeats() -> None:
    words = DaemonWords()
    assert not words.is_heard(0.0)
    words.take_heartbeat({"system_status": 3}, 10.0)
    assert not words.active and words.is_heard(13.0) and not words.is_heard(14.0)


@given(st.floats(0.0, 350.0), st.floats(0.0, 2 * math.pi))
def test_who_stands_and_wants_little_has_arrived(speed_cmps: float, towards: float) -> None:
    """Near its goal a vehicle is sent to and fro; 2 m from it the daemon still wants 2.9 m/s."""
    words = engaged()
    wanted = {"preferred_vx": int(speed_cmps * math.cos(towards)), "preferred_vy": int(speed_cmps * math.sin(towards))}
    say(words, ARRIVED_WORDS - 1, **wanted)
    assert not words.has_arrived
    say(words, 1, **wanted)
    assert words.has_arrived


@given(st.floats(ARRIVED_WITHIN_M / (ARRIVED_WORDS - 1) + 0.1, 20.0))
def test_a_slow_cruise_is_no_arrival(cruise_mps: float) -> None:
    words = engaged()
    say(words, 3 * ARRIVED_WORDS, north_mps=cruise_mps, preferred_vx=200)
    assert not words.has_arrived


def test_who_waits_for_others_or_is_not_steered_has_not_arrived() -> None:
    waiting, standby, wanting = engaged(), DaemonWords(), engaged()
    say(waiting, 3 * ARRIVED_WORDS, conflicts=1)
    say(standby, 3 * ARRIVED_WORDS)
    say(wanting, 3 * ARRIVED_WORDS, preferred_vy=-1000)
    assert not (waiting.has_arrived or standby.has_arrived or wanting.has_arrived)
