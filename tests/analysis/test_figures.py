"""The figures: every one is drawn, labelled with units, and the same twice."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="figures need the extra 'plot'")

from ridlink.analysis.figures import FIGURES, draw_figures


def test_every_figure_is_a_png_and_an_svg_and_the_same_twice(tmp_path: Path) -> None:
    files = draw_figures(tmp_path / "new" / "folder")
    assert [file.name for file in files] == [f"{name}.{suffix}" for name in FIGURES for suffix in ("png", "svg")]
    for file in files:
        if file.suffix == ".png":
            assert file.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") and file.stat().st_size > 10_000
        else:
            assert ElementTree.parse(file).getroot().tag.endswith("svg")
    again = draw_figures(tmp_path / "again")
    assert [file.read_bytes() for file in files] == [file.read_bytes() for file in again]


@pytest.mark.parametrize("name", FIGURES)
def test_axes_have_units_and_labels_do_not_overlap(name: str) -> None:
    figure = FIGURES[name]()
    figure.draw_without_rendering()
    for axes in figure.axes:
        unit = ("[m]", "[s]", "[1/m]", "eta$")
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert label.endswith(unit) or not label
        words = [text for text in axes.texts if text.get_text()]
        boxes = [text.get_window_extent() for text in words]
        legend = axes.get_legend()
        if legend is not None:
            boxes.append(legend.get_window_extent())
        for k, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[k + 1 :]), f"{name}: words lie on each other"
    assert any(axes.get_xlabel() for axes in figure.axes)
