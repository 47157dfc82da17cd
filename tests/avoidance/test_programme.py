"""The two-dimensional programme against brute force."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance import programme
from ridlink.avoidance.programme import new_choice, new_lines, padded
from tests.avoidance.way_in import way_in

nearest_admissible = way_in(programme.nearest_admissible)

LIMIT = 10.0
half_planes = st.lists(st.tuples(st.floats(0.0, 2.0 * math.pi), st.floats(-9.0, 9.0)), min_size=0, max_size=8).map(
    lambda rows: np.array([(math.cos(a), math.sin(a), d) for a, d in rows]).reshape(-1, 3)
)
velocities = st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0)).map(np.array)


def grid(step=0.1):
    axis = np.arange(-LIMIT, LIMIT + step / 2, step)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return points[np.linalg.norm(points, axis=1) <= LIMIT]


GRID = grid()


def solve(rows, preferred, hard=0):
    lines, point, first = new_lines(hard, len(rows) - hard), np.zeros(2), padded(hard)
    chosen, work = new_choice(lines.shape[1]), new_choice(lines.shape[1])
    lines[:3, :hard] = rows[:hard].T
    lines[:3, first : first + len(rows) - hard] = rows[hard:].T
    preferred = np.asarray(preferred, float)
    met = nearest_admissible(lines, 0, 0, first, lines.shape[1], LIMIT, preferred, chosen, work, point)
    return bool(met), point


def slack(rows, points):
    return (points @ rows[:, :2].T - rows[:, 2]).min(axis=-1) if len(rows) else np.full(len(points), np.inf)


@settings(max_examples=150, deadline=None)
@given(half_planes, velocities)
def test_the_optimum_is_admissible_and_no_grid_point_is_better(rows, preferred):
    met, point = solve(rows, preferred)
    assert np.linalg.norm(point) <= LIMIT + 1e-9
    admissible = GRID[slack(rows, GRID) >= 0.0]
    if met:
        assert slack(rows, point[None])[0] >= -1e-6
        if len(admissible):
            best = np.linalg.norm(admissible - preferred, axis=1).min()
            assert np.linalg.norm(point - preferred) <= best + 1e-9
    else:
        assert len(admissible) == 0 or slack(rows, admissible).max() < 1e-6


@settings(max_examples=150, deadline=None)
@given(half_planes, velocities)
def test_where_nothing_is_admissible_no_grid_point_exceeds_less(rows, preferred):
    met, point = solve(rows, preferred)
    if met:
        return
    assert np.linalg.norm(point) <= LIMIT + 1e-9
    assert slack(rows, point[None])[0] >= slack(rows, GRID).max() - 1e-6


@settings(max_examples=150, deadline=None)
@given(half_planes, st.tuples(st.floats(0.0, 2.0 * math.pi), st.floats(-9.0, 9.0)), velocities)
def test_the_hard_half_plane_is_met_whatever_the_others_ask(rows, hard, preferred):
    wall = np.array([[math.cos(hard[0]), math.sin(hard[0]), hard[1]]])
    met, point = solve(np.concatenate([wall, rows]), preferred, hard=1)
    assert slack(wall, point[None])[0] >= -1e-6
    if not met:
        allowed = GRID[slack(wall, GRID) >= 0.0]
        if len(allowed) and len(rows):
            assert slack(rows, point[None])[0] >= slack(rows, allowed).max() - 1e-6


def test_hard_half_planes_that_contradict_each_other_share_the_excess():
    walls = np.array([[1.0, 0.0, 2.0], [-1.0, 0.0, 2.0]])
    met, point = solve(walls, [5.0, 3.0], hard=2)
    assert not met
    assert np.allclose(point, [0.0, 3.0], atol=1e-5)


def test_two_opposite_half_planes_leave_the_middle():
    met, point = solve(np.array([[1.0, 0.0, 3.0], [-1.0, 0.0, -1.0]]), [0.0, 4.0])
    assert not met
    assert np.isclose(point[0], 2.0)
