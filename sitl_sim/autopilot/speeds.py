"""Speeds and heights from the parameters of an autopilot, in SI units."""

from __future__ import annotations

from sitl_sim.autopilot.guidance import STILL, GoTo
from sitl_sim.autopilot.modes import Flavour
from sitl_sim.autopilot.navigation import Vector
from sitl_sim.autopilot.parameters import Parameters

CRUISE, CLIMB, DESCENT = 1, 2, 3
"""SPEED_TYPE of DO_CHANGE_SPEED; all other values mean cruise, too."""


class Speeds:
    """Speeds, heights and radii of one vehicle, read each time, since parameters change in flight.

    Args:
        flavour: The autopilot.
        parameters: Parameters, in metres for PX4, in centimetres for ArduPilot.
    """

    def __init__(self, flavour: Flavour, parameters: Parameters) -> None:
        self._px4, self._parameters = flavour.is_px4, parameters
        self._asked_mps: dict[int, float] = {}

    def change(self, kind: float, speed_mps: float) -> None:
        """Execute DO_CHANGE_SPEED.

        PX4 ignores the kind, and returns to its parameter for a speed that is not above zero; ArduPilot ignores such a
        speed.
        """
        if speed_mps > 0.0:
            self._asked_mps[int(kind) if kind in (CLIMB, DESCENT) and not self._px4 else CRUISE] = speed_mps
        elif self._px4:
            self.forget()

    def forget(self) -> None:
        """Return to the parameters, as either autopilot does in the next mode."""
        self._asked_mps.clear()

    def _figure(self, px4: str, ardupilot: str) -> float:
        return self._parameters[px4] if self._px4 else self._parameters[ardupilot] / 100.0

    @property
    def fastest_mps(self) -> float:
        """Speed towards a position setpoint."""
        return self._figure("MPC_XY_VEL_MAX", "WPNAV_SPEED")

    @property
    def cruise_mps(self) -> float:
        """Speed of missions, repositions and the return."""
        return self._asked_mps.get(CRUISE) or self._figure("MPC_XY_CRUISE", "WPNAV_SPEED")

    @property
    def climb_mps(self) -> float:
        """Up."""
        return self._asked_mps.get(CLIMB) or self._figure("MPC_Z_VEL_MAX_UP", "WPNAV_SPEED_UP")

    @property
    def descent_mps(self) -> float:
        """Down."""
        return self._asked_mps.get(DESCENT) or self._figure("MPC_Z_VEL_MAX_DN", "WPNAV_SPEED_DN")

    @property
    def takeoff_mps(self) -> float:
        """Up from the ground."""
        return self._figure("MPC_TKO_SPEED", "WPNAV_SPEED_UP")

    @property
    def return_height_m(self) -> float:
        """Least height of the return."""
        return self._figure("RTL_RETURN_ALT", "RTL_ALT")

    @property
    def acceptance_radius_m(self) -> float:
        """Distance at which a waypoint counts as reached."""
        return self._figure("NAV_ACC_RAD", "WPNAV_RADIUS")

    def way_to(
        self, target_ned_m: Vector, speed_mps: float | None = None, feed_forward_ned_mps: Vector = STILL
    ) -> GoTo:
        """The way to a point about the scenario's home; at cruise speed unless another is given."""
        pace_mps = self.cruise_mps if speed_mps is None else speed_mps
        return GoTo(target_ned_m, pace_mps, self.climb_mps, self.descent_mps, feed_forward_ned_mps)
