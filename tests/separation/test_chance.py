"""The chance constraint: its three forms, the risk shared by neighbours, and what is left of it after a mission."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ridlink.separation import ChanceBound, Definition, Reported, separation_discs
from ridlink.separation.chance import (
    chance_error_sum,
    eta_of_mission,
    independent_draws,
    instant_probability,
    mission_probability,
    pair_risk,
)

SIGMA_M = 10.0
BOUND_M = 3.0 * SIGMA_M
AIRFRAME_M = 3.8
ONE = Reported(AIRFRAME_M, BOUND_M, BOUND_M, speed_mps=10.0)
PAIR = (ONE, ONE)
STILL = {"interval_s": 0.0}
"""Nothing flown between two reports: what is left is errors."""

FloatArray = NDArray[np.float64]


def tangent(reported_m: FloatArray, radius_m: float, side: FloatArray) -> FloatArray:
    """Direction in which own-ship flies relative to each neighbour: on the boundary of the constraint, past one side
    of the disc of a reported position, or across inside it; shape (n, 2)."""
    distance = np.hypot(reported_m[:, 0], reported_m[:, 1])
    opening = np.arcsin(np.minimum(radius_m / np.maximum(distance, 1e-9), 1.0))
    bearing = np.arctan2(reported_m[:, 1], reported_m[:, 0]) + side * opening
    return np.stack((np.cos(bearing), np.sin(bearing)), axis=1)


def miss(position_m: FloatArray, direction: FloatArray) -> FloatArray:
    """True distance at the closest approach, from now on."""
    along = (position_m * direction).sum(axis=1)
    across = np.abs(position_m[:, 0] * direction[:, 1] - position_m[:, 1] * direction[:, 0])
    return np.where(along > 0.0, across, np.hypot(position_m[:, 0], position_m[:, 1]))


def most_failures(count: int, risk: float) -> float:
    """What a binomial number of failures exceeds in five cases of a hundred."""
    return count * risk + 1.645 * math.sqrt(count * risk * (1.0 - risk)) + 0.5


def drifted(error_m: FloatArray, correlation: float, sigma_m: float, random: np.random.Generator) -> FloatArray:
    """The error one step later: fresh (0), drifting (0.99 a step of 0.1 s is ten seconds), or the same for ever (1)."""
    if correlation == 1.0:
        return error_m
    fresh = random.normal(0.0, sigma_m, error_m.shape)
    return correlation * error_m + math.sqrt(1.0 - correlation**2) * fresh


@pytest.mark.parametrize(
    ("eta", "contours", "covariance", "halfplane"),
    [(0.95, 54.2, 34.6, 23.3), (0.99, 65.1, 42.9, 32.9), (0.999, 78.0, 52.6, 43.7)],
)
def test_distance_beyond_the_airframes_of_two_vehicles_with_ten_metres(eta, contours, covariance, halfplane):
    """Beside them the paper's three sigma each, 60 m whatever eta is."""
    printed = {"contours": contours, "covariance": covariance, "halfplane": halfplane}
    for bound, expected in printed.items():
        kept = chance_error_sum(BOUND_M, BOUND_M, eta=eta, bound=ChanceBound(bound))
        assert kept == pytest.approx(expected, abs=0.05)
    three_sigma = separation_discs(Definition.CANDIDATE2, *PAIR, **STILL).error_sum_m
    assert three_sigma == pytest.approx(60.0)
    relative = SIGMA_M * math.sqrt(2.0)
    assert chance_error_sum(BOUND_M, BOUND_M, eta=eta) == pytest.approx(NormalDist(sigma=relative).inv_cdf(eta))


@pytest.mark.parametrize("eta", [0.95, 0.99, 0.999])
@pytest.mark.parametrize(("own_sigma", "sigma"), [(10.0, 10.0), (3.5, 10.0)])
@pytest.mark.parametrize("correlation", [0.0, 0.99], ids=["white", "drifting"])
def test_of_random_encounters_no_more_than_the_rest_of_eta_comes_too_close(eta, own_sigma, sigma, correlation) -> None:
    """Pairs anywhere about each other fly a second along the boundary, choosing anew on each report; judged is the true
    miss distance of the last choice, against the airframes, with 95 % binomial confidence."""
    random = np.random.default_rng(17)
    both = math.hypot(own_sigma, sigma)
    pair = replace(ONE, error_bound_m=3.0 * own_sigma), replace(ONE, error_bound_m=3.0 * sigma)
    radius = float(separation_discs(Definition.CHANCE, *pair, **STILL, eta=eta).radius_m)
    position = random.uniform(-250.0, 250.0, (130_000, 2))
    side = random.choice([-1.0, 1.0], len(position))
    error = random.normal(0.0, both, position.shape)
    for _ in range(4):
        position = position - tangent(position + error, radius, side) * 5.0
        error = drifted(error, correlation, both, random)
    reported = position + error
    judged = np.hypot(reported[:, 0], reported[:, 1]) > radius  # inside, nobody can keep it any more
    assert judged.sum() > 100_000
    true_miss = miss(position, tangent(reported, radius, side))[judged]
    failures = int(np.sum(true_miss < AIRFRAME_M))
    assert failures <= most_failures(len(true_miss), 1.0 - eta)
    # One-sided means that next to nothing is given away: a bound that held twice as much would be another bound.
    assert failures > len(true_miss) * (1.0 - eta) / 2.0
    assert true_miss.mean() - AIRFRAME_M == pytest.approx(radius - AIRFRAME_M, abs=0.5)


@pytest.mark.parametrize("correlation", [0.0, 0.99, 1.0], ids=["white", "drifting", "bias"])
def test_of_whole_encounters_no_more_than_the_rest_of_eta_collides(correlation: float) -> None:
    """Own-ship means to fly straight on and leaves its course as little as the constraint allows, 8 s long."""
    eta, random = 0.99, np.random.default_rng(23)
    relative = SIGMA_M * math.sqrt(2.0)
    radius = float(separation_discs(Definition.CHANCE, *PAIR, **STILL, eta=eta).radius_m)
    count = 20_000
    position = np.stack((np.full(count, 120.0), random.uniform(-radius, radius, count)), axis=1)
    error = random.normal(0.0, relative, position.shape)
    closest, decisions, failures = np.full(count, np.inf), 0, 0
    for _ in range(80):
        reported = position + error
        bearing = np.arctan2(reported[:, 1], reported[:, 0])
        distance = np.hypot(reported[:, 0], reported[:, 1])
        in_conflict = np.abs(bearing) < np.arcsin(np.minimum(radius / distance, 1.0))
        avoiding = tangent(reported, radius, np.where(bearing > 0.0, -1.0, 1.0))
        direction = np.where(in_conflict[:, None], avoiding, [1.0, 0.0])
        judged = in_conflict & (distance > radius)
        decisions += int(judged.sum())
        failures += int(np.sum(miss(position, direction)[judged] < AIRFRAME_M))
        position = position - 3.0 * direction
        error = drifted(error, correlation, relative, random)
        closest = np.minimum(closest, np.hypot(position[:, 0], position[:, 1]))
    assert failures <= decisions * (1.0 - eta), "per instant"
    collisions = int(np.sum(closest < AIRFRAME_M))
    assert collisions <= most_failures(count, 1.0 - eta), "and per encounter"
    if correlation == 1.0:
        assert collisions > count * (1.0 - eta) / 2.0, "one draw for the whole encounter: nothing evens out"


def test_neighbours_share_the_risk() -> None:
    """Own-ship touches the constraints of n neighbours at once: its own error is in all of them, yet all hold."""
    eta, neighbours, random = 0.99, 5, np.random.default_rng(3)
    kept = chance_error_sum(BOUND_M, BOUND_M, eta=eta, neighbours=neighbours)
    alone = chance_error_sum(BOUND_M, BOUND_M, eta=eta)
    count = 100_000
    normal = random.uniform(0.0, 2.0 * math.pi, (count, neighbours))
    normal = np.stack((np.cos(normal), np.sin(normal)), axis=-1)
    own = random.normal(0.0, SIGMA_M, (count, 1, 2))
    error = ((own - random.normal(0.0, SIGMA_M, (count, neighbours, 2))) * normal).sum(axis=-1)
    assert np.sum((error > kept).any(axis=1)) <= most_failures(count, 1.0 - eta)
    assert np.sum((error > alone).any(axis=1)) > 3.0 * count * (1.0 - eta), "without sharing it does not hold"
    assert pair_risk(eta, [0, 1, 5]) == pytest.approx([0.01, 0.01, 0.002])


def test_a_velocity_error_counts_as_a_position_error_at_the_closest_approach() -> None:
    """A neighbour whose velocity is 1 m/s wrong on either axis, 10 s before: bounds grow as the module says."""
    eta, closest_s, speed, random = 0.99, 10.0, 15.0, np.random.default_rng(29)
    count, velocity_sigma = 100_000, 1.0
    position = np.array([[speed * closest_s, 0.0]]) + random.normal(0.0, 60.0, (count, 2))
    grown = math.hypot(BOUND_M, 3.0 * velocity_sigma * closest_s)
    for bound, holds in ((grown, True), (BOUND_M, False)):
        radius = float(
            separation_discs(Definition.CHANCE, ONE, replace(ONE, error_bound_m=bound), **STILL, eta=eta).radius_m
        )
        reported = position + random.normal(0.0, SIGMA_M * math.sqrt(2.0), position.shape)
        judged = np.abs(np.hypot(reported[:, 0], reported[:, 1]) - speed * closest_s) < 20.0
        planned = speed * tangent(reported, radius, random.choice([-1.0, 1.0], count))
        true = planned + random.normal(0.0, velocity_sigma, planned.shape)
        direction = true / np.hypot(true[:, 0], true[:, 1])[:, None]
        failures = int(np.sum(miss(position, direction)[judged] < AIRFRAME_M))
        assert (failures <= most_failures(int(judged.sum()), 1.0 - eta)) == holds


def test_what_each_definition_guarantees_at_one_instant() -> None:
    """The figures in the documentation of the definitions."""
    for definition, equal in (("candidate1", 0.999988), ("candidate2", 0.999988), ("remote-id", 1.0 - 1e-8)):
        slack = separation_discs(Definition(definition), *PAIR, **STILL).error_sum_m
        assert instant_probability(slack, BOUND_M, BOUND_M) >= equal
    assert instant_probability(BOUND_M + np.array([0.0, 5.0, 60.0]), BOUND_M, [0.0, 5.0, 60.0]) == pytest.approx(
        [0.99865, 0.99972, 0.99997], abs=6e-6
    )
    assert 1.0 - math.exp(-4.5) == pytest.approx(0.989, abs=2e-4)
    snmac = separation_discs(Definition.SNMAC, *PAIR, **STILL)
    assert instant_probability(snmac.radius_m - AIRFRAME_M, BOUND_M, BOUND_M) == pytest.approx(0.79, abs=0.01)
    for eta in (0.6, 0.95, 0.999, 1.0 - 1e-12):
        slack = chance_error_sum(BOUND_M, 5.0, eta=eta)
        assert instant_probability(slack, BOUND_M, 5.0) == pytest.approx(eta, abs=1e-12)
    assert instant_probability([-1.0, 0.0, 1.0], 0.0, 0.0).tolist() == [0.0, 1.0, 1.0]


def test_what_is_left_of_each_definition_after_an_hour_of_conflict() -> None:
    """361 draws, as in the documentation of the definitions."""
    hour = (3600.0, 10.0)
    assert independent_draws(*hour) == 361.0

    def held(definition: str, other_bound_m: float = BOUND_M, **chance: float) -> float:
        discs = separation_discs(
            Definition(definition), ONE, replace(ONE, error_bound_m=other_bound_m), **STILL, **chance
        )
        instant = instant_probability(discs.radius_m - AIRFRAME_M, BOUND_M, other_bound_m)
        return float(instant) ** independent_draws(*hour)

    assert held("snmac") < 1e-9
    assert held("remote-id") > 1.0 - 361e-8
    assert held("candidate2") == pytest.approx(0.996, abs=5e-4)
    assert held("candidate2", 0.0) == pytest.approx(0.614, abs=1e-3)
    assert (
        held("chance", eta=0.999) == pytest.approx(mission_probability(0.999, *hour)) == pytest.approx(0.70, abs=0.01)
    )
    assert held("chance", eta=eta_of_mission(0.999, *hour)) == pytest.approx(0.999)


def test_snmac_lets_one_encounter_in_five_collide() -> None:
    random = np.random.default_rng(31)
    position = random.uniform(-250.0, 250.0, (50_000, 2))
    reported = position + random.normal(0.0, SIGMA_M * math.sqrt(2.0), position.shape)
    radius = float(separation_discs(Definition.SNMAC, *PAIR, **STILL).radius_m)
    touched = miss(position, tangent(reported, radius, np.ones(len(position)))) < AIRFRAME_M
    held = float(instant_probability(radius - AIRFRAME_M, BOUND_M, BOUND_M))
    missed_on_the_other_side = float(instant_probability(-radius - AIRFRAME_M, BOUND_M, BOUND_M))
    assert touched.mean() == pytest.approx(1.0 - held - missed_on_the_other_side, abs=0.01)


@pytest.mark.parametrize(("correlation", "time_constant_s"), [(0.0, 0.1), (1.0, math.inf)], ids=["white", "bias"])
def test_mission_of_white_errors_and_of_a_bias(correlation: float, time_constant_s: float) -> None:
    """Fresh errors at each of 50 steps, or one for all of them: `eta^(1 + T/T_c)` exactly."""
    eta, steps, random = 0.99, 50, np.random.default_rng(41)
    count, limit = 40_000, NormalDist().inv_cdf(eta)
    error, held = random.normal(size=count), np.ones(count, bool)
    for _ in range(steps):
        held &= error < limit
        error = drifted(error, correlation, 1.0, random)
    expected = mission_probability(eta, 0.1 * (steps - 1), time_constant_s)
    assert held.mean() == pytest.approx(expected, abs=4.0 * math.sqrt(expected * (1.0 - expected) / count))
    assert expected == pytest.approx(eta**steps if correlation == 0.0 else eta)


def test_mission_of_drifting_errors() -> None:
    """Encounters one correlation time apart hold at least `eta^(1 + T/T_c)`; every instant between them does not."""
    eta, random = 0.99, np.random.default_rng(43)
    count, limit, correlation = 20_000, NormalDist().inv_cdf(eta), 0.99
    time_constant_s = -0.1 / math.log(correlation)
    error = random.normal(size=count)
    encounters = error < limit
    instants = encounters.copy()
    steps = 200
    for step in range(1, steps + 1):
        error = drifted(error, correlation, 1.0, random)
        instants &= error < limit
        if step % round(10.0 * time_constant_s) == 0:
            encounters &= error < limit
    promised = mission_probability(eta, 0.1 * steps, time_constant_s)
    assert promised - 4.0 * math.sqrt(promised * (1.0 - promised) / count) <= encounters.mean() < eta
    every_instant = eta * math.exp(-limit * NormalDist().pdf(limit) * 0.1 * steps / time_constant_s)
    assert instants.mean() == pytest.approx(every_instant, abs=0.03)
    assert instants.mean() < promised - 0.05


@given(st.floats(0.5, 0.999999), st.floats(0.0, 3600.0), st.floats(0.1, 100.0))
def test_eta_of_a_mission_gives_the_mission_back(probability: float, duration_s: float, time_constant_s: float) -> None:
    eta = eta_of_mission(probability, duration_s, time_constant_s)
    if eta < 1.0:
        assert mission_probability(eta, duration_s, time_constant_s) == pytest.approx(probability, rel=1e-6)
    assert independent_draws(0.0, time_constant_s) == 1.0 <= independent_draws(duration_s, time_constant_s)


@given(
    st.floats(0.0, 185.0), st.floats(0.0, 185.0), st.floats(1e-6, 1.0 - 1e-12), st.integers(0, 300),
)  # fmt: skip
def test_the_three_forms_are_ordered(own: float, other: float, eta: float, neighbours: int) -> None:
    halfplane, covariance, contours = (
        float(chance_error_sum(own, other, eta=eta, neighbours=neighbours, bound=bound)) for bound in ChanceBound
    )
    assert 0.0 <= halfplane <= covariance + 1e-9
    assert covariance <= contours + 1e-9
    assert math.isfinite(contours)


def test_counts_broadcast_over_batches() -> None:
    kept = chance_error_sum(np.full((4, 1), 30.0), np.full(3, 30.0), neighbours=np.array([[1], [2], [7], [7]]))
    assert kept.shape == (4, 3)
    assert np.all(np.diff(kept[:, 0]) >= 0.0)
    assert kept[2, 1] == pytest.approx(chance_error_sum(30.0, 30.0, neighbours=7))
    empty = separation_discs(Definition.CHANCE, ONE, replace(ONE, airframe_m=np.empty(0)), neighbours=0)
    assert empty.radius_m.shape == (0,)


@pytest.mark.parametrize("eta", [0.0, 1.0, -0.5, 1.5, math.nan, math.inf])
def test_an_eta_that_is_no_probability_is_refused(eta: float) -> None:
    with pytest.raises(ValueError, match=f"got {eta:g}"):
        separation_discs(Definition.CHANCE, *PAIR, **STILL, eta=eta)
    with pytest.raises(ValueError, match=f"got {eta:g}"):
        mission_probability(eta, 1.0, 1.0)


@pytest.mark.parametrize("count", [math.nan, -1.0, math.inf])
def test_a_number_of_neighbours_that_is_none_is_refused(count: float) -> None:
    with pytest.raises(ValueError, match=f"^neighbours must be .* got {count:g}"):
        separation_discs(Definition.CHANCE, *PAIR, **STILL, neighbours=np.array([1.0, count]))


@pytest.mark.parametrize("bound_m", [math.nan, -1.0, math.inf])
@pytest.mark.parametrize("whose", ["own_error_bound_m", "error_bound_m"])
def test_an_error_bound_that_is_none_is_refused(whose: str, bound_m: float) -> None:
    bounds = {"own_error_bound_m": 3.0, "error_bound_m": np.array([3.0, 3.0])} | {whose: np.array([3.0, bound_m])}
    with pytest.raises(ValueError, match=f"^{whose} must be .* got {bound_m:g}"):
        chance_error_sum(**bounds)
    with pytest.raises(ValueError, match=f"^{whose} must be .* got {bound_m:g}"):
        instant_probability(1.0, **bounds)
    with pytest.raises(ValueError, match="slack_m"):
        instant_probability(math.nan, 3.0, 3.0)


@pytest.mark.parametrize(("duration_s", "time_constant_s"), [(-1.0, 1.0), (math.inf, 1.0), (1.0, 0.0), (1.0, math.nan)])
def test_a_meaningless_mission_is_refused(duration_s: float, time_constant_s: float) -> None:
    with pytest.raises(ValueError, match="must be"):
        independent_draws(duration_s, time_constant_s)
