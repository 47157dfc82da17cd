"""What one step of the engine saw and decided, as a value to log, to announce and to show."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field

from ridlink.avoidance.types import Status
from ridlink.engine.detection import DetectionRange
from ridlink.failsafe import State
from ridlink.setpoint import Velocity
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.track import Track


@dataclass(frozen=True, slots=True)
class Conflict:
    """A neighbour whose disc is entered within the solver's horizon if both fly on.

    Attributes:
        track: The neighbour.
        entry_s: Time until its disc is entered, 0 inside.
        closest_s: Time of the closest approach.
        miss_m: Horizontal distance then.
        height_m: How far it is above us now, 0 where that is not known.
    """

    track: Track
    entry_s: float
    closest_s: float
    miss_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class DecisionRecord:
    """One step.

    Attributes:
        time_s: The caller's clock.
        state: State of the failsafe ladder.
        own: Own state; None while it is unknown.
        tracks: Number of tracks.
        conflicts: Neighbours in conflict, the most urgent first.
        nearest_margin_m: Smallest distance to a neighbour less its disc; infinite without any.
        time_to_violation_s: Time until the first disc is entered if all fly on; infinite if never.
        preferred_ned_mps: Velocity wanted without traffic; None without a decision.
        commanded_ned_mps: Velocity that was sent; None if nothing was.
        status: Result of the solver; None without a decision.
        binding: Neighbours whose constraints bind.
        goal_distance_m: Horizontal distance to the goal; None without a decision.
        recovering: A conflict is there, or was a moment ago.
        detection: From how far neighbours must be heard and are heard; None before own state is known.
    """

    time_s: float
    state: State
    own: OwnState | None
    tracks: int
    conflicts: tuple[Conflict, ...] = ()
    nearest_margin_m: float = math.inf
    time_to_violation_s: float = math.inf
    preferred_ned_mps: Velocity | None = None
    commanded_ned_mps: Velocity | None = None
    status: Status | None = None
    binding: tuple[Track, ...] = ()
    goal_distance_m: float | None = None
    recovering: bool = False
    detection: DetectionRange | None = None


@dataclass(slots=True)
class StepOutput:
    """What to send after one step.

    Attributes:
        to_vehicle: Frames for the autopilot.
        to_air: Frames for the Remote ID link.
        broadcasts: The own Remote ID, datagrams for whoever transmits it.
        replies: Frames for others who spoke on the vehicle link, with their addresses.
        warnings: What an operator should hear of; on the vehicle link it is a STATUSTEXT.
        decision: What was decided.
    """

    decision: DecisionRecord
    to_vehicle: list[bytes] = field(default_factory=list)
    to_air: list[bytes] = field(default_factory=list)
    broadcasts: list[bytes] = field(default_factory=list)
    replies: list[tuple[bytes, Hashable]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class EngineSummary:
    """Totals so far."""

    setpoints: int
    reports_received: int
    rejects: dict[str, int]
    tracks: int
    state: str
    reason: str
    infeasible_steps: int
