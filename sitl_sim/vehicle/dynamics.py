"""Response of a fleet to velocity setpoints: kinematics of an ideal vehicle, of PX4 and of ArduPilot.

Units and axes: metres, seconds; north-east-down. Arrays are (n, 3), one row per vehicle; a batch of worlds is one long
fleet. The models were fitted to step responses of both autopilots in their own simulators (ArduPilot Copter 4.6 "quad",
PX4 1.17 "SIH quad X"): ``tests/sitl_sim/measured.py`` has the measured tables, ``airframes`` the figures of the models.

- ideal: the commanded velocity at once, within the limits of speed.
- ArduPilot shapes the target (limits of jerk and acceleration), then follows it: slow, but exact.
- PX4 does not shape in OFFBOARD. It uses proportional, integral and derivative feedback of velocity, limited by tilt,
  against a drag that is unusually large in its simulator: quick, but for seconds 12-17 % short of the commanded speed.

The world is stepped in ticks of 20 ms, the period at which both autopilots stream and a tenth of their lag.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from sitl_sim.vehicle.airframe import model_for_speed
from sitl_sim.vehicle.models import GRAVITY_MPS2, TICK_S, Ideal, Model, ShapedTarget, VelocityFeedback

FloatArray = npt.NDArray[np.float64]

_HISTORY_TICKS = 16
"""Length of the delay line; the longest delay is two ticks less, 0.28 s."""

_CALM = np.zeros((1, 2))

WIND_LAG_S = 2.0
"""Time constant with which ArduPilot's integrators learn a steady wind; only faster changes move the vehicle."""


def limit_norm(vectors: FloatArray, limit: FloatArray) -> FloatArray:
    """Vectors (m, k) shortened to at most ``limit`` (m,), with unchanged direction."""
    norm = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    scale = np.minimum(1.0, limit / np.maximum(norm, 1e-12))
    return np.asarray(vectors * scale[:, None])


class _DelayLine:
    """Values of the last ticks, read with a separate delay for each vehicle and axis, linear between ticks.

    Args:
        delay_s: Shape (m, 3).
    """

    def __init__(self, delay_s: FloatArray) -> None:
        ticks = delay_s / TICK_S
        if np.any(ticks > _HISTORY_TICKS - 2):
            raise ValueError(f"a delay is at most {(_HISTORY_TICKS - 2) * TICK_S:.2f} s")
        self._whole = np.floor(ticks + 1e-9).astype(np.int64)
        self._part = np.maximum(ticks - self._whole, 0.0)
        self._rows, self._axes = np.arange(len(delay_s))[:, None], np.arange(3)
        self._history = np.zeros((_HISTORY_TICKS, len(delay_s), 3))
        self._head = 0

    def push(self, values: FloatArray) -> FloatArray:
        """Store the values (m, 3) of this tick; returns those of ``delay_s`` ago."""
        self._head = (self._head + 1) % _HISTORY_TICKS
        self._history[self._head] = values
        newer = self._history[(self._head - self._whole) % _HISTORY_TICKS, self._rows, self._axes]
        older = self._history[(self._head - self._whole - 1) % _HISTORY_TICKS, self._rows, self._axes]
        return np.asarray(newer + self._part * (older - newer))

    def fill(self, rows: npt.NDArray[np.int64], values: FloatArray) -> None:
        """Fill the line with constant values."""
        self._history[:, rows] = values


class _Group(Protocol):
    """All vehicles of one model; row indices are those within the group."""

    def step(self, command: FloatArray, velocity: FloatArray, wind_ne: FloatArray) -> FloatArray:
        """Velocity (m, 3) one tick later."""
        ...

    def settle(self, rows: npt.NDArray[np.int64], velocity: FloatArray, wind_ne: FloatArray) -> None:
        """Set the inner state to that of steady flight at these velocities in this wind."""
        ...


def _column(models: Sequence[Model], name: str) -> FloatArray:
    return np.array([getattr(model, name) for model in models], dtype=np.float64)


class _IdealGroup:
    def step(self, command: FloatArray, velocity: FloatArray, wind_ne: FloatArray) -> FloatArray:
        return command

    def settle(self, rows: npt.NDArray[np.int64], velocity: FloatArray, wind_ne: FloatArray) -> None:
        return None


class _ShapedGroup:
    """ArduPilot's shaping: a square-root controller demands acceleration, and jerk limits its rate of change."""

    def __init__(self, models: Sequence[ShapedTarget]) -> None:
        self._acceleration_limit = _column(models, "acceleration_mps2")
        self._jerk_limit = _column(models, "jerk_mps3")
        self._vertical_acceleration_limit = _column(models, "vertical_acceleration_mps2")
        self._vertical_jerk_limit = _column(models, "vertical_jerk_mps3")
        self._gain = _column(models, "gain_per_s")
        self._blend = 1.0 - np.exp(-TICK_S / _column(models, "lag_s"))[:, None]
        self._delay = _DelayLine(np.repeat(_column(models, "delay_s")[:, None], 3, axis=1))
        self._target = np.zeros((len(models), 3))
        self._target_acceleration = np.zeros((len(models), 3))
        self._gust_per_s = _column(models, "gust_per_s")[:, None]
        self._known_wind = np.zeros((len(models), 2))
        self._blown = np.zeros((len(models), 2))

    def step(self, command: FloatArray, velocity: FloatArray, wind_ne: FloatArray) -> FloatArray:
        error = command - self._target
        horizontal = error[:, :2]
        norm = np.sqrt(np.einsum("ij,ij->i", horizontal, horizontal))
        wanted = np.empty_like(error)
        asked = np.minimum(self._sqrt_controller(norm, self._jerk_limit), self._acceleration_limit)
        wanted[:, :2] = horizontal * (asked / np.maximum(norm, 1e-12))[:, None]
        asked = np.minimum(
            self._sqrt_controller(np.abs(error[:, 2]), self._vertical_jerk_limit), self._vertical_acceleration_limit
        )
        wanted[:, 2] = np.copysign(asked, error[:, 2])
        change = wanted - self._target_acceleration
        self._target_acceleration[:, :2] += limit_norm(change[:, :2], self._jerk_limit * TICK_S)
        vertical_step = self._vertical_jerk_limit * TICK_S
        self._target_acceleration[:, 2] += np.clip(change[:, 2], -vertical_step, vertical_step)
        self._target += self._target_acceleration * TICK_S
        followed = velocity.copy()
        followed[:, :2] -= self._blown
        followed += self._blend * (self._delay.push(self._target) - followed)
        gust = wind_ne - self._known_wind
        self._known_wind += gust * (TICK_S / WIND_LAG_S)
        self._blown += (self._gust_per_s * gust - self._gain[:, None] * self._blown) * TICK_S
        followed[:, :2] += self._blown
        return followed

    def _sqrt_controller(self, error: FloatArray, limit: FloatArray) -> FloatArray:
        """Rate of correction from which a stop is possible with ``limit``; linear near zero."""
        linear = limit / self._gain**2
        curved = np.sqrt(np.maximum(2.0 * limit * (error - 0.5 * linear), 0.0))
        return np.where(error > linear, curved, self._gain * error)

    def settle(self, rows: npt.NDArray[np.int64], velocity: FloatArray, wind_ne: FloatArray) -> None:
        self._target[rows] = velocity
        self._target_acceleration[rows] = 0.0
        self._blown[rows] = 0.0
        self._known_wind[rows] = wind_ne
        self._delay.fill(rows, velocity)


class _FeedbackGroup:
    """PX4's velocity controller with its anti-windup, two lags of attitude, and drag."""

    def __init__(self, models: Sequence[VelocityFeedback]) -> None:
        def axes(horizontal: str, vertical: str) -> FloatArray:
            return np.stack([_column(models, name) for name in (horizontal, horizontal, vertical)], axis=1)

        self._p = axes("p_per_s", "vertical_p_per_s")
        self._i = axes("i_per_s2", "vertical_i_per_s2")
        self._d = _column(models, "d")[:, None] * np.array([1.0, 1.0, 0.0])
        self._drag = axes("drag_per_s", "vertical_drag_per_s")
        self._blend = 1.0 - np.exp(-TICK_S / axes("lag_s", "vertical_lag_s"))
        self._second_blend = 1.0 - np.exp(-TICK_S / _column(models, "second_lag_s"))[:, None]
        self._limit = GRAVITY_MPS2 * np.tan(np.radians(_column(models, "tilt_limit_deg")))
        self._climb_limit = _column(models, "climb_acceleration_mps2")
        self._delay = _DelayLine(axes("delay_s", "vertical_delay_s"))
        self._integral = np.zeros((len(models), 3))
        self._tilting = np.zeros((len(models), 3))
        self._thrust = np.zeros((len(models), 3))
        self._acceleration = np.zeros((len(models), 3))

    def step(self, command: FloatArray, velocity: FloatArray, wind_ne: FloatArray) -> FloatArray:
        error = command - velocity
        asked = self._p * error + self._integral - self._d * self._acceleration
        possible = asked.copy()
        possible[:, :2] = limit_norm(asked[:, :2], self._limit)
        possible[:, 2] = np.clip(asked[:, 2], -self._climb_limit, GRAVITY_MPS2)
        # anti-windup: the unreachable part is subtracted from the integrated error (PositionControl's gain 2 / P)
        self._integral += self._i * (error - (asked - possible) * (2.0 / self._p)) * TICK_S
        self._tilting += self._blend * (self._delay.push(possible) - self._tilting)
        self._thrust[:, :2] += self._second_blend * (self._tilting[:, :2] - self._thrust[:, :2])
        self._thrust[:, 2] = self._tilting[:, 2]
        airspeed = velocity.copy()
        airspeed[:, :2] -= wind_ne
        self._acceleration = self._thrust - self._drag * airspeed
        return velocity + self._acceleration * TICK_S

    def settle(self, rows: npt.NDArray[np.int64], velocity: FloatArray, wind_ne: FloatArray) -> None:
        airspeed = velocity.copy()
        airspeed[:, :2] -= wind_ne
        self._integral[rows] = self._drag[rows] * airspeed
        self._thrust[rows] = self._tilting[rows] = self._integral[rows]
        self._acceleration[rows] = 0.0
        self._delay.fill(rows, self._integral[rows])


class FleetDynamics:
    """Positions and velocities of a fleet; each vehicle may have its own model.

    Args:
        models: One model per vehicle, or its name.
        position_ned_m: Initial positions, shape (n, 3).
        velocity_ned_mps: Initial velocities, shape (n, 3); by default hovering. The inner state is that of steady
            flight.
        wind_ne_mps: Wind of the steady flight, shape (2,); by default calm air.

    Attributes:
        position_ned_m: Shape (n, 3).
        velocity_ned_mps: Shape (n, 3).
        acceleration_ned_mps2: Mean acceleration over the last tick, shape (n, 3).

    Raises:
        ValueError: If a model is unknown or shapes do not fit.
    """

    def __init__(
        self,
        models: Sequence[Model | str],
        position_ned_m: npt.ArrayLike,
        velocity_ned_mps: npt.ArrayLike = 0.0,
        wind_ne_mps: npt.ArrayLike = 0.0,
    ) -> None:
        chosen = [model_for_speed(model, 0.0) if isinstance(model, str) else model for model in models]
        count = len(chosen)
        self.position_ned_m: FloatArray = np.array(position_ned_m, dtype=np.float64).reshape(count, 3)
        self.velocity_ned_mps: FloatArray = np.zeros((count, 3))
        self.acceleration_ned_mps2: FloatArray = np.zeros((count, 3))
        self._speed_limit = _column(chosen, "speed_limit_mps")
        self._up_limit = -_column(chosen, "climb_limit_mps")
        self._down_limit = _column(chosen, "descent_limit_mps")
        self._groups: list[tuple[npt.NDArray[np.int64], _Group]] = []
        for kind in (Ideal, ShapedTarget, VelocityFeedback):
            rows = np.array([row for row, model in enumerate(chosen) if isinstance(model, kind)], dtype=np.int64)
            if len(rows):
                self._groups.append((rows, _group([chosen[row] for row in rows])))
        self.reset(np.arange(count), self.position_ned_m, velocity_ned_mps, wind_ne_mps)

    def step(
        self,
        command_velocity_ned_mps: npt.ArrayLike,
        dt_s: float,
        airborne: npt.ArrayLike,
        wind_ne_mps: FloatArray = _CALM,
    ) -> None:
        """Fly for ``dt_s`` towards the commanded velocities.

        Args:
            command_velocity_ned_mps: Shape (n, 3), finite; it is clamped to a vehicle's limits.
            dt_s: A multiple of ``TICK_S``.
            airborne: Mask, shape (n,); the others stand still and their inner state is reset.
            wind_ne_mps: Velocity of the air, shape (n, 2) or (1, 2); an ideal vehicle does not feel it.

        Raises:
            ValueError: If ``dt_s`` is not a multiple of ``TICK_S`` or a command is not finite.
        """
        ticks = round(dt_s / TICK_S)
        if ticks < 0 or abs(ticks * TICK_S - dt_s) > 1e-9:
            raise ValueError(f"dt_s must be a multiple of {TICK_S} s, not {dt_s}")
        command = np.array(command_velocity_ned_mps, dtype=np.float64)
        if not np.all(np.isfinite(command)):
            raise ValueError("command_velocity_ned_mps must be finite")
        command[:, :2] = limit_norm(command[:, :2], self._speed_limit)
        np.clip(command[:, 2], self._up_limit, self._down_limit, out=command[:, 2])
        standing = np.flatnonzero(~np.asarray(airborne, dtype=np.bool_))
        for _ in range(ticks):
            self._tick(command, standing, np.broadcast_to(wind_ne_mps, (len(command), 2)))

    def reset(
        self,
        index: npt.ArrayLike,
        position_ned_m: npt.ArrayLike,
        velocity_ned_mps: npt.ArrayLike = 0.0,
        wind_ne_mps: npt.ArrayLike = 0.0,
    ) -> None:
        """Place one vehicle (or several) in steady flight at a position and velocity, in a wind."""
        rows = np.atleast_1d(np.asarray(index, dtype=np.int64))
        self.position_ned_m[rows] = position_ned_m
        velocity = np.broadcast_to(np.asarray(velocity_ned_mps, dtype=np.float64), (len(rows), 3))
        self._settle(rows, velocity, np.broadcast_to(np.asarray(wind_ne_mps, dtype=np.float64), (len(rows), 2)))

    def _settle(self, rows: npt.NDArray[np.int64], velocity: FloatArray, wind_ne: FloatArray) -> None:
        self.velocity_ned_mps[rows] = velocity
        self.acceleration_ned_mps2[rows] = 0.0
        for group_rows, group in self._groups:
            _, within, which = np.intersect1d(group_rows, rows, assume_unique=True, return_indices=True)
            if len(within):
                group.settle(within, velocity[which], wind_ne[which])

    def _tick(self, command: FloatArray, standing: npt.NDArray[np.int64], wind_ne: FloatArray) -> None:
        before = self.velocity_ned_mps
        after = np.empty_like(before)
        for rows, group in self._groups:
            after[rows] = group.step(command[rows], before[rows], wind_ne[rows])
        self.velocity_ned_mps = after
        self.acceleration_ned_mps2 = (after - before) / TICK_S
        if len(standing):
            self._settle(standing, np.zeros((len(standing), 3)), np.zeros((len(standing), 2)))
        # use the new velocity: an ideal vehicle has it for the whole tick
        self.position_ned_m = self.position_ned_m + self.velocity_ned_mps * TICK_S


def _group(models: Sequence[Model]) -> _Group:
    if all(isinstance(model, ShapedTarget) for model in models):
        return _ShapedGroup([model for model in models if isinstance(model, ShapedTarget)])
    if all(isinstance(model, VelocityFeedback) for model in models):
        return _FeedbackGroup([model for model in models if isinstance(model, VelocityFeedback)])
    return _IdealGroup()
