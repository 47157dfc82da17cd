"""The height error of an estimator: the barometer determines quick changes, the receiver slow ones.

Units and axes: metres, downwards; shape (n,) for a fleet. A barometer senses climbs of decimetres and drifts with the
weather; a receiver knows the absolute height and wanders by metres within seconds. Estimators fuse both (PX4's EKF2 and
ArduPilot's EKF3 do by default), so a vehicle that holds its height does not follow its receiver up and down.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

FOLLOWS_RECEIVER_S = 100.0
"""Assumed time constant with which an estimator follows its receiver's height. With errors of 5.25 m that are
correlated over 10 s, the default of the emulator, heights wander by 1.6 m and drift at 0.05 m/s."""


class HeightEstimators:
    """The heights of a fleet.

    Args:
        receiver_error_m: Reported less true position of the receivers at the start, downwards, shape (n,).

    Attributes:
        error_down_m: Estimated less true position now, downwards, shape (n,).
    """

    def __init__(self, receiver_error_m: FloatArray) -> None:
        self.error_down_m: FloatArray = np.array(receiver_error_m, dtype=np.float64)

    def step(self, receiver_error_m: FloatArray, dt_s: float) -> None:
        """Let time pass.

        Args:
            receiver_error_m: Errors of the receivers now, shape (n,).
            dt_s: Time step [s].
        """
        self.error_down_m += -math.expm1(-dt_s / FOLLOWS_RECEIVER_S) * (receiver_error_m - self.error_down_m)
