"""``ridlink decode``: message dumps to lines of text or JSON, or to statistics."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, BinaryIO

import click

from ridlink.cli import EXIT_DONE, EXIT_IO, EXIT_REJECTS
from ridlink.cli.decode_export import export, others_go_on
from ridlink.cli.decode_options import EXPORTS, MAPS, refuse_combination, refuse_following, time_us
from ridlink.cli.files import readable, whole_output
from ridlink.cli.options import NAME, capture_kind, wanted_names
from ridlink.cli.progress import HasPosition, Progress

if TYPE_CHECKING:
    from ridlink.captures import Capture, Record
    from ridlink.captures.export.selection import Selection
    from ridlink.captures.fast.blocks import BlockReader
    from ridlink.captures.statistics import Statistics

BATCH_BYTES = 64 * 1024


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@capture_kind("Format of the files; auto tells it by content and suffix.")
@click.option(
    "-f",
    "--format",
    "output_format",
    type=click.Choice(["table", "jsonl", *EXPORTS]),
    default="table",
    show_default=True,
    help="One aligned row, or one JSON object, a message; a folder of tables (csv, parquet); a map; MCAP.",
)
@click.option(
    "-o",
    "--output",
    type=NAME,
    metavar="OUT",
    help="Write there, not to standard output, and whole or not at all; replaces a file, or an empty folder.",
)
@click.option("--frames", is_flag=True, help="Add each frame's bytes to its JSON line: 'encode' gives the file back.")
@click.option(
    "--join",
    is_flag=True,
    help="One row for each update of each aircraft: identity, location, separation, operator (jsonl, csv, parquet).",
)
@click.option(
    "--telemetry",
    is_flag=True,
    help="On a map (geojson, kml), a second track from GLOBAL_POSITION_INT for vehicles that are on it by Remote ID.",
)
@click.option(
    "--since",
    metavar="TIME",
    callback=time_us,
    help="Only from this time on: seconds since 1970, or such as 2026-05-01T12:30:00Z.",
)
@click.option("--until", metavar="TIME", callback=time_us, help="Only before this time.")
@click.option("--types", metavar="GLOBS", help="Messages to show, such as 'OPEN_DRONE_ID_*,RIDLINK_*'.")
@click.option("--source-system", type=click.IntRange(0, 255), metavar="N", help="Only messages of this system id.")
@click.option(
    "--stats",
    is_flag=True,
    help="Counts, rates, sequence gaps (lost, or sent over links that were not recorded) and damage.",
)
@click.option("--follow", is_flag=True, help="Go on with what is appended to the file, until interrupted.")
@click.option("--strict", is_flag=True, help="Exit with 4 if anything in the files was damaged.")
def decode(
    files: tuple[str, ...],
    kind: str,
    output_format: str,
    output: str | None,
    frames: bool,
    join: bool,
    telemetry: bool,
    since: int | None,
    until: int | None,
    types: str | None,
    source_system: int | None,
    stats: bool,
    follow: bool,
    strict: bool,
) -> int:
    """Decode message dumps; - is standard input.

    Read are MAVLink telemetry logs (.tlog) and raw MAVLink streams; pcap and pcapng captures, of MAVLink over UDP and
    TCP and of Remote ID on the air (802.11 beacons and NAN frames, Bluetooth 4 and 5 advertisements); and lines of
    hexadecimal, one message, message pack or frame each.

    Open Drone ID and RIDLINK_SEPARATION come in SI units, null or - where unknown; other messages as the MAVLink XML
    has them. Damage is skipped, counted by cause, and reported on standard error.
    """
    from ridlink.captures.export.selection import Selection
    from ridlink.captures.statistics import Statistics

    refuse_combination(output_format, output, frames, join, stats, telemetry)
    if since is not None and until is not None and since >= until:
        raise click.UsageError("--since is not before --until: between them there is nothing")
    if follow:
        refuse_following(files, kind, output_format, output, join, stats)
    selection = Selection(wanted_names(types), source_system, since, until)
    statistics = Statistics(are_all=selection.names is None)
    found = readable(files)
    if join or output_format in EXPORTS:
        taken = export(found, kind, output_format, output, join, selection, statistics, telemetry=telemetry)
        wanted = "position" if output_format in MAPS else "Remote ID position" if join else ""
        _tell_nothing(statistics, selection, taken, wanted)
        _tell_timeless(statistics, selection)
        return _verdict(statistics, strict, len(files) - len(found))
    with whole_output(output, files) as out:
        lines = _Lines(output_format, selection, frames, stats, statistics, out)
        if follow:
            _follow(found[0], kind, lines)
        else:
            _decode_files(found, kind, lines)
        if stats and statistics.captures:
            import msgspec

            text = msgspec.json.encode(statistics.as_dict()) + b"\n" if output_format == "jsonl" else (
                statistics.as_text().encode(errors="backslashreplace")
            )  # fmt: skip
            out.write(text)
        else:
            _tell_nothing(statistics, selection, lines.any_written)
    _tell_timeless(statistics, selection)
    return _verdict(statistics, strict, len(files) - len(found), silent=stats)


def _tell_nothing(statistics: Statistics, selection: Selection, taken: bool, wanted: str = "") -> None:
    """Say that nothing came: limits keep nothing, or the format needs something ``wanted`` that there is not."""
    from ridlink.captures.export.selection import Selection

    if (wanted or selection != Selection()) and not taken and not _timeless(statistics, selection):
        said = f"there is no {wanted} in what was asked for" if wanted else "no message is of those asked for"
        click.echo(f"ridlink: {said}; --stats, without limits, shows what there is", err=True)


def _timeless(statistics: Statistics, selection: Selection) -> list[str]:
    """Names of captures without times, if the selection is by time."""
    if selection.takes_time(None):
        return []
    return [capture.name for capture in statistics.captures if capture.kind in ("mavlink", "hex")]


def _tell_timeless(statistics: Statistics, selection: Selection) -> None:
    for name in _timeless(statistics, selection):
        click.echo(f"ridlink: {name} has no times: nothing of it is within --since and --until", err=True)


def _verdict(statistics: Statistics, strict: bool, absent: int, *, silent: bool = False) -> int:
    """The exit code; damage is reported on standard error."""
    for capture in statistics.captures:
        if capture.rejects and not silent:
            click.echo(f"ridlink: {capture.name}: damaged: {capture.rejects}", err=True)
    if statistics.unread or absent:
        return EXIT_IO
    return EXIT_REJECTS if strict and statistics.rejects else EXIT_DONE


class _Lines:
    """Writes messages as lines, in batches, or counts them."""

    def __init__(
        self,
        output_format: str,
        selection: Selection,
        frames: bool,
        stats: bool,
        statistics: Statistics,
        out: BinaryIO,
    ) -> None:
        from ridlink.captures.lines import json_line, table_line

        self.statistics = statistics
        self.progress = Progress(out is not sys.stdout.buffer or stats or not sys.stdout.isatty())
        self._format = output_format
        self._line_of = json_line if output_format == "jsonl" else table_line
        self._selection = selection
        self._frames = frames
        self._stats = stats
        self._out = out
        self._batch: list[bytes] = []
        self._size = 0
        self.any_written = False

    def write(self, capture: Capture) -> None:
        """Write all messages of a capture, or count them."""
        self.statistics.begin(capture)
        self._take(capture, capture)
        self.flush()

    def _take(self, records: Iterable[Record], capture: HasPosition) -> None:
        from ridlink.captures import decode_records
        from ridlink.captures.export.framed import framed_line

        for record in decode_records(records):
            self.progress.tick(capture)
            if not self._selection.takes(record):
                continue
            if self._stats:
                self.statistics.count(record)
                continue
            line = framed_line(self._line_of(record), record) if self._frames else self._line_of(record)
            self._batch.append(line)
            self._size += len(line)
            if self._size >= BATCH_BYTES:
                self.flush()

    def write_blocks(self, reader: BlockReader) -> None:
        """Write the lines of a large file, or count its messages."""
        from ridlink.captures.export.block_lines import BlockLines
        from ridlink.captures.export.counting import count_block

        self.statistics.begin(reader)  # type: ignore[arg-type]  # it has what is reported of a capture
        lines = BlockLines(self._selection, self._format, frames=self._frames)
        for part in reader.parts():
            if isinstance(part, list):
                self._take(part, reader)
                continue
            if self._stats:
                count_block(self.statistics, part, self._selection)
            else:
                self.flush()
                text = lines.of(part)
                self._out.write(text)
                self.any_written |= len(text) > 0
            self.progress.tick(reader, part.count)
        self.flush()

    def flush(self) -> None:
        """Write the lines collected so far."""
        if self._batch:
            self._out.write(b"".join(self._batch))
            self._out.flush()
            self.any_written = True
        self._batch, self._size = [], 0


def _decode_files(files: tuple[str, ...], kind: str, lines: _Lines) -> None:
    from ridlink.captures import open_capture

    for path in files:
        with others_go_on(files, lines.statistics):
            reader = _large_reader(path, kind)
            if reader is not None:
                lines.write_blocks(reader)
                continue
            # a live reader of our output gets all lines before we wait for more
            with open_capture(path, kind, before_read=lines.flush) as capture:
                lines.write(capture)
    lines.progress.clear()


def _large_reader(path: str, kind: str) -> BlockReader | None:
    """A reader in blocks for a large file, where it is faster; ``None`` otherwise."""
    from ridlink.captures.reader import is_large, open_capture

    if not is_large(path):
        return None
    from ridlink.captures.fast.blocks import KINDS, BlockReader

    with open_capture(path, kind) as capture:
        return BlockReader(path, capture.kind) if capture.kind in KINDS else None


def _follow(path: str, kind: str, lines: _Lines) -> None:
    """Decode one file as it grows, until a signal ends it; a second signal does not wait for the reader of our
    output."""
    from ridlink.captures.follow import Follower, Stopped

    follower = Follower(
        path, kind, notice=lambda text: click.echo(f"ridlink: {text}", err=True), before_read=lines.flush
    )

    def stop(number: int, _: object) -> None:
        follower.stop()
        signal.signal(number, signal.SIG_DFL)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for capture in follower:
            lines.write(capture)
    except Stopped:
        pass
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        lines.progress.clear()
