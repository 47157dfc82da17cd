"""The tables of a campaign as Markdown: one row per setting, one column per scene and error model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict

from ridlink.analysis.campaign import FlownCell, setting_words
from ridlink.analysis.pairs import PAPERS_POINTS, Pair, Pooled
from ridlink.campaign.cell import Cell, world_words
from ridlink.words import or_dash

ERRORS = {"gauss-markov": "G-M"}
"""Short names for column heads."""

BAR = "\\|"
"""An escaped bar, which does not end a table cell."""

CHANCE = 1e-4
"""Smaller probabilities are shown as smaller than this."""


def markdown_report(cells: Sequence[FlownCell], points: Sequence[Pair], together: Sequence[Pooled]) -> str:
    """Times and collisions of all cells, comparisons of all cells with the paper's Candidates, and totals over scenes.

    Args:
        cells: A complete campaign.
        points: Comparisons of its cells with those of the Candidates.
        together: Total collisions over all scenes.
    """
    ours = [pair for pair in points if (pair.cell.definition, pair.cell.solver) not in PAPERS_POINTS]
    parts = [
        "Median s / collided flights (late: not arrived by the cut-off):", _matrix(cells),
        "Less the other, paired, 95 %: median s; mean s; runs with more : fewer collided flights, exact sign test:",
        _table(("scene", "setting", "against", "median", "mean", "collided flights", "runs"), map(_against, ours)),
        "Collided flights of all scenes together:",
        _table(("errors", "setting", "collided"), map(_together, together)),
    ]  # fmt: skip
    pairs = zip(parts[::2], parts[1::2], strict=True)
    return "\n\n".join(f"{title}\n\n{table}" for title, table in pairs if table) + "\n"


def _matrix(cells: Sequence[FlownCell]) -> str:
    found: dict[str, dict[str, str]] = {}
    for each in cells:
        cell, row = Cell.of_row(each.row), each.row
        late = f" ({row['unfinished']} late)" if row["unfinished"] else ""
        line = found.setdefault(setting_words(cell.definition, cell.solver), {})
        line[_world(cell)] = f"{or_dash(row['median_s'])} / {row['macs']}{late}"
    worlds = list(dict.fromkeys(world for line in found.values() for world in line))
    lines = ((setting, *(line.get(world, "") for world in worlds)) for setting, line in found.items())
    return _table(("setting", *worlds), lines)


def _against(pair: Pair) -> tuple[str, ...]:
    found = pair.difference
    chance = "< 0.0001" if found.p_value < CHANCE else f"{found.p_value:.2g}"
    runs = f"{found.more_runs} : {found.fewer_runs}"
    return (
        _world(pair.cell), setting_words(pair.cell.definition, pair.cell.solver),
        setting_words(pair.against.definition, pair.against.solver),
        _span(found.median_s, found.median_ci95, 1), _span(found.mean_s, found.mean_ci95, 2),
        f"{pair.macs} : {pair.macs_against}", runs if runs == "0 : 0" else f"{runs}, p {chance}",
    )  # fmt: skip


def _together(each: Pooled) -> tuple[str, ...]:
    known = each.conditions
    errors = ", ".join(filter(None, (ERRORS.get(known["gnss"], known["gnss"]), world_words(known))))
    return errors, setting_words(known["definition"], known["solver"]), each.said


def _world(cell: Cell) -> str:
    return " ".join(filter(None, (cell.scenario, ERRORS.get(cell.gnss, cell.gnss), world_words(asdict(cell)))))


def _span(value: float | None, interval: tuple[float, float] | None, digits: int) -> str:
    if value is None or interval is None:
        return "-"
    # A value that rounds to zero gets no sign.
    value, low, high = (round(each, digits) + 0.0 for each in (value, *interval))
    return f"{value:+.{digits}f} ({low:+.{digits}f} to {high:+.{digits}f})"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = list(map(_line, rows))
    if not lines:
        return ""
    return "\n".join((_line(heads), "|" + " --- |" * len(heads), *lines))


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"
