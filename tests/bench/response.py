"""The response models over the measured step responses: a table, and a plot that somebody looks at."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sitl_sim.vehicle import TICK_S
from tests.sitl_sim.measured import DISPLACEMENTS, EAST, NORTH, SETTLE_S, STEPS, STOPS, respond, respond_as_measured

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"ardupilot": "#0072B2", "px4": "#D55E00"}
SECONDS = np.arange(1.0, 6.0)


def report(plot: Path) -> dict[str, list[dict[str, Any]]]:
    """Print the table, draw the plot where matplotlib is installed, and return the rows."""
    rows = _rows()
    print("\nstep responses, model beside what was measured")
    print(f"{'':34}{'measured':>10}{'model':>10}{'off':>8}")
    for row in rows:
        off = row["model"] / row["measured"] - 1.0
        print(f"{row['what']:34}{row['measured']:>8.2f} {row['unit']}{row['model']:>8.2f} {row['unit']}{off:>+8.0%}")
    try:
        _draw(plot)
    except ImportError:
        print("no plot without matplotlib: pip install 'ridlink[plot]'")
    else:
        print(plot)
    return {"response": rows}


def _rows() -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for column, autopilot in ((5, "ardupilot"), (6, "px4")):
        for row in STEPS:
            if row[column] is not None:
                model_s = respond_as_measured(autopilot, row[0]).t63_s(row[3], row[4])
                rows.append(
                    {"what": f"{autopilot} {row[0]}, t63", "unit": "s", "measured": row[column], "model": model_s}
                )
        for speed_mps, measured_m in STOPS[autopilot]:
            moved = respond(autopilot, (speed_mps, 0.0, 0.0), (0.0, 0.0, 0.0)).moved[-1, NORTH]
            what = f"{autopilot} stop from {speed_mps:g}"
            rows.append({"what": what, "unit": "m", "measured": measured_m, "model": float(moved)})
    return rows


def _draw(plot: Path) -> None:
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.use("Agg")
    figure = Figure(figsize=(13.0, 9.0), layout="constrained")
    panels = figure.subplots(3, 4)
    for axes, row in zip(panels.flat, STEPS, strict=False):
        _draw_step(axes, row)
    panels.flat[0].legend(fontsize=8, loc="lower right")
    figure.suptitle("Velocity after a step: models (lines), measured t63 (rings); displacement dotted, right scale")
    figure.savefig(plot, dpi=90)


def _draw_step(axes: Axes, row: Any) -> None:
    name, before, _, axis, to_mps, *measured_s = row
    displaced = next((each for each in DISPLACEMENTS if each[0] == name), None)
    right = axes.twinx() if displaced else None
    for column, (autopilot, colour) in enumerate(COLOURS.items()):
        response = respond_as_measured(autopilot, name)
        time_s = np.arange(len(response.velocity)) * TICK_S
        axes.plot(time_s, response.velocity[:, axis], color=colour, label=autopilot)
        if measured_s[column] is not None:
            at = before[axis] + 0.63 * (to_mps - before[axis])
            axes.plot(measured_s[column], at, "o", color=colour, fillstyle="none")
        if right is not None and displaced is not None:
            time_s = time_s[time_s <= 5.2]
            right.plot(time_s, response.aside_m(time_s), ":", color=colour)
            right.plot(SECONDS, displaced[1 + column], "x", color=colour)
    axes.set_title(f"{name} m/s ({'NED'[axis] if axis != EAST else 'E'})", fontsize=9)
    axes.set_xlim(0.0, SETTLE_S)
    axes.axhline(to_mps, color="grey", linewidth=0.6, linestyle="--")
