"""Confidence intervals for the figures of a campaign: shares, medians, ratios and differences.

Runs are independent of each other, but the flights of one run are not. So resampling always takes whole runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Interval = tuple[float, float]

LEVEL = 0.95
RESAMPLES = 1000
LEAST_RUNS = 6
"""The least number of runs whose extremes contain the median of all with a probability of `LEVEL`: 1 - 2 / 2^6 = 0.97.
Fewer runs do not determine the median, however they are resampled, and have no bootstrap interval."""
_BISECTIONS = 60
_AT_A_TIME = 100
"""Resamples in memory at a time."""


def clopper_pearson(events: int, trials: int) -> Interval:
    """Exact two-sided interval that contains a share with a probability of at least `LEVEL`.

    Source: Clopper and Pearson (1934), by bisection of the binomial distribution.

    Args:
        events: Number of events.
        trials: Number of trials.

    Raises:
        ValueError: If there are no trials, or not 0 <= events <= trials.
    """
    if not (trials > 0 and 0 <= events <= trials):
        raise ValueError(f"events must lie within 0 and the number of trials, got {events} of {trials}")
    tail = (1.0 - LEVEL) / 2.0
    low = 0.0 if events == 0 else 1.0 - _share_with_at_most(trials - events, trials, tail)
    high = 1.0 if events == trials else _share_with_at_most(events, trials, tail)
    return low, high


def collided_share(collided: int, flights: int) -> Interval:
    """Interval of the share of flights that end in a collision, where flights collide in pairs.

    The pairs are nearly independent, so the interval is computed for pairs: half of the collided flights among half of
    all flights. An interval for single flights contains the share in 82 to 87 % of the cases, not in 95: it is too
    narrow by the root of two, and for no collisions its bound is too low by a factor of two.

    Args:
        collided: Flights that collided.
        flights: All of them.

    Raises:
        ValueError: As `clopper_pearson`.
    """
    if not (flights > 0 and 0 <= collided <= flights):
        raise ValueError(f"collided must lie within 0 and the number of flights, got {collided} of {flights}")
    pairs = max(flights // 2, 1)
    most = min(-(-collided // 2), pairs)  # odd if three collide in one step
    return clopper_pearson(collided // 2, pairs)[0], clopper_pearson(most, pairs)[1]


def _share_with_at_most(events: int, trials: int, probability: float) -> float:
    """The share at which at most this many events have that probability."""
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
    """A median, and the medians of resampled campaigns, shape (RESAMPLES,); NaN without flights or with too few
    runs."""

    median: float
    resampled: FloatArray

    @property
    def interval(self) -> Interval | None:
        """Bootstrap interval of the median, or None."""
        return percentile_interval(self.resampled)


def percentile_interval(values: FloatArray) -> Interval | None:
    """The middle 95 % of resampled values; None if an end of it is not finite, or more than 5 % are NaN.

    Infinite ratios are included: without them the upper end would be too low.
    """
    told = values[~np.isnan(values)]
    if told.size < LEVEL * values.size or not told.size:
        return None
    tail = 100.0 * (1.0 - LEVEL) / 2.0
    with np.errstate(invalid="ignore"):  # between two infinite values
        low, high = np.percentile(told, [tail, 100.0 - tail])
    return (float(low), float(high)) if np.isfinite(low) and np.isfinite(high) else None


def bootstrap_medians(values: FloatArray, run: NDArray[np.int64], runs: int, seed: int) -> Medians:
    """Median of pooled values, and of campaigns resampled from the same runs.

    Equal seeds and numbers of runs resample the same runs, so that two cells on common seeds can be compared pair by
    pair.

    Args:
        values: Measured values, shape (n,).
        run: Run of each value, 0 to runs - 1, shape (n,).
        runs: Number of runs.
        seed: Seed of the resampling.
    """
    if not values.size or runs < LEAST_RUNS:
        median = float(np.median(values)) if values.size else math.nan
        return Medians(median, np.full(RESAMPLES, np.nan))
    order = np.argsort(values, kind="stable")
    ranked, owner = values[order], run[order]
    medians = np.empty(RESAMPLES)
    for first, weight in _resampled(runs, seed):
        upto = np.cumsum(weight[:, owner], axis=1)
        for k, sums in enumerate(upto, start=first):
            total = int(sums[-1])
            if not total:
                medians[k] = np.nan
                continue
            lower, upper = np.searchsorted(sums, [(total + 1) // 2, total // 2 + 1])
            medians[k] = (ranked[lower] + ranked[upper]) / 2.0
    return Medians(float(np.median(values)), medians)


def bootstrap_totals(counts: NDArray[np.int64] | FloatArray, seed: int) -> FloatArray:
    """Totals of campaigns resampled from the same runs, shape (RESAMPLES,); NaN if there are too few runs.

    Args:
        counts: Count or sum of each run, shape (runs,).
        seed: Seed of the resampling; equal ones resample the same runs as `bootstrap_medians` does.
    """
    totals = np.full(RESAMPLES, np.nan)
    if len(counts) < LEAST_RUNS:
        return totals
    for first, weight in _resampled(len(counts), seed):
        totals[first : first + len(weight)] = weight @ counts
    return totals


def _resampled(runs: int, seed: int) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """How often each run is in each resampled campaign, in parts: number of the first campaign, and counts, shape
    (part, runs)."""
    random = np.random.default_rng(seed)
    for first in range(0, RESAMPLES, _AT_A_TIME):
        yield first, random.multinomial(runs, np.full(runs, 1.0 / runs), size=_AT_A_TIME)


def risk_ratio(
    collided: NDArray[np.bool_], reference: NDArray[np.bool_], seed: int
) -> tuple[float | None, Interval | None]:
    """Share in a collision divided by that of a reference flown on the same runs, with its interval.

    The interval comes from resampled runs. If nobody collided, every resampled ratio is zero and contains no
    information: the upper end is then the upper bound of the share divided by the lower bound of the reference share,
    which is on the safe side; None if that bound is zero.

    Args:
        collided: Mask of collided vehicles, shape (runs, vehicles).
        reference: The same in the reference, same shape.
        seed: Seed of the resampling.

    Returns:
        Ratio and interval, both None if nobody collided in the reference.
    """
    if not reference.any():
        return None, None
    ratio = float(collided.mean() / reference.mean())
    if not collided.any():
        least = collided_share(int(reference.sum()), reference.size)[0]
        return ratio, (0.0, collided_share(0, collided.size)[1] / least) if least else None
    totals, others = (bootstrap_totals(each.sum(axis=1), seed) for each in (collided, reference))
    with np.errstate(divide="ignore", invalid="ignore"):
        return ratio, percentile_interval(totals / others)


@dataclass(frozen=True, slots=True)
class Difference:
    """One cell compared with another on the same runs; None if a figure cannot be computed.

    Attributes:
        median_s: Median time less that of the other.
        median_ci95: Bootstrap interval of it, the same runs resampled in both.
        median_ratio: Ratio of the medians.
        median_ratio_ci95: Interval of it.
        mean_s: Mean difference of times, flight by flight, of flights without a collision in either.
        mean_ci95: Bootstrap interval of it.
        mac_rate: Share in a collision less that of the other.
        mac_rate_ci95: Interval of it; None if too few runs differ.
        more_runs: Runs with more vehicles in a collision than the same runs of the other.
        fewer_runs: Runs with fewer.
        p_value: Two-sided exact sign test of these two numbers: probability of such a split, or a larger one, by chance
            alone.
    """

    median_s: float | None
    median_ci95: Interval | None
    median_ratio: float | None
    median_ratio_ci95: Interval | None
    mean_s: float | None
    mean_ci95: Interval | None
    mac_rate: float
    mac_rate_ci95: Interval | None
    more_runs: int
    fewer_runs: int
    p_value: float


@dataclass(frozen=True, slots=True)
class Flights:
    """Flights of one cell: R runs of N vehicles.

    Attributes:
        time_s: Mission times, the cut-off for those that did not arrive, shape (R, N).
        collided: Mask of collided flights, whose times do not count, shape (R, N).
        medians: Median of the times, resampled with the seed of the comparison.
    """

    time_s: FloatArray
    collided: NDArray[np.bool_]
    medians: Medians


def paired_difference(one: Flights, other: Flights, seed: int) -> Difference:
    """Compare one cell with another, run by run.

    If no run differs, every resampled difference is zero and contains no information: the interval is then the bound
    for zero events in that many flights, to either side.

    Args:
        one: Flights of the one cell.
        other: The same runs and vehicles in the other cell.
        seed: Seed of the resampling.

    Raises:
        ValueError: If the numbers of runs and vehicles differ.
    """
    if one.collided.shape != other.collided.shape:
        raise ValueError(f"runs and vehicles must be the same, got {one.collided.shape} and {other.collided.shape}")
    ours, theirs = one.medians, other.medians
    comparable = np.isfinite(ours.median) and np.isfinite(theirs.median)
    mean, mean_ci95 = _paired_mean(one, other, seed)
    extra = one.collided.sum(axis=1) - other.collided.sum(axis=1)
    more, fewer = int((extra > 0).sum()), int((extra < 0).sum())
    flights = one.collided.size
    mac_rate_ci95 = percentile_interval(bootstrap_totals(extra, seed) / flights)
    if not more + fewer:
        high = collided_share(0, flights)[1]
        mac_rate_ci95 = (-high, high)
    return Difference(
        ours.median - theirs.median if comparable else None,
        percentile_interval(ours.resampled - theirs.resampled) if comparable else None,
        ours.median / theirs.median if comparable else None,
        percentile_interval(ours.resampled / theirs.resampled) if comparable else None,
        mean, mean_ci95, float(extra.sum() / flights), mac_rate_ci95, more, fewer, sign_test(more, fewer),
    )  # fmt: skip


def _paired_mean(one: Flights, other: Flights, seed: int) -> tuple[float | None, Interval | None]:
    """Mean difference of the flights that did not collide in either, and its bootstrap interval."""
    both = ~one.collided & ~other.collided
    if not both.any():
        return None, None
    extra = np.where(both, one.time_s - other.time_s, 0.0).sum(axis=1)
    count = both.sum(axis=1)
    with np.errstate(invalid="ignore"):
        resampled = bootstrap_totals(extra, seed) / bootstrap_totals(count, seed)
    return float(extra.sum() / count.sum()), percentile_interval(resampled)


def sign_test(more: int, fewer: int) -> float:
    """Two-sided exact probability of this split, or of a more uneven one, if both sides are equally likely.

    Source: the sign test; with yes and no for more and fewer it is the exact McNemar test.

    Raises:
        ValueError: If a count is negative.
    """
    if more < 0 or fewer < 0:
        raise ValueError(f"counts must not be negative, got {more} and {fewer}")
    trials = more + fewer
    half = math.log(0.5) * trials
    tail = math.fsum(
        math.exp(half + math.lgamma(trials + 1) - math.lgamma(k + 1) - math.lgamma(trials - k + 1))
        for k in range(min(more, fewer) + 1)
    )
    return min(1.0, 2.0 * tail)
