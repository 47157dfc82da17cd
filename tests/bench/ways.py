"""What ways round obstacles cost, as CPU time of a decision among square blocks: ``python -m tests.bench.ways``.

A new goal's distances are worked out within one decision, which must not make a daemon miss its setpoints.
"""

from __future__ import annotations

import math
import statistics
from functools import partial
from typing import Any

import numpy as np

from ridlink.avoidance import Obstacles
from ridlink.avoidance.solver import HalfplaneSolver, warm_up
from ridlink.avoidance.types import OwnShip, Traffic
from tests.bench.measure import ROUNDS, cpu_seconds

SIDES = (1, 4, 10, 20)
"""Blocks along one side of the square that they stand in."""
SPACING_M, HALF_M = 80.0, 20.0
DECISIONS = 100
"""Of those whose goal is known, taken together: the clock for CPU time is coarse."""


def blocks(side: int) -> Obstacles:
    """`side` x `side` blocks."""
    corners = HALF_M * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    places = SPACING_M * np.array([(i, j) for i in range(side) for j in range(side)])
    return Obstacles.from_polygons((place + corners).tolist() for place in places)


def measured(side: int) -> dict[str, Any]:
    """Median time of a decision to a goal that is new, and to one that is known, across all blocks."""
    obstacles, nobody = blocks(side), Traffic.empty()
    south_west, north_east = -SPACING_M / 2.0, SPACING_M * (side - 0.5)
    own = OwnShip(np.full(2, south_west), np.zeros(2), np.zeros(2), 0.6, 10.0)
    new, known = [], []
    for turn in range(ROUNDS):
        solver, goal = HalfplaneSolver(), (north_east, north_east + 2.0 * turn)

        def decide(times: int, solver: HalfplaneSolver = solver, goal: tuple[float, float] = goal) -> None:
            for _ in range(times):
                solver.solve(own, nobody, goal_ne_m=goal, cruise_mps=10.0, obstacles=obstacles)

        decide(1, goal=(south_west, south_west))
        new.append(cpu_seconds(partial(decide, 1)))
        known.append(cpu_seconds(partial(decide, DECISIONS)) / DECISIONS)
    return {
        "blocks": side * side, "new_goal_s": statistics.median(new), "new_goal_max_s": max(new),
        "known_goal_s": statistics.median(known),
    }  # fmt: skip


def report() -> dict[str, list[dict[str, Any]]]:
    """Print the table."""
    warm_up()
    print(f"\nways round square blocks {SPACING_M:.0f} m apart, CPU time of a decision, median of {ROUNDS} rounds")
    print(f"{'blocks':>8}{'a new goal':>14}{'any other':>12}")
    rows = [measured(side) for side in SIDES]
    for row in rows:
        print(f"{row['blocks']:>8}{1e3 * row['new_goal_s']:>11.2f} ms{1e6 * row['known_goal_s']:>9.0f} us")
    few, many = rows[-2:]
    power = math.log(many["new_goal_s"] / few["new_goal_s"]) / math.log(many["blocks"] / few["blocks"])
    print(f"a new goal costs the number of blocks to the power of {power:.1f}")
    return {"ways": rows}


if __name__ == "__main__":
    report()
