"""Two emulated vehicles and their two daemons in one program, over real sockets on loopback: a quarter minute.

The vehicles start 120 m apart, and the goal of each is behind the other. The kernel chooses the ports.
"""

import asyncio

import numpy as np

from ridlink.daemon.config import DaemonConfig
from ridlink.daemon.service import AvoidDaemon
from ridlink.engine import EngineConfig, Goal
from ridlink.geodesy import geodetic_from_ned
from ridlink.links import parse_link_url
from ridlink.scenario import Scenario, VehicleSpec
from sitl_sim.autopilot import Start
from sitl_sim.fleet_config import FleetConfig
from sitl_sim.server import FleetServer

SCENARIO = Scenario(
    name="two",
    duration_s=60.0,
    vehicles=(
        VehicleSpec(start_ned_m=(-60.0, 0.0, -50.0), goal_ned_m=(60.0, 0.0, -50.0), sigma_m=1.0),
        VehicleSpec(start_ned_m=(60.0, 0.0, -50.0), goal_ned_m=(-60.0, 0.0, -50.0), sigma_m=1.0),
    ),
)


async def main() -> None:
    fleet = FleetServer(SCENARIO, FleetConfig(start=Start.AIRBORNE, vehicle_port=0, companion_port=0, air_port=0))
    await fleet.start()
    daemons = []
    for index, vehicle in enumerate(SCENARIO.vehicles):
        latitude, longitude, altitude = geodetic_from_ned(vehicle.goal_ned_m, fleet.home)
        config = DaemonConfig(
            vehicle=parse_link_url(f"udpout:127.0.0.1:{fleet.ports.vehicles[index]}"),
            remote_id=parse_link_url(f"udpout:127.0.0.1:{fleet.ports.air}"),
            engine=EngineConfig(goal=Goal(float(latitude), float(longitude), float(altitude)), vehicle_sysid=index + 1),
        )
        daemons.append(AvoidDaemon(config))
    stop = asyncio.Event()
    tasks = [asyncio.create_task(fleet.run(stop)), *(asyncio.create_task(daemon.run(stop)) for daemon in daemons)]
    print("  time   north 1   east 1   north 2   east 2   apart")
    while not fleet.world.finished:
        first, second = fleet.world.position_ned_m[:, :2]
        apart = float(np.hypot(*(first - second)))
        where = f"{first[0]:8.1f} {first[1]:8.1f} {second[0]:9.1f} {second[1]:8.1f}"
        print(f"{fleet.world.time_s:5.1f} s {where} {apart:7.1f} m")
        await asyncio.sleep(1.0)
    stop.set()
    await asyncio.gather(*tasks)
    await fleet.close()
    verdict = fleet.world.verdict()
    print(f"{verdict.arrived} arrived, {verdict.macs} collisions, never nearer than {verdict.min_separation_m:.1f} m")


asyncio.run(main())
