"""The front of time against safety, and which figures a campaign gets."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("matplotlib", reason="figures need the extra 'plot'")

from ridlink.analysis.campaign import DEFINITION_NAMES
from ridlink.analysis.campaign_front import front_figure, front_of, sensitivity_figures
from ridlink.analysis.panels import WORLD, grouped, name_of
from tests.analysis.cells import flown

FIGURES = st.integers(0, 9).map(float)


@given(st.lists(st.tuples(FIGURES, FIGURES), min_size=1, max_size=30))
def test_the_front_is_what_nothing_dominates(points):
    front = front_of(points)

    def beats(one, other):
        return one != other and one[0] <= other[0] and one[1] <= other[1]

    assert not any(beats(one, other) for one in points for other in front)
    assert all(any(best == point or beats(best, point) for best in front) for point in points)
    assert front == sorted(front)


def test_a_figure_is_named_by_what_the_figures_of_its_kind_differ_in():
    rows = [flown("chance", 8.0, loss=loss, sigma_m=sigma).row for loss in (0.0, 0.3) for sigma in (3.5, 10.0)]
    groups = grouped(rows, ("sigma_m", "loss"))
    assert [name_of("x", rows, group, groups, ("solver", "sigma_m", "loss")) for group in groups] == [
        "x-sigma3.5-loss0", "x-sigma10-loss0", "x-sigma3.5-loss0.3", "x-sigma10-loss0.3",
    ]  # fmt: skip
    assert name_of("x", rows[:1], [0], [[0]], ("solver", "sigma_m")) == "x"


def test_only_what_varies_has_a_figure_of_sensitivity():
    rows = [flown("chance", 8.0, sigma_m=sigma).row for sigma in (3.5, 10.0)]
    assert list(sensitivity_figures(rows)) == ["sensitivity-to-sigma"]
    assert sensitivity_figures(rows[:1]) == {}
    rows += [flown("chance", 9.0, sigma_m=10.0, interval_s=1.0).row]
    assert set(sensitivity_figures(rows)) == {"sensitivity-to-sigma", "sensitivity-to-interval"}


@pytest.mark.parametrize("gnss", [("white",), ("white", "bias"), ("white", "bias", "gauss-markov")])
def test_titles_and_legends_stay_within_the_picture(gnss):
    cells = [
        flown(definition, 8.0, gnss=kind, solver=solver, sigma_m=sigma, interval_s=1.0, loss=0.3)
        for kind in gnss
        for solver in ("halfplane", "rotation")
        for definition in DEFINITION_NAMES
        for sigma in (3.5, 10.0)
    ]
    rows = [cell.row for cell in cells]
    figures = [front_figure(rows, grouped(rows, WORLD)[0]), next(iter(sensitivity_figures(rows).values()))()]
    for figure in figures:
        figure.draw_without_rendering()
        for part in (*figure.legends, figure._suptitle):
            box = part.get_window_extent()
            assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0.0 and box.y1 <= figure.bbox.y1


def test_bars_of_settings_stand_beside_each_other_and_within_the_panel():
    rows = [flown(name, 8.0, sigma_m=sigma).row for name in ("snmac", "chance") for sigma in (3.5, 10.0)]
    figure = sensitivity_figures(rows)["sensitivity-to-sigma"]()
    below = figure.axes[1]
    bars = [tuple(segment[:, 0]) for bar in below.collections for segment in bar.get_segments()]
    assert len(set(bars)) == 4
    most = max(100.0 * row["mac_rate_pairs_ci95"][1] for row in rows)
    assert below.get_ylim()[1] >= most
