"""From the traffic of a step to conflicts and, if one may be flown, a velocity. A failure here becomes a stop.

Axes: north, east, down about the present own position; metres, m/s, seconds of the caller's monotonic clock.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace

import numpy as np

from ridlink.avoidance.types import Status
from ridlink.engine.climbing import Climber
from ridlink.engine.config import EngineConfig, Goal
from ridlink.engine.deciding import Decider
from ridlink.engine.decision import DecisionRecord
from ridlink.engine.detection import DetectionRange, DetectionWatch, reaction_of
from ridlink.engine.identity import Identity
from ridlink.engine.recovery import Recovery
from ridlink.failsafe import Stream
from ridlink.own_ship import OwnShipTelemetry
from ridlink.periodic import Periodic
from ridlink.setpoint import STOP, Velocity
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.picture import TrafficPicture
from ridlink.traffic.snapshot import Snapshot

FATAL_FAILURES = 3
FATAL_WITHIN_S = 1.0
"""FATAL_FAILURES failed decisions within this time are no accident."""


class Steering:
    """Looks at the traffic and decides, step by step.

    Args:
        config: As the engine has it.
        picture: Traffic.
        telemetry: Own state and autopilot.

    Attributes:
        decider: Chooses the horizontal velocity.
        fatal: Whether decisions failed again and again.
        last_error: Error of the last one that failed.
        counters: `decision_failed`.
    """

    def __init__(self, config: EngineConfig, picture: TrafficPicture, telemetry: OwnShipTelemetry) -> None:
        self.decider = Decider(config)
        self.fatal = False
        self.last_error = ""
        self.counters: Counter[str] = Counter()
        self._config, self._picture, self._telemetry = config, picture, telemetry
        self._climber = Climber(config) if config.vertical_avoidance else None
        self._recovery = Recovery()
        self._failures: deque[float] = deque(maxlen=FATAL_FAILURES)
        self._detection_due = Periodic(1.0)
        self._detection_watch = DetectionWatch()
        self._detection: DetectionRange | None = None

    def begin_leg(self) -> None:
        """Begin a new leg: a new goal, or a new engagement."""
        self.decider.begin_leg()
        if self._climber is not None:
            self._climber.begin_leg()

    def look_and_decide(
        self,
        record: DecisionRecord,
        own: OwnState,
        *,
        stream: Stream,
        goal: Goal | None,
        last: Velocity,
        identity: Identity,
        since_last_s: float,
        utc_s: float | None,
        resumed_mps: float | None = None,
    ) -> DecisionRecord:
        """The record with the present traffic and, if one may be flown, the velocity.

        Args:
            record: What is known of this step, with its time.
            own: Own state.
            stream: What may be sent.
            goal: Goal; None if there is none.
            last: Velocity sent last.
            identity: Own system id and identity in Remote ID.
            since_last_s: Time since the last step.
            utc_s: UTC now, the clock of turns in a jam.
            resumed_mps: Speed at which the plan of the autopilot may go on to the goal, if it may.
        """
        now_s = record.time_s
        commanded = None if stream is Stream.NOTHING else STOP
        try:
            everybody = self._picture.snapshot(own, now_s)
            snapshot = everybody.at_our_height()
            traffic, seen = self.decider.traffic(own, snapshot)
            detection = self._detection_range(own, snapshot, now_s)
            record = replace(self.decider.seen(record, snapshot, seen), detection=detection)
            if record.conflicts:
                self._recovery.conflict(now_s)
            record = replace(record, recovering=self._recovery.recovering(now_s))
            if stream is not Stream.DECISION or goal is None:
                return replace(record, commanded_ned_mps=commanded)
            record = self.decider.decide(record, goal, own, last, snapshot, traffic, identity, utc_s)
            record = self._slowed(record, last, since_last_s)
            if resumed_mps is not None:
                resumed_entry_s = self.decider.resumed_entry_s(goal, resumed_mps, own, snapshot)
                record = replace(record, resumed_entry_s=resumed_entry_s)
            if self._climber is None:
                return record
            return self._climber.climb(record, own, everybody, self.decider, last_down_mps=last[2], identity=identity)
        except Exception as error:  # a fault here must become a hold, never a missing setpoint
            self._failed(error, now_s)
            return replace(record, commanded_ned_mps=commanded)

    def detection_warning(self, record: DecisionRecord) -> str:
        """Warning about the range from which neighbours are heard; empty if there is none."""
        if record.detection is None or self._telemetry.lock is None:
            return ""
        return self._detection_watch.warning(record.detection, record.time_s)

    def _failed(self, error: Exception, now_s: float) -> None:
        self.counters["decision_failed"] += 1
        self.last_error = f"{type(error).__name__}: {error}"
        self._failures.append(now_s)
        if len(self._failures) == FATAL_FAILURES and now_s - self._failures[0] <= FATAL_WITHIN_S:
            self.fatal = True

    def _slowed(self, record: DecisionRecord, last: Velocity, since_last_s: float) -> DecisionRecord:
        """The decision, slowed down if it only leads back from a conflict that is gone."""
        if record.commanded_ned_mps is None:
            return record
        if record.conflicts or record.status is not Status.FREE:
            # A vehicle that avoids in time is never in conflict: a bent way counts as well.
            self._recovery.conflict(record.time_s)
            return replace(record, recovering=True)
        if not record.recovering:
            return record
        slowed = self._recovery.slowed(
            record.commanded_ned_mps,
            last,
            step_s=since_last_s,
            acceleration_mps2=self._config.limits.acceleration_mps2,
        )
        return replace(record, commanded_ned_mps=slowed)

    def _detection_range(self, own: OwnState, snapshot: Snapshot, now_s: float) -> DetectionRange | None:
        """Ranges from which neighbours must be heard and are heard, updated once a second."""
        if self._detection_due.due(now_s):
            telemetry, lock = self._telemetry, self._telemetry.lock
            self._detection_watch.hear(self._picture.tracks, telemetry.armed and telemetry.ready, now_s)
            reaction = reaction_of(lock.autopilot if lock else None, self._config.limits.acceleration_mps2)
            stranger_m = self.decider.discs.stranger_range_m(own, reaction)
            near = np.hypot(*snapshot.position_ned_m[:, :2].T) <= stranger_m
            self._detection_watch.near(snapshot.tracks[k] for k in np.flatnonzero(near))
            needed_m = self.decider.discs.needed_range_m(own, snapshot, reaction) if len(snapshot) else stranger_m
            self._detection = self._detection_watch.judge(needed_m, len(snapshot) > 0)
        return self._detection
