"""Own-ships and crowds by a few numbers, or drawn, and what a solver answers."""

import math

import numpy as np
from hypothesis import strategies as st

from ridlink.avoidance import Obstacles, OwnShip, Traffic
from ridlink.avoidance.solver import HalfplaneSolver

SOLVER = HalfplaneSolver()
GOAL = (1000.0, 0.0)
SQUARE = Obstacles.from_polygons([[[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]])


def own_ship(position=(0.0, 0.0), velocity=(10.0, 0.0), command=None, limit=10.0):
    told = velocity if command is None else command
    return OwnShip(np.array(position), np.array(velocity), np.array(told), 1.0, limit)


def traffic(*rows, radius=24.0, error=21.0, age=0.0, reciprocal=True, command=(math.nan, math.nan)):
    """Neighbours at (north, east) with velocity (north, east)."""
    table = np.array(rows, float).reshape(-1, 4)
    count = len(table)
    return Traffic(
        table[:, :2], table[:, 2:], np.tile(command, (count, 1)), np.full(count, age), np.full(count, radius),
        np.full(count, error), np.full(count, reciprocal), np.zeros(count, np.int8),
    )  # fmt: skip


def solve(own, others, solver=SOLVER, **options):
    return solver.solve(own, others, **({"goal_ne_m": GOAL, "cruise_mps": 10.0} | options))


def turned(vectors, angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(vectors) @ np.array([[c, s], [-s, c]])


coordinate = st.floats(-300.0, 300.0)
speed = st.floats(-12.0, 12.0)
neighbour = st.tuples(coordinate, coordinate, speed, speed)
crowd = st.lists(neighbour, min_size=0, max_size=12)


def drawn_crowd(seed, most=9):
    random = np.random.default_rng(seed)
    count = int(random.integers(0, most + 1))
    return np.hstack([random.uniform(-200.0, 200.0, (count, 2)), random.uniform(-12.0, 12.0, (count, 2))])
