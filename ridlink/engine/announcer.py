"""Rhythm of the messages that the daemon sends about itself, beside setpoints."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ridlink.engine.announce import collision, heartbeat, status, warning
from ridlink.engine.decision import DecisionRecord, StepOutput
from ridlink.failsafe import UNHEARD, State
from ridlink.mavlink.codec import Encoder
from ridlink.own_ship import OwnShipTelemetry
from ridlink.own_ship.requests import Requests
from ridlink.own_ship.rival import Rivals
from ridlink.periodic import Periodic
from ridlink.traffic.track import TrackKey

MOST_COLLISIONS = 8
"""COLLISION messages per second: warnings must not flood a link of a few kbit/s."""
COLLISION_PERIOD_S = 1.0 - 1e-6

QUIET_S = 10.0
"""Time between two alerts of one kind."""

ALERTS = {
    "newcomer_refused": "Remote ID flood: new senders refused",
    "track_evicted": "Remote ID flood: traffic picture is full",
    "track_refused": "Remote ID flood: newcomers find no room",
    "own_id_elsewhere": "our own Remote ID is used elsewhere",
    "other_writer": "another writer steers this vehicle, too",
    "setpoints_unheard": UNHEARD,
    "pause_kept": "guard: the mission was paused, and is not flown on",
    "mode_not_given": "guard: the autopilot does not change its mode",
    "own_position_jump": "own position jumped",
    "own_position_delayed": "telemetry comes late",
    "own_height_implausible": "own heights contradict each other",
    "goal_below_home": "the goal lies below home, perhaps underground",
    "no_multirotor": "the vehicle is no multirotor: nothing is flown",
    "decision_failed": "a decision failed",
}
"""Alerts to the operator, by the counter that moves."""


class Announcer:
    """Adds all messages except setpoints to the output of a step.

    Args:
        broadcasts: Whether the vehicle's Remote ID is sent, too.

    Attributes:
        decision_time_s: How long the last step took, for RIDLINK_STATUS.
    """

    def __init__(self, *, broadcasts: bool) -> None:
        self.decision_time_s = 0.0
        self._heartbeat_due = Periodic(1.0)
        self._status_due = Periodic(1.0)
        self._requests = Requests(steers=True, broadcasts=broadcasts)
        self._claimed = 0
        self._warned_at_s: dict[TrackKey, float] = {}
        self._counted = dict.fromkeys(ALERTS, 0)
        self._alerted_s: dict[str, float] = {}

    def announce(
        self,
        output: StepOutput,
        encoder: Encoder,
        air_encoder: Encoder,
        transmitter_encoder: Encoder,
        telemetry: OwnShipTelemetry,
        *,
        state: State,
        rivals: Rivals,
        time_boot_ms: int,
        count: Callable[[], Mapping[str, int]],
        now_s: float,
    ) -> None:
        """Add the messages that are due.

        Args:
            output: Output of this step.
            encoder: Encoder of the own messages to the vehicle.
            air_encoder: The same for the Remote ID link.
            transmitter_encoder: The same for the transmitter, on that link or on its own.
            telemetry: Telemetry of the vehicle.
            state: State of the failsafe ladder.
            rivals: Own claim to steer, which others hear at once.
            time_boot_ms: Time since start.
            count: Counts so far, see `ALERTS`; called once a second.
            now_s: Monotonic time.
        """
        vehicle, record, lock = output.to_vehicle, output.decision, telemetry.lock
        if self._heartbeat_due.due(now_s) or rivals.claim != self._claimed or rivals.answer:
            self._claimed, rivals.answer = rivals.claim, False
            vehicle.append(heartbeat(encoder, state is State.ENGAGED, rivals.claim))
            # The air listens to those that say which vehicle they are: not before that is known.
            if lock is not None or telemetry.pinned is not None:
                output.to_air.append(heartbeat(air_encoder, state is State.ENGAGED, rivals.claim))
                if transmitter_encoder is not air_encoder:
                    output.to_transmitter.append(heartbeat(transmitter_encoder, state is State.ENGAGED, rivals.claim))
        if lock is None:
            return
        if self._status_due.due(now_s):
            vehicle.append(status(encoder, record, time_boot_ms, self.decision_time_s))
            output.warnings.extend(self._alerts(count(), now_s))
        vehicle.extend(self._requests.due(encoder, telemetry, now_s))
        if telemetry.armed:
            vehicle.extend(self._collisions(encoder, record, now_s))
        vehicle.extend(warning(encoder, text) for text in output.warnings)

    def _collisions(self, encoder: Encoder, record: DecisionRecord, now_s: float) -> list[bytes]:
        """COLLISION for the most urgent conflicts, once a second for each and `MOST_COLLISIONS` a second in all."""
        self._warned_at_s = {key: at for key, at in self._warned_at_s.items() if now_s - at < COLLISION_PERIOD_S}
        due = [c for c in record.conflicts[:MOST_COLLISIONS] if c.track.key not in self._warned_at_s]
        due = due[: MOST_COLLISIONS - len(self._warned_at_s)]
        self._warned_at_s.update((conflict.track.key, now_s) for conflict in due)
        return [collision(encoder, conflict, record.state) for conflict in due]

    def _alerts(self, counters: Mapping[str, int], now_s: float) -> list[str]:
        """A line for each cause of `ALERTS` whose count grew within the last second, each at most every ten seconds."""
        counted_on = [cause for cause in ALERTS if counters[cause] > self._counted[cause]]
        self._counted.update({cause: counters[cause] for cause in counted_on})
        due = [cause for cause in counted_on if now_s - self._alerted_s.get(cause, -QUIET_S) >= QUIET_S]
        self._alerted_s.update(dict.fromkeys(due, now_s))
        return [ALERTS[cause] for cause in due]
