"""Models of a multirotor: response to velocity setpoints, airframe types, wind, battery, state."""

from __future__ import annotations

from sitl_sim.vehicle.airframe import AIRFRAMES, MEASURED, Airframe, load_airframe, model_for_speed
from sitl_sim.vehicle.battery import BatteryType, FleetBattery
from sitl_sim.vehicle.dynamics import FleetDynamics
from sitl_sim.vehicle.models import GRAVITY_MPS2, TICK_S, Ideal, Model, ShapedTarget, VelocityFeedback
from sitl_sim.vehicle.state import VehicleState
from sitl_sim.vehicle.wind import FleetWind

AUTOPILOTS = ("ideal", "px4", "ardupilot")
"""Allowed names for ``--autopilot``."""

__all__ = [
    "AIRFRAMES",
    "AUTOPILOTS",
    "GRAVITY_MPS2",
    "MEASURED",
    "TICK_S",
    "Airframe",
    "BatteryType",
    "FleetBattery",
    "FleetDynamics",
    "FleetWind",
    "Ideal",
    "Model",
    "ShapedTarget",
    "VehicleState",
    "VelocityFeedback",
    "load_airframe",
    "model_for_speed",
]
