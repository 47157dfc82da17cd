"""How benchmarks measure: peers interleaved, CPU time, every round kept."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

ROUNDS = 7


def children_seconds() -> float:
    """CPU time of all processes that this one has waited for [s]."""
    times = os.times()
    return times.children_user + times.children_system


def cpu_seconds(action: Callable[[], object], clock: Callable[[], float] = time.process_time) -> float:
    """CPU time of an action [s], of this process unless `clock` reads another."""
    begun = clock()
    action()
    return clock() - begun


def interleaved(
    actions: dict[str, Callable[[], object]], rounds: int = ROUNDS, clock: Callable[[], float] = time.process_time
) -> dict[str, list[float]]:
    """CPU seconds of each action, one after the other in every round, after one uncounted round.

    Args:
        actions: What is measured, by name.
        rounds: How often.
        clock: Reads the CPU time used so far, of this process unless told otherwise.
    """
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(rounds + 1):
        for name, action in actions.items():
            used = cpu_seconds(action, clock)
            if turn:
                seconds[name].append(used)
    return seconds
