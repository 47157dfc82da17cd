"""MAVSDK takes the emulated vehicle for a real one; skipped where MAVSDK is not installed."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from ridlink.scenario import built_in
from sitl_sim.server import FleetServer
from tests.sitl_sim.fleets import fly, fly_both_autopilots, run_client

pytestmark = [
    pytest.mark.programs,
    pytest.mark.skipif(importlib.util.find_spec("mavsdk") is None, reason="the extra mavsdk is not installed"),
]

CLIENT = Path(__file__).with_name("mavsdk_client.py")


def test_mavsdk_does_with_either_autopilot_all_that_it_can() -> None:
    async def act(server: FleetServer) -> None:
        seen = await run_client("fly", f"127.0.0.1:{server.ports.vehicles[0]}", client=CLIENT)
        assert seen["home_deg"] == pytest.approx([47.39864, 8.545594], abs=1e-4)
        assert seen["height_m"] > 1.5 and seen["speed_mps"] > 1.8 and seen["in_air"]
        assert seen["east_m"] == pytest.approx(3.0, abs=0.7) and seen["goto_m"] == pytest.approx(-3.0, abs=0.8)
        count = 14 if server.config.autopilot == "ardupilot" else 16
        assert seen["parameters"] == [45.5, 4321, count]
        assert seen["mission"] == {"read_back": [0.0, 1.0, 2.0, 3.0, 4.0], "progress": [5, 5]}
        assert not server.autopilots[0].pilot.armed

    fly_both_autopilots(act)


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_twenty_vehicles_take_off_and_land_at_once(flavour: str) -> None:
    async def act(server: FleetServer) -> None:
        addresses = [f"127.0.0.1:{port}" for port in server.ports.vehicles]
        assert (await run_client("many", *addresses, client=CLIENT))["landed"] == list(range(1, 21))

    server = fly(built_in("circle8", 20), act, sigma_m=0.0, autopilot=flavour)
    assert not any(autopilot.pilot.armed for autopilot in server.autopilots)


def test_conductors_of_a_fleet_that_is_not_heard_say_so_and_end_though_nobody_has_told_them_to() -> None:
    program = (
        "import sys; from sitl_sim.demo import from_ground; from_ground.DISCOVERY_S = 0.3\n"
        "sys.exit(from_ground.main(sys.argv[1:]))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, "udpout:127.0.0.1:9=30"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.wait(60.0) == 3, "stdin is open all the while"
        assert process.stderr is not None and process.stderr.read() == "ridlink: MAVSDK hears 0 of 1 vehicle\n"
