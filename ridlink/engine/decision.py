"""Result of one step of the engine: a value to log, to announce and to show."""

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
        miss_m: Horizontal distance at that time.
        height_m: Height of the neighbour above us now, 0 if unknown.
    """

    track: Track
    entry_s: float
    closest_s: float
    miss_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class DecisionRecord:
    """What one step saw and decided.

    Attributes:
        time_s: The caller's clock.
        state: State of the failsafe ladder.
        own: Own state; None if unknown.
        tracks: Number of tracks.
        conflicts: Neighbours in conflict, the most urgent first.
        nearest_margin_m: Smallest distance to a neighbour less its disc; infinite without neighbours.
        time_to_violation_s: Time until the first disc is entered if all fly on; infinite if none is.
        preferred_ned_mps: Velocity wanted without traffic; None without a decision.
        commanded_ned_mps: Velocity that was sent; None if nothing was.
        status: Result of the solver; None without a decision.
        binding: Neighbours whose constraints bind.
        goal_distance_m: Horizontal distance to the goal; None without a decision.
        recovering: True if there is a conflict, or was one a moment ago.
        resumed_entry_s: Under a guard that steers, time until the first disc is entered if the autopilot's plan goes
            on [s].
        detection: Ranges from which neighbours must be heard and are heard; None before the own state is known.
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
    resumed_entry_s: float = math.inf
    detection: DetectionRange | None = None


@dataclass(slots=True)
class StepOutput:
    """What to send after one step.

    Attributes:
        to_vehicle: Frames for the autopilot.
        to_air: Frames for the Remote ID link.
        to_transmitter: The same for the link of a transmitter that has its own; to be sent before `broadcasts`.
        broadcasts: The own Remote ID, as datagrams for its transmitter.
        replies: Frames for other senders on the vehicle link, with their addresses.
        warnings: Warnings for the operator; on the vehicle link each is a STATUSTEXT.
        decision: Record of the step.
    """

    decision: DecisionRecord
    to_vehicle: list[bytes] = field(default_factory=list)
    to_air: list[bytes] = field(default_factory=list)
    to_transmitter: list[bytes] = field(default_factory=list)
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
