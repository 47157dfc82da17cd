"""The way round static obstacles: the shortest, on the right of two that are equal, in and out of bays."""

import heapq
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import Obstacles, OwnShip, Traffic, keep_out, roadmap, waypoint, ways
from ridlink.avoidance.roadmap import NO_KEY, STEPS_PER_M, new_roadmap
from ridlink.avoidance.solver import HalfplaneSolver
from tests.avoidance.lockstep import signed_distance
from tests.avoidance.way_in import way_in

nearest_point, enclose, in_sight = (way_in(one) for one in (keep_out.nearest_point, ways.enclose, ways.in_sight))
ways_to, next_waypoint, choose_way = (
    way_in(one) for one in (roadmap.ways_to, waypoint.next_waypoint, waypoint.choose_way)
)

SQUARE = np.array([[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]])
BAY = np.array(
    [[-60.0, -60.0], [60.0, -60.0], [60.0, -50.0], [-50.0, -50.0], [-50.0, 50.0], [60.0, 50.0], [60.0, 60.0],
     [-60.0, 60.0]]
)  # fmt: skip
"""Open to the north."""


def wall(*corners, thickness=2.0):
    """Polygons along a line from corner to corner."""
    parts = []
    for here, there in pairwise(np.array(corners, float)):
        along = (there - here) / np.linalg.norm(there - here)
        aside = thickness / 2.0 * np.array([-along[1], along[0]])
        parts.append(np.array([here - aside, there - aside, there + aside, here + aside]))
    return parts


SPIRAL = wall(
    (0.0, 40.0), (0.0, -60.0), (120.0, -60.0), (120.0, 120.0), (-100.0, 120.0), (-100.0, -160.0), (220.0, -160.0)
)


class Way:
    """The way to a goal, asked for at one place after the other."""

    def __init__(self, obstacles, goal, clearance=12.0):
        self.obstacles, self.goal, self.clearance, self.memory = obstacles, np.array(goal), clearance, 0
        self.roadmap = new_roadmap(obstacles)

    def aim(self, position):
        aim = np.zeros(2)
        self.memory = next_waypoint(
            self.obstacles.pieces, self.roadmap, *position, *self.goal, self.clearance, 0.0, max(self.memory, 0), aim
        )
        return aim

    def fly(self, position, step_m=2.0, most=2000):
        """Places on the way, in steps, until the goal is reached, none is in sight or there are too many."""
        position = np.array(position, float)
        places = [position]
        for _ in range(most):
            way = self.aim(position) - position
            length = np.linalg.norm(way)
            if self.memory < 0 or length < 1e-9:
                break
            position = position + way * min(step_m / length, 1.0)
            places.append(position)
            if np.linalg.norm(self.goal - position) < 1e-6:
                break
        return np.array(places)


def length(places):
    return np.linalg.norm(np.diff(places, axis=0), axis=1).sum()


def test_a_free_way_leads_straight_to_the_goal():
    way = Way(Obstacles.from_polygons([SQUARE]), (300.0, 60.0))
    assert way.aim((-300.0, 60.0)) == pytest.approx([300.0, 60.0])
    assert way.memory == 0


@pytest.mark.parametrize(("east", "side"), [(10.0, 1), (-10.0, -1), (0.0, 1)])
def test_the_shorter_way_round_counts_and_of_equal_ways_the_right_hand_one(east, side):
    """Flying north, east is to the right."""
    way = Way(Obstacles.from_polygons([SQUARE]), (300.0, east))
    aim = way.aim((-300.0, east))
    assert side * aim[1] > 40.0
    assert aim[0] < 0.0


def test_the_side_is_kept_against_drifting_positions_until_the_other_one_is_much_shorter():
    for side in (1, -1):
        way = Way(Obstacles.from_polygons([SQUARE]), (300.0, 0.0))
        way.aim((-300.0, 30.0 * side))
        for east in (3.0, -3.0, 3.0, -3.0):
            assert side * way.aim((-300.0, east))[1] > 40.0
        assert side * way.aim((-60.0, -38.0 * side))[1] < -40.0


@settings(max_examples=100, deadline=None)
@given(st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 2.0 * math.pi), st.floats(1.0, 30.0), st.sampled_from([1.0, 3.0]))
def test_following_the_aim_leads_to_the_goal_outside_the_clearance(start, end, clearance, stretch):
    """A point that flies at its aim in steps of 2 m arrives, and comes hardly nearer than the clearance."""
    obstacles = Obstacles.from_polygons([SQUARE * [1.0, stretch / 3.0]])
    position = 150.0 * np.array([math.cos(start), math.sin(start)])
    goal = 150.0 * np.array([math.cos(end), math.sin(end)])
    places = Way(obstacles, goal, clearance).fly(position)
    assert np.linalg.norm(goal - places[-1]) < 1e-6
    assert signed_distance(obstacles, places).min() > 0.95 * clearance - 0.5


@pytest.mark.parametrize("bulge_m", [-1e-6, -1e-12, 0.0, 1e-12, 1e-6])
@pytest.mark.parametrize("corner", range(4))
def test_a_corner_that_is_straight_but_for_rounding_changes_no_way(corner, bulge_m):
    """Degrees and back make one of every third point on a wall."""
    plain = Obstacles.from_polygons([SQUARE])
    before, after = SQUARE[corner], SQUARE[(corner + 1) % 4]
    outward = np.array([after[1] - before[1], before[0] - after[0]]) / np.linalg.norm(after - before)
    bent = Obstacles.from_polygons([np.insert(SQUARE, corner + 1, (before + after) / 2.0 + bulge_m * outward, axis=0)])
    for position in ((-300.0, 10.0), (-60.0, 5.0), (50.0, 70.0), (45.0, -52.0)):
        here, there = (Way(obstacles, (300.0, 0.0)) for obstacles in (plain, bent))
        assert here.aim(position)[1] * there.aim(position)[1] >= 0.0
        assert length(there.fly(position)) == pytest.approx(length(here.fly(position)), abs=0.5)


@pytest.mark.parametrize("off_m", [0.5, 2.0, 8.0])
def test_who_is_nearer_than_the_clearance_finds_its_way_on_the_first_map(off_m):
    way = Way(Obstacles.from_polygons([SQUARE]), (300.0, 10.0))
    aim = way.aim((-40.0 - off_m, 10.0))
    assert way.memory > 0 and aim[1] > 40.0
    assert known(way.roadmap) == 1


def test_two_obstacles_in_a_row_are_passed_one_after_the_other():
    obstacles = Obstacles.from_polygons([SQUARE, SQUARE + np.array([200.0, 30.0])])
    places = Way(obstacles, (400.0, 0.0), 10.0).fly((-150.0, 0.0))
    assert places[-1] == pytest.approx([400.0, 0.0])
    assert signed_distance(obstacles, places).min() > 9.0


def test_inside_a_piece_the_way_leads_over_the_nearest_edge():
    aim = Way(Obstacles.from_polygons([SQUARE]), (0.0, -300.0)).aim((0.0, 30.0))
    assert aim[1] > 40.0 and aim[0] == pytest.approx(0.0)


@pytest.mark.parametrize("gap_m", [20.0, 30.0])
def test_a_gap_is_flown_through_if_it_is_wide_enough_and_otherwise_round_both_sides_of_it(gap_m):
    aside = np.array([0.0, 40.0 + gap_m / 2.0])
    obstacles = Obstacles.from_polygons([SQUARE - aside, SQUARE + aside])
    places = Way(obstacles, (200.0, 0.0)).fly((-200.0, 0.0))
    assert places[-1] == pytest.approx([200.0, 0.0])
    assert signed_distance(obstacles, places).min() > 11.5
    assert (np.abs(places[:, 1]).max() > 80.0) == (gap_m < 24.0)


@pytest.mark.parametrize("from_within", [False, True])
@pytest.mark.parametrize("outside", [(-150.0, 5.0), (150.0, -5.0), (10.0, 150.0)])
def test_bays_are_found_into_and_out_of(outside, from_within):
    obstacles = Obstacles.from_polygons([BAY])
    start, goal = ((-30.0, 0.0), outside) if from_within else (outside, (-30.0, 0.0))
    places = Way(obstacles, goal).fly(start)
    assert places[-1] == pytest.approx(goal)
    assert signed_distance(obstacles, places).min() > 11.5


def test_a_spiral_is_found_into_and_out_of():
    obstacles = Obstacles.from_polygons(SPIRAL)
    middle, outside = (40.0, 0.0), (-200.0, -50.0)
    into, out = Way(obstacles, middle).fly(outside), Way(obstacles, outside).fly(middle)
    assert into[-1] == pytest.approx(middle) and out[-1] == pytest.approx(outside)
    assert length(into) == pytest.approx(length(out), abs=3.0)
    assert length(into) > 600.0


def test_a_goal_that_cannot_be_reached_is_in_nobodys_sight():
    obstacles = Obstacles.from_polygons(wall((-50, -50), (50, -50), (50, 50), (-50, 50), (-50, -50)))
    way = Way(obstacles, (0.0, 0.0))
    assert way.aim((-300.0, 0.0)) == pytest.approx([0.0, 0.0])
    assert way.memory == waypoint.NO_WAY


@pytest.mark.parametrize("off_m", [6.0, 6.3, 6.49, 6.51])
def test_a_goal_within_the_clearance_is_found_wherever_it_is_between_whole_metres(off_m):
    """Ways to it keep as far off as it is itself, and not further than those do that were worked out to the metre."""
    obstacles = Obstacles.from_polygons(wall((0.0, -60.0), (0.0, 60.0)))
    places = Way(obstacles, (off_m, 0.0)).fly((-100.0, 5.0))
    assert places[-1] == pytest.approx([off_m, 0.0])
    assert signed_distance(obstacles, places).min() > 0.98 * (off_m - 1.5) - 0.1


@pytest.mark.parametrize("half_m", [5.0, 9.0, 11.0])
def test_who_starts_between_walls_that_are_too_near_gets_out_and_nobody_gets_in(half_m):
    """A street in which the clearance of 9.5 m, with its buffer, is nowhere; the goal is beyond one of its walls."""
    obstacles = Obstacles.from_polygons([SQUARE * [0.2, 1.5] + [side * (half_m + 8.0), 0.0] for side in (-1.0, 1.0)])
    for start, goal in (((0.0, 10.0), (half_m + 60.0, 0.0)), ((0.0, -150.0), (0.0, 0.0))):
        solver, position, command, route, nearest = HalfplaneSolver(), np.array(start), np.zeros(2), 0, math.inf
        for _ in range(400):
            decision = solver.solve(
                OwnShip(position, command, command, 1.0, 10.0), no_traffic(), goal_ne_m=goal, cruise_mps=10.0,
                obstacles=obstacles, own_clearance_m=9.5, route=route,
            )  # fmt: skip
            route, command = decision.route, decision.command_ne_mps
            position = position + 0.1 * command
            nearest = min(nearest, signed_distance(obstacles, position))
        assert (np.linalg.norm(position - goal) < 5.0) == (start[1] > 0.0)
        assert nearest > min(half_m, 9.5) - 0.2


def no_traffic():
    pairs, ones = np.zeros((0, 2)), np.zeros(0)
    return Traffic(pairs, pairs, pairs, ones, ones, ones, ones.astype(np.bool_), ones.astype(np.int8))


def scattered(random):
    """Some obstacles, a start and a goal outside of them, as random as can be."""
    polygons = []
    for _ in range(int(random.integers(1, 6))):
        corner = np.sort(random.uniform(-math.pi, math.pi, int(random.integers(3, 8))))
        if not np.diff(corner).min() > 0.2 or not np.diff(corner, append=corner[0] + 2.0 * math.pi).max() < 3.0:
            continue
        radius = random.uniform(10.0, 60.0) * random.choice([1.0, 0.4], len(corner))
        ring = radius[:, None] * np.stack([np.cos(corner), np.sin(corner)], axis=1)
        polygons.append(random.uniform(-120.0, 120.0, 2) + ring)
    obstacles = Obstacles.from_polygons(polygons)
    while True:
        ends = random.uniform(-180.0, 180.0, (2, 2))
        if not polygons or signed_distance(obstacles, ends).min() > 8.0:
            return obstacles, *ends


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), clearance=st.floats(0.5, 20.0))
def test_in_sight_is_what_no_piece_comes_near(seed, clearance):
    random = np.random.default_rng(seed)
    obstacles, start, goal = scattered(random)
    keep = np.zeros((ways.ROUND * len(obstacles.piece_vertex_ne_m), ways.KEEP_COLUMNS))
    enclose(obstacles.pieces, keep)
    keep[: obstacles.piece_count, ways.KEEP] = clearance
    between = start + np.linspace(0.0, 1.0, 1000)[:, None] * (goal - start)
    nearest = signed_distance(obstacles, between).min() if obstacles.piece_count else math.inf
    if abs(nearest - clearance) > 0.2 and signed_distance(obstacles, np.stack([start, goal])).min() > clearance:
        assert in_sight(obstacles.pieces, keep, *start, *goal) == (nearest > clearance)


def shortest_on_a_grid(obstacles, start, goal, clearance, step_m=4.0):
    """Length of the shortest way in steps to sixteen sides, infinite if there is none (A*)."""
    places = np.arange(-260.0, 260.0 + step_m, step_m)
    grid = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1)
    around = np.pad(signed_distance(obstacles, grid) > clearance, 2)  # no step leads over two rows that are not free
    width = len(around)
    free = around.ravel().tolist()
    (north, east), there = (np.rint((np.array(end) + 260.0) / step_m).astype(int) + 2 for end in (start, goal))
    offset = np.indices(around.shape) - there[:, None, None]
    straight = (step_m * np.hypot(*offset)).ravel().tolist()
    here, there = int(north * width + east), int(there[0] * width + there[1])
    sides = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if math.gcd(i, j) == 1]
    steps = [(i * width + j, step_m * math.hypot(i, j)) for i, j in sides]
    least, queue = {here: 0.0}, [(straight[here], 0.0, here)]
    while queue:
        _, so_far, place = heapq.heappop(queue)
        if place == there:
            return so_far
        if so_far > least[place]:
            continue
        for step, further in steps:
            following, longer = place + step, so_far + further
            if free[following] and longer < least.get(following, math.inf):
                least[following] = longer
                heapq.heappush(queue, (longer + straight[following], longer, following))
    return math.inf


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_among_any_obstacles_the_way_is_as_short_as_any(seed):
    """Whatever way a grid finds with more clearance, there is one, and it is no longer than that."""
    clearance = 5.0
    obstacles, start, goal = scattered(np.random.default_rng(seed))
    if not obstacles.piece_count:
        return
    places = Way(obstacles, goal, clearance).fly(start)
    known = shortest_on_a_grid(obstacles, start, goal, clearance + 4.0)
    if math.isfinite(known):
        assert places[-1] == pytest.approx(goal)
        assert length(places) <= 1.02 * known + 8.0
        assert signed_distance(obstacles, places).min() > 0.9 * clearance - 0.5


def known(roadmap):
    """How many ways are on a map."""
    return int((roadmap.keys[:, :-1] != NO_KEY).sum())


def ways_at(obstacles, roadmap, goal, clearance=12.0, width=0, margin=3.0):
    """The ways to a goal, as the table has them."""
    where = ways_to(obstacles.pieces, roadmap, *goal, int(clearance * STEPS_PER_M), width, margin, np.zeros(2))
    return roadmap.table[where]


def test_a_roadmap_works_out_what_is_new_and_keeps_the_rest():
    obstacles = Obstacles.from_polygons([BAY, SQUARE + 200.0])
    here = new_roadmap(obstacles)
    assert known(here) == 0
    first = ways_at(obstacles, here, (0.0, 10.0))
    assert first[0, ways.OFF] == 15.0
    first[0, ways.OFF] = -1.0
    for goal, clearance in (((0.0, 10.0), 12.0), ((0.2, 9.7), 12.0), ((0.0, 10.0), 12.4)):
        assert ways_at(obstacles, here, goal, clearance)[0, ways.OFF] == -1.0
        assert known(here) == 1
    for goal, clearance, width, off in (
        ((0.6, 10.0), 12.0, 0, 15.0), ((0.0, 10.0), 12.6, 0, 15.5), ((0.0, 10.0), 12.0, 1, 12.0),
        ((0.0, 10.0), 12.0, 2, 3.0),
    ):  # fmt: skip
        before = known(here)
        assert ways_at(obstacles, here, goal, clearance, width)[0, ways.OFF] == off
        assert known(here) == before + 1


def test_ways_do_not_fill_the_memory_and_are_the_same_whoever_else_asked():
    obstacles = Obstacles.from_polygons([SQUARE])
    crowded, random = new_roadmap(obstacles), np.random.default_rng(5)
    room = crowded.table.shape[0]
    for goal in np.array([200.0, 0.0]) + random.normal(0.0, 40.0, (3 * room, 2)):
        ways_at(obstacles, crowded, goal)
    assert 0.99 * room < known(crowded) <= room == crowded.table.shape[0]
    for goal in np.array([200.0, 0.0]) + random.normal(0.0, 40.0, (50, 2)):
        expected = ways_at(obstacles, new_roadmap(obstacles), goal)
        assert np.array_equal(ways_at(obstacles, crowded, goal), expected)
        assert np.array_equal(ways_at(obstacles, crowded, goal), expected)


@pytest.mark.parametrize("count", [0, 1, 30, 400])
def test_the_more_obstacles_there_are_the_fewer_ways_are_kept(count):
    """And keys reach all shelves."""
    obstacles = Obstacles.from_polygons([SQUARE + 100.0 * np.array([k // 20, k % 20]) for k in range(count)])
    here = new_roadmap(obstacles)
    assert len(here.table) == roadmap.SHELF * len(here.keys)
    assert math.gcd(len(here.keys), 6) == 1
    assert roadmap.LEAST_WAYS / 2 <= len(here.table) <= 2 * roadmap.MOST_WAYS or not count
    assert count < 30 or here.table.nbytes < 3 * max(roadmap.MOST_BYTES, roadmap.LEAST_WAYS * here.table[0].nbytes)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), clearance=st.floats(0.0, 15.0))
def test_where_the_goal_is_in_sight_no_map_is_asked_for_and_would_say_the_same(seed, clearance):
    obstacles, start, goal = scattered(np.random.default_rng(seed))
    if not obstacles.piece_count:
        return
    way = Way(obstacles, goal, clearance)
    aim = way.aim(start)
    if not known(way.roadmap):
        assert way.memory == 0 and aim.tolist() == goal.tolist()
        table = ways_at(obstacles, way.roadmap, goal, clearance, margin=0.0)
        assert choose_way(obstacles.pieces, way.roadmap, table, *start, *goal, 0) == 0


def test_without_obstacles_there_are_no_ways_whatever_there_was_before():
    none, no_kind = np.zeros((0, 2)), np.zeros(0)
    alone = Traffic(none, none, none, no_kind, no_kind, no_kind, np.zeros(0, np.bool_), np.zeros(0, np.int8))
    own = OwnShip(np.array([-100.0, 0.0]), np.zeros(2), np.zeros(2), 0.6, 10.0)
    solver, ask = HalfplaneSolver(), {"goal_ne_m": (100.0, 0.0), "cruise_mps": 5.0}
    for _ in range(2):
        round_it = solver.solve(own, alone, obstacles=Obstacles.from_polygons([SQUARE]), **ask)
        assert round_it.route > 0 and abs(round_it.preferred_ne_mps[1]) > 1.0
        straight = solver.solve(own, alone, **ask)
        assert straight.route == 0 and straight.preferred_ne_mps == pytest.approx([5.0, 0.0])


@pytest.mark.parametrize("moved", [(0.0, 0.0), (123.4, -56.7)])
def test_ways_move_with_the_origin(moved):
    """A daemon tells its obstacles about its own position, wherever that is."""
    layout, position = Obstacles.from_polygons([BAY]), np.array([-150.0, 5.0])
    way = Way(layout, (-30.0, 0.0))
    expected = way.aim(position)
    way.obstacles, way.goal = Obstacles.from_polygons([BAY + moved]), way.goal + moved
    assert way.aim(position + moved) - moved == pytest.approx(expected, abs=1e-6)
    assert known(way.roadmap) == 1


@pytest.mark.parametrize("origin", [(5.4e6, 4e5), (-6e5, 6e5), (1e8, -1e8)])
def test_ways_are_found_wherever_the_origin_is(origin):
    """As where north is counted from the equator."""
    start, goal = np.array([-30.0, 0.0]), np.array([-150.0, 5.0])
    expected = Way(Obstacles.from_polygons([BAY]), goal).fly(start)
    places = Way(Obstacles.from_polygons([BAY + origin]), goal + origin).fly(start + origin) - origin
    assert length(expected) > 250.0
    assert places == pytest.approx(expected, abs=1e-3)


def test_ways_keep_to_their_corners_where_north_is_another_direction():
    """It is, of a daemon that has flown some hundred metres: what is far from the first corner is not where it was."""
    turn, far = 2e-4, np.array([2000.0, 2000.0])
    turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    here = Obstacles.from_polygons([SQUARE @ turned, (SQUARE + far) @ turned])
    beyond = far + np.array([200.3, 5.0])
    way, goal, position = Way(here, beyond @ turned), beyond @ turned, (far - np.array([200.0, 5.0])) @ turned
    way.roadmap = new_roadmap(Obstacles.from_polygons([SQUARE, SQUARE + far]))
    aim = way.aim(position)
    assert way.memory > 0
    assert aim == pytest.approx(Way(here, goal).aim(position), abs=0.05)


def test_a_goal_is_known_by_its_nearest_corner_where_north_is_another_direction():
    """As seen from the first corner it is 4 m off."""
    turn, far = 2e-3, np.array([2000.0, 2000.0])
    turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    plain, goal = Obstacles.from_polygons([SQUARE, SQUARE + far]), far + np.array([200.0, 5.0])
    here = new_roadmap(plain)
    ways_at(plain, here, goal)
    ways_at(Obstacles.from_polygons([SQUARE @ turned, (SQUARE + far) @ turned]), here, goal @ turned)
    assert known(here) == 1


def test_whoever_has_no_goal_needs_no_map():
    obstacles, solver = Obstacles.from_polygons([SQUARE]), HalfplaneSolver()
    own = OwnShip(np.array([-100.0, 0.0]), np.zeros(2), np.zeros(2), 0.6, 10.0)
    solver.solve(own, no_traffic(), preferred_ne_mps=(5.0, 0.0), cruise_mps=5.0, obstacles=obstacles)
    assert known(solver._roadmap) == 0
    solver.solve(own, no_traffic(), goal_ne_m=(100.0, 0.0), cruise_mps=5.0, obstacles=obstacles)
    assert known(solver._roadmap) > 0
