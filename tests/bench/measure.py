"""How benchmarks measure: peers interleaved, CPU time, every round kept."""

from __future__ import annotations

import time
from collections.abc import Callable

ROUNDS = 7


def cpu_seconds(action: Callable[[], object]) -> float:
    """CPU time of this process [s]."""
    begun = time.process_time()
    action()
    return time.process_time() - begun


def interleaved(actions: dict[str, Callable[[], object]], rounds: int = ROUNDS) -> dict[str, list[float]]:
    """CPU seconds of each action, one after the other in every round, after one uncounted round."""
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(rounds + 1):
        for name, action in actions.items():
            used = cpu_seconds(action)
            if turn:
                seconds[name].append(used)
    return seconds
