"""Cells of a campaign: in what they differ, and how that is said in tables and file names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

BASELINE = "none"
"""Name of the definition under which nobody avoids anybody."""

USUAL = {"dynamics": "ideal", "sigma_m": 10.0, "interval_s": 0.1, "loss": 0.0}
"""What goes without saying."""

WORDS = {"dynamics": "{}", "sigma_m": "sigma {:g} m", "interval_s": "every {:g} s", "loss": "{:.0%} lost"}
"""How the rest of it is said."""


@dataclass(frozen=True, slots=True)
class Cell:
    """Names and figures in which the cells of one campaign differ.

    Attributes:
        scenario: Name of the scene.
        definition: What sizes the discs; `none` where nobody avoids.
        gnss: How sigma becomes a position error.
        solver: Who decides.
        dynamics: How vehicles answer.
        sigma_m: Standard deviation of vehicles of which the scene says nothing.
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
    """What is unusual about a world, in words.

    Args:
        figures: Those of a cell, or a row, by the names in `USUAL`; others do not matter.
    """
    return ", ".join(words.format(figures[name]) for name, words in WORDS.items() if figures[name] != USUAL[name])
