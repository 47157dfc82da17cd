"""Static obstacles: validation, convex pieces and distances."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import OwnShip, Traffic, keep_out
from ridlink.avoidance.obstacles import Obstacles, signed_area
from tests.avoidance.encounters import SOLVER
from tests.avoidance.way_in import way_in

nearest_point = way_in(keep_out.nearest_point)

SQUARE = np.array([[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]])
NOTCHED = np.array(
    [[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [20.0, 30.0], [20.0, 10.0], [10.0, 10.0], [10.0, 30.0], [0.0, 30.0]]
)
KEYHOLE = [[0, 0], [9, 0], [9, 9], [3, 3], [6, 3], [3, 6], [3, 3], [9, 9], [0, 9]]
L_SHAPE = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [10.0, 10.0], [10.0, 20.0], [0.0, 20.0]])


def rings(flat, start):
    return [flat[a:b] for a, b in pairwise(start)]


@pytest.mark.parametrize("shape", [SQUARE, NOTCHED, L_SHAPE], ids=["square", "notched", "L"])
@pytest.mark.parametrize("reverse", [False, True])
def test_pieces_are_convex_and_cover_the_polygon(shape, reverse):
    obstacles = Obstacles.from_polygons([shape[::-1] if reverse else shape])
    pieces = rings(obstacles.piece_vertex_ne_m, obstacles.piece_start)
    assert sum(signed_area(piece) for piece in pieces) == pytest.approx(abs(signed_area(shape)))
    for piece in pieces:
        assert signed_area(piece) > 0.0
        edge = np.roll(piece, -1, axis=0) - piece
        following = np.roll(edge, -1, axis=0)
        assert np.all(edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0] >= 0.0)


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
        (np.zeros((0, 2)), "three distinct vertices, got 0"),
        ([[1.0, 1.0]], "three distinct vertices, got 1"),
        ([[0.0, 0.0], [1.0, 1.0]], "three distinct vertices, got 2"),
        ([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0]], "three distinct"),
        ([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], "no area"),
        ([[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 3.0]], "crosses or touches itself, on its edge from vertex 1$"),
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
    with pytest.raises(ValueError, match=f"obstacle 2 .*{reason}"):
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


WALL = Obstacles.from_polygons([[(0, -400), (80, -400), (80, 400), (0, 400)]])
CORNER = Obstacles.from_polygons(
    [[(0, -400), (80, -400), (80, 400), (0, 400)], [(-400, 0), (0, 0), (0, 80), (-400, 80)]]
)


def sent_elsewhere(obstacles, position, velocity, goal):
    """The velocity asked of a vehicle that would keep 3 m, with a buffer of 1 m."""
    own = OwnShip(np.array(position), np.array(velocity), np.array(velocity), 0.6, 15.0)
    return SOLVER.solve(
        own, Traffic.empty(), goal_ne_m=goal, cruise_mps=15.0, obstacles=obstacles, own_clearance_m=3.0
    ).velocity_ne_mps  # fmt: skip


@given(along=st.floats(-10.0, 10.0), goal=st.floats(-300.0, 300.0))
def test_who_comes_as_fast_as_it_can_stop_turns_no_more_than_braking_leaves(along, goal):
    """At 8 m/s it stops in 8 m/s (1 s + 0.6 s) + 16 m: of 2.5 m/s^2, which it has in all, 2 must brake."""
    velocity = np.array([8.0, along])
    change = sent_elsewhere(WALL, (-(4.0 + 8.0 * 1.6 + 16.0), 0.0), velocity, (-30.0, goal)) - velocity
    assert -change[0] >= 0.77 * np.linalg.norm(change) - 1e-6


@given(along=st.floats(-12.0, 12.0), goal=st.sampled_from([-300.0, 300.0]))
def test_who_flies_along_an_obstacle_turns_freely(along, goal):
    found = sent_elsewhere(WALL, (-8.0, 0.0), (0.0, along), (-8.0, goal))
    assert found[1] == pytest.approx(math.copysign(15.0, goal), abs=0.3)


@given(st.floats(0.0, 2.0 * math.pi))
def test_in_a_corner_the_way_out_stays_open(angle):
    """Both walls ask for more than the vehicle has: it brakes, and turns neither into the one nor into the other."""
    goal = (-150.0 + 100.0 * math.cos(angle), -150.0 + 100.0 * math.sin(angle))
    found = sent_elsewhere(CORNER, (-32.0, -32.0), (8.0, 8.0), goal)
    assert found[0] < 1.0
    assert found[1] < 1.0
