"""Cells against each other: which are comparable at all, and what is said about them."""

import pytest

from ridlink.analysis.campaign_markdown import markdown_report
from ridlink.analysis.campaign_pairs_page import dominance_table
from ridlink.analysis.pairs import against_lossless, against_points, dominance, pooled
from tests.analysis.cells import flown


def test_every_cell_meets_the_papers_points_of_its_own_world():
    cells = [
        flown("candidate1", 8.2), flown("candidate2", 8.0, macs=4),
        flown("candidate2", 7.9, solver="g2"), flown("candidate2", 7.0, solver="g2", gnss="bias"),
    ]  # fmt: skip
    pairs = against_points(cells)
    assert [(pair.cell.solver, pair.against.definition) for pair in pairs] == [
        ("rotation", "candidate2"), ("rotation", "candidate1"), ("g2", "candidate1"), ("g2", "candidate2"),
    ]  # fmt: skip
    assert all(pair.cell.gnss == pair.against.gnss for pair in pairs)
    assert [pair.difference.median_s for pair in pairs] == pytest.approx([0.2, -0.2, -0.3, -0.1])
    assert [pair.time_verdict for pair in pairs] == ["slower", "faster", "faster", "faster"]
    assert [(pair.macs, pair.macs_against) for pair in pairs] == [(0, 4), (4, 0), (0, 0), (0, 4)]


def test_a_setting_dominates_where_it_is_no_worse_in_any_cell():
    def cells(ours_s, ours_macs):
        return [
            flown("candidate2", 8.0, macs=2, scenario="circle8"),
            flown("candidate2", 8.0, macs=2, scenario="square24"),
            flown("candidate2", 7.9, macs=0, scenario="circle8", solver="g2"),
            flown("candidate2", ours_s, macs=ours_macs, scenario="square24", solver="g2"),
        ]  # fmt: skip

    for ours_s, macs, expected in ((8.0, 2, (2, 2, True)), (8.1, 0, (1, 2, False)), (7.0, 3, (2, 1, False))):
        (found,) = dominance(against_points(cells(ours_s, macs)))
        assert (found.setting, found.against, found.cells) == (("candidate2", "g2"), ("candidate2", "rotation"), 2)
        assert (found.no_slower, found.no_more_macs, found.dominates) == expected
        assert found.slower == (ours_s > 8.0)


def test_a_world_in_which_nothing_was_chosen_is_not_said_to_be_the_papers():
    own = [flown("candidate2", 8.0, scenario="mine"), flown("candidate2", 7.9, scenario="mine", solver="g3")]
    page = dominance_table(dominance(against_points(own)))
    assert "<td>usual</td>" in page and "paper" not in page


def test_losses_are_compared_with_the_same_cell_without():
    cells = [flown("chance", 8.0, loss=0.0), flown("chance", 8.4, macs=60, loss=0.3), flown("snmac", 7.0, loss=0.3)]
    (pair,) = against_lossless(cells)
    assert (pair.cell.loss, pair.against.loss) == (0.3, 0.0)
    assert pair.difference.median_ratio == pytest.approx(1.05)
    assert (pair.difference.more_runs, pair.mac_verdict) == (8, "more")
    assert not pair.has_no_more_macs


def test_flights_of_all_scenes_are_counted_and_not_claimed():
    cells = [flown("chance", 8.0, scenario="circle8"), flown("chance", 20.0, scenario="square24")]
    (nobody,) = pooled(cells)
    assert (nobody.flights, nobody.macs) == (160, 0)
    assert nobody.said == "0 of 160, so below 4.5e-02 at 95 %"
    (some,) = pooled([cells[0], flown("chance", 20.0, macs=2, scenario="square24")])
    assert some.said == "2 of 160, so 3.2e-04 to 6.8e-02 at 95 %"
    assert pooled(cells[:1]) == []


def test_the_tables_for_documents_have_a_line_a_setting_and_a_column_a_world():
    cells = [
        flown("candidate1", 8.2), flown("candidate2", 8.0, macs=4), flown("candidate2", 7.9, solver="g2"),
        flown("candidate2", 7.0, solver="g2", gnss="bias"), flown("candidate2", 7.5, solver="g2", loss=0.3),
    ]  # fmt: skip
    text = markdown_report(cells, against_points(cells), pooled(cells))
    lines = text.splitlines()
    assert lines[2] == "| setting | circle8 white-radial | circle8 bias | circle8 white-radial 30% lost |"
    assert lines[4:7] == [
        "| Candidate 1, rotation | 8.2 / 0 |  |  |",
        "| Candidate 2, rotation | 8.0 / 4 |  |  |",
        "| Candidate 2, g2 | 7.9 / 0 | 7.0 / 0 | 7.5 / 0 |",
    ]
    # The Candidates themselves are compared with nobody; what was flown in one scene only is not taken together.
    against = [line for line in lines if line.count("|") == 8][2:]
    assert [line.split(" | ")[1:3] for line in against] == [
        ["Candidate 2, g2", "Candidate 1, rotation"], ["Candidate 2, g2", "Candidate 2, rotation"],
    ]  # fmt: skip
    assert " -0.3 (-0.3 to -0.3) | -0.30 (-0.30 to -0.30) | 0 : 0 | 0 : 0 |" in against[0]
    assert "together" not in text
