"""Intervals against figures that are known, and against many repeated campaigns."""

import numpy as np
import pytest

from ridlink.campaign.statistics import bootstrap_medians, clopper_pearson, percentile_interval


@pytest.mark.parametrize(
    ("events", "trials", "low", "high"),
    [
        (0, 10, 0.0, 0.3084971),
        (5, 10, 0.1870860, 0.8129140),
        (1, 160, 0.0001582, 0.0343293),
        (10, 10, 0.6915029, 1.0),
        (0, 64000, 0.0, 5.7637e-5),
        (4000, 12000, 0.3248986, 0.3418490),
    ],
)
def test_clopper_pearson_as_tabulated(events, trials, low, high):
    assert clopper_pearson(events, trials) == pytest.approx((low, high), rel=2e-4, abs=1e-12)


def test_clopper_pearson_is_symmetric_and_holds_the_share():
    for events in range(0, 41, 5):
        low, high = clopper_pearson(events, 40)
        assert low <= events / 40 <= high
        assert clopper_pearson(40 - events, 40) == pytest.approx((1.0 - high, 1.0 - low), abs=1e-9)


@pytest.mark.parametrize(("events", "trials"), [(0, 0), (-1, 5), (6, 5)])
def test_shares_that_are_none_are_refused(events, trials):
    with pytest.raises(ValueError, match=f"{events} of {trials}"):
        clopper_pearson(events, trials)


def test_a_bootstrap_interval_holds_the_true_median_about_as_often_as_it_says():
    """Flights of a run share its luck: an interval from flights one by one would be three times too narrow."""
    random = np.random.default_rng(5)
    runs, flights, campaigns = 60, 8, 120
    run = np.repeat(np.arange(runs), flights)
    held = 0
    for campaign in range(campaigns):
        values = np.repeat(random.normal(20.0, 2.0, runs), flights) + random.normal(0.0, 0.5, runs * flights)
        low, high = bootstrap_medians(values, run, runs, campaign).interval
        held += low <= 20.0 <= high
    assert 0.87 <= held / campaigns <= 1.0


def test_the_same_seed_resamples_the_same_runs():
    random = np.random.default_rng(6)
    values, run = random.normal(10.0, 1.0, 40), np.repeat(np.arange(10), 4)
    first, second = (bootstrap_medians(each, run, 10, 3) for each in (values, 2.0 * values))
    assert np.array_equal(2.0 * first.resampled, second.resampled)
    assert first.median == np.median(values)


def test_weighted_medians_are_those_of_repeated_values():
    """With one run every resample is the campaign itself."""
    values = np.array([4.0, 1.0, 3.0, 2.0])
    assert bootstrap_medians(values, np.zeros(4, int), 1, 1).resampled == pytest.approx(2.5)


def test_where_nobody_flew_there_is_no_median():
    nothing = bootstrap_medians(np.empty(0), np.empty(0, int), 3, 1)
    assert np.isnan(nothing.median)
    assert nothing.interval is None
    assert percentile_interval(np.array([np.nan, 2.0, 2.0])) == (2.0, 2.0)
