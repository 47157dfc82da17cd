"""Detection range: how far away a neighbour must be heard, and how far away neighbours are heard.

An encounter can keep its disc only if it begins early enough. With closing speed v_c that takes D = v_c t_R, where t_R
is the time in which own-ship moves aside by y: it reacts after t_d, moves off sideways with acceleration a, and no
faster than its speed V:

    t_R = t_d + sqrt(2 y / a)                      for y <= V^2 / (2 a)
    t_R = t_d + V / a + (y - V^2 / (2 a)) / V      otherwise

y is the disc with the buffer of the solver, or half of it if both avoid. At equal speeds, a neighbour that avoids
nobody must be heard from at least twice the disc, however slowly both fly. Metres, m/s, seconds.

How far away the air lets neighbours be heard is judged only by those that come within the range from which a stranger
must be heard, whatever they say of themselves. A report may name any place: three from the other side of the earth
would make every air look wide enough. A forger of neighbours nearer than that can still hide a short range, and has
them avoided.
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
"""More reaction time towards a sender at 1 Hz: a change of its course may stay unsaid for this long."""

LISTENED_S = 10.0
"""A neighbour heard within this time of flight was there before; where it is first heard says nothing of the air."""

EVIDENCE = 3
"""Fewer neighbours than this show no range."""

KEPT = 32
SHARE_WITHIN = 0.75
"""A vehicle that takes off beside us, or comes from behind a house, is first heard near. So the range of the air is
what the farther quarter shows."""

MOST_IDENTITIES = 10_000
ENOUGH_AGAIN = 1.1
"""The range counts as enough again only with this factor to spare."""
QUIET_S = 60.0
"""Time between two warnings."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """Answer of a vehicle to a velocity setpoint: delay until it moves, and acceleration from then on."""

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
        aside_m: Distance to move aside, shape (...).
        speed_mps: Largest sideways speed.
        reaction: Delay and acceleration.
        late_s: Additional delay for a neighbour that is heard seldom, shape (...).
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
        reciprocal: True for neighbours that take their half of the avoidance, shape (n,).
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
    """Needed and given detection range.

    Attributes:
        needed_m: Range needed for the most demanding neighbour heard now; if there is none, for one that says nothing
            of itself.
        given_m: Range that the air gives; None without evidence: no neighbour came near.
        short: True if a neighbour heard now needs more than the air gives.
    """

    needed_m: float
    given_m: float | None
    short: bool = False


class DetectionWatch:
    """Learns how far away neighbours that come near are first heard in flight, and warns if that is not enough."""

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
            tracks: All tracks.
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
        """Take tracks within the range from which a stranger must be heard: where each was first heard is now
        evidence."""
        for track in tracks:
            if (first_m := self._not_near_yet_m.pop(track.key, None)) is not None:
                self._first_heard_m.append(first_m)

    @property
    def given_m(self) -> float | None:
        """How far away neighbours that come near are heard [m]; None without evidence."""
        if len(self._first_heard_m) < EVIDENCE:
            return None
        # As `np.quantile`, which imports masked arrays when it is first called: 20 ms in the middle of a flight.
        shares = np.linspace(0.0, 1.0, len(self._first_heard_m))
        return float(np.interp(SHARE_WITHIN, shares, sorted(self._first_heard_m)))

    def judge(self, needed_m: float, anybody: bool) -> DetectionRange:
        """Needed and given range; without neighbours, the last judgement stands.

        Args:
            needed_m: Range needed now.
            anybody: True if the range is needed for a neighbour that is there.
        """
        given = self.given_m
        if given is not None and anybody:
            self._short = given < needed_m * (ENOUGH_AGAIN if self._short else 1.0)
        return DetectionRange(needed_m, given, self._short)

    def warning(self, judged: DetectionRange, now_s: float) -> str:
        """Warning to send now, at most 50 characters as STATUSTEXT has them; empty for none."""
        if not judged.short or judged.given_m is None or now_s - self._warned_at_s < QUIET_S:
            return ""
        self._warned_at_s = now_s
        return f"Remote ID heard from {judged.given_m:.0f} m, {judged.needed_m:.0f} m needed"
