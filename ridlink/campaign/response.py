"""How vehicles respond to velocity setpoints, for batches of worlds: at once, as PX4 or as ArduPilot.

These are the models of the emulator's vehicles in two dimensions, with the same constants and the same ticks of 20 ms.
They were fitted to step responses of both autopilots in their own simulators. ArduPilot shapes its target with limited
acceleration and jerk, and follows it through a delay and a lag. PX4 closes a velocity loop, limited by tilt, against a
drag that is unusually large in its simulator.

Axes: north-east, metres, m/s, seconds. W worlds of N vehicles.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ridlink.compiled import kernel_decorator
from ridlink.words import Named

FloatArray = NDArray[np.float64]

kernel = kernel_decorator([Path(__file__)])

TICK_S = 0.02

MEASURED_SPEED_MPS = 10.0
"""Fastest cruise at which the models were measured."""

SPEED_LIMIT_MPS = {"px4": 12.0, "ardupilot": 10.2}
"""PX4: MPC_XY_VEL_MAX. ArduPilot: speed at which its lean angle of 30 degrees balances the measured drag."""

# ArduPilot: PSC_JERK_XY, WPNAV_ACCEL, slope of the square-root controller, delay of three ticks, lag.
JERK_MPS3, ACCELERATION_MPS2, GAIN_PER_S, SHAPED_LAG_S = 5.0, 2.5, 2.0, 0.10

# PX4: MPC_XY_VEL_P_ACC, _I_ACC, _D_ACC; g at a tilt of 45 degrees; drag of its simulator; delay of three
# ticks, two lags.
P_PER_S, I_PER_S2, D, TILT_MPS2, DRAG_PER_S, LOOP_LAG_S, SECOND_LAG_S = 1.8, 0.4, 0.2, 9.80665, 1.0, 0.18, 0.10

# Columns of the inner state: target and its acceleration, or integral and thrust; last change of velocity; output of
# the first of two lags; contents of the delay line, the newest first.
FIRST, SECOND, CHANGE, TILTING, HISTORY, STATE_COLUMNS = 0, 2, 4, 6, 8, 16


class Dynamics(Named):
    """How vehicles respond."""

    IDEAL = "ideal"
    PX4 = "px4"
    ARDUPILOT = "ardupilot"


class Response:
    """The vehicles of a batch of worlds, which all respond in the same way.

    Args:
        dynamics: How they respond.
        velocity_ne_mps: Initial velocities, as in steady flight, shape (W, N, 2).
        cruise_mps: Cruise speeds, shape (W, N). A vehicle with a faster cruise speed than was measured gets that speed
            as its limit, and a proportionally smaller drag; otherwise it could never reach it.
    """

    def __init__(self, dynamics: Dynamics, velocity_ne_mps: FloatArray, cruise_mps: FloatArray) -> None:
        self.dynamics = Dynamics(dynamics)
        if self.dynamics is Dynamics.IDEAL:
            return
        measured = SPEED_LIMIT_MPS[self.dynamics]
        self._limit_mps = np.maximum(cruise_mps, measured)
        self._drag_per_s = np.where(cruise_mps > measured, DRAG_PER_S * MEASURED_SPEED_MPS / cruise_mps, DRAG_PER_S)
        self._state = np.zeros((*cruise_mps.shape, STATE_COLUMNS))
        settled = velocity_ne_mps
        if self.dynamics is Dynamics.PX4:
            settled = self._drag_per_s[..., None] * velocity_ne_mps
            self._state[..., SECOND : SECOND + 2] = settled
            self._state[..., TILTING : TILTING + 2] = settled
        self._state[..., FIRST : FIRST + 2] = settled
        for k in range(4):
            self._state[..., HISTORY + 2 * k : HISTORY + 2 * k + 2] = settled

    def advance(self, position: FloatArray, velocity: FloatArray, command: FloatArray, elapsed_s: float) -> None:
        """Fly towards the commands; position and velocity are changed.

        Args:
            position: Shape (W, N, 2), written.
            velocity: Shape (W, N, 2), written.
            command: Commanded velocities, shape (W, N, 2).
            elapsed_s: A multiple of `TICK_S`, unless vehicles are ideal.

        Raises:
            ValueError: If it is not such a multiple.
        """
        if self.dynamics is Dynamics.IDEAL:
            velocity[...] = command
            position += velocity * elapsed_s
            return
        ticks = round(elapsed_s / TICK_S)
        if abs(ticks * TICK_S - elapsed_s) > 1e-9:
            raise ValueError(f"elapsed_s must be a multiple of {TICK_S}, got {elapsed_s}")
        if self.dynamics is Dynamics.PX4:
            fly_feedback(position, velocity, command, self._limit_mps, self._drag_per_s, ticks, self._state)
        else:
            fly_shaped(position, velocity, command, self._limit_mps, ticks, self._state)

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Keep only some worlds of the batch, shape (W,)."""
        if self.dynamics is not Dynamics.IDEAL:
            for name in ("_limit_mps", "_drag_per_s", "_state"):
                setattr(self, name, getattr(self, name)[kept])


@kernel
def limited(x_1, x_2, most):  # type: ignore[no-untyped-def]
    """A vector shortened to at most this length."""
    length = math.sqrt(x_1 * x_1 + x_2 * x_2)
    share = min(1.0, most / max(length, 1e-12))
    return x_1 * share, x_2 * share


@kernel
def push(state, x_1, x_2):  # type: ignore[no-untyped-def]
    """Put a value into the delay line of one vehicle."""
    for k in range(STATE_COLUMNS - 1, HISTORY + 1, -1):
        state[k] = state[k - 2]
    state[HISTORY], state[HISTORY + 1] = x_1, x_2


@kernel(nogil=True)
def fly_shaped(position, velocity, command, limit_mps, ticks, state):  # type: ignore[no-untyped-def]
    """Fly a number of ticks as under ArduPilot, whose measured speed had no error in wind.

    Args:
        position: Shape (W, N, 2), written.
        velocity: Shape (W, N, 2), written.
        command: Commanded velocities, shape (W, N, 2).
        limit_mps: Speed limits, shape (W, N).
        ticks: Number of ticks.
        state: Inner state, shape (W, N, STATE_COLUMNS), written.
    """
    blend = 1.0 - math.exp(-TICK_S / SHAPED_LAG_S)
    linear = JERK_MPS3 / GAIN_PER_S**2
    for world in range(position.shape[0]):
        for i in range(position.shape[1]):
            at, v, inner = position[world, i], velocity[world, i], state[world, i]
            c_1, c_2 = limited(command[world, i, 0], command[world, i, 1], limit_mps[world, i])
            for _ in range(ticks):
                e_1, e_2 = c_1 - inner[FIRST], c_2 - inner[FIRST + 1]
                error = math.sqrt(e_1 * e_1 + e_2 * e_2)
                curved = math.sqrt(max(2.0 * JERK_MPS3 * (error - 0.5 * linear), 0.0))
                asked = min(curved if error > linear else GAIN_PER_S * error, ACCELERATION_MPS2)
                share = asked / max(error, 1e-12)
                j_1, j_2 = limited(
                    e_1 * share - inner[SECOND], e_2 * share - inner[SECOND + 1], JERK_MPS3 * TICK_S
                )  # fmt: skip
                inner[SECOND] += j_1
                inner[SECOND + 1] += j_2
                inner[FIRST] += inner[SECOND] * TICK_S
                inner[FIRST + 1] += inner[SECOND + 1] * TICK_S
                push(inner, inner[FIRST], inner[FIRST + 1])
                for axis in range(2):
                    v[axis] += blend * (inner[HISTORY + 6 + axis] - v[axis])
                    at[axis] += v[axis] * TICK_S


@kernel(nogil=True)
def fly_feedback(position, velocity, command, limit_mps, drag_per_s, ticks, state):  # type: ignore[no-untyped-def]
    """Fly a number of ticks as under PX4; arguments as in `fly_shaped`, with the drag of each vehicle [1/s]."""
    blend = 1.0 - math.exp(-TICK_S / LOOP_LAG_S)
    second_blend = 1.0 - math.exp(-TICK_S / SECOND_LAG_S)
    for world in range(position.shape[0]):
        for i in range(position.shape[1]):
            at, v, inner, drag = position[world, i], velocity[world, i], state[world, i], drag_per_s[world, i]
            c_1, c_2 = limited(command[world, i, 0], command[world, i, 1], limit_mps[world, i])
            for _ in range(ticks):
                e_1, e_2 = c_1 - v[0], c_2 - v[1]
                a_1 = P_PER_S * e_1 + inner[FIRST] - D * inner[CHANGE]
                a_2 = P_PER_S * e_2 + inner[FIRST + 1] - D * inner[CHANGE + 1]
                p_1, p_2 = limited(a_1, a_2, TILT_MPS2)
                # Anti-windup of the autopilot: the unreachable part is subtracted from the integrated error.
                inner[FIRST] += I_PER_S2 * (e_1 - (a_1 - p_1) * (2.0 / P_PER_S)) * TICK_S
                inner[FIRST + 1] += I_PER_S2 * (e_2 - (a_2 - p_2) * (2.0 / P_PER_S)) * TICK_S
                push(inner, p_1, p_2)
                for axis in range(2):
                    inner[TILTING + axis] += blend * (inner[HISTORY + 6 + axis] - inner[TILTING + axis])
                    inner[SECOND + axis] += second_blend * (inner[TILTING + axis] - inner[SECOND + axis])
                    inner[CHANGE + axis] = inner[SECOND + axis] - drag * v[axis]
                    v[axis] += inner[CHANGE + axis] * TICK_S
                    at[axis] += v[axis] * TICK_S
