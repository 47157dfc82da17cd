"""An emulated autopilot, PX4 or ArduPilot by choice, that MAVSDK, mavutil and MAVProxy take for real.

`pilot` decides and steers by `navigation`, with `guidance` for what it flies by itself; `setpoints`, `commands` and
`parameters` are what it can be told, `telemetry` what it tells; `autopilot` is its MAVLink face.
"""

from __future__ import annotations

from sitl_sim.autopilot.autopilot import Address, Autopilot, Outgoing
from sitl_sim.autopilot.modes import FLAVOURS, Mode
from sitl_sim.autopilot.navigation import FleetNavigation, Navigation
from sitl_sim.autopilot.pilot import Pilot, Start

__all__ = ["FLAVOURS", "Address", "Autopilot", "FleetNavigation", "Mode", "Navigation", "Outgoing", "Pilot", "Start"]
