"""`--takeoff-aware`: a climb-out is not interrupted, unless a mid-air collision is predicted."""

from __future__ import annotations

import math

from ridlink.engine.config import EngineConfig
from ridlink.engine.decision import Conflict, DecisionRecord
from ridlink.own_ship import OwnShipTelemetry
from ridlink.separation.reference import AIRFRAME_CAP_M, ERROR_CAP_M, MAX_AIRFRAME_M, UNKNOWN_ERROR_BOUND_M
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.track import bound_m

CLIMBING_MPS = 0.5


def interruptible(
    config: EngineConfig, telemetry: OwnShipTelemetry, own: OwnState | None, last: DecisionRecord | None
) -> bool:
    """Whether setpoints may be sent to the vehicle as it is: not on the ground, not in a climb-out.

    Args:
        config: As the engine has it.
        telemetry: Own state and autopilot.
        own: Own state now.
        last: Record of the last step.
    """
    if not config.takeoff_aware:
        return telemetry.ready
    if telemetry.on_ground:
        return False
    climbing_out = not telemetry.ready
    if own is not None:
        low = own.position.altitude_m - own.home_altitude_m < config.takeoff_height_m
        climbing_out |= low and -own.velocity_ned_mps[2] > CLIMBING_MPS
    return not climbing_out or (last is not None and own is not None and mac_predicted(config, own, last))


def mac_predicted(config: EngineConfig, own: OwnState, seen: DecisionRecord) -> bool:
    """Whether a neighbour comes as near as both airframes and one standard deviation of both errors, if all fly on."""
    return any(_miss_is_mac(config, own, conflict) for conflict in seen.conflicts)


def _miss_is_mac(config: EngineConfig, own: OwnState, conflict: Conflict) -> bool:
    report = conflict.track.report
    # Capped as for discs: one packet that claims 655 m must not interrupt every climb-out.
    airframe_m = (config.airframe_m + min(report.airframe_size_m or MAX_AIRFRAME_M, AIRFRAME_CAP_M)) / 2.0
    sigma_m = math.hypot(own.error_bound_m, min(bound_m(report, UNKNOWN_ERROR_BOUND_M), ERROR_CAP_M)) / 3.0
    return conflict.miss_m <= airframe_m + sigma_m
