"""Formats of ``ridlink decode``, its times, and combinations of options that it refuses."""

from __future__ import annotations

import click

FOLDERS = ("csv", "parquet")
MAPS = ("geojson", "kml")
EXPORTS = (*FOLDERS, *MAPS, "mcap")
NEED_OUTPUT = ("parquet", "mcap")
JOINABLE = ("csv", "parquet", "jsonl")


def time_us(_: click.Context, __: click.Parameter, value: str | None) -> int | None:
    """Microseconds since 1970 from seconds since 1970, or from a date and time, UTC unless it has a time zone."""
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


def refuse_combination(
    output_format: str, output: str | None, frames: bool, join: bool, stats: bool, telemetry: bool
) -> None:
    """Refuse options that make no sense together.

    Raises:
        click.UsageError: If they are given.
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


def refuse_following(
    files: tuple[str, ...], kind: str, output_format: str, output: str | None, join: bool, stats: bool
) -> None:
    """Refuse files and options with which a file cannot be followed.

    Raises:
        click.UsageError: If they are given.
    """
    if len(files) > 1 or files[0] == "-":
        raise click.UsageError("--follow is for one file, and standard input is followed as it is")
    if output_format not in ("table", "jsonl") or join or stats:
        raise click.UsageError("--follow is for -f table and -f jsonl, without --join and --stats")
    if kind == "pcap":
        raise click.UsageError("--follow is for tlog, raw MAVLink and lines of hex, not for pcap")
    if output not in (None, "-"):
        raise click.UsageError("--follow writes to standard output: a file of -o appears only when it is whole")
