"""A client of MAVSDK, run as a process of its own: connect, arm, take off, fly north in offboard, land.

    python mavsdk_client.py 127.0.0.1:PORT

The last line on stdout is a JSON object with what was seen.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from collections.abc import Awaitable, Callable
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync, VelocityNedYaw
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

PATIENCE_S = 15.0


async def until(question: Callable[[], Awaitable[Any]], wanted: Callable[[Any], bool]) -> Any:
    """Ask until the answer is wanted."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        answer = await question()
        if wanted(answer):
            return answer
        await asyncio.sleep(0.05)
    raise SystemExit(f"{question} never came to what was wanted; last {answer}")


async def fly(address: str) -> dict[str, Any]:
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(f"udpout://{address}")
        system = await mavsdk.first_autopilot(timeout_s=PATIENCE_S)
        assert system is not None, "no autopilot found"
        telemetry, action, offboard = TelemetryAsync(system), ActionAsync(system), OffboardAsync(system)
        await until(telemetry.health_all_ok, bool)
        home = await telemetry.home()
        await action.set_takeoff_altitude(2.0)
        await action.arm()
        await until(telemetry.armed, bool)
        await action.takeoff()
        up = await until(telemetry.position_velocity_ned, lambda state: state.position.down_m < -1.5)
        await offboard.set_velocity_ned(VelocityNedYaw(3.0, 0.0, 0.0, 0.0))
        await offboard.start()
        moving = await until(telemetry.position_velocity_ned, lambda state: state.velocity.north_m_s > 2.0)
        in_air = await telemetry.in_air()
        await offboard.stop()
        await action.land()
        await until(telemetry.armed, lambda armed: not armed)
        return {
            "home_deg": [home.latitude_deg, home.longitude_deg],
            "height_m": -up.position.down_m,
            "speed_mps": moving.velocity.north_m_s,
            "in_air": in_air,
        }


if __name__ == "__main__":
    print(json.dumps(asyncio.run(fly(sys.argv[1]))))
