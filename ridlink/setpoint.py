"""Velocity -> SET_POSITION_TARGET_LOCAL_NED: the last functions before the bytes, with the last checks.

Whatever was decided above, a setpoint that leaves here is finite, within the limits, no steeper than the slew allows,
and in the one form that both PX4 and ArduPilot take for "fly this velocity". Axes: north, east, down; m/s.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from ridlink.mavlink.codec import Encoder
from ridlink.ranges import Range, check_ranges

Velocity = tuple[float, float, float]

VELOCITY_ONLY_MASK = 0x0DC7
"""Position, acceleration, yaw and yaw rate ignored; all three velocities used. A mask that ignores a single velocity
axis stops the vehicle."""

FRAME_LOCAL_NED = 1
"""MAV_FRAME_LOCAL_NED. Body frames turn with the nose: a vehicle that turns into the wind would fly a curve."""

STOP: Velocity = (0.0, 0.0, 0.0)

FLOAT32_MARGIN = 1e-6
"""Relative margin to the limits, so that they hold after the wire rounds to float32."""

FASTEST_MPS = 100.0
"""No vehicle that takes velocity setpoints flies faster; a higher limit is a typing error."""

SPEED_RANGE = Range(0.01, FASTEST_MPS, "m/s")
"""Speeds and limits of them: from the cm/s in which messages count."""

LONGEST_SLEW_S = 0.5
"""After a longer gap the slew is that of this time: a stalled loop must not allow a leap."""


@dataclass(frozen=True, slots=True)
class VelocityLimits:
    """Limits of what the autopilot is asked for.

    Args:
        horizontal_mps: Horizontal speed. A category 2 multirotor reaches 15 m/s.
        vertical_mps: Climb and descent. PX4 descends at 1.5 m/s at most and ArduPilot keeps 2 m/s.
        acceleration_mps2: Change of a setpoint per second. Less than 5 m/s^2 adds a lag to that of the autopilot.

    Raises:
        ConfigError: If one is out of its range.
    """

    horizontal_mps: float = 15.0
    vertical_mps: float = 2.0
    acceleration_mps2: float = 5.0

    RANGES: ClassVar[Mapping[str, Range]] = {
        "horizontal_mps": SPEED_RANGE,
        "vertical_mps": SPEED_RANGE,
        "acceleration_mps2": Range(0.1, 10_000.0, "m/s^2"),  # from there on any change fits into a step of 0.02 s
    }

    def __post_init__(self) -> None:
        check_ranges(self, self.RANGES)


def clamp_velocity(wanted: Velocity, last: Velocity, elapsed_s: float, limits: VelocityLimits) -> Velocity:
    """Velocity nearest to the wanted one that may be sent, north, east, down [m/s].

    Zero is always allowed at once: to stop is not limited by the slew, the autopilot brakes as hard as it can.
    Horizontal speed is cut in length, so the course is kept.

    Args:
        wanted: Velocity that was decided; not finite means stop.
        last: Velocity sent last, itself within the limits.
        elapsed_s: Time since then.
        limits: Limits.
    """
    if not all(math.isfinite(value) for value in wanted):
        return STOP
    most = limits.horizontal_mps * (1.0 - FLOAT32_MARGIN)
    most_down = limits.vertical_mps * (1.0 - FLOAT32_MARGIN)
    north, east, down = wanted
    speed = math.hypot(north, east)
    if speed > most:
        # Scale down first: the square of a huge but finite speed is not finite.
        scale = max(abs(north), abs(east))
        north, east = north / scale, east / scale
        length = math.hypot(north, east)
        north, east = north * most / length, east * most / length
    down = min(max(down, -most_down), most_down)
    if north == east == down == 0.0:
        return STOP
    change = (north - last[0], east - last[1], down - last[2])
    size = math.sqrt(change[0] ** 2 + change[1] ** 2 + change[2] ** 2)
    room = limits.acceleration_mps2 * (1.0 - FLOAT32_MARGIN) * min(max(elapsed_s, 0.0), LONGEST_SLEW_S)
    if size <= room:
        return north, east, down
    # Any velocity between two within the limits is within the limits, too.
    part = room / size
    return last[0] + part * change[0], last[1] + part * change[1], last[2] + part * change[2]


def encode_setpoint(
    encoder: Encoder, velocity: Velocity, time_boot_ms: int, target_system: int, target_component: int
) -> bytes:
    """One SET_POSITION_TARGET_LOCAL_NED (84) frame, velocity only, frame LOCAL_NED.

    Args:
        encoder: Encoder of our messages.
        velocity: North, east, down [m/s].
        time_boot_ms: Time since start; the wire carries it modulo 2**32, 50 days.
        target_system: System id of the autopilot.
        target_component: Component id of the autopilot.
    """
    return encoder.encode(
        "SET_POSITION_TARGET_LOCAL_NED",
        time_boot_ms=time_boot_ms & 0xFFFFFFFF,
        target_system=target_system,
        target_component=target_component,
        coordinate_frame=FRAME_LOCAL_NED,
        type_mask=VELOCITY_ONLY_MASK,
        vx=velocity[0],
        vy=velocity[1],
        vz=velocity[2],
    )


class SetpointStream:
    """The running stream: keeps the last setpoint and its time, so that limits on change hold.

    Attributes:
        velocity: Velocity sent last; zero before the first setpoint.
        sent: Number of setpoints sent.
        counters: `setpoint_not_finite`, `setpoint_limited` (something above asked for more than the limits).
    """

    def __init__(self, limits: VelocityLimits) -> None:
        self.limits = limits
        self.velocity: Velocity = STOP
        self.sent = 0
        self.counters: Counter[str] = Counter()
        self._time_ms = 0

    def restart(self) -> None:
        """Begin again from zero, after nothing was sent for a while."""
        self.velocity = STOP

    def next(
        self, encoder: Encoder, wanted: Velocity, time_boot_ms: int, target_system: int, target_component: int
    ) -> bytes:
        """Frame of the next setpoint; arguments as in `encode_setpoint`, with `wanted` as decided."""
        time_ms = max(time_boot_ms, self._time_ms)
        if not all(math.isfinite(value) for value in wanted):
            self.counters["setpoint_not_finite"] += 1
        # The slew uses the time that an observer reads off the frames.
        sent = clamp_velocity(wanted, self.velocity, (time_ms - self._time_ms) / 1e3, self.limits)
        if max(abs(sent[0] - wanted[0]), abs(sent[1] - wanted[1]), abs(sent[2] - wanted[2])) > 0.01:
            self.counters["setpoint_limited"] += 1
        self._time_ms = time_ms
        self.velocity = sent
        self.sent += 1
        return encode_setpoint(encoder, sent, time_ms, target_system, target_component)
