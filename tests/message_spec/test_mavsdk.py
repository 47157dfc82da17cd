"""MAVSDK takes ridlink.xml as it stands, include and all, and hands out what our encoder sends."""

from __future__ import annotations

import asyncio
import json
import socket
from pathlib import Path
from typing import Any

import pytest

from ridlink.mavlink.codec import Encoder
from tests.loopback import free_port

pytest.importorskip("mavsdk", reason="the extra 'mavsdk' is not installed")

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync

XML = (Path(__file__).parents[2] / "message_spec" / "ridlink.xml").read_text()

SENT = {
    "id_or_mac": bytes(range(20)),
    "timestamp": 1234.5,
    "horizontal_error": 1050,
    "vertical_error": 65535,
    "velocity_error": 90,
    "airframe_size": 60,
    "airframe_height": 35,
    "update_interval": 100,
    "commanded_vx": 800,
    "commanded_vy": -32767,
    "commanded_vz": -1,
    "flags": 11,
}


async def received_by_mavsdk() -> dict[str, Any]:
    """Fields of the first RIDLINK_SEPARATION that MAVSDK hands out."""
    port = free_port()
    encoder = Encoder(1, 1)
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.setblocking(False)

        async def answer() -> None:
            """Speak whenever MAVSDK does: it sends a heartbeat every second."""
            while True:
                heartbeat = encoder.encode("HEARTBEAT", type=2, autopilot=12, system_status=4, mavlink_version=3)
                vehicle.sendto(heartbeat, ("127.0.0.1", port))
                vehicle.sendto(encoder.encode("RIDLINK_SEPARATION", **SENT), ("127.0.0.1", port))
                await asyncio.get_running_loop().sock_recv(vehicle, 2048)

        async with Mavsdk(configuration) as sdk:
            await sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
            sending = asyncio.create_task(answer())
            try:
                system = await sdk.first_autopilot(timeout_s=20)
                assert system is not None
                direct = MavlinkDirectAsync(system)
                await direct.load_custom_xml(XML)
                async for message in direct.subscribe_message("RIDLINK_SEPARATION"):
                    return {"system_id": message.system_id, **json.loads(message.fields_json)}
            finally:
                sending.cancel()
    raise AssertionError("the subscription ended without a message")


def test_mavsdk_receives_our_message_with_our_xml() -> None:
    received = asyncio.run(asyncio.wait_for(received_by_mavsdk(), timeout=40))
    assert received["system_id"] == 1
    assert received["message_id"] == 61400
    assert {name: received[name] for name in SENT} == SENT | {"id_or_mac": list(range(20))}
