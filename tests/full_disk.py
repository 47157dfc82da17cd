"""A disk that takes no large files, in the place of one that is full."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def largest_file(length: int) -> Iterator[None]:
    """This process cannot write a file longer than this many bytes; more is an OSError, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (length, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def files_below(folder: Path) -> list[Path]:
    """All files in a folder and in those within it."""
    return sorted(path for path in folder.rglob("*") if path.is_file())
