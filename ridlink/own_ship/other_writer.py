"""Another writer: somebody else who sends setpoints to our autopilot.

Autopilots obey whoever sent last and tell nobody. What they do tell, in POSITION_TARGET_LOCAL_NED (85), is the velocity
that they fly after; a target that is not what we sent was somebody else's. Axes: north, east, down; m/s.

Of two writers the later one gives way, for the earlier one is in the middle of its flight; if the other one does not
give way, we do after a while, since a vehicle that is pulled two ways is steered by nobody.
"""

from __future__ import annotations

import math
from collections import deque

from ridlink.mavlink.codec import Message
from ridlink.setpoint import Velocity

POSITION_IGNORED, VELOCITY_IGNORED = 0x07, 0x38
"""Bits of the type mask."""

ECHO_S = 1.0
"""A target may be what was sent so long ago: the stream at 5 Hz, and a link with delay."""

UNHEARD_S = 3.0
SAME_MPS = 0.05
"""An ArduPilot that hears nothing more flies so long after what it heard last (GUID_TIMEOUT): the very same velocity,
which is nobody else's for being old."""

TOLERANCE_MPS, TOLERANCE_SHARE = 0.5, 0.25
"""Autopilots clip targets and shape them a little."""

SIGHTINGS, WITHIN_S = 4, 3.0
"""So many foreign targets in so short a time are somebody. Where two streams alternate just so, one of them is seen
almost always and the other one hardly ever; targets of ours in between are therefore no excuse."""

NEWCOMER_S = 3.0
"""Whoever first sees another writer within so short a time of its first setpoint came second."""
PATIENCE_S = 10.0
"""So long the earlier one waits for the later one to give way."""


class OtherWriter:
    """Fed with what we send and with what the autopilot says it flies after."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Velocity]] = deque(maxlen=32)
        self._streaming_since_s: float | None = None
        self._sightings: deque[float] = deque(maxlen=SIGHTINGS)
        self._first_seen_s: float | None = None
        self._contested_since_s: float | None = None
        self._last_foreign: Velocity | None = None

    def sent(self, velocity: Velocity | None, now_s: float) -> None:
        """What was sent in this step, None for nothing."""
        if velocity is None:
            self._streaming_since_s = None
            return
        if self._streaming_since_s is None:
            self._streaming_since_s = now_s
        self._sent.append((now_s, velocity))

    def receive(self, message: Message, now_s: float) -> None:
        """Take a POSITION_TARGET_LOCAL_NED."""
        if not self._is_foreign(message, now_s):
            return
        if not self._sightings or now_s - self._sightings[-1] > WITHIN_S:
            self._first_seen_s = now_s
        self._sightings.append(now_s)
        if not self.contested(now_s):
            self._contested_since_s = None
        elif self._contested_since_s is None:
            self._contested_since_s = now_s

    def forget(self) -> None:
        """Another mode, another autopilot: what was seen counts no more."""
        self._sightings.clear()
        self._first_seen_s = self._contested_since_s = self._last_foreign = None

    def contested(self, now_s: float) -> bool:
        """Somebody else steers, as far as the last targets tell."""
        return len(self._sightings) == SIGHTINGS and now_s - self._sightings[0] <= WITHIN_S

    def must_yield(self, now_s: float) -> bool:
        """Somebody else steers, and was there first or does not give way."""
        if not self.contested(now_s) or self._first_seen_s is None or self._contested_since_s is None:
            return False
        since = self._streaming_since_s
        came_second = since is None or self._first_seen_s - since <= NEWCOMER_S
        return came_second or now_s - self._contested_since_s > PATIENCE_S

    def _is_foreign(self, message: Message, now_s: float) -> bool:
        streaming = self._streaming_since_s is not None
        if message.type_mask & VELOCITY_IGNORED or message.type_mask & POSITION_IGNORED != POSITION_IGNORED:
            return streaming and now_s - (self._streaming_since_s or 0.0) > ECHO_S
        target = (message.vx, message.vy, message.vz)
        if not all(math.isfinite(value) for value in target):
            return False
        if any(math.dist(target, ours) <= SAME_MPS for at_s, ours in self._sent if now_s - at_s <= UNHEARD_S):
            return False
        lately = [velocity for at_s, velocity in self._sent if now_s - at_s <= ECHO_S]
        if lately:
            # Between two of ours lies what an autopilot makes of them.
            return any(
                not min(ours) - _tolerance(min(ours)) <= value <= max(ours) + _tolerance(max(ours))
                for value, ours in zip(target[:2], zip(*(each[:2] for each in lately), strict=True), strict=True)
            )
        # Nothing of ours: a target that stands is what a writer left behind that is gone, one that moves has a writer.
        moves = self._last_foreign is not None and math.dist(target, self._last_foreign) > 1e-3
        self._last_foreign = target
        return moves and math.hypot(*target) > TOLERANCE_MPS


def _tolerance(value_mps: float) -> float:
    return TOLERANCE_MPS + TOLERANCE_SHARE * abs(value_mps)
