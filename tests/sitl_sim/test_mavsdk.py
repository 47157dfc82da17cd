"""MAVSDK takes the emulated vehicle for a real one; skipped where MAVSDK is not installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from sitl_sim.server import FleetServer
from tests.sitl_sim.test_server import fly_both_autopilots, run_client

pytestmark = pytest.mark.skipif(importlib.util.find_spec("mavsdk") is None, reason="the extra mavsdk is not installed")

CLIENT = Path(__file__).with_name("mavsdk_client.py")


def test_mavsdk_arms_takes_off_flies_offboard_and_lands() -> None:
    async def act(server: FleetServer) -> None:
        seen = await run_client(f"127.0.0.1:{server.ports.vehicles[0]}", client=CLIENT)
        assert seen["home_deg"] == pytest.approx([47.39864, 8.545594], abs=1e-4)
        assert seen["height_m"] > 1.5 and seen["speed_mps"] > 2.0 and seen["in_air"]
        assert not server.autopilots[0].pilot.armed

    fly_both_autopilots(act)
