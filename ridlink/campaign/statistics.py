"""How far the figures of a campaign can be trusted: intervals for shares, medians, ratios and differences.

Runs are independent of each other, the flights of one run are not: whatever is resampled, is resampled in whole runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Interval = tuple[float, float]

LEVEL = 0.95
RESAMPLES = 1000
_BISECTIONS = 60
_AT_A_TIME = 100
"""Resamples in memory at a time."""


def clopper_pearson(events: int, trials: int, level: float = LEVEL) -> Interval:
    """Exact two-sided interval for a share.

    Source: Clopper and Pearson (1934), by bisection of the binomial distribution.

    Args:
        events: How often it happened.
        trials: How often it could have.
        level: Probability that the interval holds the true share, at least.

    Raises:
        ValueError: If there are no trials, or not 0 <= events <= trials.
    """
    if not (trials > 0 and 0 <= events <= trials):
        raise ValueError(f"events must lie within 0 and the number of trials, got {events} of {trials}")
    tail = (1.0 - level) / 2.0
    low = 0.0 if events == 0 else 1.0 - _share_with_at_most(trials - events, trials, tail)
    high = 1.0 if events == trials else _share_with_at_most(events, trials, tail)
    return low, high


def _share_with_at_most(events: int, trials: int, probability: float) -> float:
    """The share under which so many events or fewer have that probability."""
    count = np.arange(events + 1)
    ways = np.concatenate([[0.0], np.cumsum(np.log((trials - count[:-1]) / (count[:-1] + 1.0)))])
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        share = (low + high) / 2.0
        terms = ways + count * np.log(share) + (trials - count) * np.log1p(-share)
        largest = terms.max()
        below = np.exp(largest) * np.exp(terms - largest).sum()
        low, high = (share, high) if below > probability else (low, share)
    return (low + high) / 2.0


@dataclass(frozen=True, slots=True)
class Medians:
    """A median, and those of resampled campaigns, shape (RESAMPLES,); NaN where nobody flew."""

    median: float
    resampled: FloatArray

    @property
    def interval(self) -> Interval | None:
        """Bootstrap interval of the median; None where there is none."""
        return percentile_interval(self.resampled)


def percentile_interval(values: FloatArray) -> Interval | None:
    """The middle 95 % of resampled values; None if none is finite."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    tail = 100.0 * (1.0 - LEVEL) / 2.0
    low, high = np.percentile(finite, [tail, 100.0 - tail])
    return float(low), float(high)


def bootstrap_medians(values: FloatArray, run: NDArray[np.int64], runs: int, seed: int) -> Medians:
    """Median of pooled values, and of campaigns resampled from the same runs.

    Equal seeds and numbers of runs resample the same runs, so that two cells on common seeds can be compared pair by
    pair.

    Args:
        values: What was measured, shape (n,).
        run: To which run each belongs, 0 to runs - 1, shape (n,).
        runs: Number of runs.
        seed: Seed of the resampling.
    """
    if not values.size:
        return Medians(float("nan"), np.full(RESAMPLES, np.nan))
    order = np.argsort(values, kind="stable")
    ranked, owner = values[order], run[order]
    random = np.random.default_rng(seed)
    medians = np.empty(RESAMPLES)
    for first in range(0, RESAMPLES, _AT_A_TIME):
        weight = random.multinomial(runs, np.full(runs, 1.0 / runs), size=_AT_A_TIME)
        upto = np.cumsum(weight[:, owner], axis=1)
        for k, sums in enumerate(upto, start=first):
            total = int(sums[-1])
            if not total:
                medians[k] = np.nan
                continue
            lower, upper = np.searchsorted(sums, [(total + 1) // 2, total // 2 + 1])
            medians[k] = (ranked[lower] + ranked[upper]) / 2.0
    return Medians(float(np.median(values)), medians)
