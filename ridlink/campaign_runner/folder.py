"""The folder of a campaign: its configuration, and what was flown, in shards that are whole or not there.

    campaign.json                        what is flown
    shards/<cell>/runs-000000.parquet    one row a run, beginning with that run
    rows.json                            the table, once everything is there

A shard is written under another name, forced onto the disk and renamed.
"""

from __future__ import annotations

import errno
import io
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from ridlink.campaign.plan import Cell, Plan
from ridlink.campaign.response import Dynamics
from ridlink.campaign.worlds import Outcomes
from ridlink.captures.export.tables import arrow
from ridlink.errors import CaptureError, ConfigError

CONFIGURATION = "campaign.json"
ROWS = "rows.json"
UNFINISHED = ".unfinished"
"""Suffix of what is half written."""
GO_ON = "go on with it by 'ridlink campaign run --resume'"
"""What flies what is missing or damaged."""


class CampaignFolder:
    """Where a campaign is kept.

    Args:
        path: The folder; made where it does not exist.
        configuration: Everything that the rows depend on, as JSON would give it back.
        resume: Go on with what is there.

    Raises:
        ConfigError: If there is a campaign in the folder, and `resume` is false or it is another one.
        MissingExtraError: If pyarrow is not installed.
        OSError: If the folder cannot be made or written.
    """

    def __init__(self, path: Path, configuration: dict[str, Any], *, resume: bool) -> None:
        self._arrow, self._parquet = arrow()
        self.path = path
        self._writing: Path | None = None
        known = path / CONFIGURATION
        if known.exists():
            _check_same(path, configuration, resume)
            if not os.access(path, os.W_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        elif path.is_dir() and any(not found.name.endswith(UNFINISHED) for found in path.iterdir()):
            raise ConfigError(f"{path}: is not empty and holds no campaign; name a new folder")
        else:
            if path.exists() and not path.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path))
            path.mkdir(parents=True, exist_ok=True)
            self._write(known, json.dumps(configuration, indent=1).encode())
        for left in path.rglob(f"*{UNFINISHED}"):
            left.unlink(missing_ok=True)

    def write(self, plan: Plan, outcomes: Outcomes) -> None:
        """Keep some runs of a plan; when this returns they are on the disk.

        Raises:
            OSError: If that fails; nothing is left of it.
        """
        pa = self._arrow
        runs = len(outcomes.run)
        columns = {name: pa.array([value] * runs).dictionary_encode() for name, value in asdict(plan.cell).items()}
        columns["seed"] = pa.array([plan.seed] * runs)
        for name in _columns():
            values = getattr(outcomes, name)
            columns[name] = pa.array(values.tolist() if values.ndim > 1 else values)
        buffer = io.BytesIO()
        self._parquet.write_table(pa.table(columns), buffer, compression="zstd")
        target = self._shard(plan, int(outcomes.run[0]))
        target.parent.mkdir(parents=True, exist_ok=True)
        self._write(target, buffer.getvalue())

    def read(self, plan: Plan, runs: range) -> Outcomes | None:
        """Runs of a plan, or None where they are missing or the shard is damaged.

        Raises:
            ConfigError: If the shard is whole, and of another seed, cell or runs.
        """
        shard = self._shard(plan, runs[0])
        if not shard.exists():
            return None
        try:
            table = self._parquet.read_table(io.BytesIO(shard.read_bytes()))
            outcomes = _outcomes(table, plan.duration_s)
            found = {name: table[name][0].as_py() for name in (*asdict(plan.cell), "seed")}
        except (self._arrow.ArrowInvalid, OSError, LookupError):
            return None
        for name, wanted in {**asdict(plan.cell), "seed": plan.seed}.items():
            if found[name] != wanted:
                raise ConfigError(
                    f"{shard}: is of another campaign: {name} is {found[name]} there and {wanted} here; take it away "
                    "or name a new folder"
                )
        if outcomes.run.tolist() != list(runs):
            raise ConfigError(f"{shard}: holds other runs than its name says; take it away or name a new folder")
        return outcomes

    def write_rows(self, rows: Sequence[dict[str, Any]]) -> None:
        """Keep the table."""
        self._write(self.path / ROWS, json.dumps({"rows": list(rows)}, indent=1).encode())

    def discard_unfinished(self) -> None:
        """Take away what is half written; may be called by a signal."""
        if self._writing is not None:
            self._writing.unlink(missing_ok=True)

    def _shard(self, plan: Plan, first: int) -> Path:
        return self.path / "shards" / _folder_of(plan.cell) / f"runs-{first:06d}.parquet"

    def _write(self, target: Path, data: bytes) -> None:
        working = self._writing = target.with_name(target.name + UNFINISHED)
        try:
            with open(working, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(working, target)
        except OSError as error:
            working.unlink(missing_ok=True)
            error.filename, error.filename2 = str(target), None
            raise
        finally:
            self._writing = None
        listing = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(listing)
        finally:
            os.close(listing)


def _columns() -> list[str]:
    return [name for name in Outcomes.__slots__ if name != "duration_s"]


def _check_same(path: Path, configuration: dict[str, Any], resume: bool) -> None:
    """A folder is gone on with by the campaign that began it, and by no other."""
    if not resume:
        raise ConfigError(f"{path}: holds a campaign already; go on with it by --resume, or name a new folder")
    try:
        found = _object_in(path / CONFIGURATION)
    except CaptureError as error:
        raise ConfigError(str(error)) from error
    wanted = json.loads(json.dumps(configuration))
    for key in [*wanted, *found]:
        if found.get(key) != wanted.get(key):
            raise ConfigError(f"{path}: holds another campaign: {_difference(key, found.get(key), wanted.get(key))}")


def _difference(key: str, there: object, here: object) -> str:
    """Where two values part, as deep as they have names for it."""
    while isinstance(there, dict) and isinstance(here, dict):
        absent = object()
        name = next(name for name in [*here, *there] if there.get(name, absent) != here.get(name, absent))
        if name not in there or name not in here:
            return f"{key} has {name} {'here' if name in here else 'there'} only"
        key, there, here = f"{key}.{name}", there[name], here[name]
    return f"{key} is {_short(there)} there and {_short(here)} here"


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def read_campaign(path: Path) -> tuple[dict[str, Any], list[tuple[dict[str, Any], Outcomes]]]:
    """Configuration of a complete campaign, and its rows with the outcomes behind them.

    Raises:
        CaptureError: If it is not complete, or damaged.
        MissingExtraError: If pyarrow is not installed.
        OSError: If a file cannot be read.
    """
    arrow()
    if not (path / CONFIGURATION).exists():
        raise CaptureError(f"{path}: holds no campaign")
    if not (path / ROWS).exists():
        raise CaptureError(f"{path}: is not complete; {GO_ON}")
    configuration, cells = _object_in(path / CONFIGURATION), []
    try:
        for row in _object_in(path / ROWS)["rows"]:
            cell = _folder_of(Cell(**{item.name: row[item.name] for item in fields(Cell)}))
            duration_s = configuration["scenario"][row["scenario"]]["duration_s"]
            shards = sorted((path / "shards" / cell).glob("*.parquet"))
            flown = [_read_shard(shard, duration_s, configuration["seed"]) for shard in shards]
            runs = sum(len(outcomes.run) for outcomes in flown)
            if not flown or runs != row["runs"]:
                raise CaptureError(f"{path}: has {runs} runs of {cell} instead of {row['runs']}; {GO_ON}")
            cells.append((row, Outcomes.joined(flown)))
    except (KeyError, TypeError) as error:
        raise CaptureError(f"{path}: is damaged: {CONFIGURATION} and {ROWS} are not those of a campaign") from error
    return configuration, cells


def _object_in(file: Path) -> dict[str, Any]:
    """What a JSON file of a campaign holds.

    Raises:
        CaptureError: If it is not a JSON object.
        OSError: If it cannot be read.
    """
    try:
        found = json.loads(file.read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise CaptureError(f"{file}: is damaged: {error}") from error
    if not isinstance(found, dict):
        raise CaptureError(f"{file}: is damaged: no JSON object")
    return found


def _read_shard(shard: Path, duration_s: float, seed: int) -> Outcomes:
    _, parquet = arrow()
    try:
        # read here, for pyarrow wants names in UTF-8, which a folder's need not be
        table = parquet.read_table(io.BytesIO(shard.read_bytes()))
        seeds, outcomes = set(table["seed"].unique().to_pylist()), _outcomes(table, duration_s)
    except (LookupError, TypeError, ValueError) as error:  # pyarrow's ArrowInvalid is a ValueError, too
        raise CaptureError(f"{shard}: is damaged; {GO_ON}") from error
    if seeds != {seed}:
        raise CaptureError(f"{shard}: is of another campaign: its seed is not {seed}")
    return outcomes


def _outcomes(table: Any, duration_s: float) -> Outcomes:
    return Outcomes(duration_s=duration_s, **{name: np.array(table[name].to_pylist()) for name in _columns()})


def _folder_of(cell: Cell) -> str:
    """Name of the folder of a cell: what it always has, and what of it is unusual."""
    # The name of a scene is the only part that may hold any character.
    parts = [quote(cell.scenario, safe=""), cell.definition, cell.gnss, cell.solver]
    if cell.dynamics != Dynamics.IDEAL:
        parts.append(cell.dynamics)
    for name, value, usual in (
        ("sigma", cell.sigma_m, 10.0), ("interval", cell.interval_s, 0.1), ("loss", cell.loss, 0.0)
    ):  # fmt: skip
        if value != usual:
            parts.append(f"{name}{value!r}")
    return "_".join(parts)
