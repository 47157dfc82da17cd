"""The flight controller of one vehicle: facts that every part of its autopilot needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ridlink.geodesy import Geodetic
from ridlink.scenario import Event, VehicleSpec
from sitl_sim.autopilot.modes import Flavour
from sitl_sim.autopilot.parameters import Parameters
from sitl_sim.autopilot.results import Say


@dataclass(slots=True)
class Board:
    """The facts of one vehicle; only its home, the height of its origin and the values of its parameters change.

    Args:
        system_id: System id of the vehicle.
        spec: Its part of the scenario.
        flavour: The autopilot that it emulates.
        parameters: Its parameters.
        scenario_home: Origin of the scenario's coordinates.
        own_origin: Origin of its local frame: the ground below its start, at the height of home.
        own_home: The ground where it was switched on or armed, at the height that its estimator had then; heights count
            from there.
        say: Called with severity and text of a STATUSTEXT.
        inject: Called with a failure of the vehicle.
    """

    system_id: int
    spec: VehicleSpec
    flavour: Flavour
    parameters: Parameters
    scenario_home: Geodetic
    own_origin: Geodetic
    own_home: Geodetic
    say: Say
    inject: Callable[[Event], None]

    @property
    def is_px4(self) -> bool:
        """Whether it behaves like PX4, not like ArduPilot."""
        return self.flavour.is_px4
