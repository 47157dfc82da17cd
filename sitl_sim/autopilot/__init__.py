"""An emulated autopilot, PX4 or ArduPilot, that works with MAVSDK, mavutil and MAVProxy like a real one.

`board` has the facts of the vehicle that every part needs. `pilot` is what it is doing: it steers by `navigation`, with
`guidance` for its own manoeuvres, `steering` for setpoints and sticks, `mission_flight` for its mission, `failsafes`,
and its `home`. `routine` is what it does by itself as time passes; `standing` disarms it. Its inputs are `setpoints`,
`commands`, `orders`, `parameter_protocol` (of its `parameters`) and `mission_protocol`. `telemetry` makes its messages
(`attitude`: roll and pitch), `streams` sets their rates, and `rates` has the default rates. `autopilot` is its MAVLink
interface: `peers` with a `link` each, `answers` to their messages, `status_texts` for all of them.
"""

from __future__ import annotations

from sitl_sim.autopilot.autopilot import Autopilot, Outgoing
from sitl_sim.autopilot.link import Address
from sitl_sim.autopilot.modes import FLAVOURS, Mode
from sitl_sim.autopilot.navigation import FleetNavigation, Navigation
from sitl_sim.autopilot.pilot import Pilot, Start

__all__ = ["FLAVOURS", "Address", "Autopilot", "FleetNavigation", "Mode", "Navigation", "Outgoing", "Pilot", "Start"]
