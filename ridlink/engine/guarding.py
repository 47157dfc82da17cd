"""A guard in its engine: what it sees of own-ship and of the last decision, and where a takeover leads.

Once a step, before the ladder moves, the engine asks its guard and carries out its wishes: see `guard`.
"""

from __future__ import annotations

from ridlink.engine.config import EngineConfig, Goal
from ridlink.engine.decision import DecisionRecord
from ridlink.engine.guard import PAUSABLE, Guard, Seen
from ridlink.engine.takeoff import interruptible
from ridlink.failsafe import HEARTBEAT_LOST_S, OTHER_WRITER, STEERING, Rung, State
from ridlink.geodesy import moved
from ridlink.own_ship import PX4, OwnShipTelemetry
from ridlink.traffic.own_state import OwnState

AHEAD_M = 1000.0
"""Further away than any conflict lasts."""

HOVERING_MPS = 1.0
"""A slower vehicle keeps its place: the velocity of one that hovers is the noise of its receiver, and leads nowhere."""

RESUMED_FREE_S = 5.0
"""A plan that goes on at the highest speed at which it was flown must lead into no disc for so long. The next takeover
would come too late for an earlier one: half a second of stream, up to a second until a heartbeat, and the way in which
the vehicle stops."""


def resting(guard: Guard) -> Rung:
    """Rung of a guard that watches: it waits for no operator's request."""
    return Rung(reason=f"guard: {guard.phase}" + (f": {guard.remark}" if guard.remark else ""))


def ended(autopilot: int, *, asked: bool, dry_run: bool) -> Rung:
    """Rung at the end of a daemon that steered; its reason says how the vehicle is left.

    Args:
        autopilot: MAV_AUTOPILOT.
        asked: The mode that a guard found was asked for, without waiting for a heartbeat that confirms it.
        dry_run: Nothing was sent.
    """
    if dry_run:
        return Rung(reason="ended")
    if asked:
        return Rung(reason="ended: the mode that the guard found is asked for")
    left = "leaves OFFBOARD by its own failsafe" if autopilot == PX4 else "hovers in GUIDED"
    return Rung(reason=f"ended: the vehicle is told to stop, and {left}")


def goal_ahead(own: OwnState, *, paused: bool = False) -> Goal:
    """Goal where the autopilot's plan leads, as far as the own velocity tells; for a vehicle that hovers, or whose plan
    is paused, its place."""
    here = own.position.latitude_deg, own.position.longitude_deg
    if paused or own.speed_mps < HOVERING_MPS:
        return Goal(*here)
    ahead_s = AHEAD_M / own.speed_mps
    north, east = (ahead_s * value for value in own.velocity_ned_mps[:2])
    return Goal(*moved(*here, north, east), speed_mps=own.speed_mps)


def seen_by_guard(
    config: EngineConfig,
    telemetry: OwnShipTelemetry,
    own: OwnState | None,
    rung: Rung,
    last: DecisionRecord | None,
    now_s: float,
) -> Seen:
    """What a guard sees in this step.

    Args:
        config: As the engine has it.
        telemetry: Own state and autopilot.
        own: Own state now; without one, the last decision says nothing about the present.
        rung: Rung of the last step.
        last: Decision of the last step.
        now_s: Monotonic time.
    """
    last = last if own is not None else None
    lock = telemetry.lock
    return Seen(
        autopilot=lock.autopilot if lock is not None else 0,
        custom_mode=telemetry.custom_mode,
        flying=telemetry.armed and telemetry.is_multirotor and not telemetry.on_ground,
        interruptible=interruptible(config, telemetry, own, last),
        conflict=last is not None and bool(last.conflicts),
        clear=rung.state is State.ENGAGED
        and last is not None
        and not last.recovering
        and last.resumed_entry_s > RESUMED_FREE_S,
        steering=rung.state in STEERING,
        taken=rung.reason == OTHER_WRITER,
        sysid=lock.sysid if lock is not None else 0,
        mission_item=telemetry.mission_item,
        paused=telemetry.mission_paused and lock is not None and telemetry.custom_mode == PAUSABLE.get(lock.autopilot),
        heard=telemetry.heard_s(now_s) <= HEARTBEAT_LOST_S,
        armed=telemetry.armed,
    )
