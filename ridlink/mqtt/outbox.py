"""What waits for the broker: the latest of every topic, a bounded number of them, the oldest given up first.

A broker that is slow or away must cost neither memory nor time: an old position is worth nothing once there is a newer
one, so a message that still waits is replaced by the next of its topic, in its place at the end of the queue.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple

CAPACITY = 1000


class Outgoing(NamedTuple):
    """One message for the broker."""

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    about: str = ""
    """What of the topic it is about: only a newer message about the same replaces it."""

    @property
    def key(self) -> tuple[str, str]:
        """What a newer message must share to replace this one."""
        return self.topic, self.about


class Outbox:
    """A bounded queue of the latest values.

    Attributes:
        replaced: Messages that a newer one of their topic overtook while they waited.
        dropped: Messages given up because there were too many topics.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        if capacity < 1:
            raise ValueError(f"capacity must be at least 1, not {capacity}")
        self.replaced = self.dropped = 0
        self._capacity = capacity
        self._waiting: OrderedDict[tuple[str, str], Outgoing] = OrderedDict()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, message: Outgoing) -> None:
        """Queue a message; it takes the place of an older one of its topic."""
        if self._waiting.pop(message.key, None) is not None:
            self.replaced += 1
        self._waiting[message.key] = message
        if len(self._waiting) > self._capacity:
            self._waiting.popitem(last=False)
            self.dropped += 1

    def put_back(self, message: Outgoing) -> None:
        """Queue what could not be sent before everything else, unless something newer of its topic waits."""
        if message.key in self._waiting or len(self._waiting) >= self._capacity:
            self.replaced += 1
            return
        self._waiting[message.key] = message
        self._waiting.move_to_end(message.key, last=False)

    def take(self) -> Outgoing | None:
        """The message that waits longest, None if there is none."""
        return self._waiting.popitem(last=False)[1] if self._waiting else None
