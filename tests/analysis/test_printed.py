"""The paper's printed figures beside ours: which are equal, which differ, and why."""

from __future__ import annotations

import json

import pytest

from ridlink.analysis import Comparison, Verdict, comparisons, excess_distances
from ridlink.analysis.printed import compared

ROWS = comparisons()


def the(text: str) -> Comparison:
    (found,) = (row for row in ROWS if text in row.what)
    return found


@pytest.mark.parametrize(
    ("printed", "ours", "verdict"),
    [
        ("3", 3.032, Verdict.EQUAL),
        ("3", 3.49, Verdict.EQUAL),
        ("3", 3.51, Verdict.DIFFERS),
        ("5.6", 5.585, Verdict.EQUAL),
        ("9.34", 9.353, Verdict.CLOSE),
        ("7.4", 7.739, Verdict.DIFFERS),
        (None, 7.739, Verdict.NOT_PRINTED),
    ],
)
def test_a_figure_is_judged_by_the_digits_that_were_printed(printed: str | None, ours: float, verdict: Verdict) -> None:
    row = compared("somewhere", "something", "m", printed, ours, "because")
    assert row.verdict is verdict
    assert row.why == ("because" if verdict in (Verdict.CLOSE, Verdict.DIFFERS) else "")


def test_what_differs_says_why_and_nothing_else_does() -> None:
    for row in ROWS:
        assert bool(row.why) == (row.verdict in (Verdict.CLOSE, Verdict.DIFFERS)), row
        assert (row.printed is None) == (row.verdict is Verdict.NOT_PRINTED), row
    assert len({(row.where, row.what) for row in ROWS}) == len(ROWS)


@pytest.mark.parametrize(
    ("what", "ours", "verdict"),
    [
        ("mean error of a pair, sigma 1.9", 3.032, Verdict.EQUAL),
        ("mean error of a pair, sigma 3.5", 5.585, Verdict.EQUAL),
        ("mean error of a pair, sigma 4.85", 7.739, Verdict.DIFFERS),
        ("mean error of a pair, sigma 10", 15.958, Verdict.EQUAL),
        ("99.9 % error of a pair, sigma 1.9", 9.353, Verdict.CLOSE),
        ("99.9 % error of a pair, sigma 3.5", 17.229, Verdict.CLOSE),
        ("99.9 % error of a pair, sigma 4.85", 23.874, Verdict.CLOSE),
        ("99.9 % error of a pair, sigma 10", 49.224, Verdict.CLOSE),
        ("two of category 1 fly", 35.774, Verdict.NOT_PRINTED),
        ("two of category 4 fly", 88.343, Verdict.NOT_PRINTED),
        ("mode of the MAC distance", 3.8, Verdict.DIFFERS),
        ("sum of the two largest airframes", 15.0, Verdict.EQUAL),
        ("Remote ID, error part of the diameter", 160.0, Verdict.EQUAL),
        ("flights", 64000.0, Verdict.DIFFERS),
    ],
)
def test_printed_figures(what: str, ours: float, verdict: Verdict) -> None:
    row = the(what)
    assert row.ours == pytest.approx(ours, abs=6e-4)
    assert row.verdict is verdict


def test_the_mean_that_does_not_follow_follows_from_the_table_of_gps_accuracies() -> None:
    """7.4 m is 1.59577 times a third of the printed 13.85 m; the printed sigma of 4.85 m gives 7.74 m."""
    assert round(1.59577 * 13.85 / 3.0, 1) == 7.4
    assert "4.62" in the("mean error of a pair, sigma 4.85").why


def test_what_technologies_allow_is_a_range_over_the_categories() -> None:
    assert the("Wi-Fi beacon").ours == pytest.approx((2.786, 9.046), abs=1e-3)
    assert the("Wi-Fi beacon").verdict is the("LoRa").verdict is Verdict.EQUAL
    assert the("FLARM").verdict is the("Bluetooth 4").verdict is Verdict.DIFFERS


def test_excess_distances_over_eta() -> None:
    """Half-plane, covariance, contours, and the paper's three sigma of both, for 10 m."""
    printed = {0.95: (23.3, 34.6, 54.2, 60.0), 0.99: (32.9, 42.9, 65.1, 60.0), 0.999: (43.7, 52.6, 78.0, 60.0)}
    for row in excess_distances():
        found = (row["halfplane"], row["covariance"], row["contours"], row["three_sigma"])
        assert found == pytest.approx(printed[row["eta"]], abs=0.05)


def test_every_row_is_json() -> None:
    assert len(json.loads(json.dumps([row.as_dict() for row in ROWS]))) == len(ROWS)
