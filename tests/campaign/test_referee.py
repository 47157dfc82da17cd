"""Who is judged to have collided."""

import math

import numpy as np
import pytest

from ridlink.avoidance.obstacles import Obstacles
from ridlink.campaign.referee import judge_worlds
from ridlink.campaign.stepping import is_inside


def judged(before, after, airframe=(2.0, 2.0), present=(True, True), swept=False):
    hit = np.zeros((1, 2), bool)
    distance, margin = np.full(1, np.inf), np.full(1, np.inf)
    judge_worlds(
        np.array([before], float), np.array([after], float), np.array([present]), np.array([airframe]), swept, hit,
        distance, margin,
    )  # fmt: skip
    return hit[0].tolist(), distance[0], margin[0]


def test_airframes_that_touch_have_collided():
    here = [(0.0, 0.0), (0.0, 1.99)]
    assert judged(here, here)[0] == [True, True]
    assert judged(here, [(0.0, 0.0), (0.0, 2.01)]) == ([False, False], 2.01, pytest.approx(0.01))
    assert judged(here, here, present=(True, False)) == ([False, False], math.inf, math.inf)


def test_only_a_swept_judgement_sees_what_happens_between_two_instants():
    before, after = [(0.0, 0.0), (3.0, 0.5)], [(3.0, 0.0), (0.0, 0.5)]
    assert judged(before, after)[0] == [False, False]
    hit, distance, margin = judged(before, after, swept=True)
    assert hit == [True, True]
    assert distance == pytest.approx(0.5)
    assert margin == pytest.approx(-1.5)


def test_points_in_an_obstacle():
    walls = Obstacles.from_polygons([[(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)]])
    points = np.array([[1.0, 0.5], [2.0, 3.0], [0.2, 3.0], [5.0, 0.5]])
    assert is_inside(walls, points).tolist() == [True, False, True, False]
