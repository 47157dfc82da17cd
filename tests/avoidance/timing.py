"""How long a decision takes: python -m tests.avoidance.timing."""

from __future__ import annotations

import time

import numpy as np


def main() -> None:
    begin = time.perf_counter()
    from ridlink.avoidance import HalfplaneSettings, OwnShip, Traffic
    from ridlink.avoidance.solver import HalfplaneSolver, warm_up

    imported = time.perf_counter()
    warm_up()
    print(f"import {imported - begin:.2f} s, warm-up {time.perf_counter() - imported:.2f} s")
    random = np.random.default_rng(1)
    solver = HalfplaneSolver(HalfplaneSettings())
    for count in (1, 8, 23, 100):
        spent, status = [], []
        for _ in range(3000):
            angle, away = random.uniform(0, 2 * np.pi, count), random.uniform(20, 400, count)
            position = np.stack([away * np.cos(angle), away * np.sin(angle)], axis=1)
            speed = 10.0 * random.normal(size=(count, 2))
            own = OwnShip(np.zeros(2), np.array([10.0, 0.0]), np.array([10.0, 0.0]), 1.0, 10.0)
            ones = np.ones(count)
            started = time.perf_counter()
            others = Traffic(
                position, speed, speed, 0.2 * ones, 24.0 * ones, 21.0 * ones, ones > 0, np.zeros(count, np.int8)
            )
            middle = time.perf_counter()
            decision = solver.solve(own, others, goal_ne_m=(500.0, 0.0), cruise_mps=10.0)
            spent.append((time.perf_counter() - middle, middle - started))
            status.append(decision.status)
        solve, build = 1e6 * np.array(spent).T
        print(
            f"{count:4d} neighbours: p50 {np.percentile(solve, 50):.0f} us, p99 {np.percentile(solve, 99):.0f} us "
            f"(Traffic p50 {np.percentile(build, 50):.0f} us), infeasible {100 * np.mean(np.array(status) == 3):.0f} %"
        )


if __name__ == "__main__":
    main()
