"""The two crowds that RVO2 ships as examples, flown without any error: python -m tests.avoidance.study_rvo2.

Circle: 250 agents on a circle of 200 m, discs of 1.5 m, 2 m/s, to the opposite side. Blocks: four groups of 25 with
discs of 2 m that cross between four square blocks of 30 m to a common point behind; within 20 m of it they have
arrived. Steps of 0.25 s, neighbours within 15 m, horizons of 10 and 5 s as there; who has arrived leaves.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ridlink.campaign.plan import IDEAL_HALFPLANES
from tests.avoidance.exact import Flown, fly, on_circle

STEP_S, SPEED_MPS, RANGE_M = 0.25, 2.0, 15.0
CIRCLE_DISC_M, BLOCKS_DISC_M = 3.0, 4.0
"""Distances of two centres."""


def circle(count: int = 250, radius_m: float = 200.0, **options) -> Flown:
    """RVO2's examples/Circle.cpp."""
    start = on_circle(count, radius_m)
    settings = replace(IDEAL_HALFPLANES, horizon_s=10.0, contact_step_s=STEP_S)
    common = {"step_s": STEP_S, "range_m": RANGE_M, "arrived_m": 1.5, "duration_s": 600.0, "settings": settings}
    return fly(start, -start, CIRCLE_DISC_M, SPEED_MPS, **(common | options))


def blocks(rows: int = 5, **options) -> Flown:
    """RVO2's examples/Blocks.cpp."""
    at = 55.0 + 10.0 * np.arange(rows)
    grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
    start = np.concatenate([grid * corner for corner in corners])
    goal = np.repeat(-75.0 * corners, len(grid), axis=0)
    square = np.array([[10.0, 10.0], [40.0, 10.0], [40.0, 40.0], [10.0, 40.0]])
    settings = replace(IDEAL_HALFPLANES, horizon_s=5.0, contact_step_s=STEP_S)
    common = {"step_s": STEP_S, "range_m": RANGE_M, "arrived_m": 20.0, "duration_s": 600.0, "settings": settings}
    polygons = [square * corner for corner in corners]
    return fly(start, goal, BLOCKS_DISC_M, SPEED_MPS, polygons=polygons, **(common | options))


def report(wanted: Sequence[str] = ()) -> dict[str, list[dict[str, Any]]]:
    """Fly both, or those wanted, print what became of them, and return the rows."""
    print("\nRVO2's own examples, without errors: who arrives, and how far discs are entered")
    rows: list[dict[str, Any]] = []
    for name, disc_m, crowd in (("circle", CIRCLE_DISC_M, circle), ("blocks", BLOCKS_DISC_M, blocks)):
        if wanted and name not in wanted:
            continue
        begin = time.process_time()
        out = crowd()
        arrived = np.isfinite(out.time_s)
        row = {
            "example": name,
            "agents": len(arrived),
            "arrived": int(arrived.sum()),
            "last_s": float(out.time_s[arrived].max(initial=0.0)),
            "straight_s": float(out.straight_s.max()),
            "entered_m": max(disc_m - out.least_m, 0.0),
            "infeasible": out.infeasible_share,
        }
        rows.append(row)
        print(
            f"{name:8}{row['arrived']:4d} of {row['agents']}, the last after {row['last_s']:.0f} s "
            f"({row['last_s'] / row['straight_s']:.2f} of the longest straight way); entered by "
            f"{100.0 * row['entered_m']:.2f} cm; infeasible {row['infeasible']:.1%}; "
            f"{time.process_time() - begin:.1f} s CPU",
            flush=True,
        )
    return {"rvo2_examples": rows}


if __name__ == "__main__":
    report(sys.argv[1:])
