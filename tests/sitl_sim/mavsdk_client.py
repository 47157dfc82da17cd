"""Clients of MAVSDK, run as processes of their own.

    python mavsdk_client.py fly 127.0.0.1:PORT       everything that one vehicle is asked for, from arming to disarming
    python mavsdk_client.py many 127.0.0.1:PORT ...  arm, take off and land with many vehicles at once

The last line on stdout is a JSON object with what was seen.
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from contextlib import aclosing, asynccontextmanager
from typing import Any, TypeVar

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync, PositionNedYaw, VelocityNedYaw
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.autopilot import Autopilot
from mavsdk.plugins.mission import MissionItem, MissionPlan

PATIENCE_S = 25.0
NORTH_M_PER_DEG = 111_180.0

NAN = math.nan

T = TypeVar("T")


async def until(stream: AsyncGenerator[T, None], wanted: Callable[[T], Any]) -> T:
    """The first of a stream that is wanted."""
    latest: T | None = None
    try:
        async with asyncio.timeout(PATIENCE_S), aclosing(stream):
            async for latest in stream:
                if wanted(latest):
                    return latest
    except TimeoutError:
        pass
    raise SystemExit(f"{stream} never came to what was wanted; last {latest}")


def waypoint(latitude_deg: float, longitude_deg: float, height_m: float) -> MissionItem:
    return MissionItem(
        latitude_deg, longitude_deg, height_m, 4.0, True, NAN, NAN, MissionItem.CameraAction.NONE,
        NAN, NAN, 1.0, NAN, NAN, MissionItem.VehicleAction.NONE,
    )  # fmt: skip


@asynccontextmanager
async def ground_station() -> AsyncIterator[Mavsdk]:
    """MAVSDK, which aborts the process if a worker thread of the loop still holds a part of it when it ends."""
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        yield mavsdk
        await asyncio.get_running_loop().shutdown_default_executor()


async def fly(address: str) -> dict[str, Any]:
    async with ground_station() as mavsdk:
        await mavsdk.add_any_connection(f"udpout://{address}")
        system = await mavsdk.first_autopilot(timeout_s=PATIENCE_S)
        assert system is not None, "no autopilot found"
        telemetry, action, offboard = TelemetryAsync(system), ActionAsync(system), OffboardAsync(system)
        await until(telemetry.subscribe_health_all_ok(), bool)
        home = await telemetry.home()
        parameters = await set_and_get(ParamAsync(system), await system.autopilot_type())
        await action.set_takeoff_altitude(2.0)
        await action.arm()
        await until(telemetry.subscribe_armed(), bool)
        await action.takeoff()
        up = await until(telemetry.subscribe_position_velocity_ned(), lambda state: state.position.down_m < -1.5)

        await offboard.set_velocity_ned(VelocityNedYaw(3.0, 0.0, 0.0, 0.0))
        await offboard.start()
        moving = await until(telemetry.subscribe_position_velocity_ned(), lambda state: state.velocity.north_m_s > 1.8)
        in_air = await telemetry.in_air()
        north = moving.position.north_m
        await offboard.set_position_ned(PositionNedYaw(north, 3.0, -2.0, 0.0))
        there = await until(
            telemetry.subscribe_position_velocity_ned(),
            lambda state: abs(state.position.north_m - north) < 1.0 and abs(state.position.east_m - 3.0) < 0.7,
        )
        await offboard.stop()

        at = await telemetry.position()
        goal = at.latitude_deg - 3.0 / NORTH_M_PER_DEG
        await action.goto_location(goal, at.longitude_deg, at.absolute_altitude_m, 0.0)
        went = await until(
            telemetry.subscribe_position(), lambda at: abs(at.latitude_deg - goal) * NORTH_M_PER_DEG < 0.7
        )

        flown = await mission(MissionAsync(system), goal, at.longitude_deg)
        await action.land()
        await until(telemetry.subscribe_armed(), lambda armed: not armed)
        await until(telemetry.subscribe_in_air(), lambda flying: not flying)
        return {
            "home_deg": [home.latitude_deg, home.longitude_deg],
            "height_m": -up.position.down_m,
            "speed_mps": moving.velocity.north_m_s,
            "east_m": there.position.east_m,
            "goto_m": (went.latitude_deg - at.latitude_deg) * NORTH_M_PER_DEG,
            "in_air": in_air,
            "parameters": parameters,
            "mission": flown,
        }


async def set_and_get(param: ParamAsync, autopilot: Autopilot) -> list[Any]:
    """A float and an integer, written and read back, and how many there are."""
    is_ardupilot = autopilot == Autopilot.ARDUPILOT
    a_float, an_int = ("WPNAV_SPEED", "RTL_ALT") if is_ardupilot else ("MPC_XY_CRUISE", "SYS_AUTOSTART")
    await param.set_param_float(a_float, 45.5)
    await param.set_param_int(an_int, 4321)
    everything = await param.get_all_params()
    seen = [await param.get_param_float(a_float), await param.get_param_int(an_int)]
    await param.set_param_float(a_float, 400.0 if is_ardupilot else 5.0)
    return [*seen, len(everything.float_params) + len(everything.int_params)]


async def mission(missions: MissionAsync, latitude_deg: float, longitude_deg: float) -> dict[str, Any]:
    """Five items, a metre and a half from one to the next: up, down, and flown to the end."""
    step_deg = 1.5 / NORTH_M_PER_DEG
    plan = MissionPlan([waypoint(latitude_deg + k * step_deg, longitude_deg, 2.5) for k in range(5)])
    await missions.upload_mission(plan)
    back = await missions.download_mission()
    await missions.start_mission()
    progress = await until(missions.subscribe_mission_progress(), lambda progress: progress.current == progress.total)
    assert await missions.is_mission_finished()
    return {
        "read_back": [round((item.latitude_deg - latitude_deg) / step_deg, 2) for item in back.mission_items],
        "progress": [progress.current, progress.total],
    }


async def many(addresses: list[str]) -> dict[str, Any]:
    async with ground_station() as mavsdk:
        for address in addresses:
            await mavsdk.add_any_connection(f"udpout://{address}")
        systems = await discovered(mavsdk, len(addresses))
        ids = [await system.get_system_id() for system in systems]
        await asyncio.gather(*(up_and_down(system) for system in systems))
        return {"landed": sorted(ids)}


async def discovered(mavsdk: Mavsdk, count: int) -> list[Any]:
    """That many systems, once they are there; those before the question count."""
    news = mavsdk.on_new_system()
    async with asyncio.timeout(PATIENCE_S), aclosing(news):
        waiting = asyncio.ensure_future(anext(news))  # listens before it asks: no system is missed in between
        while len(systems := await mavsdk.get_systems()) < count:
            await waiting
            waiting = asyncio.ensure_future(anext(news))
        waiting.cancel()
        await asyncio.wait([waiting])
    return systems


async def up_and_down(system: Any) -> None:
    telemetry, action = TelemetryAsync(system), ActionAsync(system)
    await until(telemetry.subscribe_health_all_ok(), bool)
    await action.set_takeoff_altitude(1.0)
    await action.arm()
    await action.takeoff()
    await until(telemetry.subscribe_in_air(), bool)
    await until(telemetry.subscribe_position(), lambda at: at.relative_altitude_m > 0.6)
    await action.land()
    await until(telemetry.subscribe_armed(), lambda armed: not armed)


if __name__ == "__main__":
    print(json.dumps(asyncio.run(fly(sys.argv[2]) if sys.argv[1] == "fly" else many(sys.argv[2:]))))
