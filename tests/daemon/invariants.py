"""The invariants, as an observer of the emitted stream: whatever a test is about, these hold beside it.

I1  every setpoint is finite, within the limits, velocity-only, LOCAL_NED, to the configured autopilot, in order of time
I2  no gap of more than 300 ms; what follows a longer one is a stop
I3  nothing arms, changes a mode, uploads or steers a vehicle that a pilot has taken back
I4  no margin is told that is no number
I5  what is heard of others redirects nothing: targets, own ids
I6  tracks are bounded; time per step is CPU time, which a message cannot tell, and is measured by `tests.soak.hostile`
I7  no cause is told more often than once a second
I8  is about exit codes, see `tests/cli/test_avoid.py`
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

from ridlink.mavlink.codec import CRC_EXTRAS, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.setpoint import VelocityLimits

LONGEST_GAP_MS = 300
ROUNDING_MS = 2
MOST_TRACKS = 2000

SAID = {
    "HEARTBEAT", "RIDLINK_STATUS", "SET_POSITION_TARGET_LOCAL_NED", "COLLISION", "STATUSTEXT", "COMMAND_ACK",
    "COMMAND_LONG",
}  # fmt: skip
ASKED = {511}
"""MAV_CMD_SET_MESSAGE_INTERVAL, the one command that is given without `--guard`."""
GUARDING = {176, 224}
"""MAV_CMD_DO_SET_MODE and DO_SET_MISSION_CURRENT, which a guard may give as well."""
LEAST_BETWEEN_WORDS_S = 0.95
"""One second, less what a clock of 100 ms makes of it."""
LATE_SETPOINTS = 2
"""Two periods of 100 ms: what is under way when a pilot takes over."""


def messages(data: bytes) -> list[Message]:
    """Messages of a datagram; anything but good frames is a failure of the sender."""
    found = parse_datagram(data, CRC_EXTRAS)
    assert all(isinstance(frame, Frame) and frame.checked for frame in found), found
    return [decode_message(frame) for frame in found if isinstance(frame, Frame)]


@dataclass
class Observer:
    """Checks everything that it is shown, and keeps the setpoints.

    Args:
        limits: Of setpoints.
        target: System id of the autopilot.
        may: Commands that may be given.
    """

    limits: VelocityLimits = field(default_factory=VelocityLimits)
    target: int = 1
    may: set[int] = field(default_factory=lambda: set(ASKED))
    steerable: bool = True
    """Armed and in GUIDED or OFFBOARD, or a PX4 that wants a stream before."""
    setpoints: list[Message] = field(default_factory=list)
    _last: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _last_ms: int = 0
    _unwanted: int = 0
    _status_ms: int = 0
    _texts: Counter[tuple[int, str]] = field(default_factory=Counter)

    def watch(self, data: bytes) -> list[Message]:
        """Messages of a datagram, checked."""
        found = parse_datagram(data, CRC_EXTRAS)
        for frame in found:
            assert isinstance(frame, Frame) and frame.checked, frame
            assert frame.compid == 196 and frame.sysid == self.target, "I5: we speak for our own vehicle"
        decoded = messages(data)
        for message in decoded:
            self._check(message)
        return decoded

    def _check(self, message: Message) -> None:
        assert message.name in SAID, f"I3: {message.name} is not ours to say"
        match message.name:
            case "SET_POSITION_TARGET_LOCAL_NED":
                self._check_setpoint(message)
                self.setpoints.append(message)
            case "COMMAND_LONG":
                assert message.command in self.may, f"I3: command {message.command} is not ours to give"
            case "RIDLINK_STATUS":
                self._status_ms = message.time_boot_ms
                assert message.tracks <= MOST_TRACKS, "I6"
                assert -(2**31) < message.nearest_margin < 2**31, "I4"
            case "STATUSTEXT":
                key = (self._status_ms, message.text.rstrip(b"\x00").decode())
                self._texts[key] += 1
                assert self._texts[key] == 1, "I7: told twice within a second"

    def _check_setpoint(self, message: Message) -> None:
        velocity = (message.vx, message.vy, message.vz)
        assert all(math.isfinite(value) for value in velocity), "I1"
        assert math.hypot(message.vx, message.vy) <= self.limits.horizontal_mps, "I1"
        assert abs(message.vz) <= self.limits.vertical_mps, "I1"
        assert message.type_mask == 0x0DC7 and message.coordinate_frame == 1, "I1"
        assert (message.target_system, message.target_component) == (self.target, 1), "I1, I5"
        assert message.time_boot_ms >= self._last_ms, "I1"
        elapsed_ms = message.time_boot_ms - self._last_ms
        if velocity != (0.0, 0.0, 0.0):
            change = math.dist(velocity, self._last)
            assert change <= self.limits.acceleration_mps2 * elapsed_ms / 1e3 + 1e-4, ("I1", velocity, self._last)
            assert elapsed_ms <= LONGEST_GAP_MS + ROUNDING_MS, f"I2: {velocity} after {elapsed_ms} ms of nothing"
        self._unwanted = 0 if self.steerable else self._unwanted + 1
        assert self._unwanted <= LATE_SETPOINTS, "I3: setpoints to a vehicle that a pilot has taken back"
        self._last, self._last_ms = velocity, message.time_boot_ms
