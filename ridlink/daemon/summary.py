"""Summary of a flight: totals, and how regular it was."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import asdict, dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

KEPT_STEPS = 36_000
"""An hour of steps; percentiles are of this hour, maxima of the whole flight."""


def _quantiles(values: NDArray[np.float64], shares: tuple[float, ...]) -> NDArray[np.float64]:
    """Replaces `np.quantile`, whose first call imports masked arrays: 20 ms in the middle of a flight."""
    return np.asarray(np.interp(shares, np.linspace(0.0, 1.0, len(values)), np.sort(values)))


class Spread:
    """Median, 99th percentile and maximum of a running quantity."""

    def __init__(self) -> None:
        self._recent: deque[float] = deque(maxlen=KEPT_STEPS)
        self._most = 0.0

    def add(self, value: float) -> None:
        """Add a value."""
        self._recent.append(value)
        self._most = max(self._most, value)

    def quantiles(self, last: int, scale: float) -> dict[str, float]:
        """Median, 99th percentile and maximum of the ``last`` values, times ``scale``, by quantile; empty if there is
        none."""
        recent = list(islice(reversed(self._recent), last))
        if not recent:
            return {}
        figures = _quantiles(np.array(recent), (0.5, 0.99, 1.0)) * scale
        return dict(zip(("0.5", "0.99", "1"), figures.tolist(), strict=True))

    def summary(self) -> dict[str, float]:
        """Median, 99th percentile and maximum, rounded."""
        if not self._recent:
            return {"p50": 0.0, "p99": 0.0, "max": 0.0}
        p50, p99 = _quantiles(np.fromiter(self._recent, np.float64), (0.5, 0.99))
        return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(self._most, 3)}


class Pace:
    """How long decisions take, and how regular setpoints are.

    Attributes:
        decision_ms: Wall time of decisions.
        decision_cpu_ms: CPU time of the thread.
        gap_ms: Between two setpoints of one stream.
    """

    def __init__(self) -> None:
        self.decision_ms, self.decision_cpu_ms, self.gap_ms = Spread(), Spread(), Spread()
        self._began_s = self._began_cpu_s = 0.0
        self._last_setpoint_s: float | None = None

    def begin(self) -> None:
        """Call it when a decision begins."""
        self._began_s, self._began_cpu_s = time.perf_counter(), time.thread_time()

    def decided(self) -> float:
        """Call it when the decision is made; returns its duration [s]."""
        took_s = time.perf_counter() - self._began_s
        self.decision_ms.add(took_s * 1e3)
        self.decision_cpu_ms.add((time.thread_time() - self._began_cpu_s) * 1e3)
        return took_s

    def sent(self, is_setpoint: bool, now_s: float) -> None:
        """Call it when the output was sent: a setpoint, or none, which ends a stream."""
        if is_setpoint and self._last_setpoint_s is not None:
            self.gap_ms.add((now_s - self._last_setpoint_s) * 1e3)
        self._last_setpoint_s = now_s if is_setpoint else None


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a flight. Times are in milliseconds as `p50`, `p99` and `max`, as wall time and, for busy machines, as
    CPU time of this thread; `decision_log` is the hash of all decisions if an input log was written."""

    setpoints: int
    reports_received: int
    decision_ms: dict[str, float]
    decision_cpu_ms: dict[str, float]
    setpoint_gap_ms: dict[str, float]
    rejects: dict[str, int]
    tracks: int
    state: str
    infeasible_steps: int
    decision_log: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)
