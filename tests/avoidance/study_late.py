"""Encounters that are heard too late for the disc: is at least the airframe missed?

python -m tests.avoidance.study_late [runs] [seed]

Own-ship flies straight at cruise; another vehicle, first heard 60 to 100 m away, will pass its centre within 10 m, from
any direction. It avoids nobody ("intruder"), or avoids as well ("pair"); or both kinds come at once ("both"), so that
the way out of one meeting leads into the other. Errors are Gauss-Markov of 3.5 m, latencies 0.1 to 0.3 s, airframes 0.5
to 2 m. Printed: collisions [%], runs in which two airframes came nearer than 5 m [%], 5th percentile of the smallest
true gap [m], runs in which a reported position came inside of the disc [%].
"""

from __future__ import annotations

import sys

import numpy as np

from tests.avoidance.lockstep import Scene, fly

LEAST_CLOSING = 0.7
"""Of the speed: what comes nearer more slowly is not late."""


def late(kind: str, runs: int, speed: float, seed: int, near_m=60.0, far_m=100.0) -> Scene:
    """Random encounters, one a world."""
    random = np.random.default_rng(seed)
    others = {"intruder": 1, "pair": 1, "both": 2}[kind]
    start, goal = np.zeros((runs, 1 + others, 2)), np.zeros((runs, 1 + others, 2))
    start[:, 0], goal[:, 0] = (0.0, 0.0), (300.0, 0.0)
    own = np.array([speed, 0.0])
    for w in range(runs):
        placed = []
        while len(placed) < others:
            course = random.uniform(-np.pi, np.pi)
            velocity = speed * np.array([np.cos(course), np.sin(course)])
            closing = own - velocity
            if np.hypot(*closing) < LEAST_CLOSING * speed:
                continue
            along = closing / np.hypot(*closing)
            place = random.uniform(near_m, far_m) * along + random.uniform(-10, 10) * np.array([-along[1], along[0]])
            if all(np.hypot(*(place - other)) > 50.0 for other, _ in placed):
                placed.append((place, velocity))
        for k, (place, velocity) in enumerate(placed):
            start[w, 1 + k], goal[w, 1 + k] = place, place + velocity * 300.0 / speed
    cooperative = np.array({"intruder": [True, False], "pair": [True, True], "both": [True, False, True]}[kind])
    return Scene(start, goal, np.full(1 + others, speed), cooperative)


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    print(f"{'':27}hit%  <5m%  gap5  viol%")
    for response in ("ardupilot", "px4"):
        for kind in ("intruder", "pair", "both"):
            for speed in (5.0, 8.0, 12.0):
                plan = late(kind, runs, speed, seed)
                out = fly(plan, worlds=runs, seed=seed, response=response, duration_s=25.0, landing_s=0.0)
                gap, entered = out.least_gap_m, out.least_margin_m < 0.0
                print(
                    f"{f'{kind} {response} {speed:g} m/s':26}{100 * np.mean(gap < 0.0):5.1f} "
                    f"{100 * np.mean(gap < 5.0):5.1f} {np.percentile(gap, 5):5.1f} {100 * np.mean(entered):6.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
