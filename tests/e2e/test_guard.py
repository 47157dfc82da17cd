"""`ridlink avoid --guard` over UDP beside MAVSDK, which flies a mission across somebody's path."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import sys
from typing import Any

import pytest

from ridlink.scenario import Scenario, VehicleSpec
from sitl_sim.autopilot import Start
from sitl_sim.fleet_config import FleetConfig
from sitl_sim.server import FleetServer
from tests.sitl_sim.fleets import ANY_PORT, run

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.skipif(importlib.util.find_spec("mavsdk") is None, reason="the extra mavsdk is not installed"),
]

ACROSS = Scenario(
    "across", 120.0,
    (
        VehicleSpec((0.0, 0.0, -50.0), (150.0, 0.0, -50.0)),
        VehicleSpec((60.0, -78.0, -50.0), (60.0, 250.0, -50.0), speed_mps=6.0, cooperative=False),
    ),
)  # fmt: skip
"""Who crosses sets out when the mission is under way at 4 m/s, twelve seconds from where the ways meet."""


async def line_of(process: asyncio.subprocess.Process, words: str) -> str:
    assert process.stdout is not None
    async for line in process.stdout:
        if words in line.decode():
            return line.decode()
    raise AssertionError(f"the process never said {words!r}")


async def program(*arguments: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(sys.executable, "-m", *arguments, stdout=asyncio.subprocess.PIPE)


async def flown(server: FleetServer, manner: str) -> dict[str, Any]:
    """A guard beside a mission; what MAVSDK saw, and where the ladder and the mode of the vehicle ended."""
    vehicle = f"127.0.0.1:{server.ports.vehicles[0]}"
    guard = await program(
        *("ridlink", "avoid", "--guard", "--json", "--vehicle", f"udpout:{vehicle}"),
        *("--rid", f"udpout:127.0.0.1:{server.ports.air}"),
    )
    try:
        await line_of(guard, "")
        client = await program("tests.e2e.guarded_mission", manner, vehicle)
        await line_of(client, "under way")
        server.begin_mission()
        seen: dict[str, Any] = json.loads(await line_of(client, "{"))
        assert await client.wait() == 0
    finally:
        guard.terminate()
        said = (await guard.communicate())[0].decode().splitlines()
    assert guard.returncode == 0
    return seen | {"last": json.loads(said[-1]), "steered_at_the_end": server.autopilots[0].is_avoiding}


@pytest.mark.parametrize("manner", ["through", "pilot"])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_mission_of_mavsdk_across_somebodys_path(autopilot: str, manner: str) -> None:
    seen: dict[str, Any] = {}
    config = FleetConfig(autopilot=autopilot, start=Start.HOLDING, **ANY_PORT)
    server = FleetServer(ACROSS, config)

    async def act(server: FleetServer) -> None:
        seen.update(await flown(server, manner))

    asyncio.run(run(server, act))
    verdict = server.world.verdict().as_dict()
    print(f"{autopilot}, {manner}: {seen['modes']}, items {seen['progress']}, nearest {verdict['min_separation_m']} m")
    assert verdict["macs"] == 0
    modes = seen["modes"]
    if manner == "through":
        # Found, taken over, handed back, once or twice; after the last item either autopilot does as it is used to.
        assert modes[:3] == ["MISSION", "OFFBOARD", "MISSION"]
        assert seen["progress"] == [2, 2]
    else:
        assert modes[:2] == ["MISSION", "OFFBOARD"] and modes[-1] not in ("OFFBOARD", "MISSION")
        assert modes.count("OFFBOARD") == 1, "what the pilot has stays his"
    assert not seen["steered_at_the_end"]
