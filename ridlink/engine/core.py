"""One own-ship and its goal, without input or output: bytes and times in, bytes out.

Datagrams go in as they come; `step` is called every 100 ms and returns what to send. No clock is read and no socket
opened here, so the same engine runs in the daemon, in tests in virtual time, and on recordings.

Axes: north, east, down about the present own position; metres, m/s, seconds of the caller's monotonic clock.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import replace

from ridlink.engine.announce import AVOIDANCE_COMPONENT
from ridlink.engine.announcer import Announcer
from ridlink.engine.commands import MOST_REPLIES, acknowledged, answered
from ridlink.engine.config import EngineConfig
from ridlink.engine.decision import DecisionRecord, EngineSummary, StepOutput
from ridlink.engine.guard import Commands, Guard, Phase, Seen
from ridlink.engine.guarding import ended, goal_ahead, resting, seen_by_guard
from ridlink.engine.hearing import Hearing
from ridlink.engine.intake import VEHICLE_IDS, Intake
from ridlink.engine.steering import Steering
from ridlink.engine.takeoff import interruptible
from ridlink.engine.unheard import Unheard
from ridlink.failsafe import STEERING, Conditions, Rung, State, Stream, advance, request
from ridlink.mavlink.codec import Encoder, Message
from ridlink.mavlink.frames import Frame
from ridlink.own_ship import AUTOPILOT_COMPONENT, OwnShipTelemetry
from ridlink.own_ship.broadcast import Broadcast
from ridlink.own_ship.requests import command
from ridlink.own_ship.rival import Rivals
from ridlink.remote_id.bridge import REMOTE_ID_IDS
from ridlink.setpoint import STOP, SetpointStream, Velocity
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.picture import TrafficPicture

LAST_WORDS = 3
"""How often the last setpoint, and the commands of a guard that hands back, are sent: one may be lost."""


class Engine:
    """The engine of one own-ship. Feed it with datagrams, and call `step` every 100 ms.

    Attributes:
        config: Configuration, as given.
        rung: State of the failsafe ladder, and why.
        goal: Where to go now.
        telemetry: Own state, and state of the autopilot.
        picture: Traffic.
        setpoints: The stream of setpoints.
        rivals: Claims of other daemons on this vehicle.
        unheard: Why no autopilot is heard.
        steering: Makes the decisions.
        encoder: Encoder of our messages to the vehicle, with its system id and the component id of obstacle avoidance.
        air_encoder: The same for the Remote ID link: each link counts its own messages, so that receivers see no loss.
        transmitter_encoder: The same for the own Remote ID: that of the air, unless its transmitter has another link.
        guard: Takes over from the autopilot's own plan; None without `--guard`.
        warm: Whether decisions can be made in time; they cannot while kernels are being compiled.
    """

    def __init__(self, config: EngineConfig) -> None:
        self.config = config
        self.goal = config.goal
        self.rung = Rung()
        if config.goal is not None and not config.standby:
            self.rung = request(self.rung)
        self.telemetry = OwnShipTelemetry(config.vehicle_sysid, filtered=config.filter_positions)
        self.picture = TrafficPicture(config.picture_settings)
        self.setpoints = SetpointStream(config.limits)
        self._counters: Counter[str] = Counter()
        self.steering = Steering(config, self.picture, self.telemetry)
        self._speak_as(config.vehicle_sysid or 1)
        self._answers: list[tuple[Message, int, Frame, Hashable]] = []
        self._started_s: float | None = None
        self._last_step_s: float | None = None
        self._intake = Intake(allow_v1=config.allow_v1)
        self._air_intake = Intake(allow_v1=config.allow_v1)
        self._hearing = Hearing(config, self._air_intake, self.telemetry, self.picture)
        self.unheard = Unheard(self._intake, self.telemetry)
        self._announcer = Announcer(broadcasts=config.broadcast)
        self._broadcast = Broadcast(config.broadcast_settings) if config.broadcast else None
        self._hold_next = False
        self.rivals = Rivals()
        self.warm = True
        self.guard = Guard() if config.guard else None
        self._plan_mps = 0.0
        if self.guard is not None:
            self.rung = resting(self.guard)
        self._last_record: DecisionRecord | None = None

    # --- in -------------------------------------------------------------------------------------------------------

    @property
    def vehicle_source(self) -> Hashable:
        """Address of the autopilot that is listened to; None before one is heard."""
        return self.telemetry.lock.source if self.telemetry.lock else None

    def receive_vehicle(
        self, datagram: bytes, now_s: float, *, source: Hashable = None, utc_s: float | None = None
    ) -> None:
        """Take a datagram of the vehicle link: telemetry, commands to us, and Remote ID that receivers relay.

        Args:
            datagram: Bytes.
            now_s: Monotonic time.
            source: Address of the sender.
            utc_s: UTC now, for the age of Remote ID reports.
        """
        for frame, message in self._intake.messages(datagram, VEHICLE_IDS):
            if frame.msgid in REMOTE_ID_IDS:
                self._hearing.receive_vehicle(frame, message, source, now_s, utc_s)
            elif message.name in ("COMMAND_LONG", "COMMAND_INT"):
                self._command(frame, message, source, now_s)
            elif message.name == "HEARTBEAT" and frame.compid == AVOIDANCE_COMPONENT:
                if (lock := self.telemetry.lock) is not None and (lock.sysid, lock.source) == (frame.sysid, source):
                    self.rivals.hear(message.custom_mode, now_s)
            else:
                self.telemetry.receive(frame.sysid, frame.compid, message, now_s, source)
        lock = self.telemetry.lock
        if lock is not None and self.encoder.sysid != lock.sysid:
            self._speak_as(lock.sysid)

    def _speak_as(self, sysid: int) -> None:
        self.encoder, self.air_encoder, apart, withheld = (Encoder(sysid, AVOIDANCE_COMPONENT) for _ in range(4))
        self.transmitter_encoder = apart if self.config.broadcast_apart else self.air_encoder
        self._steering_encoder = withheld if self.config.dry_run else self.encoder

    def receive_remote_id(
        self, datagram: bytes, now_s: float, *, source: Hashable = None, utc_s: float | None = None
    ) -> None:
        """Take a datagram of the Remote ID link. Nothing in it can change anything but tracks.

        Args:
            datagram: Bytes.
            now_s: Monotonic time.
            source: Address of the sender: a flood of one leaves room for the others.
            utc_s: UTC now, for the age of reports.
        """
        self._hearing.receive_air(datagram, source, now_s, utc_s)

    def _command(self, frame: Frame, message: Message, source: Hashable, now_s: float) -> None:
        """Take a command to this component: DO_REPOSITION sets a goal and is an operator's request."""
        lock = self.telemetry.lock
        if lock is None or message.target_system != lock.sysid or message.target_component != AVOIDANCE_COMPONENT:
            return
        if _host(source) != _host(lock.source):
            self._counters["foreign_command"] += 1
            return
        if len(self._answers) == MOST_REPLIES:
            self._counters["command_refused"] += 1
            return
        own = self.telemetry.state(now_s)
        answer = answered(message, own, self.config.failsafe, guarding=self.guard is not None)
        if answer.engages_guard and self.guard is not None and self.guard.engage():
            self.rung = resting(self.guard)
        if answer.goal is not None:
            self.goal = answer.goal
            self.rung = request(self.rung)
            self.steering.begin_leg()
        self._answers.append((message, answer.result, frame, source))

    # --- out ------------------------------------------------------------------------------------------------------

    def step(self, now_s: float, *, utc_s: float | None = None) -> StepOutput:
        """Decide, and say what to send.

        Args:
            now_s: Monotonic time; must not go back.
            utc_s: UTC now, for the own Remote ID and for turns in a jam.

        Raises:
            ValueError: If `now_s` is not finite.
        """
        if not math.isfinite(now_s):
            raise ValueError(f"now_s must be finite, got {now_s}")
        if self._started_s is None:
            self._started_s = now_s
        since_last = 0.0 if self._last_step_s is None else now_s - self._last_step_s
        self._last_step_s = now_s
        self.picture.drop_silent(now_s)
        own = self.telemetry.state(now_s)
        if own is None:
            self.picture.forget_own_state()
        before = self.rung.state
        commands = [] if self.guard is None else self._watch(self.guard, own, now_s)
        self.rung = advance(self.rung, self._conditions(own, now_s, since_last), self.config.failsafe)
        self._hold_next = False
        self.rivals.steer(self.rung.state in STEERING and not self.config.dry_run, utc_s)
        record = self._last_record = self._decided(own, now_s, since_last, utc_s)
        if self.rung.state is State.ENGAGED and before not in STEERING:
            self.steering.begin_leg()
        output = StepOutput(record, to_vehicle=commands)
        if record.commanded_ned_mps is not None:
            output.to_vehicle.append(self._setpoint(record.commanded_ned_mps, now_s))
            output.decision = replace(record, commanded_ned_mps=self.setpoints.velocity)
        else:
            self.setpoints.restart()
        self._watch_writers(output.decision.commanded_ned_mps, now_s)
        if text := self.steering.detection_warning(record):
            output.warnings.append(text)
        self._announcer.announce(
            output,
            self.encoder,
            self.air_encoder,
            self.transmitter_encoder,
            self.telemetry,
            state=self.rung.state,
            rivals=self.rivals,
            time_boot_ms=self.time_boot_ms(now_s),
            count=lambda: self.counters,
            now_s=now_s,
        )
        answers, self._answers = self._answers, []
        for message, result, frame, source in answers:
            output.replies.append((acknowledged(self.encoder, message, result, frame.sysid, frame.compid), source))
        if self._broadcast is not None:
            self._transmit(self._broadcast, output, now_s, utc_s)
        return output

    def _decided(self, own: OwnState | None, now_s: float, since_last_s: float, utc_s: float | None) -> DecisionRecord:
        """The record with what is seen and, if one may be flown, the velocity; without an own position zero at most."""
        record = DecisionRecord(now_s, self.rung.state, own, len(self.picture))
        if own is None:
            return replace(record, commanded_ned_mps=STOP) if self.rung.stream is Stream.ZERO else record
        self._counters["goal_below_home"] += self.goal is not None and self.goal.is_below(own.home_altitude_m)
        return self.steering.look_and_decide(
            record,
            own,
            stream=self.rung.stream,
            goal=self.goal,
            last=self.setpoints.velocity,
            identity=(self.encoder.sysid, self._hearing.names.uas_id),
            since_last_s=since_last_s,
            utc_s=utc_s,
            resumed_mps=self._resumed_mps,
        )

    def _watch_writers(self, sent: Velocity | None, now_s: float) -> None:
        """Count steps in which others steer, or the vehicle does not hear us; `sent` is None if nothing is sent."""
        writer = self.telemetry.other_writer
        if self.rung.state in STEERING:
            self._counters["other_writer"] += writer.contested(now_s) or self.rivals.gives_way(now_s)
            self._counters["setpoints_unheard"] += writer.unheard(now_s)
        writer.sent(None if self.config.dry_run else sent, now_s)

    def _transmit(self, broadcast: Broadcast, output: StepOutput, now_s: float, utc_s: float | None) -> None:
        """Add the own Remote ID, with the velocity that was sent in this step."""
        telemetry = self.telemetry
        steers = telemetry.external_mode and not self.config.dry_run
        output.broadcasts = broadcast.datagrams(
            self.transmitter_encoder,
            telemetry,
            now_s=now_s,
            utc_s=utc_s,
            uas_id=self._hearing.names.uas_id,
            id_type=self._hearing.names.id_type,
            commanded=output.decision.commanded_ned_mps if steers else None,
            avoiding=self.rung.state is State.ENGAGED and steers,
        )

    def _watch(self, guard: Guard, own: OwnState | None, now_s: float) -> list[bytes]:
        """Ask the guard; returns the commands that it wants to send."""
        if self.telemetry.lock is None:
            return []
        if own is not None and guard.phase is Phase.WATCHING:
            self._plan_mps = min(max(self._plan_mps, own.speed_mps), self.config.cruise_mps)
        wish = guard.step(self._seen_by_guard(own, now_s), now_s)
        if wish.begin and own is not None:
            self.goal = goal_ahead(own, paused=guard.found_paused)
            self.rung = request(Rung())
        if wish.end or guard.phase is Phase.WATCHING:
            self.rung = resting(guard)
        self._counters["mode_not_given"], self._counters["pause_kept"] = guard.refused, guard.pauses_kept
        return self._commands(wish.commands)

    @property
    def _resumed_mps(self) -> float | None:
        """Highest speed at which the plan was flown, if it goes on to the goal once the guard hands back."""
        leads_on = self.guard is not None and self.goal is not None and self.goal.speed_mps is not None
        return self._plan_mps if leads_on else None

    def _seen_by_guard(self, own: OwnState | None, now_s: float) -> Seen:
        return seen_by_guard(self.config, self.telemetry, own, self.rung, self._last_record, now_s)

    def stop(self, now_s: float) -> list[bytes]:
        """Three zero setpoints for the end, 50 ms apart by their time stamps; none if nothing was being streamed.

        A guard that has taken over, or asked to, hands back what it found, and its commands are sent three times as
        well: nobody will be there to repeat them.
        """
        frames: list[bytes] = []
        wanted: Commands = ()
        lock = self.telemetry.lock
        if self.guard is not None and lock is not None:
            wanted = self.guard.hand_back(self._seen_by_guard(self.telemetry.state(now_s), now_s))
        if self.rung.state in STEERING:
            frames = [self._setpoint(STOP, now_s + 0.05 * k) for k in range(LAST_WORDS)]
        if lock is not None and (frames or wanted):
            self.rung = ended(lock.autopilot, asked=bool(wanted), dry_run=self.config.dry_run)
        return frames + self._commands(LAST_WORDS * wanted)

    def note_decision_time(self, seconds: float) -> None:
        """Note how long the last step took to compute, for RIDLINK_STATUS; the engine itself reads no clock."""
        self._announcer.decision_time_s = seconds

    @property
    def fatal(self) -> bool:
        """Whether decisions failed again and again: the caller should hold and end."""
        return self.steering.fatal

    @property
    def last_error(self) -> str:
        """Error of the last decision that failed."""
        return self.steering.last_error

    def hold_next(self) -> None:
        """Hold in the next step, whatever is decided: the loop stood still."""
        self._hold_next = True

    @property
    def counters(self) -> Counter[str]:
        """Counts of everything that was dropped, clamped, rejected or noticed, by cause."""
        intakes = self._intake, self._air_intake
        parts = (*intakes, self.steering, self._hearing, self.telemetry, self.picture, self.setpoints)
        return sum((part.counters for part in parts), self._counters)

    @property
    def setpoints_sent(self) -> int:
        """Number of setpoints so far; 0 in a dry run, which sends none."""
        return 0 if self.config.dry_run else self.setpoints.sent

    def summary(self) -> EngineSummary:
        """Totals so far."""
        return EngineSummary(
            setpoints=self.setpoints_sent,
            reports_received=self._hearing.reports,
            rejects=dict(self.counters),
            tracks=len(self.picture),
            state=self.rung.state.name.lower(),
            reason=self.rung.reason,
            infeasible_steps=self.steering.decider.infeasible,
        )

    def _conditions(self, own: OwnState | None, now_s: float, since_last_s: float) -> Conditions:
        telemetry = self.telemetry
        return Conditions(
            autopilot_heard_s=telemetry.heard_s(now_s),
            own_state_age_s=telemetry.age_s(now_s),
            armed=telemetry.armed,
            external_mode=telemetry.external_mode,
            obeying_s=telemetry.obeying_s(now_s),
            ready=interruptible(self.config, telemetry, own, self._last_record),
            wants_stream=telemetry.wants_stream,
            rebooted=telemetry.take_reboot(),
            latitude_deg=own.position.latitude_deg if own is not None else 0.0,
            since_last_step_s=since_last_s,
            stalled=self._hold_next,
            warming=not self.warm,
            own_jumped=telemetry.jumped(now_s),
            on_ground=telemetry.on_ground,
            other_writer=not self.config.dry_run and self._must_yield(now_s),
            unheard=telemetry.other_writer.must_give_up(now_s),
            has_goal=self.goal is not None,
            goal_away_m=0.0 if self.goal is None or own is None else self.goal.away_m(own.position),
            deciding_fails=self.steering.fatal,
        )

    def _must_yield(self, now_s: float) -> bool:
        """Whether another writer steers this vehicle and has precedence."""
        if self.rivals.must_yield(now_s):
            return True
        if self.rivals.gives_way(now_s):
            self.telemetry.other_writer.forget()
        return self.telemetry.other_writer.must_yield(now_s)

    # --- frames ---------------------------------------------------------------------------------------------------

    def time_boot_ms(self, now_s: float) -> int:
        """Time since the first step [ms]; frames have it modulo 2**32."""
        return int((now_s - (self._started_s or 0.0)) * 1e3)

    def _commands(self, wanted: Commands) -> list[bytes]:
        lock = self.telemetry.lock
        target = lock.sysid if lock is not None else 0
        return [command(self._steering_encoder, number, parameters, target) for number, parameters in wanted]

    def _setpoint(self, velocity: Velocity, now_s: float) -> bytes:
        lock = self.telemetry.lock
        target = lock.sysid if lock is not None else 0
        time_boot_ms = self.time_boot_ms(now_s)
        return self.setpoints.next(self._steering_encoder, velocity, time_boot_ms, target, AUTOPILOT_COMPONENT)


def _host(source: Hashable) -> Hashable:
    """Host of an address of a link."""
    return source[0] if isinstance(source, tuple) and source else source
