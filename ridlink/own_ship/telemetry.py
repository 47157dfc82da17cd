"""Own state from the telemetry of one autopilot: where we are, how wrong that may be, and in which mode.

Positions WGS-84, altitudes above mean sea level (GLOBAL_POSITION_INT) and, if the receiver sends it, above the
ellipsoid; velocities north-east-down in m/s; errors three standard deviations. Times are the caller's monotonic clock.

Both autopilots forward heartbeats of others, and anybody can send to a listening port. So only the first autopilot
heard (system id, component 1, autopilot type, address) counts, until it has been silent for three seconds.

A fresh position proves nothing: it may be invalid, see `trust`; it may have jumped, see `jump`; and it may have just
come and be old, see `lateness`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass

from ridlink.failsafe import HEARTBEAT_LOST_S
from ridlink.geodesy import Geodetic, offset_m
from ridlink.mavlink.codec import Message
from ridlink.own_ship.grave_words import GraveWords
from ridlink.own_ship.jump import JumpWatch
from ridlink.own_ship.lateness import Lateness
from ridlink.own_ship.other_writer import OtherWriter
from ridlink.own_ship.rhythm import Rhythm
from ridlink.own_ship.trust import NavigationTrust
from ridlink.separation.reference import ERROR_CAP_M
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.position_filter import PositionFilter
from ridlink.units import deg_from_dege7, m_from_mm, mps_from_cmps

AUTOPILOT_COMPONENT = 1
ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT_ARDUPILOTMEGA and MAV_AUTOPILOT_PX4."""
ARDUPILOT_GUIDED = 4
PX4_OFFBOARD_MAIN_MODE = 6
ARMED_FLAG = 128
MULTIROTORS = frozenset((0, 2, 3, 4, 13, 14, 15, 29, 35, 43))
"""MAV_TYPE of vehicles that can stop and hover: multirotors and helicopters, and generic (0), which a PX4 calls itself
if its frame sets no type; one with wings does set it. Numbers of modes are those of an ArduPilot Copter: its GUIDED (4)
is ACRO for a Plane and HOLD for a Rover, and its AUTO (3) is TRAINING, flown by a pilot."""
MISSION_PAUSED = 4
"""MISSION_STATE."""
LANDED_ON_GROUND, LANDED_TAKEOFF = 1, 3
"""MAV_LANDED_STATE."""

INFLATE_AFTER_S = 0.3
LONGEST_AGE_S = 10.0
"""A position older than this says nothing about where we are."""
LANDED_STATE_VALID_S = 5.0
"""EXTENDED_SYS_STATE comes once or twice a second."""
CLOCK_BACK_MS = 1000
"""time_boot_ms back by more is a restart of the autopilot; by less, a datagram that overtook another."""
CLOCK_ROUND_MS = 1 << 32
NEARLY_ROUND_MS = CLOCK_ROUND_MS - 60_000
"""The clock wraps after 50 days; a difference of nearly this much, within a minute of that, is none."""


@dataclass(frozen=True, slots=True)
class AutopilotLock:
    """The autopilot that is listened to."""

    sysid: int
    autopilot: int
    source: Hashable


class OwnShipTelemetry:
    """Takes the messages of the vehicle link, and gives the own state.

    Args:
        sysid: Only this system id is taken as the vehicle; without it, the first autopilot heard.
        filtered: Smooth the reported positions, see `PositionFilter`.

    Attributes:
        lock: The autopilot that is listened to; None before the first heartbeat.
        pinned: The only system id that is taken; None for the first one heard.
        armed: Whether it is armed, by its last heartbeat.
        external_mode: Whether it is a multirotor in GUIDED or OFFBOARD, by its last heartbeat.
        custom_mode: Number of the mode, as the autopilot counts.
        mission_item: Sequence number of the item that is flown; None before it is told.
        mission_paused: Whether the mission is told to be paused, in the present mode; so PX4 calls all that it does not
            fly.
        vehicle_type: MAV_TYPE of its heartbeat.
        home: Take-off position of HOME_POSITION, altitude above mean sea level; None before that is told.
        trust: What receiver and estimator say of themselves.
        other_writer: Whether another writer steers as well.
        words: Grave texts of the autopilot.
        counters: `foreign_autopilot`, `own_position_unusable`, `own_position_untrusted`, `own_position_late`,
            `own_position_jump`, `own_position_delayed`, `own_height_implausible`,
            `autopilot_restart`, `no_multirotor`, `vehicle_text_left_out`.
    """

    def __init__(self, sysid: int | None = None, *, filtered: bool = True) -> None:
        self.counters: Counter[str] = Counter()
        self.lock: AutopilotLock | None = None
        self.armed = False
        self.external_mode = False
        self.pinned = sysid
        self._filtered = filtered
        self._forget()

    def _forget(self) -> None:
        self.armed = self.external_mode = False
        self.custom_mode = 0
        self.mission_item: int | None = None
        self.mission_paused = False
        self.vehicle_type = 0
        self.home: Geodetic | None = None
        self.trust = NavigationTrust()
        self.other_writer = OtherWriter()
        self.words = GraveWords(self.counters)
        self._heartbeat_at_s = -math.inf
        self._obeying_since_s = math.inf
        self._landed_state = 0
        self._landed_told_at_s = -math.inf
        self._rebooted = False
        self._position_heard_at_s = -math.inf
        self._positions = Rhythm()
        self._clock_ms: int | None = None
        self._rounds_ms = 0
        self._lateness = Lateness()
        self._jumps = JumpWatch()
        self._filter = PositionFilter() if self._filtered else PositionFilter(time_constant_s=0.0)
        self._altitude_m = self._home_altitude_m = 0.0
        self._velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self._trusted_at_s = -math.inf

    # --- in -------------------------------------------------------------------------------------------------------

    def receive(self, sysid: int, compid: int, message: Message, now_s: float, source: Hashable = None) -> None:
        """Take one message of the vehicle link.

        Args:
            sysid: System id of the frame.
            compid: Component id of the frame.
            message: What it carried.
            now_s: Monotonic time.
            source: Address that it came from.
        """
        if compid != AUTOPILOT_COMPONENT:
            return
        if message.name == "HEARTBEAT" and message.autopilot in (ARDUPILOT, PX4):
            self._heartbeat(sysid, message, now_s, source)
            return
        lock = self.lock
        if lock is None or lock.sysid != sysid or lock.source != source:
            return
        match message.name:
            case "GLOBAL_POSITION_INT":
                self._position(message, now_s)
            case "LOCAL_POSITION_NED":
                self._local(message)
            case "GPS_RAW_INT":
                self.trust.receiver(message, now_s)
                if message.alt_ellipsoid and self.trust.undulation_m is None:
                    self.counters["own_height_implausible"] += 1
            case "ESTIMATOR_STATUS":
                self.trust.estimator(message.flags, message.pos_horiz_accuracy, now_s)
            case "EKF_STATUS_REPORT":
                self.trust.estimator(message.flags, 0.0, now_s)
            case "POSITION_TARGET_LOCAL_NED":
                if self.external_mode:
                    self.other_writer.receive(message, now_s, stands_unheard=lock.autopilot == ARDUPILOT)
            case "MISSION_CURRENT":
                self.mission_item, self.mission_paused = message.seq, message.mission_state == MISSION_PAUSED
            case "EXTENDED_SYS_STATE":
                self._landed_state, self._landed_told_at_s = message.landed_state, now_s
            case "HOME_POSITION":
                self._home(message)
            case "STATUSTEXT":
                self.words.receive(message, now_s)

    def _heartbeat(self, sysid: int, message: Message, now_s: float, source: Hashable) -> None:
        offered = AutopilotLock(sysid, message.autopilot, source)
        if self.pinned is not None and sysid != self.pinned:
            self.counters["foreign_autopilot"] += 1
            return
        if offered != self.lock:
            if self.lock is not None and now_s - self._heartbeat_at_s <= HEARTBEAT_LOST_S:
                self.counters["foreign_autopilot"] += 1
                return
            changed = self.lock is not None
            self._forget()
            self._rebooted = changed
            self.lock = offered
        self._heartbeat_at_s = now_s
        self.armed = bool(message.base_mode & ARMED_FLAG)
        self.mission_paused &= message.custom_mode == self.custom_mode
        self.custom_mode = message.custom_mode
        self.vehicle_type = message.type
        self.counters["no_multirotor"] += not self.is_multirotor
        if message.autopilot == PX4:
            external = (message.custom_mode >> 16) & 0xFF == PX4_OFFBOARD_MAIN_MODE
        else:
            external = message.custom_mode == ARDUPILOT_GUIDED
        self.external_mode = external and self.is_multirotor
        if not self.external_mode:
            self.other_writer.forget()
        obeys = self.armed and self.external_mode
        self._obeying_since_s = min(self._obeying_since_s, now_s) if obeys else math.inf

    def _in_order(self, time_boot_ms: int) -> bool:
        """Follow the autopilot's clock, kept in `_clock_ms`; False for a message that was overtaken."""
        before, now_ms = self._clock_ms, time_boot_ms + self._rounds_ms
        if before is not None and before - now_ms > NEARLY_ROUND_MS:
            self._rounds_ms += CLOCK_ROUND_MS
            now_ms += CLOCK_ROUND_MS
        elif before is not None and self._rounds_ms and now_ms - before > NEARLY_ROUND_MS:
            return False
        self._clock_ms = now_ms
        if before is None or now_ms >= before:
            return True
        if before - now_ms > CLOCK_BACK_MS:
            self._rebooted = True
            self._lateness.forget()
            self.counters["autopilot_restart"] += 1
            return True
        self._clock_ms = before
        return False

    def _position(self, message: Message, now_s: float) -> None:
        if not self._in_order(message.time_boot_ms):
            self.counters["own_position_late"] += 1
            return
        self._position_heard_at_s = now_s
        self._positions.hear(now_s)
        latitude, longitude = deg_from_dege7(message.lat), deg_from_dege7(message.lon)
        if (message.lat == 0 and message.lon == 0) or abs(latitude) > 90.0 or abs(longitude) > 180.0:
            self.counters["own_position_unusable"] += 1
            return
        late_s = self._late_s(now_s)
        if not self.trust.trusted:
            self.counters["own_position_untrusted"] += 1
            return
        velocity = (mps_from_cmps(message.vx), mps_from_cmps(message.vy), mps_from_cmps(message.vz))
        measured_at_s = now_s - late_s
        self._watch_for_jumps((latitude, longitude), velocity, measured_at_s)
        # By the autopilot's own clock: the link's jitter is no motion.
        self._filter.update(latitude, longitude, velocity, self.trust.error_m(now_s), self._clock_s)
        self._altitude_m = m_from_mm(message.alt)
        self._home_altitude_m = m_from_mm(message.alt - message.relative_alt)
        self._velocity = velocity
        self._trusted_at_s = measured_at_s

    def _home(self, message: Message) -> None:
        latitude, longitude = deg_from_dege7(message.latitude), deg_from_dege7(message.longitude)
        known = (message.latitude, message.longitude) != (0, 0)
        if known and abs(latitude) <= 90.0 and abs(longitude) <= 180.0:
            self.home = Geodetic(latitude, longitude, m_from_mm(message.altitude))

    @property
    def _clock_s(self) -> float:
        return (self._clock_ms or 0) / 1e3

    def _late_s(self, now_s: float) -> float:
        late_s = self._lateness.update(self._clock_s, now_s)
        if late_s > INFLATE_AFTER_S:
            self.counters["own_position_delayed"] += 1
        return late_s

    def _watch_for_jumps(
        self, place_deg: tuple[float, float], velocity: tuple[float, float, float], measured_at_s: float
    ) -> None:
        elapsed_s = measured_at_s - self._trusted_at_s
        if elapsed_s > LONGEST_AGE_S:
            return
        expected_deg = self._filter.extrapolate(max(elapsed_s, 0.0), self._velocity)
        speed_mps = max(math.hypot(*velocity[:2]), math.hypot(*self._velocity[:2]))
        if self._jumps.update(
            math.hypot(*offset_m(expected_deg, place_deg)),
            bound_m=self.trust.error_m(measured_at_s),
            travelled_m=speed_mps * max(elapsed_s, 0.0),
            now_s=measured_at_s,
        ):
            self.counters["own_position_jump"] += 1

    def _local(self, message: Message) -> None:
        """Take the velocity only: the local origin may move, and our coordinates begin at our own position anyway."""
        if not self._in_order(message.time_boot_ms):
            return
        velocity = (message.vx, message.vy, message.vz)
        if all(math.isfinite(value) and abs(value) < 300.0 for value in velocity) and self.trust.trusted:
            self._velocity = velocity

    # --- out ------------------------------------------------------------------------------------------------------

    def heard_s(self, now_s: float) -> float:
        """Time since the last heartbeat of the autopilot [s]; infinite without one."""
        return now_s - self._heartbeat_at_s

    def obeying_s(self, now_s: float) -> float:
        """Time for which heartbeats have said armed and GUIDED or OFFBOARD [s]; 0 if they do not."""
        return max(now_s - self._obeying_since_s, 0.0)

    def age_s(self, now_s: float) -> float:
        """Time since the last trusted position [s]; infinite without one."""
        return now_s - self._trusted_at_s

    def position_silent_s(self, now_s: float) -> float:
        """Time since the last position message, trusted or not [s]; infinite without one."""
        return now_s - self._position_heard_at_s

    @property
    def position_seldom_told(self) -> bool:
        """Whether positions come so seldom that the own error grows between them."""
        return self._positions.is_slower_than(INFLATE_AFTER_S)

    def jumped(self, now_s: float) -> bool:
        """Whether the own position jumped within the last second."""
        return self._jumps.doubtful(now_s)

    @property
    def on_ground(self) -> bool:
        """Whether it stands, as far as the autopilot tells."""
        return self._landed_state == LANDED_ON_GROUND

    def landed_state_known(self, now_s: float) -> bool:
        """Whether the autopilot told lately if it stands or flies: after a restart it forgets what to send."""
        return self._landed_state != 0 and now_s - self._landed_told_at_s <= LANDED_STATE_VALID_S

    @property
    def ready(self) -> bool:
        """Whether it is neither on the ground nor in an automatic take-off, as far as the autopilot tells."""
        return self._landed_state not in (LANDED_ON_GROUND, LANDED_TAKEOFF)

    @property
    def is_multirotor(self) -> bool:
        """Whether it can stop and hover, with the mode numbers that are known here."""
        return self.vehicle_type in MULTIROTORS

    @property
    def wants_stream(self) -> bool:
        """Whether the autopilot accepts its external mode only with a stream of setpoints."""
        return self.lock is not None and self.lock.autopilot == PX4 and self.is_multirotor

    def take_reboot(self) -> bool:
        """True once after the autopilot restarted, or another one took its place."""
        rebooted, self._rebooted = self._rebooted, False
        return rebooted

    def state(self, now_s: float) -> OwnState | None:
        """Own state now; None before the first trusted position and long after the last one."""
        age = self.age_s(now_s)
        if age > LONGEST_AGE_S:
            return None
        north, east, down = self._velocity
        latitude, longitude = self._filter.extrapolate(age, self._velocity)
        error = max(self.trust.error_m(now_s), self._jumps.error_m(now_s))
        if age > INFLATE_AFTER_S:
            error += math.hypot(north, east) * age
        altitude = self._altitude_m - down * age
        vertical = self.trust.vertical_error_m(now_s)
        if vertical is not None and age > INFLATE_AFTER_S:
            vertical += abs(down) * age
        undulation = self.trust.undulation_m
        return OwnState(
            position=Geodetic(latitude, longitude, altitude),
            altitude_ellipsoid_m=None if undulation is None else altitude + undulation,
            velocity_ned_mps=self._velocity,
            error_bound_m=min(error, ERROR_CAP_M),
            vertical_error_bound_m=vertical,
            home_altitude_m=self._home_altitude_m,
            age_s=age,
        )
