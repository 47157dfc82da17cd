"""Files of commands: checks of those to read, and output files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeVar

import click

from ridlink.cli.signals import removed_by_signals
from ridlink.files import full_disk_named
from ridlink.remote_id.text import display_name

Made = TypeVar("Made")

# --- read ---


def refuse_unreadable(path: str) -> None:
    """Check that a file can be opened, before modules that read it are loaded.

    Raises:
        click.UsageError: If it is a link; the text names commands for links.
        OSError: If it cannot be opened.
    """
    try:
        if path != "-" and not stat.S_ISFIFO(os.stat(path).st_mode):  # the writer of a pipe would see it close
            open(path, "rb").close()
    except FileNotFoundError:
        from ridlink.links import Scheme

        if path.partition(":")[0] in list(Scheme):
            name = display_name(path)
            remedy = f"'ridlink view --source {name}' shows its traffic, 'ridlink record {name} -o FILE' keeps it"
            raise click.UsageError(f"{name} is a link, not a file: {remedy}") from None
        raise


def readable(files: tuple[str, ...]) -> tuple[str, ...]:
    """The files that can be opened. The others are reported at once, not after an hour of reading earlier files.

    Raises:
        click.UsageError: If standard input is to be read twice, or one is a link.
        OSError: If none can be opened.
    """
    if files.count("-") > 1:
        raise click.UsageError("standard input can be read once: - only once")
    found = []
    for number, path in enumerate(files, 1):
        try:
            refuse_unreadable(path)
            found.append(path)
        except OSError as error:
            if number == len(files) and not found:
                raise
            click.echo(f"ridlink: {display_name(path)}: {error.strerror}", err=True)
    return tuple(found)


def refuse_to_replace(path: str | None, read: Iterable[str]) -> None:
    """Refuse an output file that is also an input, as it would be replaced. Standard streams are allowed.

    Raises:
        click.UsageError: If the path is one of the files that are read.
    """
    if path is None or path == "-":
        return
    if any(os.path.realpath(name) == os.path.realpath(path) for name in read if name != "-"):
        raise click.UsageError(f"{display_name(path)} is what is read: write to another file")


# --- written ---


@contextmanager
def whole_output(path: str | None, read: Iterable[str] = ()) -> Iterator[BinaryIO]:
    """Standard output, or a file that appears when it is complete.

    Args:
        path: Path of the file; None or ``-`` for standard output.
        read: Files that are read meanwhile, and must not be replaced.

    Raises:
        click.UsageError: If it is one of the files that are read.
        OSError: If it cannot be written, or its name is that of a folder.
    """
    if path is None or path == "-":
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
        return
    target = Path(path)
    if path.endswith(os.sep):  # a path without it is written otherwise
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    if target.exists() and not target.is_file():  # a device or pipe cannot be replaced
        with full_disk_named(path), open(target, "wb") as stream:
            yield stream
        return
    refuse_to_replace(path, read)
    unfinished = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    with removed_by_signals(lambda: unfinished.unlink(missing_ok=True)):
        try:
            with full_disk_named(path), _made(lambda: open(unfinished, "xb"), path) as stream:
                yield stream
            os.replace(unfinished, target)
        except BaseException:
            with suppress(OSError):  # for example where nothing can be written
                unfinished.unlink(missing_ok=True)
            raise


@contextmanager
def whole_folder(path: str) -> Iterator[Path]:
    """A folder to write files into, which gets its name at the end; after an error it is removed.

    The files of a folder that exists, such as ``.`` or a disk, are moved into it at the end.

    Args:
        path: The folder; must not exist, or be empty.

    Raises:
        OSError: If it exists and is not empty, or cannot be made.
    """
    target = Path(path)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise FileExistsError(errno.EEXIST, "exists and is not an empty folder; name a new one", path)
    hidden = f".{target.name}.{secrets.token_hex(4)}"
    working = target / hidden if target.exists() else target.absolute().with_name(hidden)
    try:
        _made(working.mkdir, path)
        with removed_by_signals(lambda: shutil.rmtree(working, ignore_errors=True)), full_disk_named(path):
            yield working
        if working.parent == target:
            for file in working.iterdir():
                os.replace(file, target / file.name)
            working.rmdir()
        else:
            os.replace(working, target)
    except BaseException:
        shutil.rmtree(working, ignore_errors=True)
        raise


def _made(make: Callable[[], Made], path: str) -> Made:
    """The result of ``make``; its errors name the path that the user gave."""
    try:
        return make()
    except OSError as error:
        error.filename = path
        raise
