"""``ridlink encode``: JSON lines to a message dump, the inverse of ``ridlink decode``."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath
from typing import TYPE_CHECKING, BinaryIO

import click

from ridlink.cli import EXIT_DONE, EXIT_REJECTS
from ridlink.cli.files import whole_output
from ridlink.cli.options import NAME
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.captures.export.from_lines import TimedFrame

FORMATS = {".tlog": "tlog", ".mavlink": "mavlink", ".raw": "mavlink", ".hex": "hex"}
MAX_LINE_LENGTH = 64 * 1024


@click.command(short_help="Encode the JSON lines of 'ridlink decode' into a dump.")
@click.argument("file", metavar="FILE.jsonl")
@click.option(
    "-o",
    "--output",
    required=True,
    type=NAME,
    metavar="F.tlog|F.mavlink|F.hex",
    help="What to write; its suffix says the format. Whole or not at all; replaces the file.",
)
@click.option(
    "--to",
    type=click.Choice(["auto", "tlog", "mavlink", "hex"]),
    default="auto",
    show_default=True,
    help="Format, where the suffix does not say it.",
)
@click.option("--strict", is_flag=True, help="Exit with 4 if any line could not be encoded.")
def encode(file: str, output: str, to: str, strict: bool) -> int:
    """Encode the JSON lines of 'ridlink decode' into a dump; - is standard input.

    \b
    ridlink decode a.tlog -f jsonl --frames | ridlink encode - -o b.tlog      b is a, byte by byte

    Sequence numbers and sources are those of the lines. With --frames lines carry their frames, and signed, MAVLink 1
    and unknown frames come back as they were; without it, frames are made anew from the fields: MAVLink 2, unsigned.
    Lines that cannot be encoded are skipped and reported. In a tlog a line without a time gets the one before.
    """  # fmt: skip
    kind = FORMATS.get(PurePath(output).suffix.lower()) if to == "auto" else to
    if kind is None:
        raise click.UsageError(f"the suffix of {output} is none of {', '.join(FORMATS)}: say --to")
    from ridlink.captures.export.from_lines import frame_of_line
    from ridlink.errors import CaptureError, WireError
    from ridlink.remote_id.text import display_name

    read_from = "standard input" if file == "-" else display_name(file)
    written = refused = timeless = number = 0
    first = ""
    last_us = 0
    with _input(file) as lines, whole_output(output, [file]) as out:
        for number, line in enumerate(_lines(lines), 1):
            if not line.strip():
                continue
            try:
                found = frame_of_line(line) if len(line) <= MAX_LINE_LENGTH else _too_long()
            except WireError as error:
                refused += 1
                first = first or f"line {number}: {error}"
                continue
            if found is None:
                continue
            if kind == "tlog":
                timeless += found.time_us is None
                last_us = last_us if found.time_us is None else found.time_us
            out.write(_written(found, kind, last_us))
            written += 1
        if not written and (refused or not number):  # an existing file is kept
            what = f"has no line that can be encoded; {first}" if refused else "is empty"
            raise CaptureError(f"{read_from} {what}")
    if timeless:
        click.echo(f"ridlink: {read_from}: {counted(timeless, 'line')} without a time got the one before", err=True)
    if refused:
        click.echo(f"ridlink: {read_from}: {refused:,} of {counted(number, 'line')} not encoded; {first}", err=True)
    click.echo(f"{output}: {counted(written, 'frame')}", err=output == "-")
    return EXIT_REJECTS if strict and refused else EXIT_DONE


def _written(found: TimedFrame, kind: str, time_us: int) -> bytes:
    if kind == "tlog":
        return time_us.to_bytes(8, "big") + found.frame
    if kind == "mavlink":
        return found.frame
    return (found.frame if found.data is None else found.data).hex().encode() + b"\n"


def _too_long() -> TimedFrame:
    from ridlink.errors import WireError

    raise WireError(f"longer than {MAX_LINE_LENGTH} bytes")


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """Lines; one that is too long is cut one byte beyond the limit."""
    while line := stream.readline(MAX_LINE_LENGTH + 1):
        if len(line) > MAX_LINE_LENGTH and not line.endswith(b"\n"):
            while (rest := stream.readline(MAX_LINE_LENGTH)) and not rest.endswith(b"\n"):
                pass
        yield line


@contextmanager
def _input(path: str) -> Iterator[BinaryIO]:
    if path == "-":
        yield sys.stdin.buffer
        return
    with open(path, "rb") as stream:
        yield stream
