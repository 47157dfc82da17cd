"""Figures of a campaign, drawn with matplotlib (extra `plot`): mission times as box plots and as distributions, and
collisions, of every definition.

One figure per solver and world, one panel per scenario and error model; times in seconds, shares in per cent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ridlink.analysis.campaign import DEFINITION_NAMES, FlownCell, JudgedCell
from ridlink.analysis.campaign_front import front_figure, sensitivity_figures
from ridlink.analysis.figures import GREY, draw_figure
from ridlink.analysis.panels import (
    COLOUR_OF,
    WORLD,
    Panels,
    grouped,
    head_figure,
    legend_below,
    name_of,
    panel_grid,
    panels_of,
    title_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

WHISKERS = (5.0, 95.0)
MOST_POINTS = 400
"""Points of a distribution; more than that many flights are thinned out, which nobody could see."""

NEARLY_ALL = 0.995
"""A few late arrivals do not stretch a panel."""

MANY = 5
"""More labels than this are rotated."""


def draw_campaign(flown: Sequence[FlownCell], judged: Sequence[JudgedCell]) -> dict[str, bytes]:
    """All figures as PNG and SVG; contents by file name."""
    rows = [cell.row for cell in flown]
    draw: dict[str, Callable[[], Figure]] = {}
    fronts = grouped(rows, WORLD)
    for numbers in fronts:
        draw[name_of("time-against-safety", rows, numbers, fronts, WORLD)] = partial(front_figure, rows, numbers)
    draw |= sensitivity_figures(rows)
    by = ("solver", *WORLD)
    groups = grouped(rows, by)
    for numbers in groups:
        panels = panels_of(rows, numbers)
        draw[name_of("mission-times", rows, numbers, groups, by)] = partial(_times, panels, flown, judged)
        draw[name_of("distributions", rows, numbers, groups, by)] = partial(_distributions, panels, flown)
        draw[name_of("collisions", rows, numbers, groups, by)] = partial(_collisions, panels, judged)
    files: dict[str, bytes] = {}
    for name, figure in draw.items():
        files |= draw_figure(figure, name, formulas=False)
    return files


def _times(panels: Panels, flown: Sequence[FlownCell], judged: Sequence[JudgedCell]) -> Figure:
    figure, all_axes = panel_grid(panels, 3.5)
    for axes, numbers in zip(all_axes, panels.values(), strict=True):
        for at, k in enumerate(numbers):
            colour = COLOUR_OF[flown[k].row["definition"]]
            line: dict[str, Any] = {"color": colour, "linewidth": 1.3}
            if flown[k].times_s.size:
                axes.boxplot(
                    flown[k].times_s, positions=[at], widths=0.55, whis=WHISKERS, showfliers=False, boxprops=line,
                    whiskerprops=line, capprops=line, medianprops={"color": colour, "linewidth": 2.4},
                )  # fmt: skip
        printed = [(at, judged[k].median.printed) for at, k in enumerate(numbers) if judged[k].median.printed]
        if printed:
            axes.plot(*zip(*printed, strict=True), "D", color=GREY, markersize=5.0, label="median as printed")
            axes.legend(loc="upper right", fontsize=8.5)
        _name_definitions(axes, [flown[k].row["definition"] for k in numbers])
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("mission time [s]")
    what = "Mission times: median, quartiles, 5 to 95 % of the flights"
    head_figure(figure, title_of(what, flown[next(iter(panels.values()))[0]].row, ("solver", *WORLD)))
    return figure


def arrivals(cell: FlownCell) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distribution of the mission times of a cell: times [s], rising, and the share of all its flights that has arrived
    by each of them [%], both of shape (n,). Who collides or is late never arrives, so the last share is below 100."""
    flights = cell.flights.time_s.size
    count = flights - cell.row["macs"] - cell.row["unfinished"]
    drawn = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(int))
    return np.sort(cell.times_s)[drawn], 100.0 * (drawn + 1) / flights


def _distributions(panels: Panels, flown: Sequence[FlownCell]) -> Figure:
    figure, all_axes = panel_grid(panels, 3.5, below_in=0.4)
    lines: dict[str, Line2D] = {}
    for axes, numbers in zip(all_axes, panels.values(), strict=True):
        longest_s, end_s = 0.0, 1.05 * max(float(flown[k].flights.time_s.max()) for k in numbers)
        for k in numbers:
            definition = flown[k].row["definition"]
            times_s, share = arrivals(flown[k])
            if times_s.size:
                name = DEFINITION_NAMES[definition]
                [lines[name]] = axes.plot(
                    np.append(times_s, end_s),
                    np.append(share, share[-1]),
                    color=COLOUR_OF[definition],
                    drawstyle="steps-post",
                    linewidth=1.5,
                    label=name,
                )
                longest_s = max(longest_s, float(np.quantile(times_s, NEARLY_ALL)))
        axes.set(xlabel="mission time [s]", ylabel="flights that have arrived [%]", ylim=(0.0, 102.0))
        axes.set_xlim(0.0, 1.05 * longest_s or 1.0)
    if lines:
        legend_below(figure, list(lines.values()))
    what = "Distributions of the mission times, among all flights"
    head_figure(figure, title_of(what, flown[next(iter(panels.values()))[0]].row, ("solver", *WORLD)))
    return figure


def _collisions(panels: Panels, judged: Sequence[JudgedCell]) -> Figure:
    figure, all_axes = panel_grid(panels, 3.5)
    for axes, numbers in zip(all_axes, panels.values(), strict=True):
        for at, k in enumerate(numbers):
            row = judged[k].row
            low, high = (100.0 * share for share in row["mac_rate_pairs_ci95"])
            rate = 100.0 * row["mac_rate"]
            axes.errorbar(
                at, rate, yerr=[[rate - low], [high - rate]], fmt="o", capsize=4.0, color=COLOUR_OF[row["definition"]]
            )
            text = f"{row['macs']} of\n{row['flights']:,}"
            axes.annotate(text, (at, high), (0.0, 4.0), textcoords="offset points", ha="center", fontsize=7.5)
        printed = [
            (at, 100.0 * judged[k].mac_rate.printed)  # type: ignore[operator]  # asked for in the same line
            for at, k in enumerate(numbers)
            if judged[k].mac_rate.printed is not None
        ]
        if printed:
            axes.plot(*zip(*printed, strict=True), "D", color=GREY, markersize=5.0, zorder=1.0, label="as printed")
            axes.legend(loc="upper right", fontsize=8.5)
        _name_definitions(axes, [judged[k].row["definition"] for k in numbers])
        top = axes.get_ylim()[1]
        axes.set_yticks([tick for tick in axes.get_yticks() if 0.0 <= tick <= 100.0])
        axes.set_ylim(-0.02 * top, 1.25 * top)
        axes.set_ylabel("flights in a collision [%]")
    what = "Mid-air collisions, with 95 % intervals"
    head_figure(figure, title_of(what, judged[next(iter(panels.values()))[0]].row, ("solver", *WORLD)))
    return figure


def _name_definitions(axes: Axes, definitions: Sequence[str]) -> None:
    names = [DEFINITION_NAMES[definition] for definition in definitions]
    if len(names) > MANY:
        axes.set_xticks(range(len(names)), names, fontsize=8.0, rotation=30, ha="right", rotation_mode="anchor")
    else:
        axes.set_xticks(range(len(names)), [name.replace(" ", "\n") for name in names], fontsize=8.5)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.grid(False, axis="x")
