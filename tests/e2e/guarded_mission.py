"""MAVSDK flies a mission, run as a process of its own.

    python -m tests.e2e.guarded_mission through 127.0.0.1:PORT      follows it to its end
    python -m tests.e2e.guarded_mission pilot 127.0.0.1:PORT        has the vehicle hold when it was taken over

The last line on stdout is a JSON object with what was seen; the line before says that the vehicle is under way.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.autopilot import Autopilot
from mavsdk.plugins.mission import MissionPlan
from mavsdk.plugins.telemetry import FlightMode

from tests.sitl_sim import mavsdk_client
from tests.sitl_sim.mavsdk_client import NORTH_M_PER_DEG, ground_station, until, waypoint

NORTH_M = (110.0, 130.0)
HEIGHT_M = 50.0
LOOKED_ON = 60
"""Words of its position that a pilot waits for: whether the vehicle stays his."""


async def fly(manner: str, address: str) -> dict[str, Any]:
    modes: list[str] = []
    async with ground_station() as mavsdk:
        await mavsdk.add_any_connection(f"udpout://{address}")
        system = await mavsdk.first_autopilot(timeout_s=mavsdk_client.PATIENCE_S)
        assert system is not None, "no autopilot found"
        telemetry, missions, action = TelemetryAsync(system), MissionAsync(system), ActionAsync(system)
        if await system.autopilot_type() == Autopilot.ARDUPILOT:  # which takes no speed from MAVSDK's items
            await ParamAsync(system).set_param_float("WPNAV_SPEED", 400.0)
        at = await until(telemetry.subscribe_position(), lambda at: at.relative_altitude_m > 1.0)
        places = [at.latitude_deg + north_m / NORTH_M_PER_DEG for north_m in NORTH_M]
        await missions.upload_mission(MissionPlan([waypoint(place, at.longitude_deg, HEIGHT_M) for place in places]))
        await missions.start_mission()
        await until(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.MISSION)

        async def note_modes() -> None:
            async for mode in telemetry.subscribe_flight_mode():
                if modes[-1:] != [mode.name]:
                    modes.append(mode.name)

        noting = asyncio.create_task(note_modes())
        await until(telemetry.subscribe_position_velocity_ned(), lambda state: state.velocity.north_m_s > 3.0)
        print("under way", flush=True)
        if manner == "pilot":
            await until(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.OFFBOARD)
            await until(telemetry.subscribe_position_velocity_ned(), lambda state: abs(state.velocity.east_m_s) > 0.5)
            await action.hold()
            await until(telemetry.subscribe_flight_mode(), lambda mode: mode != FlightMode.OFFBOARD)
            left = LOOKED_ON
            async for _ in telemetry.subscribe_position():
                left -= 1
                if not left:
                    break
        else:
            await until(missions.subscribe_mission_progress(), lambda progress: progress.current == progress.total)
        progress = await missions.mission_progress()
        noting.cancel()
        await asyncio.gather(noting, return_exceptions=True)
        return {"modes": modes, "progress": [progress.current, progress.total]}


if __name__ == "__main__":
    mavsdk_client.PATIENCE_S = 120.0
    print(json.dumps(asyncio.run(fly(sys.argv[1], sys.argv[2]))))
