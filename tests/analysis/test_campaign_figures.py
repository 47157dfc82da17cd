"""Distributions of mission times, as they are drawn."""

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="figures need the extra 'plot'")

from ridlink.analysis.campaign import judge_cells
from ridlink.analysis.campaign_figures import MOST_POINTS, arrivals, draw_campaign
from ridlink.campaign.statistics import Flights
from tests.analysis.cells import flown


def test_who_collides_never_arrives() -> None:
    times_s, share = arrivals(flown("snmac", 7.0, macs=8))
    assert times_s.shape == share.shape == (72,) and np.all(np.diff(times_s) > 0.0)
    assert share[0] == pytest.approx(100.0 / 80.0) and share[-1] == pytest.approx(90.0)
    assert times_s[36] == pytest.approx(7.0, abs=0.1)


def test_who_is_late_never_arrives() -> None:
    cell = flown("snmac", 7.0)
    cell.flights.time_s[0, :4] = 120.0  # the cut-off
    cell.row["unfinished"] = 4
    times_s, share = arrivals(cell)
    assert times_s.max() < 7.2 and share[-1] == pytest.approx(95.0)


def test_many_flights_are_thinned_out_and_keep_both_ends() -> None:
    cell = flown("snmac", 7.0)
    many = Flights(np.arange(20_000.0).reshape(2500, 8), np.zeros((2500, 8), bool), cell.flights.medians)
    times_s, share = arrivals(type(cell)(cell.row, many, 1))
    assert times_s.size == MOST_POINTS and (times_s[0], times_s[-1]) == (0.0, 19_999.0)
    assert share == pytest.approx(100.0 * (times_s + 1.0) / 20_000.0)


def test_cells_of_which_nobody_arrives_are_drawn() -> None:
    cells = [flown("snmac", 7.0, macs=80), flown("candidate2", 8.0, macs=80)]
    files = draw_campaign(cells, judge_cells(cells, as_printed=False))
    assert {"distributions.svg", "distributions.png"} <= files.keys()
