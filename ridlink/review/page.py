"""The encounters of a recording as one HTML page, without external resources or scripts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from typing import Any

from ridlink.observer.pairs import HORIZON_S
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION
from ridlink.review.pictures import distance, plan, style_of
from ridlink.review.report import Closest, Met
from ridlink.separation.definitions import Definition
from ridlink.separation.reference import UNKNOWN_ERROR_BOUND_M
from ridlink.words import counted

POLICY = "default-src 'none'; style-src 'unsafe-inline'"

STYLE = """
:root { color-scheme: light dark; --ink: #1a1a1a; --paper: #fff; --faint: #ddd; --soft: #5a5a5a; --bad: #b3261e;
  --one: #0072b2; --two: #c04e00;
  --snmac: #0072b2; --remote-id: #c04e00; --odid-accuracy: #007a5a; --candidate1: #a8527f; --candidate2: #2a8fc7;
  --chance: #a87000 }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --paper: #16181b; --faint: #34383d; --soft: #a5abb3;
  --bad: #ff8a80; --one: #56b4e9; --two: #ff9a4d;
  --snmac: #5b9bff; --remote-id: #ff9a4d; --odid-accuracy: #3fd0a0; --candidate1: #e79bc4; --candidate2: #7fd0ff;
  --chance: #f2c14e } }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: var(--ink);
  background: var(--paper) }
h2 { margin: 2.2rem 0 .3rem; font-size: 1.15rem; overflow-wrap: anywhere }
.wide { overflow-x: auto }
table { border-collapse: collapse; margin: 1rem 0; font-size: 14px; font-variant-numeric: tabular-nums }
th, td { padding: .25rem .45rem; text-align: right; border-bottom: 1px solid var(--faint); white-space: nowrap }
th { color: var(--soft); font-weight: 500; vertical-align: bottom } td:first-child, th:first-child { text-align: left }
td.inside { color: var(--bad) } a { color: inherit } .bad { color: var(--bad); font-weight: 600 }
p { margin: .4rem 0; max-width: 52rem } .soft { color: var(--soft) }
.pictures { display: flex; flex-wrap: wrap; gap: 1rem }
svg { max-width: 100%; height: auto; font-size: 11px; fill: var(--ink) } svg text { paint-order: stroke;
  stroke: var(--paper); stroke-width: 3px }
.grid { stroke: var(--faint); stroke-width: 1 } .tick { fill: var(--soft) } .middle { text-anchor: middle }
.end { text-anchor: end }
path { fill: none } .track, .distance { stroke-width: 2; stroke: var(--ink) } .required { stroke-width: 1.6 }
.one { stroke: var(--one); fill: var(--one) } .two { stroke: var(--two); fill: var(--two) } path.track { fill: none }
.start { fill: var(--paper); stroke-width: 1.5 } text.one, text.two { stroke: var(--paper) } .name { font-weight: 600 }
.error { fill-opacity: .12; stroke-opacity: .5 }
.closest { stroke: var(--ink); stroke-width: 1.2; stroke-dasharray: 2 3 }
.mac { stroke: var(--bad); stroke-width: 1.4; stroke-dasharray: 1 3 }
.key { display: inline-block; margin-right: 1rem; white-space: nowrap } .key svg { vertical-align: middle }
""" + "\n".join(
    f".{style_of(definition)} {{ stroke: var(--{definition}); stroke-dasharray: {dashes} }}"
    for definition, dashes in zip(Definition, ("none", "7 3", "2 2", "7 2 2 2", "12 3", "4 4"), strict=True)
)


@dataclass(frozen=True, slots=True)
class Summary:
    """Facts of a recording for the page.

    Attributes:
        names: Names of the files.
        begun_s, ended_s: First and last time, seconds since 1970; None if nothing was heard.
        aircraft: Number of aircraft.
        encounters: Number of encounters.
        definition: The definition whose discs opened the encounters.
        closest: The pair that came nearest, None if there were never two aircraft.
        convention: Assumed meaning of the senders' accuracy codes.
    """

    names: Sequence[str]
    begun_s: float | None
    ended_s: float | None
    aircraft: int
    encounters: int
    definition: Definition
    closest: Closest | None
    convention: str = DEFAULT_CONVENTION


def report_page(summary: Summary, worst: Sequence[Met], *, drawn: int) -> str:
    """The page as HTML.

    Args:
        summary: Facts of the recording.
        worst: Encounters with the least margins, the least first.
        drawn: How many of them get pictures.
    """
    title = f"Encounters: {', '.join(summary.names)}"
    parts = [
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width">'
        f"<style>{STYLE}</style></head><body><h1>{escape(title)}</h1>",
        f"<p>{escape(summary_line(summary))}</p>",
        f"<p>An encounter begins when two are inside the disc of {summary.definition} or would enter it within "
        f"{HORIZON_S:g} s if both flew on. A margin is the least distance of centres less the radius of the disc; "
        "below zero the disc was entered. Everything is as it was reported: where a vehicle truly was is not known. An "
        "error is three standard deviations as its sender states it in its broadcast or, where none was recorded, in "
        f"its telemetry; ? is one that is not stated, and counts as {UNKNOWN_ERROR_BOUND_M:g} m. Under "
        f"{Definition.ODID_ACCURACY} accuracy codes are read by the convention {escape(summary.convention)}.</p>",
    ]
    if worst:
        parts += [_table(summary, worst, drawn), _legend()]
        parts += [_encounter(number, met) for number, met in enumerate(worst[:drawn], 1) if met.trace is not None]
    return "\n".join([*parts, "</body></html>\n"])


def summary_line(summary: Summary) -> str:
    """The recording in one line."""
    if summary.begun_s is None or summary.ended_s is None or not summary.aircraft:
        return "nobody in it tells a position, by Remote ID or by telemetry"
    text = (
        f"{_clock(summary.begun_s)} to {_clock(summary.ended_s)} UTC: {summary.aircraft:,} aircraft, "
        f"{counted(summary.encounters, 'encounter')} under {summary.definition}"
    )
    if summary.closest is None:
        return text
    one, other = summary.closest.pair
    return text + (
        f"; nearest of all {one} and {other}, {summary.closest.distance_m:.1f} m at {_clock(summary.closest.time_s)} "
        f"(errors {_bound(summary.closest.error_bounds_m)} m)"
    )


def _table(summary: Summary, worst: Sequence[Met], drawn: int) -> str:
    margins_of = (f"{kind}<br>margin m".replace("-", "&#8209;") for kind in Definition)
    heads = ["pair", "nearest<br>m", "at<br>UTC", "errors<br>m", *margins_of, "moved"]
    lines = ['<div class="wide"><table><thead><tr>', *(f"<th>{head}</th>" for head in heads), "</tr></thead><tbody>"]
    for number, met in enumerate(worst, 1):
        row = met.row
        pair = " and ".join(map(escape, row["uas"]))
        if number <= drawn and met.trace is not None:
            pair = f'<a href="#encounter-{number}">{pair}</a>'
        margins = (
            f'<td class="{"inside" if margin < 0.0 else ""}">{margin:.1f}</td>' for margin in row["margin_m"].values()
        )
        lines.append(
            f"<tr><td>{pair}{' <span class=bad>MAC</span>' if row['mac'] else ''}</td><td>{row['closest_m']:.1f}</td>"
            f"<td>{_clock(row['closest_t'], '%H:%M:%S.%f')}</td><td>{_bound(row['horizontal_error_m'])}</td>"
            f"{''.join(margins)}<td>{_moved(row)}</td></tr>"
        )
    lines.append("</tbody></table></div>")
    if summary.encounters > len(worst):
        lines.append(f"<p class=soft>The {len(worst):,} of the least margin of {summary.encounters:,}.</p>")
    return "\n".join(lines)


def _legend() -> str:
    def key(style: str, name: str) -> str:
        line = f'<svg width="34" height="10"><path class="{style}" d="M0 5H34"/></svg>'
        return f'<span class="key">{line} {name}</span>'

    keys = [key("distance", "distance"), key("mac", "airframes touch")]
    keys += [key(f"required {style_of(kind)}", str(kind)) for kind in Definition]
    return f'<p class="soft">{"".join(keys)}</p>'


def _encounter(number: int, met: Met) -> str:
    row = met.row
    one, other = map(escape, row["uas"])
    moved = escape(" and ".join(row["moved"]) or "nobody")
    above = row["closest_vertical_m"]
    height = "" if above is None else f" {other} says it is {abs(above):.1f} m {'above' if above >= 0 else 'below'}."
    return (
        f'<h2 id="encounter-{number}">{number}. {one} and {other}</h2>'
        f"<p>From {_clock(row['start_t'])}, {row['end_t'] - row['start_t']:.1f} s. Nearest at "
        f"{_clock(row['closest_t'])}: {row['closest_m']:.1f} m between centres, reported errors "
        f"{_bound(row['horizontal_error_m'])} m.{height} Manoeuvred until then: {moved}.</p>"
        f'<div class="pictures">{plan(met)}{distance(met)}</div>'
    )


def _moved(row: dict[str, Any]) -> str:
    moved = row["moved"]
    return "both" if len(moved) == 2 else escape(moved[0]) if moved else "nobody"


def _bound(errors: Sequence[float | None]) -> str:
    return " + ".join("?" if error is None or error != error else f"{error:.1f}" for error in errors)


def _clock(time_s: float, form: str = "%Y-%m-%d %H:%M:%S.%f") -> str:
    try:
        return datetime.fromtimestamp(time_s, UTC).strftime(form)[:-5]
    except (ValueError, OverflowError, OSError):  # a capture may contain any time
        return f"{time_s:.1f} s"
