"""What a demonstration flight is made of."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from ridlink.avoidance.types import SolverKind
from ridlink.errors import ConfigError
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import Definition
from sitl_sim.autopilot import Start
from sitl_sim.fleet_config import FleetConfig


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """One flight.

    Args:
        scenario: Name of a built-in scenario, or a TOML file.
        definition: Separation definition that every daemon flies under.
        eta: Of the definition chance: probability, at any one instant, that no neighbour comes too close.
        accuracy_convention: Of the definition odid-accuracy: what all take each other's accuracy codes for.
        solver: What chooses the velocities.
        vertical: Daemons may climb or descend, too.
        count: Number of vehicles, where the scenario takes one.
        speed_mps: Cruise speed of vehicles of which the scenario says nothing.
        interval_s: Time between two Remote ID updates; None: the scenario's.
        fleet: Seed, autopilot, GNSS, radio, home and ports of the fleet; it holds at its start until the handover, or
            stands on the ground until it is conducted.
        processes: Each daemon in a process of its own; otherwise all share one, apart from the fleet's.
        log: Where the flight is recorded; None: a new file in the temporary folder.

    Raises:
        ConfigError: If these do not go together, or there is no folder for the log.
        ValueError: If the fleet would begin by itself.
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
        if not 0.0 < self.eta < 1.0:
            raise ConfigError(f"eta must lie between 0 and 1, ends excluded, got {self.eta:g}")
        if self.log is not None and not self.log.resolve().parent.is_dir():
            raise ConfigError(f"--log {self.log}: there is no folder {self.log.resolve().parent}")


def any_free_ports(fleet: FleetConfig) -> FleetConfig:
    """The same fleet on ports that the kernel chooses, so that several can fly side by side."""
    return replace(fleet, vehicle_port=0, companion_port=0, air_port=0)
