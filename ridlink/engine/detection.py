"""From how far a neighbour must be heard, and from how far the air lets it be heard.

An encounter can keep its disc only if it begins early enough. With closing speed v_c that takes D = v_c t_R, where t_R
is the time in which own-ship moves aside by y: it reacts after t_d, moves off sideways with acceleration a, and no
faster than its speed V:

    t_R = t_d + sqrt(2 y / a)                      for y <= V^2 / (2 a)
    t_R = t_d + V / a + (y - V^2 / (2 a)) / V      otherwise

y is the disc with the buffer of the solver, or half of it where both avoid. At equal speeds somebody who avoids nobody
must be heard from at least twice the disc, however slowly both fly. Metres, m/s, seconds.

From how far the air lets neighbours be heard, only those tell who come within the range from which a stranger must be
heard, whatever they say of themselves: a report may name any place, and three from the other side of the earth would
make every air look wide enough. Who forges neighbours nearer than that can still hide a short range, and has them
avoided.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.own_ship import PX4
from ridlink.traffic.track import SLOW_INTERVAL_S, Track, TrackKey

FloatArray = NDArray[np.float64]

SLOW_SENDER_S = 1.0
"""More reaction towards a sender at 1 Hz: so long may a change of its course stay unsaid."""

LISTENED_S = 10.0
"""Who is heard within so short a time of flight was there before; where it is first heard says nothing of the air."""

EVIDENCE = 3
"""Fewer neighbours than this show no range."""

KEPT = 32
SHARE_WITHIN = 0.75
"""A vehicle that takes off beside us, or comes from behind a house, is first heard near: the range of the air is what
the farther quarter shows."""

MOST_IDENTITIES = 10_000
ENOUGH_AGAIN = 1.1
"""The range counts as enough again only with a little to spare."""
QUIET_S = 60.0
"""Between two warnings."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """How a vehicle answers a velocity setpoint: delay until it moves, and acceleration from then on."""

    delay_s: float
    acceleration_mps2: float


ARDUPILOT_REACTION = Reaction(0.7, 2.5)
PX4_REACTION = Reaction(0.5, 5.0)
"""Measured in the software-in-the-loop builds of both."""


def reaction_of(autopilot: int | None, acceleration_limit_mps2: float) -> Reaction:
    """Reaction of an autopilot (MAV_AUTOPILOT) under a limit on the change of setpoints; the slower one if unknown."""
    measured = PX4_REACTION if autopilot == PX4 else ARDUPILOT_REACTION
    return Reaction(measured.delay_s, min(measured.acceleration_mps2, acceleration_limit_mps2))


def reaction_time(aside_m: ArrayLike, speed_mps: float, reaction: Reaction, late_s: ArrayLike = 0.0) -> FloatArray:
    """Time until own-ship has moved aside [s].

    Args:
        aside_m: How far, shape (...).
        speed_mps: How fast it may fly sideways.
        reaction: Delay and acceleration.
        late_s: More delay, for a neighbour that is heard seldom, shape (...).
    """
    aside, late = np.asarray(aside_m, dtype=np.float64), np.asarray(late_s, dtype=np.float64)
    gaining = speed_mps**2 / (2.0 * reaction.acceleration_mps2)
    speeding_up = np.sqrt(2.0 * np.minimum(aside, gaining) / reaction.acceleration_mps2)
    return np.asarray(reaction.delay_s + late + speeding_up + np.maximum(aside - gaining, 0.0) / speed_mps)


def needed_range(
    disc_m: ArrayLike,
    neighbour_speed_mps: ArrayLike,
    reciprocal: ArrayLike,
    *,
    speed_mps: float,
    reaction: Reaction,
    interval_s: ArrayLike = 0.1,
) -> FloatArray:
    """Distance at which each neighbour must be heard so that its disc can be kept head-on [m].

    Args:
        disc_m: Radii of the discs of the pairs, the solver's buffer included, shape (n,).
        neighbour_speed_mps: Speeds of the neighbours, shape (n,).
        reciprocal: Who takes its half of the avoidance, shape (n,).
        speed_mps: Own speed.
        reaction: Own reaction.
        interval_s: Times between the reports of each, shape (n,).
    """
    aside = np.asarray(disc_m, dtype=np.float64) * np.where(reciprocal, 0.5, 1.0)
    late = np.where(np.asarray(interval_s) > SLOW_INTERVAL_S, SLOW_SENDER_S, 0.0)
    closing = speed_mps + np.asarray(neighbour_speed_mps, dtype=np.float64)
    return np.asarray(closing * reaction_time(aside, speed_mps, reaction, late))


@dataclass(frozen=True, slots=True)
class DetectionRange:
    """What is needed against what there is.

    Attributes:
        needed_m: For the most demanding neighbour heard now; with nobody there, for one that says nothing of itself.
        given_m: What the air gives; None without evidence: nobody came near.
        short: The air gives less than a neighbour heard now needs.
    """

    needed_m: float
    given_m: float | None
    short: bool = False


class DetectionWatch:
    """Learns from how far neighbours are first heard in flight that come near, and warns where that is not enough."""

    def __init__(self) -> None:
        self._flying_since_s: float | None = None
        self._looked_at_s = -math.inf
        self._identities: set[Hashable] = set()
        self._not_near_yet_m: dict[Hashable, float] = {}
        self._first_heard_m: deque[float] = deque(maxlen=KEPT)
        self._short = False
        self._warned_at_s = -math.inf

    def hear(self, tracks: Mapping[TrackKey, Track], flying: bool, now_s: float) -> None:
        """Look at the tracks, at least every few seconds.

        Args:
            tracks: All of them.
            flying: Own-ship is in the air.
            now_s: Monotonic time.
        """
        self._not_near_yet_m = {key: first for key, first in self._not_near_yet_m.items() if key in tracks}
        if not flying:
            self._flying_since_s = None
        elif self._flying_since_s is None:
            self._flying_since_s = now_s
        since = self._flying_since_s
        for track in tracks.values():
            if track.began_at_s < self._looked_at_s or track.key in self._identities:
                continue
            in_flight = since is not None and track.began_at_s >= since + LISTENED_S and not track.report.on_ground
            if in_flight and track.first_heard_m is not None:
                self._not_near_yet_m[track.key] = track.first_heard_m
            if len(self._identities) >= MOST_IDENTITIES:
                self._identities.clear()
            self._identities.add(track.key)
        self._looked_at_s = now_s

    def near(self, tracks: Iterable[Track]) -> None:
        """These are within the range from which a stranger must be heard: from how far they were, is evidence now."""
        for track in tracks:
            if (first_m := self._not_near_yet_m.pop(track.key, None)) is not None:
                self._first_heard_m.append(first_m)

    @property
    def given_m(self) -> float | None:
        """From how far neighbours are heard that come near; None without evidence."""
        if len(self._first_heard_m) < EVIDENCE:
            return None
        # As `np.quantile`, which imports masked arrays when it is first called: 20 ms in the middle of a flight.
        shares = np.linspace(0.0, 1.0, len(self._first_heard_m))
        return float(np.interp(SHARE_WITHIN, shares, sorted(self._first_heard_m)))

    def judge(self, needed_m: float, anybody: bool) -> DetectionRange:
        """What is needed against what there is; with nobody there the last judgement stands.

        Args:
            needed_m: Range needed now.
            anybody: It is needed for somebody who is there.
        """
        given = self.given_m
        if given is not None and anybody:
            self._short = given < needed_m * (ENOUGH_AGAIN if self._short else 1.0)
        return DetectionRange(needed_m, given, self._short)

    def warning(self, judged: DetectionRange, now_s: float) -> str:
        """What to say now, at most 50 characters as STATUSTEXT has them; empty for nothing."""
        if not judged.short or judged.given_m is None or now_s - self._warned_at_s < QUIET_S:
            return ""
        self._warned_at_s = now_s
        return f"Remote ID heard from {judged.given_m:.0f} m, {judged.needed_m:.0f} m needed"
