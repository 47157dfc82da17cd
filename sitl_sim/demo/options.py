"""What a demonstration flight is made of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic

IDEAL = "ideal"


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """One flight. Defaults are those of the command line.

    Args:
        scenario: Name of a built-in scenario, or a TOML file.
        definition: Separation definition that every daemon flies under.
        seed: Seed of every chance in it.
        count: Number of vehicles, where the scenario takes one.
        speed_mps: Cruise speed of vehicles of which the scenario says nothing.
        autopilot: Response and MAVLink face: px4, ardupilot or ideal.
        gnss: How sigma becomes an error.
        sigma_m: One standard deviation per axis, for vehicles of which the scenario says nothing.
        interval_s: Time between two Remote ID updates; None: the scenario's.
        technology: Radio technology of the air.
        loss: Share of broadcasts that a receiver loses; None: the technology's.
        range_m: Radio range; None: the technology's.
        home: Where the scenario's origin lies.
        processes: Each daemon in an operating-system process of its own.
        fixed_ports: The documented ports (14540.., 14580.., 14650); False: whatever is free.
        log: Where the flight is recorded; None: a new file in the temporary folder.
    """

    scenario: str = "circle8"
    definition: str = "candidate2"
    seed: int = 1
    count: int | None = None
    speed_mps: float = 10.0
    autopilot: str = "px4"
    gnss: str = "gauss-markov"
    sigma_m: float = 3.5
    interval_s: float | None = None
    technology: str = IDEAL
    loss: float | None = None
    range_m: float | None = None
    home: Geodetic = Geodetic(47.3977, 8.5456, 488.0)
    processes: bool = False
    fixed_ports: bool = True
    log: Path | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.speed_mps <= 60.0:
            raise ConfigError(f"--speed must be above 0 and at most 60 m/s, not {self.speed_mps:g}")
        if not 0.0 <= self.sigma_m <= 1000.0:
            raise ConfigError(f"--sigma must be between 0 and 1000 m, not {self.sigma_m:g}")
        if self.loss is not None and not 0.0 <= self.loss < 1.0:
            raise ConfigError(f"--loss must be at least 0 and below 1, not {self.loss:g}")
        if self.interval_s is not None and not 0.02 <= self.interval_s <= 10.0:
            raise ConfigError(f"--interval must be between 0.02 and 10 s, not {self.interval_s:g}")
        if self.log is not None and not self.log.resolve().parent.is_dir():
            raise ConfigError(f"--log {self.log}: there is no folder {self.log.resolve().parent}")
