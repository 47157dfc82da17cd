"""Layout of the figures of a campaign: which cells share a figure or a panel, names and titles."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ridlink.analysis.campaign import DEFINITION_NAMES
from ridlink.analysis.figures import COLOURS, GREY, new_figure
from ridlink.campaign.cell import world_words
from ridlink.files import file_part

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WORLD = ("dynamics", "sigma_m", "interval_s", "loss")
PANEL = ("scenario", "gnss")

COLOUR_OF = dict(zip(DEFINITION_NAMES, (*COLOURS, GREY), strict=True))
MARKER_OF = {"rotation": "o", "halfplane": "s", "graded": "^", "g2": "^", "g3": "*", "k": "D", "k2": "v"}

WIDTHS_IN = {1: 6.2, 2: 4.6}
"""Width of a panel by the number side by side: a single panel must leave room for the title and the legend."""

Row = dict[str, Any]
Panels = dict[tuple[Any, ...], list[int]]


def grouped(rows: Sequence[Row], names: Sequence[str], numbers: Sequence[int] | None = None) -> list[list[int]]:
    """Groups of row numbers with equal values in these columns, in order; of some rows, or of all."""
    found: dict[tuple[Any, ...], list[int]] = {}
    for k in range(len(rows)) if numbers is None else numbers:
        found.setdefault(tuple(rows[k][name] for name in names), []).append(k)
    return list(found.values())


def panels_of(rows: Sequence[Row], numbers: Sequence[int]) -> Panels:
    """Row numbers by scenario and error model."""
    return {tuple(rows[group[0]][name] for name in PANEL): group for group in grouped(rows, PANEL, numbers)}


def name_of(
    what: str, rows: Sequence[Row], numbers: Sequence[int], groups: Sequence[Sequence[int]], names: Sequence[str]
) -> str:
    """Name of the figure of a group: its subject, and the columns by which groups differ."""
    parts = [what]
    for name in names:
        if len({rows[group[0]][name] for group in groups}) > 1:
            value = rows[numbers[0]][name]
            parts.append(
                file_part(value) if isinstance(value, str) else f"{name.removesuffix('_m').removesuffix('_s')}{value:g}"
            )
    return "-".join(parts)


def title_of(what: str, row: Row, names: Sequence[str]) -> str:
    """Title of a figure: its subject and its conditions."""
    words = [f"solver {row['solver']}"] if "solver" in names else []
    world = world_words(row)
    return " - ".join([what, ", ".join([*words, *([world] if world else [])])]).removesuffix(" - ")


def head_figure(figure: Figure, title: str) -> None:
    """Add the title to a figure, in as many lines as its width needs."""
    figure.suptitle(textwrap.fill(title, int(11.5 * figure.get_figwidth())), fontsize=10.0)


def legend_below(figure: Figure, handles: Sequence[Artist]) -> None:
    """Put one legend below all panels, in as many columns as fit."""
    longest = max(len(str(handle.get_label())) for handle in handles)
    fitting = int((figure.get_figwidth() - 0.2) / (0.075 * longest + 0.55))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=max(min(fitting, len(handles), 6), 1), fontsize=8.5
    )


def panel_grid(panels: Panels, height_in: float, *, below_in: float = 0.0) -> tuple[Figure, list[Axes]]:
    """One panel per scenario and error model: scenarios side by side, or in rows if there are several models."""
    scenarios, kinds = ({key[k]: None for key in panels} for k in (0, 1))
    is_table = len(kinds) > 1 and len(panels) == len(scenarios) * len(kinds)
    across = len(kinds) if is_table else min(len(panels), 2)
    down = -(-len(panels) // across)
    figure = new_figure(WIDTHS_IN.get(across, 3.9) * across + 0.4, height_in * down + 0.4 + below_in)
    every = list(np.ravel(figure.subplots(down, across, squeeze=False)))
    for axes in every[len(panels) :]:
        axes.set_visible(False)
    ordered = [(s, k) for s in scenarios for k in kinds] if is_table else list(panels)
    by_key = dict(zip(ordered, every, strict=False))
    for key in panels:
        by_key[key].set_title(", ".join(map(str, key)), fontsize=9.5)
    return figure, [by_key[key] for key in panels]
