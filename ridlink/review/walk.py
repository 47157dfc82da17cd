"""Converts recorded frames to scenes: the sky as it was known at every tenth of a second of the recording's time.

No clock is read. If time goes back, as in logs joined one after another, a new recording begins. While no aircraft is
heard, no scenes are made. An aircraft is left out once it has missed three reports: its position is unknown. Scenes are
held back for half a second, so an aircraft that is not heard again is left out from its first missed report on. An
aircraft without a reported error is left out for its first second.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from ridlink.mavlink.codec import decode_message
from ridlink.mavlink.frames import Frame
from ridlink.observer import Scene, Sky
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.remote_id.bridge import REMOTE_ID_IDS, messages_of
from ridlink.review.own import OwnVehicles
from ridlink.review.source import Timed
from ridlink.separation.reference import REPORT_INTERVAL_S

GRID_US = 100_000
BACK_US = 5_000_000
"""If time goes back by less, frames of one log are only out of order."""

MISSED_REPORTS = 3.0
OVERDUE_INTERVALS = 1.5
HELD_S = 0.5
SETTLED_S = 1.0


class Watcher(Protocol):
    """Receives the scenes."""

    def step(self, scene: Scene) -> None:
        """Take the next scene, a tenth of a second later or more."""

    def end(self) -> None:
        """Finish a recording; another may follow, with other aircraft under the same numbers."""


class Walk:
    """Makes scenes of recordings and hands them to watchers.

    Args:
        watchers: Receivers of the scenes.
        convention: Assumed meaning of the senders' accuracy codes.

    Attributes:
        sky: Aircraft in the air.
        own: Those of them that are best known by telemetry.
        begun_us, ended_us: Time of the first and of the last frame, microseconds since 1970; None before the first.
        scenes: Number of scenes.
        aircraft: Number of aircraft in all recordings.
    """

    def __init__(
        self, watchers: Sequence[Watcher], *, convention: AccuracyConvention | str = DEFAULT_CONVENTION
    ) -> None:
        self._convention = AccuracyConvention(convention)
        self.sky = Sky(convention=self._convention)
        self.own = OwnVehicles(self.sky, convention=self._convention)
        self.begun_us: int | None = None
        self.ended_us: int | None = None
        self.scenes = 0
        self._before = 0
        self._watchers = watchers
        self._now_us = 0
        self._due_us: int | None = None
        self._held: deque[Scene] = deque()

    @property
    def aircraft(self) -> int:
        """Number of aircraft in all recordings."""
        return self._before + self.sky.met

    def through(self, frames: Iterable[Timed]) -> None:
        """Take all frames, and finish."""
        for time_us, frame in frames:
            self.receive(time_us, frame)
        self.end()

    def receive(self, time_us: int, frame: Frame) -> None:
        """Take the next frame, with microseconds since 1970."""
        if time_us < self._now_us - BACK_US:
            self.end()
        self._now_us = max(self._now_us, time_us)
        self.begun_us = self._now_us if self.begun_us is None else min(self.begun_us, self._now_us)
        self.ended_us = self._now_us if self.ended_us is None else max(self.ended_us, self._now_us)
        if self._due_us is None:
            self._due_us = self._now_us
        while self._due_us < self._now_us:
            self._due_us = self._due_us + GRID_US if self._look(self._due_us) else self._now_us
        now_s = self._now_us / 1e6
        if frame.msgid not in REMOTE_ID_IDS:
            self.own.receive(frame, now_s)
            return
        said = messages_of(decode_message(frame), self.sky.rejects)
        if not self.own.supersedes(frame, said, now_s):
            self.sky.hear(frame, said, now_s)

    def end(self) -> None:
        """Finish: the recording is over."""
        if self._due_us is not None:
            self._look(max(self._due_us, self._now_us))
            self._show(before_s=math.inf)
            for watcher in self._watchers:
                watcher.end()
        self._before += self.sky.met
        self.sky = Sky(origin=self.sky.origin, convention=self._convention)
        self.own = OwnVehicles(self.sky, convention=self._convention)
        self._now_us, self._due_us = 0, None

    def _look(self, time_us: int) -> bool:
        """Make a scene; False if no aircraft is left for a scene."""
        now_s = time_us / 1e6
        if not self.sky.aircraft:
            self._show(before_s=math.inf)
            return False
        self.own.step(now_s)
        self.sky.forget_silent(now_s)
        self._held.append(self.sky.at(now_s, missed=MISSED_REPORTS, settled_s=SETTLED_S))
        self.scenes += 1
        self._show(before_s=now_s - HELD_S)
        return True

    def _show(self, before_s: float) -> None:
        """Pass on scenes that were held back long enough, without aircraft that were not heard again."""
        if not self._held or self._held[0].time_s > before_s:
            return
        heard_s = {one.number: one.last_heard_s for one in self.sky.aircraft.values()}
        while self._held and self._held[0].time_s <= before_s:
            scene = self._held.popleft()
            last_s = np.array([heard_s.get(number, -math.inf) for number in scene.numbers])
            overdue = scene.age_s > OVERDUE_INTERVALS * np.maximum(scene.interval_s, REPORT_INTERVAL_S)
            silent = overdue & (last_s <= scene.time_s)
            for watcher in self._watchers:
                watcher.step(scene.only(~silent) if silent.any() else scene)
