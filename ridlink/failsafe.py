"""Engage, hold, stop: which kind of setpoint may leave now. A pure function of the last rung and the conditions.

    STANDBY   nothing is steered. PX4 gets zero velocity while it is armed and waits, since it wants a stream before it
              accepts OFFBOARD. It ignores that outside OFFBOARD, and hovers inside, where its position may yet come.
    ENGAGED   the vehicle is armed and in GUIDED or OFFBOARD, an operator asked for it, the own state is fresh.
    HOLD      engaged, but own state or loop are in doubt, or it stands on the ground: zero velocity.
    STOPPED   doubt lasted: the stream has ended on purpose, so that the native failsafe of the autopilot acts.

The first engagement uses up an operator's request. A change of mode, by the pilot or by the autopilot itself (a
landing, a failsafe), ends the engagement. Neither the return of the mode nor that of a lost link renews it: only
another request does.

The end of the stream does not mean the same to both autopilots. ArduPilot flies on for three seconds (GUID_TIMEOUT),
brakes and hovers. PX4 leaves OFFBOARD after one (COM_OF_LOSS_T) and, without a radio control link, returns home. So
zero velocity always goes out before the stream ends on purpose: three setpoints at a clean stop, seconds of them on the
rung of HOLD. To ask PX4 for its HOLD mode as well would change a mode, which is the operator's: only `--guard`, into
which the operator opted, hands back the mode that it found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum

OTHER_WRITER = "another writer steers this vehicle"
UNHEARD = "the vehicle does not obey: setpoints may be lost"

HEARTBEAT_LOST_S = 3.0
"""Three heartbeats of an autopilot that sends one a second: after such a silence its state is unknown."""


class State(IntEnum):
    """RIDLINK_STATE."""

    STANDBY = 0
    ENGAGED = 1
    HOLD = 2
    STOPPED = 3


STEERING = (State.ENGAGED, State.HOLD)
"""States in which setpoints move the vehicle, or stop it."""


class Stream(StrEnum):
    """What may be sent to the autopilot."""

    NOTHING = "nothing"
    ZERO = "zero"
    DECISION = "decision"


@dataclass(frozen=True, slots=True)
class FailsafeSettings:
    """When doubt becomes action.

    Args:
        heartbeat_lost_s: An autopilot that was silent for this long is lost.
        hold_after_s: Own state older than this is no base for avoidance: 15 m of flight at 15 m/s.
        stop_after_s: Own state older than this will not come back soon; the autopilot knows better what to do.
        pause_s: After a longer pause of the loop, hold first: the world has moved on. The watchdog uses the same time.
        max_latitude_deg: Closer to a pole, local coordinates bend too much.
        farthest_goal_m: What is farther away was not meant, as where longitude was written first: no multirotor flies
            for eight hours.
    """

    heartbeat_lost_s: float = HEARTBEAT_LOST_S
    hold_after_s: float = 1.0
    stop_after_s: float = 5.0
    pause_s: float = 0.3
    max_latitude_deg: float = 85.0
    farthest_goal_m: float = 300e3


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of this step.

    Args:
        autopilot_heard_s: Time since the last heartbeat of the autopilot; infinite without one.
        own_state_age_s: Time since the last trusted own position; infinite without one.
        armed: Whether the vehicle is armed, by the last heartbeat.
        external_mode: Whether it is in GUIDED or OFFBOARD, by the last heartbeat.
        obeying_s: Time for which heartbeats have said both without a break.
        ready: The vehicle is neither on the ground nor in an automatic take-off, where a setpoint aborts the climb.
        wants_stream: The autopilot (PX4) accepts OFFBOARD only with a stream.
        rebooted: The clock of the autopilot went back since the last step.
        latitude_deg: Own latitude.
        since_last_step_s: Time since the last step.
        stalled: The watchdog saw the loop stand still.
        warming: The kernels that decide are still being compiled or loaded.
        own_jumped: The own position jumped a moment ago: it is wrong now, or was before.
        on_ground: The autopilot says that the vehicle stands: one that has landed must not be made to climb or to tip
            over.
        other_writer: Another writer sends setpoints, and was there first or does not give way.
        unheard: The vehicle has stood for a long time, and flown after no setpoint.
        has_goal: There is a goal.
        goal_away_m: Distance to the goal, if known.
        deciding_fails: Decisions have failed again and again.
    """

    autopilot_heard_s: float = math.inf
    own_state_age_s: float = math.inf
    armed: bool = False
    external_mode: bool = False
    obeying_s: float = 0.0
    ready: bool = True
    wants_stream: bool = False
    rebooted: bool = False
    latitude_deg: float = 0.0
    since_last_step_s: float = 0.0
    stalled: bool = False
    warming: bool = False
    own_jumped: bool = False
    on_ground: bool = False
    other_writer: bool = False
    unheard: bool = False
    has_goal: bool = False
    goal_away_m: float = 0.0
    deciding_fails: bool = False


@dataclass(frozen=True, slots=True)
class Rung:
    """Present rung of the ladder.

    Attributes:
        state: State.
        requested: Whether an operator's request stands.
        stream: What may be sent in this step.
        reason: Why, in a few words.
    """

    state: State = State.STANDBY
    requested: bool = False
    stream: Stream = Stream.NOTHING
    reason: str = "waiting for an operator's request"


def request(rung: Rung) -> Rung:
    """Rung after an operator's request, at the start or by MAV_CMD_DO_REPOSITION; an engaged vehicle stays engaged."""
    state = State.STANDBY if rung.state is State.STOPPED else rung.state
    return replace(rung, requested=True, state=state)


def advance(rung: Rung, seen: Conditions, settings: FailsafeSettings | None = None) -> Rung:
    """The rung of this step.

    Args:
        rung: Rung of the step before.
        seen: Present conditions.
        settings: Limits; the defaults if not given.
    """
    settings = settings or FailsafeSettings()
    if rung.state in STEERING:
        return _engaged(seen, settings)
    return _waiting(rung, seen, settings)


def _engaged(seen: Conditions, settings: FailsafeSettings) -> Rung:
    asleep_s = _asleep_s(seen, settings)
    ended = _end_of_engagement(seen, settings, asleep_s)
    if ended:
        return Rung(State.STANDBY, False, Stream.NOTHING, ended)
    if not seen.own_state_age_s - asleep_s <= settings.stop_after_s:
        return _stopped(settings)
    doubt = _doubt(seen, settings)
    if doubt:
        return Rung(State.HOLD, True, Stream.ZERO, doubt)
    return Rung(State.ENGAGED, True, Stream.DECISION, "avoiding")


def _asleep_s(seen: Conditions, settings: FailsafeSettings) -> float:
    # Messages that came while the loop slept wait in the sockets until the next step: the autopilot was not silent.
    return seen.since_last_step_s if seen.since_last_step_s > settings.pause_s else 0.0


def _stopped(settings: FailsafeSettings) -> Rung:
    lost = f"own state lost for {settings.stop_after_s:g} s: the autopilot's own failsafe takes over"
    return Rung(State.STOPPED, False, Stream.NOTHING, lost)


def _end_of_engagement(seen: Conditions, settings: FailsafeSettings, asleep_s: float) -> str:
    where = ", on the ground" if seen.on_ground else ""
    if seen.rebooted:
        return "the autopilot restarted"
    if seen.autopilot_heard_s - asleep_s > settings.heartbeat_lost_s:
        return f"no heartbeat of the autopilot for {settings.heartbeat_lost_s:g} s, it was armed{where}"
    if not seen.armed:
        return f"disarmed{where}"
    if not seen.external_mode:
        return "the vehicle left GUIDED or OFFBOARD"
    if seen.other_writer:
        return OTHER_WRITER
    if seen.unheard:
        return UNHEARD
    return ""


def _doubt(seen: Conditions, settings: FailsafeSettings) -> str:
    if seen.stalled or seen.since_last_step_s > settings.pause_s:
        return "the loop paused"
    if not seen.own_state_age_s <= settings.hold_after_s:
        return f"own state is stale: no position to trust for {settings.hold_after_s:g} s"
    if seen.warming:
        return "kernels are being loaded"
    if seen.on_ground:
        return "the vehicle stands on the ground"
    if seen.own_jumped:
        return "own position jumped"
    if not abs(seen.latitude_deg) <= settings.max_latitude_deg:
        return f"latitude beyond {settings.max_latitude_deg:g} degrees"
    if not seen.goal_away_m <= settings.farthest_goal_m:
        return f"the goal {_far(settings)}"
    if seen.deciding_fails:
        return "decisions fail"
    return ""


def _far(settings: FailsafeSettings) -> str:
    return f"is more than {settings.farthest_goal_m / 1e3:g} km away"


def _waiting(rung: Rung, seen: Conditions, settings: FailsafeSettings) -> Rung:
    if not rung.requested:
        if rung.state is State.STOPPED and seen.armed:
            return replace(rung, stream=Stream.NOTHING)
        reason = rung.reason if rung.state is State.STANDBY else "waiting for an operator's request"
        return Rung(State.STANDBY, False, Stream.NOTHING, reason)
    if seen.autopilot_heard_s > settings.heartbeat_lost_s:
        return Rung(State.STANDBY, True, Stream.NOTHING, "waiting for an autopilot")
    if not seen.has_goal:
        return Rung(State.STANDBY, True, Stream.NOTHING, "waiting for a goal")
    if not seen.goal_away_m <= settings.farthest_goal_m:
        return Rung(State.STANDBY, True, Stream.NOTHING, f"waiting for another goal: this one {_far(settings)}")
    if not seen.armed:
        return Rung(State.STANDBY, True, Stream.NOTHING, "waiting for the vehicle to be armed")
    if seen.external_mode and seen.other_writer:
        return Rung(State.STANDBY, False, Stream.NOTHING, OTHER_WRITER)
    prestream = Stream.ZERO if seen.wants_stream else Stream.NOTHING
    if not seen.external_mode:
        return Rung(State.STANDBY, True, prestream, "waiting for GUIDED or OFFBOARD")
    # A PX4 in OFFBOARD obeys the stream. It must not outlast the own position, nor resume: that brings OFFBOARD back.
    lost_s = min(seen.own_state_age_s, seen.obeying_s) - _asleep_s(seen, settings)
    if seen.wants_stream and not lost_s <= settings.stop_after_s:
        return _stopped(settings)
    if not seen.ready:
        return Rung(State.STANDBY, True, prestream, "waiting for the end of the take-off")
    doubt = _doubt(seen, settings)
    if doubt:
        return Rung(State.STANDBY, True, prestream, f"waiting: {doubt}")
    # The first setpoint of an engagement is zero velocity, whatever is decided.
    return Rung(State.ENGAGED, True, Stream.ZERO, "avoiding")
