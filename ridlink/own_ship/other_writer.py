"""Another writer: somebody else who sends setpoints to our autopilot.

Autopilots obey the last sender and tell nobody. They do tell, in POSITION_TARGET_LOCAL_NED (85), the velocity that they
fly after; a target that we did not send came from another writer. Axes: north, east, down; m/s.

Of two writers the later one gives way, for the earlier one is in the middle of its flight. If the other writer does not
give way, we do after a while: a vehicle that is pulled two ways is steered by nobody.

An ArduPilot that hears no setpoints, because the way there is lost or it wants signatures, stays in GUIDED: it brakes
and stands, and says so in the same message. Targets that stand from then on, and never alternate with ours, have no
writer.
"""

from __future__ import annotations

import math
from collections import deque

from ridlink.mavlink.codec import Message
from ridlink.own_ship.rhythm import Rhythm
from ridlink.own_ship.rival import PATIENCE_S
from ridlink.setpoint import Velocity

Target = tuple[float, float, float]
"""A position [m] or a velocity [m/s]."""

POSITION_IGNORED, VELOCITY_IGNORED = 0x07, 0x38
"""Bits of the type mask."""

ECHO_S = 1.0
"""A target may be what was sent this long ago: the stream at 5 Hz, and a link with delay."""

UNHEARD_S = 3.0
SAME_MPS = 0.05
"""An ArduPilot that hears nothing more flies on for UNHEARD_S (GUID_TIMEOUT) with the very velocity that it heard last;
an old velocity of ours is not another writer's."""

TOLERANCE_MPS, TOLERANCE_SHARE = 0.5, 0.25
"""Autopilots clip targets and shape them a little."""

SIGHTINGS, WITHIN_S = 4, 3.0
"""SIGHTINGS foreign targets within this time are another writer. Where two streams alternate in step, one is seen
almost always and the other hardly ever, so targets of ours in between are no excuse."""

SELDOM_S = 0.085
"""Targets that are told at the rate of two streams, or less often, may show only one of them while clocks are alike."""

HEARD_S = 2.0
"""A vehicle that stands again this soon after it flew after ours was told to: unheard, it flies on for longer."""

NEWCOMER_S = 3.0
"""A daemon that first sees another writer within this time of its first setpoint came second."""

GIVE_UP_S = 10.0
"""Setpoints may go unheard for this long and still count as steering."""


class OtherWriter:
    """Compares what we send with what the autopilot says it flies after."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Velocity]] = deque(maxlen=32)
        self._streaming_since_s: float | None = None
        self._sightings: deque[float] = deque(maxlen=SIGHTINGS)
        self._first_seen_s: float | None = None
        self._contested_since_s: float | None = None
        self._last_foreign: Velocity | None = None
        self._obeys_since_s: float | None = None
        self._standing: Target | None = None
        self._somebody = False
        self._told = Rhythm()

    def sent(self, velocity: Velocity | None, now_s: float) -> None:
        """Note what was sent in this step, None for nothing."""
        if velocity is None:
            self._streaming_since_s = None
            return
        if self._streaming_since_s is None:
            self._streaming_since_s = now_s
        self._sent.append((now_s, velocity))

    def receive(self, message: Message, now_s: float, *, stands_unheard: bool = False) -> None:
        """Take a POSITION_TARGET_LOCAL_NED.

        Args:
            message: The target.
            now_s: Monotonic time.
            stands_unheard: The autopilot keeps its mode when it hears no setpoints, and stands (ArduPilot).
        """
        self._told.hear(now_s)
        standing = _standing(message) if stands_unheard else None
        if not self._is_foreign(message, now_s):
            if standing is None and self._obeys_since_s is None:
                self._obeys_since_s = now_s
            return
        if not self._sightings or now_s - self._sightings[-1] > WITHIN_S:
            self._first_seen_s, self._standing, self._somebody = now_s, standing, False
        obeyed_s = math.inf if self._obeys_since_s is None else now_s - self._obeys_since_s
        self._somebody |= standing is None or standing != self._standing or obeyed_s < HEARD_S
        self._obeys_since_s = None
        self._sightings.append(now_s)
        if not self._disobeyed(now_s):
            self._contested_since_s = None
        elif self._contested_since_s is None:
            self._contested_since_s = now_s

    def forget(self) -> None:
        """Forget what was seen, after a change of mode or autopilot."""
        self._sightings.clear()
        self._first_seen_s = self._contested_since_s = self._last_foreign = self._obeys_since_s = None

    def contested(self, now_s: float) -> bool:
        """Whether another writer steers, as far as the last targets tell."""
        return self._somebody and self._disobeyed(now_s)

    def unheard(self, now_s: float) -> bool:
        """Whether the vehicle stands and follows none of our setpoints, as if it did not hear us."""
        return not self._somebody and self._disobeyed(now_s)

    @property
    def seldom_told(self) -> bool:
        """Whether targets come too seldom to show every writer in our rhythm."""
        return self._told.is_slower_than(SELDOM_S)

    def must_give_up(self, now_s: float) -> bool:
        """Whether the vehicle has not heard us for so long that this is no steering."""
        since = self._contested_since_s
        return self.unheard(now_s) and since is not None and now_s - since > GIVE_UP_S

    def must_yield(self, now_s: float) -> bool:
        """Whether another writer steers, and was there first or does not give way."""
        if not self.contested(now_s) or self._first_seen_s is None or self._contested_since_s is None:
            return False
        since = self._streaming_since_s
        came_second = since is None or self._first_seen_s - since <= NEWCOMER_S
        return came_second or now_s - self._contested_since_s > PATIENCE_S

    def _disobeyed(self, now_s: float) -> bool:
        return len(self._sightings) == SIGHTINGS and now_s - self._sightings[0] <= WITHIN_S

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
            # An autopilot may make of ours anything between two of them.
            return any(
                not min(ours) - _tolerance(min(ours)) <= value <= max(ours) + _tolerance(max(ours))
                for value, ours in zip(target[:2], zip(*(each[:2] for each in lately), strict=True), strict=True)
            )
        # Nothing of ours: a target that stands was left by a writer that is gone, one that moves has a writer.
        moves = self._last_foreign is not None and math.dist(target, self._last_foreign) > 1e-3
        self._last_foreign = target
        return moves and math.hypot(*target) > TOLERANCE_MPS


def _standing(message: Message) -> Target | None:
    """Position or velocity of a target that lets the vehicle stand; None if it lets it fly."""
    if message.type_mask & POSITION_IGNORED != POSITION_IGNORED:
        return message.x, message.y, message.z
    velocity = message.vx, message.vy, message.vz
    return velocity if math.hypot(*velocity) <= SAME_MPS else None


def _tolerance(value_mps: float) -> float:
    return TOLERANCE_MPS + TOLERANCE_SHARE * abs(value_mps)
