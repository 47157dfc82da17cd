"""Instants are what the scenes were; a history keeps within its memory and finds what it has."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.observer import Sky
from ridlink.separation.definitions import Definition
from ridlink.view import book as reading
from ridlink.view.instants import COLUMNS, History, Instant, instant_of
from tests.observer.flights import HOME, Flyer, frames
from tests.view.serving import HEAD_ON, a_show


def moment(time_s: float, count: int = 3) -> Instant:
    names = tuple(f"N{k}" for k in range(count))
    return Instant(time_s, tuple(range(count)), names, np.zeros((count, COLUMNS), np.float32))


def test_an_instant_is_the_scene_that_it_was() -> None:
    sky = Sky(origin=HOME)
    for time_s, frame in frames(HEAD_ON, 1.0):
        sky.receive(frame, time_s)
    scene = sky.at(1.2)
    kept = instant_of(scene, {"ALPHA": (1.0, 2.0)})
    again = kept.scene()
    assert (again.time_s, again.names, again.numbers) == (1.2, scene.names, scene.numbers)
    for name in ("position_ne_m", "velocity_ne_mps", "command_ne_mps", "speed_mps", "airframe_m", "error_bound_m",
                 "accuracy_bound_m", "interval_s", "age_s", "altitude_m", "climb_mps", "vertical_error_m",
                 "airframe_height_m"):  # fmt: skip
        assert np.allclose(getattr(again, name), getattr(scene, name), rtol=1e-6, equal_nan=True), name
    assert again.avoiding.tolist() == scene.avoiding.tolist() and again.avoiding.dtype == np.bool_
    assert kept.truth_ne_m[scene.names.index("ALPHA")].tolist() == [1.0, 2.0]
    assert np.isnan(kept.truth_ne_m[scene.names.index("BRAVO")]).all()
    later = instant_of(sky.at(1.3), None, kept)
    assert later.names is kept.names and later.numbers is kept.numbers, "shared, not kept twice"


@settings(deadline=None, max_examples=50)
@given(st.integers(1, 400), st.integers(2_000, 60_000), st.integers(0, 8), st.booleans())
def test_memory_is_never_exceeded_and_what_is_kept_is_found(
    count: int, budget: int, vehicles: int, keeps_all: bool
) -> None:
    history = History(budget, keeps_all=keeps_all)
    for step in range(count):
        history.add(moment(step / 10.0, vehicles))
        assert history.bytes <= budget or len(history) == 1
    kept = [one.time_s for one in history]
    assert kept == sorted(kept) and len(kept) == len(history) > 0
    for number, time_s in enumerate(kept, history.first):
        assert history.find(time_s) == history.find(time_s + 0.01) == number
        assert history.at(number).time_s == time_s
    assert history.find(-1.0) == history.first, "before the beginning is the beginning"
    assert history.extent_s == (kept[0], kept[-1])
    if keeps_all:
        assert kept[0] == 0.0, "a recording loses every second instant, never its beginning"
    else:
        assert kept[-1] == (count - 1) / 10.0, "what goes on loses its oldest instants"
        with pytest.raises(IndexError):
            history.at(history.first - 1)
    with pytest.raises(IndexError):
        history.at(history.end)


def test_nothing_is_nothing() -> None:
    history = History()
    assert len(history) == 0 and history.find(1.0) is None and history.extent_s is None
    assert a_show([]).latest(Definition.CANDIDATE2, None) is None


def test_a_book_knows_the_encounter_and_how_tight_it_was_when() -> None:
    show = a_show([Flyer(1, (0.0, 0.0), (10.0, 0.0)), Flyer(2, (200.0, 5.0), (-10.0, 0.0))], 20.0)
    book = show.book(Definition.CANDIDATE2)
    assert not book.series(0.0, 20.0)[3] and not book.caught_up, "nothing has been read yet"
    while book.behind:
        book.read()
    assert book.caught_up
    book.end()
    [(number, encounter)] = book.encounters()
    assert number == 1 and set(encounter.pair) == {"1/1", "2/1"}
    assert encounter.closest_s == pytest.approx(10.0, abs=0.1) and encounter.closest_m == pytest.approx(5.0, abs=0.1)
    from_s, step_s, least, complete = book.series(0.0, 20.0)
    assert complete and (from_s, step_s) == (pytest.approx(0.1), pytest.approx(0.1))
    times = from_s + step_s * np.arange(len(least))
    assert least[:, 0] == pytest.approx(np.hypot(200.0 - 20.0 * times, 5.0), abs=0.5)
    assert np.all(least[:, 1] > 20.0)


def test_buckets_keep_the_least_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "MOST_POINTS", 30)
    show = a_show([Flyer(1, (0.0, 0.0), (10.0, 0.0)), Flyer(2, (200.0, 5.0), (-10.0, 0.0))], 20.0)
    book = show.book(Definition.CANDIDATE2)
    while book.read():
        continue
    _, step_s, least, _ = book.series(0.0, 20.0)
    assert len(least) == 30 and step_s > 0.1
    assert np.nanmin(least[:, 0]) == pytest.approx(5.0, abs=0.1), "the closest approach is not averaged away"
