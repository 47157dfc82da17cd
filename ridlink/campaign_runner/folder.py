"""The folder of a campaign: its configuration, and its results in shards, which are complete or absent.

    campaign.json                        what is flown
    shards/<cell>/runs-000000.parquet    one row a run, beginning with that run
    rows.json                            the table, once everything is there

Every file is written under a temporary name, synchronised to the disk and renamed.
"""

from __future__ import annotations

import errno
import fcntl
import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ridlink.campaign.cell import USUAL, Cell
from ridlink.campaign.plan import Plan
from ridlink.campaign.worlds import Outcomes
from ridlink.campaign_runner.shards import campaign_digest, names_of, read_shard, shard_bytes
from ridlink.captures.export.tables import arrow
from ridlink.errors import CaptureError, ConfigError
from ridlink.files import UNFINISHED, file_part, unfinished, write_whole

CONFIGURATION = "campaign.json"
ROWS = "rows.json"
GO_ON = "go on with it by its own 'ridlink campaign run ...' and --resume"
"""Advice on how to fly missing or damaged shards."""


OF_ANOTHER = "is of another campaign, whose conditions differ"


class CampaignFolder:
    """The folder of a campaign; one process at a time may write to it.

    Args:
        path: The folder; created if it does not exist.
        configuration: Everything that the rows depend on, as read back from JSON.
        resume: Continue an existing campaign.

    Raises:
        ConfigError: If there is a campaign in the folder, and `resume` is false or it is another one; or if another
            process is flying it.
        MissingExtraError: If pyarrow is not installed.
        OSError: If the folder cannot be made or written.
    """

    def __init__(self, path: Path, configuration: dict[str, Any], *, resume: bool) -> None:
        arrow()
        self.path = path
        self._campaign = campaign_digest(configuration)
        self._writing: Path | None = None
        if path.exists() and not path.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path))
        path.mkdir(parents=True, exist_ok=True)
        self._held = os.open(path, os.O_RDONLY)
        try:
            self._begin(configuration, resume)
        except BaseException:
            self.close()
            raise

    def _begin(self, configuration: dict[str, Any], resume: bool) -> None:
        path, known = self.path, self.path / CONFIGURATION
        _hold(path, self._held)
        if known.exists():
            _check_same(path, configuration, resume)
            if not os.access(path, os.W_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        elif any(not found.name.endswith(UNFINISHED) for found in path.iterdir()):
            raise ConfigError(f"{path}: is not empty and holds no campaign; name a new folder")
        else:
            self._write(known, json.dumps(configuration, indent=1).encode())
        for left in path.rglob(f"*{UNFINISHED}"):
            left.unlink(missing_ok=True)

    def close(self) -> None:
        """Release the folder for other processes."""
        os.close(self._held)

    def write(self, plan: Plan, outcomes: Outcomes) -> None:
        """Save some runs of a plan; they are on the disk when this returns.

        Raises:
            OSError: If that fails; no part of the file is left.
        """
        target = self._shard(plan, int(outcomes.run[0]))
        target.parent.mkdir(parents=True, exist_ok=True)
        self._write(target, shard_bytes(plan, outcomes, self._campaign))

    def read(self, plan: Plan, runs: range) -> Outcomes | None:
        """Runs of a plan, or None if they are missing or the shard is damaged.

        Raises:
            ConfigError: If the shard is intact, but has another seed, cell or runs.
        """
        file = self._shard(plan, runs[0])
        try:
            shard = read_shard(file, plan.duration_s)
        except (CaptureError, OSError):
            return None
        if shard.outcomes.arrival_s.shape[1] != len(plan.scene):
            return None
        for name, wanted in names_of(plan.cell, plan.seed).items():
            if shard.names[name] != wanted:
                raise ConfigError(
                    f"{file}: is of another campaign: {name} is {shard.names[name]} there and {wanted} here; take it "
                    "away or name a new folder"
                )
        if shard.campaign not in ("", self._campaign):
            raise ConfigError(f"{file}: {OF_ANOTHER}; take it away or name a new folder")
        if shard.outcomes.run.tolist() != list(runs):
            raise ConfigError(f"{file}: holds other runs than its name says; take it away or name a new folder")
        return shard.outcomes

    def write_rows(self, rows: Sequence[dict[str, Any]]) -> None:
        """Save the table."""
        self._write(self.path / ROWS, json.dumps({"rows": list(rows)}, indent=1).encode())

    def discard_unfinished(self) -> None:
        """Delete files that are written in part; may be called by a signal handler."""
        if self._writing is not None:
            unfinished(self._writing).unlink(missing_ok=True)

    def _shard(self, plan: Plan, first: int) -> Path:
        return self.path / "shards" / cell_folder(plan.cell) / shard_name(first)

    def _write(self, target: Path, data: bytes) -> None:
        self._writing = target
        try:
            write_whole(target, data)
        finally:
            self._writing = None


def _hold(path: Path, descriptor: int) -> None:
    """Lock a folder as long as its descriptor is open; killing the process closes it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ConfigError(f"{path}: another process flies this campaign; wait for it, or name a new folder") from error
    except OSError:  # a file system without locks
        pass


def _check_same(path: Path, configuration: dict[str, Any], resume: bool) -> None:
    """Check that a folder is continued only by the campaign that began it."""
    if not resume:
        raise ConfigError(f"{path}: holds a campaign already; go on with it by --resume, or name a new folder")
    try:
        found = object_in(path / CONFIGURATION)
    except CaptureError as error:
        raise ConfigError(str(error)) from error
    wanted = json.loads(json.dumps(configuration))
    for key in [*wanted, *found]:
        if found.get(key) != wanted.get(key):
            differs = _difference(key, found.get(key), wanted.get(key))
            raise ConfigError(f"{path}: holds another campaign: {differs}; give its own options")


def _difference(key: str, there: object, here: object) -> str:
    """The first difference between two values, by the names of nested keys."""
    while isinstance(there, dict) and isinstance(here, dict):
        absent = object()
        name = next(name for name in [*here, *there] if there.get(name, absent) != here.get(name, absent))
        if name not in there or name not in here:
            return f"{key} has {name} {'here' if name in here else 'there'} only"
        key, there, here = f"{key}.{name}", there[name], here[name]
    return f"{key} is {shortened(there)} there and {shortened(here)} here"


def shortened(value: object) -> str:
    """A value as JSON, no longer than 60 characters."""
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def object_in(file: Path) -> dict[str, Any]:
    """The object in a JSON file of a campaign.

    Raises:
        CaptureError: If it is not a JSON object, or holds a number that is not finite.
        OSError: If it cannot be read.
    """
    try:
        found = json.loads(file.read_text("utf-8"), parse_float=_finite, parse_constant=_finite)
    except (ValueError, RecursionError) as error:
        raise CaptureError(f"{file}: is damaged: {error}") from error
    if not isinstance(found, dict):
        raise CaptureError(f"{file}: is damaged: no JSON object")
    return found


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is not a finite number")
    return number


def shard_name(first: int) -> str:
    """Name of the shard that begins with this run."""
    return f"runs-{first:06d}.parquet"


def cell_folder(cell: Cell) -> str:
    """Name of the folder of a cell: its names, and its unusual values."""
    # Only the name of a scene may contain any character.
    parts = [file_part(cell.scenario), cell.definition, cell.gnss, cell.solver]
    for name, usual in USUAL.items():
        value = getattr(cell, name)
        if value != usual:
            parts.append(value if name == "dynamics" else f"{name.removesuffix('_m').removesuffix('_s')}{value!r}")
    return "_".join(parts)
