"""Ranges that numbers of a configuration must lie in, for their check and for their documentation."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ridlink.checked_toml import KeyFault


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers from one to another, both included.

    Args:
        least: The smallest number.
        most: The largest number.
        unit: Unit of all of them, empty for none.
        or_infinite: Whether infinity is allowed as well, where it stands for "no limit".
    """

    least: float
    most: float
    unit: str = ""
    or_infinite: bool = False

    def __str__(self) -> str:
        """As in ``0 to 5 s``."""
        return f"{self.least:.12g} to {self.most:.12g}{self._unit}{' or inf' * self.or_infinite}"

    @property
    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""

    def __contains__(self, value: float) -> bool:
        return self.least <= value <= self.most or (self.or_infinite and value == math.inf)

    def check(self, name: str, value: float) -> None:
        """Refuse a number outside.

        Args:
            name: What it is, for the error text.
            value: The number.

        Raises:
            KeyFault: If it is outside, or no number; the text tells range and value.
        """
        if value not in self:
            within = f"between {self.least:.12g} and {self.most:.12g}{self._unit}{' or be infinite' * self.or_infinite}"
            told = reprlib.repr(value) if isinstance(value, int) else f"{value:.12g}"  # no float holds every int
            raise KeyFault(f"{name} must lie {within}, got {told}", name)


def check_ranges(settings: Any, ranges: Mapping[str, Range]) -> None:
    """Check fields of a dataclass against their ranges.

    Raises:
        KeyFault: For the first that is outside, as `Range.check`.
    """
    for name, allowed in ranges.items():
        allowed.check(name, getattr(settings, name))
