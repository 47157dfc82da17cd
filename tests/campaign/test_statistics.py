"""Intervals against figures that are known, and against many repeated campaigns."""

import numpy as np
import pytest

from ridlink.campaign.statistics import (
    Flights,
    bootstrap_medians,
    clopper_pearson,
    collided_share,
    paired_difference,
    percentile_interval,
    risk_ratio,
    sign_test,
)


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


@pytest.mark.parametrize(
    ("collided", "flights", "pairs", "low_of", "high_of"),
    [
        (0, 64000, 32000, 0, 0),
        (52, 1040, 520, 26, 26),
        (3, 8, 4, 1, 2),
        (8, 8, 4, 4, 4),
        (3, 3, 1, 1, 1),
        (0, 1, 1, 0, 0),
    ],
)
def test_flights_collide_two_at_a_time(collided, flights, pairs, low_of, high_of):
    low, high = collided_share(collided, flights)
    assert (low, high) == (clopper_pearson(low_of, pairs)[0], clopper_pearson(high_of, pairs)[1])
    assert low <= collided / flights <= high


def test_an_interval_of_collided_flights_holds_their_share_as_often_as_it_says():
    """Of flights one by one it did so in 85 % of such campaigns."""
    random = np.random.default_rng(8)
    for pairs, share in ((400, 0.05), (2000, 0.001)):
        found = {n: collided_share(2 * n, 2 * pairs) for n in range(80)}
        drawn = random.binomial(pairs, share, 2000).tolist()
        assert sum(found[n][0] <= share <= found[n][1] for n in drawn) / len(drawn) >= 0.95


@pytest.mark.parametrize(("collided", "flights"), [(0, 0), (-1, 8), (9, 8)])
def test_shares_of_flights_that_are_none_are_refused(collided, flights):
    with pytest.raises(ValueError, match=f"{collided} of {flights}"):
        collided_share(collided, flights)


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
    """Runs that are all alike: every resample is the campaign itself."""
    values, run = np.tile([4.0, 1.0, 3.0, 2.0], 6), np.repeat(np.arange(6), 4)
    assert bootstrap_medians(values, run, 6, 1).resampled == pytest.approx(2.5)


@pytest.mark.parametrize("runs", [1, 2, 5])
def test_few_runs_have_figures_and_no_intervals(runs):
    """One run resampled is itself: its interval was a point, and held the truth never, that of two runs half of the
    time, of three in three quarters."""
    time_s, nobody = np.arange(8.0 * runs).reshape(runs, 8), np.zeros((runs, 8), bool)
    some = nobody.copy()
    some[0, :2] = True
    one, other = flights(time_s + 1.0, some), flights(time_s, nobody)
    assert np.isfinite(other.medians.median) and other.medians.interval is None
    found = paired_difference(one, other, 1)
    assert found.median_s is not None and found.median_ratio is not None
    assert found.mean_s == pytest.approx(1.0)
    assert found.mac_rate == pytest.approx(2 / (8 * runs)) and found.p_value == 1.0
    intervals = (found.median_ci95, found.median_ratio_ci95, found.mean_ci95, found.mac_rate_ci95)
    assert intervals == (None, None, None, None)
    assert risk_ratio(some, some, 1) == (1.0, None)


def test_what_has_no_end_has_no_interval():
    """One run in a hundred collided in the reference: a third of the resampled references have none, and whatever one
    divides by nothing is not left out."""
    some = np.zeros((100, 8), bool)
    some[0, :2] = True
    assert risk_ratio(some, some, 1) == (1.0, None)
    assert risk_ratio(np.roll(some, 1, axis=0), some, 1) == (1.0, None)
    one = np.zeros((100, 8), bool)
    one[0, 0] = True
    assert risk_ratio(np.zeros_like(one), one, 1) == (0.0, None), "no pair collided in the reference"
    assert percentile_interval(np.append(np.ones(900), np.full(100, np.inf))) is None
    assert percentile_interval(np.append(np.ones(990), np.full(10, np.inf))) == (1.0, 1.0)
    assert percentile_interval(np.append(np.ones(940), np.full(60, np.nan))) is None


def test_where_nobody_flew_there_is_no_median():
    nothing = bootstrap_medians(np.empty(0), np.empty(0, int), 3, 1)
    assert np.isnan(nothing.median)
    assert nothing.interval is None
    assert percentile_interval(np.append(np.nan, np.full(99, 2.0))) == (2.0, 2.0)


@pytest.mark.parametrize(
    ("more", "fewer", "p_value"),
    [
        (0, 0, 1.0),
        (3, 3, 1.0),
        (0, 5, 0.0625),
        (3, 12, 0.03515625),
        (12, 3, 0.03515625),
        (0, 1, 1.0),
        (1, 9, 0.021484375),
    ],
)
def test_the_sign_test_as_tabulated(more, fewer, p_value):
    """Binomial tails with one half, both sides."""
    assert sign_test(more, fewer) == pytest.approx(p_value, rel=1e-12)


def test_a_sign_test_of_thousands_of_runs_stays_a_probability():
    assert 0.0 < sign_test(900, 1100) < 1e-4
    assert sign_test(0, 5000) == 0.0
    with pytest.raises(ValueError, match="-1"):
        sign_test(-1, 2)


def flights(time_s, collided, seed=1):
    run = np.broadcast_to(np.arange(len(time_s))[:, None], time_s.shape)
    return Flights(time_s, collided, bootstrap_medians(time_s[~collided], run[~collided], len(time_s), seed))


def test_pairs_of_runs_show_what_unpaired_ones_hide():
    """Runs differ by ten seconds, the two cells by a tenth: each median is vague, their difference is sure."""
    random = np.random.default_rng(7)
    time_s = random.normal(30.0, 10.0, (60, 1)) + random.normal(0.0, 0.5, (60, 8))
    nobody = np.zeros((60, 8), bool)
    slower, faster = flights(time_s + 0.1, nobody), flights(time_s, nobody)
    found = paired_difference(slower, faster, 1)
    low, high = faster.medians.interval
    assert high - low > 2.0
    assert found.median_s == pytest.approx(0.1)
    assert found.median_ci95 == pytest.approx((0.1, 0.1))
    assert found.mean_s == pytest.approx(0.1)
    assert found.mean_ci95 == pytest.approx((0.1, 0.1))


def test_flights_that_collided_in_either_are_in_no_mean():
    time_s = np.full((6, 2), 10.0)
    ours, theirs = np.zeros((6, 2), bool), np.zeros((6, 2), bool)
    ours[0], theirs[1] = True, True
    late = time_s.copy()
    late[:2] = 99.0
    found = paired_difference(flights(late, ours), flights(time_s, theirs), 1)
    assert found.mean_s == 0.0
    assert (found.more_runs, found.fewer_runs, found.p_value, found.mac_rate) == (1, 1, 1.0, 0.0)
    low, high = found.mac_rate_ci95
    assert low < 0.0 < high


def test_where_no_run_differs_the_bound_is_that_of_zero():
    """Every resampled difference of nothing is nothing; that does not make it sure."""
    time_s, nobody = np.full((50, 8), 10.0), np.zeros((50, 8), bool)
    found = paired_difference(flights(time_s, nobody), flights(time_s, nobody), 1)
    high = clopper_pearson(0, 200)[1]
    assert found.mac_rate_ci95 == (-high, high)
    assert found.p_value == 1.0


def test_cells_of_different_runs_cannot_be_paired():
    time_s, nobody = np.full((4, 2), 10.0), np.zeros((4, 2), bool)
    one, other = flights(time_s, nobody), flights(time_s[:3], nobody[:3])
    with pytest.raises(ValueError, match=r"\(4, 2\) and \(3, 2\)"):
        paired_difference(one, other, 1)


def test_where_everybody_collided_nothing_is_compared():
    time_s, nobody = np.full((4, 2), 10.0), np.zeros((4, 2), bool)
    found = paired_difference(flights(time_s, ~nobody), flights(time_s, nobody), 1)
    assert (found.median_s, found.median_ratio, found.mean_s, found.mean_ci95) == (None, None, None, None)
    assert (found.mac_rate, found.more_runs) == (1.0, 4)
