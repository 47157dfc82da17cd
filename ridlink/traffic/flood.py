"""Floods of new identities: a bounded rate per source, so that they cost known traffic nothing."""

from __future__ import annotations

from collections.abc import Hashable

MOST_SOURCES = 256
FULL_AGAIN_S = 1.0
"""A bucket that was asked for nothing for this long is full, as that of a new source."""

_CROWD = object()


class NewcomerGate:
    """Token bucket for each source, and one for all sources beyond `MOST_SOURCES`, which are a flood themselves.

    Args:
        per_second: New tracks per second of one source; the same number may come at once.
    """

    def __init__(self, per_second: float) -> None:
        self._per_second = per_second
        self._left: dict[Hashable, tuple[float, float]] = {}  # who asked longest ago comes first

    def admit(self, source: Hashable, now_s: float) -> bool:
        """Whether this source may begin one more track."""
        if source not in self._left and len(self._left) >= MOST_SOURCES:
            first = next(iter(self._left))
            if now_s - self._left[first][1] < FULL_AGAIN_S:
                source = _CROWD
            else:
                del self._left[first]
        left, at_s = self._left.pop(source, (self._per_second, now_s))
        left = min(left + max(now_s - at_s, 0.0) * self._per_second, self._per_second)
        admitted = left >= 1.0
        self._left[source] = (left - 1.0 if admitted else left, now_s)
        return admitted
