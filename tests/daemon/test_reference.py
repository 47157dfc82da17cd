"""The reference of the configuration is the schema's, and its defaults are those of a program that is told nothing."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import click
import msgspec

from ridlink.cli.avoid import avoid
from ridlink.daemon.config import DaemonConfig, as_toml
from ridlink.daemon.config_file import FlatConfig
from ridlink.daemon.reference import ELSEWHERE, reference
from ridlink.metrics import AVOID_METRICS, MQTT_METRICS, metrics_table

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


def test_metrics_are_documented() -> None:
    text = (DOCS / "metrics.md").read_text()
    assert metrics_table(AVOID_METRICS) in text and metrics_table(MQTT_METRICS) in text
