"""Step responses as measured on two real autopilots in their own simulators, and the models flown the same way.

ArduPilot Copter 4.6 ("quad", built-in physics) and PX4 1.17 (SIH quad X); velocity setpoints at 10 Hz, one run a row.

A row that begins from rest began while the vehicle still crept from the row before it: PX4's integrator unwinds for
many seconds. The measured figures show it. Of PX4's rows from rest, 5 % was there after 0.16 s in 0 -> 5, which follows
another flight north, but only after 0.32 s in the dodge to the west, which follows a flight to the east; and no time to
5 % is given where it flew before (5 -> 0), because it was 8 % short of the commanded speed already. So every row from
rest is flown after the one above it and `PAUSE_S` at zero, and shares are those of the commanded step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from sitl_sim.vehicle import TICK_S, FleetDynamics

FloatArray = npt.NDArray[np.float64]
Velocity = tuple[float, float, float]

NORTH, EAST, DOWN = 0, 1, 2
SETTLE_S = 9.0
"""How long the measured runs held each setpoint."""
PAUSE_S = 7.5
"""How long zero was commanded before a row from rest: the one figure here that was not written down."""


@dataclass(frozen=True)
class Response:
    """Velocity and displacement every tick after the change of the setpoint; the setpoint before it."""

    velocity: FloatArray
    moved: FloatArray
    before: Velocity

    def share_s(self, share: float, axis: int, to_mps: float) -> float:
        """When this share of the commanded change has been made [s]."""
        made = (self.velocity[:, axis] - self.before[axis]) / (to_mps - self.before[axis])
        tick = int(np.argmax(made >= share))
        if tick == 0:
            return 0.0
        return float(tick - 1 + (share - made[tick - 1]) / (made[tick] - made[tick - 1])) * TICK_S

    def t63_s(self, axis: int, to_mps: float) -> float:
        """When 63 % of the commanded change has been made [s]."""
        return self.share_s(0.63, axis, to_mps)

    def aside_m(self, seconds: FloatArray) -> FloatArray:
        """How far the vehicle is from the place where the setpoint before would have had it."""
        ticks = np.round(seconds / TICK_S).astype(int)
        return np.linalg.norm(self.moved[ticks] - np.outer(seconds, self.before), axis=1)


def respond(
    autopilot: str, before: Velocity, after: Velocity, duration_s: float = SETTLE_S, earlier: Velocity | None = None
) -> Response:
    """Hold one setpoint for as long as the measured runs did, then change it.

    ``earlier`` is flown before that, and followed by a pause at zero.
    """
    fleet = FleetDynamics([autopilot], [[0.0, 0.0, -100.0]])
    if earlier is not None:
        fleet.step([earlier], SETTLE_S, [True])
        fleet.step([(0.0, 0.0, 0.0)], PAUSE_S, [True])
    fleet.step([before], SETTLE_S if any(before) else 0.0, [True])
    start = fleet.position_ned_m.copy()
    velocity, moved = [fleet.velocity_ned_mps[0].copy()], [np.zeros(3)]
    for _ in range(round(duration_s / TICK_S)):
        fleet.step([after], TICK_S, [True])
        velocity.append(fleet.velocity_ned_mps[0].copy())
        moved.append((fleet.position_ned_m - start)[0])
    return Response(np.array(velocity), np.array(moved), before)


@cache
def respond_as_measured(autopilot: str, name: str) -> Response:
    """A row of `STEPS`, after the one above it."""
    index = next(index for index, row in enumerate(STEPS) if row[0] == name)
    _, before, after, *_ = STEPS[index]
    if index == 0 or any(before):
        return respond(autopilot, before, after)
    _, before_it, after_it, *_ = STEPS[index - 1]
    return respond(autopilot, before, after, earlier=after_it if any(after_it) else before_it)


# name, setpoint before and after, axis and its target, measured t63 of ArduPilot and PX4 (None: clipped, see limits)
STEPS = [
    ("0 -> 2", (0, 0, 0), (2, 0, 0), NORTH, 2.0, 0.87, 0.97),
    ("0 -> 5", (0, 0, 0), (5, 0, 0), NORTH, 5.0, 1.60, 0.96),
    ("0 -> 10", (0, 0, 0), (10, 0, 0), NORTH, 10.0, 2.92, 1.36),
    ("5 -> 0", (5, 0, 0), (0, 0, 0), NORTH, 0.0, 1.61, 0.76),
    ("10 -> 0", (10, 0, 0), (0, 0, 0), NORTH, 0.0, 2.95, 0.88),
    ("-5 -> 5", (-5, 0, 0), (5, 0, 0), NORTH, 5.0, 2.86, 1.02),
    ("90 degree turn", (5, 0, 0), (0, 5, 0), EAST, 5.0, 2.15, 0.87),
    ("dodge 3 west", (0, 0, 0), (0, -3, 0), EAST, -3.0, 1.04, 1.32),
    ("up 1", (0, 0, 0), (0, 0, -1), DOWN, -1.0, 0.79, 0.38),
    ("up 3", (0, 0, 0), (0, 0, -3), DOWN, -3.0, 1.99, 0.31),
    ("down 1", (0, 0, 0), (0, 0, 1), DOWN, 1.0, 0.81, 0.31),
    ("down 3", (0, 0, 0), (0, 0, 3), DOWN, 3.0, 1.85, None),
]

# time to 5 % of PX4, where it was not already there
PX4_T05_S = {
    "0 -> 2": 0.18,
    "0 -> 5": 0.16,
    "0 -> 10": 0.20,
    "dodge 3 west": 0.32,
    "up 1": 0.04,
    "up 3": 0.07,
    "down 1": 0.09,
}

# metres against the old path 1, 2, 3, 4, 5 s after the step
DISPLACEMENTS = [
    ("dodge 3 west", (0.5, 3.0, 5.9, 9.0, 11.9), (0.5, 2.3, 4.3, 6.5, 8.7)),
    ("0 -> 5", (0.6, 3.4, 8.0, 13.0, 18.1), (1.6, 5.1, 8.9, 13.0, 16.2)),
    ("90 degree turn", (0.6, 3.4, 8.8, 15.6, 22.7), (2.5, 7.8, 13.5, 19.5, 25.7)),
    ("up 1", (0.3, 1.4, 2.4, 3.4, 4.4), (0.7, 1.7, 2.6, 3.5, 4.5)),
    ("up 3", (0.3, 1.7, 4.2, 7.2, 10.2), (1.9, 4.6, 7.4, 10.3, 13.2)),
]

# speed before zero is commanded, metres travelled until standing
STOPS = {
    "ardupilot": ((2.0, 1.8), (3.0, 3.0), (5.0, 7.0), (10.0, 23.8)),
    # from 5 m/s measured between 7.9 and 9.7; PX4 creeps while its integrator unwinds, the runs end after 9 s
    "px4": ((2.0, 3.6), (5.0, 8.8), (10.0, 17.2)),
}
