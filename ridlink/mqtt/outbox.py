"""Queue of messages for the broker: the latest of every topic, a bounded number of them, the oldest dropped first.

A broker that is slow or away must cost neither memory nor time. An old position is worthless once there is a newer one,
so a new message replaces the waiting one of its topic and keeps its place in the queue. No topic can starve another,
however often it is renewed and however many there are of one kind.
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
    """Subject within the topic: only a newer message of the same topic and subject replaces this one."""

    @property
    def key(self) -> tuple[str, str]:
        """Topic and subject: a newer message with the same key replaces this one."""
        return self.topic, self.about


Lane = OrderedDict[tuple[str, str], Outgoing]


class Outbox:
    """A bounded queue of the latest values, in three lanes that take turns: QoS 0, QoS 1, and retained messages.

    Retained messages have their own lane: if one is dropped, the broker keeps the older value for good, for example
    that an aircraft is present when it has gone.

    Args:
        capacity: Most waiting messages, over all lanes.

    Attributes:
        replaced: Messages replaced by a newer one of their topic while they waited.
        dropped: Messages dropped because there were too many topics, from the longest lane first.

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
        """Queue a message; it replaces an older one of its topic and keeps that one's place in the queue."""
        lane = self._lane(message)
        if message.key in lane:
            self.replaced += 1
        lane[message.key] = message
        self._make_room()

    def put_back(self, message: Outgoing) -> None:
        """Queue a message that could not be sent at the front, unless a newer one of its topic waits."""
        lane = self._lane(message)
        if message.key in lane:
            self.replaced += 1
            return
        lane[message.key] = message
        lane.move_to_end(message.key, last=False)
        self._make_room()

    def _make_room(self) -> None:
        if len(self) > self._capacity:
            max(self._lanes, key=len).popitem(last=False)
            self.dropped += 1

    def take(self) -> Outgoing | None:
        """The next message: the oldest of one lane, then of the next lane in turn; None if there is none."""
        for _ in self._lanes:
            lane = self._lanes[self._next]
            self._next = (self._next + 1) % len(self._lanes)
            if lane:
                return lane.popitem(last=False)[1]
        return None
