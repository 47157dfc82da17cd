"""Events that a daemon reports to an observer, and their facts. A failing observer must not end a flight."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from ridlink.engine import DecisionRecord, Engine
from ridlink.setpoint import Velocity

EventSink = Callable[[dict[str, Any]], None]


class Events:
    """Passes events to a sink until the sink fails.

    Args:
        sink: Called with a dictionary for every event; None for no sink.
        counters: Counts the failure of the sink.
    """

    def __init__(self, sink: EventSink | None, counters: Counter[str]) -> None:
        self.sink, self._counters = sink, counters

    def emit(self, event: str, **facts: Any) -> None:
        """Report an event, with its time in seconds since 1970."""
        if self.sink is None:
            return
        try:
            self.sink({"event": event, "t": round(time.time(), 3), **facts})
        except Exception:
            self._counters["event_sink_failed"] += 1
            self.sink = None


def summary_facts(engine: Engine, record: DecisionRecord, rejects: dict[str, int]) -> dict[str, Any]:
    """The facts of a ``summary``; unknown ones are None, numbers have two decimals.

    Args:
        engine: The engine that decided.
        record: The decision.
        rejects: What was dropped, clamped, rejected or noticed so far, by cause.
    """
    command, detection, vehicle = record.commanded_ned_mps, record.detection, engine.telemetry
    return {
        "state": engine.rung.state.name.lower(),
        "reason": engine.rung.reason,
        "autopilot_heard_s": _finite(vehicle.heard_s(record.time_s)),
        "armed": vehicle.armed if vehicle.lock is not None else None,
        "on_ground": vehicle.on_ground if vehicle.landed_state_known(record.time_s) else None,
        "tracks": record.tracks,
        "conflicts": len(record.conflicts),
        "nearest_margin_m": _finite(record.nearest_margin_m),
        "time_to_violation_s": _finite(record.time_to_violation_s),
        "goal_distance_m": _finite(record.goal_distance_m),
        "speed_mps": _finite(record.own.speed_mps if record.own is not None else None),
        "commanded_ned_mps": None if command is None else rounded(command),
        "status": None if record.status is None else record.status.name.lower(),
        "setpoints": engine.setpoints_sent,
        "recovering": record.recovering,
        "doubtful": sum(track.doubt.widening_m(record.time_s) > 0.0 for track in engine.picture.tracks.values()),
        "rejects": rejects,
        "detection_needed_m": _finite(detection.needed_m if detection is not None else None),
        "detection_given_m": _finite(detection.given_m if detection is not None else None),
        "detection_short": detection is not None and detection.short,
    }


def rounded(velocity_ned_mps: Velocity) -> list[float]:
    """A velocity with two decimals."""
    return [round(value, 2) for value in velocity_ned_mps]


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, 2)
