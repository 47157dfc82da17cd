"""All pairs at once: what each of them is alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.observer import Scene, Sky, closing_times, pair_discs, pairs_of
from ridlink.separation.definitions import Definition
from ridlink.traffic.altitude import known_apart, vertical_bound
from tests.observer.flights import HOME, Flyer, frames

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
    pairs = pairs_of(scene, Definition.CANDIDATE2)
    assert np.array_equal(pairs.entry_s, closing_times(scene, pair_discs(scene, Definition.CANDIDATE2)))
    for i in range(len(scene)):
        for j in range(i):
            offset = scene.position_ne_m[j] - scene.position_ne_m[i]
            relative = scene.velocity_ne_mps[j] - scene.velocity_ne_mps[i]
            assert np.isclose(pairs.distance_m[i, j], np.hypot(*offset))
            entry_s = pairs.entry_s[i, j]
            if 0.0 < entry_s < np.inf:
                then = np.hypot(*(offset + entry_s * relative))
                assert np.isclose(then, pairs.radius_m[i, j], rtol=1e-4), "on the edge when it says so"
            elif entry_s == 0.0:
                assert pairs.distance_m[i, j] < pairs.radius_m[i, j]
            else:
                along = np.linspace(0.0, 300.0, 3001)[:, None] * relative + offset
                assert np.hypot(*along.T).min() > pairs.radius_m[i, j] - 1e-6, "never"


heights = st.one_of(st.just(np.nan), st.floats(400.0, 480.0))
lengths = st.one_of(st.just(np.nan), st.floats(-1.0, 20.0))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(heights, lengths, lengths, st.floats(-5.0, 5.0), st.floats(0.0, 3.0)), max_size=6))
def test_a_pair_is_apart_as_one_of_the_two_would_find_it_alone(told: list[tuple[float, ...]]) -> None:
    altitude, error, height, climb, age = np.array(told).reshape(-1, 5).T
    flyers = [Flyer(k + 1, (300.0 * k, 0.0), (0.0, 0.0)) for k in range(len(told))]
    scene = replace(scene_of(flyers), altitude_m=altitude, vertical_error_m=error, airframe_height_m=height,
                    climb_mps=climb, age_s=age)  # fmt: skip
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
            assert scene.apart()[i, j] == known_apart(above, bound)


def test_the_pair_in_most_danger_is_not_always_the_nearest_one() -> None:
    large, near = Flyer(2, (0.0, 80.0), (0.0, 0.0), error_m=60.0), Flyer(3, (0.0, -60.0), (0.0, 0.0), error_m=1.0)
    scene = scene_of([Flyer(1, (0.0, 0.0), (0.0, 0.0), error_m=1.0), large, near])
    least = pairs_of(scene, Definition.CANDIDATE2).least_margin()
    assert least is not None and {scene.names[k] for k in least} == {"1/1", "2/1"}


def test_nobody_and_those_at_other_heights_make_no_pair() -> None:
    assert pairs_of(Sky().at(0.0), Definition.CANDIDATE2).least_margin() is None
    above = scene_of([Flyer(1, (0.0, 0.0), (0.0, 0.0)), Flyer(2, (5.0, 0.0), (0.0, 0.0), altitude_m=900.0)])
    assert pairs_of(above, Definition.CANDIDATE2).least_margin() is None
