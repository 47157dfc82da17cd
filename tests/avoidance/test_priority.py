"""Who goes first where nobody gets anywhere, asked of one own-ship; whole worlds of it are in `test_exact`."""

from __future__ import annotations

import math
from itertools import groupby
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import OwnShip, Traffic
from ridlink.avoidance.priority import CLEAR_RADII, FAILED_RADII, NOBODY, PATIENCE_S, TURN_S, RightOfWay
from tests.avoidance.lots import clock_in, lot, turn_of

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
    """An own-ship that is asked twice a second, by a clock that stands in one turn or goes on from the middle of it."""

    def __init__(self, identity: int, own: OwnShip | None = None, *, turn: int = 0, goes: bool = False) -> None:
        self.identity, self.own = identity, own or standing()
        self.right_of_way, self.now_s = RightOfWay(), 0.0
        self.clock_s, self.goes = clock_in(turn), goes

    def last(self, traffic: Traffic, identities, for_s: float = STEP_S, goal=GOAL):
        """What it is told after so long."""
        for _ in range(round(for_s / STEP_S)):
            self.now_s += STEP_S
            self.clock_s += STEP_S * self.goes
            told = self.right_of_way.velocity(
                self.own, self.identity, traffic, np.array(identities), goal_ne_m=goal, cruise_mps=CRUISE,
                now_s=self.now_s, clock_s=self.clock_s,
            )  # fmt: skip
        return told

    def stalled(self, traffic: Traffic, identities):
        """Waits with the clock in the middle of its turn until its patience is at an end."""
        goes, self.goes = self.goes, False
        told = self.last(traffic, identities, ROUND_S + 2.0 * STEP_S)
        self.goes = goes
        return told


FIRST_1 = turn_of(1, 2)
"""A turn in which 1 goes before 2."""

AHEAD = neighbours((50.0, 0.0))


def test_only_who_gets_nowhere_for_a_while_makes_way():
    jam = Jam(2, turn=FIRST_1)
    assert jam.last(AHEAD, [1], ROUND_S) is None
    told = jam.last(AHEAD, [1], 2.0 * STEP_S)
    assert told is not None and told == pytest.approx([-(CLEAR_RADII * DISC_M - 50.0), 0.0])


@pytest.mark.parametrize("disc_m", [25.0, 40.0, 120.0])
def test_it_waits_as_long_as_a_way_round_the_largest_disc_takes(disc_m):
    """Slow among large discs, a vehicle may only be on its way round; beside small ones it waits for PATIENCE_S."""
    jam, traffic = Jam(2, turn=turn_of(1, 2, 3)), neighbours((20.0, 0.0), (0.0, 20.0), disc_m=disc_m)
    traffic.radius_m[1] = 15.0
    wait = max(PATIENCE_S, 2.0 * math.pi * disc_m / CRUISE)
    assert jam.last(traffic, [1, 3], wait - STEP_S) is None
    assert jam.last(traffic, [1, 3], 3.0 * STEP_S) is not None


def test_who_comes_nearer_to_its_goal_never_does():
    jam = Jam(2, turn=FIRST_1)
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
    turn = turn_of(2, 3) if identities == [3] else FIRST_1
    assert Jam(2, turn=turn).last(traffic, identities, ROUND_S + TURN_S / 2.0) is None


def test_at_the_goal_it_is_for_the_half_planes_to_make_way():
    assert Jam(2, turn=FIRST_1).last(AHEAD, [1], ROUND_S + 1.0, goal=(5.0, 0.0)) is None


def test_far_enough_away_it_waits():
    jam = Jam(2, turn=FIRST_1)
    told = jam.last(neighbours((CLEAR_RADII * DISC_M + 5.0, 0.0)), [1], ROUND_S + 1.0)
    assert told is not None and told.tolist() == [0.0, 0.0]


def test_whom_the_first_flies_at_leaves_to_the_left_of_it():
    """The first comes from the north, so its left is in the east; it passes on its right, in the west."""
    jam = Jam(2, turn=FIRST_1)
    told = jam.last(neighbours((50.0, 0.0), velocity=(-5.0, 0.0)), [1], ROUND_S + 1.0)
    assert told[0] < 0.0 < told[1]


def test_it_makes_way_for_all_that_go_before_it_and_for_no_others():
    """0 goes first, 1 next; 3 comes after 2."""
    jam = Jam(2, turn=turn_of(0, 1, 2, 3))
    places = ((50.0, 0.0), (0.0, 40.0), (0.0, -40.0))
    told = jam.last(neighbours(*places), [0, 1, 3], ROUND_S + 1.0)
    assert told[0] < 0.0 and told[1] < 0.0


def test_the_order_goes_on_from_who_is_first_round_and_round():
    """3 goes first, 1 next, then 2 itself."""
    jam = Jam(2, turn=turn_of(3, 1, 2))
    told = jam.stalled(neighbours((50.0, 0.0), (0.0, 50.0)), [1, 3])
    assert told[0] < 0.0 and told[1] < 0.0
    jam = Jam(1, turn=turn_of(3, 1, 2))
    told = jam.stalled(neighbours((50.0, 0.0), (0.0, 50.0)), [2, 3])
    assert told[0] == 0.0 and told[1] < 0.0


def test_who_has_no_identity_draws_no_lot():
    turn = next(k for k in range(200) if lot(NOBODY, k) < lot(1, k) < lot(2, k))
    told = Jam(2, turn=turn).stalled(neighbours((50.0, 0.0), (0.0, 50.0)), [1, NOBODY])
    assert told == pytest.approx([-(CLEAR_RADII * DISC_M - 50.0), 0.0])


def test_who_stands_loses_its_turn_as_it_is_over():
    jam = Jam(2, turn=FIRST_1, goes=True)
    assert jam.stalled(AHEAD, [1]) is not None
    assert jam.last(AHEAD, [1], TURN_S / 2.0 - STEP_S) is not None
    assert jam.last(AHEAD, [1], TURN_S / 2.0) is None


@pytest.mark.parametrize("gust_mps", [1.5, 8.0])
def test_who_hovers_in_wind_and_noise_stands(gust_mps):
    jam = Jam(2, turn=FIRST_1, goes=True)
    assert jam.stalled(AHEAD, [1]) is not None
    told = []
    for k in range(round(TURN_S / STEP_S)):
        velocity = (0.0, gust_mps if k % 2 else -gust_mps)
        told.append(jam.last(neighbours((50.0, 0.0), velocity=velocity), [1]))
    assert told[0] is not None and told[-1] is None


@pytest.mark.parametrize("velocity", [(0.0, 3.0), (-3.0, 0.0)])
def test_who_comes_somewhere_keeps_its_turn(velocity):
    jam, flying = Jam(2, turn=FIRST_1, goes=True), neighbours((50.0, 0.0), velocity=velocity)
    jam.stalled(flying, [1])
    assert all(jam.last(flying, [1]) is not None for _ in range(round(5.0 * TURN_S / STEP_S)))


def test_what_nobody_looked_at_is_not_taken_for_a_flight():
    """Own-ship was not stalled for a minute, in which the first hovered at a speed that noise alone has."""
    jam, hovering = Jam(2, turn=FIRST_1, goes=True), neighbours((50.0, 0.0), velocity=(0.0, 0.5))
    assert jam.stalled(hovering, [1]) is not None
    jam.now_s += 60.0
    assert jam.last(hovering, [1], TURN_S) is None


def test_who_makes_way_for_own_ship_has_lost_its_turn_however_far_it_comes():
    jam, retreating = Jam(2, turn=FIRST_1, goes=True), neighbours((50.0, 0.0), velocity=(3.0, 0.5))
    assert jam.stalled(retreating, [1]) is not None
    assert jam.last(retreating, [1], TURN_S) is None


def test_who_gets_nowhere_in_its_own_turns_leaves_the_round_for_longer_and_longer_and_gives_more_room():
    jam, ahead = Jam(2, goes=True), neighbours((55.0, 0.0))
    told = [jam.last(ahead, [1]) for _ in range(1500)]
    assert (
        0.0 < np.mean([each is not None for each in told[-750:]]) < np.mean([each is not None for each in told[:250]])
    )
    lacking = sorted({round(float(-each[0]), 6) for each in told if each is not None})
    assert lacking == [CLEAR_RADII * DISC_M - 55.0, CRUISE]
    assert lacking[-1] < (CLEAR_RADII + FAILED_RADII) * DISC_M - 55.0


@pytest.mark.parametrize("later_s", [STEP_S, 4.0, 11.0, 33.0])
def test_two_agree_on_who_goes_first_whenever_each_began_to_wait(later_s):
    """Never do both make way, and mostly one of them does, until they leave the round."""
    here, there = Jam(7, goes=True), Jam(9, standing((50.0, 0.0)), goes=True)
    here.last(neighbours((50.0, 0.0)), [9], later_s)
    there.clock_s = here.clock_s
    both = one = 0
    for _ in range(round((ROUND_S + 3.0 * TURN_S) / STEP_S)):
        first = here.last(neighbours((50.0, 0.0)), [9])
        second = there.last(neighbours((0.0, 0.0)), [7], goal=(-500.0, 0.0))
        both += first is not None and second is not None
        one += (first is None) != (second is None)
    assert both == 0
    assert one * STEP_S > TURN_S


def test_without_a_clock_that_all_share_the_own_one_counts():
    jam = Jam(2)
    told = [
        jam.right_of_way.velocity(
            jam.own, 2, AHEAD, np.array([1]), goal_ne_m=GOAL, cruise_mps=CRUISE, now_s=STEP_S * k
        )
        for k in range(round((ROUND_S + 10.0 * TURN_S) / STEP_S))
    ]  # fmt: skip
    assert any(each is not None for each in told) and any(each is None for each in told[round(ROUND_S / STEP_S) + 2 :])


@pytest.mark.parametrize("identities", [range(2), range(24), [crc32(bytes([k])) for k in range(5)]])
def test_lots_are_fair_and_seldom_the_same_for_long(identities):
    leaders = [min(identities, key=lambda each: lot(each, turn)) for turn in range(118_000_000, 118_002_000)]
    shares = np.array([leaders.count(each) for each in identities]) * len(identities) / len(leaders)
    assert shares == pytest.approx(1.0, abs=0.5)
    runs = [len(list(run)) for _, run in groupby(leaders)]
    assert max(runs) < 15


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
        Jam(identity, turn=FIRST_1).last(
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
    for wrong in ({"now_s": math.nan}, {"now_s": 0.0, "clock_s": math.inf}):
        with pytest.raises(ValueError, match="now_s, clock_s"):
            RightOfWay().velocity(standing(), 1, AHEAD, np.array([2]), goal_ne_m=GOAL, cruise_mps=10.0, **wrong)
