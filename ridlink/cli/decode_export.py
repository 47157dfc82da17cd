"""What ``ridlink decode`` does for formats other than lines and statistics, and for large files."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from ridlink.cli.files import whole_folder, whole_output
from ridlink.errors import CaptureError
from ridlink.remote_id.text import display_name

if TYPE_CHECKING:
    from ridlink.captures.export.fields import Fields
    from ridlink.captures.export.selection import Selection
    from ridlink.captures.fast.block import Block
    from ridlink.captures.fast.blocks import BlockReader
    from ridlink.captures.messages import MessageRecord
    from ridlink.captures.statistics import Statistics

FOLDERS = ("csv", "parquet")
MAPS = ("geojson", "kml")
EXPORTS = (*FOLDERS, *MAPS, "mcap")
NEED_OUTPUT = ("parquet", "mcap")
JOINABLE = ("csv", "parquet", "jsonl")

RECORDS_AT_ONCE = 8192


def time_us(_: click.Context, __: click.Parameter, value: str | None) -> int | None:
    """Microseconds since 1970 of seconds since 1970 or of a date and time, UTC where it does not say."""
    if value is None:
        return None
    from datetime import UTC, datetime
    from decimal import Decimal

    try:
        return int(Decimal(value) * 1_000_000)
    except (ArithmeticError, ValueError):
        pass
    try:
        moment = datetime.fromisoformat(value)
    except ValueError:
        raise click.BadParameter("must be seconds since 1970 or a time such as 2026-05-01T12:30:00Z") from None
    moment = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds


def check(output_format: str, output: str | None, frames: bool, join: bool, stats: bool, telemetry: bool) -> None:
    """Refuse combinations of options that mean nothing.

    Raises:
        click.UsageError: If so.
    """
    if join and output_format not in JOINABLE:
        raise click.UsageError(f"--join is for -f {', '.join(JOINABLE)}; -f {output_format} cannot take it")
    if frames and (join or stats or output_format != "jsonl"):
        raise click.UsageError("--frames is for -f jsonl, without --join and --stats")
    if telemetry and output_format not in MAPS:
        raise click.UsageError(f"--telemetry is for -f {' and -f '.join(MAPS)}")
    if stats and (join or output_format in EXPORTS):
        raise click.UsageError("--stats is for -f table and -f jsonl, without --join")
    if output in (None, "-"):
        if output_format == "csv" and not join:
            raise click.UsageError("-f csv writes one file a message: name a folder with -o")
        if output_format in NEED_OUTPUT:
            raise click.UsageError(f"-f {output_format} needs -o")


def check_follow(
    files: tuple[str, ...], kind: str, output_format: str, output: str | None, join: bool, stats: bool
) -> None:
    """Refuse what cannot be followed.

    Raises:
        click.UsageError: If so.
    """
    if len(files) > 1 or files[0] == "-":
        raise click.UsageError("--follow is for one file, and standard input is followed as it is")
    if output_format not in ("table", "jsonl") or join or stats:
        raise click.UsageError("--follow is for -f table and -f jsonl, without --join and --stats")
    if kind == "pcap":
        raise click.UsageError("--follow is for tlog, raw MAVLink and lines of hex, not for pcap")
    if output not in (None, "-"):
        raise click.UsageError("--follow writes to standard output: a file of -o appears only when it is whole")


@contextmanager
def others_go_on(files: tuple[str, ...], statistics: Statistics) -> Iterator[None]:
    """One file that is no capture is one line and keeps no other back; where no file was one, it is an error."""
    before = len(statistics.captures)
    try:
        yield
    except CaptureError as error:
        del statistics.captures[before:]
        statistics.unread += 1
        if statistics.unread == len(files):
            raise
        click.echo(f"ridlink: {error}", err=True)


def large_reader(path: str, kind: str) -> BlockReader | None:
    """A reader in blocks where that pays off, that is for large files; ``None`` elsewhere."""
    from ridlink.captures.reader import is_large, open_capture

    if not is_large(path):
        return None
    from ridlink.captures.fast.blocks import KINDS, BlockReader

    with open_capture(path, kind) as capture:
        return BlockReader(path, capture.kind) if capture.kind in KINDS else None


def export(
    files: tuple[str, ...],
    kind: str,
    output_format: str,
    output: str | None,
    join: bool,
    selection: Selection,
    statistics: Statistics,
    *,
    telemetry: bool,
) -> None:
    """Write the files in a format that is no line a message.

    Args:
        files, kind: What to read.
        output_format, output, join: What to write.
        selection: Which messages.
        statistics: Gets the captures, for their rejects.
        telemetry: On a map, also what vehicles that are on it by Remote ID say of themselves.
    """
    if output_format in FOLDERS and not join:
        assert output is not None
        _export_folder(files, kind, output_format, output, selection, statistics)
        return
    from ridlink.captures.export.geo import MAPPED_NAMES, write_geojson, write_kml
    from ridlink.captures.export.join import JOINED_NAMES
    from ridlink.captures.export.join import join as joined
    from ridlink.captures.export.tables import write_joined_csv, write_joined_parquet

    if selection.names is None and output_format != "mcap":  # nothing else is looked at
        selection = dataclasses.replace(selection, names=frozenset(JOINED_NAMES if join else MAPPED_NAMES))
    messages = _messages(files, kind, selection, statistics)
    with whole_output(output, files) as out:
        if output_format == "geojson":
            write_geojson(messages, out, telemetry=telemetry)
        elif output_format == "kml":
            write_kml(messages, out, telemetry=telemetry)
        elif output_format == "mcap":
            from ridlink.captures.export.mcap import write_mcap

            write_mcap(messages, out)
        elif output_format == "csv":
            write_joined_csv(joined(messages), out)
        elif output_format == "parquet":
            write_joined_parquet(joined(messages), out)
        else:
            _write_joined_lines(joined(messages), out)


def _captures(
    files: tuple[str, ...], kind: str, selection: Selection, statistics: Statistics
) -> Iterator[Block | list[MessageRecord]]:
    """Files of MAVLink as blocks, everything else as messages, some thousand at a time."""
    from ridlink.captures import decode_records, open_capture
    from ridlink.captures.fast.blocks import SCANNED, BlockReader

    for path in files:
        with others_go_on(files, statistics), open_capture(path, kind) as capture:
            if capture.kind in SCANNED and path != "-" and Path(path).is_file():
                reader = BlockReader(path, capture.kind)
                statistics.captures.append(reader)  # type: ignore[arg-type]  # it has what is reported of a capture
                yield from reader
                continue
            statistics.captures.append(capture)
            chosen = (record for record in decode_records(capture) if selection.takes(record))
            while records := list(itertools.islice(chosen, RECORDS_AT_ONCE)):
                yield records


def _messages(files: tuple[str, ...], kind: str, selection: Selection, statistics: Statistics) -> Iterator[Fields]:
    from ridlink.captures.export.fields import fields_of_block, fields_of_records

    for part in _captures(files, kind, selection, statistics):
        yield from fields_of_records(part) if isinstance(part, list) else fields_of_block(part, selection)


def _export_folder(
    files: tuple[str, ...], kind: str, output_format: str, output: str, selection: Selection, statistics: Statistics
) -> None:
    from ridlink.captures.export.fields import fields_of_records
    from ridlink.captures.export.tables import CsvFolder, ParquetFolder, tables_of_block, tables_of_messages

    with (
        whole_folder(output) as folder,
        CsvFolder(folder) if output_format == "csv" else ParquetFolder(folder) as writer,
    ):
        for part in _captures(files, kind, selection, statistics):
            tables = (
                tables_of_messages(fields_of_records(part))
                if isinstance(part, list)
                else tables_of_block(part, selection)
            )
            for name, columns in tables:
                writer.write(name, columns)
        names = writer.finish()
    click.echo(f"{display_name(output)}: {', '.join(names) or 'no messages'}", err=True)


def _write_joined_lines(rows: Iterable[dict[str, Any]], out: BinaryIO) -> None:
    import msgspec

    from ridlink.captures.lines import exact_seconds

    encode = msgspec.json.Encoder().encode
    for row in rows:
        row["t"] = msgspec.Raw(exact_seconds(row["t"]).encode())
        out.write(encode(row) + b"\n")
