"""What a daemon says of its own regularity."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.daemon import telling
from ridlink.daemon.events import summary_facts
from ridlink.daemon.summary import Pace, Spread, Summary
from ridlink.engine import Engine, EngineConfig


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=200))
def test_quantiles_are_numpys(values: list[float]) -> None:
    spread = Spread()
    for value in values:
        spread.add(value)
    p50, p99 = np.percentile(values, (50, 99))
    assert spread.summary() == pytest.approx({"p50": p50, "p99": p99, "max": max(values)}, abs=1e-3)
    of_these = values[-10:]
    expected = dict(zip(("0.5", "0.99", "1"), np.percentile(of_these, (50, 99, 100)), strict=True))
    assert spread.quantiles(10, 2.0) == pytest.approx({share: 2.0 * value for share, value in expected.items()})


def test_without_a_value_there_is_no_quantile() -> None:
    assert Spread().quantiles(10, 1.0) == {}
    assert Spread().summary() == {"p50": 0.0, "p99": 0.0, "max": 0.0}


def test_a_gap_lies_between_two_setpoints_of_one_stream() -> None:
    pace = Pace()
    for now_s, is_setpoint in ((9.9, False), (10.0, True), (10.1, True), (10.2, False), (20.0, True), (20.2, True)):
        pace.sent(is_setpoint, now_s)
    assert pace.gap_ms.summary() == {"p50": 150.0, "p99": 199.0, "max": 200.0}


def test_the_document_names_every_event_and_every_key_of_the_summaries() -> None:
    text = (Path(__file__).parents[2] / "docs" / "daemon.md").read_text().partition("## What it says")[2]
    section = text.partition("\n## ")[0]
    engine = Engine(EngineConfig(standby=True))
    keys = {*summary_facts(engine, engine.step(now_s=0.0).decision, {}), *(each.name for each in fields(Summary))}
    events = {*re.findall(r'emit\("(\w+)"', Path(telling.__file__).read_text()), "final"}
    assert len(events) == 7 and {*keys, *events} <= set(re.findall(r"`(\w+)`", section))


def test_no_quantile_imports_anything_in_flight() -> None:
    """numpy's own ones import masked arrays when they are first called: 20 ms of a control tick."""
    code = """
import sys
from ridlink.daemon.summary import Spread
from ridlink.engine import Engine, EngineConfig
from ridlink.engine.detection import DetectionWatch

before = set(sys.modules)
spread, watch = Spread(), DetectionWatch()
for value in range(10):
    spread.add(value)
    watch._first_heard_m.append(value)
spread.summary(), spread.quantiles(5, 1.0)
assert round(watch.given_m, 9) == 6.75
print(*sorted(set(sys.modules) - before))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
