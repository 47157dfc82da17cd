"""Airframes where errors are small, and a disc has no room for the answer of a vehicle.

python -m tests.avoidance.study_small_errors [flights]

Three of 1 m at the corners of a triangle leave a hover for the points opposite; three to six at random places within
60 m, at least 15 m apart, do so in 30 scenes. Printed: flights with a collision, and the smallest true gap between two
airframes [m], by the standard deviation of the errors.
"""

from __future__ import annotations

import sys

import numpy as np

from tests.avoidance.lockstep import Scene, circle, fly, scene

SIGMAS_M = (0.02, 0.3, 0.6, 1.0)
SCENES, EXTENT_M, APART_M = 30, (25.0, 60.0), 15.0


def scattered(random: np.random.Generator, vehicles: int) -> Scene:
    """Random places round the middle, goals opposite, at 10 m/s."""
    while True:
        angle = random.uniform(0.0, 2.0 * np.pi, vehicles)
        start = np.stack([np.cos(angle), np.sin(angle)], axis=1) * random.uniform(*EXTENT_M, (vehicles, 1))
        apart = np.linalg.norm(start[:, None] - start, axis=-1)[np.triu_indices(vehicles, 1)]
        if apart.min() >= APART_M:
            return scene(start, -start, 10.0)


def row(name: str, plans: list[Scene], flights: int, response: str) -> None:
    """Fly all plans with each of the errors, and print."""
    found = []
    for sigma_m in SIGMAS_M:
        flown = [
            fly(plan, worlds=flights, seed=1, response=response, sigma_m=sigma_m, airframe_m=(1.0, 1.0),
                from_rest=True, duration_s=150.0)
            for plan in plans
        ]  # fmt: skip
        hit = sum(int(out.collided.any(axis=1).sum()) for out in flown)
        gap_m = min(float(out.least_gap_m.min()) for out in flown)
        found.append(f"{sigma_m:4} m: {hit:3} of {flights * len(plans)}, {gap_m:4.1f} m")
    print(f"{response:10}{name:22}", "   ".join(found), flush=True)


def main() -> None:
    """Print a row for each autopilot and scene."""
    flights = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    for response in ("ardupilot", "px4"):
        for speed, radius_m in ((10.0, 30.0), (10.0, 40.0), (20.0, 100.0)):
            name = f"3 at {speed:g} m/s, {radius_m * 3**0.5:.0f} m"
            row(name, [circle(3, radius_m, speed)], flights, response)
        random = np.random.default_rng(11)
        for vehicles in (3, 4, 5, 6):
            plans = [scattered(random, vehicles) for _ in range(SCENES)]
            row(f"{vehicles} at random", plans, max(1, flights // 3), response)


if __name__ == "__main__":
    main()
