"""Output of ``ridlink decode`` in formats other than lines and statistics."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Generic, TypeVar

import click

from ridlink.cli.decode_options import FOLDERS
from ridlink.cli.files import whole_folder, whole_output
from ridlink.errors import CaptureError
from ridlink.remote_id.text import display_name

if TYPE_CHECKING:
    from ridlink.captures.export.fields import Fields
    from ridlink.captures.export.selection import Selection
    from ridlink.captures.fast.block import Block
    from ridlink.captures.messages import MessageRecord
    from ridlink.captures.statistics import Statistics

RECORDS_AT_ONCE = 8192

T = TypeVar("T")


@contextmanager
def others_go_on(files: tuple[str, ...], statistics: Statistics) -> Iterator[None]:
    """Report a file that is no capture in one line, and go on with the others; if none is one, it is an error."""
    before = len(statistics.captures)
    try:
        yield
    except CaptureError as error:
        del statistics.captures[before:]
        statistics.unread += 1
        if statistics.unread == len(files):
            raise
        click.echo(f"ridlink: {error}", err=True)


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
) -> bool:
    """Write the files in a format that has not one line for each message; whether anything is in what was written.

    Args:
        files, kind: Files to read, and their format.
        output_format, output, join: Format and file to write, and whether messages are joined.
        selection: Messages to write.
        statistics: Gets the captures, for their rejects.
        telemetry: On a map, add the own telemetry of vehicles that are on it by Remote ID.
    """
    if output_format in FOLDERS and not join:
        assert output is not None
        return _export_folder(files, kind, output_format, output, selection, statistics)
    from ridlink.captures.export.geo import MAPPED_NAMES, write_geojson, write_kml
    from ridlink.captures.export.join import JOINED_NAMES
    from ridlink.captures.export.join import join as joined
    from ridlink.captures.export.tables import write_joined_csv, write_joined_parquet

    if selection.names is None and output_format != "mcap":  # other messages are not used
        selection = dataclasses.replace(selection, names=frozenset(JOINED_NAMES if join else MAPPED_NAMES))
    messages = _Watched(_messages(files, kind, selection, statistics))
    with whole_output(output, files) as out:
        if output_format == "geojson":
            return write_geojson(messages, out, telemetry=telemetry) > 0
        if output_format == "kml":
            return write_kml(messages, out, telemetry=telemetry) > 0
        if output_format == "mcap":
            from ridlink.captures.export.mcap import write_mcap

            write_mcap(messages, out)
            return messages.any
        rows = _Watched(joined(messages))
        if output_format == "csv":
            write_joined_csv(rows, out)
        elif output_format == "parquet":
            write_joined_parquet(rows, out)
        else:
            _write_joined_lines(rows, out)
        return rows.any


def _captures(
    files: tuple[str, ...], kind: str, selection: Selection, statistics: Statistics
) -> Iterator[Block | list[MessageRecord]]:
    """Files of MAVLink as blocks, other files as messages, some thousand at a time."""
    from ridlink.captures import decode_records, open_capture
    from ridlink.captures.fast.blocks import SCANNED, BlockReader

    for path in files:
        with others_go_on(files, statistics), open_capture(path, kind) as capture:
            if capture.kind in SCANNED and path != "-" and Path(path).is_file():
                reader = BlockReader(path, capture.kind)
                statistics.begin(reader)  # type: ignore[arg-type]  # it has what is reported of a capture
                yield from reader
                continue
            statistics.begin(capture)
            chosen = (record for record in decode_records(capture) if selection.takes(record))
            while records := list(itertools.islice(chosen, RECORDS_AT_ONCE)):
                yield records


def _messages(files: tuple[str, ...], kind: str, selection: Selection, statistics: Statistics) -> Iterator[Fields]:
    from ridlink.captures.export.fields import fields_of_block, fields_of_records

    for part in _captures(files, kind, selection, statistics):
        yield from fields_of_records(part) if isinstance(part, list) else fields_of_block(part, selection)


class _Watched(Generic[T]):
    """Items to iterate over; ``any`` says whether there was one."""

    def __init__(self, items: Iterator[T]) -> None:
        self._items = items
        self.any = False

    def __iter__(self) -> Iterator[T]:
        for item in self._items:
            self.any = True
            yield item


def _export_folder(
    files: tuple[str, ...], kind: str, output_format: str, output: str, selection: Selection, statistics: Statistics
) -> bool:
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
    return bool(names)


def _write_joined_lines(rows: Iterable[dict[str, Any]], out: BinaryIO) -> None:
    import msgspec

    from ridlink.captures.lines import exact_seconds

    encode = msgspec.json.Encoder().encode
    for row in rows:
        row["t"] = msgspec.Raw(exact_seconds(row["t"]).encode())
        out.write(encode(row) + b"\n")
