"""Long runs of the lockstep worlds, printed as a table: python -m tests.avoidance.study [runs] [name ...].

Rows called "rest" begin in a hover, as a fleet in the field does; the others at cruise. Flying alone begins alike.

Columns: runs in which a reported position came inside the disc, 5th percentile of the smallest reported margin,
    smallest
true gap of two airframes, vehicles collided, vehicles that never arrived, median time relative to flying alone, median
and longest time, reversals of the lateral command a vehicle, share of infeasible decisions, smallest distance to the
obstacle.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from ridlink.separation import Definition
from tests.avoidance import lockstep
from tests.avoidance.lockstep import Scene, fly, solo_time

FAST = {"response": "ideal", "gnss": "white", "sigma_m": 10.0, "airframe_m": (0.1, 7.5)}

SHORT = {"duration_s": 80.0}
"""An intruder never lands, so its worlds last until the cut-off."""


def cases() -> list[tuple[str, Scene, dict]]:
    rows: list[tuple[str, Scene, dict]] = []
    for response in ("px4", "ardupilot", "ideal"):
        option = {"response": response}
        rows += [
            (f"circle8 {response}", lockstep.circle(), option),
            (f"head-on 0 {response}", lockstep.head_on(), option),
            (f"head-on 2 {response}", lockstep.head_on(2.0), option),
            (f"head-on 10 {response}", lockstep.head_on(10.0), option),
            (f"head-on -10 {response}", lockstep.head_on(-10.0), option),
            (f"crossing {response}", lockstep.crossing(), option),
            (f"overtaking {response}", lockstep.overtaking(), option),
            (f"intruder head-on {response}", lockstep.head_on(cooperative=[True, False]), option | SHORT),
            (f"intruder crossing {response}", lockstep.crossing(cooperative=[True, False]), option | SHORT),
            (f"square24 {response}", lockstep.square24(), option),
        ]
    for definition in ("candidate2", "candidate1", "remote-id", "snmac"):
        option = {**FAST, "definition": Definition(definition)}
        rows.append((f"fast circle8 {definition}", lockstep.circle(speed=30.7), option))
        rows.append((f"fast square24 {definition}", lockstep.square24(speed=30.7), option))
    for definition in ("candidate1", "remote-id", "snmac"):
        option = {"definition": Definition(definition)}
        rows.append((f"circle8 px4 {definition}", lockstep.circle(), option))
    return rows + [(f"{name} rest", plan, option | {"from_rest": True}) for name, plan, option in rows]


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    wanted = sys.argv[2:]
    print(f"{'':37}viol%  rep5    gap  macs  lost  ratio  med s  max s   rev  infeas  obst   wall")
    for name, plan, option in cases():
        if wanted and not any(word in name for word in wanted):
            continue
        begin = time.perf_counter()
        option = {"worlds": runs, "seed": 1, "duration_s": 700.0} | option
        out = fly(plan, **option)
        solo = solo_time(plan, **(option | {"worlds": 2}))
        counted = np.broadcast_to(plan.cooperative, out.arrival_s.shape)
        flown = out.arrival_s[counted]
        ratio = np.median(flown / np.broadcast_to(np.median(solo, axis=0), out.arrival_s.shape)[counted])
        lost = (~out.arrived & ~out.collided)[counted].sum()
        print(
            f"{name:37}{100 * np.mean(out.least_margin_m < 0):5.0f} {np.percentile(out.least_margin_m, 5):5.1f} "
            f"{out.least_gap_m.min():6.1f} {out.collided.sum():5d} {lost:5d} "
            f"{ratio:6.2f} {np.median(flown):6.1f} {flown.max():6.1f} "
            f"{out.reversals:5.1f} {100 * out.infeasible_share:6.1f}% {out.least_obstacle_m.min():5.1f} "
            f"{time.perf_counter() - begin:6.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
