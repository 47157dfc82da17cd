"""Configuration of a fleet: its autopilots, receivers and radio, and its network ports."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic
from ridlink.scenario import Scenario
from sitl_sim.autopilot import FLAVOURS, Start
from sitl_sim.gnss import CORRELATION_TIME_S, ERROR_MODELS, ErrorModel
from sitl_sim.vehicle import load_airframe

HOST = "127.0.0.1"

MAX_SPEEDUP = 100.0

MAX_VEHICLES = 250
"""System ids begin with 1; ids from 251 on are for ground stations and observers."""

DEFAULT_HOME = Geodetic(47.397742, 8.545594, 488.0)
"""Take-off position of PX4's own simulations."""


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """Configuration of a fleet.

    Args:
        seed: Seed of all random draws.
        autopilot: "px4", "ardupilot" or "ideal", for vehicles without one in the scenario. A vehicle that has arrived
            lands; with "ideal" it disappears at once, as in the paper.
        gnss: Error model; errors of the default wander as those of real receivers do.
        sigma_m: One standard deviation per axis, for vehicles without one in the scenario.
        gnss_common_share: Share of the variance of position errors that all vehicles have in common.
        gnss_time_constant_s: Correlation time of "gauss-markov".
        airframe: Type of vehicles without one in the scenario; None: the measured type.
        start: Initial state of the fleet.
        remote_id: Whether vehicles broadcast by themselves; False leaves it to their daemons.
        technology: Broadcast technology, see ``ridlink.technologies``.
        range_m, loss: Radio range and share lost; None: those of the technology.
        rid_on_bus: Whether a receiver on board of each vehicle delivers Remote ID on the vehicle's own bus.
        ground_station: Connection string of a ground station that is sent the traffic around vehicle 1; None: nowhere.
        speedup: Fleet seconds per real second; 0: lockstep, where `FleetServer.advance` moves time.
        home: Geodetic position of the scenario's origin; None: that of the scenario, else `DEFAULT_HOME`.
        vehicle_port: Port of the first vehicle; 0: the kernel chooses all of them.
        companion_port: Port to which the first vehicle sends its telemetry without request; 0: none.
        air_port: Port of the air; 0: the kernel chooses.

    Raises:
        ConfigError: If a figure is out of range.
    """

    seed: int = 1
    autopilot: str = "px4"
    gnss: ErrorModel = "gauss-markov"
    sigma_m: float = 3.5
    gnss_common_share: float = 0.0
    gnss_time_constant_s: float = CORRELATION_TIME_S
    airframe: str | None = None
    start: Start = Start.GROUND
    remote_id: bool = True
    technology: str = "ideal"
    range_m: float | None = None
    loss: float | None = None
    rid_on_bus: bool = False
    ground_station: str | None = None
    speedup: float = 1.0
    home: Geodetic | None = None
    vehicle_port: int = 14580
    companion_port: int = 14540
    air_port: int = 14650

    def __post_init__(self) -> None:
        if self.autopilot not in FLAVOURS:
            raise ConfigError(f"unknown autopilot '{self.autopilot}': known are {', '.join(FLAVOURS)}")
        if self.gnss not in ERROR_MODELS:
            raise ConfigError(f"unknown GNSS error model '{self.gnss}': known are {', '.join(ERROR_MODELS)}")
        if self.seed < 0:
            raise ConfigError(f"the seed must not be negative, not {self.seed}")
        if not (math.isfinite(self.sigma_m) and self.sigma_m >= 0.0):
            raise ConfigError(f"sigma must be finite and not negative, not {self.sigma_m}")
        if not 0.0 <= self.gnss_common_share <= 1.0:
            raise ConfigError(f"the common share must be between 0 and 1, not {self.gnss_common_share}")
        if self.gnss_common_share and self.gnss == "white-radial":
            raise ConfigError("white-radial errors have no common share; use white")
        if not (math.isfinite(self.gnss_time_constant_s) and self.gnss_time_constant_s > 0.0):
            raise ConfigError(f"the time constant must be positive and finite, not {self.gnss_time_constant_s}")
        if not (math.isfinite(self.speedup) and 0.0 <= self.speedup <= MAX_SPEEDUP):
            raise ConfigError(f"the speedup must be between 0 and {MAX_SPEEDUP:g}, not {self.speedup}")
        if self.airframe is not None:
            load_airframe(self.airframe).model(self.autopilot)
        home = self.home or DEFAULT_HOME
        if not (abs(home.latitude_deg) <= 90.0 and abs(home.longitude_deg) <= 180.0 and math.isfinite(home.altitude_m)):
            raise ConfigError(f"no such home: {home.latitude_deg}, {home.longitude_deg}, {home.altitude_m}")

    def home_of(self, scenario: Scenario) -> Geodetic:
        """Geodetic position of the origin of a scenario."""
        if self.home is not None:
            return self.home
        return DEFAULT_HOME if scenario.home_deg_m is None else Geodetic(*scenario.home_deg_m)

    def autopilots_of(self, scenario: Scenario) -> tuple[str, ...]:
        """The autopilot of every vehicle of a scenario.

        Raises:
            ConfigError: If there are more vehicles than system ids, or a vehicle has its own autopilot in an ideal
                fleet, whose vehicles obey at once and disappear where they arrive.
        """
        if len(scenario.vehicles) > MAX_VEHICLES:
            raise ConfigError(
                f"{scenario.name}: {len(scenario.vehicles)} vehicles are more than the {MAX_VEHICLES} that have a "
                f"system id of their own; -n {MAX_VEHICLES} flies the first ones"
            )
        for number, vehicle in enumerate(scenario.vehicles, start=1):
            if vehicle.autopilot is not None and self.autopilot == "ideal":
                raise ConfigError(
                    f"vehicle {number} has the autopilot {vehicle.autopilot}: in an ideal fleet nobody has; "
                    "use --autopilot px4 or ardupilot for the others"
                )
        return tuple(vehicle.autopilot or self.autopilot for vehicle in scenario.vehicles)

    def check_ports(self, vehicles: int) -> None:
        """Check that no port is used twice.

        Raises:
            ConfigError: If the ports of this many vehicles overlap, or there are not enough ports.
        """
        blocks = [("vehicle", self.vehicle_port, vehicles), ("companion", self.companion_port, vehicles)]
        blocks = [block for block in [*blocks, ("air", self.air_port, 1)] if block[1] and block[2]]
        for name, first, count in blocks:
            if not (first > 0 and first + count - 1 <= 65535):
                raise ConfigError(f"the {name} port must be between 1 and {65536 - count}, not {first}")
        for at, (name, first, count) in enumerate(blocks):
            for other, other_first, other_count in blocks[at + 1 :]:
                if first < other_first + other_count and other_first < first + count:
                    raise ConfigError(
                        f"{vehicles} vehicles: the {name} ports from {first} and the {other} ports from {other_first} "
                        "overlap; move them with --vehicle-port, --companion-port or --air-port"
                    )


@dataclass(frozen=True, slots=True)
class FleetPorts:
    """UDP ports as bound: one per vehicle in the order of system ids, and that of the air."""

    vehicles: tuple[int, ...]
    air: int
