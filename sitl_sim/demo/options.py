"""Options of a demonstration flight."""

from __future__ import annotations

import errno
import importlib.util
import os
from dataclasses import dataclass, field, replace
from pathlib import Path

from ridlink.avoidance.types import SolverKind
from ridlink.errors import ConfigError, MissingExtraError
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.separation.chance import DEFAULT_ETA, ETA_RANGE
from ridlink.separation.definitions import Definition
from sitl_sim.autopilot import Start
from sitl_sim.fleet_config import FleetConfig


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """One flight.

    Args:
        scenario: Name of a built-in scenario, or a TOML file.
        definition: Separation definition that every daemon flies under.
        eta: For the definition chance: probability, at any one instant, that no neighbour comes too close.
        accuracy_convention: For the definition odid-accuracy: how accuracy codes are read.
        solver: The solver.
        vertical: Whether daemons may also climb or descend.
        count: Number of vehicles, if the scenario accepts one.
        speed_mps: Cruise speed of vehicles without one in the scenario.
        interval_s: Time between two Remote ID updates; None: that of the scenario.
        fleet: Seed, autopilot, GNSS, radio, home and ports of the fleet; it holds at its start until the handover, or
            is on the ground until it is conducted.
        processes: Whether each daemon has its own process; otherwise all share one, separate from that of the fleet.
        log: File of the recording; None: a new file in the temporary folder.

    Raises:
        ConfigError: If the options contradict each other.
        MissingExtraError: If conductors are to fly, and MAVSDK is not installed.
        OSError: If there is no folder for the log, or it is one itself.
        ValueError: If the mission of the fleet would begin by itself.
    """

    scenario: str = "circle8"
    definition: Definition = Definition.CANDIDATE2
    eta: float = DEFAULT_ETA
    accuracy_convention: AccuracyConvention = DEFAULT_CONVENTION
    solver: SolverKind = SolverKind.HALFPLANE
    vertical: bool = False
    count: int | None = None
    speed_mps: float = 10.0
    interval_s: float | None = None
    fleet: FleetConfig = field(default_factory=lambda: FleetConfig(start=Start.HOLDING))
    processes: bool = False
    log: Path | None = None

    @property
    def from_ground(self) -> bool:
        """Whether conductors arm the vehicles, take them off and land them."""
        return self.fleet.start is Start.GROUND

    def __post_init__(self) -> None:
        if self.fleet.start is Start.AIRBORNE:
            raise ValueError("a demonstration's fleet holds until it is handed over")
        if self.from_ground and self.fleet.autopilot == "ideal":
            raise ConfigError("ideal vehicles are gone where they arrive: fly --from-ground with px4 or ardupilot")
        if self.from_ground and importlib.util.find_spec("mavsdk") is None:
            raise MissingExtraError("mavsdk", "--from-ground")
        ETA_RANGE.check("eta", self.eta)
        if self.log is not None and self.log.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(self.log))
        if self.log is not None and not self.log.resolve().parent.is_dir():
            raise OSError(errno.ENOENT, f"there is no folder {self.log.resolve().parent}", str(self.log))


def any_free_ports(fleet: FleetConfig) -> FleetConfig:
    """The same fleet on ports that the kernel chooses, so that several can fly side by side."""
    return replace(fleet, vehicle_port=0, companion_port=0, air_port=0)
