"""Static obstacles: validation, convex pieces, distances and the way round."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import keep_out, route
from ridlink.avoidance.obstacles import Obstacles, convex_hull, signed_area
from ridlink.avoidance.route import ring_size
from tests.avoidance.way_in import way_in

nearest_point, route_aim = way_in(keep_out.nearest_point), way_in(route.route_aim)

SQUARE = np.array([[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]])
NOTCHED = np.array(
    [[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [20.0, 30.0], [20.0, 10.0], [10.0, 10.0], [10.0, 30.0], [0.0, 30.0]]
)
KEYHOLE = [[0, 0], [9, 0], [9, 9], [3, 3], [6, 3], [3, 6], [3, 3], [9, 9], [0, 9]]
L_SHAPE = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [10.0, 10.0], [10.0, 20.0], [0.0, 20.0]])


def rings(flat, start):
    return [flat[a:b] for a, b in pairwise(start)]


def aim_at(obstacles, position, goal, clearance=12.0, memory=0):
    aim, ring = np.zeros(2), np.zeros((ring_size(obstacles.hull_start), 2))
    memory = route_aim(obstacles.hulls, *position, *goal, clearance, memory, ring, aim)
    return aim, memory


@pytest.mark.parametrize("shape", [SQUARE, NOTCHED, L_SHAPE], ids=["square", "notched", "L"])
@pytest.mark.parametrize("reverse", [False, True])
def test_pieces_are_convex_and_cover_the_polygon(shape, reverse):
    obstacles = Obstacles.from_polygons([shape[::-1] if reverse else shape])
    pieces = rings(obstacles.piece_vertex_ne_m, obstacles.piece_start)
    assert sum(signed_area(piece) for piece in pieces) == pytest.approx(abs(signed_area(shape)))
    for piece in pieces:
        assert signed_area(piece) > 0.0
        assert signed_area(convex_hull(piece)) == pytest.approx(signed_area(piece))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(1.0, 50.0), min_size=3, max_size=30), st.tuples(*[st.floats(-1e4, 1e4)] * 2), st.booleans(),
)  # fmt: skip
def test_no_area_is_lost_of_any_star(radii, middle, reverse):
    """Seen from its middle every polygon of these is simple, however jagged."""
    angle = np.linspace(0.0, 2.0 * math.pi, len(radii), endpoint=False)
    star = np.array(middle) + np.array(radii)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    obstacles = Obstacles.from_polygons([star[::-1] if reverse else star])
    pieces = rings(obstacles.piece_vertex_ne_m, obstacles.piece_start)
    assert sum(map(signed_area, pieces)) == pytest.approx(signed_area(star), rel=1e-6)


def test_a_convex_polygon_stays_one_piece_and_an_l_needs_two():
    assert Obstacles.from_polygons([SQUARE]).piece_count == 1
    assert Obstacles.from_polygons([L_SHAPE]).piece_count == 2
    assert Obstacles.from_polygons([SQUARE, L_SHAPE + 500.0]).piece_count == 3


@pytest.mark.parametrize(
    ("polygon", "reason"),
    [
        ([[0.0, 0.0], [1.0, 1.0]], "three distinct"),
        ([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0]], "three distinct"),
        ([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], "no area"),
        ([[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 3.0]], "crosses or touches itself"),
        # An hourglass whose halves share a corner, a line that stands on a wall, a hole that a line leads to, and a
        # square that is gone round twice: pieces of these lacked half of the area or all of it.
        ([[0.0, 0.0], [5.0, 5.0], [0.0, 10.0], [10.0, 10.0], [5.0, 5.0], [10.0, 0.0]], "touches itself"),
        ([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [5.0, 9.0], [5.0, 15.0], [5.0, 9.0], [0.0, 9.0]], "touches itself"),
        (KEYHOLE, "touches itself"),
        ([*SQUARE.tolist(), *SQUARE.tolist()], "touches itself"),
        ([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [5.0, 0.0], [0.0, 9.0]], "touches itself"),
        ([[0.0, 0.0], [1.0, math.nan], [2.0, 0.0]], "finite .* got .1.0, nan"),
        ([[0.0, 0.0], [0.0, 1e200], [2.0, 0.0]], "within 1e.09, got .0.0, 1e.200"),
        ([0.0, 1.0, 2.0], "shape"),
    ],
)
def test_a_degenerate_polygon_is_refused_by_its_number(polygon, reason):
    with pytest.raises(ValueError, match=f"obstacle 1 .*{reason}"):
        Obstacles.from_polygons([SQUARE, polygon])


@pytest.mark.parametrize(
    ("point", "distance", "normal"),
    [
        ((50.0, 0.0), 10.0, (1.0, 0.0)),
        ((0.0, -43.0), 3.0, (0.0, -1.0)),
        ((43.0, 44.0), 5.0, (0.6, 0.8)),
        ((35.0, 0.0), -5.0, (1.0, 0.0)),
        ((40.0, 0.0), 0.0, (1.0, 0.0)),
    ],
)
def test_distance_is_signed_and_the_normal_leads_out(point, distance, normal):
    found = np.zeros(2)
    assert nearest_point(SQUARE, 0, 4, *point, found) == pytest.approx(distance)
    assert found == pytest.approx(normal)


def test_a_free_way_leads_straight_to_the_goal():
    obstacles = Obstacles.from_polygons([SQUARE])
    aim, memory = aim_at(obstacles, (-300.0, 60.0), (300.0, 60.0))
    assert aim == pytest.approx([300.0, 60.0])
    assert memory == 0


@pytest.mark.parametrize(("east", "side"), [(10.0, 1), (-10.0, -1), (0.0, 1)])
def test_the_shorter_way_round_counts_and_of_equal_ways_the_right_hand_one(east, side):
    """Flying north, east is to the right."""
    obstacles = Obstacles.from_polygons([SQUARE])
    aim, memory = aim_at(obstacles, (-300.0, east), (300.0, east))
    assert memory == side
    assert side * aim[1] > 40.0
    assert aim[0] < 0.0


def test_the_side_is_kept_against_drifting_positions():
    obstacles = Obstacles.from_polygons([SQUARE])
    for east in (-3.0, 3.0):
        for memory in (1, -1):
            assert aim_at(obstacles, (-300.0, east), (300.0, east), memory=memory)[1] == memory
    assert aim_at(obstacles, (-60.0, 38.0), (300.0, 38.0), memory=-1)[1] == 1


@settings(max_examples=100, deadline=None)
@given(st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 2.0 * math.pi), st.floats(1.0, 30.0), st.sampled_from([1.0, 3.0]))
def test_following_the_aim_leads_to_the_goal_outside_the_clearance(start, end, clearance, stretch):
    """A point that flies at its aim in steps of 2 m arrives, and comes no nearer than the chords of the corners
    allow."""
    obstacles = Obstacles.from_polygons([SQUARE * [1.0, stretch / 3.0]])
    position = 150.0 * np.array([math.cos(start), math.sin(start)])
    goal = 150.0 * np.array([math.cos(end), math.sin(end)])
    found, memory, nearest = np.zeros(2), 0, math.inf
    for _ in range(600):
        aim, memory = aim_at(obstacles, position, goal, clearance, memory)
        way = aim - position
        length = np.linalg.norm(way)
        position = position + way * min(2.0 / max(length, 1e-9), 1.0)
        vertices = obstacles.piece_vertex_ne_m
        nearest = min(nearest, nearest_point(vertices, 0, len(vertices), *position, found))
        if np.linalg.norm(goal - position) < 1e-6:
            break
    assert np.linalg.norm(goal - position) < 1e-6
    assert nearest > 0.9 * clearance - 0.5


@pytest.mark.parametrize("bulge_m", [-1e-6, -1e-12, 0.0, 1e-12, 1e-6])
@pytest.mark.parametrize("corner", range(4))
def test_a_corner_that_is_straight_but_for_rounding_changes_no_way(corner, bulge_m):
    """Degrees and back make one of every third point on a wall."""
    plain = Obstacles.from_polygons([SQUARE])
    before, after = SQUARE[corner], SQUARE[(corner + 1) % 4]
    outward = np.array([after[1] - before[1], before[0] - after[0]]) / np.linalg.norm(after - before)
    hull = np.insert(SQUARE, corner + 1, (before + after) / 2.0 + bulge_m * outward, axis=0)
    bent = replace(plain, hull_vertex_ne_m=hull, hull_start=np.array([0, 5]))
    for position in ((-300.0, 10.0), (-60.0, 5.0), (50.0, 70.0), (45.0, -52.0)):
        aim, side = aim_at(plain, position, (300.0, 0.0), 12.0)
        assert aim_at(bent, position, (300.0, 0.0), 12.0)[1] == side
        assert aim_at(bent, position, (300.0, 0.0), 12.0)[0] == pytest.approx(aim, abs=0.01)


def test_two_obstacles_in_a_row_are_passed_one_after_the_other():
    obstacles = Obstacles.from_polygons([SQUARE, SQUARE + np.array([200.0, 30.0])])
    position, memory, found = np.array([-150.0, 0.0]), 0, np.zeros(2)
    for _ in range(600):
        aim, memory = aim_at(obstacles, position, (400.0, 0.0), 10.0, memory)
        way = aim - position
        position = position + way * min(2.0 / max(np.linalg.norm(way), 1e-9), 1.0)
        for first in (0, 4):
            assert nearest_point(obstacles.hull_vertex_ne_m, first, first + 4, *position, found) > 8.0
    assert position == pytest.approx([400.0, 0.0])


def test_inside_a_polygon_the_way_leads_over_the_nearest_edge():
    obstacles = Obstacles.from_polygons([SQUARE])
    aim, _ = aim_at(obstacles, (0.0, 30.0), (0.0, -300.0))
    assert aim[1] > 40.0 and aim[0] == pytest.approx(0.0)
