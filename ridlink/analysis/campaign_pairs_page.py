"""Tables of the campaign page that compare cells: run by run, setting by setting, and over all scenes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from html import escape

from ridlink.analysis.campaign import setting_words
from ridlink.analysis.pairs import Dominance, Pair, Pooled
from ridlink.campaign.cell import Cell, world_words

PAIRED = (
    "Cells of one scene and one kind of errors fly the same fleets with the same errors, so they are compared run by "
    "run. Medians: the same runs are resampled under both. Means: flight by flight, of those that collided in neither. "
    "Collisions: runs with more and with fewer collided flights, and how often chance alone would part them so or "
    "further (exact sign test, McNemar's)."
)  # fmt: skip


def pooled_table(found: Sequence[Pooled]) -> str:
    """Table of flights and collisions over all scenes."""
    if not found:
        return ""
    rows = (
        (
            setting_words(each.conditions["definition"], each.conditions["solver"]),
            _joined(each.conditions["gnss"], world_words(each.conditions)), each.said,
        )
        for each in found
    )  # fmt: skip
    title = f"Collided flights, {' and '.join(found[0].scenarios)} together"
    return _section(title, "", ("setting", "errors", "collided flights"), rows)


def dominance_table(found: Sequence[Dominance]) -> str:
    """Table of settings that are no slower and have no more collisions than another in all cells."""
    rows = (
        (
            setting_words(*each.setting), setting_words(*each.against), world_words(each.world) or "usual",
            f"{each.no_slower} of {each.cells}", f"{each.no_more_macs} of {each.cells}", f"{each.slower}",
            f"{each.more_macs}", "<strong>dominates</strong>" if each.dominates else "",
        )
        for each in found
    )  # fmt: skip
    heads = ("setting", "against", "world", "no slower in", "no more collisions in", "slower beyond chance in",
             "more collisions beyond chance in", "")  # fmt: skip
    why = "Over all scenes and kinds of errors of a world: the median is not above, no more flights collided."
    return _section("Setting against setting", why, heads, rows)


def pairs_table(title: str, found: Sequence[Pair]) -> str:
    """Table that compares cells run by run."""
    rows = (
        (
            _where(pair.cell), setting_words(pair.cell.definition, pair.cell.solver), _against(pair),
            _span(pair.difference.median_s, pair.difference.median_ci95, "{:+.1f}", pair.time_verdict),
            _span(pair.difference.mean_s, pair.difference.mean_ci95, "{:+.2f}"),
            f"{pair.macs} : {pair.macs_against}",
            _span(pair.difference.mac_rate, pair.difference.mac_rate_ci95, "{:+.3%}", pair.mac_verdict),
            f"{pair.difference.more_runs} : {pair.difference.fewer_runs}"
            f"<small>p {_chance(pair.difference.p_value)}</small>",
        )
        for pair in found
    )  # fmt: skip
    heads = ("scene, errors", "setting", "against", "median, less the other s", "mean, less the other s",
             "collided flights", "share, less the other", "runs with more : fewer")  # fmt: skip
    return _section(title, PAIRED, heads, rows)


def _where(cell: Cell) -> str:
    return escape(_joined(cell.scenario, cell.gnss, world_words(asdict(cell))))


def _against(pair: Pair) -> str:
    if pair.cell.loss != pair.against.loss:
        return "nothing lost"
    return setting_words(pair.against.definition, pair.against.solver)


def _span(value: float | None, interval: tuple[float, float] | None, form: str, verdict: str = "") -> str:
    if value is None:
        return "-"
    text = form.format(value)
    if interval is not None:
        text += f"<small>{form.format(interval[0])} to {form.format(interval[1])}</small>"
    return text + (f"<small>{verdict}</small>" if verdict else "")


def _chance(p_value: float) -> str:
    return "&lt; 0.0001" if p_value < 1e-4 else f"{p_value:.2g}"


def _joined(*parts: str) -> str:
    return ", ".join(filter(None, parts))


def _section(title: str, why: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["<tr>" + "".join(f"<td>{column}</td>" for column in row) + "</tr>" for row in rows]
    if not lines:
        return ""
    head = "".join(f"<th>{each}</th>" for each in heads)
    said = f"<p>{why}</p>" if why else ""
    return f"<h2>{title}</h2>{said}<table><thead><tr>{head}</tr></thead><tbody>" + "\n".join(lines) + "</tbody></table>"
