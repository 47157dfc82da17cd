"""Shards: some runs of one cell as one Parquet file with checksums of its pages.

A shard reads exactly as it was written, or it is reported as damaged: a lost bit cannot change an outcome.
"""

from __future__ import annotations

import hashlib
import io
import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ridlink.campaign.cell import Cell
from ridlink.campaign.plan import Plan
from ridlink.campaign.worlds import Outcomes
from ridlink.captures.export.tables import arrow
from ridlink.errors import CaptureError

CAMPAIGN = "ridlink.campaign"
"""Key of the file's metadata for the digest of its campaign."""

NAMES = (*(item.name for item in fields(Cell)), "seed")
"""Columns that have one value in a shard."""

COLUMNS = {
    "run": (np.int64, 1),
    "arrival_s": (np.float64, 2),
    "collided": (np.bool_, 2),
    "distance_m": (np.float64, 1),
    "margin_m": (np.float64, 1),
    "decisions": (np.int64, 1),
    "infeasible": (np.int64, 1),
    "in_obstacle": (np.int64, 1),
}
"""Columns of `Outcomes`: type, and number of axes."""


@dataclass(frozen=True, slots=True)
class Shard:
    """The contents of a shard.

    Attributes:
        names: Its cell and its seed, by the keys of `NAMES`.
        outcomes: Its runs.
        campaign: `campaign_digest` of its campaign; empty if the file has none.
    """

    names: dict[str, Any]
    outcomes: Outcomes
    campaign: str


def names_of(cell: Cell, seed: int) -> dict[str, Any]:
    """The values of a shard of a cell, by the keys of `NAMES`."""
    return {**asdict(cell), "seed": seed}


def campaign_digest(configuration: dict[str, Any]) -> str:
    """Digest of everything that distinguishes a campaign from others: 64 hexadecimal digits."""
    return hashlib.sha256(json.dumps(configuration, sort_keys=True).encode()).hexdigest()


def shard_bytes(plan: Plan, outcomes: Outcomes, campaign: str) -> bytes:
    """Runs of a plan as a Parquet file, with the digest of their campaign."""
    pa, parquet = arrow()
    runs = len(outcomes.run)
    columns = {name: pa.array([value] * runs).dictionary_encode() for name, value in asdict(plan.cell).items()}
    columns["seed"] = pa.array([plan.seed] * runs)
    for name, (_, axes) in COLUMNS.items():
        values = getattr(outcomes, name)
        columns[name] = pa.array(values.tolist() if axes > 1 else values)
    buffer = io.BytesIO()
    table = pa.table(columns).replace_schema_metadata({CAMPAIGN: campaign})
    parquet.write_table(table, buffer, compression="zstd", write_page_checksum=True)
    return buffer.getvalue()


def read_shard(file: Path, duration_s: float) -> Shard:
    """Read a shard.

    Args:
        file: Its path.
        duration_s: Cut-off of its flights, which the file does not contain.

    Raises:
        CaptureError: If it is damaged.
        OSError: If it cannot be read.
    """
    pa, parquet = arrow()
    data = file.read_bytes()  # read here, for pyarrow wants names in UTF-8, which a folder's need not be
    try:
        table = parquet.read_table(io.BytesIO(data), page_checksum_verification=True)
        names = {name: _only(table[name].to_pylist()) for name in NAMES}
        columns = {name: _column(table[name].to_pylist(), *kind) for name, kind in COLUMNS.items()}
        if not _can_be(columns):
            raise ValueError("columns do not hold what flights bring forth")
    except (pa.ArrowException, OSError, LookupError, TypeError, ValueError, OverflowError) as error:
        raise CaptureError(f"{file}: is damaged") from error
    campaign = (table.schema.metadata or {}).get(CAMPAIGN.encode(), b"").decode("ascii", "replace")
    return Shard(names, Outcomes(duration_s=duration_s, **columns), campaign)


def _can_be(columns: dict[str, NDArray[Any]]) -> bool:
    """Whether the columns are plausible: a vehicle that collides does not arrive, and only margins are below zero."""
    arrived, collided = np.isfinite(columns["arrival_s"]), columns["collided"]
    if arrived.shape != collided.shape or np.any(arrived & collided):
        return False
    if np.any(columns["infeasible"] > columns["decisions"]):
        return False
    return all(np.all(values >= 0) for name, values in columns.items() if name != "margin_m")


def _only(values: list[Any]) -> Any:
    (value,) = set(values)
    return value


def _column(values: list[Any], kind: type[np.generic], axes: int) -> NDArray[Any]:
    column = np.array(values)
    if column.dtype != kind or column.ndim != axes or np.isnan(column).any():
        raise ValueError("a column does not hold what such columns hold")
    return column
