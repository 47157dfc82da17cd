"""The paper's simulation in full, and the graded solver against it: python -m tests.avoidance.study_paper [runs]
[row of the second table ...].

First table: the four definitions under the paper's solver and errors, beside what the paper prints. Second: rotation
under Candidates 1 and 2 against the graded solver, on the same fleets and errors, for white, Gauss-Markov and constant
errors per axis. Cells: median time of the flights without a collision, then collided flights in per cent and the
one-sided 95 % bound on them; two flights collide at a time, so events are half of them.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from ridlink.avoidance import GradedSettings
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.flight import fly
from ridlink.campaign.plan import Plan, graded_plan, paper_plan
from ridlink.campaign.scene import Scene, circle, square
from ridlink.campaign.worlds import Outcomes
from ridlink.separation import Definition

PRINTED = {
    "circle8": {"snmac": (6.7, 1.0, 4.3), "remote-id": (11.3, 1.69, 0.0), "candidate1": (7.7, 1.15, 0.0),
                "candidate2": (6.9, 1.03, 0.0)},
    "square24": {"snmac": (20.9, 1.0, 4.3), "remote-id": (50.8, 2.43, 0.0), "candidate1": (27.4, 1.31, 0.0),
                 "candidate2": (22.2, 1.06, 0.0)},
}  # fmt: skip
"""Median seconds, ratio to sNMAC, MAC per cent. The paper gives one collision rate for both scenes."""

PER_AXIS = (ErrorModel.WHITE, ErrorModel.GAUSS_MARKOV, ErrorModel.BIAS)


def most_likely_below(events: int, trials: int) -> float:
    """One-sided 95 % Poisson bound on a rate."""
    low, high = float(events), events + 10.0 + 5.0 * events**0.5
    terms = np.arange(events + 1)
    log_factorial = np.concatenate([[0.0], np.cumsum(np.log(np.maximum(terms[1:], 1)))])
    for _ in range(60):
        middle = (low + high) / 2.0
        below = np.exp(-middle + terms * np.log(max(middle, 1e-300)) - log_factorial).sum()
        low, high = (middle, high) if below > 0.05 else (low, middle)
    return high / trials


def cell(outcomes: Outcomes) -> str:
    bound = most_likely_below(outcomes.macs // 2, outcomes.flights // 2)
    return f"{np.median(outcomes.mission_s):5.1f} / {100 * outcomes.macs / outcomes.flights:.3f} (< {100 * bound:.3f})"


def paper_table(runs: int) -> None:
    print(f"rotation, white radial errors of 10 m, {runs} runs a cell")
    print(f"{'':20}{'median s':>9}{'printed':>9}{'ratio':>8}{'printed':>9}{'MAC %':>8}{'printed':>9}"
          f"{'unfinished':>12}{'infeasible':>12}{'wall s':>8}")  # fmt: skip
    for scene in (circle(), square()):
        first = None
        for definition in (Definition.SNMAC, Definition.REMOTE_ID, Definition.CANDIDATE1, Definition.CANDIDATE2):
            begin = time.perf_counter()
            out = fly(paper_plan(scene, definition), range(runs))
            median = float(np.median(out.mission_s))
            first = first or median
            seconds, ratio, rate = PRINTED[scene.name][definition]
            print(
                f"{scene.name + ' ' + definition:20}{median:9.1f}{seconds:9.1f}{median / first:8.2f}{ratio:9.2f}"
                f"{100 * out.macs / out.flights:8.2f}{rate:9.1f}{out.unfinished:12d}"
                f"{100 * out.infeasible.sum() / out.decisions.sum():11.1f}%{time.perf_counter() - begin:8.1f}",
                flush=True,
            )


def front_plan(name: str, scene: Scene, errors: ErrorModel) -> Plan:
    """A row of the second table."""
    settings = {"G2": GradedSettings.g2(), "K": GradedSettings.k(), "K2": GradedSettings.k2()}
    if name in settings:
        return graded_plan(scene, settings[name], errors=errors)
    definition = {"C1": Definition.CANDIDATE1, "C2": Definition.CANDIDATE2}[name]
    return replace(paper_plan(scene, definition), errors=errors)


def front_table(runs: int, names: list[str]) -> None:
    print(
        f"\nerrors of 10 m per axis, {runs} runs a cell; C1, C2: rotation, pair bound 30 m; G2, K, K2: graded, filtered"
    )
    print(
        f"{'':4}" + "".join(f"{scene + ' ' + str(errors):>28}" for errors in PER_AXIS for scene in ("circle", "square"))
    )
    for name in names or ["C2", "C1", "G2", "K", "K2"]:
        cells = [
            cell(fly(front_plan(name, scene, errors), range(runs)))
            for errors in PER_AXIS
            for scene in (circle(), square())
        ]
        print(f"{name:4}" + "".join(f"{text:>28}" for text in cells), flush=True)


if __name__ == "__main__":
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    if not sys.argv[2:]:
        paper_table(wanted)
    front_table(wanted, sys.argv[2:])
