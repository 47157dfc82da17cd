"""The figures of a flying daemon for `ridlink.metrics`."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ridlink.daemon.summary import Pace
from ridlink.engine import Engine, StepOutput
from ridlink.failsafe import State
from ridlink.metrics import Value

LAST_MINUTE_STEPS = 600


def figures(
    engine: Engine,
    output: StepOutput,
    *,
    pace: Pace,
    broadcasts: int,
    events: Mapping[str, int],
) -> dict[str, Value]:
    """The figures that `AVOID_METRICS` names; unknown or infinite ones are left out.

    Args:
        engine: The engine.
        output: Output of its last step.
        pace: Times of its steps.
        broadcasts: Datagrams of the own Remote ID sent.
        events: What was dropped, clamped, refused or noticed, by cause.
    """
    record = output.decision
    totals = engine.summary()
    now_s = record.time_s
    found: dict[str, Value] = {
        "ridlink_state": {state.name.lower(): float(state is record.state) for state in State},
        "ridlink_tracks": record.tracks,
        "ridlink_tracks_doubtful": sum(t.doubt.widening_m(now_s) > 0.0 for t in engine.picture.tracks.values()),
        "ridlink_conflicts": len(record.conflicts),
        "ridlink_setpoints": totals.setpoints,
        "ridlink_reports_received": totals.reports_received,
        "ridlink_infeasible_steps": totals.infeasible_steps,
        "ridlink_broadcasts": broadcasts,
        "ridlink_decision_seconds": pace.decision_ms.quantiles(LAST_MINUTE_STEPS, 1e-3),
        "ridlink_setpoint_gap_seconds": pace.gap_ms.quantiles(LAST_MINUTE_STEPS, 1e-3),
        "ridlink_events": dict(events),
    }
    for name, value in (
        ("ridlink_nearest_margin_metres", record.nearest_margin_m),
        ("ridlink_time_to_violation_seconds", record.time_to_violation_s),
        ("ridlink_own_error_metres", math.inf if record.own is None else record.own.error_bound_m),
        ("ridlink_guard_takeovers", math.inf if engine.guard is None else engine.guard.takeovers),
    ):
        if math.isfinite(value):
            found[name] = value
    return found
