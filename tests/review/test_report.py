"""What is reported of a flight is what happened in it."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import ridlink
from ridlink.cli.campaign import run as campaign_run
from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.review import Report, Source, Walk, together, traces
from ridlink.review.drawing import Frame, round_numbers
from ridlink.review.page import Summary, report_page
from ridlink.separation.definitions import Definition
from tests.observer.flights import Flyer
from tests.review.recordings import NORTHBOUND, SOUTHBOUND, START_S, recorded

HOSTILE = [
    b"<img src=x onerror=",
    b"\x1b[2J\x07]0;owned\n",
    b"=cmd|'/c calc'!A1",
    b"+/#\"'><script>a",
    b"../../etc/passwd",
]


def reported(path: Path, **options: Any) -> tuple[Report, list[dict[str, Any]], Walk]:
    rows: list[dict[str, Any]] = []
    report = Report(on_encounter=rows.append, **options)
    walk = Walk([report])
    walk.through(together([Source(str(path))]))
    return report, rows, walk


def page_of(report: Report, *, drawn: int = 40) -> str:
    summary = Summary(["f.tlog"], START_S, START_S + 60.0, 2, report.encounters, Definition.CANDIDATE2, report.closest)
    return report_page(summary, report.worst(), drawn=drawn)


def test_a_pass_is_one_row_with_its_margins(tmp_path: Path) -> None:
    report, [row], _ = reported(recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND], 26.0))
    assert row["uas"] == ["ALPHA", "BRAVO"] and row["moved"] == [] and not row["mac"] and not row["at_end"]
    assert row["closest_t"] - START_S == pytest.approx(20.0, abs=0.05)
    assert row["closest_m"] == pytest.approx(6.0, abs=0.1)
    assert row["horizontal_error_m"] == [10.5, 10.5] and row["closest_vertical_m"] == 0.0
    assert list(row["margin_m"]) == list(Definition) == list(row["inside_s"])
    assert row["margin_m"]["snmac"] == pytest.approx(6.0 - 15.0, abs=0.1)
    assert row["margin_m"]["candidate2"] == pytest.approx(6.0 - (0.6 + 21.0 + 2.0), abs=0.1)
    assert report.closest is not None and report.closest.distance_m == pytest.approx(row["closest_m"], abs=0.01)


def test_the_end_of_a_recording_is_said(tmp_path: Path) -> None:
    _, [row], _ = reported(recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND], 15.0))
    assert row["at_end"] and row["end_t"] - START_S == pytest.approx(14.9, abs=0.01)


@pytest.mark.parametrize(("sigma_m", "within_m"), [(1.0, 6.0), (0.0, 0.1)])
def test_the_closest_approach_of_a_campaigns_flight_is_the_referees(
    tmp_path: Path, sigma_m: float, within_m: float
) -> None:
    """Its log says what was true, as GLOBAL_POSITION_INT, beside what was told; only the latter is reported on."""
    log = tmp_path / "f.tlog"
    row = _flown(log, "candidate2", sigma_m)
    report, rows, _ = reported(log)
    assert report.closest is not None
    errors = sum(report.closest.error_bounds_m)
    assert errors == pytest.approx(6.0 * sigma_m, abs=0.03)  # an exact position goes out as 1 cm
    assert abs(report.closest.distance_m - row["min_separation_m"]) <= min(within_m, max(errors, 0.1))

    truth = _true_approaches(log)
    assert len(rows) >= 20
    for pair, met in itertools.groupby(sorted(rows, key=lambda one: one["uas"]), key=lambda one: one["uas"]):
        closest_m = min(one["closest_m"] for one in met)
        assert closest_m >= truth[tuple(pair)] - within_m, pair
    nearest = min(rows, key=lambda one: one["closest_m"])
    assert nearest["closest_m"] == pytest.approx(truth[tuple(nearest["uas"])], abs=within_m)


def test_the_collisions_of_a_campaigns_flight_are_the_referees(tmp_path: Path) -> None:
    """Without avoidance and errors; who has collided is gone, and nobody collides with what it might have become."""
    log = tmp_path / "f.tlog"
    row = _flown(log, "none", 0.0)
    report, rows, _ = reported(log)
    assert len({name for one in rows if one["mac"] for name in one["uas"]}) == row["macs"] > 0
    assert report.closest is not None
    assert report.closest.distance_m == pytest.approx(row["min_separation_m"], abs=0.1)


def _flown(log: Path, definition: str, sigma_m: float) -> dict[str, Any]:
    """The row of one flight of a campaign, and its log."""
    arguments = ["--scenario", "circle8", "--definition", definition, "--sigma", str(sigma_m), "--seed", "3"]
    done = CliRunner().invoke(campaign_run, [*arguments, "--only-run", "2", "--log", str(log), "--json"])
    [row] = json.loads(done.stdout)["rows"]
    flown: dict[str, Any] = row
    return flown


def _true_approaches(log: Path) -> dict[tuple[str, ...], float]:
    position = ridlink.decode(log)["GLOBAL_POSITION_INT"]
    origin = Geodetic(position["lat"][0] / 1e7, position["lon"][0] / 1e7, position["alt"][0] / 1e3)
    ned = ned_from_geodetic(position["lat"] / 1e7, position["lon"] / 1e7, position["alt"] / 1e3, origin)
    tracks = {
        number: dict(zip(position["t_us"][own].tolist(), ned[own, :2], strict=True))
        for number in np.unique(position["sysid"]).tolist()
        if (own := position["sysid"] == number).any()
    }
    approaches = {}
    for pair in itertools.permutations(tracks, 2):
        one, other = (tracks[number] for number in pair)
        offset = np.array([one[at] - other[at] for at in sorted(one.keys() & other.keys())])
        way = np.diff(offset, axis=0)
        share = np.clip(-(offset[:-1] * way).sum(1) / np.maximum((way**2).sum(1), 1e-9), 0.0, 1.0)
        nearest = offset[:-1] + share[:, None] * way
        approaches[tuple(f"{number}/1" for number in pair)] = float(np.hypot(*nearest.T).min())
    return approaches


class Tags(HTMLParser):
    """Which elements and attributes a page has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: dict[str, set[str | None]] = {}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            self.attributes.setdefault(name, set()).add(value)


def test_the_page_has_two_pictures_an_encounter_and_asks_for_nothing(tmp_path: Path) -> None:
    third = Flyer(3, (0.0, 200.0), (0.0, -10.0), b"CHARLIE")
    report, rows, _ = reported(recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND, third], 22.0), keep=10)
    text = page_of(report)
    assert len(rows) == 3 and text.count('<svg role="img"') == 2 * len(rows)
    found = Tags(text)
    assert not found.tags & {"script", "link", "img", "iframe", "object", "base", "form"}
    assert not {"src", "onload", "onerror", "onclick", "srcset"} & found.attributes.keys()
    assert all(value is not None and value.startswith("#encounter-") for value in found.attributes["href"])
    assert "url(" not in text and "http" not in text.replace("http-equiv", "")
    assert page_of(report, drawn=1).count('<svg role="img"') == 2
    margins = [met.margin_m for met in report.worst()]
    assert margins == sorted(margins)


def test_hostile_identities_are_inert_in_rows_and_page(tmp_path: Path) -> None:
    crowd = [Flyer(k, (40.0 * k, 10.0 - 20.0 * k), (0.0, 10.0), identity) for k, identity in enumerate(HOSTILE, 1)]
    harmless = [replace(one, identity=b"N%d" % one.sysid) for one in crowd]
    crossing = Flyer(99, (0.0, 10.0), (20.0, 0.0), b"CROSSING")
    pages = []
    for name, flyers in (("hostile", crowd), ("harmless", harmless)):
        path = recorded(tmp_path / f"{name}.tlog", [*flyers, crossing], 10.5)
        report, rows, _ = reported(path, keep=20)
        assert {name for row in rows for name in row["uas"]} >= {"CROSSING"} and len(rows) >= len(HOSTILE)
        assert all(name.isprintable() and name.isascii() for row in rows for name in row["uas"])
        pages.append(page_of(report))
    hostile, plain = map(Tags, pages)
    assert hostile.tags == plain.tags and hostile.attributes.keys() == plain.attributes.keys()
    assert "\x1b" not in pages[0] and "&lt;img src=x onerror=" in pages[0]


def test_a_page_without_encounters_says_so(tmp_path: Path) -> None:
    report, rows, _ = reported(recorded(tmp_path / "f.tlog", [NORTHBOUND], 5.0), keep=10)
    assert not rows and report.closest is None
    text = page_of(report)
    assert "0 encounters" in text and "<table" not in text


def test_only_the_least_margins_are_kept(tmp_path: Path) -> None:
    crowd = [Flyer(k, (20.0 * k, -200.0), (0.0, 10.0)) for k in range(1, 5)]
    crossing = Flyer(9, (0.0, 200.0), (0.3, -10.0), b"NINE")
    report, rows, _ = reported(recorded(tmp_path / "f.tlog", [*crowd, crossing], 25.0), keep=3)
    least = sorted(row["margin_m"]["candidate2"] for row in rows)[:3]
    assert len(rows) > 3 and [met.margin_m for met in report.worst()] == least


def test_a_long_encounter_is_traced_more_coarsely_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(traces, "MAX_SAMPLES", 30)
    beside = Flyer(2, (-200.0, 10.0), (10.0, 0.0), b"BRAVO")
    report, _, _ = reported(recorded(tmp_path / "f.tlog", [NORTHBOUND, beside], 13.0), keep=1)
    [met] = report.worst()
    assert met.trace is not None and 15 < len(met.trace) <= 30
    assert met.trace.time_s[-1] - START_S > 12.0
    assert met.trace.distance_m == pytest.approx(10.0, abs=0.1)


def test_ticks_are_round_and_within() -> None:
    assert round_numbers((0.0, 20.0), 5) == [0.0, 5.0, 10.0, 15.0, 20.0]
    assert round_numbers((-0.31, 0.22), 6) == [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2]
    assert round_numbers((1.0, 1.0), 5) == []


def test_a_metre_is_a_metre_on_both_axes_of_a_plan() -> None:
    frame = Frame.true_to_scale(400.0, 300.0, (0.0, 10.0), (0.0, 90.0))
    one, east, north = frame.at([0.0, 10.0, 0.0], [0.0, 0.0, 10.0])
    assert east[0] - one[0] == pytest.approx(one[1] - north[1])
