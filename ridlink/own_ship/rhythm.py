"""How often messages of one kind come."""

from __future__ import annotations

from collections import deque

LAST = 5
"""Messages that make a rhythm."""


class Rhythm:
    """The times of the last few messages of one kind."""

    def __init__(self) -> None:
        self._heard_s: deque[float] = deque(maxlen=LAST)

    def hear(self, now_s: float) -> None:
        """Take the time of a message."""
        self._heard_s.append(now_s)

    def is_slower_than(self, interval_s: float) -> bool:
        """Whether the last messages were further apart than this in the mean; False before LAST have come."""
        heard = self._heard_s
        return len(heard) == LAST and heard[-1] - heard[0] > interval_s * (LAST - 1)
