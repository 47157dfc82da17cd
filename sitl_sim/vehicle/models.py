"""Parameters of the response models of a vehicle.

Units: metres, seconds, radians. The TOML files of ``airframes`` give the sources of the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

TICK_S = 0.02
"""Length of one physics step."""

GRAVITY_MPS2 = 9.80665

MEASURED_SPEED_MPS = 10.0
"""Fastest cruise at which the models were measured."""


@dataclass(frozen=True, slots=True)
class Ideal:
    """The commanded velocity at once.

    Args:
        speed_limit_mps: Largest horizontal speed; the paper's fastest category reaches 51.5.
        climb_limit_mps, descent_limit_mps: Largest vertical speeds.
    """

    speed_limit_mps: float = 60.0
    climb_limit_mps: float = 10.0
    descent_limit_mps: float = 10.0


@dataclass(frozen=True, slots=True)
class ShapedTarget:
    """ArduPilot: a target limited in jerk and acceleration, followed exactly after a delay and a lag.

    Args:
        speed_limit_mps: Speed at which the lean angle (ANGLE_MAX) balances the drag.
        climb_limit_mps, descent_limit_mps: WPNAV_SPEED_UP and _DN do not clip a velocity setpoint; these do.
        acceleration_mps2, jerk_mps3: WPNAV_ACCEL and PSC_JERK_XY.
        vertical_acceleration_mps2, vertical_jerk_mps3: WPNAV_ACCEL_Z and PSC_JERK_Z.
        gain_per_s: Slope of the square-root controller near its target.
        delay_s, lag_s: Pure delay and first-order lag behind the target.
        gust_per_s: Acceleration for each m/s of a gust, before the controller compensates it.
    """

    speed_limit_mps: float
    climb_limit_mps: float
    descent_limit_mps: float
    acceleration_mps2: float
    jerk_mps3: float
    vertical_acceleration_mps2: float
    vertical_jerk_mps3: float
    gain_per_s: float
    delay_s: float
    lag_s: float
    gust_per_s: float


@dataclass(frozen=True, slots=True)
class VelocityFeedback:
    """PX4 in OFFBOARD: feedback of velocity, limited by tilt, through two lags, against drag.

    Args:
        speed_limit_mps: MPC_XY_VEL_MAX.
        climb_limit_mps, descent_limit_mps: MPC_Z_VEL_MAX_UP and MPC_Z_VEL_MAX_DN.
        tilt_limit_deg: MPC_TILTMAX_AIR.
        p_per_s, i_per_s2, d: MPC_XY_VEL_P_ACC, _I_ACC, _D_ACC.
        vertical_p_per_s, vertical_i_per_s2: MPC_Z_VEL_P_ACC, _I_ACC.
        drag_per_s, vertical_drag_per_s: Deceleration for each m/s of airspeed.
        delay_s, vertical_delay_s: Pure delay of the loop.
        lag_s, second_lag_s: First-order lags of attitude, one behind the other.
        vertical_lag_s: Lag of thrust.
        climb_acceleration_mps2: Upward acceleration at full thrust, less gravity; downwards it is gravity at zero
            thrust.
    """

    speed_limit_mps: float
    climb_limit_mps: float
    descent_limit_mps: float
    tilt_limit_deg: float
    p_per_s: float
    i_per_s2: float
    d: float
    vertical_p_per_s: float
    vertical_i_per_s2: float
    drag_per_s: float
    vertical_drag_per_s: float
    delay_s: float
    lag_s: float
    second_lag_s: float
    vertical_delay_s: float
    vertical_lag_s: float
    climb_acceleration_mps2: float


Model = Ideal | ShapedTarget | VelocityFeedback


def made_for_speed(model: Model, speed_mps: float) -> Model:
    """The model, made fast enough for a cruise speed.

    If the cruise speed exceeds the limit, the speed limit is raised to it and the drag is reduced in proportion;
    otherwise the vehicle could not reach the speed.
    """
    if speed_mps <= model.speed_limit_mps:
        return model
    if isinstance(model, VelocityFeedback):
        drag_per_s = model.drag_per_s * MEASURED_SPEED_MPS / speed_mps
        return replace(model, speed_limit_mps=speed_mps, drag_per_s=min(drag_per_s, model.drag_per_s))
    return replace(model, speed_limit_mps=speed_mps)
