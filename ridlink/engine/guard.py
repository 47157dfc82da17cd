"""`--guard`: watch while the autopilot flies its own plan, take over for a conflict, hand back what was found.

    WATCHING      only status messages are sent. Takes over from autonomous modes only, never from a pilot's.
    TAKING_OVER   a conflict is predicted: PX4 gets its stream first, then the mode is asked for until a heartbeat says
                  it. If the link is lost meanwhile, the next heartbeat tells whether the request was heard.
    RESOLVING     in GUIDED or OFFBOARD; until the way has been free for the hysteresis, or nothing has steered for five
                  seconds: a lost own state or link ends the avoidance, and an ArduPilot would hover there for ever.
    HOLDING       a mission that was found paused is not handed back, for it would fly on: the vehicle goes on avoiding
                  about its place, until the operator chooses the mode that was found.
    HANDING_BACK  the mission item and the mode that were found are asked for until a heartbeat says so.
                  Of a vehicle that was disarmed meanwhile nothing is asked: the guard watches.
    ENDED         somebody else changed the mode meanwhile, or steers as well, or another vehicle speaks on the link.
                  The vehicle is theirs until the operator engages the guard again, by MAV_CMD_DO_PAUSE_CONTINUE with 1
                  sent to this component.

No acknowledgement counts: PX4 acknowledges twice, and only the second one may be the refusal. A guard is told what is
seen, and returns the commands to send; it sends nothing itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from ridlink.failsafe import OTHER_WRITER
from ridlink.own_ship import ARDUPILOT, PX4

DO_SET_MODE, DO_SET_MISSION_CURRENT = 176, 224
"""MAV_CMD."""
CUSTOM_MODE_ENABLED = 1.0
EXTERNAL_MODE = {PX4: 6 << 16, ARDUPILOT: 4}

PX4_AUTO = 4
AUTONOMOUS = {PX4: {(PX4_AUTO, 3), (PX4_AUTO, 4), (PX4_AUTO, 5)}, ARDUPILOT: {(3, 0), (6, 0)}}
"""PX4: hold, mission, return. ArduPilot: AUTO, RTL."""

PAUSABLE = {ARDUPILOT: 3}
"""AUTO, which an operator pauses by DO_PAUSE_CONTINUE: it stays the mode, and another mode ends the pause."""

STREAM_FIRST_S = 0.5
"""PX4 accepts OFFBOARD after 100 ms of stream; lost datagrams are allowed for."""
ASK_AGAIN_S = 0.5
GIVE_UP_S = 5.0
"""Without the mode: it is tried again, for the conflict may still be there. In the mode: without any steering."""

CHANGED = "somebody else, or the autopilot itself, changed the mode"
FOREIGN_MODE = "this mode is not taken over from"
"""Remarks."""

Commands = tuple[tuple[int, tuple[float, ...]], ...]
"""COMMAND_LONGs to the autopilot: number and parameters."""


class Phase(StrEnum):
    """Phase of a guard."""

    WATCHING = "watching"
    TAKING_OVER = "taking over"
    RESOLVING = "resolving"
    HOLDING = "holding"
    HANDING_BACK = "handing back"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Seen:
    """What a guard sees in this step.

    Args:
        autopilot: MAV_AUTOPILOT.
        custom_mode: Mode in the last heartbeat.
        flying: A multirotor, armed, off the ground.
        interruptible: Not in a climb-out that must not be interrupted.
        conflict: A disc is entered within the horizon if all fly on.
        clear: The way has been free for the hysteresis, and is so for some seconds at the speed of the plan.
        sysid: System id of the autopilot.
        mission_item: Sequence number in MISSION_CURRENT; None if it was not told.
        paused: The plan is paused in its mode.
        steering: The avoidance steers, or stops the vehicle.
        taken: Another writer sends setpoints, and the avoidance gave way.
        heard: The autopilot is heard; otherwise, what it said last may be long past.
        armed: Armed, by the last heartbeat.
    """

    autopilot: int
    custom_mode: int
    flying: bool
    interruptible: bool
    conflict: bool
    clear: bool
    sysid: int
    mission_item: int | None = None
    paused: bool = False
    steering: bool = True
    taken: bool = False
    heard: bool = True
    armed: bool = True

    @property
    def vehicle(self) -> tuple[int, int]:
        """Identity of the vehicle."""
        return self.sysid, self.autopilot


@dataclass(frozen=True, slots=True)
class Wish:
    """What a guard wants in this step.

    Attributes:
        begin: Make the operator's request of avoidance, to resolve a conflict.
        end: Withdraw that request.
        commands: Commands for the autopilot.
    """

    begin: bool = False
    end: bool = False
    commands: Commands = ()


def is_autonomous(autopilot: int, custom_mode: int) -> bool:
    """Whether the autopilot flies a plan of its own in this mode."""
    return _parts(autopilot, custom_mode) in AUTONOMOUS.get(autopilot, set())


def _parts(autopilot: int, custom_mode: int) -> tuple[int, int]:
    return ((custom_mode >> 16) & 0xFF, custom_mode >> 24) if autopilot == PX4 else (custom_mode, 0)


def mode_command(autopilot: int, custom_mode: int) -> tuple[int, tuple[float, ...]]:
    """DO_SET_MODE with a custom mode."""
    return DO_SET_MODE, (CUSTOM_MODE_ENABLED, *(float(part) for part in _parts(autopilot, custom_mode)))


class Guard:
    """Guard of one vehicle.

    Attributes:
        phase: Present phase.
        found_mode: Mode that it hands back.
        found_paused: Whether the plan was paused in that mode.
        takeovers: Number of conflicts that it took over for.
        refused: How often a mode was asked for in vain for longer than five seconds.
        pauses_kept: For how many conflicts it has not handed back, since the plan was found paused.
        remark: Why it has ended, or does not take over now; empty if there is nothing to say.
    """

    def __init__(self) -> None:
        self.phase = Phase.WATCHING
        self.found_mode = 0
        self.found_paused = False
        self.takeovers = self.refused = self.pauses_kept = 0
        self.remark = ""
        self._found_item: int | None = None
        self._vehicle: tuple[int, int] | None = None
        self._since_s = self._asked_s = self._steered_s = 0.0

    def engage(self) -> bool:
        """Engage again, for the operator; returns whether it had ended."""
        ended = self.phase is Phase.ENDED
        if ended:
            self.phase, self.remark = Phase.WATCHING, ""
        return ended

    def step(self, seen: Seen, now_s: float) -> Wish:
        """What the guard wants now.

        Args:
            seen: What it sees.
            now_s: Monotonic time.
        """
        if self.phase not in (Phase.WATCHING, Phase.ENDED) and seen.vehicle != self._vehicle:
            return self._end("another vehicle speaks on the link", now_s)
        external = _same(seen.autopilot, seen.custom_mode, EXTERNAL_MODE[seen.autopilot])
        match self.phase:
            case Phase.WATCHING:
                return self._watch(seen, now_s)
            case Phase.TAKING_OVER:
                return self._take_over(seen, now_s, external)
            case Phase.RESOLVING | Phase.HOLDING | Phase.HANDING_BACK:
                return self._resolve(seen, now_s, external)
        return Wish()

    def _watch(self, seen: Seen, now_s: float) -> Wish:
        autonomous = is_autonomous(seen.autopilot, seen.custom_mode)
        self.remark = FOREIGN_MODE if seen.flying and seen.heard and not autonomous else ""
        if not (autonomous and seen.conflict and seen.flying and seen.heard and seen.interruptible):
            return Wish()
        self.found_mode, self.found_paused = seen.custom_mode, seen.paused
        self._found_item, self._vehicle = seen.mission_item, seen.vehicle
        self.takeovers += 1
        self._go(Phase.TAKING_OVER, now_s)
        return Wish(begin=True)

    def _take_over(self, seen: Seen, now_s: float, external: bool) -> Wish:
        if external:
            self._go(Phase.RESOLVING, now_s)
            return Wish()
        if not seen.heard:
            return Wish()
        if not seen.flying:
            self._go(Phase.WATCHING, now_s)
            return Wish(end=True)
        if not _same(seen.autopilot, seen.custom_mode, self.found_mode):
            if self._has_asked or not is_autonomous(seen.autopilot, seen.custom_mode):
                return self._end(CHANGED, now_s)
            # As it would have been found a moment later: a mission that has come to its end holds.
            self.found_mode, self.found_paused = seen.custom_mode, seen.paused
            return Wish(begin=True)
        if now_s - self._since_s > GIVE_UP_S:
            self.refused += 1
            self._go(Phase.WATCHING, now_s)
            return Wish(end=True)
        self._found_item = seen.mission_item  # the plan goes on until the mode is there
        stream_first_s = STREAM_FIRST_S if seen.autopilot == PX4 else 0.0
        if now_s - self._since_s < stream_first_s - 1e-6 or not self._ask(now_s):
            return Wish()
        return Wish(commands=(mode_command(seen.autopilot, EXTERNAL_MODE[seen.autopilot]),))

    def _resolve(self, seen: Seen, now_s: float, external: bool) -> Wish:
        # While it hands back it ends the stream anyway, and the plan that is flown again sets targets of its own.
        if not external or (seen.taken and self.phase is not Phase.HANDING_BACK):
            if self.phase is Phase.RESOLVING or not _same(seen.autopilot, seen.custom_mode, self.found_mode):
                return self._end(CHANGED if not external else OTHER_WRITER, now_s)
            self._go(Phase.WATCHING, now_s)
            return Wish(end=True)
        if not seen.armed:  # its flight is over, and a plan that was handed back would begin when it is armed again
            self._go(Phase.WATCHING, now_s)
            return Wish(end=True)
        if seen.steering:
            self._steered_s = now_s
        # What was asked for may still come; after handing back, the guard watches on.
        if not seen.clear and now_s - max(self._steered_s, self._since_s) <= GIVE_UP_S:
            return Wish()
        if self.phase is Phase.RESOLVING:
            self.pauses_kept += self.found_paused
            self._go(Phase.HOLDING if self.found_paused else Phase.HANDING_BACK, now_s)
        elif self.phase is Phase.HOLDING and not seen.clear:
            self._go(Phase.HOLDING, now_s)
            return Wish(begin=True)  # the avoidance was ended, by a lost own state or link
        if self.phase is Phase.HOLDING:
            return Wish()
        if not self._ask(now_s):
            return Wish()
        self.refused += seen.heard and now_s - self._since_s > GIVE_UP_S
        return Wish(commands=self.hand_back(seen))

    def hand_back(self, seen: Seen) -> Commands:
        """Commands that restore what was found; none unless the guard took over, or asked to and does not know yet, and
        none that would end a pause."""
        asked = self.phase is Phase.TAKING_OVER and self._has_asked
        taken = asked or self.phase in (Phase.RESOLVING, Phase.HANDING_BACK)
        if not taken or self.found_paused or seen.vehicle != self._vehicle:
            return ()
        mode = mode_command(seen.autopilot, self.found_mode)
        if self._found_item is None or seen.mission_item in (None, self._found_item):
            return (mode,)
        return (DO_SET_MISSION_CURRENT, (float(self._found_item),)), mode

    @property
    def _has_asked(self) -> bool:
        """Whether anything was asked for in this phase."""
        return self._asked_s >= self._since_s

    def _ask(self, now_s: float) -> bool:
        if now_s - self._asked_s < ASK_AGAIN_S - 1e-6:
            return False
        self._asked_s = now_s
        return True

    def _end(self, why: str, now_s: float) -> Wish:
        self.remark = why
        self._go(Phase.ENDED, now_s)
        return Wish(end=True)

    def _go(self, phase: Phase, now_s: float) -> None:
        self.phase, self._since_s, self._asked_s = phase, now_s, now_s - 1.0


def _same(autopilot: int, one: int, other: int) -> bool:
    """Whether two custom modes are the same; PX4's OFFBOARD has no sub mode, but some report one."""
    if autopilot == PX4 and _parts(autopilot, other)[0] != PX4_AUTO:
        return _parts(autopilot, one)[0] == _parts(autopilot, other)[0]
    return one == other
