"""All pairs at once: what each of them is alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.observer import (
    Scene,
    Sky,
    least_margin,
    nearest_of,
    pairs_at,
    pairs_of,
)
from ridlink.observer import pairs as under_test
from ridlink.observer.scene import CONSIDERED_M
from ridlink.separation.definitions import Definition
from ridlink.traffic.altitude import known_apart, vertical_bound
from tests.observer.flights import HOME, Flyer, a_crowd, frames

metres = st.floats(-900.0, 900.0)
speeds = st.floats(-15.0, 15.0)


def scene_of(flyers: list[Flyer]) -> Scene:
    sky = Sky(origin=HOME)
    for time_s, frame in frames(flyers, 0.3):
        sky.receive(frame, time_s)
    return sky.at(0.3)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(metres, metres, speeds, speeds), min_size=2, max_size=5, unique_by=lambda one: one[:2]))
def test_whoever_flies_on_until_then_stands_on_the_edge_of_the_disc(places: list[tuple[float, ...]]) -> None:
    scene = scene_of([Flyer(k + 1, place[:2], place[2:]) for k, place in enumerate(places)])  # type: ignore[arg-type]
    first, second = np.triu_indices(len(scene), 1)
    pairs = pairs_at(scene, first, second, Definition.CANDIDATE2)
    for i, j, distance, radius, entry_s in zip(
        first, second, pairs.distance_m, pairs.radius_m, pairs.entry_s, strict=True
    ):
        offset = scene.position_ne_m[j] - scene.position_ne_m[i]
        relative = scene.velocity_ne_mps[j] - scene.velocity_ne_mps[i]
        assert np.isclose(distance, np.hypot(*offset))
        if 0.0 < entry_s < np.inf:
            then = np.hypot(*(offset + entry_s * relative))
            assert np.isclose(then, radius, rtol=1e-4), "on the edge when it says so"
        elif entry_s == 0.0:
            assert distance < radius
        else:
            along = np.linspace(0.0, 300.0, 3001)[:, None] * relative + offset
            assert np.hypot(*along.T).min() > radius - 1e-6, "never"


@pytest.mark.parametrize("definition", Definition)
@pytest.mark.parametrize("side_m", [100.0, 1000.0, 6000.0, 50_000.0])
def test_nobody_is_missed_by_not_looking_at_all_pairs(
    monkeypatch: pytest.MonkeyPatch, definition: Definition, side_m: float
) -> None:
    monkeypatch.setattr(under_test, "FEW", 1)
    for seed, count in enumerate((1, 2, 3, 31, 32, 33, 150)):
        scene = a_crowd(seed, count, side_m)
        everybody = pairs_at(scene, *np.triu_indices(count, 1), definition)
        theirs = everybody.only(everybody.entry_s <= under_test.HORIZON_S)
        pairs = pairs_of(scene, definition)
        assert np.array_equal(pairs.first, theirs.first) and np.array_equal(pairs.second, theirs.second)
        assert np.allclose(pairs.entry_s, theirs.entry_s, rtol=1e-9)
        assert np.allclose(pairs.distance_m, theirs.distance_m) and not pairs.apart.any()
        assert np.allclose(pairs.radius_m, theirs.radius_m, rtol=1e-12)

        margin, distance = np.full((2, count, count), np.inf)
        for i, j in ((everybody.first, everybody.second), (everybody.second, everybody.first)):
            distance[i, j] = everybody.distance_m
            margin[i, j] = np.where(everybody.apart, np.inf, everybody.distance_m - everybody.radius_m)
        nearest = nearest_of(scene, definition)
        alone = ~np.isfinite(margin.min(axis=1))
        assert np.array_equal(nearest.who < 0, alone)
        assert np.allclose((nearest.distance_m - nearest.radius_m)[~alone], margin.min(axis=1)[~alone])

        margin[distance > CONSIDERED_M] = np.inf
        least = least_margin(scene, definition)
        assert len(least) == np.isfinite(margin).any()
        assert np.allclose(least.distance_m - least.radius_m, margin.min())


heights = st.one_of(st.just(np.nan), st.floats(400.0, 480.0))
lengths = st.one_of(st.just(np.nan), st.floats(-1.0, 20.0))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(heights, lengths, lengths, st.floats(-5.0, 5.0), st.floats(0.0, 3.0)), max_size=6))
def test_a_pair_is_apart_as_one_of_the_two_would_find_it_alone(told: list[tuple[float, ...]]) -> None:
    altitude, error, height, climb, age = np.array(told).reshape(-1, 5).T
    flyers = [Flyer(k + 1, (300.0 * k, 0.0), (0.0, 0.0)) for k in range(len(told))]
    scene = replace(scene_of(flyers), altitude_m=altitude, vertical_error_m=error, airframe_height_m=height,
                    climb_mps=climb, age_s=age)  # fmt: skip
    first, second = np.indices((len(told), len(told))).reshape(2, -1)
    apart = scene.apart_at(first, second).reshape(len(told), len(told))
    for i in range(len(told)):
        for j in range(len(told)):
            above = altitude[j] - altitude[i]
            bound = vertical_bound(
                above,
                error_m=(error[i], error[j]),
                height_m=(height[i], height[j]),
                climb_mps=(climb[i], climb[j]),
                age_s=max(age[i], age[j]),
                horizon_s=8.0,
            )
            assert apart[i, j] == known_apart(above, bound)


def test_the_pair_in_most_danger_is_not_always_the_nearest_one() -> None:
    large, near = Flyer(2, (0.0, 80.0), (0.0, 0.0), error_m=60.0), Flyer(3, (0.0, -60.0), (0.0, 0.0), error_m=1.0)
    scene = scene_of([Flyer(1, (0.0, 0.0), (0.0, 0.0), error_m=1.0), large, near])
    least = least_margin(scene, Definition.CANDIDATE2)
    assert {scene.names[k] for k in (least.first[0], least.second[0])} == {"1/1", "2/1"}


def test_nobody_and_those_at_other_heights_make_no_pair() -> None:
    assert not len(least_margin(Sky().at(0.0), Definition.CANDIDATE2))
    assert not len(pairs_of(Sky().at(0.0), Definition.CANDIDATE2))
    above = scene_of([Flyer(1, (0.0, 0.0), (0.0, 0.0)), Flyer(2, (5.0, 0.0), (0.0, 0.0), altitude_m=900.0)])
    assert not len(least_margin(above, Definition.CANDIDATE2)) and not len(pairs_of(above, Definition.CANDIDATE2))
