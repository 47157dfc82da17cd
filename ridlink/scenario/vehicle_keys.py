"""Keys of one vehicle that both kinds of scenario files have: TOML keys, GeoJSON properties."""

from __future__ import annotations

from typing import TypedDict

from ridlink.checked_toml import CheckedTable
from ridlink.scenario.model import (
    AUTOPILOTS,
    DEFAULT_AIRFRAME_M,
    LEAST_INTERVAL_S,
    MOST_AIRFRAME_M,
    MOST_INTERVAL_S,
    MOST_SIGMA_M,
)


class VehicleKeys(TypedDict):
    """Arguments of `VehicleSpec`."""

    airframe_m: float
    sigma_m: float | None
    extended: bool
    ghost: bool
    silent: bool
    interval_s: float | None
    airframe: str | None
    autopilot: str | None


def read_vehicle_keys(table: CheckedTable) -> VehicleKeys:
    """The keys of one vehicle, with defaults for those that are missing.

    Raises:
        ConfigError: If a value is of the wrong type, out of range or unknown.
    """
    keys = VehicleKeys(
        airframe_m=table.number("airframe_m", DEFAULT_AIRFRAME_M, above=0.0, most=MOST_AIRFRAME_M),
        sigma_m=table.number("sigma_m", 0.0, least=0.0, most=MOST_SIGMA_M) if table.has("sigma_m") else None,
        extended=table.truth("extended", True),
        ghost=table.truth("ghost", False),
        silent=table.truth("silent", False),
        interval_s=_interval_s(table) if table.has("interval_s") else None,
        airframe=table.text("airframe") if table.has("airframe") else None,
        autopilot=table.text("autopilot") if table.has("autopilot") else None,
    )
    if keys["autopilot"] not in (None, *AUTOPILOTS):
        raise table.fault("autopilot", f"must be {' or '.join(AUTOPILOTS)}, not {keys['autopilot']!r}")
    return keys


def _interval_s(table: CheckedTable) -> float:
    return table.number("interval_s", least=LEAST_INTERVAL_S, most=MOST_INTERVAL_S)
