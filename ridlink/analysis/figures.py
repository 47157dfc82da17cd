"""The paper's analytic figures, drawn with matplotlib (extra `plot`) as PNG and SVG, with the same bytes every time.

Distances are in metres, times in seconds. Colours are those of Okabe and Ito, which colour-blind readers can
distinguish; lines also differ in style, for print.
"""

from __future__ import annotations

import errno
import io
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ridlink.analysis.printed import PAPER_SIGMA_M, excess_distances
from ridlink.errors import MissingExtraError
from ridlink.files import write_together
from ridlink.separation.chance import ChanceBound
from ridlink.separation.components import displacement_line, localization_error, unmac_radius_distribution
from ridlink.separation.reference import (
    CATEGORIES,
    GPS_SIGMA_M,
    GPS_STANDARDS,
    MAX_AIRFRAME_M,
    REPORT_INTERVAL_S,
    SNMAC_PAIR_RADIUS_M,
    UNKNOWN_ERROR_BOUND_M,
)
from ridlink.technologies import COMPARED

try:
    import matplotlib
    from matplotlib.figure import Figure
    from matplotlib.ticker import FormatStrFormatter, NullFormatter
except ImportError as error:
    raise MissingExtraError("plot", "drawing figures") from error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
STYLES = ("-", "--", "-.", ":")
GREY = "#555555"
PNG_DPI = 150

STYLE = {
    "font.size": 10.0,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.framealpha": 1.0,
    "legend.edgecolor": "white",
    "svg.hashsalt": "ridlink",
}

UNMAC_INTERVALS_S = (0.1, 0.5, 1.0, 3.0)


def draw_figures(folder: Path) -> list[Path]:
    """Draw every figure into a folder, which is created if it does not exist; all of them or none.

    Returns:
        The files, in the order of the paper; existing ones are replaced.

    Raises:
        OSError: If the folder or a file cannot be written.
    """
    if folder.exists() and not folder.is_dir():  # for a device, `mkdir` would report that it exists
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    files: dict[str, bytes] = {}
    for name, draw in FIGURES.items():
        files |= draw_figure(draw, name)
    write_together(folder, files)
    return [folder / name for name in files]


def draw_figure(draw: Callable[[], Figure], name: str, *, formulas: bool = True) -> dict[str, bytes]:
    """One figure in the common style as PNG and SVG, with the same bytes every time; contents by file name.

    Args:
        draw: Function that draws it.
        name: Name of the files, without a suffix.
        formulas: Whether text between dollar signs is a formula; False if names of scenes are drawn, which may contain
            dollar signs.
    """
    files = {}
    with matplotlib.rc_context({**STYLE, "text.parse_math": formulas}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a letter that is not in the font is drawn as a box
        figure = draw()
        for suffix, metadata in (("png", {"Software": None}), ("svg", {"Date": None, "Creator": None})):
            drawn = io.BytesIO()
            figure.savefig(drawn, format=suffix, dpi=PNG_DPI, metadata=metadata)
            files[f"{name}.{suffix}"] = drawn.getvalue()
    return files


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def localization_figure() -> Figure:
    """Error of both vehicles, Eq. 12, for the standards of Table II; with the standard's bound of 80 m."""
    figure, axes = _figure(7.0, 4.2)
    x = np.linspace(0.0, 90.0, 1801)
    for k, (sigma, standard) in enumerate(zip(GPS_SIGMA_M, GPS_STANDARDS, strict=True)):
        error = localization_error(sigma)
        label = (
            rf"$\sigma$ = {sigma:g} m, {standard}: mean {error.mean:.1f} m, 99.9 % {float(error.quantile(0.999)):.1f} m"
        )
        axes.plot(x, error.pdf(x), STYLES[k], color=COLOURS[k], label=label)
        axes.axvline(float(error.quantile(0.999)), 0.0, 0.7, color=COLOURS[k], linewidth=0.8, linestyle=STYLES[k])
    bound = 2.0 * UNKNOWN_ERROR_BOUND_M
    axes.axvline(bound, 0.0, 0.7, color=GREY, label=f"upper bound without a report, {bound:.0f} m")
    axes.set(xlabel="localization error of both vehicles [m]", ylabel="density [1/m]", xlim=(0.0, 90.0))
    axes.set_ylim(0.0, 0.36)
    axes.set_title("Localization error of a pair (vertical lines: 99.9 %)", fontsize=10.0)
    axes.legend(loc="upper right", fontsize=8.5)
    return figure


def mobility_figure() -> Figure:
    """Distance that two vehicles of a category fly between two reports, 99.7 %, over the time between them."""
    figure, axes = _figure(7.0, 4.6)
    interval = np.geomspace(0.01, 10.0, 61)
    for k, (number, category) in enumerate(CATEGORIES.items()):
        flown = [displacement_line(category, each) for each in interval]
        axes.loglog(interval, flown, STYLES[k], color=COLOURS[k], label=f"category {number}")
    for interval_s, names in _technologies_by_interval().items():
        axes.axvline(interval_s, color=GREY, linewidth=0.8, linestyle=":")
        axes.annotate(
            "\n".join(names), (interval_s, 0.985), xycoords=("data", "axes fraction"), xytext=(-3, 0),
            textcoords="offset points", rotation=90, ha="right", va="top", fontsize=8, color=GREY,
        )  # fmt: skip
    axes.set(xlabel="time between two reports [s]", ylabel="displacement of both vehicles, 99.7 % [m]")
    axes.set(xlim=(0.01, 10.0), ylim=(0.2, 2e4))
    plain_numbers(axes)
    axes.legend(loc="lower right")
    axes.set_title("Displacement between two reports (dotted: shortest interval of a technology)", fontsize=10.0)
    return figure


def unmac_figure() -> Figure:
    """Radius of the uNMAC of two vehicles of category 3, worst and best receivers, for several intervals."""
    figure = Figure(figsize=(7.0, 6.2), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    x = np.linspace(0.0, 210.0, 2101)
    for axes, sigma in zip(panels, (GPS_SIGMA_M[-1], GPS_SIGMA_M[0]), strict=True):
        for k, interval_s in enumerate(UNMAC_INTERVALS_S):
            radius = unmac_radius_distribution(sigma, interval_s)
            q997 = float(radius.quantile(0.997))
            label = rf"$\Delta t$ = {interval_s:g} s: mean {radius.mean:.1f} m, 99.7 % {q997:.1f} m"
            axes.plot(x, radius.pdf(x), STYLES[k], color=COLOURS[k], label=label)
        axes.axvline(SNMAC_PAIR_RADIUS_M, color=GREY, linewidth=1.0, linestyle=":", label="sNMAC, 15 m")
        worst = MAX_AIRFRAME_M + 2.0 * UNKNOWN_ERROR_BOUND_M + 2.0 * REPORT_INTERVAL_S * CATEGORIES[3].cruise_speed_mps
        label = rf"standard Remote ID at $\Delta t$ = {REPORT_INTERVAL_S:g} s, {worst:.1f} m"
        axes.axvline(worst, color=GREY, linewidth=1.0, label=label)
        axes.set(ylabel="density [1/m]", xlim=(0.0, 210.0))
        axes.set_ylim(bottom=0.0)
        axes.set_title(rf"$\sigma$ = {sigma:g} m, both vehicles", fontsize=10.0)
        axes.legend(loc="upper right", fontsize=8.5)
    panels[-1].set_xlabel("uNMAC radius of two vehicles of category 3 [m]")
    return figure


def wireless_figure() -> Figure:
    """Technologies: time between reports, range, and distance that a pair flies in that time. Sources:
    `technologies`."""
    figure = Figure(figsize=(8.4, 3.6), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    rows = sorted(COMPARED, key=lambda each: -each.period_s)
    names = [each.label for each in rows]
    columns = (
        ("time between two reports [s]", [each.period_s for each in rows], (0.03, 60.0)),
        ("range in the open [m]", [each.range_m for each in rows], (100.0, 4e4)),
        (
            "two of category 3 fly\nmeanwhile, 99.7 % [m]",
            [displacement_line(CATEGORIES[3], each.period_s) for each in rows],
            (1.0, 3000.0),
        ),
    )
    for axes, colour, (label, values, limits) in zip(panels, COLOURS, columns, strict=False):
        axes.hlines(names, limits[0], values, color=colour, linewidth=1.5)
        axes.semilogx(values, names, "o", color=colour)
        for name, value in zip(names, values, strict=True):
            axes.annotate(
                f"{value:.3g}" if value < 1000.0 else f"{value:.0f}", (value, name), xytext=(6, 0),
                textcoords="offset points", va="center", fontsize=8.5,
            )  # fmt: skip
        axes.set(xlabel=label, xlim=limits)
        axes.grid(False, axis="y")
        plain_numbers(axes, vertical=False)
    panels[0].set_ylim(-0.6, len(rows) - 0.4)
    return figure


def chance_figure() -> Figure:
    """Distance kept beyond the airframes over eta, in each form of the chance constraint and by the paper."""
    figure, axes = _figure(7.0, 4.2)
    risk = np.geomspace(0.1, 1e-6, 101)
    rows = excess_distances(tuple((1.0 - risk).tolist()))
    labels = {
        ChanceBound.HALFPLANE: r"half-plane, exact: $\Phi^{-1}(\eta) \sqrt{\sigma_i^2 + \sigma_j^2}$",
        ChanceBound.COVARIANCE: r"covariance: $\sqrt{-2 \ln(1-\eta)} \sqrt{\sigma_i^2 + \sigma_j^2}$",
        ChanceBound.CONTOURS: r"contours: $\sqrt{-2 \ln(1-\sqrt{\eta})}\, (\sigma_i + \sigma_j)$",
    }
    for k, bound in enumerate(ChanceBound):
        axes.semilogx(risk, [row[bound.value] for row in rows], STYLES[k], color=COLOURS[k], label=labels[bound])
    axes.axhline(rows[0]["three_sigma"], color=GREY, linestyle=":", label=r"$3 \sigma$ of each, whatever $\eta$ is")
    axes.set(xlabel=r"risk of one encounter, $1 - \eta$", ylabel="distance kept beyond the airframes [m]")
    axes.set(xlim=(0.1, 1e-6), ylim=(0.0, 150.0))
    axes.legend(loc="upper left", fontsize=9.0)
    axes.set_title(f"Chance constraint, errors of {PAPER_SIGMA_M:g} m per axis each", fontsize=10.0)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "wireless_technologies": wireless_figure,
    "localization_error": localization_figure,
    "mobility": mobility_figure,
    "unmac_sizes": unmac_figure,
    "chance_constraint": chance_figure,
}
"""By file name, in the order of the paper."""


def _figure(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    figure = new_figure(width_in, height_in)
    return figure, figure.subplots()


def plain_numbers(axes: Axes, *, vertical: bool = True) -> None:
    """Label axes with 1000 instead of a power of ten, and not between the decades."""
    for axis in (axes.xaxis, axes.yaxis) if vertical else (axes.xaxis,):
        axis.set_major_formatter(FormatStrFormatter("%g"))
        axis.set_minor_formatter(NullFormatter())


def _technologies_by_interval() -> dict[float, list[str]]:
    """Names of the technologies at each interval; technologies with equal intervals share a line."""
    grouped: dict[float, list[str]] = {}
    for technology in sorted(COMPARED, key=lambda each: each.period_s):
        near = next((known for known in grouped if technology.period_s / known < 1.1), technology.period_s)
        grouped.setdefault(near, []).append(technology.label)
    return grouped
