"""How long a decision takes, for one own-ship and in batches: python -m tests.avoidance.timing [solver ...].

CPU time. Run it alone and twice: the first run compiles. The batch is the paper's square in its first ten seconds with
everybody heard, so every decision has 23 neighbours.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from ridlink.avoidance import GradedSettings, OwnShip, RotationSettings, SolverKind, Traffic
from ridlink.avoidance.solver import new_solver, warm_up
from ridlink.campaign import worlds
from ridlink.campaign.deciding import new_decider
from ridlink.campaign.flight import fly
from ridlink.campaign.plan import IDEAL_HALFPLANES, Plan
from ridlink.campaign.scene import square

IDEAL = {
    SolverKind.HALFPLANE: IDEAL_HALFPLANES,
    SolverKind.GRADED: GradedSettings.g2(),
    SolverKind.ROTATION: RotationSettings.paper(),
}


def one_own_ship(kind: SolverKind) -> None:
    random = np.random.default_rng(1)
    solver = new_solver(kind)
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
            f"  {count:4d} neighbours: p50 {np.percentile(solve, 50):.0f} us, p99 {np.percentile(solve, 99):.0f} us "
            f"(Traffic p50 {np.percentile(build, 50):.0f} us), infeasible {100 * np.mean(np.array(status) == 3):.0f} %"
        )


def batches(kind: SolverKind) -> None:
    spent: list[float] = []
    decisions = 0

    class Timed:
        def __init__(self, *arguments) -> None:
            self._inner = new_decider(*arguments)
            self.keep = self._inner.keep

        def decide(self, own, deciding, *rest):
            nonlocal decisions
            decisions += deciding.sum()
            begin = time.process_time()
            result = self._inner.decide(own, deciding, *rest)
            spent.append(time.process_time() - begin)
            return result

    plan = Plan(square(), settings=IDEAL[kind], range_m=1e4, duration_s=10.0, filtered=True)
    fly(plan, range(1))
    worlds.new_decider = Timed
    begin = time.process_time()
    fly(plan, range(64))
    whole = time.process_time() - begin
    worlds.new_decider = new_decider
    print(
        f"  batches: {1e9 * sum(spent) / decisions:.0f} ns a decision at 23 neighbours, one thread; the whole step "
        f"{1e9 * whole / decisions:.0f} ns"
    )
    short = replace(plan, range_m=400.0)
    begin = time.process_time()
    out = fly(short, range(64))
    print(f"  the same within 400 m, whole step: {1e9 * (time.process_time() - begin) / out.decisions.sum():.0f} ns")


def main() -> None:
    for kind in [SolverKind(name) for name in sys.argv[1:]] or list(SolverKind):
        begin = time.process_time()
        warm_up(kind)
        print(f"{kind}: warm-up {time.process_time() - begin:.2f} s")
        one_own_ship(kind)
        batches(kind)


if __name__ == "__main__":
    main()
