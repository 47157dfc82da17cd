"""Recorded traffic under other definitions."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ridlink.observer import Scene
from ridlink.review import Source, Walk, together
from ridlink.review import whatif as under_test
from ridlink.review.approach import Approach, nearest_since
from ridlink.review.whatif import AHEAD_S, WhatIf
from ridlink.separation.definitions import Definition
from tests.captures.conftest import START_US, tlog_bytes
from tests.observer.flights import Flyer
from tests.review.recordings import NORTHBOUND, SOUTHBOUND, START_S, recorded, records

COLLIDING = replace(SOUTHBOUND, start_ne_m=(200.0, 0.1))


def judged(path: Path, *definitions: Definition, **options: Any) -> dict[str, dict[str, Any]]:
    whatif = WhatIf(definitions or tuple(Definition), **options)
    Walk([whatif]).through(together([Source(str(path))]))
    return {row["definition"]: row for row in (judgement.as_dict() for judgement in whatif.judgements)}


def test_a_pass_is_alerted_as_far_ahead_as_asked_and_as_long_as_it_lasts(tmp_path: Path) -> None:
    log = recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND], 26.0)
    row = judged(log)["candidate2"]
    assert (row["alerts"], row["entered"], row["macs"]) == (1, 1, 0)
    half_s = (23.6**2 - 6.0**2) ** 0.5 / 20.0  # inside the disc of 23.6 m, at 20 m/s
    assert row["alert_s"] == pytest.approx(AHEAD_S + 2.0 * half_s, abs=0.2)
    assert row["least_margin_m"] == pytest.approx(6.0 - 23.6, abs=0.1)
    assert row["least_margin_t"] - START_S == pytest.approx(20.0, abs=0.05)
    assert row["least_margin_uas"] == ["ALPHA", "BRAVO"] and row["least_warning_s"] is None
    at_once = judged(log, Definition.CANDIDATE2, ahead_s=0.0)["candidate2"]
    assert at_once["alert_s"] == pytest.approx(2.0 * half_s, abs=0.2)


def test_a_larger_disc_alerts_longer_and_has_less_margin(tmp_path: Path) -> None:
    rows = judged(recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND], 26.0))
    ordered = [rows[name] for name in ("snmac", "candidate2", "candidate1", "remote-id")]
    assert [row["alert_s"] for row in ordered] == sorted(row["alert_s"] for row in ordered)
    assert [row["least_margin_m"] for row in ordered] == sorted(
        (row["least_margin_m"] for row in ordered), reverse=True
    )


def test_who_passes_outside_is_a_margin_without_an_alert(tmp_path: Path) -> None:
    beside = replace(SOUTHBOUND, start_ne_m=(200.0, 60.0))
    row = judged(recorded(tmp_path / "f.tlog", [NORTHBOUND, beside], 30.0))["snmac"]
    assert (row["alerts"], row["alert_s"]) == (0, 0.0)
    assert row["least_margin_m"] == pytest.approx(45.0, abs=0.1)


def test_a_collision_is_announced_by_the_alert_before_it(tmp_path: Path) -> None:
    row = judged(recorded(tmp_path / "f.tlog", [NORTHBOUND, COLLIDING], 30.0))["candidate2"]
    assert (row["macs"], row["macs_without_alert"], row["alerts"]) == (1, 0, 1)
    assert row["least_warning_s"] == pytest.approx(AHEAD_S + 23.6 / 20.0, abs=0.2)


def test_a_collision_with_somebody_who_is_first_heard_in_it_is_not(tmp_path: Path) -> None:
    heard_late = [
        (time_us, frame)
        for time_us, frame in records([NORTHBOUND, COLLIDING], 25.0)
        if frame[5] == NORTHBOUND.sysid or time_us >= START_US + 20_000_000
    ]
    path = tmp_path / "f.tlog"
    path.write_bytes(tlog_bytes(heard_late))
    rows = judged(path)
    assert set(rows) == set(Definition)
    for row in rows.values():
        assert (row["macs"], row["macs_without_alert"], row["least_warning_s"]) == (1, 1, None)


def test_a_second_meeting_is_a_second_alert(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    again_us = START_US + 40_000_000
    flight = records([NORTHBOUND, SOUTHBOUND], 26.0) + records([NORTHBOUND, SOUTHBOUND], 26.0, from_us=again_us)
    path.write_bytes(tlog_bytes(flight))
    assert judged(path)["snmac"]["alerts"] == 2


def test_what_was_said_of_somebody_who_is_another_is_taken_back(tmp_path: Path) -> None:
    shadow = replace(NORTHBOUND, sysid=200, start_ne_m=(-200.2, 0.0), identity_from_s=3.0)
    row = judged(recorded(tmp_path / "f.tlog", [NORTHBOUND, shadow], 8.0))["candidate2"]
    assert (row["macs"], row["alerts"], row["entered"]) == (0, 0, 0)


def test_nothing_is_missed_by_not_looking_at_all_pairs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draws = np.random.default_rng(3)
    crowd = [
        Flyer(k + 1, tuple(draws.uniform(-600.0, 600.0, 2)), tuple(draws.uniform(-15.0, 15.0, 2)), error_m=5.0)
        for k in range(40)
    ]
    log = recorded(tmp_path / "f.tlog", crowd, 12.0)
    looked_at: list[int] = []

    def nearest(before: Scene | None, scene: Scene, within_m: float, *, ahead_s: float, everywhere: bool) -> Approach:
        approach = nearest_since(before, scene, np.inf if everywhere else within_m, ahead_s=ahead_s)
        looked_at.append(len(approach.first))
        return approach

    rows, pairs = [], []
    for everywhere in (True, False):
        monkeypatch.setattr(under_test, "nearest_since", partial(nearest, everywhere=everywhere))
        looked_at.clear()
        rows.append(judged(log))
        pairs.append(sum(looked_at))
    assert rows[0] == rows[1] and rows[0]["candidate2"]["alerts"] > 1
    assert pairs[1] < pairs[0] / 2


def test_nobody_and_one_alone_have_no_margin(tmp_path: Path) -> None:
    row = judged(recorded(tmp_path / "f.tlog", [NORTHBOUND], 3.0))["chance"]
    assert row["least_margin_m"] is None and row["least_margin_uas"] is None and row["alerts"] == 0


def test_heights_known_apart_are_no_alert(tmp_path: Path) -> None:
    high = Flyer(2, (200.0, 0.0), (-10.0, 0.0), b"BRAVO", altitude_m=750.0)
    row = judged(recorded(tmp_path / "f.tlog", [NORTHBOUND, high], 25.0))["remote-id"]
    assert (row["alerts"], row["macs"]) == (0, 0)
