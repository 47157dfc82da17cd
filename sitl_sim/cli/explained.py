"""Text for ``ridlink sim --list`` and ``--explain``."""

from __future__ import annotations

import math
from dataclasses import asdict
from itertools import pairwise
from typing import Any

from ridlink.scenario import BUILT_IN, EVENTS, Scenario, VehicleSpec
from ridlink.technologies import TECHNOLOGIES
from ridlink.words import counted
from sitl_sim.cli.options import ACCURACY_CLASSES
from sitl_sim.fleet_config import FleetConfig
from sitl_sim.vehicle import AIRFRAMES, MEASURED, load_airframe, model_for_speed


def choices() -> dict[str, dict[str, Any]]:
    """Everything that the options can name, by kind and name, as ``--list --json`` prints it."""
    return {
        "scenarios": {name: (make.__doc__ or "").strip() for name, make in BUILT_IN.items()},
        "airframes": {name: load_airframe(name).title for name in AIRFRAMES},
        "accuracy_classes_sigma_m": ACCURACY_CLASSES,
        "technologies": {name: asdict(each) for name, each in TECHNOLOGIES.items()},
        "faults": {what: {name: asdict(each) for name, each in figures.items()} for what, figures in EVENTS.items()},
    }


def everything() -> str:
    """Text of ``--list``: the same for people."""
    found = choices()
    lines = ["scenarios (--scenario):"]
    lines += [f"  {name:16}{text}" for name, text in found["scenarios"].items()]
    lines += ["", "airframes (--airframe, or airframe of a vehicle):"]
    lines += [f"  {name:16}{title}" for name, title in found["airframes"].items()]
    lines += ["", "accuracy classes (--sigma), one sigma per axis:"]
    lines += [f"  {name:16}{sigma_m:g} m" for name, sigma_m in ACCURACY_CLASSES.items()]
    lines += ["", "technologies (--technology):"]
    for name, each in TECHNOLOGIES.items():
        lines.append(f"  {name:16}every {each.period_s:g} s, {each.range_m:g} m, {each.loss:.0%} lost close by")
    lines += ["", "faults ([[event]] of a scenario file, or a line on stdin):"]
    for what, figures in EVENTS.items():
        told = [name if figure.default is None else f"[{name}]" for name, figure in figures.items()]
        lines.append(f"  {what:16}{' '.join(told)}".rstrip())
    return "\n".join(lines)


def scenario_text(scenario: Scenario, config: FleetConfig) -> str:
    """Text of ``--explain``: the contents of a scenario, and how it would be flown.

    Raises:
        ConfigError: If such a fleet cannot fly it.
    """
    home = config.home_of(scenario)
    wind = scenario.wind
    speed_mps = math.hypot(*wind.velocity_ne_mps)
    lines = [
        f"{scenario.name}: {counted(len(scenario.vehicles), 'vehicle')}, at most {scenario.duration_s:g} s, "
        f"Remote ID every {_interval_s(scenario.interval_s, config):g} s",
        f"home {home.latitude_deg:.6f}, {home.longitude_deg:.6f}, {home.altitude_m:g} m; autopilot {config.autopilot}; "
        f"gnss {config.gnss}; technology {config.technology}; seed {config.seed}",
    ]
    if speed_mps or wind.gust_sigma_mps:
        lines.append(f"wind {speed_mps:g} m/s, gusts of {wind.gust_sigma_mps:g} m/s")
    flown_by = config.autopilots_of(scenario)
    for number, (vehicle, autopilot) in enumerate(zip(scenario.vehicles, flown_by, strict=True), start=1):
        lines.append(f"  vehicle {number}: {_vehicle_text(vehicle, config, autopilot)}")
    for number, obstacle in enumerate(scenario.obstacles, start=1):
        corners = " ".join(f"({north:g}, {east:g})" for north, east in obstacle.polygon_ne_m)
        lines.append(f"  obstacle {number}: {corners}")
    for event in scenario.events:
        whom = f"vehicle {event.vehicle}" if event.vehicle else "everybody"
        figures = ", ".join(f"{name} {value:g}" for name, value in event.figures.items())
        lines.append(f"  {event.at_s:g} s: {event.what}, {whom}{': ' if figures else ''}{figures}")
    return "\n".join(lines)


def _vehicle_text(vehicle: VehicleSpec, config: FleetConfig, autopilot: str) -> str:
    way = (vehicle.start_ned_m, *vehicle.route_ned_m, vehicle.goal_ned_m)
    length_m = sum(math.dist(*leg) for leg in pairwise(way))
    sigma_m = config.sigma_m if vehicle.sigma_m is None else vehicle.sigma_m
    start, goal = ("(" + ", ".join(f"{x:g}" for x in point) + ")" for point in (way[0], way[-1]))
    text = f"{start} to {goal}, {length_m:.0f} m at {vehicle.speed_mps:g} m/s; {vehicle.airframe_m:g} m wide, "
    text += f"sigma {sigma_m:g} m"
    if vehicle.ghost:
        return f"{text}; a ghost"
    airframe = vehicle.airframe or config.airframe or MEASURED[autopilot]
    model_for_speed(autopilot, vehicle.speed_mps, airframe)  # raises if it cannot be flown
    text += f"; {airframe}"
    habits = {
        f"{vehicle.autopilot}": vehicle.autopilot is not None,
        counted(len(way) - 2, "point") + " on its way": bool(vehicle.route_ned_m),
        "avoids nobody": not vehicle.cooperative,
        "stock Remote ID": not vehicle.extended,
        "silent": vehicle.silent,
        f"every {_interval_s(vehicle.interval_s or 0.0, config):g} s": vehicle.interval_s is not None,
    }
    return "; ".join([text, *(habit for habit, has in habits.items() if has)])


def _interval_s(wanted_s: float, config: FleetConfig) -> float:
    """Broadcast period: the wanted one, but not shorter than that of the technology."""
    return max(wanted_s, TECHNOLOGIES[config.technology].period_s)
