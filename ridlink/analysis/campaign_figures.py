"""Pictures of a campaign, drawn with matplotlib (extra `plot`): mission times, collisions, one against the other.

One panel a scenario, kind of error and solver; times in seconds, shares in per cent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ridlink.analysis.campaign import DEFINITION_NAMES, FlownCell, JudgedCell
from ridlink.analysis.figures import COLOURS, GREY, new_figure, plain_numbers, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOUR_OF = dict(zip(DEFINITION_NAMES, (*COLOURS, GREY), strict=True))
MARKERS = dict(zip(DEFINITION_NAMES, "osv^DPX", strict=True))
WHISKERS = (5.0, 95.0)

Panels = dict[tuple[Any, ...], list[int]]


def draw_campaign(flown: Sequence[FlownCell], judged: Sequence[JudgedCell], folder: Path) -> dict[str, list[Path]]:
    """Draw all figures into a folder; the files of each, by its name."""
    panels: Panels = {}
    for k, cell in enumerate(flown):
        panels.setdefault(cell.key, []).append(k)
    draw: dict[str, Callable[[], Figure]] = {
        "mission-times": partial(_times, panels, flown, judged),
        "collisions": partial(_collisions, panels, judged),
        "time-against-safety": partial(_front, panels, judged),
    }
    return {name: save_figure(figure, folder, name) for name, figure in draw.items()}


def _times(panels: Panels, flown: Sequence[FlownCell], judged: Sequence[JudgedCell]) -> Figure:
    figure, all_axes = _grid(panels)
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
    figure.suptitle("Mission times: median, quartiles, 5 to 95 % of the flights", fontsize=10.0)
    return figure


def _collisions(panels: Panels, judged: Sequence[JudgedCell]) -> Figure:
    figure, all_axes = _grid(panels)
    for axes, numbers in zip(all_axes, panels.values(), strict=True):
        for at, k in enumerate(numbers):
            row = judged[k].row
            low, high = (100.0 * share for share in row["mac_rate_ci95"])
            rate = 100.0 * row["mac_rate"]
            axes.errorbar(
                at, rate, yerr=[[rate - low], [high - rate]], fmt="o", capsize=4.0, color=COLOUR_OF[row["definition"]]
            )
            text = f"{row['macs']} of {row['flights']:,}"
            axes.annotate(text, (at, high), (0.0, 6.0), textcoords="offset points", ha="center", fontsize=8.0)
        printed = [
            (at, 100.0 * judged[k].mac_rate.printed)  # type: ignore[operator]  # asked for in the same line
            for at, k in enumerate(numbers)
            if judged[k].mac_rate.printed is not None
        ]
        if printed:
            axes.plot(*zip(*printed, strict=True), "D", color=GREY, markersize=5.0, zorder=1.0, label="as printed")
            axes.legend(loc="upper right", fontsize=8.5)
        _name_definitions(axes, [judged[k].row["definition"] for k in numbers])
        axes.set_ylim(bottom=-0.02 * axes.get_ylim()[1], top=1.15 * axes.get_ylim()[1])
        axes.set_ylabel("flights in a collision [%]")
    figure.suptitle("Mid-air collisions, with 95 % intervals", fontsize=10.0)
    return figure


def _front(panels: Panels, judged: Sequence[JudgedCell]) -> Figure:
    figure, all_axes = _grid(panels)
    for axes, numbers in zip(all_axes, panels.values(), strict=True):
        for k in numbers:
            row = judged[k].row
            if row["median_s"] is None:
                continue
            definition, high = row["definition"], 100.0 * row["mac_rate_ci95"][1]
            filled = COLOUR_OF[definition] if row["macs"] else "none"
            axes.plot(
                row["median_s"], high, MARKERS[definition], color=COLOUR_OF[definition], markerfacecolor=filled,
                markersize=8.0, linestyle="none", label=DEFINITION_NAMES[definition],
            )  # fmt: skip
        axes.set_yscale("log")
        low, high = np.log10(axes.get_ylim())
        axes.set_ylim(10.0 ** np.floor(low), min(10.0 ** np.ceil(high), 100.0))
        plain_numbers(axes)
        axes.set_xlim(left=0.0, right=1.1 * axes.get_xlim()[1])
        axes.set_xlabel("median mission time [s]")
        axes.set_ylabel("collided flights, below [%]")
        axes.legend(loc="best", fontsize=8.5)
    figure.suptitle("Time against safety: upper 95 % bounds (open: no collision was seen)", fontsize=10.0)
    return figure


def _grid(panels: Panels) -> tuple[Figure, list[Axes]]:
    """Two panels in a line, each with its name."""
    across = min(len(panels), 2)
    down = -(-len(panels) // across)
    figure = new_figure(4.6 * across + 0.4, 3.5 * down + 0.4)
    grid = figure.subplots(down, across, squeeze=False)
    every = list(np.ravel(grid))
    for axes in every[len(panels) :]:
        axes.set_visible(False)
    for axes, key in zip(every, panels, strict=False):
        axes.set_title(", ".join(map(str, key[:4])), fontsize=9.5)
    return figure, every[: len(panels)]


def _name_definitions(axes: Axes, definitions: Sequence[str]) -> None:
    names = [DEFINITION_NAMES[definition].replace(" ", "\n") for definition in definitions]
    axes.set_xticks(range(len(definitions)), names, fontsize=8.5)
    axes.set_xlim(-0.6, len(definitions) - 0.4)
    axes.grid(False, axis="x")
