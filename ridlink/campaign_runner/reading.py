"""Reads the folder of a complete campaign for a report.

Shards have checksums; the table has none. So its rows are computed again from the shards, and a table that differs is
refused.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

from ridlink.analysis.campaign import FlownCell
from ridlink.campaign.cell import BASELINE, Cell
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.response import Dynamics
from ridlink.campaign.table import table_rows
from ridlink.campaign.worlds import Outcomes
from ridlink.campaign_runner.choice import SOLVERS
from ridlink.campaign_runner.folder import (
    CONFIGURATION,
    GO_ON,
    OF_ANOTHER,
    ROWS,
    cell_folder,
    object_in,
    shard_name,
    shortened,
)
from ridlink.campaign_runner.shards import campaign_digest, names_of, read_shard
from ridlink.captures.export.tables import arrow
from ridlink.checked_toml import finite_number
from ridlink.errors import CaptureError
from ridlink.separation.definitions import Definition
from ridlink.words import counted

KNOWN = {
    "definition": (*Definition, BASELINE), "gnss": tuple(ErrorModel), "solver": SOLVERS, "dynamics": tuple(Dynamics),
}  # fmt: skip
"""Allowed values of a cell, by key; its scenario is any text, and all other values are numbers."""

EQUAL = 1e-9
"""Relative difference up to which two figures count as equal, since machines round differently."""


def read_campaign(path: Path) -> tuple[dict[str, Any], list[FlownCell]]:
    """Configuration of a complete campaign, and its rows with their flights.

    Raises:
        CaptureError: If it is not complete, or damaged; the text names the file.
        MissingExtraError: If pyarrow is not installed.
        OSError: If a file cannot be read.
    """
    arrow()
    if not (path / CONFIGURATION).exists():
        raise CaptureError(f"{path}: holds no campaign")
    if not (path / ROWS).exists():
        raise CaptureError(f"{path}: is not complete; {GO_ON}")
    configuration = _configuration(path / CONFIGURATION)
    rows = _rows(path / ROWS, configuration["scenario"])
    seed: int = configuration["seed"]
    cells = {cell: _flown(path, cell, configuration) for cell in rows}
    known = set(map(cell_folder, rows))
    if not known or not known >= {file.parent.name for file in (path / "shards").glob("*/*.parquet")}:
        raise CaptureError(f"{path / ROWS}: lacks cells that were flown; {GO_ON}")
    flown = []
    for (cell, row), (ours, flights) in zip(rows.items(), table_rows(cells, seed), strict=True):
        _check_same(path / ROWS, cell, row, json.loads(json.dumps(ours.as_dict())))
        flown.append(FlownCell(row, flights, seed))
    return configuration, flown


def _configuration(file: Path) -> dict[str, Any]:
    """The configuration of a campaign; values that a report depends on are checked."""
    found = object_in(file)

    def check(name: str, holds: bool, what: str) -> None:
        if not holds:
            raise CaptureError(f"{file}: is damaged: {name} is not {what}")

    for name in ("seed", "runs"):
        value = found.get(name)
        check(name, type(value) is int and value >= 0, "a whole number from 0 up")
    sigmas = found.get("sigma_m")
    check(
        "sigma_m",
        isinstance(sigmas, list) and all(finite_number(each) is not None for each in sigmas),
        "a list of figures",
    )
    scenes = found.get("scenario")
    check("scenario", isinstance(scenes, dict), "an object")
    assert isinstance(scenes, dict)
    for name, scene in scenes.items():
        duration_s = finite_number(scene.get("duration_s")) if isinstance(scene, dict) else None
        check(f"duration_s of {name}", duration_s is not None and duration_s > 0.0, "a time above 0")
    return found


def _rows(file: Path, scenarios: Collection[str]) -> dict[Cell, dict[str, Any]]:
    """The rows of the table, by cell."""
    rows = object_in(file).get("rows")
    if not isinstance(rows, list):
        raise CaptureError(f"{file}: is damaged: it has no list of rows; {GO_ON}")
    found: dict[Cell, dict[str, Any]] = {}
    for number, row in enumerate(rows, start=1):
        wrong = _wrong_in(row, scenarios)
        if not wrong and (cell := Cell.of_row(row)) in found:
            wrong = "is there twice"
        if wrong:
            raise CaptureError(f"{file}: is damaged: row {number} {wrong}; {GO_ON}")
        found[cell] = row
    return found


def _wrong_in(row: object, scenarios: Collection[str]) -> str:
    """Why a row does not belong to a cell; empty if it does."""
    if not isinstance(row, dict):
        return "is no object"
    known: dict[str, Collection[str]] = {"scenario": scenarios, **KNOWN}
    for name in Cell.__slots__:
        if name not in row:
            return f"lacks {name}"
        value = row[name]
        is_any = isinstance(value, str) and value in known[name] if name in known else finite_number(value) is not None
        if not is_any:
            return f"has an unknown {name}, {shortened(value)}"
    return ""


def _flown(path: Path, cell: Cell, configuration: dict[str, Any]) -> Outcomes:
    """The outcomes of a cell, from all of its shards."""
    duration_s = configuration["scenario"][cell.scenario]["duration_s"]
    folder = path / "shards" / cell_folder(cell)
    parts = []
    for file in sorted(folder.glob("*.parquet")):
        try:
            shard = read_shard(file, duration_s)
        except CaptureError as error:
            raise CaptureError(f"{error}; {GO_ON}") from error
        for name, wanted in names_of(cell, configuration["seed"]).items():
            if shard.names[name] != wanted:
                raise CaptureError(f"{file}: is of another campaign: its {name} is not {wanted}")
        if shard.campaign not in ("", campaign_digest(configuration)):
            raise CaptureError(f"{file}: {OF_ANOTHER}, or {path / CONFIGURATION} was changed")
        if file.name != shard_name(int(shard.outcomes.run[0])):
            raise CaptureError(f"{file}: holds other runs than its name says; take it away")
        parts.append(shard.outcomes)
    runs = sum(len(part.run) for part in parts)
    if runs != configuration["runs"]:
        raise CaptureError(f"{folder}: has {counted(runs, 'run')} instead of {configuration['runs']}; {GO_ON}")
    try:
        outcomes = Outcomes.joined(parts)
    except ValueError as error:
        raise CaptureError(f"{folder}: not all shards have as many vehicles") from error
    if outcomes.run.tolist() != list(range(runs)):
        raise CaptureError(f"{folder}: does not hold the runs 0 to {runs - 1}, each once; {GO_ON}")
    return outcomes


def _check_same(file: Path, cell: Cell, row: dict[str, Any], ours: dict[str, Any]) -> None:
    """Check that a row agrees with the shards of its cell."""
    for name in [*ours, *row]:
        if name not in row or name not in ours:
            wrong = f"it {'lacks' if name in ours else 'has'} {name}"
        elif not _are_equal(row[name], ours[name]):
            wrong = f"{name} is {shortened(row[name])} and by them {shortened(ours[name])}"
        else:
            continue
        raise CaptureError(f"{file}: does not fit the shards of {cell_folder(cell)}: {wrong}; {GO_ON}")


def _are_equal(one: object, other: object) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_are_equal, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=EQUAL, abs_tol=EQUAL)
    return type(one) is type(other) and one == other
