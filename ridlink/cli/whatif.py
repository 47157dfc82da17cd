"""``ridlink whatif``: recorded traffic evaluated under other definitions."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli.files import refuse_to_replace, whole_output
from ridlink.cli.options import DEFINITION, NAME, accuracy_convention, capture_kind, definition_of, eta_option
from ridlink.cli.reviewing import exit_code, open_sources, strict, walk_through
from ridlink.words import or_dash

if TYPE_CHECKING:
    from ridlink.review import Walk


def _seconds(_: click.Context, __: click.Parameter, value: float | None) -> float | None:
    if value is not None and not 0.0 <= value < math.inf:
        raise click.BadParameter("must be 0 or more seconds")
    return value


@click.command(short_help="Recorded traffic judged under other definitions.")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@capture_kind("Format of the files; auto tells it by content and suffix.")
@click.option("--definition", "definitions", metavar="A,B,...", help=f"{DEFINITION}  [default: all]")
@click.option(
    "--ahead", type=float, callback=_seconds, metavar="S",
    help="How far ahead an entry into a disc is alerted.  [default: 8, as far as the daemon looks]",
)  # fmt: skip
@eta_option()
@accuracy_convention
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of a table.")
@click.option("--csv", "as_csv", is_flag=True, help="Comma-separated values instead of a table.")
@click.option("-o", "--output", type=NAME, metavar="OUT",
              help="Write there instead of to standard output; replaces the file.")  # fmt: skip
@strict
def whatif(
    files: tuple[str, ...],
    kind: str,
    definitions: str | None,
    ahead: float | None,
    eta: float,
    accuracy_convention: str,
    as_json: bool,
    as_csv: bool,
    output: str | None,
    is_strict: bool,
) -> int:
    """Judge recorded traffic (tlog, pcap, pcapng) under each definition: how many alerts it would have given, for how
    long, how near the disc came, and which collisions of reported airframes it would not have announced.

    \b
    ridlink whatif flight.tlog
    ridlink whatif flight.tlog --definition snmac,candidate2 --ahead 0 --json

    An alert begins when two are inside the disc, or would enter it within --ahead seconds if both flew on. Vehicles
    flew under the definition of that day: under another they would have flown otherwise.
    """
    from ridlink.separation.definitions import Definition

    if as_json and as_csv:
        raise click.UsageError("--json and --csv exclude each other")
    wanted = [definition_of(name) for name in definitions.split(",")] if definitions is not None else list(Definition)
    refuse_to_replace(output, files)
    with whole_output(output) as out:
        sources, absent = open_sources(files, kind)

        from ridlink.review.whatif import AHEAD_S, WhatIf

        ahead_s = AHEAD_S if ahead is None else ahead
        judged = WhatIf(wanted, ahead_s=ahead_s, eta=eta)
        walk = walk_through(sources, [judged], accuracy_convention)
        rows = [judgement.as_dict() for judgement in judged.judgements]
        text = (
            _json(rows, walk, ahead_s, accuracy_convention)
            if as_json
            else _csv(rows)
            if as_csv
            else _table(rows, walk, ahead_s)
        )
        out.write(text.encode())
    return exit_code(sources, absent, is_strict)


def _json(rows: list[dict[str, Any]], walk: Walk, ahead_s: float, accuracy_convention: str) -> str:
    import msgspec

    document = {
        "begin_t": None if walk.begun_us is None else walk.begun_us / 1e6,
        "end_t": None if walk.ended_us is None else walk.ended_us / 1e6,
        "aircraft": walk.aircraft,
        "ahead_s": ahead_s,
        "accuracy_convention": accuracy_convention,
        "rows": rows,
    }
    return msgspec.json.encode(document).decode() + "\n"


def _csv(rows: list[dict[str, Any]]) -> str:
    import csv

    from ridlink.captures.export.tables import neutral

    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    for row in rows:
        pair = row["least_margin_uas"]
        writer.writerow((row | {"least_margin_uas": None if pair is None else neutral(" ".join(pair))}).values())
    return text.getvalue()


def _table(rows: list[dict[str, Any]], walk: Walk, ahead_s: float) -> str:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    heads = ("definition", "alerts", "alert s", "entered", "margin m", "MACs", "unannounced", "warning s")
    for head in heads:
        table.add_column(head, no_wrap=True, justify="left" if head == "definition" else "right")
    table.add_column("least margin", overflow="fold")
    for row in rows:
        pair = row["least_margin_uas"]
        cells = (
            row["definition"], f"{row['alerts']:,}", f"{row['alert_s']:,.1f}", f"{row['entered']:,}",
            or_dash(row["least_margin_m"]), f"{row['macs']:,}", f"{row['macs_without_alert']:,}",
            or_dash(row["least_warning_s"]), "-" if pair is None else " ".join(pair),
        )  # fmt: skip
        table.add_row(*map(Text, cells))
    console = Console(file=io.StringIO(), width=120, color_system=None)
    console.print(table)
    span = 0.0 if walk.begun_us is None or walk.ended_us is None else (walk.ended_us - walk.begun_us) / 1e6
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    text = "\n".join(line.rstrip() for line in lines)
    return f"{text}\n{walk.aircraft:,} aircraft, {span:,.1f} s; entries alerted {ahead_s:g} s ahead\n"
