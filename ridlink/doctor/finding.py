"""The result of one check."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """What the result of a check means for a flight."""

    OK = "ok"
    NOTE = "note"
    """Something is missing that not every user needs."""
    WARNING = "warning"
    """It works, but less well than it should."""
    FAILURE = "failure"
    """It will not work."""


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check.

    Args:
        name: What was checked, in a few words.
        verdict: What it means for a flight.
        text: What was found.
        remedy: What to do about it; empty if nothing.
    """

    name: str
    verdict: Verdict
    text: str
    remedy: str = ""

    def as_dict(self) -> dict[str, str]:
        """The fields, for JSON."""
        return {"name": self.name, "verdict": str(self.verdict), "text": self.text, "remedy": self.remedy}
