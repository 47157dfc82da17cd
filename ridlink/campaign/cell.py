"""Cells of a campaign: the figures in which they differ, and their names in tables and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

BASELINE = "none"
"""Name of the definition under which no vehicle avoids another."""

USUAL = {"dynamics": "ideal", "sigma_m": 10.0, "interval_s": 0.1, "loss": 0.0}
"""Usual values, which names leave out."""

WORDS = {"dynamics": "{}", "sigma_m": "sigma {:g} m", "interval_s": "every {:g} s", "loss": "{:.0%} lost"}
"""Texts for unusual values."""


@dataclass(frozen=True, slots=True)
class Cell:
    """Names and figures in which the cells of one campaign differ.

    Attributes:
        scenario: Name of the scene.
        definition: Separation definition; `none` if no vehicle avoids.
        gnss: Error model: how sigma becomes a position error.
        solver: Name of the solver.
        dynamics: How vehicles respond to commands.
        sigma_m: Standard deviation for vehicles that have none in the scene.
        interval_s: Time between two reports.
        loss: Share of reports that a receiver misses.
    """

    scenario: str
    definition: str
    gnss: str
    solver: str
    dynamics: str
    sigma_m: float
    interval_s: float
    loss: float

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Cell:
        """The cell of a row of the table."""
        return cls(**{name: row[name] for name in cls.__slots__})

    def under(self, definition: str) -> Cell:
        """The same cell under another definition."""
        return replace(self, definition=definition)


def world_words(figures: Mapping[str, Any]) -> str:
    """The unusual values of a world, in words.

    Args:
        figures: Values of a cell or a row by the names in `USUAL`; other names are ignored.
    """
    return ", ".join(words.format(figures[name]) for name, words in WORDS.items() if figures[name] != USUAL[name])
