"""Leaving a slab of height: who climbs, when nobody does, and the way back. Vehicles in virtual time, in a plane of
north and up, that cannot avoid each other in the plane: what keeps them apart here is height alone."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.avoidance.vertical import Cylinder, VerticalAvoidance, VerticalSettings

STEP_S = 0.1
RADIUS_M, HALF_HEIGHT_M = 20.0, 8.0
SETTINGS = VerticalSettings()
BAND_M = (30.0, 30.0)


@dataclass
class Flyer:
    """Flies straight at constant speed and obeys climb rates at once."""

    number: int
    north_m: float
    speed_mps: float
    up_m: float = 50.0
    goal_m: float = 50.0
    avoids: bool = True
    known: bool = True
    bad: bool = True
    climb_mps: float = 0.0
    mind: VerticalAvoidance = field(default_factory=VerticalAvoidance)

    def cylinder(self, other: Flyer) -> Cylinder:
        ahead, closing = other.north_m - self.north_m, self.speed_mps - other.speed_mps
        distance, approaching = abs(ahead), math.copysign(1.0, ahead) * closing
        entry = (distance - RADIUS_M) / approaching if approaching > 0.0 else math.inf
        return Cylinder(
            key=other.number,
            above_m=other.up_m - self.up_m if other.known else math.nan,
            climb_mps=other.climb_mps,
            half_height_m=HALF_HEIGHT_M if other.known else math.inf,
            entry_s=0.0 if distance < RADIUS_M else entry,
            receding=distance > RADIUS_M and approaching <= 0.0,
            reciprocal=other.avoids,
            greater=self.number > other.number,
        )

    def decide(self, others: list[Flyer]) -> float:
        if not self.avoids:
            return self.climb_mps
        return self.mind.step(
            [self.cylinder(other) for other in others],
            bad=self.bad,
            own_climb_mps=self.climb_mps,
            to_goal_m=self.goal_m - self.up_m,
            room_m=(self.goal_m + BAND_M[0] - self.up_m, self.up_m - self.goal_m + BAND_M[1]),
            last_mps=self.climb_mps,
            elapsed_s=STEP_S,
        )


def fly(flyers: list[Flyer], seconds: float) -> list[list[float]]:
    """Heights of all, step by step; limits of rate and band are checked on the way."""
    heights = []
    for _ in range(round(seconds / STEP_S)):
        climbs = [each.decide([other for other in flyers if other is not each]) for each in flyers]
        for each, climb in zip(flyers, climbs, strict=True):
            if each.avoids:
                assert -SETTINGS.descent_mps - 1e-9 <= climb <= SETTINGS.climb_mps + 1e-9
                assert abs(climb - each.climb_mps) <= SETTINGS.acceleration_mps2 * STEP_S + 1e-9
                assert -BAND_M[1] - 0.5 <= each.up_m - each.goal_m <= BAND_M[0] + 0.5
            each.climb_mps = climb
            each.up_m += climb * STEP_S
            each.north_m += each.speed_mps * STEP_S
        heights.append([each.up_m for each in flyers])
    return heights


def entered(flyers: list[Flyer], seconds: float) -> set[tuple[int, int]]:
    """Pairs of whom one entered the cylinder of the other."""
    found = set()
    for _ in range(round(seconds / STEP_S)):
        fly(flyers, STEP_S)
        for one, other in itertools.combinations(flyers, 2):
            if abs(one.north_m - other.north_m) < RADIUS_M and abs(one.up_m - other.up_m) < HALF_HEIGHT_M:
                found.add((one.number, other.number))
    return found


def head_on(**options: Any) -> list[Flyer]:
    return [Flyer(1, -150.0, 10.0, **options), Flyer(2, 150.0, -10.0)]


def test_two_head_on_at_one_height_separate_and_return() -> None:
    flyers = head_on()
    assert entered(flyers, 13.9) == set()
    assert flyers[1].up_m > 50.0 > flyers[0].up_m, "the greater identity climbs"
    assert flyers[1].up_m - flyers[0].up_m > HALF_HEIGHT_M
    assert entered(flyers, 40.0) == set()
    for each in flyers:
        assert each.up_m == pytest.approx(50.0, abs=0.2)
        assert each.mind.leaving == 0


def test_nobody_moves_while_the_plane_is_good_enough() -> None:
    flyers = head_on(bad=False)
    flyers[1].bad = False
    assert all(height == 50.0 for row in fly(flyers, 30.0) for height in row)


def test_whoever_is_higher_climbs_whatever_the_identities_say() -> None:
    flyers = head_on(up_m=54.0)
    fly(flyers, 10.0)
    assert flyers[0].up_m > 56.0 and flyers[1].up_m < 49.0


def test_who_sees_a_neighbour_leave_goes_the_other_way_though_its_own_way_is_good() -> None:
    flyers = head_on()
    flyers[1].bad = False
    assert entered(flyers, 20.0) == set()
    assert flyers[1].up_m > 51.0


@pytest.mark.parametrize("number", [1, 9])
def test_from_one_that_avoids_nobody_we_move_the_whole_way(number: int) -> None:
    flyers = [Flyer(5, -150.0, 10.0), Flyer(number, 150.0, -10.0, avoids=False)]
    assert entered(flyers, 14.5) == set()
    assert abs(flyers[0].up_m - 50.0) > HALF_HEIGHT_M
    fly(flyers, 40.0)
    assert flyers[0].up_m == pytest.approx(50.0, abs=0.2)


def test_a_slab_that_cannot_be_left_in_time_is_not_left() -> None:
    late = [Flyer(5, -40.0, 10.0), Flyer(1, 40.0, -10.0, avoids=False)]
    assert all(row[0] == 50.0 for row in fly(late, 2.5))
    chased = [Flyer(5, -150.0, 10.0), Flyer(1, 150.0, -10.0, avoids=False, climb_mps=2.0, up_m=44.0)]
    assert fly(chased, 0.5)[-1][0] == 50.0, "it climbs as fast as we do"


def test_between_one_above_and_one_below_the_middle_one_waits_until_there_is_room() -> None:
    """Three of a stack meet: the upper one climbs, the lower one descends, the third is left in between."""
    flyers = [
        Flyer(1, 150.0, -10.0, up_m=55.0, goal_m=55.0),
        Flyer(2, -150.0, 10.0),
        Flyer(3, 151.0, -10.0, up_m=45.0, goal_m=45.0),
    ]
    assert all(row[1] == 50.0 for row in fly(flyers, 2.0))
    assert flyers[0].up_m - flyers[2].up_m > 13.0
    assert entered(flyers, 70.0) == set()
    assert [each.up_m for each in flyers] == pytest.approx([55.0, 50.0, 45.0], abs=0.3)


def test_a_third_one_above_blocks_the_climb() -> None:
    free = [Flyer(5, -150.0, 10.0), Flyer(1, 150.0, -10.0, avoids=False)]
    roof = Flyer(7, 150.0, -10.0, up_m=62.0, avoids=False)
    roofed = [Flyer(5, -150.0, 10.0), Flyer(1, 150.0, -10.0, avoids=False), roof]
    fly(free, 5.0)
    heights = fly(roofed, 13.0)
    assert free[0].up_m > 51.0
    assert all(row[0] == 50.0 for row in heights)


def test_the_return_waits_for_the_cylinder_of_another_one() -> None:
    """The second one comes along the old height while we are still above it."""
    flyers = [Flyer(5, -150.0, 10.0), Flyer(1, 150.0, -10.0, avoids=False), Flyer(2, 520.0, -10.0, avoids=False)]
    assert entered(flyers, 60.0) == set()
    fly(flyers, 40.0)
    assert flyers[0].up_m == pytest.approx(50.0, abs=0.2)


@given(
    heights=st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=4),
    climbs=st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4),
    entries=st.lists(st.floats(0.0, 25.0), min_size=4, max_size=4), which=st.integers(0, 3), last=st.floats(0.0, 1.0),
    spoilt=st.sampled_from(("above_m", "climb_mps", "half_height_m")),
)  # fmt: skip
def test_while_a_neighbour_of_unknown_height_is_in_conflict_nobody_climbs_to_avoid(
    heights: list[float], climbs: list[float], entries: list[float], which: int, last: float, spoilt: str
) -> None:
    cylinders = []
    for k, above in enumerate(heights):
        unknown = k == which % len(heights)
        figures: dict[str, Any] = {"above_m": above, "climb_mps": climbs[k], "half_height_m": HALF_HEIGHT_M}
        if unknown:
            figures[spoilt] = math.nan
        entry = min(entries[k], 14.0) if unknown else entries[k]
        cylinders.append(Cylinder(key=k, entry_s=entry, receding=False, reciprocal=True, greater=True, **figures))
    mind = VerticalAvoidance()
    climb = mind.step(
        cylinders, bad=True, own_climb_mps=0.0, to_goal_m=30.0, room_m=BAND_M, last_mps=last, elapsed_s=STEP_S
    )
    assert mind.leaving == 0
    assert 0.0 <= climb <= max(last - STEP_S, 0.0) + 1e-9


def test_one_of_unknown_height_that_turns_up_stops_a_climb() -> None:
    flyers = [*head_on(), Flyer(7, -150.0, 10.0, known=False, avoids=False)]
    flyers[2].north_m = 400.0
    flyers[2].speed_mps = -10.0
    fly(flyers[:2], 6.0)
    assert flyers[0].mind.leaving == -1
    heights = [row[0] for row in fly(flyers, 5.0)]
    assert heights[-1] == pytest.approx(heights[20], abs=1e-6), "level from two seconds after it was heard"


@given(
    start=st.floats(-60.0, 60.0), numbers=st.permutations((1, 2)), north=st.floats(60.0, 250.0),
    other=st.floats(-10.0, 10.0), avoids=st.booleans(),
)  # fmt: skip
def test_never_outside_the_band(
    start: float, numbers: tuple[int, int], north: float, other: float, avoids: bool
) -> None:
    """Not even towards a goal; whoever begins outside of it only comes nearer."""
    own = Flyer(numbers[0], -north, 10.0, up_m=50.0 + start, goal_m=50.0)
    neighbour = Flyer(numbers[1], north, -10.0, up_m=50.0 + start + other, avoids=avoids)
    worst = max(abs(start), BAND_M[0])
    for _ in range(300):
        climb = own.decide([neighbour])
        own.climb_mps = climb
        own.up_m += climb * STEP_S
        own.north_m += 1.0
        neighbour.north_m -= 1.0
        assert abs(own.up_m - 50.0) <= worst + 0.3


@given(
    above=st.floats(-60.0, 60.0), climbs=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)), greater=st.booleans()
)
def test_both_ends_of_a_pair_choose_apart(above: float, climbs: tuple[float, float], greater: bool) -> None:
    def choice(above_m: float, own_climb: float, climb: float, mine: bool) -> int:
        each = Cylinder(0, above_m, climb, 50.0, 10.0, receding=False, reciprocal=True, greater=mine)
        return VerticalAvoidance()._direction(each, own_climb)

    one, other = choice(above, *climbs, greater), choice(-above, climbs[1], climbs[0], not greater)
    assert {one, other} == {1, -1}


def test_identities_that_cannot_be_told_apart_give_no_direction() -> None:
    same = Cylinder(0, 0.5, 0.0, HALF_HEIGHT_M, 10.0, receding=False, reciprocal=True, greater=None)
    mind = VerticalAvoidance()
    arguments: dict[str, Any] = {"own_climb_mps": 0.0, "to_goal_m": 0.0, "room_m": BAND_M, "last_mps": 0.0}
    assert mind.step([same], bad=True, elapsed_s=STEP_S, **arguments) == 0.0
