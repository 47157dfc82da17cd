"""The true world of one scenario: where every vehicle is, what its receiver says, who hit whom. (interface, being filled)"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Literal

import numpy as np
import numpy.typing as npt

from sitl_sim.scenario import Scenario

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


class VehicleState(IntEnum):
    GROUNDED = 0  # standing; start, or after a landing
    AIRBORNE = 1  # flies the commanded velocity
    LANDING = 2  # the world descends it by itself; commands are ignored
    GONE = 3  # collided, or left (arrival="leave")


class World:
    """Index k is system id k + 1. Everything is NED about home; the ground is down = 0.

    Truth (`position_ned_m`, `velocity_ned_mps`) is for the radio, the referee, logs and observers only; what a vehicle may
    know of itself is `reported_position_ned_m`, `reported_velocity_ned_mps` and the receiver's figures.
    """

    position_ned_m: FloatArray  # (n, 3) true
    velocity_ned_mps: FloatArray  # (n, 3) true
    acceleration_ned_mps2: FloatArray  # (n, 3) true, for ATTITUDE
    reported_position_ned_m: FloatArray  # (n, 3) true + receiver error
    reported_velocity_ned_mps: FloatArray  # (n, 3)
    state: npt.NDArray[np.int64]  # (n,) VehicleState
    active: BoolArray  # (n,) AIRBORNE and still on its mission (not arrived)
    in_air: BoolArray  # (n,) AIRBORNE or LANDING
    arrived: BoolArray  # (n,)
    h_acc_m: FloatArray  # (n,) receiver's one-sigma figures, GPS_RAW_INT h_acc
    v_acc_m: FloatArray
    vel_acc_mps: FloatArray
    bound_3sigma_m: FloatArray  # (n,) for RIDLINK_SEPARATION.horizontal_error
    fix_type: npt.NDArray[np.int64]  # (n,) 3 = fix, 0 = lost (see gnss.set_outage(index, True))
    time_s: float  # simulated time since construction
    mission_time_s: float  # since begin_mission()
    finished: bool  # nobody left to wait for, or mission_time_s >= scenario.duration_s

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int = 1,
        autopilot: str | Sequence[str] = "px4",  # ideal | px4 | ardupilot, one or one per vehicle
        gnss: str = "gauss-markov",  # white | white-radial | gauss-markov | bias
        sigma_m: float = 3.5,  # for vehicles whose scenario entry says nothing
        airborne: bool = True,  # False: all GROUNDED below their start
        arrival: Literal["land", "leave"] = "land",
        pair_radius: Callable[["World"], FloatArray] | None = None,  # (n, n) uNMAC radii now; default Eq. 8
    ) -> None: ...

    def step(self, dt_s: float) -> None:
        """Advance by dt_s; physics runs in whole 20 ms ticks, the remainder is kept."""

    def command_velocity(self, index: int, velocity_ned_mps: npt.ArrayLike) -> None:
        """Velocity [m/s] that the vehicle is to fly from now on (AIRBORNE only; kept until changed)."""

    def lift_off(self, index: int) -> None:
        """GROUNDED -> AIRBORNE (motors up); climbs only when commanded a negative down velocity."""

    def land(self, index: int) -> None:
        """AIRBORNE -> LANDING: stops horizontally, descends, becomes GROUNDED at down = 0."""

    def begin_mission(self) -> None:
        """Mission clock to zero, separation judged from here (called by the constructor when airborne=True)."""

    # verdict() -> sitl_sim.referee.Verdict with as_dict()
