"""Verdicts on a campaign: by a stated tolerance, and never without a reason."""

import json
from dataclasses import replace

import pytest

from ridlink.analysis.campaign import FEW, Verdict, is_the_papers, judge_cells
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign_runner.choice import Choice, Conditions
from tests.analysis.cells import flown


def test_each_printed_figure_gets_a_verdict_and_each_difference_a_reason():
    cells = judge_cells(
        [flown("snmac", 7.0, macs=30), flown("remote-id", 15.0), flown("candidate1", 8.0), flown("candidate2", 8.4)],
        as_printed=True,
    )
    snmac, remote_id, candidate1, candidate2 = cells
    assert (snmac.median.verdict, snmac.mac_rate.verdict) == (Verdict.REPRODUCED, Verdict.DIFFERS)
    assert (remote_id.median.verdict, remote_id.mac_rate.verdict) == (Verdict.NOT_REPRODUCIBLE, Verdict.REPRODUCED)
    assert candidate1.ratio.verdict is Verdict.REPRODUCED
    assert candidate2.ratio.verdict is Verdict.NOT_REPRODUCIBLE
    for cell in cells:
        for judged in (cell.median, cell.ratio, cell.mac_rate):
            assert bool(judged.why) == (judged.verdict in (Verdict.DIFFERS, Verdict.NOT_REPRODUCIBLE))


def test_a_difference_on_common_runs_has_no_spread_of_its_own():
    """One definition costs every flight two seconds: resampling the same runs under both leaves nothing to doubt."""
    snmac, candidate1 = judge_cells([flown("snmac", 7.0), flown("candidate1", 9.0)], as_printed=False)
    assert snmac.beside_snmac is None
    assert candidate1.beside_snmac.median_s == pytest.approx(2.0)
    assert candidate1.beside_snmac.median_ci95 == pytest.approx((2.0, 2.0))


@pytest.mark.parametrize(
    ("scenario", "solver", "as_printed"),
    [("circle8", "rotation", False), ("circle8", "graded", True), ("head-on", "rotation", True)],
)
def test_what_the_paper_did_not_fly_is_not_compared(scenario, solver, as_printed):
    (cell,) = judge_cells([flown("candidate1", 8.0, scenario=scenario, solver=solver)], as_printed=as_printed)
    assert {cell.median.verdict, cell.ratio.verdict, cell.mac_rate.verdict} == {Verdict.NOT_PRINTED}
    assert cell.beside_snmac is None


def test_of_few_runs_nothing_is_said_to_be_reproduced():
    """The interval of one run holds nearly every rate that could be printed."""
    for cell in judge_cells([flown("snmac", 6.7), flown("candidate1", 99.0)], as_printed=True):
        assert Verdict.TOO_FEW_RUNS not in (cell.median.verdict, cell.ratio.verdict, cell.mac_rate.verdict)
    few = [replace(cell, row={**cell.row, "runs": 5}) for cell in (flown("snmac", 6.7), flown("candidate1", 99.0))]
    for cell in judge_cells(few, as_printed=True):
        printed = [each for each in (cell.median, cell.ratio, cell.mac_rate) if each.printed is not None]
        assert {(each.verdict, each.why) for each in printed} == {(Verdict.TOO_FEW_RUNS, FEW)}


PAPERS = Choice(("circle8",), ("snmac",), (ErrorModel.WHITE_RADIAL,), ("rotation",), conditions=Conditions(paper=True))


@pytest.mark.parametrize(
    "condition",
    [
        {"paper": False}, {"technology": "bt4"}, {"range_m": 200.0}, {"latency_s": (0.0, 0.2)}, {"stock_share": 0.3},
        {"unresponsive_share": 0.3}, {"category": 3}, {"speed_mps": 15.0}, {"common_share": 0.5}, {"bias_m": 2.0},
        {"filtered": True},
    ],
)  # fmt: skip
def test_under_other_conditions_it_is_no_longer_the_papers_simulation(condition):
    def kept(choice):
        return json.loads(json.dumps(choice.configuration(choice.plans(), 10)))

    assert is_the_papers(kept(PAPERS))
    assert is_the_papers(kept(replace(PAPERS, conditions=replace(PAPERS.conditions, seed=7, eta=0.9))))
    assert not is_the_papers(kept(replace(PAPERS, conditions=replace(PAPERS.conditions, **condition))))
    assert not is_the_papers(kept(replace(PAPERS, sigmas_m=(5.0,))))
