"""Where commands write: standard output, or a file that appears when everything is in it."""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import click

from ridlink.cli.signals import removed_by_signals
from ridlink.files import full_disk_named
from ridlink.remote_id.text import display_name


def refuse_to_replace(path: str | None, read: Iterable[str]) -> None:
    """What is written would be the end of what is read; standard streams are nobody's end.

    Raises:
        click.UsageError: If the path is one of the files that are read.
    """
    if path is None or path == "-":
        return
    if any(os.path.realpath(name) == os.path.realpath(path) for name in read if name != "-"):
        raise click.UsageError(f"{display_name(path)} is what is read: write to another file")


@contextmanager
def whole_output(path: str | None, read: Iterable[str] = ()) -> Iterator[BinaryIO]:
    """Standard output, or a file that appears when everything is in it.

    Args:
        path: Its name; None or ``-`` for standard output.
        read: What is read meanwhile, and must not be replaced.

    Raises:
        click.UsageError: If it is one of the files that are read.
    """
    if path is None or path == "-":
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
        return
    target = Path(path)
    if target.exists() and not target.is_file():  # a device or pipe cannot be replaced
        with full_disk_named(path), open(target, "wb") as stream:
            yield stream
        return
    refuse_to_replace(path, read)
    unfinished = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    with removed_by_signals(lambda: unfinished.unlink(missing_ok=True)):
        try:
            with full_disk_named(path), _new(unfinished, path) as stream:
                yield stream
            os.replace(unfinished, target)
        except BaseException:
            unfinished.unlink(missing_ok=True)
            raise


def _new(unfinished: Path, path: str) -> BinaryIO:
    """A new file; why there can be none is said of the path that was asked for."""
    try:
        return open(unfinished, "xb")
    except OSError as error:
        error.filename = path
        raise
