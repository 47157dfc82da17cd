"""Step responses as measured on two real autopilots in their own simulators, and the models flown the same way.

ArduPilot Copter 4.6 ("quad", built-in physics) and PX4 1.17 (SIH quad X); velocity setpoints at 10 Hz, one run a row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sitl_sim.vehicle import TICK_S, FleetDynamics

FloatArray = npt.NDArray[np.float64]
Velocity = tuple[float, float, float]

NORTH, EAST, DOWN = 0, 1, 2
SETTLE_S = 9.0
"""How long the measured runs held each setpoint."""


@dataclass(frozen=True)
class Response:
    """Velocity and displacement every tick after the change of the setpoint."""

    velocity: FloatArray
    moved: FloatArray

    def t63_s(self, axis: int, to_mps: float) -> float:
        """When 63 % of the way from the velocity at the step to ``to_mps`` has been made."""
        start = self.velocity[0, axis]
        share = (self.velocity[:, axis] - start) / (to_mps - start)
        return float(np.argmax(share >= 0.63)) * TICK_S

    def moved_at(self, *seconds: float) -> FloatArray:
        return self.moved[[round(second / TICK_S) for second in seconds]]


def respond(autopilot: str, before: Velocity, after: Velocity, duration_s: float = SETTLE_S) -> Response:
    """Hold one setpoint for as long as the measured runs did, then change it."""
    fleet = FleetDynamics([autopilot], [[0.0, 0.0, -100.0]])
    fleet.step([before], SETTLE_S if any(before) else 0.0, [True])
    start = fleet.position_ned_m.copy()
    velocity, moved = [fleet.velocity_ned_mps[0].copy()], [np.zeros(3)]
    for _ in range(round(duration_s / TICK_S)):
        fleet.step([after], TICK_S, [True])
        velocity.append(fleet.velocity_ned_mps[0].copy())
        moved.append((fleet.position_ned_m - start)[0])
    return Response(np.array(velocity), np.array(moved))


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

# metres against the old path 1, 2, 3, 4, 5 s after the step
DISPLACEMENTS = [
    ("dodge 3 west", (0, 0, 0), (0, -3, 0), (0.5, 3.0, 5.9, 9.0, 11.9), (0.5, 2.3, 4.3, 6.5, 8.7)),
    ("0 -> 5", (0, 0, 0), (5, 0, 0), (0.6, 3.4, 8.0, 13.0, 18.1), (1.6, 5.1, 8.9, 13.0, 16.2)),
    ("90 degree turn", (5, 0, 0), (0, 5, 0), (0.6, 3.4, 8.8, 15.6, 22.7), (2.5, 7.8, 13.5, 19.5, 25.7)),
    ("up 1", (0, 0, 0), (0, 0, -1), (0.3, 1.4, 2.4, 3.4, 4.4), (0.7, 1.7, 2.6, 3.5, 4.5)),
    ("up 3", (0, 0, 0), (0, 0, -3), (0.3, 1.7, 4.2, 7.2, 10.2), (1.9, 4.6, 7.4, 10.3, 13.2)),
]

# speed before zero is commanded, metres travelled until standing
STOPS = {
    "ardupilot": ((2.0, 1.8), (3.0, 3.0), (5.0, 7.0), (10.0, 23.8)),
    # from 5 m/s measured between 7.9 and 9.7; PX4 creeps while its integrator unwinds, the runs end after 9 s
    "px4": ((2.0, 3.6), (5.0, 8.8), (10.0, 17.2)),
}
