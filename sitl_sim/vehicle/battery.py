"""Batteries of a fleet, and their discharge.

Units: watts, watt-hours, volts, amperes; arrays are (n,). A multirotor spends most of its power on hovering; climbing
adds weight times climb rate, here as a share of the hover power, and flying fast adds drag. All figures are assumed: it
is enough that a battery gives plausible readings and becomes empty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

STANDBY_SHARE = 0.03
"""Power on the ground, as a share of hover power."""

CLIMB_SHARE_PER_MPS = 0.1
"""Power added for each m/s of climb, as a share of hover power; a descent saves half as much."""

DRAG_SHARE = 0.002
"""Power added by flying at 1 m/s, as a share of hover power. It grows with the square of the speed: drag power grows
with the cube, but lift costs less in forward flight."""

SECONDS_PER_HOUR = 3600.0

CELL_CHARGE = (0.0, 0.05, 0.2, 0.5, 0.8, 1.0)
CELL_VOLTS = (3.0, 3.5, 3.68, 3.8, 4.0, 4.2)
"""Voltage of a lithium-polymer cell at rest by remaining charge: a typical discharge curve."""

SAG_SHARE = 0.03
"""Share of voltage lost in the internal resistance at hover power."""

MOST_SAG_SHARE = 0.3
"""Limit of this loss, for vehicles so fast that the drag above is no longer that of a multirotor."""


@dataclass(frozen=True, slots=True)
class BatteryType:
    """What an airframe carries: cells in series, energy when full [Wh], power to hover [W]."""

    cells: float
    capacity_wh: float
    hover_w: float


class FleetBattery:
    """The batteries of a fleet.

    Args:
        types: One per vehicle.

    Attributes:
        remaining: Share of the energy left, within 0 and 1, shape (n,).
        power_w: Power drawn over the last step, shape (n,).
    """

    def __init__(self, types: Sequence[BatteryType]) -> None:
        self._cells = np.array([each.cells for each in types], dtype=np.float64)
        self._capacity_wh = np.array([each.capacity_wh for each in types], dtype=np.float64)
        self._hover_w = np.array([each.hover_w for each in types], dtype=np.float64)
        self.remaining: FloatArray = np.ones(len(types))
        self.power_w: FloatArray = STANDBY_SHARE * self._hover_w

    def step(self, velocity_ned_mps: FloatArray, in_air: BoolArray, dt_s: float) -> None:
        """Discharge all batteries for ``dt_s``."""
        speed_2 = velocity_ned_mps[:, 0] ** 2 + velocity_ned_mps[:, 1] ** 2
        climb_mps = -velocity_ned_mps[:, 2]
        climb = CLIMB_SHARE_PER_MPS * np.where(climb_mps > 0.0, climb_mps, 0.5 * climb_mps)
        flying = np.maximum(1.0 + climb + DRAG_SHARE * speed_2, 0.5)
        self.power_w = self._hover_w * np.where(in_air, flying, STANDBY_SHARE)
        self.remaining = np.maximum(self.remaining - self.power_w * dt_s / (SECONDS_PER_HOUR * self._capacity_wh), 0.0)

    def set_remaining(self, index: int, share: float) -> None:
        """Set the remaining share of one battery.

        Raises:
            ValueError: If the share is not between 0 and 1.
        """
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"a battery holds a share between 0 and 1, not {share}")
        self.remaining[index] = share

    @property
    def voltage_v(self) -> FloatArray:
        """Voltage at the terminals under load, shape (n,)."""
        at_rest = np.interp(self.remaining, CELL_CHARGE, CELL_VOLTS)
        sag = np.minimum(SAG_SHARE * self.power_w / self._hover_w, MOST_SAG_SHARE)
        return np.asarray(self._cells * at_rest * (1.0 - sag))

    @property
    def current_a(self) -> FloatArray:
        """Shape (n,)."""
        return np.asarray(self.power_w / self.voltage_v)
