"""What commands about recordings have in common: many files, some of them damaged, and one walk through all."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from ridlink.cli.decode_export import readable
from ridlink.cli.progress import Progress
from ridlink.errors import CaptureError

if TYPE_CHECKING:
    from ridlink.review import Source, Walk
    from ridlink.review.walk import Watcher


def open_sources(files: tuple[str, ...], kind: str) -> tuple[list[Source], int]:
    """The recordings that can be opened, and how many cannot; of each of these stands a line on standard error.

    Raises:
        CaptureError: If none of them is a recording.
        OSError: If none of them can be read.
        click.UsageError: If standard input is to be read twice.
    """
    from ridlink.review import Source

    if files.count("-") > 1:
        raise click.UsageError("standard input can be read once: - only once")
    sources: list[Source] = []
    found = readable(files)
    for number, path in enumerate(found, 1):
        try:
            sources.append(Source(path, kind))
        except CaptureError as error:
            if number == len(found) and not sources:
                raise
            click.echo(f"ridlink: {error}", err=True)
    return sources, len(files) - len(sources)


def walk_through(sources: Sequence[Source], watchers: Sequence[Watcher]) -> Walk:
    """Show all scenes to all watchers, and on a terminal how far it is."""
    from ridlink.review import Walk, together

    progress = Progress(not sys.stdout.isatty())
    walk = Walk(watchers)
    for source in sources:
        source.on_progress = progress.tick
        source.needless = lambda: walk.own.speaking
    walk.through(together(sources))
    progress.clear()
    return walk


def tell_of_sources(sources: Sequence[Source]) -> int:
    """Say on standard error what was damaged; how many recordings ended before their end."""
    broken = 0
    for source in sources:
        if source.rejects:
            click.echo(f"ridlink: {source.name}: damaged: {source.rejects}", err=True)
        if source.error is not None:
            broken += 1
            click.echo(f"ridlink: {_text_of(source)}", err=True)
    return broken


def _text_of(source: Source) -> str:
    error = source.error
    if isinstance(error, OSError):
        return f"{source.name}: {error.strerror or error}"
    return str(error)
