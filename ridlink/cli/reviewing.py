"""Common part of commands about recordings: many files, some of them damaged, and one walk through all."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from ridlink.cli import EXIT_DONE, EXIT_IO, EXIT_REJECTS
from ridlink.cli.files import readable
from ridlink.cli.progress import Progress
from ridlink.errors import CaptureError

if TYPE_CHECKING:
    from ridlink.review import Source, Walk
    from ridlink.review.walk import Watcher


strict = click.option("--strict", "is_strict", is_flag=True, help="Exit with 4 if anything in the files was damaged.")


def open_sources(files: tuple[str, ...], kind: str) -> tuple[list[Source], int]:
    """The recordings that can be opened, and how many cannot; each of those is a line on standard error.

    Raises:
        CaptureError: If none of them is a recording.
        OSError: If none of them can be read.
        click.UsageError: If standard input is to be read twice.
    """
    found = readable(files)

    from ridlink.review import Source  # takes half a second

    sources: list[Source] = []
    for number, path in enumerate(found, 1):
        try:
            sources.append(Source(path, kind))
        except CaptureError as error:
            if number == len(found) and not sources:
                raise
            click.echo(f"ridlink: {error}", err=True)
    return sources, len(files) - len(sources)


def walk_through(sources: Sequence[Source], watchers: Sequence[Watcher], accuracy_convention: str) -> Walk:
    """Pass all scenes to all watchers, and show the progress on a terminal.

    Raises:
        CaptureError: If no file turned out to be a recording; OSError if none could be read.
    """
    from ridlink.review import Walk, together

    progress = Progress(not sys.stdout.isatty())
    walk = Walk(watchers, convention=accuracy_convention)
    for source in sources:
        source.on_progress = progress.tick
        source.needless = lambda: walk.own.speaking
    walk.through(together(sources))
    progress.clear()
    if walk.begun_us is None and all(source.error is not None for source in sources):
        *others, last = sources
        for source in others:
            click.echo(f"ridlink: {_text_of(source)}", err=True)
        assert last.error is not None
        raise last.error
    return walk


def exit_code(sources: Sequence[Source], absent: int, is_strict: bool) -> int:
    """The exit code; files that are damaged, or could not be read to the end, are reported on standard error.

    Args:
        sources: Recordings that were read.
        absent: Number of recordings that could not be opened.
        is_strict: Whether damage is a failure.
    """
    for source in sources:
        if source.rejects:
            click.echo(f"ridlink: {source.name}: damaged: {source.rejects}", err=True)
        if source.error is not None:
            click.echo(f"ridlink: {_text_of(source)}", err=True)
    if absent or any(source.error is not None for source in sources):
        return EXIT_IO
    return EXIT_REJECTS if is_strict and any(source.rejects for source in sources) else EXIT_DONE


def _text_of(source: Source) -> str:
    error = source.error
    if isinstance(error, OSError):
        return f"{source.name}: {error.strerror or error}"
    return str(error)
