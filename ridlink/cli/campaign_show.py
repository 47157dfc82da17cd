"""Output of ``ridlink campaign run``: its progress, and the table."""

from __future__ import annotations

import json
import math
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO, cast

import click

from ridlink.cli.printing import write_past_buffer
from ridlink.words import counted, or_dash

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ridlink.campaign.plan import Plan
    from ridlink.campaign.table import Row

NAMES = ("scenario", "definition")
SPARED = ("infeasible %", "nearest m", "longest s")
"""Columns that are left out on a narrow terminal, in this order."""

SHOW_CURSOR = "\x1b[?25h"


def say_if_compiling(plans: Sequence[Plan]) -> None:
    """Say on standard error that the kernels must be compiled first."""
    from ridlink.campaign.flight import is_warm
    from ridlink.compiled import how_often_compiled

    cold = dict.fromkeys(str(plan.solver) for plan in plans if not is_warm(plan))
    if cold:
        often = how_often_compiled()
        click.echo(f"campaign: compiling {', '.join(cold)} ({often}; up to half a minute) ...", err=True)


@contextmanager
def progress_shown(total: int, kept: int, who: str) -> Iterator[Callable[[int], None]]:
    """Show the progress on standard error: a bar on a terminal, otherwise a line at the start and at the end.

    Yields a function to call after each shard, with the decisions made so far.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        click.echo(f"campaign: {counted(total, 'shard')}, {kept} kept from before, {who}", err=True)
        yield lambda _: None
        click.echo(f"campaign: {counted(total, 'shard')} done", err=True)
        return
    columns = (
        TextColumn("flying"), BarColumn(), MofNCompleteColumn(), TextColumn("shards"),
        TextColumn("{task.fields[rate]}"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, auto_refresh=False, transient=True) as progress:
        bar = progress.add_task("", total=total, completed=kept, rate="")
        begin = time.monotonic()

        def advance(steps: int) -> None:
            rate = steps / max(time.monotonic() - begin, 1e-9)
            progress.update(bar, advance=1, rate=f"{rate:,.0f} decisions/s", refresh=True)

        progress.refresh()
        yield advance


def say(text: str) -> None:
    """Print a line on standard error below the bar, and show the cursor that the bar has hidden: it may be the last
    line, and that of a signal that came while the bar was written."""
    from rich.console import Console

    console = Console(stderr=True)
    below_the_bar = f"{SHOW_CURSOR}\n" if console.is_terminal else ""
    write_past_buffer(cast("TextIO", console.file), f"{below_the_bar}campaign: {text}\n")  # not the bar's own stream


def show_rows(rows: list[Row], steps: int, wall_s: float, as_json: bool, more: dict[str, Any] | None = None) -> None:
    rate = steps / wall_s if wall_s > 0.0 else 0.0
    if as_json:
        document = {"rows": [row.as_dict() for row in rows], "agent_steps": steps, "wall_s": wall_s,
                    "agent_steps_per_s": rate, **(more or {})}  # fmt: skip
        click.echo(json.dumps(document))
        return
    from rich.console import Console
    from rich.table import Table

    screen = Console()
    width = screen.width if screen.is_terminal else math.inf
    for group in dict.fromkeys(map(_group, rows)):
        columns, gap = _fitting(_columns([row for row in rows if _group(row) == group]), width)
        table = Table(
            box=None, header_style="bold", pad_edge=False, padding=(0, gap, 0, 0),
            title=f"{group}, {counted(rows[0].runs, 'run')}", title_justify="left",
        )  # fmt: skip
        for head in columns:
            table.add_column(head, justify="left" if head in NAMES else "right", no_wrap=True)
        for cells in zip(*columns.values(), strict=True):
            table.add_row(*cells)
        console = Console(width=_needed(columns, gap), markup=False, emoji=False)
        with console.capture() as drawn:  # by itself it would end the program where the reader has gone
            console.print(table)
        click.echo("\n".join(line.rstrip() for line in drawn.get().splitlines()) + "\n")
    click.echo(f"{counted(steps, 'decision')} in {wall_s:.1f} s")


def _group(row: Row) -> str:
    """Text for what all rows of a table have in common; usual values are left out."""
    from ridlink.campaign.cell import world_words

    return ", ".join(filter(None, (f"{row.gnss} errors", f"solver {row.solver}", world_words(row.as_dict()))))


def _columns(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Columns of a table by their headings, a cell for every row."""
    columns = {
        "scenario": [row.scenario for row in rows],
        "definition": [row.definition for row in rows],
        "MACs": [f"{row.macs}/{row.flights:,}" for row in rows],
        "% (95 %)": [_share(row) for row in rows],
        "late": [f"{row.unfinished}" for row in rows],
        "median s (95 %)": [_median(row) for row in rows],
        "ratio": [or_dash(row.ratio_to_snmac, ".2f") for row in rows],
    }
    if any(row.risk_ratio is not None for row in rows):
        columns["risk"] = [or_dash(row.risk_ratio, ".2g") for row in rows]
    return columns | {
        "longest s": [or_dash(row.max_time_s) for row in rows],
        "nearest m": [or_dash(row.min_separation_m) for row in rows],
        "infeasible %": [f"{100.0 * row.infeasible_share:.1f}" for row in rows],
    }


def _fitting(columns: dict[str, list[str]], width: float) -> tuple[dict[str, list[str]], int]:
    """As many columns as fit, and the gap between them. A table that is still too wide is kept whole, since a figure
    cut off would be wrong."""
    gap = 2 if _needed(columns, 2) <= width else 1
    for head in SPARED:
        if _needed(columns, gap) > width:
            columns = {name: cells for name, cells in columns.items() if name != head}
    return columns, gap


def _needed(columns: dict[str, list[str]], gap: int) -> int:
    """Width of a table."""
    from rich.cells import cell_len

    return sum(max(map(cell_len, (head, *cells))) + gap for head, cells in columns.items()) - gap


def _share(row: Row) -> str:
    low, high = (100.0 * share for share in row.mac_rate_pairs_ci95)
    return f"{100.0 * row.mac_rate:.2f} ({low:.2f}-{high:.2f})" if row.macs else f"below {high:.2g}"


def _median(row: Row) -> str:
    median = or_dash(row.median_s)
    return f"{median} ({row.median_ci95[0]:.1f}-{row.median_ci95[1]:.1f})" if row.median_ci95 else median
