"""Vehicles that do not obey at once, beside what a prototype of the same method reached with them.

python -m tests.avoidance.study_response [runs] [px4|ardupilot] [speed] [geometry ...]

For ten geometries, 60 cells in all (a quarter of an hour on one core with 300 runs): runs in which a reported
position came inside the disc [%], 5th percentile of the smallest reported margin [m], smallest true gap of two
airframes [m], collisions, vehicles that did not arrive, median time relative to flying alone, reversals of the
lateral command a vehicle. Below each row stand the same figures of `first_form`, which is the prototype's method
written again, flown in the same worlds; behind both what the prototype noted (it had no collisions, and everybody
arrived), and what is worse than either beyond the noise of the runs. Paths are 500 m, circles have a radius of 100 m,
airframes are 0.5 to 2 m, errors Gauss-Markov of 3.5 m, latencies 0.1 to 0.3 s, everybody begins at cruise, and who
arrives leaves. "Head-on 10" passes on the right unasked, 10 m apart. Two rows the prototype did not measure: with 10
m on the other side, and overtaking with two bystanders in the air, because who hears several turns further.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass

import numpy as np

from tests.avoidance import lockstep
from tests.avoidance.lockstep import Scene, fly, solo_time, with_bystanders

PROTOTYPE = {
    ("ardupilot", 5.0): "0/4.3/24/1.01/1.4 0/6.0/27/1.00/1.2 0/2.2/18/1.01/1.3 3/0.7/15/1.02/1.2 2/1.2/18/1.02/1.2 "
    "15/-0.9/11/1.29/2.4 0/2.5/19/1.02/1.2 1/2.0/16/1.05/1.3",
    ("px4", 5.0): "0/3.9/24/1.01/1.4 0/5.6/27/1.00/1.3 0/2.1/18/1.02/1.3 3/0.3/12/1.03/1.2 2/0.9/18/1.04/1.1 "
    "15/-0.7/12/1.48/2.5 0/2.5/18/1.03/1.2 1/1.8/16/1.06/1.4",
    ("ardupilot", 8.0): "0/7.8/25/1.01/1.3 0/9.7/27/1.00/1.4 0/4.2/22/1.01/1.3 0/1.7/16/1.02/1.9 0/1.7/18/1.03/1.1 "
    "8/-0.5/12/1.43/1.9 0/3.4/21/1.02/1.2 0/2.8/19/1.04/1.2",
    ("px4", 8.0): "0/7.6/26/1.01/1.3 0/9.4/28/1.00/1.3 0/3.7/23/1.01/1.2 0/1.4/17/1.02/1.7 0/1.8/18/1.04/1.0 "
    "9/-0.4/10/1.45/1.7 0/3.4/21/1.02/1.1 0/2.5/19/1.04/1.1",
    ("ardupilot", 10.0): "0/8.4/25/1.01/1.4 0/9.8/26/1.00/1.4 0/4.9/24/1.01/1.2 1/1.9/19/1.02/1.7 1/1.9/20/1.05/1.1 "
    "6/-0.1/10/1.30/1.6 0/3.3/23/1.01/1.2 0/3.1/20/1.03/1.1",
    ("px4", 10.0): "0/8.6/26/1.01/1.2 0/10.0/27/1.00/1.3 0/5.0/25/1.01/1.1 0/1.7/18/1.01/1.7 1/2.0/19/1.05/1.1 "
    "7/-0.2/10/1.29/1.6 0/3.5/23/1.01/1.1 0/2.7/20/1.03/1.1",
}
"""Violations / 5th percentile / gap / time / reversals of each geometry, in the order of `geometries`."""


def geometries(speed: float) -> list[tuple[str, Scene]]:
    intruder = [True, False]
    return [
        ("head-on 0", lockstep.head_on(0.0, speed)),
        ("head-on 10", lockstep.head_on(-10.0, speed)),
        ("crossing", lockstep.crossing(speed)),
        ("overtaking", lockstep.overtaking(speed)),
        ("circle 4", lockstep.circle(4, speed=speed)),
        ("circle 8", lockstep.circle(8, speed=speed)),
        ("intruder head-on", lockstep.head_on(0.0, speed, intruder)),
        ("intruder crossing", lockstep.crossing(speed, intruder)),
    ]


@dataclass(frozen=True)
class Cell:
    """Figures of one cell, in the order of the columns."""

    inside: float
    margin_m: float
    gap_m: float
    macs: int
    lost: int
    time: float
    reversals: float

    def __str__(self) -> str:
        return (
            f"{100.0 * self.inside:5.1f} {self.margin_m:5.1f} {self.gap_m:5.1f} {self.macs:5d} {self.lost:5d} "
            f"{self.time:6.3f} {self.reversals:5.2f}"
        )

    @classmethod
    def noted(cls, cell: str) -> Cell:
        inside, margin, gap, ratio, reversals = map(float, cell.split("/"))
        return cls(inside / 100.0, margin, gap, 0, 0, ratio, reversals)


def measure(plan: Scene, response: str, runs: int, *, first_form: bool = False) -> Cell:
    option = {
        "response": response, "duration_s": 240.0 if plan.cooperative.all() else 130.0, "landing_s": 0.0,
        "first_form": first_form,
    }  # fmt: skip
    out = fly(plan, worlds=runs, seed=1, **option)
    solo = solo_time(plan, worlds=40, seed=1, **option)
    counted = np.broadcast_to(plan.cooperative, out.arrival_s.shape)
    alone = np.broadcast_to(np.median(solo, axis=0), out.arrival_s.shape)
    return Cell(
        float(np.mean(out.least_margin_m < 0.0)),
        float(np.percentile(out.least_margin_m, 5)),
        float(out.least_gap_m.min()),
        int(out.collided.sum()),
        int((~out.arrived & ~out.collided)[counted].sum()),
        float(np.median(out.arrival_s[counted] / alone[counted])),
        float(out.reversals * plan.count / plan.cooperative.sum()),
    )


def worse_than(theirs: Cell, ours: Cell, runs: int) -> list[str]:
    """What of a cell is worse than another's beyond the noise of the runs."""
    noise = 2.0 * math.sqrt(max(theirs.inside, 0.01) * (1.0 / runs + 1.0 / 300.0))
    judged = [
        ("MAC", ours.macs > theirs.macs),
        ("lost", ours.lost > theirs.lost),
        ("inside", ours.inside > theirs.inside + noise),
        ("margin", ours.margin_m < theirs.margin_m - 0.6),
        ("time", ours.time > theirs.time + 0.015),
        ("reversals", ours.reversals > theirs.reversals + 0.25),
    ]
    return [name for name, bad in judged if bad]


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    wanted = sys.argv[2:]
    print(f"{'':33}inside% rep5   gap  macs  lost   time   rev | prototype")
    noted = as_noted = flown = as_flown = 0
    for (response, speed), row in PROTOTYPE.items():
        if wanted and not {response, f"{speed:g}"} >= set(wanted) & {"px4", "ardupilot", "5", "8", "10"}:
            continue
        cells = [*zip(geometries(speed), row.split(), strict=True)]
        cells.insert(2, (("head-on 10 crossed", lockstep.head_on(10.0, speed)), ""))
        cells.insert(5, (("overtaking beside two", with_bystanders(lockstep.overtaking(speed))), ""))
        for (name, plan), cell in cells:
            named = {"head-on", "crossing", "overtaking", "circle", "intruder"} & set(wanted)
            if named and not named & set(name.split()):
                continue
            begin = time.perf_counter()
            ours, theirs = (measure(plan, response, runs, first_form=first_form) for first_form in (False, True))
            worse = worse_than(Cell.noted(cell), ours, runs) if cell else []
            here = worse_than(theirs, ours, runs)
            noted, as_noted = noted + bool(cell), as_noted + bool(cell and not worse)
            flown, as_flown = flown + 1, as_flown + (not here)
            verdict = ", ".join(worse) or "no worse" * bool(cell)
            print(f"{f'{name} {response} {speed:g} m/s':33}{ours} | {cell:22} {verdict}")
            print(
                f"{'    first form, the same worlds':33}{theirs} | {', '.join(here) or 'no worse':28}"
                f"{time.perf_counter() - begin:6.1f} s",
                flush=True,
            )
    print(f"{as_noted} of {noted} cells are no worse than what the prototype noted")
    print(f"{as_flown} of {flown} cells are no worse than its method, flown in the same worlds")


if __name__ == "__main__":
    main()
