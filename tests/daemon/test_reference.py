"""The reference of the configuration is the schema's, and its defaults are those of a program that is told nothing."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path

import click
import msgspec
import pytest

from ridlink.cli.avoid import avoid
from ridlink.daemon.config import DaemonConfig, as_toml
from ridlink.daemon.config_file import FlatConfig
from ridlink.daemon.reference import ELSEWHERE, reference
from ridlink.metrics import AVOID_METRICS, MQTT_METRICS, Kind, Metric

DOCS = Path(__file__).resolve().parents[2] / "docs"


def helps() -> dict[str, str]:
    return {p.name: p.help or "" for p in avoid.params if isinstance(p, click.Option) and p.name}


def test_the_document_is_what_the_schema_says() -> None:
    assert (DOCS / "configuration.md").read_text() == reference(helps())


def test_every_key_is_there_with_the_default_that_is_flown() -> None:
    text = (DOCS / "configuration.md").read_text()
    keys = {item.name for item in msgspec.structs.fields(FlatConfig)}
    assert all(f"`{key}`" in text or f"[{key}]" in text for key in keys)
    flown = tomllib.loads(as_toml(DaemonConfig()))
    for key, default in re.findall(r"^\| `(\w+)` \| [^|]+ \| ([^|]+) \|", text, re.M):
        if key in flown and key not in ELSEWHERE:
            told = flown[key]
            assert str(told).lower() == default or float(default) == told, key


@pytest.mark.parametrize("metrics", [AVOID_METRICS, MQTT_METRICS], ids=["avoid", "mqtt"])
def test_metrics_are_documented(metrics: Mapping[str, Metric]) -> None:
    rows = ["| metric | label | what it says |", "| --- | --- | --- |"]
    for name, metric in metrics.items():
        full = name + ("_total" if metric.kind is Kind.COUNTER else "")
        rows.append(f"| `{full}` | {f'`{metric.label}`' if metric.label else ''} | {metric.text} |")
    assert "\n".join(rows) in (DOCS / "metrics.md").read_text()
