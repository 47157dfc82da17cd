"""An emulated autopilot, PX4 or ArduPilot by choice, that MAVSDK, mavutil and MAVProxy take for real.

`board` is what every part knows of its vehicle. `pilot` steers by `navigation`, with `guidance` for what it flies by
itself, `steering` for what comes from outside, `mission_flight` for its mission, `failsafes` for what nobody asked for,
and its `home`. It can be told something by
`setpoints`, `commands`, `orders`, `parameter_protocol` (of its `parameters`) and `mission_protocol`. `telemetry` is
what it tells (`attitude`: how it leans), `streams` how often and `rates` if nobody asks. `autopilot` is its MAVLink
face: `peers` with a `link` each, `answers` to what they say, `status_texts` for all of them.
"""

from __future__ import annotations

from sitl_sim.autopilot.autopilot import Autopilot, Outgoing
from sitl_sim.autopilot.link import Address
from sitl_sim.autopilot.modes import FLAVOURS, Mode
from sitl_sim.autopilot.navigation import FleetNavigation, Navigation
from sitl_sim.autopilot.pilot import Pilot, Start

__all__ = ["FLAVOURS", "Address", "Autopilot", "FleetNavigation", "Mode", "Navigation", "Outgoing", "Pilot", "Start"]
