"""One own-ship and its goal, without input or output: bytes and times in, bytes out.

Datagrams go in as they come; `step` is called every 100 ms and returns what to send. No clock is read and no socket
opened here, so the same engine runs in the daemon, in tests in virtual time, and on recordings.

Axes: north, east, down about the own position of the instant; metres, m/s, seconds of the caller's monotonic clock.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable
from dataclasses import dataclass, field, replace

from ridlink.engine.announce import AVOIDANCE_COMPONENT, collision, heartbeat, status, warning
from ridlink.engine.climbing import Climber
from ridlink.engine.commands import (
    ACCEPTED,
    DENIED,
    DO_REPOSITION,
    MOST_REPLIES,
    UNSUPPORTED,
    acknowledged,
    message_requests,
    repositioned,
)
from ridlink.engine.config import EngineConfig
from ridlink.engine.deciding import Decider
from ridlink.engine.decision import DecisionRecord
from ridlink.engine.detection import DetectionRange, DetectionWatch, reaction_of
from ridlink.engine.periodic import Periodic
from ridlink.failsafe import Conditions, Rung, State, Stream, advance, request
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import BadFrame, Frame, parse_datagram
from ridlink.own_ship import AUTOPILOT_COMPONENT, OwnShipTelemetry
from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.bridge import messages_of
from ridlink.remote_id.messages import MAVLINK_NAMES, BasicId, Location, RemoteIdMessage
from ridlink.separation.reference import (
    ERROR_CAP_M,
    UNKNOWN_ERROR_BOUND_M,
    UNKNOWN_SPEED_MPS,
)
from ridlink.setpoint import STOP, SetpointStream, Velocity
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.picture import PictureSettings, Snapshot, TrafficPicture
from ridlink.traffic.track import TrackKey

MOST_COLLISIONS = 8
"""COLLISION messages per second: a link of a few kbit/s must not drown in warnings."""
COLLISION_PERIOD_S = 1.0 - 1e-6

MESSAGE_IDS = frozenset(
    msgid for msgid in CRC_EXTRAS if 12900 <= msgid <= 12920 or msgid in (0, 24, 32, 33, 75, 76, 230, 245, 61400)
)
"""What an engine reads; anything else is skipped before it is decoded."""
LOCATION = MAVLINK_NAMES[Location]
REMOTE_ID_NAMES = frozenset((*MAVLINK_NAMES.values(), "OPEN_DRONE_ID_MESSAGE_PACK"))

FATAL_FAILURES = 3
FATAL_WITHIN_S = 1.0
"""So many failed decisions in so short a time are no accident."""


@dataclass(slots=True)
class StepOutput:
    """What to send after one step.

    Attributes:
        to_vehicle: Frames for the autopilot.
        to_air: Frames for the Remote ID link.
        replies: Frames for others who spoke on the vehicle link, with their addresses.
        warnings: What an operator should hear of; on the vehicle link it is a STATUSTEXT.
        decision: What was decided.
    """

    decision: DecisionRecord
    to_vehicle: list[bytes] = field(default_factory=list)
    to_air: list[bytes] = field(default_factory=list)
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


class Engine:
    """Fed with datagrams, asked once a step.

    Attributes:
        config: As given.
        rung: State of the failsafe ladder, and why.
        goal: Where to go now.
        telemetry: Own state and autopilot.
        picture: Traffic.
        setpoints: The stream of setpoints.
        fatal: Decisions failed again and again: whoever runs the engine should hold and end.
    """

    def __init__(self, config: EngineConfig) -> None:
        self.config = config
        self.goal = config.goal
        self.rung = Rung()
        if config.goal is not None and not config.standby:
            self.rung = request(self.rung)
        self.telemetry = OwnShipTelemetry(config.vehicle_sysid, filtered=config.filter_positions)
        self.picture = TrafficPicture(
            PictureSettings(
                unknown_error_m=UNKNOWN_ERROR_BOUND_M,
                unusable_error_m=ERROR_CAP_M,
                unknown_speed_mps=UNKNOWN_SPEED_MPS,
                filtered=config.filter_positions,
                own_height_m=config.height_m,
                vertical_horizon_s=config.halfplane.horizon_s,
                all_heights=config.vertical_avoidance,
            )
        )
        self.setpoints = SetpointStream(config.limits)
        self.fatal = False
        self.last_error = ""
        self._counters: Counter[str] = Counter()
        self._assemblers = {"vehicle": ReportAssembler(), "rid": ReportAssembler()}
        self._decider = Decider(config)
        self._climber = Climber(config) if config.vertical_avoidance else None
        self._uas_id = config.uas_id.encode() if config.uas_id else None
        self._encoder = Encoder(config.vehicle_sysid or 1, AVOIDANCE_COMPONENT)
        self._replies: list[tuple[bytes, Hashable]] = []
        self._started_s: float | None = None
        self._last_step_s: float | None = None
        self._reports = 0
        self._failures: deque[float] = deque(maxlen=FATAL_FAILURES)
        self._decision_time_s = 0.0
        self._heartbeat_due = Periodic(1.0)
        self._status_due = Periodic(1.0)
        self._request_due = Periodic(1.0)
        self._detection_due = Periodic(1.0)
        self._detection_watch = DetectionWatch()
        self._detection: DetectionRange | None = None
        self._warned_at_s: dict[TrackKey, float] = {}

    # --- in -------------------------------------------------------------------------------------------------------

    @property
    def vehicle_source(self) -> Hashable:
        """Address of the autopilot that is listened to; None before one was heard."""
        return self.telemetry.lock.source if self.telemetry.lock else None

    def receive_vehicle(
        self, datagram: bytes, now_s: float, *, source: Hashable = None, utc_s: float | None = None
    ) -> None:
        """Take a datagram of the vehicle link: telemetry, commands to us, and Remote ID that receivers relay.

        Args:
            datagram: Bytes.
            now_s: Monotonic time.
            source: Who sent it.
            utc_s: UTC now, for the age of Remote ID reports.
        """
        for frame, message in self._messages(datagram):
            if message.name in REMOTE_ID_NAMES:
                self._vehicle_remote_id(frame, message, source, now_s, utc_s)
            elif message.name in ("COMMAND_LONG", "COMMAND_INT"):
                self._command(frame, message, source, now_s)
            else:
                self.telemetry.receive(frame.sysid, frame.compid, message, now_s, source)
        lock = self.telemetry.lock
        if lock is not None and self._encoder.sysid != lock.sysid:
            self._encoder = Encoder(lock.sysid, AVOIDANCE_COMPONENT)

    def receive_remote_id(self, datagram: bytes, source: Hashable, now_s: float, *, utc_s: float | None = None) -> None:
        """Take a datagram of the Remote ID link. Nothing in it can change anything but tracks.

        Args:
            datagram: Bytes.
            source: Who sent it.
            now_s: Monotonic time.
            utc_s: UTC now, for the age of reports.
        """
        messages = self._messages(datagram)
        # LOCATION last here as well: see `_remote_id_parts`.
        messages.sort(key=lambda each: each[1].name == LOCATION)
        for frame, message in messages:
            if message.name in REMOTE_ID_NAMES:
                for part in self._remote_id_parts(message):
                    self._remote_id("rid", frame, part, now_s, utc_s)

    def _messages(self, datagram: bytes) -> list[tuple[Frame, Message]]:
        """What of a datagram concerns us; everything else is counted by cause."""
        taken: list[tuple[Frame, Message]] = []
        for found in parse_datagram(datagram, CRC_EXTRAS):
            if isinstance(found, BadFrame):
                self._counters[found.cause] += 1
            elif not found.checked:
                self._counters["unknown_message"] += 1
            elif found.version != 2:
                self._counters["mavlink_1_frame"] += 1
            elif found.msgid in MESSAGE_IDS:
                taken.append((found, decode_message(found)))
        return taken

    def _vehicle_remote_id(
        self, frame: Frame, message: Message, source: Hashable, now_s: float, utc_s: float | None
    ) -> None:
        """Remote ID on the vehicle link: others, as receivers relay them, or the vehicle about itself."""
        lock = self.telemetry.lock
        itself = lock is not None and lock.sysid == frame.sysid and lock.source == source
        for part in self._remote_id_parts(message):
            if not (itself and part.id_or_mac is None):
                self._remote_id("vehicle", frame, part, now_s, utc_s)
            elif isinstance(part, BasicId) and part.uas_id and self.config.uas_id is None:
                self._uas_id = part.uas_id

    def _remote_id_parts(self, message: Message) -> list[RemoteIdMessage]:
        # LOCATION last, of a pack, too: with its RIDLINK_SEPARATION before it, it makes one report instead of two.
        return sorted(messages_of(message, self._counters), key=lambda each: isinstance(each, Location))

    def _remote_id(self, link: str, frame: Frame, part: RemoteIdMessage, now_s: float, utc_s: float | None) -> None:
        lock = self.telemetry.lock
        sysid = lock.sysid if lock else self.config.vehicle_sysid
        if sysid is None:  # who cannot tell its own reports from others' would avoid itself
            self._counters["heard_before_the_vehicle"] += 1
            return
        report = self._assemblers[link].receive((frame.sysid, frame.compid), part, now_s)
        if isinstance(part, Location):
            self._reports += 1
        if report is not None:
            self.picture.receive(link, report, utc_s=utc_s, own_sysid=sysid, own_uas_id=self._uas_id)

    def _command(self, frame: Frame, message: Message, source: Hashable, now_s: float) -> None:
        """A command to this component: DO_REPOSITION sets a goal and is an operator's request."""
        lock = self.telemetry.lock
        if lock is None or message.target_system != lock.sysid or message.target_component != AVOIDANCE_COMPONENT:
            return
        if _host(source) != _host(lock.source):
            self._counters["foreign_command"] += 1
            return
        if len(self._replies) == MOST_REPLIES:
            self._counters["command_refused"] += 1
            return
        result = UNSUPPORTED
        if message.command == DO_REPOSITION:
            own = self.telemetry.state(now_s)
            goal = repositioned(message, None if own is None else own.home_altitude_m, self.config.failsafe)
            result = DENIED if goal is None else ACCEPTED
            if goal is not None:
                self.goal = goal
                self.rung = request(self.rung)
                self._begin_leg()
        ack = acknowledged(self._encoder, message, result, frame.sysid, frame.compid)
        self._replies.append((ack, source))

    def _begin_leg(self) -> None:
        self._decider.begin_leg()
        if self._climber is not None:
            self._climber.begin_leg()

    # --- out ------------------------------------------------------------------------------------------------------

    def step(self, now_s: float) -> StepOutput:
        """Decide, and say what to send.

        Args:
            now_s: Monotonic time; must not go back.
        """
        if self._started_s is None:
            self._started_s = now_s
        since_last = 0.0 if self._last_step_s is None else now_s - self._last_step_s
        self._last_step_s = now_s
        self.picture.drop_silent(now_s)
        own = self.telemetry.state(now_s)
        before = self.rung.state
        self.rung = advance(self.rung, self._conditions(own, now_s, since_last), self.config.failsafe)
        record = DecisionRecord(now_s, self.rung.state, own, len(self.picture))
        if own is not None:
            record = self._look_and_decide(record, own, now_s)
        elif self.rung.stream is Stream.ZERO:
            record = replace(record, commanded_ned_mps=STOP)
        if self.rung.state is State.ENGAGED and before is not State.ENGAGED and before is not State.HOLD:
            self._begin_leg()
        output = StepOutput(record)
        if record.commanded_ned_mps is not None:
            output.to_vehicle.append(self._setpoint(record.commanded_ned_mps, now_s))
            output.decision = replace(record, commanded_ned_mps=self.setpoints.velocity)
        else:
            self.setpoints.restart()
        self._announce(output, now_s)
        return output

    def stop(self, now_s: float) -> list[bytes]:
        """Three zero setpoints for the end, 50 ms apart by their time stamps; none if nothing was being streamed."""
        if self.rung.state not in (State.ENGAGED, State.HOLD):
            return []
        self.rung = Rung(State.STANDBY, False, Stream.NOTHING, "ended")
        return [self._setpoint(STOP, now_s + 0.05 * k) for k in range(3)]

    def note_decision_time(self, seconds: float) -> None:
        """How long the last step took to compute, for RIDLINK_STATUS; the engine itself reads no clock."""
        self._decision_time_s = seconds

    @property
    def counters(self) -> Counter[str]:
        """Everything that was dropped, clamped, rejected or noticed, by cause."""
        parts = (self._counters, self.telemetry.counters, self.picture.counters, self.setpoints.counters)
        return sum(parts, Counter())

    def summary(self) -> EngineSummary:
        """Totals so far."""
        return EngineSummary(
            setpoints=self.setpoints.sent,
            reports_received=self._reports,
            rejects=dict(self.counters),
            tracks=len(self.picture),
            state=self.rung.state.name.lower(),
            reason=self.rung.reason,
            infeasible_steps=self._decider.infeasible,
        )

    def _conditions(self, own: OwnState | None, now_s: float, since_last_s: float) -> Conditions:
        telemetry = self.telemetry
        return Conditions(
            autopilot_heard_s=telemetry.heard_s(now_s),
            own_state_age_s=telemetry.age_s(now_s),
            armed=telemetry.armed,
            external_mode=telemetry.external_mode,
            ready=telemetry.ready,
            wants_stream=telemetry.wants_stream,
            rebooted=telemetry.take_reboot(),
            latitude_deg=own.position.latitude_deg if own is not None else 0.0,
            since_last_step_s=since_last_s,
            has_goal=self.goal is not None,
            deciding_fails=self.fatal,
        )

    def _look_and_decide(self, record: DecisionRecord, own: OwnState, now_s: float) -> DecisionRecord:
        """The traffic of this instant and, where one may be flown, the velocity."""
        streaming = self.rung.stream is not Stream.NOTHING
        commanded = STOP if streaming else None
        try:
            everybody = self.picture.snapshot(own, now_s)
            snapshot = everybody.at_our_height()
            traffic, seen = self._decider.traffic(own, snapshot)
            detection = self._detection_range(own, snapshot, now_s)
            record = replace(self._decider.seen(record, snapshot, seen), detection=detection)
            if self.rung.stream is not Stream.DECISION or self.goal is None:
                return replace(record, commanded_ned_mps=commanded)
            record = self._decider.decide(record, self.goal, own, self.setpoints.velocity, snapshot, traffic, now_s)
            if self._climber is None:
                return record
            return self._climber.climb(
                record,
                own,
                everybody,
                self._decider,
                last_down_mps=self.setpoints.velocity[2],
                identity=(self._encoder.sysid, self._uas_id),
            )
        except Exception as error:  # a fault here must become a hold, never a missing setpoint
            self._counters["decision_failed"] += 1
            self.last_error = f"{type(error).__name__}: {error}"
            self._failures.append(now_s)
            if len(self._failures) == FATAL_FAILURES and now_s - self._failures[0] <= FATAL_WITHIN_S:
                self.fatal = True
            return replace(record, commanded_ned_mps=commanded)

    def _detection_range(self, own: OwnState, snapshot: Snapshot, now_s: float) -> DetectionRange | None:
        """From how far neighbours must be heard and are heard, as of the last full second."""
        if self._detection_due.due(now_s):
            telemetry, lock = self.telemetry, self.telemetry.lock
            self._detection_watch.hear(self.picture.tracks.values(), telemetry.armed and telemetry.ready, now_s)
            reaction = reaction_of(lock.autopilot if lock else None, self.config.limits.acceleration_mps2)
            needed_m = self._decider.needed_range_m(own, snapshot, reaction)
            self._detection = self._detection_watch.judge(needed_m, len(snapshot) > 0)
        return self._detection

    # --- frames ---------------------------------------------------------------------------------------------------

    def _time_boot_ms(self, now_s: float) -> int:
        return int((now_s - (self._started_s or 0.0)) * 1e3) & 0xFFFFFFFF

    def _setpoint(self, velocity: Velocity, now_s: float) -> bytes:
        lock = self.telemetry.lock
        target = lock.sysid if lock is not None else 0
        time_boot_ms = self._time_boot_ms(now_s)
        return self.setpoints.next(self._encoder, velocity, time_boot_ms, target, AUTOPILOT_COMPONENT)

    def _announce(self, output: StepOutput, now_s: float) -> None:
        """Everything but setpoints."""
        vehicle, encoder, record = output.to_vehicle, self._encoder, output.decision
        lock = self.telemetry.lock
        output.replies, self._replies = self._replies, []
        if self._heartbeat_due.due(now_s):
            vehicle.append(heartbeat(encoder, self.rung.state is State.ENGAGED))
            # The air listens to whoever says which vehicle it is: not before that is known.
            if lock is not None or self.config.vehicle_sysid is not None:
                output.to_air.append(vehicle[-1])
        if lock is None:
            return
        if self._status_due.due(now_s):
            vehicle.append(status(encoder, record, self._time_boot_ms(now_s), self._decision_time_s))
        telemetry = self.telemetry
        silent = telemetry.position_silent_s(now_s) > 1.0 or telemetry.receiver_silent_s(now_s) > 5.0
        if silent and telemetry.heard_s(now_s) < 3.0 and self._request_due.due(now_s):
            vehicle.extend(message_requests(encoder, lock.sysid))
        if telemetry.armed:
            vehicle.extend(self._collisions(record, now_s))
        if record.detection is not None and (text := self._detection_watch.warning(record.detection, now_s)):
            output.warnings.append(text)
            vehicle.append(warning(encoder, text))

    def _collisions(self, record: DecisionRecord, now_s: float) -> list[bytes]:
        """COLLISION once a second for each of the most urgent conflicts."""
        self._warned_at_s = {key: at for key, at in self._warned_at_s.items() if now_s - at < COLLISION_PERIOD_S}
        due = [c for c in record.conflicts[:MOST_COLLISIONS] if c.track.key not in self._warned_at_s]
        self._warned_at_s.update((conflict.track.key, now_s) for conflict in due)
        return [collision(self._encoder, conflict, record.state) for conflict in due]


def _host(source: Hashable) -> Hashable:
    """The machine behind an address of a link."""
    return source[0] if isinstance(source, tuple) and source else source
