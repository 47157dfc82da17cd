"""A folder of files that appears when everything is in it, or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ridlink.files import full_disk_named


@contextmanager
def whole_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A folder to write into, which takes its name at the end; after an error nothing is left of it.

    Args:
        path: The folder; must not exist, or be empty.

    Raises:
        OSError: If it exists and is not empty, or cannot be made.
    """
    target = Path(path)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise FileExistsError(errno.EEXIST, "exists and is not an empty folder; name a new one", str(path))
    working = target.absolute().with_name(f".{target.name}.{secrets.token_hex(4)}")
    try:
        _make(working, path)
        with full_disk_named(str(path)):
            yield working
        os.replace(working, target)
    except BaseException:
        shutil.rmtree(working, ignore_errors=True)
        raise


def _make(working: Path, path: str | os.PathLike[str]) -> None:
    """Make a folder; why there can be none is said of the path that was asked for."""
    try:
        working.mkdir()
    except OSError as error:
        error.filename = str(path)
        raise
