"""The report of a campaign as one self-contained HTML page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape

from ridlink.analysis.campaign import DEFINITION_NAMES, TOLERANCE, Judged, JudgedCell, Verdict
from ridlink.campaign.cell import world_words
from ridlink.campaign.statistics import Difference
from ridlink.words import counted, or_dash

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 76rem; margin: 2rem auto; padding: 0 1rem; color: #1a1a1a }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
table { display: block; overflow-x: auto }
th, td { padding: .3rem .45rem; text-align: right; border-bottom: 1px solid #ddd; vertical-align: top }
td:first-child { min-width: 10rem }
th:first-child, td:first-child, th:nth-child(2), td:nth-child(2), td.why { text-align: left }
small { color: #555; display: block; white-space: nowrap } img { max-width: 100%; height: auto }
.reproduced { color: #00603f } .differs { color: #8a4b00 } .not-reproducible { color: #a3261a }
"""
ALTERNATIVES = {
    "mission-times": "Box plots of the mission times under each definition",
    "distributions": "Share of flights that have arrived by each time under each definition",
    "collisions": "Share of flights in a collision under each definition, with intervals",
    "time-against-safety": "Median mission time against the upper bound of the collided flights",
    "sensitivity": "Median mission time and share of flights in a collision as one condition varies",
}


def report_page(title: str, cells: Sequence[JudgedCell], tables: Sequence[str], figures: Mapping[str, bytes]) -> str:
    """The page.

    Args:
        title: Title of the page.
        cells: Its rows.
        tables: Further tables, as HTML, between the rows and the figures.
        figures: SVG files by name, which are embedded in the page.
    """
    flights = sum(cell.row["flights"] for cell in cells)
    is_compared = any(cell.median.verdict is not Verdict.NOT_PRINTED for cell in cells)
    parts = [
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width">'
        f"<style>{STYLE}</style></head><body><h1>{escape(title)}</h1>",
        f"<p>{counted(flights, 'flight')}. Intervals hold with 95 %: Clopper-Pearson for shares, a bootstrap over "
        "whole runs, six or more, for times, differences and ratios; differences and ratios compare the same runs "
        "under both definitions. "
        "Vehicles collide two at a time: of collisions there are half as many as of collided flights, and intervals "
        "of their share are those of pairs. Times are those of flights without a collision.</p>",
    ]
    if is_compared:
        parts.append(
            f"<p>Beside every figure stands the printed one. A time or ratio is <em>reproduced</em> within "
            f"{TOLERANCE:.0%}, a collision rate if the interval holds the printed one. Nothing is tuned towards a "
            "printed figure. The paper counts 72,000 flights; 500 runs of 4 definitions with 8 and 24 vehicles are "
            "64,000.</p>"
        )
    parts.append(_table(cells))
    if is_compared:
        parts.append(_reasons(cells))
    parts += [*tables, *(_figure(name, file) for name, file in figures.items())]
    return "\n".join([*parts, "</body></html>\n"])


def _table(cells: Sequence[JudgedCell]) -> str:
    heads: tuple[str, ...] = (
        "scenario, errors, solver", "definition", "flights", "collided", "collided, share", "median s",
        "slower than sNMAC by s", "ratio to sNMAC", "nearest m", "unfinished", "infeasible",
    )  # fmt: skip
    shows_risk = any(cell.row["risk_ratio"] is not None for cell in cells)
    if shows_risk:
        heads += ("risk, none avoiding = 1",)
    lines = ["<table><thead><tr>", *(f"<th>{head}</th>" for head in heads), "</tr></thead><tbody>"]
    for cell in cells:
        row = cell.row
        nearest = row["min_separation_m"]
        columns: tuple[str, ...] = (
            escape(", ".join(filter(None, (row["scenario"], row["gnss"], row["solver"], world_words(row))))),
            DEFINITION_NAMES[row["definition"]],
            f"{row['flights']:,}",
            f"{row['macs']}",
            _rate(cell.mac_rate, row["macs"], row["flights"]),
            _number(cell.median, 1),
            _slower(cell.beside_snmac),
            _number(cell.ratio, 2),
            or_dash(nearest),
            f"{row['unfinished']}",
            f"{row['infeasible_share']:.1%}",
        )
        if shows_risk:
            columns += (_risk(row["risk_ratio"], row["risk_ratio_ci95"]),)
        lines.append("<tr>" + "".join(f"<td>{column}</td>" for column in columns) + "</tr>")
    return "\n".join([*lines, "</tbody></table>"])


def _risk(ratio: float | None, interval: Sequence[float] | None) -> str:
    if ratio is None:
        return "-"
    return f"{ratio:.2g}" + ("" if interval is None else f"<small>{interval[0]:.2g} to {interval[1]:.2g}</small>")


def _slower(found: Difference | None) -> str:
    if found is None or found.median_s is None:
        return "-"
    return f"{found.median_s:.1f}{_interval(found.median_ci95, 1)}"


def _number(judged: Judged, digits: int) -> str:
    if judged.ours is None:
        return "-"
    text = f"{judged.ours:.{digits}f}{_interval(judged.interval, digits)}"
    return text if judged.printed is None else text + _printed(judged, f"{judged.printed:g}")


def _rate(judged: Judged, macs: int, flights: int) -> str:
    assert judged.ours is not None and judged.interval is not None
    low, high = judged.interval
    text = f"{judged.ours:.2%}<small>{low:.2%} to {high:.2%}</small>"
    if not macs:
        text = f"0 of {flights:,}<small>below {100.0 * high:.2g}%</small>"
    return text if judged.printed is None else text + _printed(judged, f"{judged.printed:.1%}")


def _printed(judged: Judged, printed: str) -> str:
    kind = judged.verdict.replace(" ", "-")
    return f'<small>printed {printed}</small><small class="{kind}">{judged.verdict}</small>'


def _interval(interval: Sequence[float] | None, digits: int) -> str:
    return "" if interval is None else f"<small>{interval[0]:.{digits}f} to {interval[1]:.{digits}f}</small>"


def _figure(name: str, svg: bytes) -> str:
    drawn = base64.b64encode(svg).decode()
    shown = next(words for kind, words in ALTERNATIVES.items() if name.startswith(kind))
    return f'<p><img alt="{shown}" src="data:image/svg+xml;base64,{drawn}"></p>'


def _reasons(cells: Sequence[JudgedCell]) -> str:
    lines = ["<h2>What is not reproduced, and why</h2><table><tbody>"]
    for cell in cells:
        for what, judged in (("median", cell.median), ("ratio", cell.ratio), ("collisions", cell.mac_rate)):
            if judged.why:
                where = f"{escape(cell.row['scenario'])}, {DEFINITION_NAMES[cell.row['definition']]}"
                lines.append(
                    f'<tr><td>{where}</td><td>{what}: <span class="{judged.verdict.replace(" ", "-")}">'
                    f'{judged.verdict}</span></td><td class="why">{escape(judged.why)}</td></tr>'
                )
    return "\n".join([*lines, "</tbody></table>"])
