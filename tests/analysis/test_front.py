"""The front of time against safety, and which figures a campaign gets."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("matplotlib", reason="figures need the extra 'plot'")

from ridlink.analysis.campaign_front import front_of, sensitivity_figures
from ridlink.analysis.panels import grouped, name_of
from tests.analysis.test_campaign import flown

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
