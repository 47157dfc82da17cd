"""The flight controller of one vehicle: what every part of its autopilot has to know of it."""

from __future__ import annotations

from dataclasses import dataclass

from ridlink.geodesy import Geodetic
from ridlink.scenario import VehicleSpec
from sitl_sim.autopilot.modes import Flavour
from sitl_sim.autopilot.parameters import Parameters
from sitl_sim.autopilot.results import Say


@dataclass(slots=True)
class Board:
    """One vehicle's; only its home, the height of its origin and the values of its parameters change.

    Args:
        system_id: Of the vehicle.
        spec: Its part of the scenario.
        flavour: Whose habits it has.
        parameters: Its parameters.
        scenario_home: Origin of the scenario's coordinates.
        own_origin: Origin of its local frame: the ground below its start, as high as home.
        own_home: The ground where it was switched on or armed, as high as its estimator said then: heights count from
            there.
        say: Called with what STATUSTEXT is to carry.
    """

    system_id: int
    spec: VehicleSpec
    flavour: Flavour
    parameters: Parameters
    scenario_home: Geodetic
    own_origin: Geodetic
    own_home: Geodetic
    say: Say

    @property
    def is_px4(self) -> bool:
        """Whether it behaves like PX4, not like ArduPilot."""
        return self.flavour.is_px4
