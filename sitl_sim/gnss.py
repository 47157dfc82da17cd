"""The error of a vehicle's position, and the accuracy that its receiver reports.

Units and axes: metres, metres a second; north-east-down; shape (n, 3) for errors, (n,) for figures. ``sigma_m`` is one
standard deviation per horizontal axis; the vertical one is 1.5 times that, the usual ratio of satellite geometry.

A receiver has ten solutions a second, with a new error in each, for any interval of Remote ID.

Error models:

- white: a new normal draw at every solution; what most simulations, and the paper, assume.
- white-radial: as the paper does it, ``|N(0, sigma^2)| (cos phi, sin phi)``, new at every solution. Its radius is
  half-normal, so one axis has a standard deviation of sigma / sqrt(2) only; the figures reported stay those of sigma.
- gauss-markov: correlated over 10 s, as real receivers wander; the stationary deviation is sigma.
- bias: one draw for the whole flight.

Neighbours see the same satellites through the same air: `common_share` of the variance is drawn once for the whole
fleet, and cancels between any two vehicles.

The true error and the reported accuracy may differ. A receiver does not notice a jump (multipath) or a spoofer's
pull-off, so its reported accuracy stays; `set_sigma` with a claim makes it report a wrong accuracy all the time.

Convention: ``h_acc_m`` is one standard deviation per horizontal axis, as PX4 and ArduPilot pass it on from their
receivers in GPS_RAW_INT. A disc of three of them holds 98.9 % of the positions in two dimensions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from sitl_sim.draws import NormalDraws, Stream, vehicle_generator

FloatArray = npt.NDArray[np.float64]

ErrorModel = Literal["white", "white-radial", "gauss-markov", "bias"]
ERROR_MODELS: tuple[ErrorModel, ...] = get_args(ErrorModel)

SOLUTION_INTERVAL_S = 0.1
"""Time between two solutions of a receiver: 10 Hz, as for receivers of flight controllers."""

CORRELATION_TIME_S = 10.0
"""Time constant of the gauss-markov model."""

VERTICAL_RATIO = 1.5
"""Vertical sigma by horizontal sigma."""

VELOCITY_SIGMA_MPS = 0.1
"""Standard deviation of the reported velocity per axis, white noise: carrier phase measures velocity well."""

LEAST_REPORTED_M = 0.001
"""A receiver never claims perfection: GPS_RAW_INT has millimetres, where 0 means unknown."""

DRIFT_MPS2 = 0.06
"""Assumed acceleration error of dead reckoning after a loss of the fix: half of it times t^2 follows PX4's own figure
(0.5 m after 1.9 s, about 20 m after 25 s)."""

FIX_3D = 3
NO_FIX = 0

EKF_SHARE = 0.32
"""Accuracy reported by PX4's estimator divided by that of the receiver, as measured (0.29 m for 0.9 m)."""

QUIET_RATIO = 0.05
"""Innovation test ratio in quiet flight."""

GATE_SIGMAS = 5.0
"""PX4's EKF2_GPS_P_GATE: an innovation of this many standard deviations has a test ratio of one."""

INNOVATION_S = 5.0
"""Assumed time in which an estimator adopts a position that has jumped."""

_DRAWS = 7  # position, velocity, one spare for the radius: the same number for every model keeps velocities alike


class GnssReceivers:
    """The receivers of a fleet, one generator each, so that vehicle k has the same errors in any fleet.

    Args:
        model: One of ``ERROR_MODELS``.
        sigma_m: Standard deviation per horizontal axis, shape (n,); 0 = exact position (and velocity).
        seed: Seed of the run.
        interval_s: Time between two solutions; errors change only there.
        common_share: Share of the variance that all vehicles have in common.
        time_constant_s: Correlation time of the gauss-markov model.

    Attributes:
        position_error_ned_m: Reported less true position now, shape (n, 3).
        velocity_error_ned_mps: Reported less true velocity now, shape (n, 3).
        fix_type: As in GPS_RAW_INT, shape (n,): 3, or 0 during an outage.

    Raises:
        ValueError: If the model is unknown, or a sigma or the interval is out of range.
    """

    def __init__(
        self,
        model: ErrorModel,
        sigma_m: npt.ArrayLike,
        *,
        seed: int | Sequence[int] = 1,
        interval_s: float = SOLUTION_INTERVAL_S,
        common_share: float = 0.0,
        time_constant_s: float = CORRELATION_TIME_S,
    ) -> None:
        if model not in ERROR_MODELS:
            raise ValueError(f"unknown error model {model!r}: known are {', '.join(ERROR_MODELS)}")
        self._sigma_m: FloatArray = np.array(sigma_m, dtype=np.float64)
        if self._sigma_m.ndim != 1 or not np.all(np.isfinite(self._sigma_m)) or np.any(self._sigma_m < 0.0):
            raise ValueError("sigma_m must be one finite, not negative figure for each vehicle")
        if not (math.isfinite(interval_s) and interval_s > 0.0):
            raise ValueError(f"interval_s must be positive and finite, not {interval_s}")
        if not 0.0 <= common_share <= 1.0:
            raise ValueError(f"common_share must be between 0 and 1, not {common_share}")
        if common_share and model == "white-radial":
            raise ValueError("white-radial has no common share: its sum with another is not half-normal any more")
        if not (math.isfinite(time_constant_s) and time_constant_s > 0.0):
            raise ValueError(f"time_constant_s must be positive and finite, not {time_constant_s}")
        count = len(self._sigma_m)
        self.model = model
        self.interval_s = interval_s
        self.fix_type: npt.NDArray[np.int64] = np.full(count, FIX_3D, dtype=np.int64)
        self._draws = NormalDraws(seed, Stream.GNSS, count, _DRAWS)
        self._common = vehicle_generator(seed, Stream.GNSS_COMMON, 0)
        self._common_share = common_share
        self._keep = math.exp(-interval_s / time_constant_s)
        self._since_solution_s = 0.0
        self._unit_error = np.zeros((count, 3))
        self._outage_s = np.zeros(count)
        self._claimed_m = self._sigma_m.copy()
        self._jump_m = np.zeros((count, 3))
        self._pull_mps = np.zeros((count, 2))
        self._pulled_m = np.zeros((count, 2))
        self._innovation_m = np.zeros(count)
        self.position_error_ned_m: FloatArray = np.zeros((count, 3))
        self.velocity_error_ned_mps: FloatArray = np.zeros((count, 3))
        self._solve(first=True)

    def step(self, dt_s: float) -> None:
        """Let time pass; a new error appears with every solution."""
        self._outage_s[self.fix_type == NO_FIX] += dt_s
        self._pulled_m += self._pull_mps * dt_s
        self._innovation_m *= math.exp(-dt_s / INNOVATION_S)
        self._since_solution_s += dt_s
        while self._since_solution_s >= self.interval_s - 1e-9:
            self._since_solution_s -= self.interval_s
            self._solve(first=False)

    @property
    def h_acc_m(self) -> FloatArray:
        """Horizontal accuracy reported by the receiver: one standard deviation per axis, shape (n,)."""
        return np.maximum(self._claimed_m, LEAST_REPORTED_M) + self._drift_m()

    @property
    def v_acc_m(self) -> FloatArray:
        """Vertical accuracy reported by the receiver: one standard deviation, shape (n,)."""
        return np.maximum(VERTICAL_RATIO * self._claimed_m, LEAST_REPORTED_M) + self._drift_m()

    @property
    def vel_acc_mps(self) -> FloatArray:
        """Velocity accuracy reported by the receiver: one standard deviation per axis, shape (n,)."""
        return np.where(self._claimed_m > 0.0, VELOCITY_SIGMA_MPS, LEAST_REPORTED_M)

    @property
    def bound_3sigma_m(self) -> FloatArray:
        """Three reported standard deviations per horizontal axis, shape (n,); 0 if the position is exact."""
        return 3.0 * (self._claimed_m + self._drift_m())

    @property
    def ekf_h_acc_m(self) -> FloatArray:
        """Horizontal accuracy reported by PX4's estimator, shape (n,): a smaller value than that of its receiver."""
        return EKF_SHARE * np.maximum(self._claimed_m, LEAST_REPORTED_M) + self._drift_m()

    @property
    def innovation_ratio(self) -> FloatArray:
        """Test ratio of the estimator's horizontal position, shape (n,): above one, the receiver contradicts it."""
        gate_m = GATE_SIGMAS * np.maximum(self._claimed_m, 1.0)
        return QUIET_RATIO + (self._innovation_m / gate_m) ** 2

    def set_sigma(self, index: int, sigma_m: float, claimed_m: float | None = None) -> None:
        """Set the accuracy of one vehicle from its next solution on, and the accuracy that it claims (by default the
        true one).

        Raises:
            ValueError: If a figure is negative or not finite.
        """
        for figure in (sigma_m, sigma_m if claimed_m is None else claimed_m):
            if not (math.isfinite(figure) and figure >= 0.0):
                raise ValueError(f"sigma_m must be finite and not negative, not {figure}")
        self._sigma_m[index] = sigma_m
        self._claimed_m[index] = sigma_m if claimed_m is None else claimed_m

    def set_jump(self, index: int, offset_ned_m: npt.ArrayLike) -> None:
        """Offset the reported position of one vehicle, unnoticed by its receiver. Zero ends it.

        Raises:
            ValueError: If these are not three finite figures, north, east and down.
        """
        offset = np.asarray(offset_ned_m, dtype=np.float64)
        if offset.shape != (3,) or not np.all(np.isfinite(offset)):
            raise ValueError("offset_ned_m must be three finite figures")
        self._innovation_m[index] = np.hypot(*(offset - self._jump_m[index])[:2])
        self._jump_m[index] = offset

    def set_pull(self, index: int, velocity_ne_mps: npt.ArrayLike) -> None:
        """Pull the reported position of one vehicle away at a velocity, as a spoofer does: position and velocity agree.

        Raises:
            ValueError: If these are not two finite figures, north and east.
        """
        velocity = np.asarray(velocity_ne_mps, dtype=np.float64)
        if velocity.shape != (2,) or not np.all(np.isfinite(velocity)):
            raise ValueError("velocity_ne_mps must be two finite figures")
        self._pull_mps[index] = velocity

    def release(self, index: int) -> None:
        """End the spoofing: reports are as without it."""
        self._innovation_m[index] = max(self._innovation_m[index], np.hypot(*self._pulled_m[index]))
        self._pull_mps[index] = self._pulled_m[index] = 0.0

    def restore(self, index: int, sigma_m: float) -> None:
        """Restore a receiver: no outage, no jump, no spoofer, and a true reported accuracy."""
        self.set_outage(index, False)
        self.set_jump(index, np.zeros(3))
        self.release(index)
        self.set_sigma(index, sigma_m)

    def set_outage(self, index: int, lost: bool) -> None:
        """Take the fix from one vehicle, or give it back; in an outage its position drifts north with growing speed."""
        self.fix_type[index] = NO_FIX if lost else FIX_3D
        self._outage_s[index] = 0.0

    def _drift_m(self) -> FloatArray:
        return 0.5 * DRIFT_MPS2 * self._outage_s**2

    def _solve(self, *, first: bool) -> None:
        draws = self._draws.next()
        fresh = draws[:, :3]
        if self._common_share:
            common = self._common.standard_normal(3)
            fresh = math.sqrt(1.0 - self._common_share) * fresh + math.sqrt(self._common_share) * common
        match self.model:
            case "white":
                self._unit_error = fresh.copy()
            case "white-radial":
                # the direction of a two-dimensional normal draw is uniform
                direction = fresh[:, :2] / np.maximum(np.hypot(fresh[:, 0], fresh[:, 1]), 1e-300)[:, None]
                self._unit_error[:, :2] = np.abs(draws[:, 6:]) * direction
                self._unit_error[:, 2] = fresh[:, 2]
            case "gauss-markov":
                if first:
                    self._unit_error = fresh.copy()
                else:
                    self._unit_error = self._keep * self._unit_error + math.sqrt(1.0 - self._keep**2) * fresh
            case "bias":
                if first:
                    self._unit_error = fresh.copy()
        axes = np.array([1.0, 1.0, VERTICAL_RATIO])
        drift = self._drift_m()[:, None] * np.array([1.0, 0.0, 0.0])
        self.position_error_ned_m = self._unit_error * self._sigma_m[:, None] * axes + drift + self._jump_m
        self.position_error_ned_m[:, :2] += self._pulled_m
        self.velocity_error_ned_mps = np.where(self._sigma_m > 0.0, VELOCITY_SIGMA_MPS, 0.0)[:, None] * draws[:, 3:6]
        self.velocity_error_ned_mps[:, :2] += self._pull_mps
