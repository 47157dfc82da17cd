"""Files that appear when everything is in them."""

from __future__ import annotations

import os
from pathlib import Path

UNFINISHED = ".unfinished"
"""Suffix of what is half written."""


def unfinished(path: Path) -> Path:
    """Where a file is until it is whole."""
    return path.with_name(path.name + UNFINISHED)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under another name, force it onto the disk, and give it its name; one that has it is replaced.

    Raises:
        OSError: If that fails, of this path; nothing is left of it.
    """
    working = unfinished(path)
    try:
        with open(working, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(working, path)
    except BaseException as error:
        working.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename, error.filename2 = str(path), None
        raise
    listing = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(listing)
    finally:
        os.close(listing)
