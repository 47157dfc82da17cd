"""Who goes first where nobody gets anywhere, asked of one own-ship; whole worlds of it are in `test_exact`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import OwnShip, Traffic
from ridlink.avoidance.priority import CLEAR_RADII, NOBODY, PATIENCE_S, TURN_S, RightOfWay

GOAL, CRUISE, DISC_M, STEP_S = (500.0, 0.0), 10.0, 40.0, 0.5

ROUND_S = 2.0 * math.pi * DISC_M / CRUISE
"""So long own-ship flies round the disc."""


def standing(position=(0.0, 0.0)) -> OwnShip:
    return OwnShip(np.array(position), np.zeros(2), np.zeros(2), 1.0, CRUISE)


def neighbours(*places, velocity=(0.0, 0.0), reciprocal=True, disc_m=DISC_M) -> Traffic:
    count = len(places)
    flown = np.tile(np.array(velocity, float), (count, 1))
    return Traffic(
        np.array(places, float).reshape(-1, 2), flown, flown, np.zeros(count), np.full(count, disc_m), np.zeros(count),
        np.full(count, reciprocal), np.zeros(count, np.int8),
    )  # fmt: skip


class Jam:
    """An own-ship that is asked twice a second."""

    def __init__(self, identity: int, own: OwnShip | None = None) -> None:
        self.identity, self.own = identity, own or standing()
        self.right_of_way, self.now_s = RightOfWay(), 0.0

    def last(self, traffic: Traffic, identities, for_s: float = STEP_S, goal=GOAL):
        """What it is told after so long."""
        for _ in range(round(for_s / STEP_S)):
            self.now_s += STEP_S
            told = self.right_of_way.velocity(
                self.own, self.identity, traffic, np.array(identities), goal_ne_m=goal, cruise_mps=CRUISE,
                now_s=self.now_s,
            )  # fmt: skip
        return told


AHEAD = neighbours((50.0, 0.0))


def test_only_who_gets_nowhere_for_a_while_makes_way():
    jam = Jam(2)
    assert jam.last(AHEAD, [1], ROUND_S) is None
    told = jam.last(AHEAD, [1], 2.0 * STEP_S)
    assert told is not None and told == pytest.approx([-(CLEAR_RADII * DISC_M - 50.0), 0.0])


@pytest.mark.parametrize("disc_m", [25.0, 40.0, 120.0])
def test_it_waits_as_long_as_a_way_round_the_largest_disc_takes(disc_m):
    """Slow among large discs, a vehicle may only be on its way round; beside small ones it waits for PATIENCE_S."""
    jam, traffic = Jam(2), neighbours((20.0, 0.0), (0.0, 20.0), disc_m=disc_m)
    traffic.radius_m[1] = 15.0
    wait = max(PATIENCE_S, 2.0 * math.pi * disc_m / CRUISE)
    assert jam.last(traffic, [1, 3], wait - STEP_S) is None
    assert jam.last(traffic, [1, 3], 3.0 * STEP_S) is not None


def test_who_comes_nearer_to_its_goal_never_does():
    jam = Jam(2)
    for north in np.arange(0.0, 400.0, 4.0):
        jam.own = standing((north, 0.0))
        assert jam.last(neighbours((north + 50.0, 0.0)), [1], 1.0) is None


@pytest.mark.parametrize(
    ("traffic", "identities"),
    [
        (AHEAD, [3]),
        (AHEAD, [NOBODY]),
        (neighbours((200.0, 0.0)), [1]),
        (neighbours((50.0, 0.0), reciprocal=False), [1]),
        (neighbours(), []),
    ],
    ids=["the own turn", "without identity", "far away", "avoids nobody", "alone"],
)
def test_nobody_makes_way_without_reason(traffic, identities):
    assert Jam(2).last(traffic, identities, ROUND_S + TURN_S / 2.0) is None


def test_at_the_goal_it_is_for_the_half_planes_to_make_way():
    assert Jam(2).last(AHEAD, [1], ROUND_S + 1.0, goal=(5.0, 0.0)) is None


def test_far_enough_away_it_waits():
    jam = Jam(2)
    told = jam.last(neighbours((CLEAR_RADII * DISC_M + 5.0, 0.0)), [1], ROUND_S + 1.0)
    assert told is not None and told.tolist() == [0.0, 0.0]


def test_whom_the_first_flies_at_leaves_to_the_left_of_it():
    """The first comes from the north, so its left is in the east; it passes on its right, in the west."""
    jam = Jam(2)
    told = jam.last(neighbours((50.0, 0.0), velocity=(-5.0, 0.0)), [1], ROUND_S + 1.0)
    assert told[0] < 0.0 < told[1]


def test_it_makes_way_for_all_that_go_before_it_and_for_no_others():
    jam = Jam(2)
    places = ((50.0, 0.0), (0.0, 40.0), (0.0, -40.0))
    told = jam.last(neighbours(*places), [0, 1, 3], ROUND_S + 1.0)
    assert told[0] < 0.0 and told[1] < 0.0


def test_who_stands_loses_its_turn_to_the_next_one():
    """1 goes first and stands; then it is the turn of 2, then of 3, with 1 next after it; then of 1 again."""
    jam, others = Jam(2), neighbours((50.0, 0.0), (0.0, 50.0))
    # In the middle of each turn; a turn is over a step after TURN_S.
    waits = (ROUND_S + TURN_S / 2.0, *[TURN_S + STEP_S] * 3)
    turns = [jam.last(others, [1, 3], wait) for wait in waits]
    assert [told is None for told in turns] == [False, True, False, False]
    assert turns[2][0] < 0.0 and turns[2][1] < 0.0
    assert turns[3][0] < 0.0 and turns[3][1] == 0.0


def test_who_flies_keeps_its_turn():
    jam, flying = Jam(2), neighbours((50.0, 0.0), velocity=(0.0, 3.0))
    jam.last(flying, [1], ROUND_S + STEP_S)
    assert all(jam.last(flying, [1]) is not None for _ in range(round(5.0 * TURN_S / STEP_S)))


def test_who_gets_nowhere_in_its_own_turns_leaves_the_round_for_longer_and_longer():
    jam = Jam(2)
    told = [jam.last(AHEAD, [1]) is not None for _ in range(1500)]
    assert 0.0 < np.mean(told[-750:]) < np.mean(told[:250])


def test_two_agree_on_who_goes_first():
    """Both stall at once; exactly one of them makes way, and it is the greater one."""
    here, there = Jam(7), Jam(9, standing((50.0, 0.0)))
    for _ in range(round((ROUND_S + TURN_S / 2.0) / STEP_S)):
        first = here.last(neighbours((50.0, 0.0)), [9])
        second = there.last(neighbours((0.0, 0.0)), [7], goal=(-500.0, 0.0))
    assert first is None and second is not None


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-150.0, 150.0), st.floats(-150.0, 150.0)), min_size=1, max_size=8),
    st.floats(-math.pi, math.pi), st.integers(0, 8),
)  # fmt: skip
def test_the_answer_is_finite_within_cruise_and_turns_with_the_world(places, angle, identity):
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    identities = [k for k in range(9) if k != identity][: len(places)]
    plain, turned = (
        Jam(identity).last(
            neighbours(*(np.array(places) @ by)), identities, ROUND_S + 0.5, goal=tuple(np.array(GOAL) @ by)
        )
        for by in (np.eye(2), turn)
    )  # fmt: skip
    assert (plain is None) == (turned is None)
    if plain is not None:
        assert np.all(np.isfinite(plain)) and np.linalg.norm(plain) <= CRUISE + 1e-9
        assert turned == pytest.approx(plain @ turn, abs=1e-6)


def test_every_neighbour_needs_a_number():
    with pytest.raises(ValueError, match="identities must hold 1 numbers"):
        Jam(2).last(AHEAD, [1, 3])
    with pytest.raises(ValueError, match="negative: -1"):
        Jam(-1).last(AHEAD, [1])
    with pytest.raises(ValueError, match="now_s"):
        RightOfWay().velocity(standing(), 1, AHEAD, np.array([2]), goal_ne_m=GOAL, cruise_mps=10.0, now_s=math.nan)
