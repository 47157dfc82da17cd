"""Queue of STATUSTEXT for all peers until the next tick; the same text at most once a second."""

from __future__ import annotations

import math
from collections import deque

from sitl_sim.autopilot.results import Reply, Severity

REPEAT_S = 1.0
MAX_WAITING = 16
MAX_LENGTH = 50
"""Bytes of text in one message."""


class StatusTexts:
    """STATUSTEXT messages of one vehicle.

    Attributes:
        now_s: Monotonic time; its owner sets it as time passes.
        said: Number of texts, including those held back.
    """

    def __init__(self) -> None:
        self.now_s = -math.inf
        self.said = 0
        self._waiting: deque[tuple[Severity, str]] = deque(maxlen=MAX_WAITING)
        self._said_s: dict[str, float] = {}

    def say(self, severity: Severity, text: str) -> None:
        """Send this with the next tick, unless it was sent within a second."""
        self.said += 1
        if self.now_s - self._said_s.get(text, -math.inf) >= REPEAT_S:
            self._said_s = {old: at for old, at in self._said_s.items() if self.now_s - at < REPEAT_S}
            if len(self._said_s) < MAX_WAITING:
                self._said_s[text] = self.now_s
                self._waiting.append((severity, text))

    def taken(self) -> list[Reply]:
        """Remove and return the queued messages."""
        texts = [(int(severity), text[:MAX_LENGTH]) for severity, text in self._waiting]
        self._waiting.clear()
        return [("STATUSTEXT", {"severity": severity, "text": text}) for severity, text in texts]
