"""Grave texts of the autopilot: ArduPilot tells a crash, for one, in no other way.

Nothing is decided by them. They go into the daemon's own log, where a reader who asks why a vehicle came down looks
first; a recording has all of them.
"""

from __future__ import annotations

import math
from collections import Counter, OrderedDict, deque

from ridlink.mavlink.codec import Message
from ridlink.periodic import Periodic
from ridlink.remote_id.text import display_text

CRITICAL = 2
"""MAV_SEVERITY_CRITICAL; ALERT and EMERGENCY are less."""

AGAIN_S = 60.0
"""A text is new again after this time: it is repeated while its cause lasts, as ArduPilot repeats every 30 s why it
cannot be armed."""

MOST_WAITING, MOST_REMEMBERED = 10, 50
LENGTH = 50
"""Characters of one STATUSTEXT; of a longer text the first part is kept."""


class GraveWords:
    """Takes STATUSTEXT (253), and gives what is new.

    Args:
        counters: ``vehicle_text_left_out`` is counted there: texts that came faster than they can be told.
    """

    def __init__(self, counters: Counter[str]) -> None:
        self._counters = counters
        self._heard_s: OrderedDict[str, float] = OrderedDict()
        self._waiting: deque[str] = deque()
        self._due = Periodic(1.0)

    def receive(self, message: Message, now_s: float) -> None:
        """Take a STATUSTEXT."""
        text = display_text(message.text)
        if message.severity > CRITICAL or message.chunk_seq or not text:
            return
        if now_s - self._heard_s.get(text, -math.inf) < AGAIN_S:
            return
        if len(self._waiting) >= MOST_WAITING:
            self._counters["vehicle_text_left_out"] += 1
            return
        self._heard_s[text] = now_s
        self._heard_s.move_to_end(text)
        if len(self._heard_s) > MOST_REMEMBERED:
            self._heard_s.popitem(last=False)
        self._waiting.append(f"{text} ..." if message.id and len(text) >= LENGTH else text)

    def take(self, now_s: float) -> str:
        """Text that has waited longest, at most one a second; empty for none."""
        return self._waiting.popleft() if self._waiting and self._due.due(now_s) else ""
