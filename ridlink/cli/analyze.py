"""``ridlink analyze``: the paper's printed numbers beside ours, and its analytic figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ridlink.cli.options import PATH

if TYPE_CHECKING:
    from ridlink.analysis import Comparison


@click.command(short_help="Print the paper's numbers beside ours; draw its analytic figures.")
@click.option(
    "--out",
    type=PATH,
    metavar="DIR",
    help="Draw the figures there, as PNG and SVG (extra: ridlink[plot]).",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output instead of the table.")
def analyze(out: Path | None, as_json: bool) -> None:
    """Print the paper's numbers beside ours, and draw its analytic figures.

    Every number that the paper prints about sizes, errors and displacements is computed again from its own equations.
    "equal" is to all printed digits, "close" within 1 %, "differs" does not follow, with the reason. A figure without
    data in the paper's text, such as the wireless technologies, is drawn from the sources that its file names.

    \b
        ridlink analyze
        ridlink analyze --out figures/
    """
    from ridlink.analysis import comparisons, excess_distances

    rows, excess = comparisons(), excess_distances()
    files: list[Path] = []
    if out is not None:
        from ridlink.analysis.figures import draw_figures

        files = draw_figures(out)
    if as_json:
        document = {
            "comparisons": [row.as_dict() for row in rows],
            "excess_distance_m": excess,
            "files": [str(file) for file in files],
        }
        click.echo(json.dumps(document))
        return
    click.echo("\n".join(_table(rows)))
    click.echo("\ndistance kept beyond the airframes for errors of 10 m per axis, each vehicle [m]\n")
    click.echo(f"{'eta':<8}{'half-plane':>12}{'covariance':>12}{'contours':>12}{'3 sigma each':>14}")
    for row in excess:
        click.echo(
            f"{row['eta']:<8g}{row['halfplane']:>12.1f}{row['covariance']:>12.1f}{row['contours']:>12.1f}"
            f"{row['three_sigma']:>14.1f}"
        )
    for file in files:
        click.echo(file)


def _table(rows: list[Comparison]) -> list[str]:
    """Lines of a table with aligned columns; a reason is below its row."""
    cells = [(row.where, row.what, _number(row, row.printed), _number(row, row.ours), str(row.verdict)) for row in rows]
    heads = ("where", "what", "printed", "ours", "verdict")
    widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]

    def line(parts: tuple[str, ...]) -> str:
        where, what, printed, ours, verdict = parts
        text = f"{where:<{widths[0]}}  {what:<{widths[1]}}  {printed:>{widths[2]}}  {ours:>{widths[3]}}"
        return f"{text}  {verdict}"

    lines = [line(heads)]
    for row, parts in zip(rows, cells, strict=True):
        lines.append(line(parts))
        if row.why:
            lines.append(f"{'':{widths[0]}}    {row.why}")
    return lines


def _number(row: Comparison, value: str | float | tuple[float, float] | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, tuple):
        return f"{value[0]:.1f} to {value[1]:.1f} {row.unit}"
    if isinstance(value, float):
        value = f"{value:.0f}" if not row.unit else f"{value:.3f}".rstrip("0").rstrip(".")
    return f"{value} {row.unit}".rstrip()
