"""The configuration file of a daemon: the keys of one TOML file. Flags override the file, the file overrides defaults.

    vehicle = "udpin:127.0.0.1:14540"
    rid = "udpout:127.0.0.1:14650"
    goal = [47.39, 8.54, 100.0]        # degrees, degrees, metres above mean sea level (may be left out)
    definition = "candidate2"
    cruise = 10.0

    solver = "halfplane"

    [halfplane]                        # constants of that solver; likewise [graded], [rotation]
    response_time_s = 1.0

    [[obstacle]]                       # static, never entered
    polygon = [[47.391, 8.541], [47.392, 8.541], [47.392, 8.543]]

An unknown key is an error, since a misspelt key must not silently mean the default. So is a number that is NaN.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import msgspec

from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.avoidance.types import SolverKind
from ridlink.checked_toml import MOST_FAULTS, TomlSource, parse_toml
from ridlink.errors import ConfigError
from ridlink.words import did_you_mean

SOLVER_TABLES = {
    SolverKind.HALFPLANE: HalfplaneSettings,
    SolverKind.GRADED: GradedSettings,
    SolverKind.ROTATION: RotationSettings,
}
"""Tables of a file with the constants of a solver, by the name of the solver."""

LONGEST = 1_048_576
"""Bytes read from a file at most, since it may be an endless device."""

KINDS = {
    "float": "a number", "int": "a whole number", "str": "text", "bool": "true or false", "array": "a list",
    "object": "a table",
}  # fmt: skip
"""Names of types in error texts, by the names that the reader uses."""


POLYGON = ("polygon",)
"""Keys of an [[obstacle]]."""

_IN_OBSTACLE = re.compile(r"\.obstacle\[(\d+)\](?:\.polygon\[(\d+)\])?")
"""Position of a value of the wrong type, counted from 0 by the reader; error texts count from 1."""


class ObstacleTable(msgspec.Struct, forbid_unknown_fields=True, kw_only=True, frozen=True):
    """One [[obstacle]]."""

    polygon: list[tuple[float, float]]


class FlatConfig(msgspec.Struct, kw_only=True, frozen=True):
    """The keys of a file, which are those of the command line with underscores; None if a key is not given."""

    vehicle: str | None = None
    rid: str | None = None
    goal: Annotated[list[float], msgspec.Meta(min_length=2, max_length=3)] | None = None
    standby: bool | None = None
    definition: str | None = None
    eta: float | None = None
    chance_bound: str | None = None
    accuracy_convention: str | None = None
    solver: str | None = None
    cruise: float | None = None
    airframe: float | None = None
    airframe_height: float | None = None
    v_max: float | None = None
    vz_max: float | None = None
    a_max: float | None = None
    response_time: float | None = None
    vertical: bool | None = None
    vertical_cost: float | None = None
    vertical_band: float | None = None
    min_height: float | None = None
    max_height: float | None = None
    vehicle_sysid: int | None = None
    uas_id: str | None = None
    filter_positions: bool | None = None
    log: str | None = None
    input_log: str | None = None
    guard: bool | None = None
    takeoff_aware: bool | None = None
    takeoff_height: float | None = None
    allow_v1: bool | None = None
    broadcast: bool | None = None
    broadcast_to: str | None = None
    broadcast_form: str | None = None
    operator_id: str | None = None
    signing_key: str | None = None
    require_signature: bool | None = None
    signing_link_id: int | None = None
    signing_state: str | None = None
    metrics: str | None = None
    dry_run: bool | None = None
    halfplane: dict[str, float] | None = None
    graded: dict[str, float] | None = None
    rotation: dict[str, float] | None = None
    obstacle: list[ObstacleTable] | None = None


def line_of(text: str, key: str, table: str = "", number: int = 0) -> str:
    """ ":line" of a key or table in a TOML text, empty if it is unknown.

    Args:
        text: TOML.
        key: The key, or a table at the top. If the table does not have it, the line of the table counts.
        table: The table with the key; empty at the top.
        number: Which of several tables of that name, from 1; 0 if there is one.
    """
    source = TomlSource("", text)
    line = source.line(table, number, key) or source.line("", 0, table) or source.line(key, 0, "")
    return f":{line}" if line else ""


def _unknown(
    given: Mapping[str, Any], known: Sequence[str], where: str, text: str, table: str = "", number: int = 0
) -> Iterator[str]:
    for key in given:
        if key not in known:
            hint = did_you_mean(key.replace("-", "_"), known) or f": known are {', '.join(known)}"
            yield f"{where}{line_of(text, key, table, number)}: unknown key {key!r}{hint}"


def _not_finite(value: Any, key: str, where: str, text: str, table: str = "", number: int = 0) -> Iterator[str]:
    if isinstance(value, float) and not math.isfinite(value):
        yield f"{where}{line_of(text, key, table, number)}: {key} must be a finite number, not {value}"
    if isinstance(value, dict):
        for name, inner in value.items():
            # In the table of a solver infinite is allowed: it means "stops at once".
            if key not in SOLVER_TABLES or inner != math.inf:
                yield from _not_finite(inner, name, where, text, key, number)
    if isinstance(value, list):
        for at, inner in enumerate(value, start=1):
            yield from _not_finite(inner, key, where, text, table, at if isinstance(inner, dict) else number)


def config_text(path: str | Path) -> str:
    """The text of a configuration file.

    Raises:
        ConfigError: If it is not text, or too long.
        OSError: If it cannot be read.
    """
    try:
        with open(path, "rb") as file:
            content = file.read(LONGEST + 1)
        if len(content) > LONGEST:
            raise ConfigError(f"{path}: is no configuration: longer than {LONGEST} bytes")
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text: {error.reason}") from error


def read_config_file(path: str | Path) -> FlatConfig:
    """Keys of a configuration file.

    Raises:
        ConfigError: If it is not TOML, has an unknown key, or a value of the wrong kind; the text names file, line and
            key. One line for each mistake, the first as its text, up to four more as `others`.
        OSError: If it cannot be read.
    """
    return read_config_text(config_text(path), str(path))


def read_config_text(text: str, where: str) -> FlatConfig:
    """Keys of a configuration.

    Args:
        text: TOML.
        where: Name of its origin, for error texts.

    Raises:
        ConfigError: As `read_config_file`.
    """
    document = parse_toml(text, where)
    faults = [*islice(_faults(document, where, text), MOST_FAULTS)]
    if faults:
        raise ConfigError(*faults)
    return msgspec.convert(document, FlatConfig)


def _faults(document: Mapping[str, Any], where: str, text: str) -> Iterator[str]:
    """One line for each mistake: unknown keys first, then wrong values."""
    known = [item.name for item in msgspec.structs.fields(FlatConfig)]
    yield from _unknown(document, known, where, text)
    for key, value in document.items():
        found = [*dict.fromkeys(_not_finite(value, key, where, text))]
        of_solver = key in SOLVER_TABLES and isinstance(value, dict)
        if of_solver:
            found += _unknown(value, [item.name for item in fields(SOLVER_TABLES[SolverKind(key)])], where, text, key)
        if key == "obstacle" and isinstance(value, list):
            for number, one in enumerate(value, start=1):
                found += _unknown(one, POLYGON, where, text, key, number) if isinstance(one, dict) else ()
        yield from found
        if not found and of_solver:
            for name, inner in value.items():
                yield from _wrong_kind(name, {key: {name: inner}}, where, text, key)
        elif not found:
            yield from _wrong_kind(key, {key: value}, where, text)


def _wrong_kind(key: str, document: Mapping[str, Any], where: str, text: str, table: str = "") -> Iterator[str]:
    try:
        msgspec.convert(document, FlatConfig)
    except msgspec.ValidationError as error:
        said, _, path = str(error).partition(" - at")
        line = line_of(text, key, table)
        if key == "goal":
            said = "goal must be [latitude, longitude] or [latitude, longitude, altitude]"
        else:
            for kind, words in KINDS.items():
                said = said.replace(f"`{kind} | null`", words).replace(f"`{kind}`", words)
            if found := _IN_OBSTACLE.search(path):
                obstacle, vertex = (None if index is None else int(index) + 1 for index in found.groups())
                line = line_of(text, "polygon", "obstacle", obstacle or 0)
                key = f"obstacle {obstacle}" + (f", vertex {vertex}" if vertex else "")
            said = f"{key}: {said[:1].lower()}{said[1:]}"
        yield f"{where}{line}: {said}"


def overridden(flat: FlatConfig, over: Mapping[str, Any]) -> FlatConfig:
    """The configuration with every value of ``over`` that is not None: flags override the file and defaults."""
    return msgspec.structs.replace(flat, **{key: value for key, value in over.items() if value is not None})
