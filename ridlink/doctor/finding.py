"""One thing that was looked at."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """What it means for a flight."""

    OK = "ok"
    NOTE = "note"
    """Something is absent that not everybody needs."""
    WARNING = "warning"
    """It works, and less well than it should."""
    FAILURE = "failure"
    """It will not work."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Args:
        name: What, in few words.
        verdict: What it means for a flight.
        text: What was found.
        remedy: What to do about it; empty where nothing needs to be done.
    """

    name: str
    verdict: Verdict
    text: str
    remedy: str = ""

    def as_dict(self) -> dict[str, str]:
        """For JSON."""
        return {"name": self.name, "verdict": str(self.verdict), "text": self.text, "remedy": self.remedy}
