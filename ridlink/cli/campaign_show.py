"""What ``ridlink campaign run`` shows: how far it is, and the table."""

from __future__ import annotations

import json
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ridlink.campaign.plan import Plan
    from ridlink.campaign.table import Row

WIDE = 120
"""Columns that the whole table needs."""


def say_if_compiling(plans: Sequence[Plan]) -> None:
    """A word on standard error before the compiler is waited for."""
    from ridlink.campaign.flight import is_warm

    cold = dict.fromkeys(str(plan.solver) for plan in plans if not is_warm(plan))
    if cold:
        click.echo(f"campaign: compiling {', '.join(cold)} (once, up to half a minute) ...", err=True)


@contextmanager
def progress_shown(total: int, kept: int, who: str) -> Iterator[Callable[[int], None]]:
    """Says on standard error how far it is: a bar where a terminal watches, else a line at both ends.

    Gives a function to call after each shard, with the decisions made so far.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        click.echo(f"campaign: {total} shards, {kept} kept from before, {who}", err=True)
        yield lambda _: None
        click.echo(f"campaign: {total} shards done", err=True)
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


def say_left_off(text: str) -> None:
    """The last word of a campaign that a signal ends: below the bar, and with the cursor that the bar has hidden."""
    from rich.console import Console

    console = Console(stderr=True)
    console.show_cursor()
    click.echo(f"{chr(10) * console.is_terminal}campaign: {text}", err=True)


def show_rows(rows: list[Row], steps: int, wall_s: float, as_json: bool, more: dict[str, Any] | None = None) -> None:
    rate = steps / wall_s if wall_s > 0.0 else 0.0
    if as_json:
        document = {"rows": [row.as_dict() for row in rows], "agent_steps": steps, "wall_s": wall_s,
                    "agent_steps_per_s": rate, **(more or {})}  # fmt: skip
        click.echo(json.dumps(document))
        return
    from rich.console import Console
    from rich.table import Table

    console = Console()
    width = console.width if console.is_terminal else WIDE
    for group in dict.fromkeys(map(_group, rows)):
        table = Table(
            box=None, header_style="bold", pad_edge=False, padding=(0, 2 if width >= WIDE else 1, 0, 0),
            title=f"{group}, {rows[0].runs} runs", title_justify="left",
        )  # fmt: skip
        figures = [(row, _figures(row, width >= WIDE)) for row in rows if _group(row) == group]
        for head in ("scenario", "definition"):
            table.add_column(head, no_wrap=True)
        for head in figures[0][1]:
            table.add_column(head, justify="right", no_wrap=True)
        for row, cells in figures:
            table.add_row(row.scenario, row.definition, *cells.values())
        Console(width=width).print(table)
        click.echo()
    click.echo(f"{steps:,} decisions in {wall_s:.1f} s")


def _group(row: Row) -> str:
    """What the rows of one table have in common: what is usual goes without saying."""
    text = f"{row.gnss} errors, solver {row.solver}"
    if row.dynamics != "ideal":
        text += f", {row.dynamics}"
    for figure, usual, words in (
        (row.sigma_m, 10.0, "sigma {:g} m"), (row.interval_s, 0.1, "every {:g} s"), (row.loss, 0.0, "{:.0%} lost")
    ):  # fmt: skip
        if figure != usual:
            text += f", {words.format(figure)}"
    return text


def _figures(row: Row, all_of_them: bool) -> dict[str, str]:
    """Cells of a row by the heads of their columns; the last ones only where there is room."""
    low, high = (100.0 * share for share in row.mac_rate_ci95)
    median = "-" if row.median_s is None else f"{row.median_s:.1f}"
    if row.median_ci95:
        median += f" ({row.median_ci95[0]:.1f}-{row.median_ci95[1]:.1f})"
    figures = {
        "MACs": f"{row.macs}/{row.flights:,}",
        "% (95 %)": f"{100.0 * row.mac_rate:.2f} ({low:.2f}-{high:.2f})" if row.macs else f"below {high:.2g}",
        "late": f"{row.unfinished}",
        "median s (95 %)": median,
        "ratio": _or_dash(row.ratio_to_snmac, 2),
    }
    if row.risk_ratio is not None:
        figures["risk"] = f"{row.risk_ratio:.2g}"
    if all_of_them:
        figures |= {
            "longest s": _or_dash(row.max_time_s, 1),
            "nearest m": _or_dash(row.min_separation_m, 1),
        }
        if row.risk_ratio is None:
            figures["infeasible %"] = f"{100.0 * row.infeasible_share:.1f}"
    return figures


def _or_dash(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
