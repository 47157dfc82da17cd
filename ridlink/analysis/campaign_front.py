"""The main figure, mission time against safety, and how it changes with errors, intervals and losses.

Colours are definitions, markers are solvers; medians in seconds, shares in per cent with their 95 % bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ridlink.analysis.campaign import DEFINITION_NAMES, setting_words
from ridlink.analysis.figures import GREY, new_figure, plain_numbers
from ridlink.analysis.panels import (
    COLOUR_OF,
    MARKER_OF,
    WIDTHS_IN,
    WORLD,
    Row,
    grouped,
    head_figure,
    legend_below,
    name_of,
    panel_grid,
    panels_of,
    title_of,
)
from ridlink.campaign.cell import USUAL
from ridlink.errors import MissingExtraError

try:
    from matplotlib.lines import Line2D
    from matplotlib.ticker import FormatStrFormatter, LogLocator
except ImportError as error:
    raise MissingExtraError("plot", "drawing figures") from error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

VARIED = {
    "sigma_m": "standard deviation of the errors per axis [m]",
    "interval_s": "time between two reports [s]",
    "loss": "share of reports that are lost",
}
"""Quantities for the horizontal axis of a sensitivity figure."""

APART = 0.008
"""Horizontal offset between settings, as a share of the range, so that no error bar hides another."""

WIDE = 1.6
"""Ratio of largest to smallest time above which the axis is logarithmic."""


def front_figure(rows: Sequence[Row], numbers: Sequence[int]) -> Figure:
    """Median mission time against the upper bound of collided flights, with the Pareto front."""
    panels = panels_of(rows, numbers)
    figure, all_axes = panel_grid(panels, 3.3, below_in=0.7)
    for axes, group in zip(all_axes, panels.values(), strict=True):
        points = [(rows[k]["median_s"], 100.0 * rows[k]["mac_rate_pairs_ci95"][1], rows[k]) for k in group]
        points = [point for point in points if point[0] is not None]
        _draw_front(axes, [(x, y) for x, y, _ in points])
        for x, y, row in points:
            colour = COLOUR_OF[row["definition"]]
            axes.plot(
                x, y, MARKER_OF.get(row["solver"], "P"), color=colour, linestyle="none",
                markersize=10.0 if row["solver"] == "g3" else 7.0,
                markerfacecolor=colour if row["macs"] else "none", markeredgewidth=1.4,
            )  # fmt: skip
        _scale(axes)
    _legend(figure, [rows[k] for k in numbers])
    what = "Time against safety (open: no collision was seen; grey line: the front)"
    head_figure(figure, title_of(what, rows[numbers[0]], WORLD))
    return figure


def front_of(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The Pareto front: points not dominated by another, sorted by their first value; less is better."""
    best: list[tuple[float, float]] = []
    for point in sorted(set(points)):
        if not best or point[1] < best[-1][1]:
            best.append(point)
    return best


def _draw_front(axes: Axes, points: Sequence[tuple[float, float]]) -> None:
    best = front_of(points)
    if len(best) > 1:
        axes.step(*zip(*best, strict=True), where="post", color="#bbbbbb", linewidth=1.2, zorder=1.0)


def _scale(axes: Axes) -> None:
    """Set logarithmic axes; for times only if their range is wide."""
    left, right = axes.get_xlim()
    spreads = right > WIDE * left
    if spreads:
        axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = np.log10(axes.get_ylim())
    axes.set_ylim(10.0 ** np.floor(low + 1e-9), min(10.0 ** np.ceil(high), 100.0))
    left, right = axes.get_xlim()
    axes.set_xlim(left / 1.02, right * 1.02)
    plain_numbers(axes)
    if spreads:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)))
        axes.xaxis.set_minor_locator(LogLocator(subs=tuple(range(1, 10))))
    axes.set_xlabel("median mission time [s]")
    axes.set_ylabel("collided flights, below [%]")


def _legend(figure: Figure, rows: Sequence[Row]) -> None:
    """Legend of colours and markers, below all panels."""
    handles = [
        Line2D([], [], marker="o", linestyle="none", color=COLOUR_OF[name], label=DEFINITION_NAMES[name])
        for name in DEFINITION_NAMES
        if any(row["definition"] == name for row in rows)
    ]
    handles += [
        Line2D([], [], marker=MARKER_OF.get(name, "P"), linestyle="none", color=GREY, label=f"solver {name}")
        for name in dict.fromkeys(row["solver"] for row in rows)
    ]
    legend_below(figure, handles)


def sensitivity_figures(rows: Sequence[Row]) -> dict[str, Callable[[], Figure]]:
    """A figure for each quantity of `VARIED` that has several values in one world, by name."""
    figures: dict[str, Callable[[], Figure]] = {}
    for varied in VARIED:
        others = ("scenario", "solver", *(name for name in WORLD if name != varied))
        groups = [
            group for group in grouped(rows, others) if len({rows[k][varied] for k in group}) > 1
        ]  # fmt: skip
        what = f"sensitivity-to-{varied.removesuffix('_m').removesuffix('_s')}"
        for group in groups:
            figures[name_of(what, rows, group, groups, others)] = partial(_sensitivity, rows, group, varied)
    return figures


def _sensitivity(rows: Sequence[Row], numbers: Sequence[int], varied: str) -> Figure:
    panels = panels_of(rows, numbers)
    figure = new_figure(WIDTHS_IN.get(len(panels), 3.9) * len(panels) + 0.4, 6.6)
    grid = figure.subplots(2, len(panels), squeeze=False, sharex="col")
    settings = grouped(rows, ("definition", "solver"), numbers)
    values = [rows[k][varied] for k in numbers]
    apart = APART * (max(values) - min(values))
    least = 10.0 ** np.ceil(np.log10(100.0 / rows[numbers[0]]["flights"]))
    for column, (key, group) in enumerate(panels.items()):
        above, below = grid[0][column], grid[1][column]
        for place, setting in enumerate(settings):
            line = sorted(set(setting) & set(group), key=lambda k: rows[k][varied])
            _draw_line(above, below, [rows[k] for k in line], varied, apart * (place - (len(settings) - 1) / 2.0))
        above.set_title(", ".join(map(str, key)), fontsize=9.5)
        above.set_ylim(bottom=0.0)
        below.set_yscale("symlog", linthresh=least)
        below.set_ylim(bottom=0.0)
        below.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        below.set_xlabel(VARIED[varied])
        above.set_ylabel("median mission time [s]")
        below.set_ylabel("collided flights [%]")
    handles = [
        Line2D(
            [], [], marker=MARKER_OF.get(rows[k]["solver"], "P"), color=COLOUR_OF[rows[k]["definition"]],
            label=setting_words(rows[k]["definition"], rows[k]["solver"]),
        )
        for k, *_ in settings
    ]  # fmt: skip
    legend_below(figure, handles)
    what = f"Sensitivity (bars: 95 %; linear below {least:g} %)"
    head_figure(figure, title_of(what, {**rows[numbers[0]], varied: USUAL[varied]}, WORLD))
    return figure


def _draw_line(above: Axes, below: Axes, line: Sequence[Row], varied: str, beside: float) -> None:
    if not line:
        return
    look: dict[str, Any] = {
        "marker": MARKER_OF.get(line[0]["solver"], "P"), "color": COLOUR_OF[line[0]["definition"]], "markersize": 4.5,
        "linewidth": 1.2,
    }  # fmt: skip
    told = [row for row in line if row["median_s"] is not None]
    above.plot([row[varied] for row in told], [row["median_s"] for row in told], **look)
    rate = np.array([row["mac_rate"] for row in line])
    ends = np.array([row["mac_rate_pairs_ci95"] for row in line]).T
    below.errorbar(
        [row[varied] + beside for row in line],
        100.0 * rate,
        yerr=100.0 * np.abs(ends - rate),
        capsize=2.5,
        elinewidth=0.8,
        **look,
    )
