"""What waits for the broker: the latest of every topic, a bounded number of them, the oldest given up first.

A broker that is slow or away must cost neither memory nor time: an old position is worth nothing once there is a newer
one, so a message that still waits is replaced by the next of its topic, which takes its turn. However fast some topics
are renewed, and however many of one kind there are, none goes unheard for another's sake.
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


Lane = OrderedDict[tuple[str, str], Outgoing]


class Outbox:
    """A bounded queue of the latest values, in three lanes that take turns: QoS 0, QoS 1, and what the broker retains.

    The last has a lane of its own, since a value that is given up leaves an older one there for good: of an aircraft
    that is gone, that it is there.

    Args:
        capacity: Messages that wait at most, over all lanes.

    Attributes:
        replaced: Messages that a newer one of their topic overtook while they waited.
        dropped: Messages given up because there were too many topics, those of the longest lane first.

    Raises:
        ValueError: If the capacity is below 1.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        if capacity < 1:
            raise ValueError(f"capacity must be at least 1, not {capacity}")
        self.replaced = self.dropped = 0
        self._capacity = capacity
        self._lanes: tuple[Lane, ...] = (OrderedDict(), OrderedDict(), OrderedDict())
        self._next = 0

    def __len__(self) -> int:
        return sum(map(len, self._lanes))

    def _lane(self, message: Outgoing) -> Lane:
        return self._lanes[2 if message.retain else message.qos > 0]

    def put(self, message: Outgoing) -> None:
        """Queue a message; it takes the place of an older one of its topic, and its turn."""
        lane = self._lane(message)
        if message.key in lane:
            self.replaced += 1
        lane[message.key] = message
        if len(self) > self._capacity:
            max(self._lanes, key=len).popitem(last=False)
            self.dropped += 1

    def put_back(self, message: Outgoing) -> None:
        """Queue what could not be sent before everything else, unless something newer of its topic waits."""
        lane = self._lane(message)
        if message.key in lane:
            self.replaced += 1
            return
        if len(self) >= self._capacity:
            self.dropped += 1
            return
        lane[message.key] = message
        lane.move_to_end(message.key, last=False)

    def take(self) -> Outgoing | None:
        """The message of one lane that waits longest, then those of the others; None if there is none."""
        for _ in self._lanes:
            lane = self._lanes[self._next]
            self._next = (self._next + 1) % len(self._lanes)
            if lane:
                return lane.popitem(last=False)[1]
        return None
